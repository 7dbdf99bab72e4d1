//! Distance between two results: caches, checkpoints, or whole run folders.
//!
//! Caches may be of different formats, units and axes: both sides are compared in metres with Y up, frame by frame and
//! vertex by vertex. Files with the same bytes are not opened at all, unless they are layers of USD, which may refer to others.

mod caches;
mod checkpoints;
mod folders;

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

use drapery_io::error::IoError;
use drapery_io::formats;
use drapery_io::input_file;
use serde::Serialize;

/// Bytes that are compared at a time.
const BLOCK: usize = 1 << 16;

/// Outcome of a comparison in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The files have the same bytes.
    ByteEqual,
    /// The bytes differ, such as by the format or the name of a program; every value is the same.
    Equal,
    /// Values differ, by no more than the tolerance.
    WithinTolerance,
    /// Values differ by more than the tolerance, or one side has what the other lacks.
    Differs,
}

impl Verdict {
    /// The word for people.
    pub fn word(self) -> &'static str {
        match self {
            Self::ByteEqual => "byte-equal",
            Self::Equal => "equal",
            Self::WithinTolerance => "within tolerance",
            Self::Differs => "differs",
        }
    }
}

/// Comparison of two files or of two folders.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The worst of all parts.
    pub verdict: Verdict,
    /// Largest distance that was allowed [m].
    pub tolerance: f64,
    /// Comparison of each pair of files.
    pub parts: Vec<PartComparison>,
}

/// Comparison of two files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PartComparison {
    /// First file.
    pub a: String,
    /// Second file.
    pub b: String,
    /// Outcome of the comparison.
    pub verdict: Verdict,
    /// Items that the two sides do not have in common, and differences that are not distances.
    pub notes: Vec<String>,
    /// Vertex that is farthest from its like, if any is away from it at all.
    pub worst: Option<WorstVertex>,
    /// Distances in every frame that both sides have, and in every sample between frames; empty for files with the same bytes, and for checkpoints.
    pub frames: Vec<FrameDistance>,
    /// Arrays that differ; only of checkpoints.
    pub datasets: Vec<DatasetDifference>,
}

/// Distances between the vertices of two caches in one frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameDistance {
    /// The frame.
    pub frame: i64,
    /// Offset of the sample behind the frame, in frames: 0 for the frame itself.
    pub behind: f64,
    /// Largest distance between a vertex and its like [m].
    pub max: f64,
    /// Root of the mean square distance over all vertices [m].
    pub rms: f64,
    /// Largest difference between the velocities [m/s]; `None` when a side stores none.
    pub max_velocity: Option<f64>,
    /// The vertex that is farthest away.
    pub vertex: usize,
    /// Path of its mesh.
    pub mesh: String,
}

/// The vertex that is farthest from its like.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorstVertex {
    /// Path of the mesh in the cache, or name of the array of a checkpoint.
    pub mesh: String,
    /// Number of the vertex, from 0.
    pub vertex: usize,
    /// Frame; that of the checkpoint, for one.
    pub frame: i64,
    /// Offset of the sample behind the frame, in frames.
    pub behind: f64,
    /// Distance [m].
    pub distance: f64,
}

/// Difference of an array of a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DatasetDifference {
    /// Section and array: `state/positions`.
    pub name: String,
    /// Number of values that differ.
    pub count: usize,
    /// Number of values.
    pub values: usize,
    /// Largest difference, in the array's own unit.
    pub max: f64,
    /// Place of the first value that differs.
    pub first: usize,
}

/// Compares two caches, two checkpoints or two run folders; distances of up to `tolerance` [m] are let pass.
///
/// # Errors
/// A side is missing, damaged, or not of the kind of the other.
pub fn compare(a: &Path, b: &Path, tolerance: f64) -> Result<Comparison, IoError> {
    let is_folder = |path: &Path| std::fs::metadata(path).map(|m| m.is_dir()).map_err(|e| IoError::reading(path, e));
    let parts = match (is_folder(a)?, is_folder(b)?) {
        (true, true) => folders::compare(a, b, tolerance)?,
        (false, false) => vec![compare_files(a, b, tolerance)?],
        (folder, _) => {
            let (path, other) = if folder { (a, b) } else { (b, a) };
            return Err(IoError::Format {
                path: path.to_owned(),
                what: format!("this is a folder, and {} is a file", other.display()),
                advice: "give two files or two run folders".into(),
            });
        }
    };
    // A folder without caches has nothing that could differ.
    let verdict = parts.iter().map(|part| part.verdict).max().unwrap_or(Verdict::Equal);
    Ok(Comparison { verdict, tolerance, parts })
}

fn compare_files(a: &Path, b: &Path, tolerance: f64) -> Result<PartComparison, IoError> {
    if same_bytes(a, b)? && same_folders(a, b)? && !refers_to_others(a) {
        return Ok(PartComparison::new(a, b, Verdict::ByteEqual));
    }
    match (checkpoints::is_checkpoint(a), checkpoints::is_checkpoint(b)) {
        (true, true) => checkpoints::compare(a, b, tolerance),
        (false, false) => caches::compare(a, b, tolerance),
        (is_first, _) => Err(IoError::Format {
            path: if is_first { a } else { b }.to_owned(),
            what: format!("this is a checkpoint, and {} is not", if is_first { b } else { a }.display()),
            advice: "give two caches or two checkpoints".into(),
        }),
    }
}

impl PartComparison {
    fn new(a: &Path, b: &Path, verdict: Verdict) -> Self {
        Self {
            a: a.display().to_string(),
            b: b.display().to_string(),
            verdict,
            notes: Vec::new(),
            worst: None,
            frames: Vec::new(),
            datasets: Vec::new(),
        }
    }
}

/// Whether a file may be made of others that are not in a folder of its own: a stage whose layers may lie anywhere.
fn refers_to_others(path: &Path) -> bool {
    let is_alone = || formats::folder_of(path).is_some_and(|folder| folder.is_dir());
    formats::of_file(path).is_some_and(|format| format.refers_to_others) && !is_alone()
}

/// Whether the folders that belong to two caches, if there are any, hold the same files with the same bytes.
fn same_folders(a: &Path, b: &Path) -> Result<bool, IoError> {
    let files = |cache: &Path| -> Result<Option<BTreeSet<PathBuf>>, IoError> {
        let Some(folder) = formats::folder_of(cache).filter(|folder| folder.is_dir()) else { return Ok(None) };
        let (mut found, mut waiting) = (BTreeSet::new(), vec![PathBuf::new()]);
        while let Some(inner) = waiting.pop() {
            let here = folder.join(&inner);
            for entry in std::fs::read_dir(&here).map_err(|e| IoError::reading(&here, e))? {
                let path = inner.join(entry.map_err(|e| IoError::reading(&here, e))?.file_name());
                if folder.join(&path).is_dir() {
                    waiting.push(path);
                } else {
                    found.insert(path);
                }
            }
        }
        Ok(Some(found))
    };
    let (files_a, files_b) = (files(a)?, files(b)?);
    if files_a != files_b {
        return Ok(false);
    }
    let in_folder = |cache: &Path, file: &Path| formats::folder_of(cache).unwrap_or_default().join(file);
    for file in files_a.iter().flatten() {
        if !same_bytes(&in_folder(a, file), &in_folder(b, file))? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Whether two files have the same bytes.
fn same_bytes(a: &Path, b: &Path) -> Result<bool, IoError> {
    let open = |path: &Path| {
        let file = input_file::open(path)?;
        let length = file.metadata().map_err(|e| IoError::reading(path, e))?.len();
        Ok::<_, IoError>((file, length))
    };
    let ((mut file_a, length_a), (mut file_b, length_b)) = (open(a)?, open(b)?);
    if length_a != length_b {
        return Ok(false);
    }
    let (mut block_a, mut block_b) = (Vec::with_capacity(BLOCK), Vec::with_capacity(BLOCK));
    loop {
        for (path, file, block) in [(a, &mut file_a, &mut block_a), (b, &mut file_b, &mut block_b)] {
            block.clear();
            file.take(BLOCK as u64).read_to_end(block).map_err(|e| IoError::reading(path, e))?;
        }
        if block_a != block_b {
            return Ok(false);
        }
        if block_a.is_empty() {
            return Ok(true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_one_length_with_one_other_byte_are_not_byte_equal() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let mut bytes = vec![7; 3 * BLOCK + 5];
        let a = write("a", &bytes);
        let same = write("same", &bytes);
        bytes[2 * BLOCK + 1] = 8;
        let other = write("other", &bytes);
        assert!(same_bytes(&a, &same).unwrap());
        assert!(!same_bytes(&a, &other).unwrap());
        assert!(same_bytes(&a, &folder.path().join("missing")).is_err());
    }

    #[test]
    fn the_worst_part_decides() {
        assert!(Verdict::Differs > Verdict::WithinTolerance && Verdict::Equal > Verdict::ByteEqual);
    }
}

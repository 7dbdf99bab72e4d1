//! Two run folders: all caches that their manifests list, by name.

use std::path::{Path, PathBuf};

use drapery_io::error::IoError;
use drapery_shot::run_record::MANIFEST;
use drapery_shot::run_record::folder::no_run;
use drapery_shot::run_record::manifest::listed_files;

use super::{PartComparison, Verdict, compare_files};

/// Compares caches of the same file name, and those of a garment that the two runs wrote in different formats.
pub(super) fn compare(a: &Path, b: &Path, tolerance: f64) -> Result<Vec<PartComparison>, IoError> {
    let (files_a, files_b) = (caches(a)?, caches(b)?);
    let mut parts = Vec::new();
    for file in &files_a {
        parts.push(match partner(file, &files_b) {
            Some(other) => compare_files(file, other, tolerance)?,
            None => lone(file, b, "second"),
        });
    }
    let alone = files_b.iter().filter(|file| partner(file, &files_a).is_none());
    parts.extend(alone.map(|file| lone(file, a, "first")));
    Ok(parts)
}

/// Caches of a run that are there.
fn caches(folder: &Path) -> Result<Vec<PathBuf>, IoError> {
    if !folder.join(MANIFEST).is_file() {
        return Err(no_run(folder));
    }
    Ok(listed_files(folder).into_iter().filter(|path| path.is_file()).collect())
}

/// The file of the same name, or else one of the same garment.
fn partner<'a>(file: &Path, others: &'a [PathBuf]) -> Option<&'a PathBuf> {
    let same_name = others.iter().find(|other| other.file_name() == file.file_name());
    same_name.or_else(|| others.iter().find(|other| other.file_stem() == file.file_stem()))
}

/// A cache that only one of the folders has.
fn lone(file: &Path, other: &Path, side: &str) -> PartComparison {
    let mut part = PartComparison::new(file, other, Verdict::Differs);
    part.notes.push(format!("this cache is missing from the {side} folder"));
    part
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn caches_are_paired_by_name_and_else_by_garment() {
        let others: Vec<PathBuf> = ["b/skirt.h5", "b/skirt.abc", "b/vest.h5"].map(PathBuf::from).into();
        assert_eq!(partner(Path::new("a/skirt.abc"), &others), Some(&others[1]));
        assert_eq!(partner(Path::new("a/vest.abc"), &others), Some(&others[2]));
        assert_eq!(partner(Path::new("a/hat.abc"), &others), None);
    }
}

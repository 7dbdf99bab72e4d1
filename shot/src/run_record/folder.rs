//! The folder of a run as somebody finds it: manifest and record of a run that goes on, stopped, or is long done.
//!
//! Only read, never locked. What an older run did not write is empty.

use std::fs;
use std::path::{Path, PathBuf};

use drapery_io::error::IoError;
use drapery_io::input_file;
use drapery_io::shot_description::FRAMES;

use super::manifest::{Manifest, named_in};
use super::reader::Record;
use super::{MANIFEST, RECORD};

/// Contents of a run folder.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunFolder {
    /// The folder.
    pub path: PathBuf,
    /// Inventory of the folder.
    pub manifest: Manifest,
    /// Measurements of the run.
    pub record: Record,
}

/// Folders of the runs that a folder holds, as one of a wedge does, in the order of their names.
pub fn runs_in(folder: &Path) -> Vec<PathBuf> {
    let inside = fs::read_dir(folder).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let mut runs: Vec<PathBuf> = inside.filter(|folder| folder.join(MANIFEST).is_file()).collect();
    runs.sort_unstable();
    runs
}

/// A folder of a run as it is, and one of a wedge as its runs.
pub fn with_runs_in(folder: &Path) -> Vec<PathBuf> {
    let runs = if folder.join(MANIFEST).is_file() { Vec::new() } else { runs_in(folder) };
    if runs.is_empty() { vec![folder.to_owned()] } else { runs }
}

/// The error about a folder that has no manifest.
pub fn no_run(folder: &Path) -> IoError {
    IoError::NoRun { path: folder.to_owned(), runs: runs_in(folder) }
}

impl RunFolder {
    /// Reads manifest and record of a run.
    ///
    /// # Errors
    /// The folder holds no run, or its manifest cannot be understood.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        let manifest = path.join(MANIFEST);
        let text = input_file::text(&manifest).map_err(|error| match error {
            IoError::Missing { .. } => no_run(path),
            error => error,
        })?;
        let damaged = |place: String, what: String| {
            let advice = "it is replaced after every frame; restore it, or run the shot again";
            IoError::data(&manifest, place, what, advice)
        };
        let read: Manifest =
            serde_json::from_str(&text).map_err(|e| damaged(format!("line {}", e.line()), e.to_string()))?;
        let frames = [Some(read.first_frame), Some(read.last_frame), read.last_complete_frame];
        if let Some(frame) = frames.into_iter().flatten().find(|frame| !FRAMES.contains(frame)) {
            return Err(damaged("frames".to_owned(), format!("there is no frame {frame}")));
        }
        Ok(Self { path: path.to_owned(), manifest: read, record: Record::read(&path.join(RECORD))? })
    }

    /// Frames that are delivered so far, and in all.
    pub fn delivered(&self) -> (i64, i64) {
        let manifest = &self.manifest;
        let total = (manifest.last_frame - manifest.first_frame + 1).max(0);
        let done = manifest.last_complete_frame.map_or(0, |last| (last - manifest.first_frame + 1).clamp(0, total));
        (done, total)
    }

    /// The file of a cache; `None` for a name that leads out of the folder.
    pub fn cache(&self, name: &str) -> Option<PathBuf> {
        named_in(&self.path, name)
    }
}

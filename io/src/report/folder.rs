//! The folder of a run as somebody finds it: manifest and record of a run that goes on, stopped, or is long done.
//!
//! Only read, never locked. What an older run did not write is empty.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::record::Record;
use crate::error::IoError;
use crate::run_record::{MANIFEST, RECORD};

/// What a run folder tells.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunFolder {
    /// The folder.
    pub path: PathBuf,
    /// What is there.
    pub manifest: ManifestText,
    /// What was measured.
    pub record: Record,
}

/// The manifest, as far as readers of it need it.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct ManifestText {
    /// Program and version.
    pub application: String,
    /// Name of the shot.
    pub shot: String,
    /// Scene file.
    pub scene: String,
    /// `running`, `stopped`, `done` or `failed`.
    pub state: String,
    /// Why it failed.
    pub error: Option<String>,
    /// First frame that is delivered.
    pub first_frame: i64,
    /// Last frame that is delivered.
    pub last_frame: i64,
    /// Last frame that is complete in every cache.
    pub last_complete_frame: Option<i64>,
    /// Frames per second as a fraction.
    pub fps: String,
    /// Unit of length of the caches.
    pub length_unit: String,
    /// Up axis of the caches.
    pub up_axis: String,
    /// Garments and their caches.
    pub garments: Vec<GarmentText>,
    /// Number of threads.
    pub threads: u64,
    /// Processes that worked on the shot, one after the other.
    pub attempts: Vec<AttemptText>,
    /// Last good checkpoint.
    pub checkpoint: Option<CheckpointText>,
    /// Command line that goes on with the run.
    pub command: Option<String>,
}

/// A garment of the manifest.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct GarmentText {
    /// Its name.
    pub name: String,
    /// Number of points.
    pub points: u64,
    /// Its caches.
    pub files: Vec<String>,
}

/// A process that worked on the shot.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct AttemptText {
    /// Number, from 1.
    pub attempt: u64,
    /// Machine.
    pub host: String,
    /// Process number.
    pub pid: u64,
    /// Number of threads.
    pub threads: u64,
    /// First frame that it computed.
    pub first_frame: Option<i64>,
    /// Last frame that it completed.
    pub last_frame: Option<i64>,
    /// How long it worked [s].
    pub seconds: f64,
    /// How it ended; empty while it works, or when it was killed.
    pub end: Option<String>,
}

/// The last good checkpoint.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, serde::Serialize)]
#[serde(default)]
pub struct CheckpointText {
    /// Its file, relative to the folder.
    pub file: String,
    /// Last frame that it has reached.
    pub frame: i64,
    /// Collision steps since that frame.
    pub sub_step: u64,
}

impl RunFolder {
    /// Reads manifest and record of a run.
    ///
    /// # Errors
    /// The folder holds no run, or its manifest cannot be understood.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        let manifest = path.join(MANIFEST);
        let text = match std::fs::read_to_string(&manifest) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Err(IoError::NoRun { path: path.to_owned() });
            }
            Err(e) => return Err(IoError::reading(&manifest, e)),
        };
        let manifest = serde_json::from_str(&text).map_err(|e| {
            let advice = "it is replaced as a whole with every frame; restore it, or run the shot again";
            IoError::data(&manifest, format!("line {}", e.line()), e.to_string(), advice)
        })?;
        Ok(Self { path: path.to_owned(), manifest, record: Record::read(&path.join(RECORD))? })
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
        let is_name = Path::new(name).components().count() == 1 && name != "..";
        is_name.then(|| self.path.join(name))
    }
}

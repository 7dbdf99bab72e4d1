//! What an earlier run has left in a folder, and how it makes room for another.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::atomic_file;
use crate::error::IoError;
use crate::farm::digest::Fingerprint;
use crate::run_record::{self, AttemptRecord, FINGERPRINT, MANIFEST, RECORD, RESOLVED};

/// Folder inside that of a run for what a resumed run does not go on from.
const STALE: &str = "stale";

/// Key of the scene that says whether caches hold velocities.
const VELOCITIES: &str = "output.velocities";

/// An earlier run in a folder.
#[derive(Debug)]
pub(super) struct Earlier {
    /// Its manifest.
    manifest: Value,
    /// What it depended on; `None` when that is not known.
    pub(super) fingerprint: Option<Fingerprint>,
    /// Its attempts.
    pub(super) attempts: Vec<AttemptRecord>,
}

impl Earlier {
    /// The run in a folder, if there is one.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        let read = |name: &str| fs::read_to_string(folder.join(name)).ok();
        let manifest: Value = serde_json::from_str(&read(MANIFEST)?).ok()?;
        let fingerprint = read(FINGERPRINT).and_then(|text| serde_json::from_str(&text).ok());
        let attempts = serde_json::from_value(manifest["attempts"].clone()).unwrap_or_default();
        Some(Self { manifest, fingerprint, attempts })
    }

    /// Last frame that is complete in every cache.
    pub(super) fn last_complete_frame(&self) -> Option<i64> {
        self.manifest["last_complete_frame"].as_i64()
    }

    /// Whether its caches hold velocities where those of a shot would not, or the other way round.
    pub(super) fn stores_other_velocities(&self, now: &Fingerprint) -> bool {
        let stored = |fingerprint: &Fingerprint| fingerprint.scene.get(VELOCITIES).cloned();
        self.fingerprint.as_ref().is_some_and(|then| stored(then) != stored(now))
    }

    /// Whether all frames up to `last` are there, and the caches with them.
    pub(super) fn has_all(&self, folder: &Path, last: i64) -> bool {
        let files = run_record::listed_files(folder);
        self.last_complete_frame().is_some_and(|frame| frame >= last) && files.iter().all(|file| file.is_file())
    }
}

/// Writes what a run depends on.
pub(super) fn write_fingerprint(folder: &Path, fingerprint: &Fingerprint) -> Result<(), IoError> {
    // Texts only: they always have a JSON form.
    let text = serde_json::to_string_pretty(fingerprint).unwrap_or_default() + "\n";
    atomic_file::replace(&folder.join(FINGERPRINT), text.as_bytes())
}

/// Files of a run in `folder` beside its checkpoints and logs: those that are there of what every run writes, of the caches
/// `planned`, and of what the manifest lists.
pub(super) fn files_of_run(folder: &Path, planned: &[PathBuf]) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = [MANIFEST, RECORD, RESOLVED, FINGERPRINT].map(|name| folder.join(name)).into();
    files.extend(planned.iter().cloned());
    // Caches of the earlier run that this one does not write again would belong to nothing.
    files.extend(run_record::listed_files(folder));
    files.retain(|path| path.exists());
    files.sort();
    files.dedup();
    files
}

/// The folder into which an attempt sets aside what it does not go on from.
pub(super) fn stale(folder: &Path, attempt: u32) -> PathBuf {
    folder.join(STALE).join(format!("attempt_{attempt:03}"))
}

/// Moves files into `stale`, or copies them if they are `kept`.
pub(super) fn set_aside(files: &[PathBuf], stale: &Path, kept: bool) -> Result<(), IoError> {
    if !files.is_empty() {
        fs::create_dir_all(stale).map_err(|e| IoError::creating(stale, e))?;
    }
    for file in files {
        let to = stale.join(file.file_name().unwrap_or_default());
        let done = if kept { fs::copy(file, &to).map(|_| ()) } else { fs::rename(file, &to) };
        done.map_err(|e| IoError::writing(&to, e))?;
    }
    Ok(())
}

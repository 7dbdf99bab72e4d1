//! What an earlier run has left in a folder, and how it makes room for another.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::atomic_file;
use crate::checkpoint::store;
use crate::error::IoError;
use crate::farm::digest::Fingerprint;
use crate::run_record::{self, AttemptRecord, FINGERPRINT, MANIFEST, RECORD, RESOLVED};

/// Folder inside that of a run for what a resumed run does not go on from.
const STALE: &str = "stale";

/// Name of a copy that is not whole yet.
const UNFINISHED: &str = ".part";

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

    /// What positions in its caches are counted from [m]; the origin of the world in folders of older programs.
    pub(super) fn origin(&self) -> [f64; 3] {
        serde_json::from_value(self.manifest["origin"].clone()).unwrap_or_default()
    }

    /// Whether it has come far enough for anything to depend on what it was: a delivered frame or a checkpoint.
    pub(super) fn has_begun(&self, folder: &Path) -> bool {
        self.last_complete_frame().is_some() || store::list(folder).is_ok_and(|checkpoints| !checkpoints.is_empty())
    }

    /// Whether all frames up to `last` are there, the caches with them, and the checkpoint from which more could follow.
    pub(super) fn has_all(&self, folder: &Path, last: i64) -> bool {
        let ended = |frame: i64| frame > last || frame == last && self.manifest["state"] == "done";
        let files = run_record::listed_files(folder);
        self.last_complete_frame().is_some_and(ended) && files.iter().all(|file| file.is_file())
    }

    /// Says in the manifest that only the frames up to `delivered` count: what follows is about to be taken back.
    pub(super) fn take_back(&self, folder: &Path, delivered: Option<i64>) -> Result<(), IoError> {
        let mut manifest = self.manifest.clone();
        manifest["state"] = "running".into();
        manifest["last_complete_frame"] = delivered.into();
        let text = format!("{manifest:#}\n");
        atomic_file::replace(&folder.join(MANIFEST), text.as_bytes())
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

/// Removes what a killed attempt left unfinished among what it set aside.
pub(super) fn clear_unfinished(folder: &Path) -> Result<(), IoError> {
    let attempts = fs::read_dir(folder.join(STALE)).into_iter().flatten().flatten();
    for part in attempts.map(|attempt| attempt.path().join(UNFINISHED)).filter(|part| part.exists()) {
        fs::remove_file(&part).map_err(|e| IoError::writing(&part, e))?;
    }
    Ok(())
}

/// Copies files into `stale`, each whole or not at all.
pub(super) fn set_aside(files: &[PathBuf], stale: &Path) -> Result<(), IoError> {
    if !files.is_empty() {
        fs::create_dir_all(stale).map_err(|e| IoError::creating(stale, e))?;
    }
    for file in files {
        let to = stale.join(file.file_name().unwrap_or_default());
        let part = stale.join(UNFINISHED);
        let copied = fs::copy(file, &part).and_then(|_| fs::rename(&part, &to));
        if copied.is_err() {
            // What is left of it would only take room.
            let _ = fs::remove_file(&part);
        }
        copied.map_err(|e| IoError::writing(&to, e))?;
    }
    Ok(())
}

//! Files that an earlier run has left in a folder, and the way it makes room for another run.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use drapery_io::atomic_file;
use drapery_io::error::{IoError, IoErrorKind};
use drapery_io::formats;
use drapery_io::input_file;
use serde_json::Value;

use crate::checkpoints::{Store, store};
use crate::error::ShotError;
use crate::farm::attempts::Attempt;
use crate::farm::digest::Fingerprint;
use crate::farm::lock::RunLock;
use crate::farm::process::Owner;
use crate::farm::stale;
use crate::run::observer::Observer;
use crate::run::options::RunOptions;
use crate::run_record::manifest::{AttemptRecord, former_files, listed_files, listed_layers};
use crate::run_record::{FINGERPRINT, MANIFEST, RECORD, RESOLVED};
use crate::shot::Shot;

/// An earlier run in a folder.
#[derive(Debug)]
pub(super) struct Earlier {
    /// Its manifest.
    manifest: Value,
    /// Fingerprint of its dependencies; `None` when it is not known.
    pub(super) fingerprint: Option<Fingerprint>,
    /// Its attempts.
    pub(super) attempts: Vec<AttemptRecord>,
}

impl Earlier {
    /// The run in a folder, if there is one.
    ///
    /// # Errors
    /// There is a manifest that cannot be read.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, IoError> {
        let path = folder.join(MANIFEST);
        let text = match input_file::text(&path) {
            Err(IoError::Missing { .. }) => return Ok(None),
            // Below a file there can be no folder; making it says so.
            Err(IoError::Read { source, .. }) if source.kind() == ErrorKind::NotADirectory => return Ok(None),
            text => text?,
        };
        let damaged = |place: String, what: String| {
            let advice = "it is damaged, and the run cannot be continued without it: restore it, or start over with \
                          --overwrite";
            IoError::data(&path, place, what, advice)
        };
        let manifest: Value =
            serde_json::from_str(&text).map_err(|e| damaged(format!("line {}", e.line()), e.to_string()))?;
        if !manifest.is_object() {
            return Err(damaged("line 1".to_owned(), "this is not a manifest".to_owned()));
        }
        // What is damaged is not known. What the system did not read may be read by the next attempt.
        let fingerprint = match input_file::text(&folder.join(FINGERPRINT)) {
            Err(error) if error.kind() == IoErrorKind::Io => return Err(error),
            text => text.ok().and_then(|text| serde_json::from_str(&text).ok()),
        };
        let attempts = serde_json::from_value(manifest["attempts"].clone()).unwrap_or_default();
        Ok(Some(Self { manifest, fingerprint, attempts }))
    }

    /// The same, where a run that is there is not to be replaced.
    ///
    /// # Errors
    /// As [`Earlier::read`].
    pub(super) fn unless_replaced(options: &RunOptions) -> Result<Option<Self>, IoError> {
        if options.overwrite { Ok(None) } else { Self::read(&options.out) }
    }

    /// Last frame that is complete in every cache.
    pub(super) fn last_complete_frame(&self) -> Option<i64> {
        self.manifest["last_complete_frame"].as_i64()
    }

    /// Whether its caches hold velocities, faces or attributes where those of a shot would not, or the other way round.
    pub(super) fn has_other_form(&self, now: &Fingerprint) -> bool {
        self.fingerprint.as_ref().is_some_and(|then| then.form_of_caches() != now.form_of_caches())
    }

    /// Returns the origin of the positions in its caches [m]; the origin of the world in folders of older programs.
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
        let files = listed_files(folder);
        self.last_complete_frame().is_some_and(ended) && files.iter().all(|file| file.is_file())
    }

    /// Says in the manifest that only the frames up to `delivered` count: what follows is about to be taken back.
    pub(super) fn withdraw(&self, folder: &Path, delivered: Option<i64>) -> Result<(), IoError> {
        let mut manifest = self.manifest.clone();
        manifest["state"] = "running".into();
        manifest["last_complete_frame"] = delivered.into();
        let text = format!("{manifest:#}\n");
        atomic_file::replace(&folder.join(MANIFEST), text.as_bytes())
    }
}

/// A folder that this attempt has taken.
pub(super) struct Held {
    /// This process.
    pub(super) owner: Owner,
    /// The folder's lock.
    pub(super) lock: RunLock,
    /// Number and logs.
    pub(super) attempt: Attempt,
    /// The folder's checkpoints.
    pub(super) store: Store,
}

impl Held {
    /// Takes the folder, opens the logs, and clears up what earlier attempts left unfinished.
    pub(super) fn take(
        options: &RunOptions,
        notes: Vec<String>,
        observer: &mut dyn Observer,
    ) -> Result<Self, ShotError> {
        let out = &options.out;
        let owner = Owner::this_process();
        let lock = RunLock::take(out, &owner, options.steal_lock, SystemTime::now())?;
        let attempt = Attempt::next(out)?;
        observer.logs(attempt.open()?);
        notes.into_iter().for_each(|note| observer.accepted(note));
        if let Some(former) = lock.former() {
            let why =
                if options.steal_lock { "taken over by --steal-lock" } else { "which has ended without releasing it" };
            observer.note(format!("the folder was locked by {former}, {why}"));
        }
        for name in options.requests.watch_folder(out)? {
            observer.note(format!("control/{name} is left over from an earlier attempt and is removed"));
        }
        if options.overwrite {
            Store::clear(out)?;
        }
        let store = Store::open(out, options.keep, &options.pinned)?;
        stale::clear_unfinished(out)?;
        Ok(Self { owner, lock, attempt, store })
    }
}

/// Writes what a run depends on.
pub(super) fn write_fingerprint(folder: &Path, fingerprint: &Fingerprint) -> Result<(), IoError> {
    // Texts only: they always have a JSON form.
    let text = serde_json::to_string_pretty(fingerprint).unwrap_or_default() + "\n";
    atomic_file::replace(&folder.join(FINGERPRINT), text.as_bytes())
}

/// Removes a file of a run, and the folder that holds a part of it; nothing where they are not there.
pub(super) fn remove(path: &Path) -> Result<(), IoError> {
    if let Some(folder) = formats::folder_of(path) {
        formats::remove_folder(&folder)?;
    }
    atomic_file::remove(path).map_err(|e| IoError::creating(path, e))?;
    Ok(())
}

/// Files of a run in `folder` beside its checkpoints and logs: those that are there of what every run writes, of the outputs
/// `planned`, and of what the manifest lists.
pub(super) fn files_of_run(folder: &Path, planned: &[PathBuf]) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = [MANIFEST, RECORD, RESOLVED, FINGERPRINT].map(|name| folder.join(name)).into();
    files.extend(planned.iter().cloned());
    // Caches of the earlier run that this one does not write again would belong to nothing.
    files.extend(listed_files(folder));
    files.extend(former_files(folder));
    files.extend(listed_layers(folder));
    files.retain(|path| path.exists());
    files.sort();
    files.dedup();
    files
}

/// An output that is an input of the same shot would be destroyed before it is read.
pub(super) fn refuse_inputs(shot: &Shot, outputs: &[PathBuf]) -> Result<(), IoError> {
    let real = |path: &PathBuf| fs::canonicalize(path).ok();
    let inputs: Vec<PathBuf> = shot.about.input_files.iter().chain([&shot.about.scene_path]).filter_map(real).collect();
    match outputs.iter().find(|output| real(output).is_some_and(|output| inputs.contains(&output))) {
        Some(output) => Err(IoError::OutputIsInput { path: output.clone() }),
        None => Ok(()),
    }
}

/// Name of a file without its folder.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

//! Entries that a run writes into its folder when the process ends at once, while its frame loop waits for something
//! that never comes.

use std::path::Path;

use drapery_io::error::IoError;
use drapery_io::input_file;

use crate::farm::lock;
use crate::farm::process::Owner;
use crate::run_record::MANIFEST;
use crate::run_record::manifest::{AttemptRecord, Manifest, ManifestLock};
use crate::run_record::writer;

/// Says in manifest and record why the run of this process ends, and gives its folder back. A folder that this process does not hold
/// is left alone. The caller keeps the lock, with which nobody else writes a manifest, and ends the process.
///
/// # Errors
/// The folder cannot be read or written.
pub fn last_words(folder: &Path, error: &str) -> Result<ManifestLock, IoError> {
    let (me, lock) = (Owner::this_process(), ManifestLock::take());
    if !lock::is_held_by(folder, &me)? {
        return Ok(lock);
    }
    let text = input_file::bytes(&folder.join(MANIFEST));
    // The manifest of an earlier attempt may still be there.
    let ours = |manifest: &Manifest| manifest.attempts.last().is_some_and(|attempt| is_by(attempt, &me));
    let manifest = text.ok().and_then(|text| serde_json::from_slice::<Manifest>(&text).ok()).filter(ours);
    if let Some(manifest) = manifest {
        failed(folder, manifest, (error, &lock))?;
    }
    lock::give_back(folder)?;
    Ok(lock)
}

/// Says in manifest and record that an attempt of this process failed while it prepared the folder, if that has begun: a manifest
/// that says something else than `running` is as it was found.
///
/// # Errors
/// The folder cannot be read or written.
pub(crate) fn failed_to_begin(folder: &Path, error: &str) -> Result<(), IoError> {
    let text = input_file::bytes(&folder.join(MANIFEST))?;
    let manifest = serde_json::from_slice::<Manifest>(&text).ok().filter(|manifest| manifest.state == "running");
    manifest.map_or(Ok(()), |manifest| failed(folder, manifest, (error, &ManifestLock::take())))
}

/// The manifest says it also where the record cannot.
fn failed(folder: &Path, mut manifest: Manifest, (error, lock): (&str, &ManifestLock)) -> Result<(), IoError> {
    manifest.state = "failed".into();
    manifest.error = Some(error.to_owned());
    let me = Owner::this_process();
    if let Some(attempt) = manifest.attempts.last_mut().filter(|attempt| is_by(attempt, &me)) {
        attempt.end = Some("failed".to_owned());
    }
    let recorded = writer::record_failure(folder, error);
    lock.write(&manifest, folder).and(recorded)
}

/// Whether an attempt is one of this process.
fn is_by(attempt: &AttemptRecord, me: &Owner) -> bool {
    (&attempt.host, attempt.pid) == (&me.host, me.pid)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::time::SystemTime;

    use serde_json::Value;

    use super::*;
    use crate::farm::lock::{LOCK, RunLock};
    use crate::run_record::RECORD;

    #[test]
    fn the_folder_of_this_process_says_why_and_is_free_and_that_of_another_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let (out, me) = (folder.path(), Owner::this_process());
        let attempt = AttemptRecord { host: me.host.clone(), pid: me.pid, ..AttemptRecord::default() };
        let earlier = AttemptRecord { end: Some("max-wall".to_owned()), ..AttemptRecord::default() };
        let mut manifest = Manifest { state: "running".into(), attempts: vec![earlier.clone()], ..Manifest::default() };
        let end = |owner: &Owner, manifest: &Manifest| {
            manifest.write(out).unwrap();
            let text = fs::read(out.join(MANIFEST)).unwrap();
            // The lock is not given back by its own end.
            std::mem::forget(RunLock::take(out, owner, true, SystemTime::now()).unwrap());
            (drop(last_words(out, "rank 1 is lost").unwrap()), fs::read(out.join(MANIFEST)).unwrap() == text)
        };
        // Half a line of a frame is there.
        fs::write(out.join(RECORD), "{\"record\":\"header\"}\n{\"reco").unwrap();
        let other = Owner { pid: me.pid + 1, ..me.clone() };
        assert!(end(&other, &manifest).1 && out.join(LOCK).exists());
        // Before this attempt has written anything.
        assert!(end(&me, &manifest).1 && !out.join(LOCK).exists());
        manifest.attempts.push(attempt);
        assert!(!end(&me, &manifest).1 && !out.join(LOCK).exists());
        let said: Manifest = serde_json::from_slice(&fs::read(out.join(MANIFEST)).unwrap()).unwrap();
        assert_eq!((said.state.as_ref(), said.error.as_deref()), ("failed", Some("rank 1 is lost")));
        assert_eq!((&said.attempts[0], said.attempts[1].end.as_deref()), (&earlier, Some("failed")));
        let record = fs::read_to_string(out.join(RECORD)).unwrap();
        let last: Value = serde_json::from_str(record.lines().last().unwrap()).unwrap();
        assert_eq!(
            (&last["record"], &last["state"], &last["error"]),
            (&"end".into(), &"failed".into(), &"rank 1 is lost".into())
        );
    }
}

//! `OUT/stale`: files that a resumed run does not resume from, one folder for each attempt, and the number of folders kept.
//!
//! A copy is made whenever complete frames are simulated again. A run that is killed again and again would fill the disk with
//! them, so copies that say nothing new are removed: of those of the same scene, inputs and solver as the run, which hold the
//! same frames to the last bit, the two latest stay and the one that has most frames. Everything else stays until somebody
//! deletes it: copies of another scene or of other inputs, copies with checkpoints, and what is not a copy.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use drapery_io::error::IoError;
use drapery_io::{formats, platform};
use serde::Serialize;
use serde_json::Value;

use crate::checkpoints::store;
use crate::farm::digest::{self, Fingerprint};
use crate::run_record::{FINGERPRINT, MANIFEST};

/// The folder inside that of a run.
pub const FOLDER: &str = "stale";

/// Start of the names of the attempts' folders.
const ATTEMPT: &str = "attempt_";

/// End of names of folders that are not whole: being made, or being removed.
const UNFINISHED: &str = ".part";

/// Number of the latest copies that stay, beside the one with most frames.
const LATEST: usize = 2;

/// Data set aside in the folder of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Stale {
    /// Number of attempts that have set something aside.
    pub attempts: usize,
    /// Room that it takes on the disk [bytes].
    pub bytes: u64,
}

/// A copy that another may stand for.
struct Copy {
    number: u32,
    path: PathBuf,
    last_frame: i64,
    files: Vec<String>,
}

/// Measures the data set aside in the folder `out` of a run; `None` when there is nothing.
pub fn look(out: &Path) -> Option<Stale> {
    let (folder, mut found) = (out.join(FOLDER), Stale::default());
    let mut waiting = vec![folder];
    while let Some(folder) = waiting.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let Ok(about) = entry.metadata() else { continue };
            found.bytes += platform::room_taken(&about);
            found.attempts += usize::from(about.is_dir() && number_of(&entry.path()).is_some());
            // A link is not followed: what it names is somewhere else.
            waiting.extend(about.is_dir().then(|| entry.path()));
        }
    }
    (found != Stale::default()).then_some(found)
}

/// The folder into which an attempt sets aside what it does not go on from.
pub(crate) fn attempt(out: &Path, number: u32) -> PathBuf {
    out.join(FOLDER).join(format!("{ATTEMPT}{number:03}"))
}

/// Largest number of an attempt that has set something aside; 0 when there is none.
pub(crate) fn last_attempt(out: &Path) -> u32 {
    let folders = fs::read_dir(out.join(FOLDER)).into_iter().flatten().flatten();
    folders.filter_map(|entry| number_of(&entry.path())).max().unwrap_or(0)
}

/// Removes what a killed attempt left unfinished: a copy in the making, a folder that it was removing.
pub(crate) fn clear_unfinished(out: &Path) -> Result<(), IoError> {
    for folder in fs::read_dir(out.join(FOLDER)).into_iter().flatten().flatten().map(|entry| entry.path()) {
        let name = name_of(&folder);
        if name.strip_suffix(UNFINISHED).is_some_and(|name| number_of(Path::new(name)).is_some()) {
            fs::remove_dir_all(&folder).map_err(|e| IoError::writing(&folder, e))?;
        }
    }
    Ok(())
}

/// Copies files into the folder `into` of an attempt, which is there when all of them are.
///
/// # Errors
/// The disk refuses. Nothing is left of the copies then: what they are of is still in its place.
pub(crate) fn set_aside(files: &[PathBuf], into: &Path) -> Result<(), IoError> {
    if files.is_empty() {
        return Ok(());
    }
    let part = unfinished(into);
    fs::create_dir_all(&part).map_err(|e| IoError::creating(&part, e))?;
    let copy = |file: &PathBuf| {
        let to = part.join(file.file_name().unwrap_or_default());
        fs::copy(file, &to).map_err(|e| IoError::writing(&to, e))
    };
    let folder = |file: &PathBuf| match formats::folder_of(file).filter(|folder| folder.is_dir()) {
        Some(folder) => copy_folder(&folder, &part.join(folder.file_name().unwrap_or_default())),
        None => Ok(()),
    };
    let copied = files.iter().try_for_each(|file| copy(file).and_then(|_| folder(file)));
    let copied = copied.and_then(|()| fs::rename(&part, into).map_err(|e| IoError::writing(into, e)));
    if copied.is_err() {
        // It would take the room that is missing.
        let _ = fs::remove_dir_all(&part);
    }
    copied
}

/// Copies a folder with what is in it, links as what they lead to.
fn copy_folder(from: &Path, to: &Path) -> Result<(), IoError> {
    fs::create_dir(to).map_err(|e| IoError::creating(to, e))?;
    let failed = |e| IoError::writing(from, e);
    for entry in fs::read_dir(from).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let copy = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() {
            copy_folder(&path, &copy)?;
        } else {
            fs::copy(&path, &copy).map_err(|e| IoError::writing(&copy, e))?;
        }
    }
    Ok(())
}

/// The name of a folder while it is made or removed.
fn unfinished(folder: &Path) -> PathBuf {
    folder.with_file_name(name_of(folder) + UNFINISHED)
}

/// Removes copies for which a later or longer one stands; see the module. Returns their names.
pub(crate) fn prune(out: &Path, now: &Fingerprint) -> Result<Vec<String>, IoError> {
    let folders = fs::read_dir(out.join(FOLDER)).into_iter().flatten().flatten();
    let mut copies: Vec<Copy> = folders.filter_map(|entry| copy_of(&entry.path(), now)).collect();
    copies.sort_unstable_by_key(|copy| copy.number);
    // Of equally long ones the latest.
    let Some(longest) = copies.iter().max_by_key(|copy| (copy.last_frame, copy.number)) else { return Ok(Vec::new()) };
    let earlier = &copies[..copies.len().saturating_sub(LATEST)];
    let is_held = |copy: &&Copy| copy.files.iter().all(|name| longest.files.contains(name));
    let mut removed = Vec::new();
    for copy in earlier.iter().filter(|copy| copy.number != longest.number).filter(is_held) {
        let aside = unfinished(&copy.path);
        let gone = fs::rename(&copy.path, &aside).and_then(|()| fs::remove_dir_all(&aside));
        gone.map_err(|e: io::Error| IoError::writing(&copy.path, e))?;
        removed.push(name_of(&copy.path));
    }
    Ok(removed)
}

/// Describes the copies that were removed.
pub(crate) fn removed_in_words(names: &[String]) -> String {
    if names.is_empty() {
        return String::new();
    }
    format!("; removed {} there: a copy that is kept has the same frames", names.join(", "))
}

/// The copy in a folder, if it is one of frames of the same scene, inputs and solver, and of nothing else.
fn copy_of(path: &Path, now: &Fingerprint) -> Option<Copy> {
    let number = number_of(path).filter(|_| path.symlink_metadata().is_ok_and(|about| about.is_dir()))?;
    let read = |name: &str| fs::read_to_string(path.join(name)).ok();
    let then: Fingerprint = serde_json::from_str(&read(FINGERPRINT)?).ok()?;
    let manifest: Value = serde_json::from_str(&read(MANIFEST)?).ok()?;
    let is_same = digest::compare(&then, now).forbidden.is_empty();
    let has_form = then.form_of_caches() == now.form_of_caches();
    let holds_checkpoints = !store::entries(path).ok()?.is_empty();
    if !is_same || !has_form || holds_checkpoints {
        return None;
    }
    let entries = fs::read_dir(path).ok()?.map(|entry| Some(name_of(&entry.ok()?.path())));
    let files = entries.collect::<Option<_>>()?;
    Some(Copy { number, path: path.to_owned(), last_frame: manifest["last_complete_frame"].as_i64()?, files })
}

/// Number of the attempt that a folder belongs to; `None` for other names.
fn number_of(path: &Path) -> Option<u32> {
    name_of(path).strip_prefix(ATTEMPT)?.parse().ok()
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn fingerprint(scene: &str) -> Fingerprint {
        Fingerprint { digests: BTreeMap::from([("scene".to_owned(), scene.to_owned())]), scene: BTreeMap::new() }
    }

    /// A copy as an attempt leaves it.
    fn write(out: &Path, number: u32, (scene, last_frame): (&str, i64), more: &[&str]) {
        let folder = attempt(out, number);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join(FINGERPRINT), serde_json::to_string(&fingerprint(scene)).unwrap()).unwrap();
        fs::write(folder.join(MANIFEST), format!("{{\"last_complete_frame\": {last_frame}}}")).unwrap();
        more.iter().for_each(|name| fs::write(folder.join(name), "x").unwrap());
    }

    fn left(out: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(out.join(FOLDER)).unwrap().map(|entry| name_of(&entry.unwrap().path())).collect();
        names.sort_unstable();
        names
    }

    #[test]
    fn the_latest_copies_and_the_longest_stay_and_what_no_other_holds() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        let cache = ["sheet.abc"];
        write(out, 2, ("now", 1004), &cache);
        write(out, 3, ("now", 1009), &cache);
        write(out, 4, ("then", 1003), &cache);
        write(out, 5, ("now", 1003), &["sheet.abc", "frame_01002.h5"]);
        write(out, 6, ("now", 1002), &["sheet.abc", "sheet.h5"]);
        write(out, 7, ("now", 1003), &cache);
        write(out, 8, ("now", 1001), &cache);
        write(out, 9, ("now", 1002), &cache);
        fs::create_dir(out.join("stale/attempt_old")).unwrap();
        assert_eq!(prune(out, &fingerprint("now")).unwrap(), ["attempt_002", "attempt_007"]);
        let names = [3, 4, 5, 6, 8, 9].map(|number| format!("attempt_{number:03}"));
        assert_eq!(left(out), [&names[..], &["attempt_old".to_owned()]].concat());
        assert!(prune(out, &fingerprint("now")).unwrap().is_empty());
        assert_eq!(look(out).map(|found| found.attempts), Some(6));
        assert_eq!(look(&out.join("elsewhere")), None);
    }

    #[test]
    fn what_was_being_made_or_removed_is_removed_by_the_next_attempt() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        write(out, 1, ("now", 1004), &["sheet.abc"]);
        write(out, 2, ("now", 1004), &["sheet.abc"]);
        fs::rename(attempt(out, 1), unfinished(&attempt(out, 1))).unwrap();
        clear_unfinished(out).unwrap();
        assert_eq!((left(out), last_attempt(out)), (vec!["attempt_002".to_owned()], 2));
    }

    #[test]
    fn a_copy_that_fails_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        let [there, gone] = ["there.abc", "gone.abc"].map(|name| out.join(name));
        fs::write(&there, "x").unwrap();
        assert!(set_aside(&[there.clone(), gone], &attempt(out, 1)).is_err());
        assert!(left(out).is_empty());
        set_aside(&[there], &attempt(out, 1)).unwrap();
        assert_eq!(left(out), ["attempt_001"]);
    }
}

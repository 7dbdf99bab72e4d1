//! Inputs that another program writes over while a run reads them. A file that another one replaces under its name is none: the run
//! goes on reading the one that it has opened.

use std::path::{Path, PathBuf};
use std::time::SystemTime;
use std::{fs, io};

use drapery_io::platform::FileIdentity;

use crate::farm::digest::{Digests, content_digest, input_name};

/// Marks of a file that change when it is written to.
#[derive(Debug, PartialEq)]
struct Stamp {
    identity: FileIdentity,
    length: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    fn of(path: &Path) -> io::Result<Self> {
        let about = fs::metadata(path)?;
        Ok(Self { identity: FileIdentity::named(path)?, length: about.len(), modified: about.modified().ok() })
    }
}

/// The inputs of a run, as they were at its start.
#[derive(Debug)]
pub(super) struct InputWatch(Vec<(PathBuf, Stamp)>);

impl InputWatch {
    /// Watches those that are there.
    pub(super) fn new(inputs: &[PathBuf]) -> Self {
        Self(inputs.iter().filter_map(|path| Some((path.clone(), Stamp::of(path).ok()?))).collect())
    }

    /// Returns the inputs that were written over since the start and hold something else than these digests say, each once.
    pub(super) fn written_over(&mut self, digests: &Digests) -> Vec<PathBuf> {
        let mut found = Vec::new();
        self.0.retain_mut(|(path, stamp)| {
            // What is no longer there, or not for a moment, is read as it was opened.
            let Ok(now) = Stamp::of(path) else { return true };
            if now.identity != stamp.identity {
                return false;
            }
            if now == *stamp {
                return true;
            }
            *stamp = now;
            let is_same = |digest: &String| content_digest(path).is_ok_and(|content| content == *digest);
            if digests.get(&input_name(path)).is_none_or(is_same) {
                return true;
            }
            found.push(path.clone());
            false
        });
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_written_over_is_found_once_and_one_that_is_touched_or_replaced_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<PathBuf> =
            ["over", "touched", "replaced", "removed"].map(|name| folder.path().join(name)).into();
        paths.iter().for_each(|path| fs::write(path, "before").unwrap());
        let digests: Digests = paths.iter().map(|path| (input_name(path), content_digest(path).unwrap())).collect();
        let mut watch = InputWatch::new(&paths);
        assert!(watch.written_over(&digests).is_empty());
        fs::write(&paths[0], "after it").unwrap();
        fs::File::open(&paths[1]).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
        fs::write(folder.path().join("new"), "another").unwrap();
        fs::rename(folder.path().join("new"), &paths[2]).unwrap();
        fs::remove_file(&paths[3]).unwrap();
        assert_eq!(watch.written_over(&digests), [paths[0].clone()]);
        assert!(watch.written_over(&digests).is_empty());
    }
}

//! Attempts: each start of a run in a folder has its own two logs, `OUT/logs/001.log` (words) and `001.jsonl`.

use std::fs::{self, File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use drapery_io::error::IoError;

use crate::farm::stale;

/// Folder of the logs in the folder of a run.
pub(crate) const LOGS: &str = "logs";

/// One start of a run in a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Attempt {
    /// Its number, from 1.
    pub number: u32,
    /// Log for people.
    pub log: PathBuf,
    /// The same as JSON lines.
    pub log_json: PathBuf,
}

impl Attempt {
    /// The attempt after those that the logs in `folder` tell of, and what they have set aside. Its log file exists when this returns, empty, so that
    /// nobody else gets the number.
    ///
    /// # Errors
    /// The logs' folder or the file cannot be created; there is no number left.
    pub(crate) fn next(folder: &Path) -> Result<Self, IoError> {
        let logs = folder.join(LOGS);
        fs::create_dir_all(&logs).map_err(|e| IoError::creating(&logs, e))?;
        // Logs may have been deleted to save room; what was set aside keeps its name.
        let last = last(&logs)?.max(stale::last_attempt(folder));
        let mut refused = None;
        for number in last.saturating_add(1)..=u32::MAX {
            let attempt = Self::named(&logs, number);
            match OpenOptions::new().write(true).create_new(true).open(&attempt.log) {
                Ok(_) => return Ok(attempt),
                // Another process was faster; its file now counts.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => refused = Some((attempt.log, error)),
                Err(error) => return Err(IoError::creating(&attempt.log, error)),
            }
        }
        let (log, error) = refused.unwrap_or_else(|| (logs, ErrorKind::QuotaExceeded.into()));
        Err(IoError::creating(&log, error))
    }

    /// Opens the two logs to append to them: words, then JSON lines.
    ///
    /// # Errors
    /// One of them cannot be opened.
    pub(crate) fn open(&self) -> Result<[File; 2], IoError> {
        let open = |path: &Path| {
            OpenOptions::new().append(true).create(true).open(path).map_err(|e| IoError::creating(path, e))
        };
        Ok([open(&self.log)?, open(&self.log_json)?])
    }

    fn named(logs: &Path, number: u32) -> Self {
        let file = |extension: &str| logs.join(format!("{number:03}.{extension}"));
        Self { number, log: file("log"), log_json: file("jsonl") }
    }
}

/// Largest number among the logs; 0 when there are none.
fn last(logs: &Path) -> Result<u32, IoError> {
    let mut last = 0;
    for entry in fs::read_dir(logs).map_err(|e| IoError::reading(logs, e))? {
        let name = entry.map_err(|e| IoError::reading(logs, e))?.file_name();
        let stem = Path::new(&name).file_stem().and_then(|stem| stem.to_str());
        // Other files in the folder are somebody else's.
        last = last.max(stem.and_then(|stem| stem.parse().ok()).unwrap_or(0));
    }
    Ok(last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn every_attempt_has_its_own_logs() {
        let folder = tempfile::tempdir().unwrap();
        let first = Attempt::next(folder.path()).unwrap();
        assert_eq!((first.number, first.log.ends_with("logs/001.log")), (1, true));
        assert!(first.log_json.ends_with("logs/001.jsonl"));
        let [mut words, _] = first.open().unwrap();
        words.write_all(b"first").unwrap();
        assert_eq!(Attempt::next(folder.path()).unwrap().number, 2);
        // Logs are deleted to save room; numbers still grow. Other files do not count.
        fs::write(folder.path().join("logs/1041.jsonl"), "").unwrap();
        fs::write(folder.path().join("logs/notes.log"), "").unwrap();
        let next = Attempt::next(folder.path()).unwrap();
        assert_eq!((next.number, next.log.ends_with("logs/1042.log")), (1042, true));
        assert_eq!(fs::read_to_string(first.log).unwrap(), "first");
        fs::remove_dir_all(folder.path().join(LOGS)).unwrap();
        fs::create_dir_all(folder.path().join("stale/attempt_007")).unwrap();
        assert_eq!(Attempt::next(folder.path()).unwrap().number, 8);
    }

    #[test]
    fn two_starters_get_two_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let number = || Attempt::next(folder.path()).unwrap().number;
        let mut numbers: Vec<u32> = std::thread::scope(|scope| {
            let all: Vec<_> = (0..8).map(|_| scope.spawn(number)).collect();
            all.into_iter().map(|one| one.join().unwrap()).collect()
        });
        numbers.sort_unstable();
        assert_eq!(numbers, [1, 2, 3, 4, 5, 6, 7, 8]);
    }
}

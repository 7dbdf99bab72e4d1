//! Room on the disk that a run keeps for its last words: where the disk is full, it can still say that it failed, and why.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::Path;

use drapery_io::error::IoError;

/// The file while it has a name.
const FILE: &str = ".reserve";

/// Room that is kept: the manifest of some hundred garments, with the error and a line in the record [bytes].
const BYTES: usize = 64 << 10;

/// Room on the disk. It is given back when this is dropped, and when the process is killed: the file has no name.
#[derive(Debug)]
pub(super) struct Reserve(#[cfg_attr(not(test), expect(dead_code, reason = "held, not looked at"))] File);

impl Reserve {
    /// Takes room on the disk of `folder`.
    ///
    /// # Errors
    /// There is none.
    pub(super) fn take(folder: &Path) -> Result<Self, IoError> {
        let path = folder.join(FILE);
        let mut options = OpenOptions::new();
        let opened = options.write(true).create(true).truncate(true).open(&path);
        let mut file = opened.map_err(|e| IoError::creating(&path, e))?;
        // Servers take room only for what has reached them. Where files may not be that long, less has to do.
        let written = match file.write_all(&[0; BYTES]) {
            Err(error) if error.kind() != ErrorKind::FileTooLarge => Err(error),
            _ => file.sync_data(),
        };
        let removed = fs::remove_file(&path);
        written.and(removed).map_err(|e| IoError::writing(&path, e))?;
        Ok(Self(file))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_room_is_taken_and_has_no_name() {
        let folder = tempfile::tempdir().unwrap();
        // Of an attempt that was killed in between.
        fs::write(folder.path().join(FILE), "x").unwrap();
        let Reserve(file) = Reserve::take(folder.path()).unwrap();
        assert_eq!(file.metadata().unwrap().len(), BYTES as u64);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(Reserve::take(&folder.path().join("missing")).is_err());
    }
}

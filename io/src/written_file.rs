//! Files that stay open while they are written, looked at under their names: whether each still is the file that is written.
//!
//! Another program may remove, replace or cut such a file. The system does not object, and every later write succeeds: into a file
//! that nobody finds any more.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use crate::error::IoError;

/// Makes sure that `path` still names the open `file`, with at least `length` bytes.
///
/// # Errors
/// The file was removed, replaced or cut by another program; the system does not tell.
pub fn check(path: &Path, file: &File, length: u64) -> Result<(), IoError> {
    let own = file.metadata().map_err(|error| IoError::writing(path, error))?;
    let changed = |what: String| Err(IoError::OutputChanged { path: path.to_owned(), what });
    match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => changed("has removed this file".to_owned()),
        Err(error) => Err(IoError::writing(path, error)),
        Ok(named) if (named.dev(), named.ino()) != (own.dev(), own.ino()) => {
            changed("has put another file in the place of this one".to_owned())
        }
        Ok(named) if named.len() < length => changed(cut(named.len(), length)),
        Ok(_) => Ok(()),
    }
}

/// Makes sure that a file that was written and closed is there with so many bytes.
///
/// # Errors
/// The file was removed or cut by another program; the system does not tell.
pub(crate) fn check_closed(path: &Path, length: u64) -> Result<(), IoError> {
    let changed = |what: String| Err(IoError::OutputChanged { path: path.to_owned(), what });
    match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => changed("has removed this file".to_owned()),
        Err(error) => Err(IoError::writing(path, error)),
        Ok(named) if named.len() < length => changed(cut(named.len(), length)),
        Ok(_) => Ok(()),
    }
}

fn cut(held: u64, length: u64) -> String {
    format!("has cut this file from {length} to {held} bytes")
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn a_file_that_is_removed_replaced_or_cut_is_named_with_what_has_happened() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sheet.abc");
        let written = || {
            let mut file = File::create(&path).unwrap();
            file.write_all(b"0123456789").unwrap();
            check(&path, &file, 10).unwrap();
            file
        };
        let words = |file: &File| check(&path, file, 10).unwrap_err().to_string();
        let file = written();
        file.set_len(4).unwrap();
        assert!(words(&file).contains("sheet.abc: another program has cut this file from 10 to 4 bytes"));
        assert!(check_closed(&path, 10).unwrap_err().to_string().contains("from 10 to 4 bytes"));
        let file = written();
        fs::remove_file(&path).unwrap();
        assert!(words(&file).contains("sheet.abc: another program has removed this file"));
        assert!(check_closed(&path, 10).unwrap_err().to_string().contains("has removed this file"));
        fs::write(&path, "0123456789").unwrap();
        assert!(words(&file).contains("another file in the place of this one"));
        check_closed(&path, 10).unwrap();
    }
}

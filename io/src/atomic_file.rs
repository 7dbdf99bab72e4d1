//! Small files that are replaced as a whole: a reader sees the old content or the new, never a part.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::error::IoError;

/// The file that is written before it is renamed to `path`; one that is there when nobody writes was left by a process that was
/// killed.
pub fn unfinished(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    path.with_file_name(name)
}

/// Writes `content` beside `path` and renames it into place.
///
/// # Errors
/// The folder does not exist or cannot be written to, or the disk is full; `path` then keeps its old content.
pub fn replace(path: &Path, content: &[u8]) -> Result<(), IoError> {
    let beside = unfinished(path);
    let write = |mut file: File| file.write_all(content).and_then(|()| file.sync_data());
    let file = File::create(&beside).map_err(|e| IoError::creating(&beside, e))?;
    let written = write(file).and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        // What is left of it would only confuse; if it cannot be removed either, the first error says why.
        let _ = fs::remove_file(&beside);
    }
    written.map_err(|e| IoError::writing(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_old_content_stays_until_the_new_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("manifest.json");
        replace(&path, b"old").unwrap();
        let mut reader = File::open(&path).unwrap();
        replace(&path, b"new and longer").unwrap();
        // A reader that opened the file before still sees all of the old one.
        let mut seen = String::new();
        std::io::Read::read_to_string(&mut reader, &mut seen).unwrap();
        assert_eq!(seen, "old");
        assert_eq!(fs::read_to_string(&path).unwrap(), "new and longer");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_missing_folder_is_reported_with_the_path() {
        let error = replace(Path::new("/nonexistent/folder/file"), b"x").unwrap_err();
        assert!(error.to_string().contains("/nonexistent/folder"), "{error}");
    }
}

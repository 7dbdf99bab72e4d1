//! Small files that are replaced as a whole: a reader sees the old content or the new, never a part.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use crate::error::IoError;
use crate::platform;

/// The file that is written before it is renamed to `path`; one that is there when nobody writes was left by a process that was
/// killed.
pub fn unfinished(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    path.with_file_name(name)
}

/// Makes sure that a file may be put under this name: what is there is a file, or nothing. A pipe or a device that a file replaces is
/// gone, and its reader waits for ever.
///
/// # Errors
/// There is a folder, a pipe, a socket or a device, directly or by links.
pub fn check_name(path: &Path) -> Result<(), IoError> {
    match fs::metadata(path) {
        Ok(about) if !about.is_file() => {
            Err(IoError::OutputNotAFile { path: path.to_owned(), what: platform::kind_in_words(about.file_type()) })
        }
        _ => Ok(()),
    }
}

/// Bytes at the start of a file that tell its kind.
const START: u64 = 4096;

/// Makes sure that a file may be replaced by an output of a `kind`, as in "page": none of this name is there, it is empty, or `is_own` knows the
/// start of its content.
///
/// # Errors
/// The file holds something else; it cannot be read; as [`check_name`].
pub fn check_own(path: &Path, kind: &'static str, is_own: impl FnOnce(&[u8]) -> bool) -> Result<(), IoError> {
    check_name(path)?;
    let mut start = Vec::new();
    let file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        opened => opened.map_err(|e| IoError::creating(path, e))?,
    };
    file.take(START).read_to_end(&mut start).map_err(|e| IoError::creating(path, e))?;
    if start.is_empty() || is_own(&start) {
        return Ok(());
    }
    Err(IoError::OutputIsForeign { path: path.to_owned(), kind })
}

/// Gives what was written as `part` its name, in the place of a file of that name; what is refused is removed.
///
/// # Errors
/// As [`check_name`]; the disk refuses.
pub fn put(part: &Path, path: &Path) -> Result<(), IoError> {
    let renamed = || fs::rename(part, path).map_err(|e| IoError::writing(path, e));
    let put = check_name(path).and_then(|()| renamed());
    if put.is_err() {
        // What is left of it would only confuse; if it cannot be removed either, the first error says why.
        let _ = fs::remove_file(part);
    }
    put
}

/// Brings the names in a folder to the disk. Some network file systems cannot do this to folders; they keep names by themselves.
pub fn sync_folder(folder: &Path) {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
}

/// Writes `content` beside `path` and renames it into place.
///
/// # Errors
/// There is a folder, a pipe, a socket or a device of this name; the folder does not exist or cannot be written to, or the disk is full; `path` then keeps its old content.
pub fn replace(path: &Path, content: &[u8]) -> Result<(), IoError> {
    check_name(path)?;
    let beside = unfinished(path);
    let write = |mut file: File| file.write_all(content).and_then(|()| file.sync_data());
    let file = File::create(&beside).map_err(|e| IoError::creating(&beside, e))?;
    if let Err(error) = write(file) {
        // It would take the room that is missing.
        let _ = fs::remove_file(&beside);
        return Err(IoError::writing(path, error));
    }
    put(&beside, path)
}

/// Removes a file, if it is there; returns whether it was.
///
/// # Errors
/// The disk refuses.
pub fn remove(path: &Path) -> std::io::Result<bool> {
    match fs::remove_file(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        removed => removed.map(|()| true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::IoErrorKind;

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
    fn a_pipe_a_device_and_a_folder_are_refused_and_stay() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("state.h5");
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        for (path, what) in [(pipe.as_path(), "a pipe"), (&link, "a device"), (folder.path(), "a folder")] {
            let before = fs::metadata(path).unwrap().file_type();
            let error = replace(path, b"x").unwrap_err();
            assert_eq!(error.kind(), IoErrorKind::CannotCreate);
            assert!(error.to_string().contains(&format!("this is {what}")), "{error}");
            let part = folder.path().join("part");
            fs::write(&part, "x").unwrap();
            assert_eq!(put(&part, path).unwrap_err().to_string(), error.to_string());
            assert!(!part.exists() && fs::metadata(path).unwrap().file_type() == before, "{}", path.display());
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn only_an_empty_file_and_one_of_its_own_kind_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page.html");
        let check = || check_own(&path, "page", |start| start.starts_with(b"own"));
        check().unwrap();
        for (content, is_free) in [("", true), ("own page", true), ("notes", false)] {
            fs::write(&path, content).unwrap();
            assert_eq!(check().is_ok(), is_free, "{content}");
        }
        let error = check().unwrap_err();
        assert_eq!(error.kind(), IoErrorKind::CannotCreate);
        assert!(error.to_string().contains("is no page of Drapery"), "{error}");
    }

    #[test]
    fn a_missing_folder_is_reported_with_the_path() {
        let error = replace(Path::new("/nonexistent/folder/file"), b"x").unwrap_err();
        assert!(error.to_string().contains("/nonexistent/folder"), "{error}");
    }
}

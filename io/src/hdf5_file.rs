//! HDF5 files, opened and created without the locks of the library: some network disks have none, and a child process that was started
//! while a file was open keeps its lock. The lock of a run protects the folder of its files.

use std::fmt::Display;
use std::io::ErrorKind;
use std::path::Path;

/// Opens a file for reading.
///
/// # Errors
/// It cannot be opened, or is no HDF5 file.
pub(crate) fn open(path: &Path) -> hdf5::Result<hdf5::File> {
    let unlocked = hdf5::File::with_options().with_fapl(|access| access.file_locking(false)).open(path);
    // A program that has the file open by the same library has to open it in the same way again.
    unlocked.or_else(|_| hdf5::File::open(path))
}

/// Creates a file whose bytes follow from its content: without times of change, behind `userblock` bytes that are not the library's.
///
/// # Errors
/// It cannot be created.
pub(crate) fn create(path: &Path, userblock: u64) -> hdf5::Result<hdf5::File> {
    hdf5::File::with_options()
        .with_fapl(|access| access.libver_v110().file_locking(false))
        .with_fcpl(|create| create.userblock(userblock).obj_track_times(false))
        .create(path)
}

/// Turns the library's text about a file that it cannot write into the system's words and kind, where it names them, without the insides
/// of the library.
pub(crate) fn refused(error: impl Display) -> std::io::Error {
    /// The number of a full disk.
    const NO_SPACE: &str = "28";
    let text = error.to_string();
    let behind = |start: &str, end: char| Some(text.split_once(start)?.1.split(end).next()?.trim());
    match (behind("errno = ", ','), behind("error message = '", '\'')) {
        (Some(NO_SPACE), Some(words)) => std::io::Error::new(ErrorKind::StorageFull, words),
        (_, Some(words)) => std::io::Error::other(words),
        _ => std::io::Error::other(format!("HDF5: {}", text.lines().next().unwrap_or_default())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_said_in_the_words_of_the_system() {
        let text = "H5Fflush(): unable to flush file's cached information: file write failed: time = Tue Dec  1 10:16:04 2026\n, \
                    filename = 'a.h5', file descriptor = 4, errno = 28, error message = 'No space left on device', buf = 0x55";
        let full = refused(text);
        assert_eq!((full.kind(), full.to_string().as_str()), (ErrorKind::StorageFull, "No space left on device"));
        assert_eq!(refused("unable to create\nmore").to_string(), "HDF5: unable to create");
    }

    #[test]
    fn a_file_that_somebody_else_has_locked_is_created_and_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("locked.h5");
        let held = std::fs::File::create(&path).expect("a file");
        held.lock().expect("it is ours");
        create(&path, 0).and_then(hdf5::File::close).expect("it is created");
        assert!(hdf5::File::open(&path).is_err(), "the library's own locks meet ours");
        open(&path).expect("it is read");
        held.unlock().expect("it was ours");
        let _host = hdf5::File::open(&path).expect("a program around this one has it open");
        open(&path).expect("it is read");
    }
}

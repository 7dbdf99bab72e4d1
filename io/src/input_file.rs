//! Input files. Every file that is read is opened here, so that what is no file is refused before anything waits for it: a pipe
//! that nobody writes to would keep a run waiting for ever, a device has no end.

use std::fs::{self, File};
use std::io::{BufRead, Read};
use std::path::Path;

use crate::error::IoError;
use crate::platform;

/// Longest file that is read as a whole [bytes]: far more than any scene, map or record has.
const LONGEST_FILE: u64 = 1 << 30;

/// Longest line of a file that is read line by line [bytes]: a polygon with a million corners fits.
pub(crate) const LONGEST_LINE: u64 = 1 << 26;

/// Bytes with which some programs begin a text in UTF-8.
pub(crate) const MARK: &[u8] = "\u{feff}".as_bytes();

/// Makes sure that there is a regular file, directly or by links.
///
/// # Errors
/// The file is missing, or is a folder, a pipe, a socket or a device.
pub fn check(path: &Path) -> Result<(), IoError> {
    let about = fs::metadata(path).map_err(|error| IoError::reading(path, error))?;
    if about.is_file() {
        return Ok(());
    }
    Err(IoError::NotAFile { path: path.to_owned(), what: platform::kind_in_words(about.file_type()) })
}

/// Opens a regular file, directly or by links.
///
/// # Errors
/// As [`check`]; the file may not be read.
pub fn open(path: &Path) -> Result<File, IoError> {
    // Before it is opened: to open a pipe waits for a writer, and to open a device may do something to it.
    check(path)?;
    File::open(path).map_err(|error| IoError::reading(path, error))
}

/// Makes sure that the HDF5 library can open a file: it takes names in UTF-8 alone, and would wait for a pipe.
///
/// # Errors
/// As [`open`]; the path is not UTF-8.
pub(crate) fn check_for_hdf5(path: &Path) -> Result<(), IoError> {
    if path.to_str().is_none() {
        let what = format!("{path:?} is not UTF-8, which the HDF5 library requires of paths");
        return Err(IoError::data(path, "path", what, "rename the file or its folders"));
    }
    open(path).map(drop)
}

/// All bytes of a file.
///
/// # Errors
/// As [`open`]; the file is longer than 1 GiB.
pub fn bytes(path: &Path) -> Result<Vec<u8>, IoError> {
    let failed = |error| IoError::reading(path, error);
    let (mut file, mut bytes) = (open(path)?, Vec::new());
    let mut length = file.metadata().map_err(failed)?.len();
    if length <= LONGEST_FILE {
        // It may grow meanwhile, and files of the system do not say how long they are.
        file.by_ref().take(LONGEST_FILE + 1).read_to_end(&mut bytes).map_err(failed)?;
        length = bytes.len() as u64;
    }
    if length > LONGEST_FILE {
        let what = format!("it is longer than {} MiB", LONGEST_FILE >> 20);
        return Err(IoError::data(path, "length", what, "check that this is the right file"));
    }
    Ok(bytes)
}

/// The text of a file, without the mark with which some programs begin a text in UTF-8.
///
/// # Errors
/// As [`bytes`]; the text is not UTF-8.
pub fn text(path: &Path) -> Result<String, IoError> {
    let mut bytes = bytes(path)?;
    if bytes.starts_with(MARK) {
        bytes.drain(..MARK.len());
    }
    String::from_utf8(bytes).map_err(|error| {
        let (before, rest) = error.as_bytes().split_at(error.utf8_error().valid_up_to());
        let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
        let what = format!("the byte 0x{:02X} is not UTF-8", rest.first().copied().unwrap_or_default());
        IoError::data(path, format!("line {line}"), what, "save it as text in the encoding UTF-8")
    })
}

/// Reads a line of the file `path` with its end into `line`, which is cleared before; `false` at the end of the file.
///
/// # Errors
/// The file cannot be read; the line is longer than 64 MiB.
pub fn read_line(path: &Path, reader: &mut impl BufRead, line: &mut Vec<u8>) -> Result<bool, IoError> {
    line.clear();
    let read = reader.take(LONGEST_LINE + 1).read_until(b'\n', line).map_err(|error| IoError::reading(path, error))?;
    if read as u64 > LONGEST_LINE {
        let what = format!("a line is longer than {} MiB", LONGEST_LINE >> 20);
        return Err(IoError::data(path, "length", what, "the file is damaged, or not a text file; export it again"));
    }
    Ok(read > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::IoErrorKind;

    #[test]
    fn what_is_no_file_is_refused_by_its_kind_and_nobody_waits_for_it() {
        let folder = tempfile::tempdir().unwrap();
        let [pipe, socket] = ["pipe", "socket"].map(|name| folder.path().join(name));
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        // While a process could write into it, opening it does not wait.
        let _writer = File::options().read(true).write(true).open(&pipe).unwrap();
        let _listening = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let cases = [
            (folder.path(), "a folder"),
            (&pipe, "a pipe"),
            (&socket, "a socket"),
            (Path::new("/dev/zero"), "a device"),
        ];
        for (path, word) in cases {
            for error in [open(path).unwrap_err(), text(path).unwrap_err(), check_for_hdf5(path).unwrap_err()] {
                assert_eq!(error.kind(), IoErrorKind::BadInput, "{error}");
                assert!(error.to_string().contains(word) && error.to_string().contains("help:"), "{error}");
            }
        }
        let missing = open(&folder.path().join("missing")).unwrap_err();
        assert_eq!(missing.kind(), IoErrorKind::MissingInput, "{missing}");
    }

    #[test]
    fn a_text_of_another_encoding_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.txt");
        std::fs::write(&path, b"1\n2 # caf\xe9\n").unwrap();
        let error = text(&path).unwrap_err();
        assert_eq!(error.kind(), IoErrorKind::BadInput);
        assert!(error.to_string().contains("line 2: the byte 0xE9 is not UTF-8"), "{error}");
        std::fs::write(&path, "\u{feff}1\n").unwrap();
        assert_eq!(text(&path).unwrap(), "1\n");
    }

    #[test]
    fn files_and_lines_that_are_far_too_long_do_not_fill_the_memory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long");
        // Nothing but a length: it takes no room on the disk.
        File::create(&path).unwrap().set_len(LONGEST_FILE + 1).unwrap();
        assert!(bytes(&path).unwrap_err().to_string().contains("longer than 1024 MiB"));
        let mut lines = std::io::BufReader::new(open(&path).unwrap());
        let error = read_line(&path, &mut lines, &mut Vec::new()).unwrap_err();
        assert!(error.to_string().contains("a line is longer than 64 MiB"), "{error}");
    }
}

//! Errors with files: the file, the operation that failed, and the remedy.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use drapery_alembic::AlembicError;

use crate::platform;

/// An error of reading or writing files.
#[derive(Debug, thiserror::Error)]
pub enum IoError {
    /// A file that is to be read does not exist.
    #[error(
        "{}: file not found\n  \
         help: check the path; relative paths start in a scene at its file's folder, on the command line at the present folder",
        path.display()
    )]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// A file could not be read.
    #[error(
        "{}: could not be read: {source}\n  \
         help: {}",
        path.display(), advice_on_reading(source)
    )]
    Read {
        /// The file.
        path: PathBuf,
        /// Reason given by the system.
        source: std::io::Error,
    },
    /// An input is not a file: it is a folder, a pipe, a socket or a device.
    #[error(
        "{}: this is {what}, not a file\n  \
         help: give a regular file; write the output of a pipe to a file first",
        path.display()
    )]
    NotAFile {
        /// Path that was given.
        path: PathBuf,
        /// Kind of the thing at that path, as in "a folder".
        what: &'static str,
    },
    /// An output would replace something other than a file: a folder, a pipe, a socket or a device.
    #[error(
        "{}: this is {what}, and a file would replace it\n  \
         help: give a file name, new or to be replaced; copy the file into {what} once it is complete",
        path.display()
    )]
    OutputNotAFile {
        /// Path that was given.
        path: PathBuf,
        /// Kind of the thing at that path, as in "a folder".
        what: &'static str,
    },
    /// A file was changed by another program while it was written.
    #[error(
        "{}: another program {what} while this run wrote it\n  \
         help: its content is lost; keep other programs out of this folder, and start over with --overwrite",
        path.display()
    )]
    OutputChanged {
        /// The file.
        path: PathBuf,
        /// Action of the other program on it, as in "has removed this file".
        what: String,
    },
    /// An output folder has a name that files of HDF5 cannot be written under.
    #[error(
        "{path:?}: this path is not UTF-8, which checkpoints (HDF5) require\n  \
         help: choose another folder with --out"
    )]
    OutputNotUtf8 {
        /// The folder.
        path: PathBuf,
    },
    /// An output file or folder could not be created.
    #[error(
        "{}: could not be created: {source}\n  \
         help: {}",
        path.display(), advice_on(source, "check that the folder exists and that you may write there")
    )]
    Create {
        /// The file or folder.
        path: PathBuf,
        /// Reason given by the system.
        source: std::io::Error,
    },
    /// Writing to an output file failed.
    #[error(
        "{}: could not be written: {source}\n  \
         help: {}",
        path.display(), advice_on(source, "the disk may be full; frames before this one are intact")
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// Reason given by the system.
        source: std::io::Error,
    },
    /// A folder that should hold a run has no manifest.
    #[error(
        "{}: this folder holds no run: there is no manifest.json in it\n  \
         help: {}",
        path.display(), advice_without_run(runs)
    )]
    NoRun {
        /// The folder.
        path: PathBuf,
        /// Folders of runs that it holds.
        runs: Vec<PathBuf>,
    },
    /// The disk has no room for a checkpoint.
    #[error(
        "{}: {} MB are needed on this disk and {} MB are free\n  \
         help: make room and run the same command again; it resumes from the last checkpoint, which is intact",
        path.display(), needed / 1_000_000 + 1, free / 1_000_000
    )]
    NoRoom {
        /// The file.
        path: PathBuf,
        /// Space that it takes [bytes].
        needed: u64,
        /// Free space [bytes].
        free: u64,
    },
    /// The output folder holds another run.
    #[error(
        "{}: this folder already holds a run\n  \
         help: choose another folder with --out, or replace that run with --overwrite",
        path.display()
    )]
    OutputExists {
        /// The folder.
        path: PathBuf,
    },
    /// Another run holds the output folder, or may.
    #[error(
        "{}: {what}\n  \
         help: {advice}",
        path.display()
    )]
    Locked {
        /// The lock.
        path: PathBuf,
        /// Holder of the lock.
        what: String,
        /// Remedy.
        advice: String,
    },
    /// The output folder was taken over by another run.
    #[error(
        "{}: {taker} has taken over this folder; this run stops and writes nothing more\n  \
         help: let that run finish; it has resumed from the last checkpoint",
        path.display()
    )]
    LockLost {
        /// The lock.
        path: PathBuf,
        /// Present holder of the lock.
        taker: String,
    },
    /// The lock of a run, or the folder with it, is no longer under its name, and no other run has put its own there.
    #[error(
        "{}: another program has removed or renamed this {} while a run wrote into the folder; the run stops and \
         writes nothing more\n  \
         help: run the same command again, with the new name of the folder after --out if it has one; it resumes \
         from the last checkpoint that is there",
        path.display(), if *is_folder { "folder" } else { "lock" }
    )]
    LockGone {
        /// The folder or the lock.
        path: PathBuf,
        /// Whether it is the folder.
        is_folder: bool,
    },
    /// A file that is to be written is there already.
    #[error(
        "{}: this file exists already\n  \
         help: choose another name, or another folder with --out, or replace it with --overwrite",
        path.display()
    )]
    FileExists {
        /// The file.
        path: PathBuf,
    },
    /// An output would replace a file of another kind, which Drapery has not written.
    #[error(
        "{}: this file exists already and is no {kind} of Drapery\n  \
         help: give another name, or move this file away",
        path.display()
    )]
    OutputIsForeign {
        /// The file.
        path: PathBuf,
        /// Kind of the output, as in "page".
        kind: &'static str,
    },
    /// A cache would replace a file that the shot reads.
    #[error(
        "{}: this file is an input of the shot; writing the cache would destroy it\n  \
         help: choose another folder with --out",
        path.display()
    )]
    OutputIsInput {
        /// The file.
        path: PathBuf,
    },
    /// A file's content cannot be used.
    #[error(
        "{}: {place}: {what}\n  \
         help: {advice}",
        path.display()
    )]
    Data {
        /// The file.
        path: PathBuf,
        /// Line, object or element.
        place: String,
        /// Fault, in words.
        what: String,
        /// Remedy.
        advice: String,
    },
    /// A file refers to another one that is not there, or may not be read.
    #[error(
        "{}: {place}: {what}\n  \
         help: {advice}",
        path.display()
    )]
    MissingPart {
        /// The file that was opened.
        path: PathBuf,
        /// Object that refers to the other file.
        place: String,
        /// The missing part.
        what: String,
        /// The remedy.
        advice: String,
    },
    /// A file has a format that is not read or written here.
    #[error(
        "{}: {what}\n  \
         help: {advice}",
        path.display()
    )]
    Format {
        /// The file.
        path: PathBuf,
        /// Finding, in words.
        what: String,
        /// Alternative that would be accepted.
        advice: String,
    },
    /// An Alembic archive could not be read or written.
    #[error(transparent)]
    Alembic(#[from] AlembicError),
}

/// Whose fault an error is; it decides the exit code of the command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IoErrorKind {
    /// An input file is not there or may not be read.
    MissingInput,
    /// An input file holds what cannot be used.
    BadInput,
    /// An output cannot be created, or would replace something that is needed.
    CannotCreate,
    /// The system refused while reading or writing.
    Io,
    /// This program asked for something impossible.
    Internal,
}

impl IoError {
    /// Whose fault it is.
    pub fn kind(&self) -> IoErrorKind {
        match self {
            Self::Missing { .. } | Self::MissingPart { .. } | Self::NoRun { .. } => IoErrorKind::MissingInput,
            Self::Read { source, .. } if is_about_the_name(source) => IoErrorKind::MissingInput,
            Self::Read { .. } | Self::LockGone { .. } => IoErrorKind::Io,
            Self::Create { source, .. } if platform::is_out_of_files(source) => IoErrorKind::Io,
            Self::Create { .. } | Self::OutputExists { .. } | Self::OutputIsInput { .. } => IoErrorKind::CannotCreate,
            Self::OutputNotUtf8 { .. } | Self::OutputNotAFile { .. } => IoErrorKind::CannotCreate,
            Self::FileExists { .. } | Self::OutputIsForeign { .. } => IoErrorKind::CannotCreate,
            Self::Locked { .. } | Self::LockLost { .. } => IoErrorKind::CannotCreate,
            Self::Write { .. } | Self::NoRoom { .. } | Self::OutputChanged { .. } => IoErrorKind::Io,
            Self::NotAFile { .. } | Self::Data { .. } | Self::Format { .. } => IoErrorKind::BadInput,
            Self::Alembic(AlembicError::Io { action: "create", source, .. })
                if !has_no_room(source) && !platform::is_out_of_files(source) =>
            {
                IoErrorKind::CannotCreate
            }
            Self::Alembic(AlembicError::Io { .. }) => IoErrorKind::Io,
            Self::Alembic(AlembicError::Refused { .. } | AlembicError::TimeSampling { .. }) => IoErrorKind::Internal,
            Self::Alembic(_) => IoErrorKind::BadInput,
        }
    }

    /// An error of reading `path`; a missing file gets its own kind.
    pub fn reading(path: &Path, source: std::io::Error) -> Self {
        if source.kind() == ErrorKind::NotFound {
            return Self::Missing { path: path.to_owned() };
        }
        Self::Read { path: path.to_owned(), source }
    }

    /// An error of creating `path`; on a full disk it is one of writing.
    pub fn creating(path: &Path, source: std::io::Error) -> Self {
        if has_no_room(&source) {
            return Self::writing(path, source);
        }
        Self::Create { path: path.to_owned(), source }
    }

    /// An error of writing to `path`.
    pub fn writing(path: &Path, source: std::io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// Content of `path` that cannot be used.
    pub fn data(path: &Path, place: impl Into<String>, what: impl Into<String>, advice: impl Into<String>) -> Self {
        Self::Data { path: path.to_owned(), place: place.into(), what: what.into(), advice: advice.into() }
    }
}

/// Whether the system refuses because there is no room left: on the disk, or in what a user may take of it.
fn has_no_room(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
}

/// Whether a file cannot be read because of its name or its permissions: another attempt will not read it either.
fn is_about_the_name(error: &std::io::Error) -> bool {
    use ErrorKind::{InvalidFilename, NotADirectory, NotFound, PermissionDenied};
    platform::is_loop_of_links(error)
        || matches!(error.kind(), NotFound | PermissionDenied | NotADirectory | InvalidFilename)
}

/// Advice about an error of the system; `usual` where the error itself does not say.
fn advice_on<'a>(error: &std::io::Error, usual: &'a str) -> &'a str {
    if platform::is_out_of_files(error) { OPEN_FILES } else { usual }
}

/// Advice where a file cannot be read.
fn advice_on_reading(error: &std::io::Error) -> &'static str {
    let usual = if is_about_the_name(error) {
        "check that it is a file and that you may read it"
    } else {
        "check the disk or the file server, and run the same command again"
    };
    advice_on(error, usual)
}

/// Advice where a folder is no run, but may hold the folders of some.
fn advice_without_run(runs: &[PathBuf]) -> String {
    match runs.first() {
        None => "give the folder that `drapery run` wrote, the one named with --out".to_owned(),
        Some(run) => {
            format!("it holds the folders of {} runs; give one of them, for example {}", runs.len(), run.display())
        }
    }
}

/// Advice where no more files can be opened.
pub const OPEN_FILES: &str = "allow more open files (ulimit -n) and run the same command again";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_another_attempt_may_read_is_an_error_of_reading_and_what_it_cannot_is_a_missing_input() {
        use rustix::io::Errno;
        let path = Path::new("body.abc");
        let reading = |errno: Errno| IoError::reading(path, errno.into());
        for errno in [Errno::IO, Errno::STALE, Errno::MFILE, Errno::NFILE, Errno::TIMEDOUT, Errno::NOMEM] {
            assert_eq!(reading(errno).kind(), IoErrorKind::Io, "{errno}");
        }
        for errno in [Errno::NOENT, Errno::ACCESS, Errno::PERM, Errno::NOTDIR, Errno::LOOP, Errno::NAMETOOLONG] {
            assert_eq!(reading(errno).kind(), IoErrorKind::MissingInput, "{errno}");
        }
        for error in [reading(Errno::MFILE), IoError::creating(path, Errno::MFILE.into())] {
            assert_eq!(error.kind(), IoErrorKind::Io);
            assert!(error.to_string().contains("ulimit -n"), "{error}");
        }
    }

    #[test]
    fn a_full_disk_is_an_error_of_writing_whether_a_file_is_created_or_written() {
        let path = Path::new("out/sheet.abc");
        let full = || std::io::Error::from(ErrorKind::StorageFull);
        let alembic = |source| IoError::from(AlembicError::Io { path: path.to_owned(), action: "create", source });
        assert_eq!(IoError::creating(path, full()).kind(), IoErrorKind::Io);
        assert_eq!(alembic(full()).kind(), IoErrorKind::Io);
        assert_eq!(IoError::creating(path, ErrorKind::QuotaExceeded.into()).kind(), IoErrorKind::Io);
        assert_eq!(IoError::creating(path, ErrorKind::NotFound.into()).kind(), IoErrorKind::CannotCreate);
        assert_eq!(alembic(ErrorKind::NotFound.into()).kind(), IoErrorKind::CannotCreate);
    }
}

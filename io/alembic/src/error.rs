//! Failures of this crate, stated with file, place and next step.

use std::path::{Path, PathBuf};

/// Every failure of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AlembicError {
    /// The operating system refused a read or a write.
    #[error(
        "{}: could not {action}: {source}\n  \
         help: check path, permissions, free space and the limit of open files (ulimit -n)",
        path.display()
    )]
    Io {
        /// File concerned.
        path: PathBuf,
        /// Action that was tried.
        action: &'static str,
        /// Reason given by the system.
        source: std::io::Error,
    },
    /// The file uses the old HDF5 container.
    #[error(
        "{}: this Alembic archive uses the old HDF5 container, which is not supported\n  \
         help: re-export it as Ogawa, or convert it with `abcconvert -toOgawa`", path.display()
    )]
    Hdf5Container {
        /// File concerned.
        path: PathBuf,
    },
    /// The file does not start like an Ogawa archive.
    #[error("{}: not an Alembic Ogawa archive: {reason}\n  help: check the file name and export the cache again",
            path.display())]
    NotOgawa {
        /// File concerned.
        path: PathBuf,
        /// Description of the content found instead.
        reason: String,
    },
    /// The writer never committed.
    #[error(
        "{}: the archive was never finished by its writer (frozen byte not set)\n  \
         help: export it again; the exporter was probably killed", path.display()
    )]
    Unfinished {
        /// File concerned.
        path: PathBuf,
    },
    /// The content contradicts itself or the file length.
    #[error("{}: {place}: damaged: {reason}\n  help: the file is truncated or corrupt; copy or export it again",
            path.display())]
    Damaged {
        /// File concerned.
        path: PathBuf,
        /// Object path, with the property after a colon, or the table concerned.
        place: String,
        /// Description of the content found.
        reason: String,
    },
    /// An object, a property or a sample that was asked for is not there, or has another type.
    #[error("{}: {place}: {reason}\n  help: {help}", path.display())]
    Missing {
        /// File concerned.
        path: PathBuf,
        /// Object path, with the property after a colon.
        place: String,
        /// Description of the missing item.
        reason: String,
        /// Action to take.
        help: String,
    },
    /// A value given to the writer cannot be stored.
    #[error("{}: {place}: {reason}", path.display())]
    Refused {
        /// File concerned.
        path: PathBuf,
        /// Object path, with the property after a colon.
        place: String,
        /// Rule that it breaks and the input that would be accepted.
        reason: String,
    },
    /// Sample times that the format cannot express.
    #[error("time sampling: {reason}")]
    TimeSampling {
        /// Rule that is broken and the input that would be accepted.
        reason: String,
    },
}

/// A fault found below the level that knows file and object; [`Fault::at`] adds them.
#[derive(Debug)]
pub(crate) enum Fault {
    Io(std::io::Error),
    Damaged(String),
}

impl Fault {
    pub(crate) fn damaged(reason: impl Into<String>) -> Self {
        Fault::Damaged(reason.into())
    }

    pub(crate) fn at(self, path: &Path, place: &str) -> AlembicError {
        match self {
            Fault::Io(source) => AlembicError::Io { path: path.to_owned(), action: "read", source },
            Fault::Damaged(reason) => AlembicError::Damaged { path: path.to_owned(), place: place.to_owned(), reason },
        }
    }
}

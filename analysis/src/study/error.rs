//! Ways in which a study can fail.

use std::path::PathBuf;

use drapery_io::error::IoError;
use drapery_io::scene_file::SceneFileError;
use drapery_shot::ShotError;
use drapery_shot::fault::{Fault, FaultKind};

/// Why a study could not be made.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The scene file does not take a setting.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Scene(Vec<SceneFileError>),
    /// The scene cannot be simulated.
    #[error(transparent)]
    Shot(#[from] ShotError),
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The request cannot be carried out.
    #[error("{0}")]
    Asked(String),
    /// The folder holds another study.
    #[error(
        "{}: this folder holds a different study: {what}\n  \
         help: choose another folder with --out, or replace the study with --overwrite",
        folder.display()
    )]
    Other {
        /// The folder.
        folder: PathBuf,
        /// Difference between the studies.
        what: String,
    },
}

impl From<StudyError> for Fault {
    fn from(error: StudyError) -> Self {
        match error {
            StudyError::Scene(errors) => errors.into(),
            StudyError::Shot(error) => error.into(),
            StudyError::Io(error) => error.into(),
            StudyError::Asked(text) => Self::new(FaultKind::Usage, text),
            StudyError::Other { .. } => Self::new(FaultKind::CannotCreate, error.to_string()),
        }
    }
}

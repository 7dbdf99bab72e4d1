//! Faults of a stage: file, prim, description, and action to take.

use std::path::{Path, PathBuf};

/// Whose fault it is that a stage cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UsdErrorKind {
    /// A file is missing, or may not be read.
    Missing,
    /// A file holds what cannot be used.
    BadInput,
}

/// An error of reading a stage.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {place}: {what}\n  help: {advice}", path.display())]
pub struct UsdError {
    /// Whose fault it is.
    pub kind: UsdErrorKind,
    /// The file that was opened.
    pub path: PathBuf,
    /// Prim, attribute, or layer.
    pub place: String,
    /// Description of the fault.
    pub what: String,
    /// Action to take.
    pub advice: String,
}

impl UsdError {
    /// Content that cannot be used.
    pub(crate) fn bad(
        path: &Path,
        place: impl Into<String>,
        what: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        let (place, what, advice) = (place.into(), what.into(), advice.into());
        Self { kind: UsdErrorKind::BadInput, path: path.to_owned(), place, what, advice }
    }
}

//! Failures to build a simulation again around its state, by the state of the simulation after them.

use crate::snapshot::SnapshotError;

/// Failure to build a simulation again.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum RebuildError {
    /// The new form of the scene is refused; the simulation is as it was.
    Refused(SnapshotError),
    /// The simulation is in parts, and may not be used any more.
    Broken(SnapshotError),
}

impl RebuildError {
    /// The error without its consequence.
    pub(super) fn into_error(self) -> SnapshotError {
        match self {
            Self::Refused(error) | Self::Broken(error) => error,
        }
    }
}

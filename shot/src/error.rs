//! Errors of a shot.

use std::path::PathBuf;

use drapery_core::error::{Problems, StepError};
use drapery_io::error::IoError;

use crate::recorded_frames::FrameFault;

/// Why a shot could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ShotError {
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The scene or its inputs are wrong; all problems.
    #[error("{0}")]
    Problems(Problems),
    /// An object that was asked for is not in the shot: a garment, a body.
    #[error("{0}")]
    Unknown(String),
    /// The frames asked for cannot be simulated.
    #[error("{0}")]
    Frames(String),
    /// The solver gave up.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The run that the folder holds is one of another scene, or of other inputs.
    #[error(
        "{}: this folder holds a run of the same name, but of a different shot\n  {}\n  \
         help: choose another folder with --out, start over with --overwrite, or resume anyway with \
         --resume-with-changes: frames after the last checkpoint are then simulated with the changes",
        folder.display(), changes.join("\n  ")
    )]
    Changed {
        /// The folder.
        folder: PathBuf,
        /// Changes that were found.
        changes: Vec<String>,
    },
    /// The dependencies of the run that the folder holds are not known.
    #[error(
        "{}: this file is missing or damaged, so it is unknown whether the run in this folder is of the same shot\n  \
         help: choose another folder with --out, start over with --overwrite, or resume anyway with \
         --resume-with-changes, which treats everything as changed",
        path.display()
    )]
    FingerprintLost {
        /// The file.
        path: PathBuf,
    },
    /// The checkpoint that a run goes on from does not fit the shot as it is now.
    #[error(
        "{}: this checkpoint belongs to a different shot: {what}\n  \
         help: --resume-with-changes accepts changed numbers, but not changed meshes, garments or pins: start over \
         with --overwrite, or choose another folder with --out",
        path.display()
    )]
    OtherState {
        /// The checkpoint.
        path: PathBuf,
        /// Description of the mismatch.
        what: String,
    },
    /// A frame before the one that a run is told to go on after is not what was written.
    #[error(
        "{fault}\n  \
         help: resume from a checkpoint before this frame with --resume FRAME, leave --resume {asked} out to let the run find \
         one, or start over with --overwrite"
    )]
    FrameChanged {
        /// The cache, the frame, and what is wrong.
        fault: FrameFault,
        /// The frame of `--resume`.
        asked: i64,
    },
    /// There is nothing to go on from where it was asked for.
    #[error("{0}")]
    Resume(String),
}

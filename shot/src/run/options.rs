//! Options of a run: the requests made to the command.

use std::path::PathBuf;

use drapery_core::observe::Tracepoint;
use drapery_io::checkpoint::Every;

use crate::error::ShotError;
use crate::farm::stop::StopRequests;

/// Point at which a run begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resume {
    /// After the last good checkpoint of an earlier run in the folder, if there is one.
    Auto,
    /// At the first frame; a folder that holds a run is refused.
    Never,
    /// After the checkpoint of this frame.
    Frame(i64),
}

/// Options of a run.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// Folder of the output.
    pub out: PathBuf,
    /// Point at which it begins.
    pub resume: Resume,
    /// Whether a run that the folder holds is replaced.
    pub overwrite: bool,
    /// Whether a run of another scene, or with other inputs, is gone on with.
    pub with_changes: bool,
    /// Whether the folder is taken from a run that may be in progress.
    pub steal_lock: bool,
    /// Number of threads of each rank, for the record; the caller has set up the pool.
    pub threads: usize,
    /// Interval at which checkpoints are written.
    pub checkpoint_every: Every,
    /// Number of the last checkpoints that are kept.
    pub keep: usize,
    /// Frames of which checkpoints are written and kept in any case.
    pub pinned: Vec<i64>,
    /// Sources of requests to stop the run.
    pub requests: StopRequests,
    /// The command line that continues it, for the manifest.
    pub command: String,
    /// Lines of the solver's listings after which the cloth is written down.
    pub dump: Vec<Tracepoint>,
}

impl RunOptions {
    /// Checkpoints that a run keeps when nobody says.
    pub const KEEP: usize = 3;

    /// A run into a folder that starts or goes on, on one thread, and that nobody stops.
    pub fn new(out: PathBuf) -> Self {
        Self {
            out,
            resume: Resume::Auto,
            overwrite: false,
            with_changes: false,
            steal_lock: false,
            threads: 1,
            checkpoint_every: Every::Auto,
            keep: Self::KEEP,
            pinned: Vec::new(),
            requests: StopRequests::default(),
            command: String::new(),
            dump: Vec::new(),
        }
    }
    /// Refuses frames to pin that the shot does not have: their checkpoints would never be written.
    ///
    /// # Errors
    /// The first such.
    pub(super) fn refuse_pins_outside(&self, [first, last]: [i64; 2]) -> Result<(), ShotError> {
        self.pinned.iter().find(|frame| !(first..=last).contains(*frame)).map_or(Ok(()), |frame| {
            Err(ShotError::Frames(format!(
                "--pin-checkpoint {frame}: the shot has no such frame\n  help: its frames are {first}-{last}"
            )))
        })
    }
}

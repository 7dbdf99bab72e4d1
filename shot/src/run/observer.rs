//! Reports of a run while it goes on, and when it has ended.

use std::fs::File;
use std::path::PathBuf;

use drapery_core::metrics::Metrics;
use drapery_core::simulation::FrameSummary;

use crate::farm::stop::Reason;
use crate::quality::Exceeded;
use crate::run_record::strains::BeyondFabric;

/// One frame that is done.
#[derive(Debug, Clone, Copy)]
pub struct FrameReport<'a> {
    /// Its number.
    pub frame: i64,
    /// Last frame of the run.
    pub last_frame: i64,
    /// Whether it lies before the first frame that is delivered.
    pub is_preroll: bool,
    /// Frames done so far, pre-roll and those of earlier attempts included.
    pub done: u64,
    /// Frames in all, pre-roll included.
    pub total: u64,
    /// Seconds it took, reading and writing included.
    pub seconds: f64,
    /// Report of the solver; `None` for the frame at which the simulation starts.
    pub summary: Option<&'a FrameSummary>,
}

/// Outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All frames are written.
    Done,
    /// All frames were there already; nothing was written.
    NothingToDo,
    /// It was told to stop, and goes on from the last checkpoint when it is run again.
    Stopped(Reason),
}

/// Time and output of a whole run, in all its attempts.
#[derive(Debug, Clone, PartialEq)]
pub struct RunReport {
    /// Outcome of the run.
    pub outcome: Outcome,
    /// The last frame that is done.
    pub frame: i64,
    /// Stages and counts of all frames.
    pub metrics: Metrics,
    /// Seconds of all frames.
    pub seconds: f64,
    /// Frames delivered.
    pub frames: u64,
    /// The caches.
    pub files: Vec<PathBuf>,
    /// Files over the caches of all garments of a format: what is opened to see the shot.
    pub layers: Vec<PathBuf>,
    /// Counts that should have stayed zero, in the order in which they rose.
    pub exceeded: Vec<Exceeded>,
    /// Frames whose counts are not known, as ranges: earlier attempts simulated them, and the record does not tell.
    pub uncounted: Vec<[i64; 2]>,
    /// Garments that were stretched beyond the limit of their fabric.
    pub beyond_fabric: Vec<BeyondFabric>,
    /// Number of ranks of this attempt.
    pub ranks: usize,
}

/// Receiver of the reports of a run while it goes on.
pub trait Observer {
    /// The logs of this attempt are open: words, then JSON lines.
    fn logs(&mut self, _files: [File; 2]) {}

    /// The run does not begin at the first frame: `done` frames are complete.
    fn resumed(&mut self, _frame: i64, _done: u64) {}

    /// Receives a note for the user of the run.
    fn note(&mut self, text: String);

    /// Receives a change since an earlier attempt that is as it should be.
    fn accepted(&mut self, _text: String) {}

    /// Receives the description of a dump.
    fn dumped(&mut self, _text: String) {}

    /// A frame takes long: it has this number of collision-free states so far, and this share of its time is done.
    fn underway(&mut self, _frame: i64, _states: u64, _share: f64) {}

    /// A frame is on the disk.
    fn frame(&mut self, report: &FrameReport<'_>);
}

/// A function that hears of frames alone.
impl<F: FnMut(&FrameReport<'_>)> Observer for F {
    fn note(&mut self, _text: String) {}

    fn frame(&mut self, report: &FrameReport<'_>) {
        self(report);
    }
}

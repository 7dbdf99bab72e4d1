//! Requests to a run in progress: stop, stop at once, write a checkpoint.
//!
//! The frame loop asks after every step that leaves a state free of collisions ([`StopRequests::poll`]). Requests come
//! from signals, from the time that the run may take, and from files in `OUT/control`: `stop` and `checkpoint`.
//!
//! A file `checkpoint` is removed when the request is handed to the frame loop. A file `stop` stays as long as the run
//! is ending, and is removed when it has ended ([`StopRequests::finish`]). What an earlier run was killed over is removed
//! at the start ([`StopRequests::watch_folder`]): a file that stays would stop every attempt to continue.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};
use std::{fmt, fs};

use drapery_io::atomic_file;
use drapery_io::error::IoError;

use crate::farm::lock::{self, Holder};
use crate::run_record::MANIFEST;
use crate::run_record::folder::no_run;

/// Folder of the request files in the folder of a run.
pub(crate) const CONTROL: &str = "control";

/// File that asks for a checkpoint and the end.
const STOP: &str = "stop";

/// File that asks for a checkpoint.
const CHECKPOINT: &str = "checkpoint";

/// Shortest time between two looks for files: a look costs a file server as much as a small read.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// The same signal again within this time counts once: launchers signal the group of processes and then each process.
const SAME_SIGNAL: Duration = Duration::from_millis(500);

/// Checkpoints that must fit into the time before a deadline: the one to come may take twice as long as the slowest yet.
const CHECKPOINTS_IN_RESERVE: f64 = 2.0;

/// Least time before a deadline at which a run ends [s]: programs need a while to start and to end.
const LEAST_RESERVE: f64 = 10.0;

/// The least time is not more than this share of the time that there was: short runs are to get somewhere, too.
const LEAST_RESERVE_SHARE: f64 = 0.1;

/// Frames from which the time of the next is estimated.
const FRAMES_SEEN: usize = 10;

/// A signal that asks a run to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// SIGTERM: a scheduler takes the machine away.
    Terminate,
    /// SIGUSR1: notice before the end of the time.
    User1,
    /// SIGUSR2: the same, on other schedulers.
    User2,
    /// SIGINT: somebody pressed Ctrl-C.
    Interrupt,
    /// SIGXCPU: the limit of processor time.
    CpuLimit,
    /// SIGHUP: the terminal is gone, or the connection to the machine.
    HangUp,
}

/// Why a run stops early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// A signal came.
    Signal(Signal),
    /// The run has taken the time that it was given.
    MaxWall,
    /// The point of time has come at which it is to stop.
    StopAt,
    /// The scheduler's job ends.
    JobEnd,
    /// Somebody made the file `control/stop`.
    ControlFile,
    /// The program that runs Drapery as a library has said so.
    Program,
}

impl Reason {
    /// The word for log and manifest; it never changes its meaning.
    pub fn word(self) -> &'static str {
        match self {
            Self::Signal(Signal::Terminate) => "signal TERM",
            Self::Signal(Signal::User1) => "signal USR1",
            Self::Signal(Signal::User2) => "signal USR2",
            Self::Signal(Signal::Interrupt) => "signal INT",
            Self::Signal(Signal::CpuLimit) => "signal XCPU",
            Self::Signal(Signal::HangUp) => "signal HUP",
            Self::MaxWall => "max-wall",
            Self::StopAt => "stop-at",
            Self::JobEnd => "job-end",
            Self::ControlFile => "control/stop",
            Self::Program => "program",
        }
    }
}

/// All reasons; of several at once, the last in this list is the one that is reported.
const REASONS: [Reason; 11] = [
    Reason::Program,
    Reason::ControlFile,
    Reason::JobEnd,
    Reason::StopAt,
    Reason::MaxWall,
    Reason::Signal(Signal::HangUp),
    Reason::Signal(Signal::CpuLimit),
    Reason::Signal(Signal::User2),
    Reason::Signal(Signal::User1),
    Reason::Signal(Signal::Interrupt),
    Reason::Signal(Signal::Terminate),
];

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.word())
    }
}

/// Request to the frame loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Say how far the frame is, and go on.
    Report,
    /// Write a checkpoint and go on. Asked for once.
    Checkpoint,
    /// Write a checkpoint and end. Asked for again until the run ends.
    Stop(Reason),
    /// End without another checkpoint; the last one is where the run continues.
    StopAtOnce(Reason),
}

impl Request {
    /// A number that is the larger, the more urgent a request is; 0 for none. Ranks agree on what to do by the largest.
    pub(crate) fn urgency(request: Option<Self>) -> f64 {
        let place = |reason| REASONS.iter().position(|known| *known == reason).unwrap_or(0);
        let urgency = match request {
            None => 0,
            Some(Self::Report) => 1,
            Some(Self::Checkpoint) => 2,
            Some(Self::Stop(reason)) => 3 + place(reason),
            Some(Self::StopAtOnce(reason)) => 3 + REASONS.len() + place(reason),
        };
        urgency as f64
    }

    /// The request of an urgency.
    pub(crate) fn of_urgency(urgency: f64) -> Option<Self> {
        let reason = |place: usize| REASONS.get(place).copied();
        match urgency as usize {
            0 => None,
            1 => Some(Self::Report),
            2 => Some(Self::Checkpoint),
            stop => match reason(stop - 3) {
                Some(reason) => Some(Self::Stop(reason)),
                None => reason(stop - 3 - REASONS.len()).map(Self::StopAtOnce),
            },
        }
    }
}

/// Time that a run needs for ending before its earliest deadline, and the time that there is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Notice {
    /// Why it will stop.
    pub reason: Reason,
    /// Twice its slowest checkpoint and the longest of its last frames, or the least reserve if that is more [s].
    pub needed: f64,
    /// Until the deadline [s].
    pub left: f64,
    /// Whether a checkpoint was written, so that `needed` is measured.
    pub knows_checkpoints: bool,
}

/// All requests to one run. Clones are the same requests: one stays with the signals, one goes into the frame loop.
#[derive(Debug, Clone, Default)]
pub struct StopRequests(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    /// Says whether the program that runs Drapery as a library wants the run to stop.
    cancelled: Option<Cancelled>,
    /// The first signal and when it came.
    signal: Option<(Signal, SystemTime)>,
    /// The second one.
    second: Option<Signal>,
    deadlines: Vec<Deadline>,
    files: Option<ControlFiles>,
    slowest_checkpoint: f64,
    frames: VecDeque<f64>,
    /// Number of times that the frame loop has asked, and whether the run has ended.
    polls: u64,
    ended: bool,
}

/// Place of a signal among the signals that came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SignalOrder {
    /// The first one.
    First,
    /// Another one, or the same somewhat later.
    Later,
    /// The same once more, at the same time.
    Repeated,
}

/// Whether to stop; asked from any thread at every state free of collisions, so it has to be quick.
pub type Cancelled = Box<dyn FnMut() -> bool + Send>;

impl fmt::Debug for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cancelled, signal, second, deadlines, files, .. } = self;
        let mut all = f.debug_struct("State");
        all.field("asks_the_program", &cancelled.is_some()).field("signal", signal).field("second", second);
        all.field("deadlines", deadlines).field("files", files).finish_non_exhaustive()
    }
}

#[derive(Debug, Clone, Copy)]
struct Deadline {
    reason: Reason,
    at: SystemTime,
    /// Time that was left until then when the run learnt of it.
    span: Duration,
}

#[derive(Debug)]
struct ControlFiles {
    folder: PathBuf,
    last_look: Option<SystemTime>,
    stop: bool,
    /// Age of the request that was handed on, should its file not go away.
    obeyed: Option<SystemTime>,
}

impl StopRequests {
    /// A signal came; it may be the second one.
    pub fn signal(&self, signal: Signal, now: SystemTime) -> SignalOrder {
        let mut state = self.state();
        match state.signal {
            None => {
                state.signal = Some((signal, now));
                SignalOrder::First
            }
            Some((first, at)) if first == signal && now.duration_since(at).unwrap_or_default() < SAME_SIGNAL => {
                SignalOrder::Repeated
            }
            Some(_) => {
                state.second = state.second.or(Some(signal));
                SignalOrder::Later
            }
        }
    }

    /// Returns the number of times that the frame loop has asked for requests so far: after every step that leaves a
    /// state free of collisions, and at frames. `None` once the run has ended.
    pub fn polls(&self) -> Option<u64> {
        let state = self.state();
        (!state.ended).then_some(state.polls)
    }

    /// The run is to have ended at a point of time. Of several, the earliest counts.
    pub fn deadline(&self, reason: Reason, at: SystemTime, now: SystemTime) {
        let span = at.duration_since(now).unwrap_or_default();
        self.state().deadlines.push(Deadline { reason, at, span });
    }

    /// From now on asks the program that runs Drapery as a library, too.
    pub fn ask_program(&self, cancelled: Cancelled) {
        self.state().cancelled = Some(cancelled);
    }

    /// Looks for request files in the folder of the run from now on; requests to an earlier run are removed.
    ///
    /// Only the process with the lock of the folder may do this. Returns the names of what was removed.
    ///
    /// # Errors
    /// The folder `control` cannot be created.
    pub(crate) fn watch_folder(&self, run_folder: &Path) -> Result<Vec<&'static str>, IoError> {
        let folder = run_folder.join(CONTROL);
        fs::create_dir_all(&folder).map_err(|e| IoError::creating(&folder, e))?;
        let mut removed = Vec::new();
        for name in [STOP, CHECKPOINT] {
            let file = folder.join(name);
            if atomic_file::remove(&file).map_err(|e| IoError::writing(&file, e))? {
                removed.push(name);
            }
        }
        self.state().files = Some(ControlFiles { folder, last_look: None, stop: false, obeyed: None });
        Ok(removed)
    }

    /// A checkpoint took so long [s].
    pub(crate) fn note_checkpoint(&self, seconds: f64) {
        let mut state = self.state();
        state.slowest_checkpoint = state.slowest_checkpoint.max(seconds);
    }

    /// A frame took so long [s].
    pub(crate) fn note_frame(&self, seconds: f64) {
        let mut state = self.state();
        if state.frames.len() == FRAMES_SEEN {
            state.frames.pop_front();
        }
        state.frames.push_back(seconds);
    }

    /// The earliest deadline, and how long before it the run will stop as things are now. `None` without a deadline.
    pub fn notice(&self, now: SystemTime) -> Option<Notice> {
        let state = self.state();
        let deadline = state.deadlines.iter().min_by_key(|deadline| deadline.at)?;
        Some(Notice {
            reason: deadline.reason,
            needed: deadline.reserve(state.needed_notice()),
            left: deadline.left(now),
            knows_checkpoints: state.slowest_checkpoint > 0.0,
        })
    }

    /// Returns the present request. Signals come before deadlines, and deadlines before files.
    pub fn poll(&self, now: SystemTime) -> Option<Request> {
        let mut state = self.state();
        state.polls += 1;
        if let Some(second) = state.second {
            return Some(Request::StopAtOnce(Reason::Signal(second)));
        }
        if let Some((first, _)) = state.signal {
            return Some(Request::Stop(Reason::Signal(first)));
        }
        let needed = state.needed_notice();
        let passed = state.deadlines.iter().filter(|deadline| deadline.has_come(needed, now));
        if let Some(deadline) = passed.min_by_key(|deadline| deadline.at) {
            return Some(Request::Stop(deadline.reason));
        }
        let of_files = state.files.as_mut().and_then(|files| files.look(now));
        // Not while the requests are held: what is asked may use them.
        let cancelled = state.cancelled.take();
        drop(state);
        of_files.or_else(|| self.poll_program(cancelled?))
    }

    fn poll_program(&self, mut cancelled: Cancelled) -> Option<Request> {
        let stops = cancelled();
        self.state().cancelled.get_or_insert(cancelled);
        stops.then_some(Request::Stop(Reason::Program))
    }

    /// The run has ended: removes its request files.
    pub fn finish(&self) {
        self.state().ended = true;
        if let Some(files) = self.state().files.take() {
            for name in [STOP, CHECKPOINT] {
                // If it stays, the next start removes it.
                let _ = fs::remove_file(files.folder.join(name));
            }
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Every change is complete in itself, so a panic elsewhere leaves nothing half done.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn needed_notice(&self) -> f64 {
        let frame = self.frames.iter().copied().fold(0.0, f64::max);
        CHECKPOINTS_IN_RESERVE * self.slowest_checkpoint + frame
    }
}

impl Deadline {
    /// Whether what is left of the time is needed for ending.
    fn has_come(&self, needed_notice: f64, now: SystemTime) -> bool {
        self.left(now) <= self.reserve(needed_notice)
    }

    /// Time until it [s].
    fn left(&self, now: SystemTime) -> f64 {
        self.at.duration_since(now).unwrap_or_default().as_secs_f64()
    }

    /// Time before it at which the run ends [s].
    fn reserve(&self, needed_notice: f64) -> f64 {
        needed_notice.max(LEAST_RESERVE.min(LEAST_RESERVE_SHARE * self.span.as_secs_f64()))
    }
}

impl ControlFiles {
    fn look(&mut self, now: SystemTime) -> Option<Request> {
        let since = self.last_look.map(|last| now.duration_since(last).unwrap_or(LOOK_EVERY));
        if !self.stop && since.is_some_and(|since| since < LOOK_EVERY) {
            return None;
        }
        self.last_look = Some(now);
        self.stop |= self.folder.join(STOP).exists();
        if self.stop {
            return Some(Request::Stop(Reason::ControlFile));
        }
        let path = self.folder.join(CHECKPOINT);
        let asked = fs::metadata(&path).and_then(|about| about.modified()).ok()?;
        // A file that others own may not go away; it is obeyed once all the same.
        let _ = fs::remove_file(&path);
        (self.obeyed.replace(asked) != Some(asked)).then_some(Request::Checkpoint)
    }
}

/// Asks the run in a folder to write a checkpoint and to end, from another process. Returns who was asked; `None` when
/// nobody runs there, and nothing was done.
///
/// # Errors
/// The folder holds no run, or the request cannot be written.
pub fn request_stop(run_folder: &Path, now: SystemTime) -> Result<Option<Holder>, IoError> {
    let holder = lock::holder(run_folder, now)?;
    if holder.is_none() && !run_folder.join(MANIFEST).exists() {
        return Err(no_run(run_folder));
    }
    if holder.as_ref().is_none_or(|holder| holder.presence == lock::Presence::Gone) {
        return Ok(None);
    }
    let folder = run_folder.join(CONTROL);
    fs::create_dir_all(&folder).map_err(|e| IoError::creating(&folder, e))?;
    let path = folder.join(STOP);
    fs::write(&path, "").map_err(|e| IoError::creating(&path, e))?;
    Ok(holder)
}

#[cfg(test)]
mod tests;

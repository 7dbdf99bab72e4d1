//! Progress of a run, for `drapery status`. Reads only; a run that is being written is not disturbed.

use std::path::Path;
use std::time::{Duration, SystemTime};

use drapery_io::duration::utc;
use drapery_io::error::IoError;
use drapery_shot::farm::lock::{self, Holder, Presence};
use drapery_shot::farm::stale::{self, Stale};
use drapery_shot::quality::{LIMITS, RETRIES, is_limit};
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::manifest::ManifestCheckpoint;
use drapery_shot::run_record::reader::{FrameRow, median};
use serde::Serialize;

/// Number of frames from which the rate is given.
const RATE_FRAMES: usize = 10;

/// Word for a process that runs.
const ALIVE: &str = "alive";

/// Word for a process, and for its run, that was not heard of for minutes.
const SILENT: &str = "silent";

/// Word for a process that has certainly ended.
const GONE: &str = "gone";

/// State of a run that goes on.
const RUNNING: &str = "running";

/// State of a run whose process ended without a message.
const KILLED: &str = "killed";

/// Progress of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    /// Folder of the run, as it was named.
    pub folder: String,
    /// Name of the shot.
    pub shot: String,
    /// `running`, `stopped`, `done`, `failed`, `killed` (its process ended without a message), or `silent` (no heartbeat for minutes).
    pub state: String,
    /// End of the last attempt: `done`, `failed`, or the reason of a stop, as in `signal TERM`; `None` while it runs and after a kill.
    pub end: Option<String>,
    /// Why it failed.
    pub error: Option<String>,
    /// First frame that is delivered.
    pub first_frame: i64,
    /// Last frame that is delivered.
    pub last_frame: i64,
    /// Last frame that is complete in every cache.
    pub last_complete_frame: Option<i64>,
    /// Last frame that was simulated; before the first delivered one during the pre-roll.
    pub reached_frame: Option<i64>,
    /// Delivered frames that are complete.
    pub frames_done: i64,
    /// Frames to deliver.
    pub frames_total: i64,
    /// Seconds a frame: the median of the last ten.
    pub seconds_per_frame: Option<f64>,
    /// Seconds to the end at that rate; `None` before the first frame and after the last.
    pub seconds_left: Option<f64>,
    /// Time of day at which it ends at that rate, as in `2026-05-04 09:30:00 UTC`; `None` unless it runs.
    pub eta: Option<String>,
    /// Seconds that the frames of all attempts took.
    pub seconds: f64,
    /// Number of attempts.
    pub attempts: usize,
    /// Machine of the last attempt; rank 0 of several.
    pub host: Option<String>,
    /// Last good checkpoint.
    pub checkpoint: Option<ManifestCheckpoint>,
    /// Counts that should be zero and are not.
    pub degradations: Vec<Degradation>,
    /// Retries of failed collision steps, without those that hold vertices in place: these are among the degradations.
    pub steps_tried_again: u64,
    /// Frames whose counts are not known, as ranges: nobody can say whether these hold more such counts.
    pub uncounted: Vec<[i64; 2]>,
    /// Number and size of the things that attempts have set aside, if they have.
    pub stale: Option<Stale>,
    /// The process that works on it; rank 0 of several.
    pub process: Option<Process>,
    /// Number of ranks of the last attempt.
    pub ranks: usize,
    /// Command line that goes on with the run.
    pub command: Option<String>,
}

/// A count that should be zero and is not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Degradation {
    /// Its name.
    pub name: &'static str,
    /// Meaning of the count.
    pub meaning: &'static str,
    /// Total of all frames so far.
    pub total: u64,
    /// First frame in which it was not zero.
    pub first_frame: i64,
    /// Frame in which it was largest.
    pub worst_frame: i64,
    /// Number of frames in which it was not zero.
    pub frames: usize,
}

/// The process that holds the folder's lock.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Process {
    /// Machine; `None` when the lock cannot be understood.
    pub host: Option<String>,
    /// Process number.
    pub pid: Option<u32>,
    /// `alive`, `silent` (not heard of for minutes, on a machine that cannot be seen from here) or `gone`.
    pub presence: &'static str,
    /// Seconds since it last gave a sign of life.
    pub heartbeat_seconds: u64,
}

impl Status {
    /// Looks at the folder of a run; `now` is the time of day, for the age of the heartbeat.
    ///
    /// # Errors
    /// The folder holds no run, or its manifest cannot be understood.
    pub fn of(path: &Path, now: SystemTime) -> Result<Self, IoError> {
        // Before the manifest: a run that ends in the meantime has its last word there.
        let mut process = lock::holder(path, now)?;
        let folder = RunFolder::read(path)?;
        if process.is_none() {
            // Or it has begun in the meantime.
            process = lock::holder(path, now)?;
        }
        let process = process.map(Process::from);
        let (frames_done, frames_total) = folder.delivered();
        let rows = &folder.record.frames;
        // The first row is the start, where nothing is simulated; it would make a young run look fast.
        let seconds: Vec<f64> = rows.iter().skip(1).rev().take(RATE_FRAMES).map(|row| row.seconds).collect();
        let rate = median(&seconds);
        let reached = rows.last().map(|row| row.frame).or(folder.record.header.start_frame);
        let left = folder.manifest.last_frame - reached.unwrap_or(folder.manifest.first_frame);
        let degradations = degradations(&folder);
        let steps_tried_again = retries(&folder).map_or(0, |(total, _)| total);
        let start = folder.record.header.start_frame.unwrap_or(folder.manifest.first_frame);
        let counted_to = folder.manifest.last_complete_frame.or(reached);
        let uncounted = counted_to.map_or_else(Vec::new, |last| folder.record.uncounted(start, last));
        let manifest = folder.manifest;
        let state = judged(&manifest.state, process.as_ref());
        let seconds_left = rate.filter(|_| left > 0).map(|rate| rate * left as f64);
        // A damaged record may say any number of seconds.
        let eta = seconds_left.and_then(|left| now.checked_add(Duration::try_from_secs_f64(left).ok()?)).map(utc);
        let last = manifest.attempts.last();
        Ok(Self {
            folder: path.display().to_string(),
            shot: manifest.shot,
            end: last.and_then(|attempt| attempt.end.clone()),
            error: manifest.error,
            first_frame: manifest.first_frame,
            last_frame: manifest.last_frame,
            last_complete_frame: manifest.last_complete_frame,
            reached_frame: reached,
            frames_done,
            frames_total,
            seconds_per_frame: rate,
            seconds_left,
            eta: eta.filter(|_| state == RUNNING),
            state,
            seconds: manifest.attempts.iter().map(|attempt| attempt.seconds).sum(),
            attempts: manifest.attempts.len(),
            host: last.map(|attempt| attempt.host.clone()).filter(|host| !host.is_empty()),
            checkpoint: manifest.checkpoint,
            degradations,
            steps_tried_again,
            uncounted,
            stale: stale::look(path),
            process,
            // Older programs had one.
            ranks: last.map_or(1, |attempt| attempt.ranks.max(1)),
            command: manifest.command,
        })
    }
}

/// State of a run from the word in its manifest, which a process that was killed leaves at `running`, and the owner of its lock.
fn judged(written: &str, process: Option<&Process>) -> String {
    let state = match process.map(|process| process.presence) {
        _ if written != RUNNING => written,
        Some(ALIVE) => RUNNING,
        Some(SILENT) => SILENT,
        // A process that ends by itself removes its lock after it has written how it ended.
        _ => KILLED,
    };
    state.to_owned()
}

/// Counts with a limit that are not zero, in the order of the table of limits.
pub fn degradations(folder: &RunFolder) -> Vec<Degradation> {
    let rows = &folder.record.frames;
    let summed = |&(name, meaning): &(&'static str, &'static str)| {
        let amounts = rows.iter().map(|row| (row.frame, row.amount(name)));
        let bad: Vec<(i64, u64)> = amounts.filter(|(_, amount)| *amount > 0).collect();
        let (first_frame, _) = *bad.first()?;
        // Of equally bad frames the first.
        let (worst_frame, _) = *bad.iter().rev().max_by_key(|(_, amount)| amount)?;
        // A record may say anything; a sum beyond all numbers is still a large one.
        let total = bad.iter().fold(0, |sum: u64, (_, amount)| sum.saturating_add(*amount));
        Some(Degradation { name, meaning, total, first_frame, worst_frame, frames: bad.len() })
    };
    LIMITS.iter().filter_map(summed).collect()
}

/// Number of retries of failed collision steps that are no limits, and the first frame with one. A step that no such retry helped has
/// them, too.
pub fn retries(folder: &RunFolder) -> Option<(u64, i64)> {
    let names = RETRIES.iter().map(|(name, _)| *name).filter(|name| !is_limit(name));
    let of_row = |row: &FrameRow| names.clone().fold(0, |sum: u64, name| sum.saturating_add(row.amount(name)));
    let amounts = folder.record.frames.iter().map(|row| (row.frame, of_row(row))).filter(|(_, amount)| *amount > 0);
    amounts.fold(None, |found: Option<(u64, i64)>, (frame, amount)| match found {
        Some((total, first)) => Some((total.saturating_add(amount), first)),
        None => Some((amount, frame)),
    })
}

impl From<Holder> for Process {
    fn from(holder: Holder) -> Self {
        let presence = match holder.presence {
            Presence::Alive => ALIVE,
            Presence::Silent => SILENT,
            Presence::Gone => GONE,
        };
        let (host, pid) = holder.owner.map(|owner| (owner.host, owner.pid)).unzip();
        Self { host, pid, presence, heartbeat_seconds: holder.silent_for.as_secs() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_shot::farm::lock::RunLock;
    use drapery_shot::farm::process::Owner;

    /// A run of ten frames, and one before them, that has reached 1004.
    fn half_done(folder: &Path, state: &str) {
        let manifest = format!(
            "{{\"shot\":\"s\",\"state\":\"{state}\",\"first_frame\":1001,\"last_frame\":1010,\
             \"last_complete_frame\":1004,\"command\":\"drapery run s.toml\",\
             \"checkpoint\":{{\"file\":\"checkpoints/frame_01003.h5\",\"frame\":1003,\"sub_step\":2}}}}"
        );
        std::fs::write(folder.join("manifest.json"), manifest).unwrap();
        let mut record = String::from("{\"record\":\"start\",\"frame\":1000,\"seconds\":0.001}\n");
        for (frame, seconds, short, crossings) in
            [(1001, 1.0, 0, 0), (1002, 1.0, 0, 4), (1003, 50.0, 2, 4), (1004, 2.0, 1, 0)]
        {
            record += &format!(
                "{{\"record\":\"frame\",\"frame\":{frame},\"seconds\":{seconds},\
                 \"counts\":{{\"cg_short\":{short},\"crossings\":{crossings},\"zones\":9}}}}\n"
            );
        }
        std::fs::write(folder.join("run.jsonl"), record + "{\"record\":\"fra").unwrap();
    }

    #[test]
    fn rate_time_left_and_degradations_come_from_the_record() {
        let folder = tempfile::tempdir().unwrap();
        half_done(folder.path(), "running");
        let status = Status::of(folder.path(), SystemTime::now()).unwrap();
        assert_eq!((status.frames_done, status.frames_total), (4, 10));
        assert_eq!((status.seconds_per_frame, status.seconds_left), (Some(2.0), Some(12.0)));
        let found = |d: &Degradation| (d.name, d.total, d.first_frame, d.worst_frame, d.frames);
        let found: Vec<_> = status.degradations.iter().map(found).collect();
        assert_eq!(found, [("crossings", 8, 1002, 1002, 2), ("cg_short", 3, 1003, 1003, 2)]);
        assert_eq!(status.checkpoint.as_ref().map(|c| (c.frame, c.sub_step)), Some((1003, 2)));
        // Nobody holds the folder of a run that its manifest takes for running.
        assert_eq!((status.process.as_ref(), status.state.as_str(), status.eta.as_ref()), (None, "killed", None));
    }

    #[test]
    fn a_folder_without_a_manifest_is_refused_with_advice() {
        let folder = tempfile::tempdir().unwrap();
        let error = Status::of(folder.path(), SystemTime::now()).unwrap_err();
        assert!(error.to_string().contains("--out"), "{error}");
        std::fs::write(folder.path().join("manifest.json"), "{\"shot\": 7").unwrap();
        let error = Status::of(folder.path(), SystemTime::now()).unwrap_err();
        assert!(error.to_string().contains("manifest.json"), "{error}");
    }

    #[test]
    fn attempts_are_counted_and_the_last_one_names_machine_and_end() {
        let folder = tempfile::tempdir().unwrap();
        let attempts = r#"[{"host":"render01","seconds":40.0,"end":"signal TERM"},{"host":"render02","seconds":2.5,"end":"max-wall"}]"#;
        let manifest =
            format!(r#"{{"shot":"s","state":"stopped","first_frame":1,"last_frame":9,"attempts":{attempts}}}"#);
        std::fs::write(folder.path().join("manifest.json"), manifest).unwrap();
        let status = Status::of(folder.path(), SystemTime::now()).unwrap();
        assert_eq!((status.attempts, status.seconds), (2, 42.5));
        assert_eq!((status.host.as_deref(), status.end.as_deref()), (Some("render02"), Some("max-wall")));
        assert_eq!((status.state.as_str(), status.eta), ("stopped", None));
    }

    #[test]
    fn the_holder_of_the_lock_is_named_while_it_runs() {
        let folder = tempfile::tempdir().unwrap();
        half_done(folder.path(), "running");
        let now = SystemTime::now();
        let owner = Owner::this_process();
        let held = RunLock::take(folder.path(), &owner, false, now).unwrap();
        let status = Status::of(folder.path(), now).unwrap();
        let process = status.process.as_ref().expect("the lock is held");
        assert_eq!((process.pid, process.presence), (Some(std::process::id()), "alive"));
        assert_eq!((status.state.as_str(), status.eta), ("running", Some(utc(now + Duration::from_secs(12)))));
        // Another process of the same number that started at another time is not the one that took the lock.
        drop(held);
        let _gone = RunLock::take(folder.path(), &Owner { started: owner.started + 1, ..owner }, false, now).unwrap();
        assert_eq!(Status::of(folder.path(), now).unwrap().state, "killed");
    }
}

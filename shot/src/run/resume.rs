//! Whether a run starts, goes on or has nothing to do, from what its folder holds.

use std::path::{Path, PathBuf};

use drapery_core::simulation::{FrameInput, RestoreError};
use drapery_io::atomic_file;
use drapery_io::cache_frames::CacheFrames;
use drapery_io::checkpoint::CheckpointReader;
use drapery_io::error::IoError;

use crate::checkpoints::{Loaded, Store};
use crate::error::ShotError;
use crate::farm::digest::{self, Fingerprint};
use crate::farm::stale;
use crate::remote_simulation::RemoteSimulation;
use crate::run::folder::{Earlier, files_of_run};
use crate::run::kept_frames;
use crate::run::options::{Resume, RunOptions};
use crate::run::output::{planned_files, planned_outputs};
use crate::run_record::reader::Record;
use crate::run_record::{FINGERPRINT, MANIFEST};
use crate::shot::Shot;

/// Finds forbidden changes since the earlier run; allowed changes are reported with `note`.
pub(super) fn changes(
    earlier: &Earlier,
    folder: &Path,
    now: &Fingerprint,
    note: &mut dyn FnMut(String),
) -> Vec<String> {
    let Some(before) = &earlier.fingerprint else {
        if !earlier.has_begun(folder) {
            return Vec::new();
        }
        return vec!["the inputs of the earlier run are unknown: fingerprint.json is missing or damaged".to_owned()];
    };
    let found = digest::compare(before, now);
    for change in found.allowed {
        note(format!("changed since the run began, and accepted: {change}"));
    }
    found.forbidden
}

/// Why a run does not go on with what has changed.
pub(super) fn refusal(earlier: Option<&Earlier>, folder: &Path, changes: Vec<String>) -> ShotError {
    if earlier.is_some_and(|earlier| earlier.fingerprint.is_none()) {
        return ShotError::FingerprintLost { path: folder.join(FINGERPRINT) };
    }
    ShotError::Changed { folder: folder.to_owned(), changes }
}

/// Whether all frames that are asked for are there, in the form that is asked for, so that nothing needs to be touched. Caches are
/// asked for the last of them: a manifest may promise what is gone. Where an attempt was killed while it replaced the manifest, the
/// next one clears up.
pub(super) fn is_complete(shot: &Shot, options: &RunOptions, earlier: Option<&Earlier>, now: &Fingerprint) -> bool {
    let Some(earlier) = earlier.filter(|_| options.resume == Resume::Auto) else { return false };
    let holds_last = |file: &PathBuf| {
        let cache = CacheFrames::open(file).ok();
        cache.is_some_and(|cache| cache.meshes[0].frames.binary_search(&shot.about.last_frame).is_ok())
    };
    let has_form = || planned_files(shot, &options.out).iter().all(holds_last);
    let has_single = || shot.single_layer(&options.out).is_none_or(|path| path.is_file());
    let is_whole = || !atomic_file::unfinished(&options.out.join(MANIFEST)).exists();
    earlier.has_all(&options.out, shot.about.last_frame)
        && has_form()
        && has_single()
        && !earlier.has_other_form(now)
        && is_whole()
}

/// Refuses a folder that holds something that this run may neither go on with nor replace.
pub(super) fn refuse_others(shot: &Shot, options: &RunOptions, earlier: Option<&Earlier>) -> Result<(), ShotError> {
    let goes_on = earlier.is_some() && options.resume != Resume::Never;
    if options.overwrite || goes_on {
        return Ok(());
    }
    if let Some(path) = files_of_run(&options.out, &planned_outputs(shot, &options.out)).into_iter().next() {
        let is_run = earlier.is_some();
        return Err(if is_run { IoError::OutputExists { path } } else { IoError::FileExists { path } }.into());
    }
    match options.resume {
        Resume::Frame(_) => Err(ShotError::Resume(format!(
            "{}: this folder holds no run to resume\n  help: leave --resume out to start it",
            options.out.display()
        ))),
        Resume::Auto | Resume::Never => Ok(()),
    }
}

/// The checkpoint to go on from, if there is an earlier run with one, whose `record` is given; else the run starts at the first
/// frame.
///
/// It is the newest one behind which all frames are still what was written.
pub(super) fn decide(
    shot: &Shot,
    options: &RunOptions,
    (record, now): (Option<&Record>, &Fingerprint),
    store: &Store,
    note: &mut dyn FnMut(String),
) -> Result<Option<Loaded>, ShotError> {
    let Some(record) = record else { return Ok(None) };
    let at_most = match options.resume {
        Resume::Frame(frame) => frame,
        Resume::Auto | Resume::Never => shot.about.last_frame,
    };
    let mut search = store.newest_valid(Some(at_most))?;
    if let Some(found) = &search.found {
        let head = (&found.checkpoint.head, shot.about.first_frame);
        if let Some(fault) = kept_frames::earliest_fault(&options.out, head, record, note) {
            if let Resume::Frame(frame) = options.resume {
                return Err(ShotError::FrameChanged { fault, asked: frame });
            }
            note(format!("{fault}; the run resumes from the last checkpoint before this frame and simulates it again"));
            search = store.newest_valid(Some(fault.frame - 1))?;
        }
    }
    for refused in &search.refused {
        note(format!("a checkpoint is skipped, the one before is tried: {refused}"));
    }
    match (search.found, &options.resume) {
        (Some(found), Resume::Frame(frame)) if found.checkpoint.head.frame != *frame => {
            Err(no_checkpoint_at(*frame, store))
        }
        (Some(found), Resume::Frame(_)) if !options.with_changes => same_shot(found, now, &options.out).map(Some),
        (Some(found), _) => Ok(Some(found)),
        (None, Resume::Frame(frame)) => Err(no_checkpoint_at(*frame, store)),
        (None, _) => Ok(None),
    }
}

/// A checkpoint that was chosen by hand may be older than a change that the run went on with. Where it is of the run as it is in the
/// folder, that knows the values of the scene too.
fn same_shot(found: Loaded, now: &Fingerprint, folder: &Path) -> Result<Loaded, ShotError> {
    let digests = &found.checkpoint.head.digests;
    let run = Earlier::read(folder)?.and_then(|earlier| earlier.fingerprint);
    let of_run = run.filter(|run| run.digests == *digests);
    let then = of_run.unwrap_or_else(|| Fingerprint { digests: digests.clone(), ..Fingerprint::default() });
    let changes = digest::compare(&then, now).forbidden;
    if changes.is_empty() { Ok(found) } else { Err(ShotError::Changed { folder: folder.to_owned(), changes }) }
}

fn no_checkpoint_at(frame: i64, store: &Store) -> ShotError {
    let frames = store.list().unwrap_or_default().into_iter().filter(|entry| entry.sub_step == 0);
    let frames: Vec<String> = frames.map(|entry| entry.frame.to_string()).collect();
    let there =
        if frames.is_empty() { "there are none".to_owned() } else { format!("there are {}", frames.join(", ")) };
    ShotError::Resume(format!(
        "there is no valid checkpoint of frame {frame} to resume from: {there}\n  \
         help: give one of these frames, or keep checkpoints with --pin-checkpoint"
    ))
}

/// The simulation at a checkpoint; `input` is that of its frame.
pub(super) fn restored(
    remote_simulation: RemoteSimulation,
    input: FrameInput,
    (checkpoint, path): (&mut CheckpointReader, &Path),
) -> Result<RemoteSimulation, ShotError> {
    remote_simulation.restored(input, checkpoint).map_err(|error| match error {
        RestoreError::Problems(problems) => ShotError::Problems(problems),
        RestoreError::Snapshot(error) => ShotError::OtherState { path: path.to_owned(), what: error.to_string() },
    })
}

/// Sets aside what comes after the state that a run goes on from: copies of caches and record, and later checkpoints.
/// Returns whether there was anything.
///
/// At every moment in between, a run that is started again finds either all as it was or that it has to go back.
pub(super) fn set_aside_after(
    shot: &Shot,
    folder: &Path,
    earlier: &Earlier,
    found: Option<&Loaded>,
    (store, attempt): (&Store, u32),
) -> Result<bool, IoError> {
    let stale = stale::attempt(folder, attempt);
    let delivered = found.and_then(|found| found.checkpoint.head.delivered);
    let has_more = earlier.last_complete_frame() > delivered;
    if has_more {
        stale::set_aside(&files_of_run(folder, &planned_outputs(shot, folder)), &stale)?;
        earlier.withdraw(folder, delivered)?;
    }
    let (frame, sub_step) = match found {
        Some(found) => (found.checkpoint.head.frame, found.checkpoint.head.sub_step),
        None => (i64::MIN, 0),
    };
    let moved = store.set_aside_after(frame, sub_step, &stale)?;
    Ok(has_more || !moved.is_empty())
}

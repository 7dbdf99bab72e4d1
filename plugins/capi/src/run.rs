//! Whole shots, written to a folder as `drapery run` does.

use std::ffi::{c_char, c_void};

use drapery_core::simulation::FrameSummary;
use drapery_shot::run::{FrameReport, Outcome, RunOptions};
use drapery_shot::scene_source::SceneSource;

use crate::arguments::text;
use crate::errors::{drapery_error, guarded};
use crate::handles;
use crate::scene::drapery_scene;
use crate::simulation::{User, asks, drapery_cancel};
use crate::{DRAPERY_CANCELLED, DRAPERY_DONE};

/// Replaces a run that the folder holds, instead of resuming it.
pub const DRAPERY_RUN_OVERWRITE: u32 = 1;

/// A frame that is on the disk.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct drapery_frame_report {
    /// Number of the frame.
    pub frame: i64,
    /// Last frame of the run.
    pub last_frame: i64,
    /// Frames done so far, pre-roll and those of earlier attempts included.
    pub done: u64,
    /// Frames in all, pre-roll included.
    pub total: u64,
    /// Seconds it took, reading and writing included.
    pub seconds: f64,
    /// Time steps; 0 for the frame at which the simulation starts.
    pub steps: u64,
}

/// Called for every frame, on the thread that runs the shot; the report lives as long as the call. `user` is what came with it.
pub type drapery_progress = Option<unsafe extern "C" fn(report: *const drapery_frame_report, user: *mut c_void)>;

/// Runs a whole shot into a folder: caches, checkpoints and the record of the run, with the bytes that `drapery run` writes. A
/// run that the folder holds resumes after its last checkpoint, unless `flags` has DRAPERY_RUN_OVERWRITE. `progress` and `cancel`
/// may be null. Returns DRAPERY_CANCELLED, without an error, where it was cancelled: a checkpoint is written, and the next run
/// goes on from there.
///
/// Errors: the scene or its inputs are wrong; the folder holds another run, is in use or cannot be written; the solver gives up.
///
/// # Safety
/// `folder` ends with a zero; `progress` and `cancel` may be called with `user`; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_run(
    scene: *const drapery_scene,
    folder: *const c_char,
    flags: u32,
    progress: drapery_progress,
    cancel: drapery_cancel,
    user: *mut c_void,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let folder = unsafe { text(folder, "folder") }?;
        let source = handles::with(scene, |source: &mut SceneSource| Ok(source.clone()))?;
        let shot = source.prepare(None)?;
        let options = RunOptions {
            overwrite: flags & DRAPERY_RUN_OVERWRITE != 0,
            threads: rayon::current_num_threads(),
            ..RunOptions::new(folder.into())
        };
        // SAFETY: the caller promises it; the callback is dropped with `options`, before this returns.
        options.requests.ask_program(Box::new(unsafe { asks(cancel, User(user)) }));
        let mut report_frame = |report: &FrameReport<'_>| {
            let Some(progress) = progress else { return };
            let report = drapery_frame_report {
                frame: report.frame,
                last_frame: report.last_frame,
                done: report.done,
                total: report.total,
                seconds: report.seconds,
                steps: report.summary.map_or(0, |summary: &FrameSummary| summary.steps),
            };
            // SAFETY: the caller promises it.
            unsafe { progress(&report, user) }
        };
        let report = shot.run(&options, &mut report_frame)?;
        Ok(if matches!(report.outcome, Outcome::Stopped(_)) { DRAPERY_CANCELLED } else { DRAPERY_DONE })
    })
}

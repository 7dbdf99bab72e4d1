//! What will be done: the scene with its files opened, and the folder of the run.

use std::path::PathBuf;

use drapery_io::scene_file;
use drapery_io::shot::Shot;

use crate::args::{FrameRange, SceneArgs};
use crate::config::{Chosen, Surroundings};
use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// The shot that the arguments name, checked, and the threads it will use.
pub(crate) fn prepare(args: &SceneArgs, around: &Surroundings) -> Result<(Shot, Chosen<usize>), Failure> {
    let threads = around.threads(args.threads);
    start_pool(threads.value)?;
    let search = around.search(&args.materials).value;
    let description = scene_file::load_with(&args.scene, &args.settings, &search)?.resolve()?;
    let frames = args.frames.map(|FrameRange { first, last }| [first, last]);
    let shot = Shot::prepare(description, frames)?;
    for warning in shot.warnings() {
        tracing::warn!("{warning}");
    }
    Ok((shot, threads))
}

/// Makes the pool that all parallel work uses.
fn start_pool(threads: usize) -> Result<(), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    pool.map_err(|e| Failure::new(ExitCode::Internal, format!("{threads} threads could not be started: {e}")))
}

/// Where a run of this shot goes when nobody says.
pub(crate) fn default_folder(shot: &Shot) -> PathBuf {
    PathBuf::from("out").join(shot.name())
}

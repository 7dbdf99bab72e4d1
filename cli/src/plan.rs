//! What will be done: the scene with its files opened, and the folder of the run.

use std::path::PathBuf;

use drapery_core::parallel::ranks::Ranks;
use drapery_io::scene_file;
use drapery_io::shot::Shot;
use drapery_io::study::preset;

use crate::args::{FrameRange, SceneArgs};
use crate::config::{Chosen, Surroundings};
use crate::failure::Failure;
use crate::ranks;

/// Numbers of threads: of rank 0, and who said so; of every rank.
pub(crate) type Threads = (Chosen<usize>, Vec<usize>);

/// The shot that the arguments name, checked, on these ranks, and the threads it will use.
pub(crate) fn prepare(args: &SceneArgs, around: &Surroundings, ranks: &Ranks) -> Result<(Shot, Threads), Failure> {
    let threads = ranks::start_threads(ranks, around.threads(args.threads))?;
    let search = around.search(&args.materials).value;
    let mut settings = args.preset.as_deref().map(preset::read).transpose()?.unwrap_or_default();
    settings.extend(args.settings.iter().cloned());
    let description = scene_file::load_with(&args.scene, &settings, &search)?.resolve()?;
    let frames = args.frames.map(|FrameRange { first, last }| [first, last]);
    let shot = Shot::prepare_on(ranks, description, frames)?;
    for warning in shot.warnings() {
        tracing::warn!("{warning}");
    }
    Ok((shot, threads))
}

/// Where a run of this shot goes when nobody says.
pub(crate) fn default_folder(shot: &Shot) -> PathBuf {
    PathBuf::from("out").join(shot.name())
}

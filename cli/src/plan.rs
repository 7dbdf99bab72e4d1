//! Plan of a run: the scene with its files opened, and the folder of the run.

use std::path::{Path, PathBuf};

use drapery_analysis::study::preset;
use drapery_core::mesh::MeshStream;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::SolverPreset;
use drapery_io::scene_file;
use drapery_shot::Shot;
use drapery_shot::rules::Warning;
use serde_json::{Value, json};

use crate::args::{FrameRange, SceneArgs};
use crate::config::{Environment, Resolved};
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::patience;
use crate::ranks;

/// Numbers of threads: of rank 0, and who said so; of every rank.
pub(crate) type Threads = (Resolved<usize>, Vec<usize>);

/// The shot that the arguments name, checked, on these ranks, and the threads it will use.
pub(crate) fn prepare(args: &SceneArgs, around: &Environment, ranks: &Ranks) -> Result<(Shot, Threads), Failure> {
    let threads = ranks::start_threads(ranks, around.threads(args.threads))?;
    let shot = shot(args, around, ranks)?;
    for warning in shot.warnings() {
        tracing::warn!("{warning}");
    }
    Ok((shot, threads))
}

/// Warnings of a shot, for programs.
pub(crate) fn warnings_json(shot: &Shot) -> Value {
    let one = |Warning { rule, object, message, line }: &Warning| json!({"rule": rule, "object": object, "message": message, "line": line});
    shot.warnings().iter().map(one).collect()
}

/// The shot alone, where threads run already.
pub(crate) fn shot(args: &SceneArgs, around: &Environment, ranks: &Ranks) -> Result<Shot, Failure> {
    let search = around.search(&args.materials).value;
    patience::at(format!("{}: reading the scene and its meshes", args.scene.display()));
    let description = scene_file::load_with(&args.scene, &settings(args)?, &search)?.resolve_on(ranks.count())?;
    let points: usize = description.garments.iter().map(MeshStream::point_count).sum();
    let (scene, garments) = (args.scene.display(), description.garments.len());
    patience::at(format!("{scene}: building and checking {garments} garments with {points} points in total"));
    let frames = args.frames.map(|FrameRange { first, last }| [first, last]);
    Ok(Shot::prepare_on(ranks, description, frames)?)
}

/// Values of the scene that the arguments set: `--without` and `--only` are two of its keys.
pub(crate) fn settings(args: &SceneArgs) -> Result<Vec<(String, String)>, Failure> {
    let list = |names: &[String]| format!("{names:?}");
    let mut settings = args.preset.as_deref().map(of_preset).transpose()?.unwrap_or_default();
    settings.extend(args.settings.iter().cloned());
    for (key, other, names) in [("without", "only", &args.without), ("only", "without", &args.only)] {
        if !names.is_empty() {
            settings.push((format!("effects.{key}"), list(names)));
            settings.push((format!("effects.{other}"), list(&[])));
        }
    }
    Ok(settings)
}

/// The settings in the file of `--preset`. A word of `solver.preset` in its place is a mistake that is easily made.
fn of_preset(path: &Path) -> Result<Vec<(String, String)>, Failure> {
    if let Some(word) = path.to_str().filter(|word| SolverPreset::find(word).is_some() && !path.exists()) {
        let text = format!(
            "--preset {word}: this is a preset of the solver, but --preset takes a settings file from `drapery study \
             --write-preset`\n  help: write --set solver.preset={word}"
        );
        return Err(Failure::new(ExitCode::Usage, text));
    }
    Ok(preset::read(path)?)
}

/// Returns the default folder for a run of this shot.
pub(crate) fn default_folder(shot: &Shot) -> PathBuf {
    PathBuf::from("out").join(shot.name())
}

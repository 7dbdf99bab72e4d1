//! `drapery study`: what accuracy costs in time.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use drapery_analysis::study::record::{Asked, Study};
use drapery_analysis::study::schedule::Observer;
use drapery_analysis::study::space::RunRequest;
use drapery_analysis::study::{self, Options, analysis, preset, table};
use drapery_core::parallel::ranks::Ranks;
use drapery_io::atomic_file;
use drapery_io::error::IoError;
use drapery_io::input_file;
use drapery_shot::farm::command_line::quoted;
use drapery_shot::scene_source::SceneSource;

use crate::args::StudyArgs;
use crate::config::Environment;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::{ranks, say};

/// Makes a study or writes the pages of one again, prints the table, and writes the preset if one is asked for.
pub(crate) fn study(args: &StudyArgs, ranks: &Ranks, around: &Environment, quiet: bool) -> Result<ExitCode, Failure> {
    args.write_preset.as_deref().map_or(Ok(()), keep_what_is_no_preset)?;
    let (study, folder) = match (&args.from, &args.scene) {
        (Some(record), _) => {
            let folder = record.parent().unwrap_or(Path::new("")).to_owned();
            (Study::read(record)?, folder)
        }
        (None, Some(scene)) => simulate(args, scene, (ranks, around), quiet)?,
        (None, None) => return Err(Failure::new(ExitCode::Usage, "give a scene file, or --from study.json")),
    };
    let mut pages = study::write_pages(&folder)?;
    let analysis = analysis::analyse(&study);
    let budget = args.budget.map(|budget| budget.as_secs_f64()).or(study.budget);
    let preset = args.write_preset.as_ref().map(|path| (path, preset::text(&study, &analysis, budget)));
    if let Some((path, Some(text))) = &preset {
        atomic_file::replace(path, text.as_bytes())?;
        pages.push((*path).clone());
    }
    if !quiet {
        say::line(table::table(&study, &analysis, budget).trim_end());
        pages.iter().for_each(|page| say::line(format_args!("wrote {}", page.display())));
    }
    match preset {
        Some((path, None)) => {
            let why = table::recommendation(&study, &analysis, budget);
            let what = format!(
                "{}: no setting is recommended, so no preset was written\n  {why}\n  help: change --budget, or raise --max-wall",
                path.display()
            );
            Err(Failure::new(ExitCode::Usage, what))
        }
        _ => Ok(ExitCode::Done),
    }
}

/// Refuses to write a preset over something else, before anything takes long.
fn keep_what_is_no_preset(path: &Path) -> Result<(), Failure> {
    let is_other = |text: String| !text.trim().is_empty() && !text.contains(preset::KEY);
    match input_file::text(path).map(is_other) {
        Err(IoError::Missing { .. }) | Ok(false) => Ok(()),
        Ok(true) => {
            let what = "this file exists and is not a preset; it is not overwritten\n  help: give another name, or remove the file";
            Err(Failure::new(ExitCode::CannotCreate, format!("{}: {what}", path.display())))
        }
        Err(error) => Err(error.into()),
    }
}

fn simulate(
    args: &StudyArgs,
    scene: &Path,
    (ranks, around): (&Ranks, &Environment),
    quiet: bool,
) -> Result<(Study, PathBuf), Failure> {
    if !ranks.is_alone() {
        return Err(Failure::new(ExitCode::Usage, "a study measures one process\n  help: start it without mpirun"));
    }
    let (threads, _) = ranks::start_threads(ranks, around.threads(args.threads))?;
    let name = scene.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into_owned());
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from("out").join(format!("{name}_study")));
    let command: Vec<String> =
        args.words.iter().skip(1).filter(|word| *word != "--overwrite").map(|word| quoted(word)).collect();
    let mut source = SceneSource::file(scene);
    source.settings.clone_from(&args.settings);
    source.search = around.search(&args.materials).value;
    let options = Options {
        scene: source,
        out: out.clone(),
        asked: Asked {
            vary: args.vary.clone(),
            grid: args.grid,
            latin: args.latin.unwrap_or(0),
            frames: args.frames.map(|frames| [frames.first, frames.last]),
            copies: args.copies,
            repeats: args.repeats,
        },
        limit: args.max_wall,
        budget: args.budget.map(|budget| budget.as_secs_f64()),
        overwrite: args.overwrite,
        threads: threads.value,
        command: format!("drapery {}", command.join(" ")),
        cancelled: Arc::default(),
    };
    Ok((study::run(&options, &mut Watcher { quiet })?, out))
}

/// Says what goes on.
struct Watcher {
    quiet: bool,
}

impl Observer for Watcher {
    fn note(&mut self, text: &str) {
        tracing::warn!("{text}");
    }

    fn begins(&mut self, wish: &RunRequest, number: usize, all: usize, seconds: Option<f64>) {
        if !self.quiet {
            let about = seconds.map_or(String::new(), |seconds| format!(", about {seconds:.1} s"));
            say::line(format_args!("run {number} of {all}: {}{about}", wish.label()));
            say::warn_of_loss();
        }
    }
}

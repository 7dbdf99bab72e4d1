//! Cost of accuracy in time: a scene run with many settings, its errors against a finer run, and the cost of each
//! setting.
//!
//! [`run`] decides what to vary ([`space`]), runs it one after the other within a limit of time ([`schedule`], [`sample`]),
//! compares the states ([`compare`]) and writes `study.json` ([`record`]) after every run, so that a study may be stopped
//! and gone on with. Everything that people read is made from the record alone ([`write_pages`]): what follows from it
//! ([`analysis`]), the table, `study.csv` and `report.html`.

mod allowed;
pub mod analysis;
mod balance;
mod checks;
mod closed_form;
mod cloth;
mod compare;
mod csv;
mod distance;
pub mod error;
mod fit;
mod page;
pub mod preset;
mod random;
pub mod record;
mod sample;
pub mod schedule;
pub mod space;
mod states;
pub mod table;
pub mod vary;
mod verdict;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use drapery_core::scene::Integrator;
use drapery_io::atomic_file;
use drapery_io::cache::APPLICATION;
use drapery_io::error::IoError;
use drapery_io::shot_description::ShotDescription;
use drapery_shot::Shot;
use drapery_shot::farm::lock::RunLock;
use drapery_shot::farm::process::Owner;
use drapery_shot::scene_source::SceneSource;

use crate::study::error::StudyError;
use crate::study::record::{Asked, FORMAT, Machine, RECORD, Role, SceneFacts, Study};
use crate::study::sample::Bench;
use crate::study::schedule::Observer;
use crate::study::space::RunRequest;
use crate::study::vary::BaseSettings;

/// File name of the table of all runs and frames.
pub(crate) const CSV: &str = "study.csv";

/// Options of a study.
#[derive(Debug, Clone)]
pub struct Options {
    /// The scene, with what is set in it for all runs.
    pub scene: SceneSource,
    /// Folder of the study.
    pub out: PathBuf,
    /// Request to the study.
    pub asked: Asked,
    /// Time that this attempt may take.
    pub limit: Duration,
    /// Time that a frame may take with the recommended setting [s].
    pub budget: Option<f64>,
    /// Whether a study that the folder holds is replaced.
    pub overwrite: bool,
    /// Number of threads, for the record; the caller has set up the pool.
    pub threads: usize,
    /// The command line, for the record.
    pub command: String,
    /// Once it is set, the study ends as if its time were up.
    pub cancelled: Arc<AtomicBool>,
}

/// Makes a study, or goes on with the one that the folder holds, until it is complete or its time is up.
///
/// # Errors
/// The scene is wrong, the folder holds something else, a file cannot be read or written. Runs that fail are in the record.
pub fn run(options: &Options, observer: &mut dyn Observer) -> Result<Study, StudyError> {
    let begun = Instant::now();
    let load = Machine::load();
    std::fs::create_dir_all(&options.out).map_err(|error| IoError::creating(&options.out, error))?;
    let lock = RunLock::take(&options.out, &Owner::this_process(), false, SystemTime::now())?;
    let (mut study, ground, scene) = begin(options, load, observer)?;
    let before = study.seconds;
    let bench = Bench {
        scene: &scene,
        cancelled: &options.cancelled,
        size: study.scene.size,
        thickness: study.scene.thickness,
        threads: options.threads,
    };
    let wishes = space::wishes(&options.asked, &ground, space::FINENESS[0]);
    check(&bench, &wishes, !options.asked.vary.is_empty())?;
    let times = space::whole_times(&options.asked, &ground);
    let schedule =
        schedule::Schedule { bench: &bench, folder: &options.out, begun, limit: options.limit, before, times };
    schedule.run_base(&wishes, &mut study, observer)?;
    if !options.cancelled.load(Ordering::Relaxed) {
        let wishes = space::wishes(&options.asked, &ground, study.fineness);
        schedule.run_all(&wishes, &mut study, observer)?;
    }
    lock.check()?;
    study.seconds = before + begun.elapsed().as_secs_f64();
    study.write(&options.out)?;
    write_pages(&options.out)?;
    Ok(study)
}

/// Refuses what a scene does not take before anything runs; what somebody asked for is looked at more closely than what this
/// program came up with.
fn check(bench: &Bench<'_>, wishes: &[RunRequest], is_asked: bool) -> Result<(), StudyError> {
    for wish in wishes.iter().filter(|wish| wish.copy == 0 && wish.repeat == 0) {
        let file = sample::load(bench, wish)?;
        if is_asked && wish.role != Role::Base {
            file.resolve().map_err(StudyError::Scene)?;
        }
    }
    Ok(())
}

/// The record of the folder, or a new one, what the choice of runs depends on, and the scene of all runs.
fn begin(
    options: &Options,
    load: f64,
    observer: &mut dyn Observer,
) -> Result<(Study, BaseSettings, SceneSource), StudyError> {
    let bench = Bench {
        scene: &options.scene,
        cancelled: &options.cancelled,
        size: 0.0,
        thickness: 0.0,
        threads: options.threads,
    };
    let file = sample::load(&bench, &RunRequest::default())?;
    let description = file.resolve().map_err(StudyError::Scene)?;
    let (mut scene, ground) = facts(options, &description)?;
    let is_chosen = description.scene.solver.integrator == Integrator::Auto;
    let shot = Shot::prepare(description, options.asked.frames)?;
    let integrator = shot.simulation().scene().description().solver.integrator;
    let is_implicit = integrator.spec().is_implicit;
    let ground = BaseSettings { is_implicit, resolution: file.number(vary::RESOLUTION), ..ground };
    let mut source = options.scene.clone();
    if is_chosen {
        // A changed setting may not change the choice.
        source.settings.push((vary::key_of(vary::INTEGRATOR), integrator.word().to_owned()));
        scene.settings.clone_from(&source.settings);
    }
    shot.warnings().iter().for_each(|warning| observer.note(&warning.to_string()));
    scene.effects = shot.simulation().plan().iter().map(|effect| effect.name.to_owned()).collect();
    scene.effects.dedup();
    scene.triangles = shot.simulation().scene().meshes().iter().map(|mesh| mesh.triangles().len() as u64).sum();
    let simulation = shot.simulation();
    let closed_forms = closed_form::find(simulation.scene().description(), simulation, scene.size);
    let new = Study {
        format: FORMAT,
        application: APPLICATION.to_owned(),
        command: options.command.clone(),
        scene,
        machine: Machine { threads: options.threads, load, ..Machine::this() },
        closed_forms,
        outside: balance::outside(simulation.scene().description(), simulation),
        digests: shot.fingerprint()?.digests,
        asked: options.asked.clone(),
        budget: options.budget,
        limit: options.limit.as_secs_f64(),
        ..Study::default()
    };
    let path = options.out.join(RECORD);
    if options.overwrite || !path.exists() {
        return Ok((new, ground, source));
    }
    let mut old = Study::read(&path)?;
    let differs = |what: &str| Err(StudyError::Other { folder: options.out.clone(), what: what.to_owned() });
    if old.digests != new.digests {
        return differs("the scene, its inputs or the program have changed");
    }
    if old.asked != new.asked {
        return differs("different settings or frames were requested");
    }
    old.samples.retain(|sample| sample.states.is_empty() || options.out.join(&sample.states).exists());
    if old.machine.processor != new.machine.processor || old.machine.threads != new.machine.threads {
        return differs("its times were measured on a different machine, or with a different number of threads");
    }
    (old.budget, old.limit) = (options.budget, options.limit.as_secs_f64());
    Ok((old, ground, source))
}

/// Returns the facts of the scene for the record, and the settings on which the choice of runs depends, as far as its description says them.
fn facts(options: &Options, description: &ShotDescription) -> Result<(SceneFacts, BaseSettings), StudyError> {
    let scene = &description.scene;
    let mut points = Vec::new();
    for garment in &scene.garments {
        let start = garment.start.clone().map_or_else(|| garment.rest_positions(), Ok);
        points.extend(start.map_err(StudyError::Asked)?);
    }
    let mut bounds: Option<(drapery_core::Vec3, drapery_core::Vec3)> = None;
    for point in &points {
        bounds = Some(bounds.map_or((*point, *point), |(low, high)| (low.inf(point), high.sup(point))));
    }
    let mut effects: Vec<String> = scene.effects.iter().map(|request| request.effect.clone()).collect();
    effects.dedup();
    let facts = SceneFacts {
        path: options.scene.path().map_or_else(|| description.name.clone(), |path| path.display().to_string()),
        shot: description.name.clone(),
        settings: options.scene.settings.clone(),
        points: points.len() as u64,
        frames: description.frames,
        start: scene.timeline.start,
        frame_seconds: scene.timeline.frame_duration(),
        size: bounds.map_or(0.0, |(low, high)| (high - low).norm()),
        thickness: scene.garments.iter().map(|garment| garment.thickness).fold(f64::INFINITY, f64::min),
        ..SceneFacts::default()
    };
    let ground = BaseSettings {
        steps_per_frame: scene.solver.steps_per_frame,
        cfl: scene.solver.cfl,
        max_dt: scene.solver.max_dt,
        cg_tolerance: scene.solver.cg_tolerance,
        garments: scene.garments.iter().map(|garment| garment.name.clone()).collect(),
        thicknesses: scene.garments.iter().map(|garment| garment.thickness).collect(),
        bodies: scene.bodies.iter().map(|body| body.name.clone()).collect(),
        effects,
        left_out: scene.left_out.clone(),
        threads: options.threads,
        has_surfaces: description.bodies.iter().any(Option::is_some),
        ..BaseSettings::default()
    };
    Ok((facts, ground))
}

/// Writes everything that people read of the record in a folder: `study.csv` and `report.html`. Returns their paths.
///
/// # Errors
/// There is no record, or the disk refuses.
pub fn write_pages(folder: &Path) -> Result<Vec<PathBuf>, IoError> {
    let study = Study::read(&folder.join(RECORD))?;
    let pages = [(CSV, csv::csv(&study)), (page::PAGE, page::page(&study))];
    let write = |(name, text): &(&str, String)| {
        let path = folder.join(name);
        atomic_file::replace(&path, text.as_bytes()).map(|()| path)
    };
    pages.iter().map(write).collect()
}

impl Machine {
    /// This machine, as far as the system tells.
    pub fn this() -> Self {
        let line = |path: &str| std::fs::read_to_string(path).unwrap_or_default().trim().to_owned();
        let processor = line("/proc/cpuinfo");
        let named = processor.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
        Self {
            host: Owner::this_process().host,
            processor: named.map_or_else(String::new, |(_, name)| name.trim().to_owned()),
            processors: std::thread::available_parallelism().map_or(0, usize::from),
            threads: 0,
            governor: line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
            load: 0.0,
        }
    }

    /// Mean number of running processes over the last minute; zero where the system does not tell.
    pub fn load() -> f64 {
        let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
        text.split_whitespace().next().and_then(|word| word.parse().ok()).unwrap_or(0.0)
    }
}

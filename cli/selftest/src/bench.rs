//! Tools of a case: simulations that are watched, the command, a folder of its own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::effects::self_repulsion;
use drapery_core::parallel::communicator::Communicator;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{Described, Integrator, RepulsionPlace, Scene, SceneDescription, SolverSettings};
use drapery_core::settings::Settings;
use drapery_core::simulation::{FrameInput, FrameSummary, Simulation};
use drapery_core::snapshot::Snapshot;
use drapery_shot::quality::LIMITS;

use crate::tier::Tier;

/// Ranks and threads of each on which every scene has to come to the same bits; the first run is the one that is
/// measured.
const COUNTS: [[usize; 2]; 3] = [[1, 2], [4, 1], [7, 1]];

/// Energy below which rounding is all there is [J].
const SPECK: f64 = 1e-15;

/// Largest distance of two runs of one motion in short steps, which is rounding [m], or over the size of the scene.
const ROUNDING: f64 = 1e-9;

/// Share of what steps half as long change by which two runs of one motion in long steps may differ.
const SHARE_OF_STEP_ERROR: f64 = 0.05;

/// Frames after the start at which runs on several numbers of ranks are compared, unless a case says otherwise.
const COMPARED: i64 = 8;

/// Counts that say that something was not as it should be although they are no limits.
const NOTED: [&str; 12] = [
    "body_inside_out",
    "body_squeezed",
    "zones_carried",
    "zones_rigid",
    "crossings_reverted",
    "collision_steps_shortened",
    "retried_shorter",
    "retried_tighter",
    "retried_more_attempts",
    "retried_zones",
    "retried_thinner",
    "parts_reassigned",
];

/// Variables of the environment that could change what a command does.
pub const VARIABLES: [&str; 10] = [
    "DRAPERY_THREADS",
    "OMP_NUM_THREADS",
    "CUE_THREADS",
    "SLURM_CPUS_PER_TASK",
    "DRAPERY_LOG",
    "DRAPERY_PROGRESS",
    "DRAPERY_CONFIG",
    "DRAPERY_MATERIALS",
    "DRAPERY_STOP_AT",
    "SLURM_JOB_END_TIME",
];

/// Gives the bodies and tracks of a frame.
pub type Input<'a> = Box<dyn Fn(i64) -> FrameInput + Sync + 'a>;

/// A scene that is run and watched.
pub struct Trial<'a> {
    /// Scene to simulate.
    pub description: SceneDescription,
    /// Bodies and tracks of each frame.
    pub input: Input<'a>,
    /// Frames after the first one.
    pub frames: i64,
    /// Frames after the first one at which runs on several numbers of ranks are compared.
    pub compared: i64,
    /// Whether it starts with crossings, or a body forces some on it; otherwise none may appear.
    pub may_cross: bool,
    /// Whether nothing outside works on the cloth, so that its energy may not grow by more than 1 % a second.
    pub is_isolated: bool,
}

impl Trial<'_> {
    /// A scene without moving inputs.
    pub fn still(description: SceneDescription, frames: i64) -> Self {
        let compared = frames.min(COMPARED);
        let input = Box::new(FrameInput::to_frame);
        Self { description, input, frames, compared, may_cross: false, is_isolated: false }
    }
}

/// One frame of a run.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Summary of the frame by the solver.
    pub summary: FrameSummary,
    /// Positions of each garment in its own order [m].
    pub positions: Vec<Vec<Vec3>>,
    /// Velocities likewise [m/s].
    pub velocities: Vec<Vec<Vec3>>,
    /// Edges through triangles, where the scene asks for `self_collision`.
    pub crossings: usize,
}

/// A run.
#[derive(Debug, Clone)]
pub struct Record {
    /// Every frame; the first is the start.
    pub frames: Vec<Frame>,
    /// Masses of each garment's vertices in its own order [kg].
    pub masses: Vec<Vec<f64>>,
}

impl Record {
    /// The last frame.
    pub fn last(&self) -> &Frame {
        // A run has at least its start.
        &self.frames[self.frames.len() - 1]
    }

    /// A count of all frames.
    pub fn counted(&self, name: &str) -> f64 {
        self.frames.iter().map(|frame| frame.summary.metrics.counted(name)).sum::<u64>() as f64
    }

    /// Largest strain of an edge in any frame.
    pub fn strain(&self) -> f64 {
        let strain = |frame: &Frame| frame.summary.max_strain.as_ref().map_or(0.0, |s| s.strain);
        self.frames.iter().map(strain).fold(0.0, f64::max)
    }

    /// Largest kinetic energy in any frame [J].
    pub fn kinetic(&self) -> f64 {
        self.frames.iter().map(|frame| frame.summary.kinetic_energy).fold(0.0, f64::max)
    }
}

/// Outcome of a command.
#[derive(Debug, Clone)]
pub struct Ended {
    /// Its exit code; `None` if a signal ended it.
    pub code: Option<i32>,
    /// Text on its standard output.
    pub stdout: String,
    /// Complaints, as printed on its standard error.
    pub stderr: String,
}

impl Ended {
    /// The exit code as a figure; -1 if a signal ended it.
    pub fn code(&self) -> f64 {
        f64::from(self.code.unwrap_or(-1))
    }

    /// Returns the number of these texts that are in neither stream.
    pub fn missing(&self, parts: &[&str]) -> f64 {
        parts.iter().filter(|part| !self.stderr.contains(*part) && !self.stdout.contains(*part)).count() as f64
    }
}

/// Conditions under which all cases are run.
#[derive(Debug, Clone, Copy)]
pub struct Conditions<'a> {
    /// Amount of testing asked for.
    pub tier: Tier,
    /// Integrator of the scenes.
    pub integrator: Integrator,
    /// The command.
    pub drapery: &'a Path,
}

/// Tools of a case.
pub struct Bench<'a> {
    conditions: Conditions<'a>,
    folder: tempfile::TempDir,
    degradations: BTreeMap<String, u64>,
}

impl<'a> Bench<'a> {
    /// A bench with an empty folder.
    ///
    /// # Errors
    /// There is no room for a folder.
    pub fn new(conditions: Conditions<'a>) -> Result<Self, String> {
        let folder = tempfile::tempdir().map_err(|e| format!("no folder for temporary files: {e}"))?;
        Ok(Self { conditions, folder, degradations: BTreeMap::new() })
    }

    /// Returns the amount of testing asked for.
    pub fn tier(&self) -> Tier {
        self.conditions.tier
    }

    /// `quick` in the quick tier, `full` in the others.
    pub fn by_tier<T>(&self, quick: T, full: T) -> T {
        if self.tier() == Tier::Quick { quick } else { full }
    }

    /// `explicit` where elastic forces are explicit, `implicit` where they are part of the solves.
    pub fn by_integrator<T>(&self, explicit: T, implicit: T) -> T {
        if self.conditions.integrator.spec().is_implicit { implicit } else { explicit }
    }

    /// Returns the counts of events that should not have happened.
    pub fn into_degradations(self) -> Vec<(String, u64)> {
        self.degradations.into_iter().collect()
    }

    /// The case's own folder.
    pub fn folder(&self) -> PathBuf {
        self.folder.path().to_owned()
    }

    /// Writes a file into the case's folder.
    ///
    /// # Errors
    /// The disk is full.
    pub fn write(&self, name: &str, text: &str) -> Result<(), String> {
        std::fs::write(self.folder.path().join(name), text).map_err(|e| format!("{name} cannot be written: {e}"))
    }

    /// Runs the command in the case's folder and waits.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn command(&self, arguments: &[&str]) -> Result<Ended, String> {
        let mut command = Command::new(self.conditions.drapery);
        command.args(arguments);
        self.wait(command)
    }

    /// Runs a script of the shell in which `drapery` is the command.
    ///
    /// # Errors
    /// There is no shell.
    pub fn shell(&self, script: &str) -> Result<Ended, String> {
        let mut command = Command::new("sh");
        command
            .args(["-c", &format!("drapery() {{ \"$DRAPERY\" \"$@\"; }}\n{script}")])
            .env("DRAPERY", self.conditions.drapery);
        self.wait(command)
    }

    fn wait(&self, mut command: Command) -> Result<Ended, String> {
        command.current_dir(self.folder.path()).stdin(Stdio::null());
        for name in VARIABLES {
            command.env_remove(name);
        }
        let output =
            command.output().map_err(|e| format!("{} cannot be started: {e}", self.conditions.drapery.display()))?;
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        let ended = Ended { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) };
        if ended.code == Some(70) || ended.stderr.contains("panicked") {
            return Err(format!("the command has panicked\n{}", ended.stderr));
        }
        Ok(ended)
    }

    /// Runs a scene on one rank, and its beginning on several numbers of ranks and threads, and holds it to what is asked of
    /// every case.
    ///
    /// # Errors
    /// The scene is refused, the solver gives up or panics, a number is not finite, the bits differ, cloth crosses, or
    /// energy grows.
    pub fn simulate(&mut self, trial: &Trial<'_>) -> Result<Record, String> {
        let [first, others @ ..] = &COUNTS;
        let (record, snapshot) = self.run_on(trial, *first, trial.frames)?;
        self.note(&record);
        judge_all(trial, &record)?;
        for count in others {
            let (_, other) = self.run_on(trial, *count, 0)?;
            if other != snapshot {
                return Err(format!("{} ranks come to other bits than one", count[0]));
            }
        }
        Ok(record)
    }

    /// Runs a scene once, on one rank, for figures that compare runs of the same kind.
    ///
    /// # Errors
    /// As [`Bench::simulate`].
    pub fn simulate_once(&mut self, trial: &Trial<'_>) -> Result<Record, String> {
        let (record, _) = self.run_on(trial, COUNTS[0], trial.frames)?;
        self.note(&record);
        judge_all(trial, &record)?;
        Ok(record)
    }

    /// Largest distance of two runs that counts as one motion: rounding in short steps. Long steps solve to a tolerance, in an order that
    /// follows the numbers of a scene: a share of `apart`, the distance of the usual run from one of this scene with steps half as long.
    ///
    /// # Errors
    /// As [`Bench::simulate`].
    pub fn same_motion(
        &mut self,
        mut scene: SceneDescription,
        apart: impl FnOnce(&mut Self, SceneDescription) -> Result<f64, String>,
    ) -> Result<f64, String> {
        if self.by_integrator(true, false) {
            return Ok(ROUNDING);
        }
        scene.solver.steps_per_frame *= 2;
        Ok(SHARE_OF_STEP_ERROR * apart(self, scene)?)
    }

    /// One run: every frame up to `watched`, on one rank, and the state at the frame at which runs are compared.
    fn run_on(
        &self,
        trial: &Trial<'_>,
        [ranks, threads]: [usize; 2],
        watched: i64,
    ) -> Result<(Record, Snapshot), String> {
        let work = |communicator| one_rank(trial, self.conditions.integrator, communicator, watched);
        let all = LocalRanks::run(ranks, threads, work).map_err(|e| format!("on {ranks} ranks: panic: {e}"))?;
        // There is a first rank.
        all.into_iter().next().unwrap_or_else(|| Err("no rank has run".to_owned()))
    }

    fn note(&mut self, record: &Record) {
        for name in LIMITS.iter().map(|(name, _)| *name).chain(NOTED) {
            let count: u64 = record.frames.iter().map(|frame| frame.summary.metrics.counted(name)).sum();
            if count > 0 {
                *self.degradations.entry(name.to_owned()).or_default() += count;
            }
        }
    }
}

/// A scene with an integrator; keys that this one does not read, and would refuse, have their defaults.
fn with_integrator(scene: &SceneDescription, integrator: Integrator) -> SceneDescription {
    let mut description = scene.clone();
    description.solver.integrator = integrator;
    let mut written = description.solver.written();
    integrator.unused_keys().for_each(|unused| drop(written.remove(unused.key)));
    // Values out of range stay for the scene's own check.
    if let Ok(settings) = Settings::check(SolverSettings::FIELDS, &written) {
        description.solver = SolverSettings::of(&settings);
    }
    if integrator.spec().repulsion == RepulsionPlace::Solves {
        let repulsion = description.effects.iter_mut().filter(|request| request.effect == self_repulsion::SPEC.name);
        repulsion
            .for_each(|request| request.settings.retain(|key, _| !self_repulsion::OF_IMPULSES.contains(&key.as_str())));
    }
    description
}

fn one_rank(
    trial: &Trial<'_>,
    integrator: Integrator,
    communicator: Arc<dyn Communicator>,
    watched: i64,
) -> Result<(Record, Snapshot), String> {
    let ranks = Ranks::new(communicator);
    let first = || ranks.is_first();
    let start = trial.description.timeline.start;
    let description = || with_integrator(&trial.description, integrator);
    let scene = Scene::distribute(&ranks, first().then(description)).map_err(|e| format!("refused: {e}"))?;
    let input = |scene: &Scene, frame: i64| scene.share_input(first().then(|| (trial.input)(frame)));
    let at_start = input(&scene, start);
    let mut simulation = Simulation::new(scene, &at_start).map_err(|e| format!("refused: {e}"))?;
    let mut record = Record { frames: Vec::new(), masses: Vec::new() };
    if watched > 0 {
        record.masses = masses(&simulation);
        record.frames.push(see(&simulation, FrameSummary::empty(start)));
    }
    let compared = trial.compared;
    let mut snapshot = Snapshot::default();
    for frame in 1..=compared.max(watched) {
        let input = input(simulation.scene(), start + frame);
        let summary = simulation.advance(&input).map_err(|e| format!("gave up: {e}"))?;
        if frame <= watched {
            record.frames.push(see(&simulation, summary));
        }
        if frame == compared {
            snapshot = simulation.snapshot();
        }
    }
    Ok((record, snapshot))
}

/// Masses of each garment's vertices in its own order [kg]; of a simulation on one rank.
fn masses(simulation: &Simulation) -> Vec<Vec<f64>> {
    let parts = simulation.scene().parts();
    let of_garment = |garment: usize| {
        let own = parts.own_of_garment(garment);
        let mut all = vec![0.0; own.len()];
        for (number, vertex) in parts.own_numbers()[own.clone()].iter().zip(own) {
            all[*number as usize] = simulation.scene().masses()[vertex];
        }
        all
    };
    (0..simulation.scene().meshes().len()).map(of_garment).collect()
}

fn see(simulation: &Simulation, summary: FrameSummary) -> Frame {
    let (mut positions, mut velocities) = (Vec::new(), Vec::new());
    for garment in 0..simulation.scene().meshes().len() {
        let (mut x, mut v) = (Vec::new(), Vec::new());
        simulation.garment_positions(garment, &mut x);
        simulation.garment_velocities(garment, &mut v);
        positions.push(x);
        velocities.push(v);
    }
    Frame { summary, positions, velocities, crossings: simulation.crossings().len() }
}

/// Checks the requirements on every scene.
fn judge_all(trial: &Trial<'_>, record: &Record) -> Result<(), String> {
    let energy = |frame: &Frame| frame.summary.kinetic_energy + frame.summary.potential_energy;
    let seconds = trial.description.timeline.frame_duration();
    for (before, frame) in record.frames.iter().zip(&record.frames[1..]) {
        let number = frame.summary.frame;
        let all = frame.positions.iter().chain(&frame.velocities).flatten();
        if all.flat_map(|x| x.iter()).any(|c| !c.is_finite()) {
            return Err(format!("frame {number}: not finite"));
        }
        if !trial.may_cross && frame.crossings > 0 {
            return Err(format!("frame {number}: {} intersections", frame.crossings));
        }
        // The start has no energies of its own.
        let (was, is) = (energy(before), energy(frame));
        if trial.is_isolated && before.summary.steps > 0 && is > was + 0.01 * seconds * was.abs() + SPECK {
            return Err(format!("frame {number}: energy grows from {was:e} to {is:e} J"));
        }
    }
    Ok(())
}

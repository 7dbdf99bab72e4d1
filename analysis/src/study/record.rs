//! `study.json`: everything that a study has measured. Table, `study.csv` and `report.html` are made of it and of nothing
//! else, so that they can be made again.

use std::collections::BTreeMap;
use std::path::Path;

use drapery_io::atomic_file;
use drapery_io::error::IoError;
use drapery_io::input_file;
use serde::{Deserialize, Serialize};

/// File name of the record.
pub const RECORD: &str = "study.json";

/// Version of the record that this program writes and reads.
pub(crate) const FORMAT: u32 = 1;

/// A study: what it is about, what was measured, what was left out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Study {
    /// Version of the record.
    pub format: u32,
    /// Program and version.
    pub application: String,
    /// Command line.
    pub command: String,
    /// Facts of the simulated scene.
    pub scene: SceneFacts,
    /// Machine on which it was simulated.
    pub machine: Machine,
    /// Digests of the scene, its inputs and the solver: what a study has to agree in to be gone on with.
    pub digests: BTreeMap<String, String>,
    /// Variations of the study, as asked for.
    pub asked: Asked,
    /// Frames at which states are compared, ascending.
    pub compared: Vec<i64>,
    /// Smallest factor by which the reference is finer than the scene; 0 before it is decided.
    pub fineness: u32,
    /// Own error of the reference at the compared frames [m]; empty where it was not checked.
    pub own_error: Vec<f64>,
    /// Order with which the reference was extrapolated to steps of no length at the compared frames; 0 where it was not.
    pub extrapolated: Vec<u32>,
    /// Every finished run, in the order in which they ran.
    pub samples: Vec<Sample>,
    /// Runs that were planned and are not there.
    pub omitted: Vec<Omission>,
    /// Seconds of all attempts at the study.
    pub seconds: f64,
    /// Seconds that the latest attempt was allowed.
    pub limit: f64,
    /// Time that a frame may take with the recommended setting [s].
    pub budget: Option<f64>,
    /// Closed forms that the scene has.
    pub closed_forms: Vec<ClosedForm>,
    /// Actions on the cloth from outside.
    pub outside: Outside,
}

/// Actions on the cloth from outside.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Outside {
    /// Mass of the cloth [kg]; 0 in records that do not say.
    pub mass: f64,
    /// Acceleration by gravity [m/s²].
    pub gravity: [f64; 3],
    /// Effects that push it beside gravity.
    pub pushes: Vec<String>,
    /// Effects that may do work on it.
    pub works: Vec<String>,
}

/// Facts of the simulated scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SceneFacts {
    /// Scene file.
    pub path: String,
    /// Name of the shot.
    pub shot: String,
    /// `--set` arguments.
    pub settings: Vec<(String, String)>,
    /// Points of all garments.
    pub points: u64,
    /// Triangles of all garments.
    pub triangles: u64,
    /// First and last frame of the shot.
    pub frames: [i64; 2],
    /// Frame at which the simulation starts.
    pub start: i64,
    /// Length of a frame [s].
    pub frame_seconds: f64,
    /// Diagonal of the box around the cloth at the start [m].
    pub size: f64,
    /// Smallest thickness of a garment [m].
    pub thickness: f64,
    /// Effects in the order of execution.
    pub effects: Vec<String>,
}

/// Machine on which a study was made.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Machine {
    /// Its name.
    pub host: String,
    /// Model of its processor.
    pub processor: String,
    /// Processors that it has.
    pub processors: usize,
    /// Threads that the runs used.
    pub threads: usize,
    /// Governor of the processor's clock, where the system tells.
    pub governor: String,
    /// Mean number of running processes over the minute before the study.
    pub load: f64,
}

/// Request to the study: with another request it is another study.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Asked {
    /// `--vary`: name and values; the choice is the program's where empty.
    pub vary: Vec<(String, Vec<String>)>,
    /// All combinations instead of one change at a time.
    pub grid: bool,
    /// Number of combinations that hold every value equally often; 0 for none.
    pub latin: u32,
    /// First and last frame asked for; as many as the time allows when `None`.
    pub frames: Option<[i64; 2]>,
    /// Copies that tell the noise floor.
    pub copies: u32,
    /// Repeats of every run whose time matters, itself included.
    pub repeats: u32,
}

/// A point of the space that is studied: what is changed in the scene as it is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Setting {
    /// In words: `cfl 2, cg_tolerance 1e-4`; `as the scene` for no change.
    pub label: String,
    /// Changed names with their values, as shown to people.
    pub changes: Vec<(String, String)>,
    /// `--set` arguments that make it.
    pub settings: Vec<(String, String)>,
    /// Number of threads, of each rank; 0 for that of the study, which ranks share.
    pub threads: u32,
    /// Number of ranks; 0 and 1 for one alone.
    pub ranks: u32,
    /// Interval of the samples of deforming bodies [frames]; 0 and 1 take every sample.
    pub body_frames: u32,
}

/// Purpose of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The scene as it is.
    #[default]
    Base,
    /// Settings of accuracy: compared with the reference.
    Accuracy,
    /// Another mesh: compared with the reference by places of the rest shape.
    Mesh,
    /// Another model (thickness, stiffness): its difference from the base is the change in the picture.
    Model,
    /// Without one effect: likewise.
    Without,
    /// Another number of threads or ranks: it takes another time, and changes no bit.
    Threads,
    /// Reference against which errors are measured.
    Reference,
    /// Half as fine as the reference: how far that has converged.
    ReferenceCheck,
    /// A quarter as fine: whether it converges with an order at all.
    ReferenceCoarse,
}

/// One finished run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Sample {
    /// Place in the folder of the study where its states are kept while the study may go on.
    pub states: String,
    /// Purpose of the run.
    pub role: Role,
    /// Changes that it makes to the scene.
    pub setting: Setting,
    /// 0 for the run itself; others start from positions that were shifted by 1e-10 of the cloth's size.
    pub copy: u32,
    /// 0 for the first run of these settings; others only measure time again.
    pub repeat: u32,
    /// Why it broke off, if it did.
    pub failure: Option<Failure>,
    /// Cost of the run.
    pub cost: Cost,
    /// Seconds by stage, in the order of execution.
    pub stages: Vec<StageCost>,
    /// Counts of all frames.
    pub counts: BTreeMap<String, u64>,
    /// Figures of the cloth at the compared frames.
    pub figures: Vec<Figures>,
    /// Digest of positions and velocities at the compared frames: runs of one setting have to agree in it.
    pub bits: String,
    /// Distance from the reference at the compared frames; empty without one.
    pub from_reference: Vec<Distance>,
    /// Distance from the base.
    pub from_base: Vec<Distance>,
}

/// Why a run broke off.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Failure {
    /// Frame that it did not reach; `None` if it did not start.
    pub frame: Option<i64>,
    /// Message of the solver.
    pub what: String,
}

/// Cost of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Cost {
    /// Frames simulated.
    pub frames: u64,
    /// Seconds of reading inputs and simulating.
    pub seconds: f64,
    /// Processor seconds of the process meanwhile.
    pub processor_seconds: f64,
    /// Most memory that the process occupied meanwhile [bytes], where the system tells.
    pub peak_bytes: Option<u64>,
    /// Time steps.
    pub steps: u64,
    /// Shortest and longest step [s].
    pub dt: [f64; 2],
    /// Iterations of conjugate gradients.
    pub cg_iterations: u64,
    /// Seconds with everything around: checking, building, measuring.
    pub with_overhead: f64,
}

/// Seconds of a stage.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct StageCost {
    /// Its label.
    pub stage: String,
    /// Seconds spent in it.
    pub seconds: f64,
}

/// Figures of the cloth at a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Figures {
    /// Energy of motion [J].
    pub kinetic_energy: f64,
    /// Elastic energy and that of weight [J].
    pub potential_energy: f64,
    /// Centre of mass [m].
    pub centre: [f64; 3],
    /// Momentum [kg m/s].
    pub momentum: [f64; 3],
    /// Largest and 99th percentile of the relative extension of edges.
    pub strain: [f64; 2],
    /// Area of the cloth seen from above [m²].
    pub drape_area: f64,
    /// Length of folds sharper than 30, 60 and 90 degrees [m].
    pub folds: [f64; 3],
    /// Area of the cloth that lies on bodies, and on cloth [m²].
    pub contact_area: [f64; 2],
    /// Smallest distance of a vertex from a triangle of cloth that it is no corner of, if below twice the thickness [m].
    pub gap: Option<f64>,
    /// Depth of the deepest vertex in a body [m].
    pub depth: f64,
    /// Edges that pass through triangles of cloth or bodies; not looked for without self_collision.
    pub crossings: u64,
}

/// Distance of a run from another at a frame; areas are taken in the rest shape.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Distance {
    /// Root of the area-weighted mean of the squared distance of points [m].
    pub rms: f64,
    /// Distance that one vertex in a hundred exceeds [m].
    pub p99: f64,
    /// Largest distance [m].
    pub max: f64,
    /// As `rms`, of velocities [m/s].
    pub velocity_rms: f64,
    /// As `rms`, of the angles between normals of triangles [rad].
    pub normal_rms: f64,
    /// Largest distance from a vertex of either surface to the other [m]; where meshes differ.
    pub surface: Option<f64>,
}

/// A planned run that is not there.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Omission {
    /// Label of the omitted runs.
    pub label: String,
    /// Why.
    pub why: String,
    /// Seconds that all the runs meant would take, as far as is known.
    pub seconds: f64,
    /// Whether they would only have measured times again.
    pub are_repeats: bool,
}

/// A way of the centre of mass that is known without simulating.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ClosedForm {
    /// Name of the closed form.
    pub name: String,
    /// Centre of mass at the start [m].
    pub start: [f64; 3],
    /// Direction of the way.
    pub direction: [f64; 3],
    /// Speed in that direction at the start [m/s].
    pub speed: f64,
    /// Acceleration in that direction [m/s²]; below zero it ends when the cloth is at rest.
    pub acceleration: f64,
}

impl Sample {
    /// Seconds a frame.
    pub(crate) fn seconds_a_frame(&self) -> f64 {
        self.cost.seconds / self.cost.frames.max(1) as f64
    }

    /// Whether it is a run in its own right: neither a shifted copy nor a repeat for its time.
    pub fn is_own(&self) -> bool {
        self.copy == 0 && self.repeat == 0
    }

    /// Whether it came to the last frame.
    pub fn is_whole(&self) -> bool {
        self.failure.is_none()
    }
}

impl Study {
    /// Reads a record.
    ///
    /// # Errors
    /// The file cannot be read, is no record of a study, or one of a newer program.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        let text = input_file::text(path)?;
        Self::parse(path, &text)
    }

    /// The record of a text; `path` is for messages.
    ///
    /// # Errors
    /// As [`Study::read`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, IoError> {
        let advice = "give the study.json that `drapery study` wrote";
        let study: Self = serde_json::from_str(text)
            .map_err(|error| IoError::data(path, "the record of a study", error.to_string(), advice))?;
        if study.format != FORMAT {
            let what = format!("version {} is not supported; this program reads version {FORMAT}", study.format);
            return Err(IoError::data(path, "the record of a study", what, advice));
        }
        Ok(study)
    }

    /// As it stands in the file.
    pub fn text(&self) -> String {
        // A struct of texts and numbers always has a JSON form.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// Writes it into `folder`, as a whole.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write(&self, folder: &Path) -> Result<(), IoError> {
        atomic_file::replace(&folder.join(RECORD), self.text().as_bytes())
    }

    /// The scene as it is, when it has run.
    pub fn base(&self) -> Option<&Sample> {
        self.samples.iter().find(|sample| sample.role == Role::Base && sample.is_own())
    }

    /// Returns the run against which errors are measured: the reference, or where that is missing the run that was to
    /// check it.
    pub fn reference(&self) -> Option<&Sample> {
        self.of_role(Role::Reference).or_else(|| self.of_role(Role::ReferenceCheck))
    }

    /// The first run of a role that came to its end.
    pub(crate) fn of_role(&self, role: Role) -> Option<&Sample> {
        self.samples.iter().find(|sample| sample.role == role && sample.is_own() && sample.is_whole())
    }

    /// Time of a compared frame since the start of the simulation [s].
    pub fn time(&self, frame: i64) -> f64 {
        (frame - self.scene.start) as f64 * self.scene.frame_seconds
    }
}

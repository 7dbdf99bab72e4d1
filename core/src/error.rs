//! Failures: problems of a scene (all reported at once) and errors of a step.

use std::fmt;

/// One thing wrong with a scene: where, what, and what to do.
///
/// ```
/// use drapery_core::Problem;
/// let problem = Problem::scene("garment \"skirt\"", "its density is zero", "give it in kg/m²");
/// assert_eq!(problem.to_string(), "garment \"skirt\": its density is zero\n  help: give it in kg/m²");
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Object and element, for example `garment "skirt", face 12`.
    pub place: String,
    /// Fault, and why it matters.
    pub what: String,
    /// Advice: the thing to do.
    pub advice: String,
    /// Whether the scene's settings are at fault, or the data of an input file.
    pub kind: ProblemKind,
}

/// Kind of a problem; it decides the exit code of the command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProblemKind {
    /// The scene file says something impossible.
    Scene,
    /// A mesh or a motion cannot be simulated.
    Data,
}

impl Problem {
    /// A problem of the scene's own settings.
    pub fn scene(place: impl Into<String>, what: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { place: place.into(), what: what.into(), advice: advice.into(), kind: ProblemKind::Scene }
    }

    /// A problem of a mesh or a motion.
    pub fn data(place: impl Into<String>, what: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { place: place.into(), what: what.into(), advice: advice.into(), kind: ProblemKind::Data }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}\n  help: {}", self.place, self.what, self.advice)
    }
}

/// All problems of a scene; never empty.
///
/// ```
/// use drapery_core::{EffectRequest, Problems, Scene, SceneDescription};
/// let mut description = SceneDescription::new("misspelt");
/// description.effects.push(EffectRequest::of_scene("gravty"));
/// let problems: Problems = Scene::validate(description).expect_err("no effect has this name");
/// assert!(problems.to_string().contains("gravity"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problems(pub Vec<Problem>);

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let texts: Vec<_> = self.0.iter().map(Problem::to_string).collect();
        f.write_str(&texts.join("\n"))
    }
}

impl std::error::Error for Problems {}

/// Reason for a short step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShortStep {
    /// Edges change their lengths fast.
    StrainRate,
    /// Springs are stiff for the masses at their ends.
    Stiffness,
}

impl ShortStep {
    fn remedy(self) -> &'static str {
        match self {
            Self::StrainRate => {
                "the cloth is stretched faster than it can follow; check the bodies and pins in this frame"
            }
            Self::Stiffness => {
                "edges are too short and light for their stiffness: check the unit of length of the garments \
                 ([units]), merge points that almost coincide, or lower the stiffness"
            }
        }
    }
}

impl fmt::Display for ShortStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::StrainRate => "the rate of strain",
            Self::Stiffness => "the stiffness of the springs",
        })
    }
}

/// Error of a change of numbers between frames.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::error::ChangeError;
/// use drapery_core::{FrameInput, Scene, SettingValue, Simulation};
/// let scene = Scene::validate(description).expect("a valid scene");
/// let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a valid start");
/// let changed = simulation.set(&[("wind.density".to_owned(), SettingValue::Number(1.2))]);
/// assert!(matches!(changed, Err(ChangeError::Refused(_))), "the scene has no wind");
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChangeError {
    /// The change is refused; the simulation is as it was.
    #[error("{0}")]
    Refused(Problem),
    /// The solver could not be built again: the simulation may not be used any more.
    #[error("{0}")]
    Broken(Problem),
}

/// Error of a step: where and when it happened, and what to do.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::{FrameInput, Scene, Simulation, StepError};
/// let scene = Scene::validate(description).expect("a valid scene");
/// let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a valid start");
/// let skipped = simulation.advance(&FrameInput::to_frame(2));
/// assert!(matches!(skipped, Err(StepError::Input { frame: 2, .. })));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A position or velocity became infinite or not a number.
    #[error(
        "garment \"{garment}\", vertex {vertex}: not a finite number at {stage}, frame {frame}, time {time:.6} s (last \
         step {dt:.2e} s)\n  help: take shorter steps with a smaller solver.max_dt, or raise the damping of this \
         garment"
    )]
    NotFinite {
        /// Name of the garment.
        garment: String,
        /// Vertex in the garment's own order.
        vertex: usize,
        /// Frame being computed.
        frame: i64,
        /// Solver time [s].
        time: f64,
        /// Stage of the step.
        stage: &'static str,
        /// Length of the step [s].
        dt: f64,
    },
    /// The step that stability asks for is shorter than the scene allows.
    #[error(
        "frame {frame}, time {time:.6} s: the time step fell to {dt:.2e} s, below solver.min_dt = {min_dt:e} s, because of \
         {because}\n  help: {}",
        because.remedy()
    )]
    StepTooSmall {
        /// Frame being computed.
        frame: i64,
        /// Solver time [s].
        time: f64,
        /// Step that was asked for [s].
        dt: f64,
        /// Smallest step allowed [s].
        min_dt: f64,
        /// Cause of it.
        because: ShortStep,
    },
    /// A frame takes far more steps than the cloth asks for.
    #[error(
        "frame {frame}, time {time:.6} s: the frame is not complete after {steps} steps; {planned:.0} were planned for \
         all of it\n  \
         help: something in this frame moves faster than cloth can follow; check its bodies and pins (`drapery check` \
         names jumps), and solver.strain_per_step if the scene sets it"
    )]
    TooManySteps {
        /// Frame being computed.
        frame: i64,
        /// Solver time that is reached [s].
        time: f64,
        /// Collision-free states since the frame began.
        steps: u64,
        /// Steps that the elastic forces and the scene ask for in a frame.
        planned: f64,
    },
    /// The caller's samples do not cover the frame or do not fit the scene.
    #[error("frame {frame}: {what}")]
    Input {
        /// Frame asked for.
        frame: i64,
        /// Fault of the input.
        what: String,
    },
    /// A change between frames could neither be made nor undone: the simulation may not be used any more.
    #[error(
        "frame {frame}: the solver could not be built again: {what}\n  help: resume from the last checkpoint, and report this"
    )]
    Broken {
        /// Frame asked for.
        frame: i64,
        /// Failure of the change.
        what: String,
    },
}

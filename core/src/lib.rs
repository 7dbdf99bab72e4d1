//! Drapery's cloth solver: numbers in, numbers out.
//!
//! The method is that of Selle, Su, Irving and Fedkiw (IEEE TVCG 15(2), 2009): a mass-spring cloth advanced by a
//! semi-implicit step (elastic forces explicit, damping implicit) with geometric body contact and accurate friction.
//! Everything is `f64` and SI. The crate does no input or output: a caller describes a scene with plain data
//! ([`SceneDescription`]), has it checked ([`Scene::validate`]) and advances it frame by frame ([`Simulation::advance`]).
//!
//! ```
//! use drapery_core::{EffectRequest, FrameInput, GarmentDescription, PolygonMesh, Scene, SceneDescription, Simulation};
//!
//! // One square of cloth with 0.2 kg/m², falling freely.
//! let mesh = PolygonMesh::from_triangles(
//!     vec![[0.0, 0.0, 0.0].into(), [1.0, 0.0, 0.0].into(), [0.0, 0.0, 1.0].into(), [1.0, 0.0, 1.0].into()],
//!     &[[0, 2, 1], [1, 2, 3]],
//! );
//! let mut description = SceneDescription::new("falling square");
//! description.garments.push(GarmentDescription::new("sheet", mesh, 0.2));
//! description.effects.push(EffectRequest::of_scene("gravity").with_vector("acceleration", [0.0, -9.81, 0.0]));
//! let scene = Scene::validate(description).expect("a valid scene");
//! let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("effects can be built");
//! let summary = simulation.advance(&FrameInput::to_frame(1)).expect("a step of free fall");
//! assert!(summary.steps >= 1);
//! let mut positions = Vec::new();
//! simulation.garment_positions(0, &mut positions);
//! assert!((positions[0].y + 0.5 * 9.81 / (24.0 * 24.0)).abs() < 1e-12, "½ g t²");
//! ```
//!
//! # The facade
//!
//! The names at the root of the crate are its public interface. Each has an example.
//!
//! ## Describe a scene
//!
//! [`SceneDescription`] holds a [`Timeline`], garments ([`GarmentDescription`], [`PolygonMesh`], [`Vec3`], [`Mass`],
//! [`PaintedMap`]), bodies ([`BodyDescription`], [`BodyShape`], [`Shape`], [`RigidMotion`]), pins ([`PinDescription`],
//! [`PinTarget`], [`PinAnchor`], [`PinHold`]), seams ([`SeamDescription`]), rules of contact by pair ([`ContactRule`],
//! [`ContactSide`]), the grid of a wind ([`WindGridShape`]) and settings of
//! the time integration ([`SolverSettings`], [`Integrator`], [`SolverPreset`]). An [`EffectRequest`] asks for an effect, with a
//! [`SettingValue`] for each setting; [`REGISTRY`] is the table of effects, an [`EffectSpec`] each.
//!
//! ## Run it
//!
//! [`Scene`] is the checked form. [`Simulation`] advances it by a [`FrameInput`], with a [`Sample`] or [`WindSample`] for each time
//! at which something moves. [`Advance`] says whether the frame is reached.
//!
//! ## Look at results
//!
//! [`Simulation::garment_positions`] gives positions in the garment's own order. [`FrameSummary`] has strains, energies and
//! [`Metrics`]. [`self_intersections`] finds each [`Crossing`] of a mesh with itself.
//!
//! ## Save and continue
//!
//! [`Simulation::snapshot`] gives a [`Snapshot`]; [`Simulation::restore`] continues from it with the same bits, or returns a
//! [`RestoreError`]. [`solver_version`] says which program's results they are.
//!
//! ## Ranks and threads
//!
//! The solver works in the pool of threads that calls it. [`Ranks`] share one scene over a [`Communicator`]; [`LocalRanks`] are
//! threads of one process.
//!
//! ## Errors
//!
//! [`Problems`] are all that is wrong with a scene, a [`Problem`] each. [`StepError`] ends an advance.

// Describe a scene.
#[doc(inline)]
pub use crate::{
    effects::{EffectSpec, REGISTRY},
    geometry::shapes::Shape,
    mesh::PolygonMesh,
    scene::vertex_maps::PaintedMap,
    scene::{
        BodyDescription, BodyShape, ContactRule, ContactSide, EffectRequest, GarmentDescription, Integrator, Mass,
        PinAnchor, PinDescription, PinHold, PinTarget, RigidMotion, SceneDescription, SeamDescription, SolverPreset,
        SolverSettings, Timeline, WindGridShape,
    },
    settings::SettingValue,
};

// Run it.
#[doc(inline)]
pub use crate::{
    scene::Scene,
    simulation::{Advance, FrameInput, Sample, Simulation},
    wind_grid::WindSample,
};

// Look at results.
#[doc(inline)]
pub use crate::{
    geometry::crossings::{Crossing, self_intersections},
    metrics::Metrics,
    simulation::FrameSummary,
};

// Save and continue.
#[doc(inline)]
pub use crate::{simulation::RestoreError, snapshot::Snapshot};

// Ranks and threads.
#[doc(inline)]
pub use crate::parallel::{communicator::Communicator, local_ranks::LocalRanks, ranks::Ranks};

// Errors.
#[doc(inline)]
pub use crate::error::{Problem, Problems, StepError};

// The facade above is the public interface. Rooms are for Drapery's own crates and change without notice. They stand in the order
// in which to read them; docs/dev/architecture.md says which may import which.

// What is simulated: plain data, and how it becomes a checked scene on its ranks.
#[doc(hidden)]
pub mod scene;
#[doc(hidden)]
pub mod setup;

// One time step, line by line as in the paper, and the loop around it.
#[doc(hidden)]
pub mod simulation;
pub(crate) mod step;

// What a step calls.
pub(crate) mod time_step;

#[doc(hidden)]
pub mod solve;

#[doc(hidden)]
pub mod effects;
#[doc(hidden)]
pub mod pins;

#[doc(hidden)]
pub mod contact;

// What it works on.
#[doc(hidden)]
pub mod state;

#[doc(hidden)]
pub mod block_matrix;
pub(crate) mod elements;
#[doc(hidden)]
pub mod volumes;
#[doc(hidden)]
pub mod wind_grid;

#[doc(hidden)]
pub mod snapshot;

#[doc(hidden)]
pub mod observe;

// What all stands on.
#[doc(hidden)]
pub mod parallel;

#[doc(hidden)]
pub mod geometry;
#[doc(hidden)]
pub mod mesh;

#[doc(hidden)]
pub mod metrics;
#[doc(hidden)]
pub mod settings;

#[doc(hidden)]
pub mod clock;
#[doc(hidden)]
pub mod error;
pub(crate) mod long_steps;
#[doc(hidden)]
pub mod tolerances;

#[cfg(test)]
pub(crate) mod testing;

/// A point, displacement, velocity or force; the unit is said where it is used.
///
/// ```
/// use drapery_core::Vec3;
/// let (across, along) = (Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 3.0));
/// assert_eq!(along.cross(&across), 6.0 * Vec3::y());
/// ```
pub type Vec3 = nalgebra::Vector3<f64>;

/// Raised with every change of the program that changes results, by however little. A run that another version began is
/// not continued unasked: its frames would not be those of one program.
#[doc(hidden)]
pub const SOLVER_VERSION: u32 = 12;

/// Version of the results of scenes with this integrator; [`Auto`](scene::Integrator::Auto) stands for a simulation that may change from one
/// to another.
///
/// ```
/// use drapery_core::{Integrator, solver_version};
/// assert!(Integrator::ALL.iter().all(|integrator| solver_version(*integrator) >= solver_version(Integrator::SemiImplicit)));
/// ```
pub fn solver_version(integrator: scene::Integrator) -> u32 {
    SOLVER_VERSION
        + match integrator {
            scene::Integrator::Auto => {
                let of_both: u32 = scene::Integrator::ALL.iter().map(|one| one.spec().version).sum();
                of_both + simulation::CHOICE_VERSION
            }
            one => one.spec().version,
        }
}

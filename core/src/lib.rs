//! Drapery's cloth solver: numbers in, numbers out.
//!
//! The method is that of Selle, Su, Irving and Fedkiw (IEEE TVCG 15(2), 2009): a mass-spring cloth advanced by a
//! semi-implicit step (elastic forces explicit, damping implicit) with geometric body contact and accurate friction.
//! Everything is `f64` and SI. The crate does no input or output: a caller describes a scene with plain data
//! ([`scene::SceneDescription`]), has it checked ([`scene::Scene::validate`]) and advances it frame by frame.
//!
//! ```
//! use drapery_core::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};
//! use drapery_core::mesh::PolygonMesh;
//! use drapery_core::simulation::{FrameInput, Simulation};
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
//! ```
//!
//! The modules stand in the order in which to read them: what is simulated, the two listings, what they call, and what all that
//! stands on. What may import what is in `docs/dev/architecture.md`.

// What is simulated: plain data, and how it becomes a checked scene on its ranks.
pub mod scene;
pub mod setup;

// One time step, line by line as in the paper, and the loop around it.
pub(crate) mod step;

pub mod simulation;

// What a step calls.
pub(crate) mod time_step;

pub mod solve;

pub mod effects;
pub mod pins;

pub mod contact;

// What it works on.
pub mod state;

pub mod block_matrix;
pub(crate) mod elements;
pub mod volumes;
pub mod wind_grid;

pub mod snapshot;

pub mod observe;

// What all stands on.
pub mod parallel;

pub mod geometry;
pub mod mesh;

pub mod metrics;
pub mod settings;

pub mod clock;
pub mod error;
pub(crate) mod long_steps;
pub mod tolerances;

#[cfg(test)]
pub(crate) mod testing;

/// A point, displacement, velocity or force; the unit is said where it is used.
pub type Vec3 = nalgebra::Vector3<f64>;

/// Raised with every change of the program that changes results, by however little. A run that another version began is
/// not continued unasked: its frames would not be those of one program.
pub const SOLVER_VERSION: u32 = 6;

/// Version of the results of scenes with this integrator.
pub fn solver_version(integrator: scene::Integrator) -> u32 {
    SOLVER_VERSION + integrator.spec().version
}

//! Effects: everything that can act on cloth. An effect exists only when the scene asks for it.
//!
//! Each effect is one file or folder that holds its manual page, its [`EffectSpec`], what it builds, and its tests. To add
//! one, write it and list it in [`registry`]; the order there is the order of execution.

pub mod force;
pub mod inputs;
pub mod registry;
pub mod spec;
pub(crate) mod stability;

pub mod attachments;
pub mod bending;
pub mod body_collision;
pub mod cost;
pub mod dihedral_bending;
pub mod ether_drag;
pub mod gravity;
pub mod membrane;
pub mod pins;
pub mod plastic_wrinkles;
pub mod pressure;
pub mod seams;
pub mod self_collision;
pub mod self_repulsion;
pub mod shear;
pub mod springs;
pub mod strain_limit;
pub mod stretch;
pub mod wind;

pub use crate::snapshot::saved_section::{ElementRows, SectionId};
pub use force::{FilterStep, Force, ForceContext, PartForce, PartMotion, PartView, Purpose, VelocityFilter};
pub use inputs::INPUTS;
pub use registry::{LISTED, PlannedEffect, REGISTRY, build_all, find, lacking, maps};
pub use spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Scope};

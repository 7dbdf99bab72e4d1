//! Effects: everything that can act on cloth. An effect exists only when the scene asks for it.
//!
//! Each effect is one file or folder that holds its manual page, its [`EffectSpec`], what it builds, and its tests. To add
//! one, write it, list it below (twice: the second list is in the order of execution) and have `docs/reference/effects.md` written.

pub(crate) mod force;
pub(crate) mod inputs;
pub(crate) mod registry;
pub(crate) mod spec;
pub(crate) mod stability;
pub mod tensile_curve;

pub(crate) mod attachments;
pub(crate) mod bending;
pub mod body_collision;
pub mod cost;
pub(crate) mod dihedral_bending;
pub(crate) mod elastic_bands;
pub(crate) mod ether_drag;
pub mod gravity;
pub(crate) mod membrane;
pub(crate) mod pins;
pub(crate) mod plastic_wrinkles;
pub(crate) mod pressure;
pub(crate) mod seams;
pub mod self_collision;
pub mod self_repulsion;
pub(crate) mod shear;
pub(crate) mod springs;
pub(crate) mod strain_limit;
pub(crate) mod stretch;
pub(crate) mod wind;

pub use force::{
    BlockFactors, Breakable, BrokenElement, Force, ForceContext, Linearised, PartForce, PartMotion, PartView, Plastic,
    Strained,
};
pub use inputs::INPUTS;
pub use registry::{PlannedEffect, build_all, find, lacking, maps};
pub use spec::{Effect, EffectSpec, MapSpec, Need, Scope};

// The method itself is in every build: gravity and springs along edges, prescribed vertices, and contact. All others are in
// builds with the feature `effects`, which the modules repeat as their own condition.
registry::effects! {
    gravity,
    stretch,
    shear if "effects",
    membrane if "effects",
    bending if "effects",
    dihedral_bending if "effects",
    plastic_wrinkles if "effects",
    elastic_bands if "effects",
    wind if "effects",
    ether_drag if "effects",
    pressure if "effects",
    seams if "effects",
    attachments if "effects",
    pins,
    strain_limit if "effects",
    body_collision,
    self_repulsion,
    self_collision,
}

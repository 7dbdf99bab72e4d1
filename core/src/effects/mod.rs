//! Effects: everything that can act on cloth. An effect exists only when the scene asks for it.
//!
//! Each effect is one file or folder that holds its manual page, its [`EffectSpec`], what it builds, and its tests. To add
//! one, write it, list it below (twice: the second list is in the order of execution) and have `docs/reference/effects.md` written.

pub mod force;
pub mod inputs;
pub mod registry;
pub mod spec;
pub(crate) mod stability;
pub mod tensile_curve;

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

pub use crate::snapshot::elements::ElementRows;
pub use crate::snapshot::saved_section::SectionId;
pub use force::{
    BlockFactors, FilterStep, Force, ForceContext, Linearised, PartForce, PartMotion, PartView, Plastic, Purpose,
    Strained, VelocityFilter,
};
pub use inputs::INPUTS;
pub use registry::{PlannedEffect, build_all, find, lacking, maps};
pub use spec::{BuildContext, Effect, EffectSpec, MapSpec, Need, Scope};

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

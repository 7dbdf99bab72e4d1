//! From a description to a scene on its ranks: every problem is reported (`validate`), what cannot be simulated is left out
//! (`mesh_checks`), and each rank gets its pieces (`distribute`).

pub(crate) mod distribute;
mod effect_choice;
pub(crate) mod mesh_checks;
mod shape_meshes;
pub(crate) mod validate;

pub use mesh_checks::degenerate::simulated_triangles;

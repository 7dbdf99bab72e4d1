//! USD: what Drapery writes and reads of it, with the crate `openusd` behind it.
//!
//! Nothing of `openusd` shows in what this crate offers: its interface is young and changes with every release
//! (`docs/decisions/0018-usd.md`).

mod interpolation;
mod material;

pub mod cache;
pub mod read;
pub mod write;

pub use interpolation::Interpolation;
pub use material::BoundMaterial;

/// Of a render mesh: the garment that it follows.
pub(crate) const RENDER_MESH_OF: &str = "drapery:renderMeshOf";

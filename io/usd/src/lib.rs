//! USD: what Drapery writes and reads of it, with the crate `openusd` behind it.
//!
//! Nothing of `openusd` shows in what this crate offers: its interface is young and changes with every release
//! (`docs/dev/decisions/0018-usd.md`).
//!
//! ```
//! let file = std::env::temp_dir().join("drapery_usd_triangle.usda");
//! let text = r##"#usda 1.0
//! ( metersPerUnit = 1
//!   upAxis = "Y" )
//! def Mesh "triangle" {
//!   point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
//!   int[] faceVertexCounts = [3]
//!   int[] faceVertexIndices = [0, 1, 2]
//! }
//! "##;
//! std::fs::write(&file, text).expect("the folder for passing files can be written");
//! let stage = drapery_usd::read::Stage::open(&file).unwrap_or_else(|e| panic!("{e}"));
//! assert_eq!(stage.about().metres_per_unit, Some(1.0));
//! assert_eq!(stage.about().meshes.len(), 1);
//! ```

mod interpolation;
mod material;

pub mod cache;
pub mod read;
pub mod write;

pub use interpolation::Interpolation;
pub use material::BoundMaterial;

/// Attribute of a render mesh: the garment that it follows.
pub(crate) const RENDER_MESH_OF: &str = "drapery:renderMeshOf";

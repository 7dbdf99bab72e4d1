//! Caches: binary value clips, one a frame, and the text layers that tie them together.
//!
//! A garment is three kinds of layer. [`topology`] makes the one with everything that does not move, [`clip`] one with a
//! frame, [`cache_layer`] the small text that an artist opens: the topology as a sublayer, and a clip set over the mesh that
//! names each clip with its time code. [`clip_manifest`] lists what clips hold, so that nobody has to open them all to find
//! out. [`shot_layer`] references the garments of a shot.
//!
//! [`SingleLayer`] is the other form: everything in one binary layer, written when it is whole.
//!
//! Every function gives the bytes of a file; equal input gives equal bytes.

mod binary;
mod mesh;
mod names;
mod primvars;
mod single;
mod subsets;
mod text;

pub use binary::WriteError;
pub(crate) use mesh::NORMAL_INDICES;
pub(crate) use mesh::primvar_of;
pub use mesh::{Members, Moving, StillMesh, Subdivision, clip, topology};
pub use names::{Distinct, MeshPath, identifier};
pub use primvars::{Primvar, Values};
pub use single::{About, PartOfShot, SingleLayer};
pub use subsets::FaceSubset;
pub use text::{CacheLayer, GarmentReference, ShotLayer, cache_layer, clip_manifest, shot_layer};

/// Meaning of the numbers of a layer, which every layer states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// Length of one unit [m].
    pub metres_per_unit: f64,
    /// Whether Z is up; Y otherwise.
    pub z_up: bool,
    /// Time codes a second: one a frame.
    pub time_codes_per_second: f64,
}

impl Units {
    /// The up axis as USD spells it.
    fn up_axis(self) -> &'static str {
        if self.z_up { "Z" } else { "Y" }
    }
}

//! Reading archives: the object tree ([`Archive`]), its properties, and one reader per schema.

mod archive;
mod geom_param;
mod object;
mod open_file;
mod poly_mesh;
mod properties;
pub(crate) mod tables;
mod xform;

pub use archive::Archive;
pub use geom_param::GeomParam;
pub use object::{Object, Schema};
pub use poly_mesh::{FaceSet, Faces, PolyMesh, TopologyVariance};
pub use properties::{Compound, Property, PropertyKind, Samples};
pub use xform::{Xform, world_matrix_at};

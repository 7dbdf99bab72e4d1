//! Writing archives: a streaming core ([`ArchiveWriter`]) and one small writer per schema.

mod append;
mod archive;
mod commit;
mod face_set;
mod geom_param;
mod mark;
mod poly_mesh;
mod resume;
mod samples;
mod tree;
mod xform;

pub use archive::{ArchiveOptions, ArchiveWriter, Durability};
pub use face_set::write_face_set;
pub use geom_param::{GeomParamSpec, GeomParamWriter};
pub use mark::ArchiveMark;
pub use poly_mesh::{Indexed, PolyMeshSample, PolyMeshWriter, Topology};
pub use tree::{CompoundId, ObjectId, PropertyId};
pub use xform::XformWriter;

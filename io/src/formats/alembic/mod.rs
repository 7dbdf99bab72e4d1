//! Alembic (Ogawa).

mod channel;
mod read;
mod read_back;
mod summary;
mod write;

pub use read::{AlembicMesh, render_mesh_of, sample_times};
pub use read_back::{faces_of, triangles_of};
pub use write::AlembicWriter;

use super::Format;

/// The format.
pub(super) const FORMAT: Format = Format {
    open: Some(|path, pattern| Ok(Box::new(AlembicMesh::open(path, pattern)?))),
    channel: Some(channel::read),
    create: Some(|path, plan| Ok(Box::new(AlembicWriter::create(path, plan)?))),
    resume: Some(|path, plan, mark| Ok(Box::new(AlembicWriter::resume(path, plan, mark)?))),
    check: Some(AlembicWriter::check_resume),
    read_back: Some(read_back::open),
    ..Format::new("abc", "Alembic (Ogawa): bodies and garments in, caches out", summary::summary)
};

//! Alembic (Ogawa) archives, read and written in safe Rust without other libraries.
//!
//! Writing is streaming: sample payloads go to disk as they arrive, small tables stay in memory, and
//! [`ArchiveWriter::commit`] makes everything written so far visible to readers. A file that was committed once is a
//! valid archive at every later moment, also when the process is killed.
//!
//! ```
//! use drapery_alembic::{
//!     Archive, ArchiveOptions, ArchiveWriter, Durability, PolyMesh, PolyMeshSample, PolyMeshWriter, TimeSampling,
//!     Topology, XformWriter,
//! };
//!
//! # fn main() -> Result<(), drapery_alembic::AlembicError> {
//! # let folder = tempfile::tempdir().unwrap(); // a doc test may stop here
//! let path = folder.path().join("cloth.abc");
//! let mut archive = ArchiveWriter::create(&path, &ArchiveOptions::default())?;
//! let sampling = archive.add_time_sampling(TimeSampling::frames(1001.0, 24.0)?)?;
//! let root = archive.root();
//! let xform = XformWriter::still(&mut archive, root, "cloth", None)?;
//! let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "clothShape", sampling)?;
//! let topology = Topology { face_counts: &[3], face_indices: &[0, 1, 2] };
//! for frame in 0..2 {
//!     let height = frame as f32;
//!     let positions = [[0.0, height, 0.0], [1.0, height, 0.0], [0.0, height, 1.0]];
//!     mesh.write(
//!         &mut archive,
//!         &PolyMeshSample { topology: (frame == 0).then_some(topology), ..PolyMeshSample::of(&positions) },
//!     )?;
//!     archive.commit(Durability::Flushed)?;
//! }
//! archive.finish(Durability::Synced)?;
//!
//! let archive = Archive::open(&path)?;
//! let mesh = PolyMesh::open(&archive, "/cloth/clothShape")?;
//! assert_eq!(mesh.sample_count(), 2);
//! assert_eq!(mesh.positions(1)?[2], [0.0, 1.0, 1.0]);
//! # Ok(())
//! # }
//! ```
//!
//! Limits: points, curves, cameras and unknown schemas are listed with their raw properties and not interpreted;
//! half-precision values are raw bytes; arrays of several dimensions are read as their elements in a row; the old HDF5
//! container is refused with a message; transforms are written as one matrix.
//!
//! Conventions of the format that this crate leaves to its callers: faces are clockwise seen from outside, time is in
//! seconds, Y is up, and there is no unit of length.

mod error;
mod geom;
mod metadata;
mod murmur;
mod ogawa;
mod packed;
mod property;
mod time_sampling;

mod reader;
mod writer;

pub use error::AlembicError;
pub use geom::{Bounds, EMPTY_BOUNDS, IDENTITY, Interpretation, Matrix, Scope, Visibility, multiply, transform_point};
pub use metadata::MetaData;
pub use murmur::murmur3_x64_128;
pub use property::{DataType, PodType, PodValue};
pub use reader::*;
pub use time_sampling::{SamplingKind, TimeSampling};
pub use writer::*;

//! HDF5 caches: one file a garment, whole and readable from the moment it is created.
//!
//! The file is created with room for every planned frame and closed at once; frames are then written with plain
//! positioned writes into the places of the datasets, each followed by its mark in `committed`. So nobody holds the
//! file open through the HDF5 library: readers meet no lock, and a killed run leaves a file that opens like any other
//! (`docs/dev/decisions/0002-hdf5-preallocated.md`). A frame whose mark is 0 reads as zeros.
//!
//! A cache is continued in place: the marks of later frames are cleared, the last one first, and their values are set
//! back to zeros. Only when the planned range is another than before, the file is made anew beside the old one, its
//! frames are copied, and it takes the old one's name.
//!
//! The attributes of its root say what the file is about (`docs/reference/hdf5_cache.md`).
//!
//! | dataset | shape | type | content |
//! |---|---|---|---|
//! | `positions` | (frames, points, 3) | f32 | in the file's unit and up axis, counted from the attribute `origin` if there is one |
//! | `velocities` | (frames, points, 3) | f32 | per second, only if asked for |
//! | `normals` | (frames, points, 3) | f32 | of render meshes, else only if asked for; (frames, normals, 3) where hard edges split them |
//! | `normal_indices` | (corners) | i32 | which normal each corner has, only where hard edges split them |
//! | `strain`, `contact` | (frames, points) | f32 | only if asked for |
//! | `rest`, `thickness` | (points, 3), (points) | f32 | only if asked for; in the file's unit |
//! | `times` | (frames) | f64 | frame / fps [s] |
//! | `frame_numbers` | (frames) | i64 | |
//! | `committed` | (frames) | u8 | 1 when the frame is complete |
//! | `crossings` | (frames) | u32 | edges of cloth through cloth, all garments; only if the shot counts them |
//! | `face_counts`, `face_indices` | (faces), (corners) | i32 | counter-clockwise |
//! | `triangles` | (triangles, 3) | i32 | what is simulated: how faces with more corners are cut |
//! | `uv_values`, `uv_indices` | (values, 2), (corners) | f32, i32 | only if the garment has them |

pub(crate) mod datasets;
mod fixed_digest;
mod layout;
mod read_back;
mod summary;
mod write;

use std::path::Path;

pub(crate) use layout::reserved;
pub use write::Hdf5Writer;

use super::Format;
use crate::error::IoError;

/// Dataset of the number of each corner's normal.
const NORMAL_INDICES: &str = "normal_indices";

/// The format.
pub(super) const FORMAT: Format = Format {
    opens_in_applications: false,
    whole_frames: true,
    create: Some(|path, plan| Ok(Box::new(Hdf5Writer::create(path, plan)?))),
    resume: Some(|path, plan, mark| Ok(Box::new(Hdf5Writer::resume(path, plan, mark)?))),
    check: Some(Hdf5Writer::check_resume),
    read_back: Some(read_back::open),
    ..Format::new("h5", "HDF5: caches out, for analysis", summary::summary)
};

/// The error of a file that the library cannot read as a cache.
fn not_a_cache(path: &Path, source: &hdf5::Error) -> IoError {
    IoError::data(path, "HDF5", source.to_string(), "it is damaged, or not a Drapery cache")
}

//! Caches as the rest of the program sees them: a plan, and a writer that takes one frame after the other, in the
//! file's own units and axes.

use std::path::Path;

use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use serde::{Deserialize, Serialize};

use crate::attributes::{PointAttributes, PointValues};
use crate::error::IoError;
use crate::garment_mesh::GarmentMesh;
use crate::units::Units;

/// Planned content of a cache, known before its first frame.
#[derive(Debug, Clone)]
pub struct CachePlan<'a> {
    /// Name of the garment.
    pub garment: &'a str,
    /// The garment's mesh and attributes, which no cache keeps: it is read when the cache is begun or continued. Where its
    /// points are decides how faces with more corners were cut into the triangles that are simulated.
    pub mesh: &'a GarmentMesh,
    /// Units and up axis of the file.
    pub units: Units,
    /// Point that positions are counted from [m], Y up: the origin of the scene
    /// ([`drapery_core::scene::Scene::origin`]).
    pub origin: Vec3,
    /// Frame rate.
    pub timeline: Timeline,
    /// First frame.
    pub first_frame: i64,
    /// Last frame.
    pub last_frame: i64,
    /// Whether velocities are stored.
    pub velocities: bool,
    /// Whether frames come with normals, one for each point or each of the mesh's [`SplitNormals`](crate::normals::SplitNormals).
    pub normals: bool,
    /// Whether frames come with their number of crossings.
    pub crossings: bool,
    /// Other attributes at the points.
    pub attributes: PointAttributes,
    /// Times of the samples between a frame and the next, as fractions of a frame, ascending, between 0 and 1.
    pub sub_frames: &'a [f64],
}

impl CachePlan<'_> {
    /// Full object path in the file: that of the source, or `/<garment>/<garment>Shape`. A mesh that stands alone there gets the
    /// garment as its parent where that has to move it.
    pub fn object_path(&self) -> String {
        let path = self.mesh.object_path();
        let levels = path.split('/').filter(|name| !name.is_empty()).count();
        match self.file_origin() {
            _ if path.is_empty() => format!("/{0}/{0}Shape", self.garment),
            Some(_) if levels == 1 => format!("/{}/{}", self.garment, path.trim_matches('/')),
            _ => path.to_owned(),
        }
    }

    /// Returns the point that stored positions are counted from, in the file's unit and axes; `None` where it is the
    /// origin of the world.
    pub fn file_origin(&self) -> Option<[f64; 3]> {
        // Adding zero turns a negative zero into the positive one.
        let in_file = || <[f64; 3]>::from(self.units.from_si(self.origin)).map(|c| c + 0.0);
        (self.origin != Vec3::zeros()).then(in_file)
    }

    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        usize::try_from(self.last_frame - self.first_frame + 1).unwrap_or(0)
    }

    /// Number of samples from the first frame up to one that lies `sub_frame` samples behind a frame.
    pub fn samples_until(&self, frame: i64, sub_frame: usize) -> usize {
        let before = usize::try_from(frame - self.first_frame).unwrap_or(0);
        before * (self.sub_frames.len() + 1) + sub_frame + 1
    }
}

/// The program and version that caches name as their origin.
pub const APPLICATION: &str = concat!("Drapery ", env!("CARGO_PKG_VERSION"));

/// One sample of a garment, as it is stored: in the units and axes of the file ([`Units::stored`]), positions counted from the
/// cache's origin ([`Units::stored_from`]).
#[derive(Debug, Clone, Copy)]
pub struct CacheFrame<'a> {
    /// Frame number; of a sample between two frames, that of the first.
    pub frame: i64,
    /// 0 for the frame itself, else which of [`CachePlan::sub_frames`] behind it, counted from 1. HDF5 holds whole frames and
    /// passes over the others.
    pub sub_frame: usize,
    /// Positions.
    pub positions: &'a [[f32; 3]],
    /// Velocities per second; empty when none are stored.
    pub velocities: &'a [[f32; 3]],
    /// Normals at the points, or those that hard edges split ([`crate::normals`]); empty when none are stored.
    pub normals: &'a [[f32; 3]],
    /// Number of edges of cloth that pass through triangles of cloth in the positions as they are stored, in all
    /// garments of the shot; given with every sample or never, as planned.
    pub crossings: Option<u32>,
    /// Other attributes at the points, as planned.
    pub values: PointValues<'a>,
}

/// State of a cache after its last complete frame: enough to cut the file back to it and go on
/// ([`crate::formats::ResumeCache`]).
///
/// Cost of going on, for 1000 frames of 10⁵ points, with the file in memory (`io/tests/cost_of_continuing.rs`):
/// Alembic reads the tables and a few bytes of every sample, below 0.1 s wherever the mark is. HDF5 looks at all
/// frames after the mark and clears them, 0.4 s for 500 frames. Another last frame costs nothing in Alembic; in HDF5
/// the frames up to the mark are copied, 5 s for 500 frames, and both files need room for that time.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CacheMark {
    /// Name of the file, without its folder.
    pub file: String,
    /// Its last complete frame; none when there was none yet.
    pub last_frame: Option<i64>,
    /// Number of samples behind that frame, before the next one.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub sub_frame: usize,
    /// Size of the file [bytes]; without what was being written when the mark was taken.
    pub bytes: u64,
    /// Start of the tables of the last frame's commit [bytes from the start]; Alembic only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub root: Option<u64>,
    /// Digest of what the file held, hexadecimal: over the tables of the commit (Alembic, and through them over every
    /// frame) or over the last frame (HDF5). Empty when there was no frame yet.
    pub digest: String,
}

impl CacheMark {
    /// The mark of a cache without frames.
    pub fn none(path: &Path) -> Self {
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Self { file, ..Self::default() }
    }

    /// Returns the sample that comes next, as frame and sub-frame ([`CacheFrame`]).
    pub(crate) fn next(&self, first_frame: i64, sub_frames: usize) -> (i64, usize) {
        match self.last_frame {
            None => (first_frame, 0),
            Some(last) if self.sub_frame < sub_frames => (last, self.sub_frame + 1),
            Some(last) => (last + 1, 0),
        }
    }
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

/// A cache being written. Samples come in ascending order without gaps, and none after an error or after
/// [`CacheWriter::finish`].
///
/// After every [`CacheWriter::write`] the file is valid under its final name, also when the process is killed.
pub trait CacheWriter: Send {
    /// The file.
    fn path(&self) -> &Path;

    /// Appends a sample and makes it visible to readers.
    ///
    /// # Errors
    /// The disk refuses; the frames before stay intact.
    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError>;

    /// Returns the state of the file after its last complete frame. To be kept where it survives the process, after
    /// [`CacheWriter::sync`].
    fn mark(&self) -> CacheMark;

    /// Brings what is written to the disk, so that it survives a power cut too; may be called at any time.
    ///
    /// # Errors
    /// The disk refuses.
    fn sync(&mut self) -> Result<(), IoError>;

    /// Brings everything to the disk; nothing is written after that.
    ///
    /// # Errors
    /// The disk refuses.
    fn finish(&mut self) -> Result<(), IoError>;
}

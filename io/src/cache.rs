//! What mesh files and caches are to the rest of the program: a mesh with its attributes, a reader that can be asked
//! for any time, and a writer that takes one frame after the other.
//!
//! Readers and writers speak the file's own units and axes; [`crate::mesh_source::MeshSource`] and the frame loop convert at
//! the door. Faces are counter-clockwise seen from outside everywhere in the program; formats
//! that store them the other way round are reversed on reading and again on writing.

use std::path::Path;

pub use drapery_alembic::{DataType, PodType, Scope};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::Timeline;
use serde::{Deserialize, Serialize};

use crate::error::IoError;
use crate::garment_mesh::GarmentMesh;
use crate::units::Units;

/// Texture coordinates: a list of values, and for every face corner which value it has.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uvs {
    /// Name of the UV set in the source file; empty when it has none.
    pub name: String,
    /// Texture coordinates.
    pub values: Vec<[f32; 2]>,
    /// Value of each face corner, in the order of the mesh's face indices.
    pub indices: Vec<u32>,
}

/// A named set of faces, such as a panel or the faces of one material.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaceSet {
    /// Its name.
    pub name: String,
    /// Face numbers, ascending.
    pub faces: Vec<u32>,
}

/// An attribute of a mesh that is handed through from the source file to the output, value by value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshParam {
    /// Its name.
    pub name: String,
    /// What one value belongs to. Values of face corners are in Alembic's order, clockwise seen from outside.
    pub scope: Scope,
    /// Type of one value.
    pub data_type: DataType,
    /// What the numbers mean, in Alembic's words; empty for plain numbers.
    pub interpretation: String,
    /// Name of a UV set, when it is one and has one.
    pub source_name: Option<String>,
    /// The values as stored bytes.
    pub values: Vec<u8>,
    /// Value used at each place, when values are shared.
    pub indices: Option<Vec<u32>>,
}

/// A mesh with everything that is handed through to the output.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshData {
    /// Full path of the object in its file (`/hero/geo/skirt/skirtShape`); empty when the format has no paths.
    pub object_path: String,
    /// Points and polygons.
    pub mesh: PolygonMesh,
    /// Texture coordinates, if there are any.
    pub uvs: Option<Uvs>,
    /// Face sets in the order of the file.
    pub face_sets: Vec<FaceSet>,
    /// Other attributes, passed through as they are.
    pub params: Vec<MeshParam>,
}

impl MeshData {
    /// A mesh without attributes.
    pub fn new(mesh: PolygonMesh) -> Self {
        Self { mesh, ..Self::default() }
    }
}

/// Number of corners of each face, and the point of each corner.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Connectivity {
    /// Number of corners of each face.
    pub face_counts: Vec<u32>,
    /// Point of each corner, face by face.
    pub face_indices: Vec<u32>,
}

/// An opened mesh, in the units and axes of its file, transforms of all parents applied.
pub trait MeshReader: Send {
    /// Paths of the objects that were chosen, in the order in which they are merged.
    fn objects(&self) -> Vec<String>;

    /// Times at which anything of the chosen objects or their parents is stored [s], ascending; empty when nothing
    /// moves.
    fn sample_times(&self) -> &[f64];

    /// The mesh at a time [s]; between samples as [`MeshReader::positions_at`].
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn mesh_at(&self, time: f64) -> Result<MeshData, IoError>;

    /// Positions at a time [s], linear between the samples around it, held before the first and after the last.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn positions_at(&self, time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError>;

    /// Gives the positions at a time [s] piece by piece, as [`MeshReader::positions_at`] has them.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn points_at(&self, time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError>;

    /// Gives the faces at a time [s] piece by piece: the number of corners of each, and the point of each corner.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn faces_at(&self, time: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError>;

    /// Reads what is handed through at a time [s], one attribute after the other, and keeps nothing.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn check_attributes_at(&self, time: f64) -> Result<(), IoError>;

    /// How faces and points hang together at a time [s], or `None` when the file promises that it never changes.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn connectivity_at(&self, time: f64) -> Result<Option<Connectivity>, IoError>;
}

/// What a cache will hold, known before its first frame.
#[derive(Debug, Clone)]
pub struct CachePlan<'a> {
    /// Name of the garment.
    pub garment: &'a str,
    /// The garment's mesh and attributes, which no cache keeps: it is read when the cache is begun or continued. Where its
    /// points are decides how faces with more corners were cut into the triangles that are simulated.
    pub mesh: &'a GarmentMesh,
    /// Units and up axis of the file.
    pub units: Units,
    /// What positions are counted from [m], Y up: that of the scene ([`drapery_core::scene::Scene::origin`]).
    pub origin: Vec3,
    /// Frame rate.
    pub timeline: Timeline,
    /// First frame.
    pub first_frame: i64,
    /// Last frame.
    pub last_frame: i64,
    /// Whether velocities are stored.
    pub velocities: bool,
    /// Whether frames come with their number of crossings.
    pub crossings: bool,
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

    /// What stored positions are counted from, in the file's unit and axes; `None` where that is the origin of the world.
    pub fn file_origin(&self) -> Option<[f64; 3]> {
        // Adding zero turns a negative zero into the positive one.
        let in_file = || <[f64; 3]>::from(self.units.from_si(self.origin)).map(|c| c + 0.0);
        (self.origin != Vec3::zeros()).then(in_file)
    }

    /// File time of a frame [s]: frame / fps, computed from integers.
    pub fn file_time(&self, frame: i64) -> f64 {
        frame as f64 * f64::from(self.timeline.fps_denominator) / f64::from(self.timeline.fps_numerator)
    }

    /// Frames per second.
    pub fn fps(&self) -> f64 {
        f64::from(self.timeline.fps_numerator) / f64::from(self.timeline.fps_denominator)
    }

    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        usize::try_from(self.last_frame - self.first_frame + 1).unwrap_or(0)
    }
}

/// The program and version that caches name as their origin.
pub const APPLICATION: &str = concat!("Drapery ", env!("CARGO_PKG_VERSION"));

/// One frame of a garment, as it is stored: in the units and axes of the file ([`Units::stored`]), positions counted from the
/// cache's origin ([`Units::stored_from`]).
#[derive(Debug, Clone, Copy)]
pub struct CacheFrame<'a> {
    /// Frame number.
    pub frame: i64,
    /// Positions.
    pub positions: &'a [[f32; 3]],
    /// Velocities per second; empty when none are stored.
    pub velocities: &'a [[f32; 3]],
    /// How many edges of cloth pass through triangles of cloth in the positions as they are stored, in all garments of
    /// the shot; given with every frame or never, as planned.
    pub crossings: Option<u32>,
}

/// What a cache was after its last complete frame: enough to cut the file back to it and go on
/// ([`crate::formats::ResumeCache`]).
///
/// What that costs, for 1000 frames of 10⁵ points, with the file in memory (`io/tests/cost_of_continuing.rs`): Alembic
/// reads the tables and a few bytes of every sample, below 0.1 s wherever the mark is. HDF5 looks at all frames after
/// the mark and clears them, 0.4 s for 500 frames. Another last frame costs nothing in Alembic; in HDF5 the frames up to
/// the mark are copied, 5 s for 500 frames, and both files need room for that time.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CacheMark {
    /// Name of the file, without its folder.
    pub file: String,
    /// Its last complete frame; none when there was none yet.
    pub last_frame: Option<i64>,
    /// Size of the file [bytes]; without what was being written when the mark was taken.
    pub bytes: u64,
    /// Where the tables of the last frame's commit begin [bytes from the start]; Alembic only.
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
}

/// A cache being written. Frames come in ascending order without gaps, and none after an error or after
/// [`CacheWriter::finish`].
///
/// After every [`CacheWriter::write`] the file is valid under its final name, also when the process is killed.
pub trait CacheWriter: Send {
    /// The file.
    fn path(&self) -> &Path;

    /// Appends a frame and makes it visible to readers.
    ///
    /// # Errors
    /// The disk refuses; the frames before stay intact.
    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError>;

    /// What the file is after its last complete frame. To be kept where it survives the process, after
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

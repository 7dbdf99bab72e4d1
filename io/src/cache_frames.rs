//! Caches read back, frame by frame: what comparisons and pages need of an Alembic, HDF5 or USD file, in metres with Y up
//! whatever the file's own unit and axis are. What a format has to give for it is [`CacheSamples`]; how a file is opened stands in
//! the table of formats.
//!
//! Nothing is kept in memory but the frame that is asked for, and a file that is still being written may be read: only
//! frames that are complete are listed. Samples of a mesh are those of its whole frames, then those between them.

pub(crate) mod rates;
pub(crate) mod transforms;

use std::fmt;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;

use crate::attributes::{PointAttributes, StoredValues};
use crate::error::IoError;
use crate::mesh_data::{Connectivity, MeshData};
use crate::normals::SplitNormals;
use crate::units::{InputUnits, LengthUnit, Units, UpAxis};

/// A mesh of a cache.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CacheMesh {
    /// Full path of the object.
    pub name: String,
    /// Number of points of the first frame.
    pub points: usize,
    /// Faces of the first frame, counter-clockwise.
    pub faces: Connectivity,
    /// The triangles that were simulated, or the faces cut into triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Frame number of every complete sample, ascending; sample numbers where nobody says the frame rate of the file. Of files with
    /// several samples a frame, whole frames only; none where no sample is one.
    pub frames: Vec<i64>,
    /// The samples between and around these, ascending. As samples of the cache they are counted behind the frames: the first is
    /// `frames.len()`.
    pub between: Vec<Between>,
    /// Whether nothing of it changes from sample to sample; a stage shows what stands still at all times.
    pub is_still: bool,
    /// Purpose of a mesh of a stage, in USD's words (`render`, `proxy`, `guide`), if not everything.
    pub purpose: Option<String>,
    /// Attributes at its points that this program wrote, beside normals; rest positions and thickness in the file's unit.
    pub attributes: PointAttributes,
    /// Normals of its frames where hard edges split them; of caches of this program alone.
    pub split_normals: Option<SplitNormals>,
    /// Properties of it that neither its attributes nor its frames hand through, a sentence each.
    pub left_out: Vec<String>,
}

/// A sample that is no whole frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Between {
    /// The frame before it.
    pub frame: i64,
    /// Distance behind that, in frames; between 0 and 1.
    pub behind: f64,
}

impl Between {
    /// At a time in frames.
    pub(crate) fn at(time: f64) -> Self {
        Self { frame: time.floor() as i64, behind: time - time.floor() }
    }
}

/// All that a cache stores of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredFrame {
    /// Positions, counted from the cache's origin.
    pub positions: Vec<[f32; 3]>,
    /// Velocities, if there are any.
    pub velocities: Option<Vec<[f32; 3]>>,
    /// Normals at the points, or each of [`CacheMesh::split_normals`] once, if there are any.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Number of crossings, if the cache counts them.
    pub crossings: Option<u32>,
    /// Other attributes at the points.
    pub values: StoredValues,
    /// Whether the bounds that are stored, if any, are those of the positions to the last bit.
    pub has_bounds_of_points: bool,
}

/// Origin of stored points, and the points.
pub type Shifted = ([f64; 3], Vec<[f32; 3]>);

/// The samples of an opened cache, in unit and axes of the file.
///
/// # Errors
/// Every function fails where the file cannot be read, or contradicts itself.
pub trait CacheSamples: Send + Sync {
    /// Points in the world.
    fn world(&self, mesh: usize, sample: usize) -> Result<Vec<Vec3>, IoError>;

    /// Points as they are stored; `None` where parents do more than shift them.
    fn shifted(&self, mesh: usize, sample: usize) -> Result<Option<Shifted>, IoError>;

    /// Velocities in the world per second; those that are stored where parents do not turn or move them. `None` where there are none.
    fn velocities(&self, mesh: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError>;

    /// All that is stored.
    fn frame(&self, mesh: usize, sample: usize) -> Result<StoredFrame, IoError>;

    /// Faces, texture coordinates and all else of a mesh that is the same in all frames. `about` is what the cache says of the mesh.
    fn attributes(&self, mesh: usize, about: &CacheMesh) -> Result<MeshData, IoError>;

    /// Faces, where they may be others than those of the first sample.
    fn faces(&self, _mesh: usize, _sample: usize) -> Result<Option<Connectivity>, IoError> {
        Ok(None)
    }

    /// Checks by the digests in the file, if the format has any, that what does not move is what was written.
    fn check_constants(&self) -> Result<(), IoError> {
        Ok(())
    }

    /// Checks that all is there that the mesh of this path, or any without one, refers to.
    fn check_complete(&self, _mesh: Option<&str>) -> Result<(), IoError> {
        Ok(())
    }
}

/// An opened cache: what the file says of itself, and its samples.
pub struct CacheFrames {
    /// The file.
    pub path: PathBuf,
    /// Unit and axes of its numbers.
    pub input_units: InputUnits,
    /// Whether it says its unit of length.
    pub states_length: bool,
    /// Frames a second, if it tells or they were said.
    pub fps: Option<f64>,
    /// Frames a second that the file itself tells.
    pub stated_fps: Option<f64>,
    /// Time codes of a stage that a frame takes; 1 in all caches of this program.
    pub codes_per_frame: f64,
    /// Notes on a stage of another program, a sentence each.
    pub notes: Vec<String>,
    /// Meshes of a stage that are none of the cache, since nothing is to be seen of them, a sentence each.
    pub hidden: Vec<String>,
    /// Its meshes, in the order of their paths.
    pub meshes: Vec<CacheMesh>,
    /// Their samples.
    pub samples: Box<dyn CacheSamples>,
}

/// Positions of a sample as a cache stores them.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredPositions {
    /// Unit and axes of the numbers.
    pub units: Units,
    /// Origin that they are counted from.
    pub origin: [f64; 3],
    /// The positions.
    pub points: Vec<[f32; 3]>,
}

impl fmt::Debug for CacheFrames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CacheFrames").field("path", &self.path).field("meshes", &self.meshes).finish()
    }
}

impl CacheFrames {
    /// A cache that says its unit, and holds nothing to be told of.
    pub(crate) fn new(
        path: &Path,
        (input_units, fps): (InputUnits, Option<f64>),
        meshes: Vec<CacheMesh>,
        samples: impl CacheSamples + 'static,
    ) -> Self {
        let (states_length, codes_per_frame, samples) = (true, 1.0, Box::new(samples));
        let (path, notes, hidden) = (path.to_owned(), Vec::new(), Vec::new());
        Self { path, input_units, states_length, fps, stated_fps: fps, codes_per_frame, notes, hidden, meshes, samples }
    }

    /// Unit and axes of the file; metres where its unit is one that caches of this program do not have.
    pub fn units(&self) -> Units {
        let InputUnits { metres, up } = self.input_units;
        Units { length: LengthUnit::ALL.into_iter().find(|unit| unit.metres() == metres).unwrap_or_default(), up }
    }

    /// Reads the file in this unit and with this axis up from now on, whatever it says of itself.
    pub fn read_in(&mut self, length: Option<LengthUnit>, up: Option<UpAxis>) {
        let units = &mut self.input_units;
        units.metres = length.map_or(units.metres, LengthUnit::metres);
        units.up = up.unwrap_or(units.up);
    }

    /// Positions of a sample of a mesh [m], Y up.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn positions(&self, mesh: usize, sample: usize) -> Result<Vec<Vec3>, IoError> {
        Ok(self.samples.world(mesh, sample)?.into_iter().map(|p| self.input_units.to_si(p)).collect())
    }

    /// Velocities of a sample of a mesh [m/s], Y up; `None` when the cache stores none.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn velocities(&self, mesh: usize, sample: usize) -> Result<Option<Vec<Vec3>>, IoError> {
        let si = |v: [f32; 3]| self.input_units.to_si(Vec3::from(v.map(f64::from)));
        Ok(self.samples.velocities(mesh, sample)?.map(|rates| rates.into_iter().map(si).collect()))
    }

    /// Faces, texture coordinates and what else of a mesh is the same in all frames.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn attributes(&self, mesh: usize) -> Result<MeshData, IoError> {
        let data = self.samples.attributes(mesh, &self.meshes[mesh])?;
        Ok(MeshData { params_in: Some(self.input_units), ..data })
    }

    /// Positions of a sample of a mesh as they are stored; `None` if its parents do more than shift them, or of a stage with
    /// another unit than [`CacheFrames::units`].
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn stored_positions(&self, mesh: usize, sample: usize) -> Result<Option<StoredPositions>, IoError> {
        let units = self.units();
        let shifted = self.samples.shifted(mesh, sample)?.filter(|_| self.input_units == units.into());
        Ok(shifted.map(|(origin, points)| StoredPositions { units, origin, points }))
    }
}

/// Points in the world of those that are counted from an origin.
pub(crate) fn placed((origin, points): Shifted) -> Vec<Vec3> {
    points.into_iter().map(|p| Vec3::from(p.map(f64::from)) + Vec3::from(origin)).collect()
}

/// Units by their words; metres with Y up where a file does not say.
pub(crate) fn units(length: &str, up: &str) -> Units {
    let length = LengthUnit::ALL.into_iter().find(|unit| unit.word() == length).unwrap_or_default();
    Units { length, up: if up == "Z" { UpAxis::Z } else { UpAxis::Y } }
}

/// Faces cut into triangles by the solver's rule.
pub(crate) fn cut(face_counts: &[u32], corners: &[u32], points: &[Vec3]) -> Vec<[u32; 3]> {
    let mut polygons = PolygonMesh { points: points.to_vec(), ..PolygonMesh::default() };
    let mut start = 0;
    for count in face_counts {
        let face = &corners[start..start + *count as usize];
        start += *count as usize;
        // Points and lines among the faces cross nothing.
        if face.len() > 2 {
            polygons.face_counts.push(*count);
            polygons.face_indices.extend(face);
        }
    }
    polygons.triangulate().0
}

/// The triangles that a file lists as corners, three each; `None` if one is none of the points.
pub(crate) fn listed_triangles<T: Copy>(listed: &[[T; 3]], points: usize) -> Option<Vec<[u32; 3]>>
where
    u32: TryFrom<T>,
{
    let corner = |v: T| u32::try_from(v).ok().filter(|v| (*v as usize) < points);
    listed.iter().map(|[a, b, c]| Some([corner(*a)?, corner(*b)?, corner(*c)?])).collect()
}

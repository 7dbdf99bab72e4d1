//! Caches in USD, as this program writes them; any other stage is read as `stage` does.

use std::path::Path;

use drapery_alembic::murmur3_x64_128;
use drapery_core::Vec3;
use drapery_usd::cache::{Cache, CacheError, Frame, Still};
use globset::escape;

use super::read::UsdMesh;
use super::stage;
use super::write::cache_error;
use crate::attributes::{PointAttributes, REST, StoredValues, THICKNESS};
use crate::cache_frames::{
    Between, CacheFrames, CacheMesh, CacheSamples, Shifted, StoredFrame, cut, listed_triangles, placed,
};
use crate::error::IoError;
use crate::formats::Opening;
use crate::mesh_data::{Connectivity, MeshData, MeshReader};
use crate::normals::SplitNormals;
use crate::units::{InputUnits, LengthUnit, UpAxis};

/// A cache whose samples are read one by one: the layer, and what of it does not move.
struct Samples {
    cache: Cache,
    attributes: PointAttributes,
    split_normals: Option<SplitNormals>,
}

/// Opens a cache, or a stage that another program made.
///
/// # Errors
/// The file is missing or damaged, or holds no mesh.
pub(super) fn open(path: &Path, opening: Opening) -> Result<CacheFrames, IoError> {
    let cache = match Cache::open(path) {
        Err(CacheError::NotOurs { .. }) => return stage::open(path, opening),
        cache => cache.map_err(|error| cache_error(path, error))?,
    };
    let metres = cache.metres_per_unit;
    if !LengthUnit::ALL.iter().any(|unit| unit.metres() == metres) {
        return Err(damaged(path, "metersPerUnit", "it is not a unit that this program writes"));
    }
    let units = InputUnits { metres, up: if cache.z_up { UpAxis::Z } else { UpAxis::Y } };
    let first = cache.frame(0).map_err(|error| cache_error(path, error))?;
    let points: Vec<Vec3> = first.points.iter().map(|p| Vec3::from(p.map(f64::from))).collect();
    let mesh = CacheMesh {
        name: cache.mesh_path().to_owned(),
        points: points.len(),
        triangles: triangles(path, &cache.still, &points)?,
        faces: Connectivity {
            face_counts: cache.still.face_counts.clone(),
            face_indices: cache.still.face_indices.clone(),
        },
        frames: cache.frames.clone(),
        between: cache.between.iter().map(|time| Between::at(*time)).collect(),
        attributes: attributes(path, &cache.still, points.len())?,
        split_normals: split_normals(path, &cache.still)?,
        ..CacheMesh::default()
    };
    let (attributes, split_normals) = (mesh.attributes.clone(), mesh.split_normals.clone());
    let samples = Samples { attributes, split_normals, cache };
    Ok(CacheFrames::new(path, (units, Some(samples.cache.fps)), vec![mesh], samples))
}

impl Samples {
    fn sample(&self, sample: usize) -> Result<Frame, IoError> {
        self.cache.frame(sample).map_err(|error| cache_error(self.cache.path(), error))
    }
}

impl CacheSamples for Samples {
    fn world(&self, _: usize, sample: usize) -> Result<Vec<Vec3>, IoError> {
        Ok(placed((self.cache.still.origin, self.sample(sample)?.points)))
    }

    fn shifted(&self, _: usize, sample: usize) -> Result<Option<Shifted>, IoError> {
        Ok(Some((self.cache.still.origin, self.sample(sample)?.points)))
    }

    fn velocities(&self, _: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        Ok(self.sample(sample)?.velocities)
    }

    fn frame(&self, _: usize, sample: usize) -> Result<StoredFrame, IoError> {
        let Frame { points, velocities, normals, extent, crossings, mut numbers } = self.sample(sample)?;
        let normals = match (&self.split_normals, normals) {
            (Some(split), Some(corners)) => {
                let what = "the corners of one normal differ";
                Some(split.of_corners(&corners).ok_or_else(|| damaged(self.cache.path(), "normals", what))?)
            }
            (_, normals) => normals,
        };
        let lacking = |name: &str| damaged(self.cache.path(), name, "a frame does not hold it");
        let values = StoredValues::read(&self.attributes, |name| numbers.remove(name).ok_or_else(|| lacking(name)))?;
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for (point, axis) in points.iter().flat_map(|point| [0, 1, 2].map(|axis| (point, axis))) {
            bounds[0][axis] = bounds[0][axis].min(point[axis]);
            bounds[1][axis] = bounds[1][axis].max(point[axis]);
        }
        let has_bounds_of_points = extent == bounds;
        Ok(StoredFrame { positions: points, velocities, normals, crossings, values, has_bounds_of_points })
    }

    fn attributes(&self, _: usize, about: &CacheMesh) -> Result<MeshData, IoError> {
        let start = self.cache.frames[0] as f64 / self.cache.fps;
        UsdMesh::open(self.cache.path(), Some(&escape(&about.name)))?.mesh_at(start)
    }

    /// The folder of what does not move is called by its digest.
    fn check_constants(&self) -> Result<(), IoError> {
        let path = self.cache.path();
        let (bytes, folder) = self.cache.topology().map_err(|error| cache_error(path, error))?;
        let digest = format!("{:032x}", u128::from_be_bytes(murmur3_x64_128(&bytes)));
        if !folder.is_empty() && digest.starts_with(&folder) {
            return Ok(());
        }
        Err(damaged(path, "topology.usdc", "its digest differs from the name of its folder"))
    }
}

/// Attributes at the points that this program wrote, beside normals.
fn attributes(path: &Path, still: &Still, points: usize) -> Result<PointAttributes, IoError> {
    let wrong = |name: &str| damaged(path, name, "the cache does not have one value for each point");
    let rest = || still.vectors.get(REST).filter(|all| all.len() == points).cloned().ok_or_else(|| wrong(REST));
    let thickness =
        || still.numbers.get(THICKNESS).filter(|all| all.len() == points).cloned().ok_or_else(|| wrong(THICKNESS));
    PointAttributes::of_listed(still.attributes.as_deref().unwrap_or_default(), rest, thickness)
}

/// Normals that hard edges split, if there are any.
fn split_normals(path: &Path, still: &Still) -> Result<Option<SplitNormals>, IoError> {
    let Some(indices) = &still.normal_indices else { return Ok(None) };
    let count = indices.iter().max().map_or(0, |last| *last as usize + 1);
    let fits = count <= indices.len();
    let split = SplitNormals::numbered(indices.clone(), count.min(indices.len()), &still.face_indices).filter(|_| fits);
    let what = "the numbers of the normals do not fit the faces";
    split.map(Some).ok_or_else(|| damaged(path, "drapery:normalIndices", what))
}

/// The triangles that were simulated, or the faces cut by the solver's rule.
fn triangles(path: &Path, still: &Still, points: &[Vec3]) -> Result<Vec<[u32; 3]>, IoError> {
    if !still.face_indices.iter().all(|corner| (*corner as usize) < points.len()) {
        return Err(damaged(path, "faceVertexIndices", "a face refers to a point that does not exist"));
    }
    let Some(stored) = &still.triangles else { return Ok(cut(&still.face_counts, &still.face_indices, points)) };
    listed_triangles(stored, points.len())
        .ok_or_else(|| damaged(path, "drapery:triangles", "a triangle refers to a point that does not exist"))
}

fn damaged(path: &Path, place: &str, what: &str) -> IoError {
    cache_error(path, CacheError::Damaged { path: place.into(), what: what.to_owned() })
}

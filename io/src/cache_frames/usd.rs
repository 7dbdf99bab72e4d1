//! Caches in USD, as this program writes them.

use std::path::Path;

use drapery_alembic::murmur3_x64_128;
use drapery_core::Vec3;
use drapery_usd::cache::{Cache, CacheError, Frame, Still};

use super::{Between, CacheMesh, StoredFrame, cut};
use crate::error::IoError;
use crate::formats::usd_writer::cache_error;
use crate::mesh_data::Connectivity;
use crate::units::{LengthUnit, Units, UpAxis};

/// Opens a cache; `None` if it is a stage that another program made.
pub(super) fn open(path: &Path) -> Result<Option<(Cache, Units, CacheMesh)>, IoError> {
    let cache = match Cache::open(path) {
        Err(CacheError::NotOurs { .. }) => return Ok(None),
        cache => cache.map_err(|error| failed(path, error))?,
    };
    let length = LengthUnit::ALL.into_iter().find(|unit| unit.metres() == cache.metres_per_unit);
    let units = Units {
        length: length.ok_or_else(|| damaged(path, "metersPerUnit", "it is no unit that this program writes"))?,
        up: if cache.z_up { UpAxis::Z } else { UpAxis::Y },
    };
    let first = cache.frame(0).map_err(|error| failed(path, error))?;
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
    };
    Ok(Some((cache, units, mesh)))
}

/// A sample, by its place among the frames and then those between them.
pub(super) fn frame(cache: &Cache, sample: usize) -> Result<Frame, IoError> {
    let frame = cache.frame(sample).map_err(|error| failed(cache.path(), error))?;
    Ok(frame)
}

/// All that is stored of a frame.
pub(super) fn stored_frame(cache: &Cache, sample: usize) -> Result<StoredFrame, IoError> {
    let Frame { points, velocities, normals, extent, crossings } = frame(cache, sample)?;
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for (point, axis) in points.iter().flat_map(|point| [0, 1, 2].map(|axis| (point, axis))) {
        bounds[0][axis] = bounds[0][axis].min(point[axis]);
        bounds[1][axis] = bounds[1][axis].max(point[axis]);
    }
    Ok(StoredFrame { has_bounds_of_points: extent == bounds, positions: points, velocities, normals, crossings })
}

/// Whether what does not move is what was written: its folder is called by its digest.
pub(super) fn check_constants(cache: &Cache) -> Result<(), IoError> {
    let (bytes, folder) = cache.topology().map_err(|error| failed(cache.path(), error))?;
    let digest = format!("{:032x}", u128::from_be_bytes(murmur3_x64_128(&bytes)));
    if !folder.is_empty() && digest.starts_with(&folder) {
        return Ok(());
    }
    Err(damaged(cache.path(), "topology.usdc", "its digest is not the one that its folder is called by"))
}

/// The triangles that were simulated, or the faces cut by the solver's rule.
fn triangles(path: &Path, still: &Still, points: &[Vec3]) -> Result<Vec<[u32; 3]>, IoError> {
    let there = |corner: u32| (corner as usize) < points.len();
    if !still.face_indices.iter().all(|corner| there(*corner)) {
        return Err(damaged(path, "faceVertexIndices", "a face has a corner that is none of the points"));
    }
    let corner = |v: i32| u32::try_from(v).ok().filter(|corner| there(*corner));
    let stored = still
        .triangles
        .as_ref()
        .map(|stored| stored.iter().map(|[a, b, c]| Some([corner(*a)?, corner(*b)?, corner(*c)?])));
    match stored.map(Iterator::collect::<Option<Vec<_>>>) {
        Some(Some(stored)) => Ok(stored),
        Some(None) => Err(damaged(path, "drapery:triangles", "a triangle has a corner that is none of the points")),
        None => Ok(cut(&still.face_counts, &still.face_indices, points)),
    }
}

fn failed(path: &Path, error: CacheError) -> IoError {
    cache_error(path, error)
}

fn damaged(path: &Path, place: &str, what: &str) -> IoError {
    cache_error(path, CacheError::Damaged { path: place.into(), what: what.to_owned() })
}

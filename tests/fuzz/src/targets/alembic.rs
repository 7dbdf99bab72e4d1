//! Alembic archives: the container, meshes as bodies and garments, what `info`, `verify` and `diff` look at, and going on
//! with a cache.

use std::path::Path;

use crate::{memory, scratch};
use drapery_alembic::{Archive, ArchiveWriter, Compound, Durability, Object, PolyMesh, PropertyKind, world_matrix_at};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::formats;

/// Samples of each kind that are read; a file may say that it holds millions.
const SAMPLES: usize = 4;

/// Files with more samples are not looked through as a whole.
const MANY: usize = 1000;

/// Reads one input.
pub fn run(data: &[u8]) {
    let path = scratch::file("mesh.abc", data);
    memory::bounded(|| {
        let Ok(archive) = Archive::from_bytes(data.to_vec(), "memory") else { return };
        archive.objects().for_each(|object| read_object(&object));
        read_as_mesh(&path);
        let _ = drapery_io::formats::inspect(&path);
        // Every sample is looked at, and a short file may repeat one of them a million times.
        if PolyMesh::all(&archive).is_ok_and(|meshes| meshes.iter().all(|mesh| mesh.sample_count() < MANY)) {
            let _ = drapery_analysis::verify::verify(&[&path], None);
        }
        read_as_cache(&path);
        // It writes into the file, so it comes last.
        if let Ok(mut archive) = ArchiveWriter::append(&path) {
            let _ = archive.commit(Durability::Flushed);
        }
    });
}

fn read_object(object: &Object) {
    let _ = object.visibility_at(0.1);
    let _ = object.properties().map(|properties| read_compound(&properties));
    let _ = world_matrix_at(object, 0.06);
    let Ok(mesh) = PolyMesh::of(object) else { return };
    for index in 0..mesh.sample_count().min(SAMPLES) {
        let _ = mesh.world_positions(index);
        let _ = mesh.faces(index);
        let _ = mesh.bounds(index);
        let _ = mesh.velocities(index);
    }
    let _ = mesh.face_sets();
    let _ = mesh.uv().map(|uv| uv.expanded::<f32, 2>(0));
}

fn read_compound(compound: &Compound) {
    for property in compound.iter() {
        match property.kind() {
            PropertyKind::Compound(inside) => read_compound(inside),
            PropertyKind::Scalar(samples) | PropertyKind::Array(samples) => {
                for index in 0..samples.len().min(SAMPLES) {
                    let _ = samples.raw(index);
                    let _ = samples.element_count(index);
                    let _ = samples.strings(index);
                }
            }
        }
    }
}

fn read_as_mesh(path: &Path) {
    let Ok(mesh) = formats::open_mesh(path, None) else { return };
    let mut positions = Vec::new();
    for time in [-1.0, 0.0, 0.05, 1.0 / 24.0, 1e9] {
        if let Ok(data) = mesh.mesh_at(time) {
            let _ = data.mesh.triangulate();
        }
        let _ = mesh.positions_at(time, &mut positions);
        let _ = mesh.points_at(time, &mut |_| {});
        let _ = mesh.faces_at(time, &mut |_, _| {});
        let _ = mesh.connectivity_at(time);
    }
}

fn read_as_cache(path: &Path) {
    let Ok(cache) = CacheFrames::open(path) else { return };
    for (number, mesh) in cache.meshes.iter().enumerate() {
        for sample in 0..mesh.frames.len().min(SAMPLES) {
            let _ = cache.positions(number, sample);
            let _ = cache.stored_positions(number, sample);
            let _ = cache.velocities(number, sample);
        }
    }
}

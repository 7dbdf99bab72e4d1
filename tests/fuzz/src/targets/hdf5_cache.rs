//! HDF5 caches of any layout: what `info` and `diff` look at, and going on with one. The bytes are edits of a good cache.

use crate::edits::Bytes;
use crate::layout::{Kind, Layout, Value};
use crate::{memory, scratch};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::Timeline;
use drapery_io::cache::{CacheMark, CachePlan, CacheWriter};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::formats::hdf5::Hdf5Writer;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::MeshData;
use drapery_io::units::Units;

/// Origin from which the positions of a far cache are counted.
const FAR: [u32; 3] = [100_000, 0, 3];

/// A cache of two frames of one triangle.
fn cache(is_far: bool) -> Layout {
    let mut layout = Layout::default();
    for (name, text) in [
        ("application", "Drapery 0.1.0"),
        ("garment", "flag"),
        ("object_path", "/flag/flagShape"),
        ("length_unit", "m"),
        ("up_axis", "Y"),
        ("winding", "counter-clockwise"),
    ] {
        layout.attribute("", name, Value::Text(text.to_owned()));
    }
    for (name, value) in [("fps", 24.0), ("metres_per_unit", 1.0)] {
        layout.attribute("", name, Value::Real(value));
    }
    for (name, value) in [("format_version", 1 + i64::from(is_far)), ("fps_numerator", 24), ("fps_denominator", 1)] {
        layout.attribute("", name, Value::Number(value));
    }
    if is_far {
        layout.attribute("", "origin", Value::List(FAR.to_vec()));
    }
    let reals: Vec<u8> = [0.0f32, 1.0, 0.5].iter().flat_map(|v| v.to_le_bytes()).collect();
    let corners: Vec<u8> = [0i32, 1, 2].iter().flat_map(|v| v.to_le_bytes()).collect();
    let times: Vec<u8> = [1.0f64 / 24.0, 2.0 / 24.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let frames: Vec<u8> = [1i64, 2].iter().flat_map(|v| v.to_le_bytes()).collect();
    layout.array("", "times", Kind::F64, &[2], &times);
    layout.array("", "frame_numbers", Kind::I64, &[2], &frames);
    layout.array("", "face_counts", Kind::I32, &[1], &3i32.to_le_bytes());
    layout.array("", "face_indices", Kind::I32, &[3], &corners);
    layout.array("", "triangles", Kind::I32, &[1, 3], &corners);
    layout.array("", "committed", Kind::U8, &[2], &[1, 1]);
    layout.array("", "crossings", Kind::U32, &[2], &[0; 8]);
    layout.array("", "velocities", Kind::F32, &[2, 3, 3], &reals);
    layout.array("", "positions", Kind::F32, &[2, 3, 3], &reals);
    layout
}

/// Reads one input.
pub fn run(data: &[u8]) {
    let path = scratch::folder().join("cache.h5");
    let is_far = data.last().is_some_and(|byte| byte % 2 == 1);
    let mut layout = cache(is_far);
    layout.edit(&mut Bytes(data));
    let _ = std::fs::remove_file(&path);
    if layout.write(&path).is_err() {
        return;
    }
    memory::bounded(|| {
        let _ = drapery_io::formats::inspect(&path);
        if let Ok(cache) = CacheFrames::open(&path) {
            for (number, mesh) in cache.meshes.iter().enumerate() {
                for sample in 0..mesh.frames.len().min(4) {
                    let _ = cache.positions(number, sample);
                    let _ = cache.stored_positions(number, sample);
                    let _ = cache.velocities(number, sample);
                }
            }
        }
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let mesh = GarmentMesh::kept(MeshData::new(PolygonMesh::from_triangles(points, &[[0, 1, 2]])));
        let plan = CachePlan {
            sub_frames: &[],
            garment: "flag",
            mesh: &mesh,
            units: Units::SI,
            origin: if is_far { Vec3::from(FAR.map(f64::from)) } else { Vec3::zeros() },
            timeline: Timeline::default(),
            first_frame: 1,
            last_frame: 3,
            velocities: true,
            normals: false,
            crossings: true,
            attributes: Default::default(),
        };
        let bytes = std::fs::metadata(&path).map_or(0, |about| about.len());
        let mark = CacheMark { last_frame: Some(1), bytes, ..CacheMark::none(&path) };
        // It writes into the file, so it comes last.
        if let Ok(mut writer) = Hdf5Writer::resume(&path, &plan, &mark) {
            let _ = writer.finish();
        }
    });
}

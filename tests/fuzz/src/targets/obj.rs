//! Wavefront OBJ, and what is made of any mesh: its checks and its triangles.

use crate::{memory, scratch};
use drapery_core::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};
use drapery_io::formats;
use drapery_io::mesh_data::MeshData;

/// Reads one input.
pub fn run(data: &[u8]) {
    let path = scratch::file("mesh.obj", data);
    memory::bounded(|| {
        let _ = drapery_io::formats::inspect(&path);
        let Ok(reader) = formats::open_mesh(&path, None) else { return };
        let Ok(MeshData { mesh, .. }) = reader.mesh_at(0.0) else { return };
        let (mut points, mut corners) = (Vec::new(), Vec::new());
        reader.points_at(0.0, &mut |piece| points.extend_from_slice(piece)).expect("points of a mesh that was read");
        reader.faces_at(0.0, &mut |_, piece| corners.extend_from_slice(piece)).expect("faces of a mesh that was read");
        assert_eq!((points.len(), corners), (mesh.points.len(), mesh.face_indices.clone()));
        let mut scene = SceneDescription::new("fuzz");
        scene.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
        scene.effects.push(EffectRequest::of_garment("bending", 0).with("stiffness", 1.0));
        scene.garments.push(GarmentDescription::new("garment", mesh, 0.2));
        let _ = Scene::validate(scene);
    });
}

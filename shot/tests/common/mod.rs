//! Shots that the tests describe themselves.

use std::path::PathBuf;

use drapery_core::scene::SceneDescription;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::input_motion::Preroll;
use drapery_io::memory_mesh::MemoryMeshes;
use drapery_io::mesh_data::MeshData;
use drapery_io::shot_description::{CheckDescription, OutputDescription, ShotDescription};
use drapery_io::units::Units;

/// The shot of a scene without input files, whose caches hold velocities.
pub(crate) fn described(scene: SceneDescription, frames: [i64; 2], formats: &[&str], units: Units) -> ShotDescription {
    let formats = formats.iter().map(|format| (*format).to_owned()).collect();
    ShotDescription {
        name: scene.name.clone(),
        scene_path: PathBuf::new(),
        input_files: Vec::new(),
        referred_files: Vec::new(),
        meshes: MemoryMeshes::default(),
        garments: scene.garments.iter().map(|g| GarmentMesh::kept(MeshData::new(g.mesh.clone()))).collect(),
        bodies: scene.bodies.iter().map(|_| None).collect(),
        scene,
        render_meshes: Vec::new(),
        tracks: Vec::new(),
        wind: None,
        frames,
        preroll: Preroll::default(),
        output: OutputDescription {
            formats,
            units,
            velocities: true,
            sub_frames: Vec::new(),
            preroll: false,
            usd_single: false,
            attributes: Vec::new(),
            triangles: false,
        },
        resolved: String::new(),
        warnings: Vec::new(),
        check: CheckDescription::default(),
        body_thickness: Vec::new(),
    }
}

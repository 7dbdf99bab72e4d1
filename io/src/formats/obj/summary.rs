//! Summary of an OBJ file.

use std::path::Path;

use super::read::ObjMesh;
use crate::error::IoError;
use crate::file_summary::{FileSummary, MeshSummary, Normals, bounds, face_kinds};
use crate::mesh_data::MeshReader;

/// Looks into a file.
///
/// # Errors
/// It cannot be read or is damaged.
pub(super) fn summary(path: &Path) -> Result<FileSummary, IoError> {
    let mesh = ObjMesh::open(path)?;
    let data = mesh.mesh_at(0.0)?;
    let summary = MeshSummary {
        path: mesh.objects().concat(),
        points: data.mesh.points.len(),
        faces: face_kinds(&data.mesh.face_counts),
        topology: "constant",
        samples: 1,
        bounds: bounds(&data.mesh.points),
        uvs: data.uvs.map(|uvs| ("uv".to_owned(), uvs.values.len())),
        normals: Normals::of(mesh.has_normals()?, data.split_normals.is_some()),
        face_sets: data.face_sets.into_iter().map(|set| (set.name, set.faces.len())).collect(),
        ..MeshSummary::default()
    };
    Ok(FileSummary { format: "Wavefront OBJ", meshes: vec![summary], ..FileSummary::default() })
}

//! Summary of an Alembic file.

use std::path::Path;

use drapery_alembic::{Archive, PolyMesh, Schema, TopologyVariance};
use drapery_core::Vec3;

use super::channel;
use super::read::{INVISIBLE, split_normals};
use super::read_back::times_of;
use crate::error::IoError;
use crate::file_summary::{FileSummary, MeshSummary, Normals, bounds, face_kinds};

/// Looks into an archive.
///
/// # Errors
/// The file cannot be opened or contradicts itself.
pub(super) fn summary(path: &Path) -> Result<FileSummary, IoError> {
    let archive = Archive::open(path)?;
    let mut properties: Vec<(String, String)> = archive
        .metadata()
        .iter()
        .map(|(key, value)| (key.trim_start_matches("_ai_").to_owned(), value.to_owned()))
        .collect();
    let version = archive.library_version();
    let [major, minor, patch] = [version / 10_000, version / 100 % 100, version % 100];
    properties.push(("Alembic version".into(), format!("{major}.{minor}.{patch}")));
    let others = archive
        .objects()
        .filter(|o| !matches!(o.schema(), Schema::PolyMesh | Schema::SubD | Schema::FaceSet))
        .map(|o| (o.path().to_owned(), format!("{:?}", o.schema())))
        .collect();
    let meshes = PolyMesh::all(&archive)?.iter().map(alembic_mesh).collect::<Result<_, _>>()?;
    let channels = channel::all(&archive)?;
    Ok(FileSummary { format: "Alembic (Ogawa)", properties, meshes, others, channels })
}

fn alembic_mesh(mesh: &PolyMesh) -> Result<MeshSummary, IoError> {
    let (count, times) = (mesh.sample_count(), times_of(mesh)?);
    let path = mesh.object().path();
    let mut summary = MeshSummary {
        path: match mesh.object().is_hidden()? {
            true => format!("{path} (not read: {INVISIBLE})"),
            false => path.to_owned(),
        },
        samples: times.len(),
        topology: match mesh.topology_variance() {
            TopologyVariance::Constant if times.len() > 1 => "constant, moved by its parents",
            TopologyVariance::Constant => "constant",
            TopologyVariance::Homogeneous => "constant faces, moving points",
            TopologyVariance::Heterogeneous => "changing",
        },
        uvs: mesh
            .uv()
            .map(|uv| (uv.source_name().unwrap_or("uv").to_owned(), uv.samples().element_count(0).unwrap_or(0))),
        face_sets: mesh.face_sets()?.into_iter().map(|set| (set.name, set.faces.len())).collect(),
        attributes: mesh.attributes().iter().map(|param| param.name().to_owned()).collect(),
        ..MeshSummary::default()
    };
    if count > 0 {
        let points: Vec<Vec3> = mesh.world_positions(0)?.into_iter().map(Vec3::from).collect();
        summary.points = points.len();
        let faces = mesh.faces(0)?;
        summary.faces = face_kinds(&faces.face_counts);
        summary.normals =
            Normals::of(mesh.normals().is_some(), split_normals(mesh, 0, &faces, points.len())?.is_some());
        summary.times = times.first().zip(times.last()).map(|(first, last)| [*first, *last]);
        summary.bounds = bounds(&points);
        summary.velocities = mesh.velocities(0)?.is_some();
    }
    Ok(summary)
}

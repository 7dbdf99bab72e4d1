//! What a mesh or cache file holds, for `drapery info`.

use std::path::Path;

use drapery_alembic::{Archive, PolyMesh, Schema, TopologyVariance};
use drapery_core::Vec3;
use serde::Serialize;

use crate::cache::MeshReader;
use crate::error::IoError;
use crate::formats::obj::ObjMesh;
use crate::input_file;

/// What a file holds.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FileSummary {
    /// Its format.
    pub format: &'static str,
    /// Who wrote it, how it counts frames, and the like: name and value.
    pub properties: Vec<(String, String)>,
    /// Its meshes.
    pub meshes: Vec<MeshSummary>,
    /// Objects that are no meshes: path and kind.
    pub others: Vec<(String, String)>,
}

/// A mesh of a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MeshSummary {
    /// Full path of the object.
    pub path: String,
    /// Number of points of the first sample.
    pub points: usize,
    /// Faces with three, four, and more corners.
    pub faces: [usize; 3],
    /// Whether points and faces change.
    pub topology: &'static str,
    /// Number of samples of the points.
    pub samples: usize,
    /// Times of the first and the last sample [s].
    pub times: [f64; 2],
    /// Smallest and largest coordinates of the first sample, in world space and the file's unit.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Name of the UV set and number of its values.
    pub uvs: Option<(String, usize)>,
    /// Face sets and their number of faces.
    pub face_sets: Vec<(String, usize)>,
    /// Names of other attributes.
    pub attributes: Vec<String>,
    /// Whether velocities are stored.
    pub velocities: bool,
}

/// Looks into a file.
///
/// # Errors
/// The file is missing, damaged, or of a format that is not read here.
pub fn inspect(path: &Path) -> Result<FileSummary, IoError> {
    input_file::open(path)?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match extension.as_str() {
        "abc" => inspect_alembic(path),
        "obj" => inspect_obj(path),
        "h5" => crate::formats::hdf5::inspect(path),
        _ => Err(IoError::Format {
            path: path.to_owned(),
            what: format!("files of the kind .{extension} cannot be looked into"),
            advice: "give an .abc, .obj or .h5 file".into(),
        }),
    }
}

fn inspect_alembic(path: &Path) -> Result<FileSummary, IoError> {
    let archive = Archive::open(path)?;
    let mut properties: Vec<(String, String)> = archive
        .metadata()
        .iter()
        .map(|(key, value)| (key.trim_start_matches("_ai_").to_owned(), value.to_owned()))
        .collect();
    properties.push(("library".into(), archive.library_version().to_string()));
    let others = archive
        .objects()
        .filter(|o| !matches!(o.schema(), Schema::PolyMesh | Schema::SubD | Schema::FaceSet))
        .map(|o| (o.path().to_owned(), format!("{:?}", o.schema())))
        .collect();
    let meshes = PolyMesh::all(&archive)?.iter().map(alembic_mesh).collect::<Result<_, _>>()?;
    Ok(FileSummary { format: "Alembic (Ogawa)", properties, meshes, others })
}

fn alembic_mesh(mesh: &PolyMesh) -> Result<MeshSummary, IoError> {
    let count = mesh.sample_count();
    let mut summary = MeshSummary {
        path: mesh.object().path().to_owned(),
        samples: count,
        topology: match mesh.topology_variance() {
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
        summary.faces = face_kinds(&mesh.faces(0)?.face_counts);
        summary.times = [mesh.time(0), mesh.time(count - 1)];
        summary.bounds = bounds(&points);
        summary.velocities = mesh.velocities(0)?.is_some();
    }
    Ok(summary)
}

fn inspect_obj(path: &Path) -> Result<FileSummary, IoError> {
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
        face_sets: data.face_sets.into_iter().map(|set| (set.name, set.faces.len())).collect(),
        ..MeshSummary::default()
    };
    Ok(FileSummary { format: "Wavefront OBJ", meshes: vec![summary], ..FileSummary::default() })
}

/// Faces with three, four, and more corners.
pub(crate) fn face_kinds(counts: &[u32]) -> [usize; 3] {
    let number = |test: fn(u32) -> bool| counts.iter().filter(|&&count| test(count)).count();
    [number(|c| c <= 3), number(|c| c == 4), number(|c| c > 4)]
}

fn bounds(points: &[Vec3]) -> Option<[[f64; 3]; 2]> {
    let first = *points.first()?;
    let (low, high) = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    Some([low.into(), high.into()])
}

//! Scene files and meshes that cases of the command start from.

use std::path::Path;

use drapery_alembic::{
    AlembicError, ArchiveOptions, ArchiveWriter, Durability, IDENTITY, Matrix, PolyMeshSample, PolyMeshWriter,
    TimeSampling, Topology, XformWriter,
};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;

/// A garment from an OBJ file over a body from an OBJ file, frames 1 to 3.
pub const FROM_FILES: &str = r#"drapery = 1
[shot]
name = "files"
frames = "1-3"
[units]
length = "m"
[gravity]
[[body]]
name = "hero"
file = "body.obj"
[[garment]]
name = "skirt"
rest = "skirt.obj"
density = "0.15 kg/m²"
[garment.stretch]
stiffness = "100 N/m"
[output]
format = ["abc"]
"#;

/// A falling panel over a ball, frames 1001 to 1004.
pub const SHEET: &str = r#"drapery = 1
[parameters]
resolution = 6
[shot]
name = "sheet"
frames = "1001-1004"
[gravity]
[[body]]
name = "ball"
shape = { sphere = { radius = 0.2 } }
position = [0.8, 0.0, 0.5]
friction = 0.4
[[garment]]
name = "sheet"
panel = { resolution = "$resolution" }
density = "0.15 kg/m²"
[garment.stretch]
stiffness = "100 N/m"
[output]
format = ["abc"]
"#;

/// A closed body 1.7 m high, faces outwards.
pub const BODY: &str = "v 0 0 0\nv 0.5 0 0\nv 0 0 0.5\nv 0 1.7 0\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";

/// A square of cloth beside the body.
pub const SKIRT: &str = "v 2 1 0\nv 3 1 0\nv 3 1 1\nv 2 1 1\nf 1 4 3 2\n";

/// A mesh as the text of an OBJ file.
pub fn obj(mesh: &PolygonMesh) -> String {
    let points = mesh.points.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    let corners = |face: &[u32]| face.iter().map(|v| format!(" {}", v + 1)).collect::<String>();
    points.chain(mesh.faces().map(|face| format!("f{}\n", corners(face)))).collect()
}

/// A frame of an archive.
#[derive(Debug, Clone)]
pub struct ArchiveFrame {
    /// Transform that places the mesh.
    pub matrix: Matrix,
    /// Triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Points [m].
    pub points: Vec<Vec3>,
}

impl ArchiveFrame {
    /// A frame of a mesh that stands where its points are.
    pub fn of(triangles: &[[u32; 3]], points: Vec<Vec3>) -> Self {
        Self { matrix: IDENTITY, triangles: triangles.to_vec(), points }
    }
}

/// Writes a body as an Alembic archive, one sample a frame from frame 1 on, at 24 frames a second.
///
/// # Errors
/// The disk is full.
pub fn write_archive(path: &Path, frames: &[ArchiveFrame]) -> Result<(), String> {
    let write = || -> Result<(), AlembicError> {
        let mut archive = ArchiveWriter::create(path, &ArchiveOptions::default())?;
        let sampling = archive.add_time_sampling(TimeSampling::frames(1.0, 24.0)?)?;
        let root = archive.root();
        let xform = XformWriter::declare(&mut archive, root, "hero", sampling)?;
        let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "heroShape", sampling)?;
        for frame in frames {
            xform.write(&mut archive, &frame.matrix)?;
            // Alembic winds faces the other way round.
            let indices: Vec<i32> = frame.triangles.iter().flat_map(|&[a, b, c]| [a, c, b]).map(|v| v as i32).collect();
            let counts = vec![3; frame.triangles.len()];
            let points: Vec<[f32; 3]> = frame.points.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
            let topology = Some(Topology { face_counts: &counts, face_indices: &indices });
            mesh.write(&mut archive, &PolyMeshSample { topology, ..PolyMeshSample::of(&points) })?;
        }
        archive.finish(Durability::Flushed)
    };
    write().map_err(|e| format!("{}: {e}", path.display()))
}

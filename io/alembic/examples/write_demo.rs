//! Writes a set of small archives for checks with other programs: `write_demo <folder>`.
//!
//! * `demo.abc`: a waving cloth under a moving transform, 6 frames from 1001 at 24 frames per second, committed frame
//!   by frame, with UVs, normals, velocities, face sets, attributes, user properties and bounds;
//! * `continued.abc`: the same, closed after 3 frames and continued; its bytes equal those of `demo.abc`;
//! * `killed.abc`: the same, left after 3 commits with a fourth frame half written;
//! * `changing.abc`: another number of points in every sample, at irregular times;
//! * `patterns.abc`: every sequence of up to six samples over three values, as scalar and as array.

use std::path::Path;

use drapery_alembic::*;

/// Vertices along one side.
const SIDE: usize = 5;
const FRAMES: usize = 6;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: write_demo <folder>")?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    write_demo(ArchiveWriter::create(folder.join("demo.abc"), &options())?, 0..FRAMES, true)?;

    let continued = folder.join("continued.abc");
    write_demo(ArchiveWriter::create(&continued, &options())?, 0..3, true)?;
    write_demo(ArchiveWriter::append(&continued)?, 3..FRAMES, true)?;

    write_demo(ArchiveWriter::create(folder.join("killed.abc"), &options())?, 0..4, false)?;
    write_changing(&folder.join("changing.abc"))?;
    write_patterns(&folder.join("patterns.abc"))?;
    Ok(())
}

fn options() -> ArchiveOptions {
    ArchiveOptions {
        application: "Drapery demo".into(),
        description: "waving cloth".into(),
        frames_per_second: Some(24.0),
        extra: MetaData::new().with("metersPerUnit", "1"),
        ..ArchiveOptions::default()
    }
}

/// Writes `frames` of the cloth. Without `finish`, the last one is not committed, as if the process had been killed.
fn write_demo(mut archive: ArchiveWriter, frames: std::ops::Range<usize>, finish: bool) -> Result<(), AlembicError> {
    let sampling = archive.add_time_sampling(TimeSampling::frames(1001.0, 24.0)?)?;
    let root = archive.root();
    let xform = XformWriter::declare(&mut archive, root, "cloth", sampling)?;
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "clothShape", sampling)?;
    let visible = archive.add_visibility(xform.object(), 0)?;
    if archive.sample_count(visible) == 0 {
        archive.write_visibility(visible, Visibility::Visible)?;
    }
    write_statics(&mut archive, &mesh)?;

    let cloth = Cloth::new();
    let last = frames.end - 1;
    for frame in frames {
        let [positions, velocities, normals] = cloth.at(frame);
        xform.write(&mut archive, &moved_by(frame))?;
        let topology = Topology { face_counts: &cloth.face_counts, face_indices: &cloth.face_indices };
        let uv = Indexed {
            values: &cloth.uv,
            indices: Some(&cloth.uv_indices),
            scope: Scope::FaceVarying,
            source_name: Some("map1"),
        };
        let sample = PolyMeshSample {
            topology: (frame == 0).then_some(topology),
            velocities: Some(&velocities),
            uv: (frame == 0).then_some(uv),
            normals: Some(Indexed { values: &normals, indices: None, scope: Scope::Vertex, source_name: None }),
            ..PolyMeshSample::of(&positions)
        };
        mesh.write(&mut archive, &sample)?;
        archive.write_archive_bounds(sampling, &world_bounds(&positions, &moved_by(frame)))?;
        if frame < last || finish {
            archive.commit(Durability::Flushed)?;
        }
    }
    if finish { archive.finish(Durability::Synced) } else { Ok(()) }
}

/// Writes the data that does not change from frame to frame.
fn write_statics(archive: &mut ArchiveWriter, mesh: &PolyMeshWriter) -> Result<(), AlembicError> {
    let faces = ((SIDE - 1) * (SIDE - 1)) as i32;
    let (front, back): (Vec<i32>, Vec<i32>) = (0..faces).partition(|face| face % 4 < 2);
    write_face_set(archive, mesh.object(), "front", &front, true)?;
    write_face_set(archive, mesh.object(), "back", &back, true)?;

    let attributes = mesh.attributes(archive)?;
    let spec = |name, scope, pod, extent, interpretation: Interpretation| GeomParamSpec {
        name,
        scope,
        data_type: DataType::new(pod, extent),
        interpretation: interpretation.name(),
        source_name: None,
        indexed: false,
        time_sampling: 0,
    };
    let le = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let vertices = SIDE * SIDE;
    let weight: Vec<f32> = (0..vertices).map(|vertex| vertex as f32 / vertices as f32).collect();
    let plain = Interpretation::Plain;
    let param = GeomParamWriter::declare(archive, attributes, &spec("weight", Scope::Vertex, PodType::F32, 1, plain))?;
    param.write_static(archive, &le(&weight), None)?;
    let rgb = spec("colour", Scope::Constant, PodType::F32, 3, Interpretation::Rgb);
    GeomParamWriter::declare(archive, attributes, &rgb)?.write_static(archive, &le(&[0.25, 0.5, 1.0]), None)?;
    let panel: Vec<u8> = (0..faces).flat_map(|face| (face % 3).to_le_bytes()).collect();
    let param = GeomParamWriter::declare(archive, attributes, &spec("panel", Scope::Uniform, PodType::I32, 1, plain))?;
    param.write_static(archive, &panel, None)?;
    let fabric = spec("fabric", Scope::Uniform, PodType::String, 1, plain);
    let fabric = GeomParamSpec { indexed: true, ..fabric };
    let indices: Vec<u32> = (0..faces as u32).map(|face| face % 2).collect();
    GeomParamWriter::declare(archive, attributes, &fabric)?.write_static(archive, b"wool\0silk\0", Some(&indices))?;

    let user = mesh.user_properties(archive)?;
    archive.write_static_string(user, "solver", "Drapery")?;
    archive.write_static_scalar(user, "metersPerUnit", &[1.0_f64])?;
    archive.write_static_scalar(user, "gravity", &[0.0_f64, -9.81, 0.0])
}

struct Cloth {
    face_counts: Vec<i32>,
    face_indices: Vec<i32>,
    uv: Vec<[f32; 2]>,
    uv_indices: Vec<u32>,
}

impl Cloth {
    /// A grid of quads in the plane y = 0, clockwise seen from above.
    fn new() -> Self {
        let mut face_indices = Vec::new();
        for row in 0..SIDE - 1 {
            for column in 0..SIDE - 1 {
                let corner = row * SIDE + column;
                face_indices.extend([corner, corner + 1, corner + SIDE + 1, corner + SIDE].map(|v| v as i32));
            }
        }
        let step = 1.0 / (SIDE - 1) as f32;
        Self {
            face_counts: vec![4; face_indices.len() / 4],
            uv: (0..SIDE * SIDE).map(|v| [(v % SIDE) as f32 * step, (v / SIDE) as f32 * step]).collect(),
            uv_indices: face_indices.iter().map(|&v| v as u32).collect(),
            face_indices,
        }
    }

    /// Positions, velocities and normals of a frame.
    fn at(&self, frame: usize) -> [Vec<[f32; 3]>; 3] {
        let height = |x: f32, frame: f32| 0.125 * x * frame;
        let positions = self.uv.iter().map(|&[x, z]| [x, height(x, frame as f32), z]);
        let velocities = self.uv.iter().map(|&[x, _]| [0.0, height(x, 24.0), 0.0]);
        let slope = 0.125 * frame as f32;
        let length = (1.0 + slope * slope).sqrt();
        let normals = self.uv.iter().map(|_| [-slope / length, 1.0 / length, 0.0]);
        [positions.collect(), velocities.collect(), normals.collect()]
    }
}

/// The cloth moves along z, a quarter of a unit every frame.
fn moved_by(frame: usize) -> Matrix {
    let mut matrix = IDENTITY;
    matrix[14] = 0.25 * frame as f64;
    matrix
}

fn world_bounds(positions: &[[f32; 3]], matrix: &Matrix) -> Bounds {
    let mut bounds = EMPTY_BOUNDS;
    for position in positions {
        let world = transform_point(position.map(f64::from), matrix);
        for axis in 0..3 {
            bounds[axis] = bounds[axis].min(world[axis]);
            bounds[axis + 3] = bounds[axis + 3].max(world[axis]);
        }
    }
    bounds
}

/// A fan of triangles that gains one in every sample.
fn write_changing(path: &Path) -> Result<(), AlembicError> {
    let mut archive = ArchiveWriter::create(path, &options())?;
    let sampling = archive.add_time_sampling(TimeSampling::acyclic(vec![0.0, 0.1, 0.25, 0.7])?)?;
    let root = archive.root();
    let xform = XformWriter::still(&mut archive, root, "fan", None)?;
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "fanShape", sampling)?;
    for triangles in 0..4_i32 {
        let rim = (0..=triangles).map(|i| [(0.5 * i as f32).cos(), 0.0, (0.5 * i as f32).sin()]);
        let positions: Vec<[f32; 3]> =
            if triangles == 0 { vec![] } else { [[0.0; 3]].into_iter().chain(rim).collect() };
        let face_indices: Vec<i32> = (0..triangles).flat_map(|i| [0, i + 1, i + 2]).collect();
        let topology = Topology { face_counts: &vec![3; triangles as usize], face_indices: &face_indices };
        mesh.write(&mut archive, &PolyMeshSample { topology: Some(topology), ..PolyMeshSample::of(&positions) })?;
    }
    archive.finish(Durability::Synced)
}

/// Property `s_0_1_2` is a scalar with the samples 0, 1, 2; `a_0_1_2` an array with these numbers of elements in its samples.
fn write_patterns(path: &Path) -> Result<(), AlembicError> {
    let mut archive = ArchiveWriter::create(path, &options())?;
    let sampling = archive.add_time_sampling(TimeSampling::frames(0.0, 24.0)?)?;
    let top = archive.top_compound(archive.root());
    let (int, none) = (DataType::new(PodType::I32, 1), MetaData::new());
    for length in 1..=6_u32 {
        for code in 0..3_i32.pow(length) {
            let values: Vec<i32> = (0..length).map(|digit| code / 3_i32.pow(digit) % 3).collect();
            let name: String = values.iter().map(|value| format!("_{value}")).collect();
            let scalar = archive.add_scalar_property(top, &format!("s{name}"), &none, int, sampling)?;
            let array = archive.add_array_property(top, &format!("a{name}"), &none, int, sampling)?;
            for value in values {
                archive.write_sample(scalar, &[value])?;
                archive.write_sample(array, &vec![7; value as usize])?;
            }
        }
    }
    archive.finish(Durability::Synced)
}

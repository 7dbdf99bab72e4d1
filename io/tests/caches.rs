//! The Alembic hand-off: what an artist's mesh brings comes back moving, and the file is valid after every frame.

use std::path::{Path, PathBuf};

use drapery_alembic::{Archive, PolyMesh, TopologyVariance};
use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use drapery_io::cache::{CacheFrame, CachePlan, CacheWriter};
use drapery_io::formats::alembic::AlembicWriter;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::{DataType, MeshData, MeshParam, Scope};
use drapery_io::mesh_source::MeshSource;
use drapery_io::units::{LengthUnit, Units, UpAxis};

const SOURCE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nv 3 0.5 0\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
    usemtl front\nf 1/1 2/2 3/3 4/4\nf 2/1 5/2 6/3 3/4\nusemtl trim\nf 5/1 7/2 6/3\n";

fn source(folder: &Path) -> MeshData {
    let path = folder.join("skirt.obj");
    std::fs::write(&path, SOURCE).unwrap();
    let mut data = MeshSource::open(&path, None, Units::SI).unwrap().mesh_at(0.0).unwrap();
    data.object_path = "/garments/skirt/skirtShape".into();
    data.params.push(MeshParam {
        name: "panelId".into(),
        scope: Scope::Uniform,
        data_type: DataType::new(drapery_alembic::PodType::I32, 1),
        interpretation: String::new(),
        source_name: None,
        values: [7_i32, 8, 9].iter().flat_map(|v| v.to_le_bytes()).collect(),
        indices: None,
    });
    data
}

fn write(folder: &Path, name: &str, frames: i64, finish: bool) -> PathBuf {
    let data = source(folder);
    let plan = CachePlan {
        sub_frames: &[],
        garment: "skirt",
        mesh: &GarmentMesh::kept(data.clone()),
        units: Units { length: LengthUnit::Centimetre, up: UpAxis::Y },
        origin: Vec3::zeros(),
        timeline: Timeline { fps_numerator: 24000, fps_denominator: 1001, ..Timeline::default() },
        first_frame: 1001,
        last_frame: 1010,
        velocities: true,
        normals: false,
        crossings: true,
        attributes: Default::default(),
    };
    let path = folder.join(name);
    let mut writer = AlembicWriter::create(&path, &plan).unwrap();
    assert!(!path.exists(), "an archive without samples would be refused by those who load it");
    for frame in 1001..1001 + frames {
        let positions: Vec<Vec3> = data.mesh.points.iter().map(|p| p + Vec3::z() * (frame - 1000) as f64).collect();
        let velocities = vec![Vec3::new(0.0, 0.0, 0.5); positions.len()];
        let crossings = Some(if frame == 1002 { 5 } else { 0 });
        let [positions, velocities] = [positions, velocities].map(|vectors| plan.units.stored_all(&vectors));
        writer
            .write(&CacheFrame {
                frame,
                sub_frame: 0,
                positions: &positions,
                velocities: &velocities,
                normals: &[],
                crossings,
                values: Default::default(),
            })
            .unwrap();
        // Valid after every frame.
        let mesh = PolyMesh::open(&Archive::open(&path).unwrap(), "/garments/skirt/skirtShape").unwrap();
        assert_eq!(mesh.sample_count() as i64, frame - 1000);
    }
    if finish {
        writer.finish().unwrap();
    }
    path
}

#[test]
fn topology_uvs_face_sets_and_attributes_come_back_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "skirt.abc", 2, true);
    let sent = source(folder.path());
    let back = MeshSource::open(&path, None, Units { length: LengthUnit::Centimetre, up: UpAxis::Y }).unwrap();
    let data = back.mesh_at(1001.0 * 1001.0 / 24000.0).unwrap();
    assert_eq!(data.object_path, sent.object_path);
    assert_eq!(data.mesh.face_counts, sent.mesh.face_counts);
    assert_eq!(data.mesh.face_indices, sent.mesh.face_indices);
    assert_eq!((data.uvs, data.face_sets, data.params), (sent.uvs, sent.face_sets, sent.params));
    assert!((data.mesh.points[6] - Vec3::new(3.0, 0.5, 1.0)).norm() < 1e-6);
}

#[test]
fn the_stored_file_keeps_the_hand_off_rules() {
    let folder = tempfile::tempdir().unwrap();
    let archive = Archive::open(write(folder.path(), "skirt.abc", 3, false)).unwrap();
    let mesh = PolyMesh::open(&archive, "/garments/skirt/skirtShape").unwrap();
    assert_eq!(mesh.topology_variance(), TopologyVariance::Homogeneous);
    // Clockwise in the file: the corners of each face run backwards.
    assert_eq!(mesh.face_indices(0).unwrap()[..4], [3, 2, 1, 0]);
    // frame / fps, from the first delivered frame on.
    let period = 1001.0 / 24000.0;
    assert!(mesh.times().iter().enumerate().all(|(i, t)| (t - (1001 + i) as f64 * period).abs() < 1e-12));
    for sample in 0..3 {
        let velocities = mesh.velocities(sample).unwrap().expect("velocities in every sample");
        assert_eq!(velocities, vec![[0.0, 0.0, 50.0]; 7]);
        let height = 100.0 * (sample + 1) as f64;
        assert_eq!(mesh.bounds(sample).unwrap(), Some([0.0, 0.0, height, 300.0, 100.0, height]));
        let all = archive.bounds().unwrap().unwrap();
        assert_eq!(all.elements::<f64, 6>(sample).unwrap()[0], mesh.bounds(sample).unwrap().unwrap());
    }
    assert!(archive.application().starts_with("Drapery "));
    assert_eq!(archive.metadata().get("_ai_DateWritten"), None);
    assert!((archive.frames_per_second_hint().unwrap() - 23.976).abs() < 1e-3);
    let properties = mesh.user_properties().unwrap();
    assert_eq!(properties.samples("length_unit").unwrap().strings(0).unwrap(), ["cm"]);
    // What was simulated, and the count of crossings with every frame.
    let triangles = properties.samples("triangles").unwrap().elements::<i32, 3>(0).unwrap();
    // Of diagonals that are equally long the first; corners are counter-clockwise.
    assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2], [4, 6, 5]]);
    let crossings = properties.samples("crossings").unwrap();
    let counts: Vec<u32> = (0..3).map(|sample| crossings.values::<u32>(sample).unwrap()[0]).collect();
    assert_eq!((counts, crossings.time_sampling().time(1)), (vec![0, 5, 0], mesh.time(1)));
}

#[test]
fn equal_runs_give_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name| std::fs::read(write(folder.path(), name, 2, true)).unwrap();
    assert!(read("a.abc") == read("b.abc"));
}

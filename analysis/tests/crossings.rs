//! `verify` finds where cloth passes through cloth, and only there; runs count it in what they write.

#[path = "../../shot/tests/common/mod.rs"]
mod common;

use std::path::{Path, PathBuf};

use drapery_alembic::{
    Archive, ArchiveOptions, ArchiveWriter, DataType, Durability, MetaData, PodType, PolyMesh, PolyMeshSample,
    PolyMeshWriter, TimeSampling, Topology, XformWriter,
};
use drapery_analysis::verify::{Verification, verify};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{ContactRule, ContactSide, EffectRequest, GarmentDescription, SceneDescription, Timeline};
use drapery_io::shot_description::ShotDescription;
use drapery_io::units::Units;
use drapery_shot::Shot;
use drapery_shot::run::{FrameReport, RunOptions};

use common::described;

type Points = Vec<[f32; 3]>;

/// Number of corners of each face, and its points.
type Faces = (&'static [i32], &'static [i32]);

/// A triangle in the plane y = 0, alone.
const FLOOR: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]];

/// A triangle above it, whose lowest corner is number 2.
fn spike(tip: f32) -> Points {
    vec![[0.5, 1.0, 0.5], [0.6, 1.0, 0.5], [0.5, tip, 0.6]]
}

/// A mesh that is written.
struct Mesh<'a> {
    name: &'a str,
    /// Points of each frame, from frame 1001 on at 24 a second.
    frames: &'a [Points],
    /// Number of corners of each face, and its points.
    faces: (&'a [i32], &'a [i32]),
    /// Translation along y that its parent gives it.
    shift: f64,
    /// User property with triangles.
    triangles: &'a [i32],
    /// User property with the garment that it is the render mesh of.
    follows: Option<&'a str>,
    first_frame: f64,
}

impl<'a> Mesh<'a> {
    fn new(name: &'a str, frames: &'a [Points], faces: (&'a [i32], &'a [i32])) -> Self {
        Self { name, frames, faces, shift: 0.0, triangles: &[], follows: None, first_frame: 1001.0 }
    }

    fn write(&self, archive: &mut ArchiveWriter) {
        let sampling = archive.add_time_sampling(TimeSampling::frames(self.first_frame, 24.0).unwrap()).unwrap();
        let mut matrix = drapery_alembic::IDENTITY;
        matrix[13] = self.shift;
        let root = archive.root();
        let parent = XformWriter::still(archive, root, self.name, Some(&matrix)).unwrap().object();
        let mut mesh = PolyMeshWriter::declare(archive, parent, "shape", sampling).unwrap();
        for points in self.frames {
            let topology = Some(Topology { face_counts: self.faces.0, face_indices: self.faces.1 });
            mesh.write(archive, &PolyMeshSample { topology, ..PolyMeshSample::of(points) }).unwrap();
        }
        if !self.triangles.is_empty() {
            let properties = mesh.user_properties(archive).unwrap();
            let kind = DataType::new(PodType::I32, 3);
            let property = archive.add_array_property(properties, "triangles", &MetaData::new(), kind, 0).unwrap();
            archive.write_sample(property, self.triangles).unwrap();
        }
        if let Some(garment) = self.follows {
            let properties = mesh.user_properties(archive).unwrap();
            archive.write_static_string(properties, "render_mesh_of", garment).unwrap();
        }
    }
}

fn file(folder: &Path, name: &str, meshes: &[Mesh<'_>]) -> PathBuf {
    let path = folder.join(name);
    let options = ArchiveOptions { frames_per_second: Some(24.0), ..ArchiveOptions::default() };
    let mut archive = ArchiveWriter::create(&path, &options).unwrap();
    meshes.iter().for_each(|mesh| mesh.write(&mut archive));
    archive.finish(Durability::Flushed).unwrap();
    path
}

fn verified(meshes: &[Mesh<'_>]) -> Verification {
    let folder = tempfile::tempdir().unwrap();
    verify(&[&file(folder.path(), "a.abc", meshes)], None).unwrap()
}

#[test]
fn what_crosses_along_the_other_diagonal_alone_is_found_with_its_faces_and_told_apart() {
    // The diagonal from 0 to 2 is the shorter one, at height 0; that from 1 to 3 is at 0.4. A spike hangs to between them.
    let at = |tip: f32| -> Points {
        let quad = [[-0.9, 0.0, 0.0], [0.0, 0.4, -1.0], [0.9, 0.0, 0.0], [0.0, 0.4, 1.0]];
        let spike = [[0.1, 1.0, 0.02], [0.1, 1.0, 0.12], [0.01, tip, 0.02]];
        quad.into_iter().chain(spike).collect()
    };
    let faces: (&[i32], &[i32]) = (&[4, 3], &[0, 1, 2, 3, 4, 5, 6]);
    let clean = verified(&[Mesh::new("cloth", &[at(0.5)], faces)]);
    assert!(clean.failures.is_empty(), "{:?}", clean.failures);
    let words = "no intersections where quads are cut along the other diagonal and larger faces into fans, in 1 of 1";
    assert!(clean.facts.iter().any(|fact| fact.starts_with(words)), "{:?}", clean.facts);
    let found = verified(&[Mesh::new("cloth", &[at(0.5), at(0.2)], faces)]);
    assert!(found.facts.iter().any(|fact| fact == "/cloth/shape: 3 triangles, no intersections in 2 frames"));
    assert!(found.failures.is_empty(), "{:?}", found.failures);
    let is_about_it = |text: &&String| text.contains("along the other diagonal");
    let message = found.warnings.iter().find(is_about_it).expect("a warning");
    let expected = "/cloth/shape: the cloth intersects itself if faces are cut along the other diagonal, as renderers may do, in 1 \
                    of 2 frames";
    assert!(message.starts_with(expected) && message.contains("frame 1002, edge"), "{message}");
    assert!(
        message.contains("face 0") && message.contains("face 1") && message.contains("faces = \"triangles\""),
        "{message}"
    );
    let triangles: (&[i32], &[i32]) = (&[3, 3, 3], &[0, 1, 2, 0, 2, 3, 4, 5, 6]);
    let cut = verified(&[Mesh::new("cloth", &[at(0.5), at(0.2)], triangles)]);
    assert!(cut.failures.is_empty() && !cut.warnings.iter().any(|text| is_about_it(&text)), "{:?}", cut.warnings);
}

fn joined(tips: &[f32]) -> Vec<Points> {
    tips.iter().map(|&tip| [FLOOR.to_vec(), spike(tip)].concat()).collect()
}

#[test]
fn a_mesh_that_passes_through_itself_is_found_with_frame_edge_and_triangle() {
    let faces: (&[i32], &[i32]) = (&[3, 3], &[0, 1, 2, 3, 4, 5]);
    let clean = verified(&[Mesh::new("cloth", &joined(&[0.5, 0.1, 1e-30, 0.2]), faces)]);
    assert!(clean.failures.is_empty(), "{:?}", clean.failures);
    assert!(clean.facts.iter().any(|fact| fact == "/cloth/shape: 2 triangles, no intersections in 4 frames"));
    let found = verified(&[Mesh::new("cloth", &joined(&[0.5, 0.1, 0.0, -0.1, 0.1]), faces)]);
    assert_eq!(found.failures.len(), 1);
    let expected = "/cloth/shape: the cloth intersects itself in 2 of 5 frames, at most 2 intersections (frame 1003); first: \
                    frame 1003, edge 3-5 through triangle 2-1-0";
    assert_eq!(found.failures[0], expected);
}

#[test]
fn meshes_of_several_files_are_judged_together_where_their_parents_put_them() {
    let faces: (&[i32], &[i32]) = (&[3], &[0, 1, 2]);
    let (floor, low, high) = (vec![FLOOR.to_vec(); 2], vec![spike(0.5), spike(-0.5)], vec![spike(0.5); 2]);
    let folder = tempfile::tempdir().unwrap();
    let still = file(folder.path(), "floor.abc", &[Mesh::new("floor", &floor, faces)]);
    for (frames, shift, crosses) in [(&low, 0.0, true), (&low, 2.0, false), (&high, 0.0, false), (&high, -0.75, true)] {
        let moving = Mesh { shift, ..Mesh::new("spike", frames, faces) };
        let moving = file(folder.path(), "spike.abc", &[moving]);
        let found = verify(&[&still, &moving], None).unwrap();
        assert_eq!(!found.failures.is_empty(), crosses, "{shift}: {:?}", found.failures);
        if crosses {
            assert!(found.failures[0].starts_with("floor.abc: /floor/shape and spike.abc: /spike/shape intersect in "));
        }
        // The same mesh as a body is reported, not judged.
        let found = verify(&[&moving], Some(&still)).unwrap();
        assert!(found.failures.is_empty());
        assert_eq!(found.warnings.iter().any(|text| text.contains("and the body intersect in")), crosses);
    }
}

#[test]
fn a_render_mesh_is_no_cloth_and_what_it_crosses_is_told_and_not_judged() {
    let (whole, one): (Faces, Faces) = ((&[3, 3], &[0, 1, 2, 3, 4, 5]), (&[3], &[0, 1, 2]));
    let (shell, cloth) = (joined(&[0.5, -0.5]), [spike(0.5), spike(-0.5)]);
    let follows =
        |follows| [Mesh { follows, ..Mesh::new("coat_render", &shell, whole) }, Mesh::new("coat", &cloth, one)];
    assert_eq!(verified(&follows(None)).failures.len(), 2);
    let found = verified(&follows(Some("coat")));
    assert_eq!(found.failures, [] as [String; 0]);
    let shell = "/coat_render/shape (render mesh of coat, reported only)";
    for expected in
        [format!("{shell}: its layers intersect in 1 of 2 frames"), format!("{shell} and /coat/shape intersect in ")]
    {
        assert!(found.facts.iter().any(|fact| fact.starts_with(&expected)), "{:?}", found.facts);
    }
}

#[test]
fn meshes_without_a_common_time_cannot_be_judged_and_that_is_a_failure() {
    let faces: (&[i32], &[i32]) = (&[3], &[0, 1, 2]);
    let frames: Vec<Points> = [0.5, 0.6, 0.7].map(spike).to_vec();
    let moved = |first_frame: f64| Mesh { first_frame, shift: 3.0, ..Mesh::new("other", &frames, faces) };
    let judged = |first_frame: f64| verified(&[Mesh::new("one", &frames, faces), moved(first_frame)]);
    assert!(judged(1001.5).failures.iter().any(|text| text.contains("no sample at the same time")));
    let partly = judged(1002.0);
    assert!(partly.failures.is_empty());
    assert!(partly.warnings.iter().any(|text| text.contains("share 2 times of 3")), "{:?}", partly.warnings);
    assert!(judged(1001.0).warnings.iter().all(|text| !text.contains("share")));
}

#[test]
fn faces_are_cut_into_the_triangles_that_were_simulated() {
    // A bent quad: along one diagonal it passes above the spike's tip, along the other below.
    let bent = [[0.0, 0.0, 0.0], [2.0, 0.6, 0.0], [2.0, 0.0, 2.0], [0.0, 0.6, 2.0]];
    let frames = [[bent.to_vec(), vec![[0.9, 2.0, 1.0], [1.1, 2.0, 1.0], [1.0, 0.3, 1.0]]].concat()];
    let quad = |triangles| Mesh { triangles, ..Mesh::new("cloth", &frames, (&[4, 3], &[0, 1, 2, 3, 4, 5, 6])) };
    assert!(verified(&[quad(&[0, 1, 2, 0, 2, 3, 4, 5, 6])]).failures.is_empty());
    assert_eq!(verified(&[quad(&[0, 1, 3, 1, 2, 3, 4, 5, 6])]).failures.len(), 1);
    // Triangles that do not fit the points are not believed.
    assert!(verified(&[quad(&[0, 1, 2, 0, 2, 7, 4, 5, 6])]).failures.len() < 2);
}

/// A hanging square of cloth and another that stands across it, frames 1001 to 1003.
fn two_sheets(distance: f64, effect: &str) -> ShotDescription {
    let square = |corners: [[f64; 3]; 4]| PolygonMesh {
        points: corners.map(Vec3::from).to_vec(),
        face_counts: vec![4],
        face_indices: vec![0, 1, 2, 3],
    };
    let first = square([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let x = 0.4 + distance;
    let second = square([[x, 0.2, -0.5], [x, 0.2, 0.5], [x, 0.8, 0.5], [x, 0.8, -0.5]]);
    let mut scene = SceneDescription::new("two_sheets");
    scene.timeline = Timeline { origin: 1001, start: 1001, ..Timeline::default() };
    for (name, mesh) in [("first", &first), ("second", &second)] {
        scene.garments.push(GarmentDescription::new(name, mesh.clone(), 0.2));
    }
    scene.effects.push(EffectRequest::of_scene(effect));
    described(scene, [1001, 1003], &["abc"], Units::SI)
}

#[test]
fn a_run_counts_the_crossings_of_what_it_writes_and_verify_agrees() {
    for (distance, effect, counted) in
        [(0.0, "self_collision", Some(true)), (2.0, "self_collision", Some(false)), (0.0, "gravity", None)]
    {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let shot = Shot::prepare(two_sheets(distance, effect), None).unwrap();
        let report = shot.run(&RunOptions::new(out.clone()), &mut |_: &FrameReport<'_>| {}).unwrap();
        let exceeded = report.exceeded.iter().find(|limit| limit.name == "crossings_written");
        assert_eq!(exceeded.map(|limit| limit.first_frame), (counted == Some(true)).then_some(1001));
        let record = std::fs::read_to_string(out.join("run.jsonl")).unwrap();
        let mut recorded = Vec::new();
        for line in record.lines() {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            if line["record"] == "start" || line["record"] == "frame" {
                recorded.push(line["counts"]["crossings_written"].as_u64());
            }
        }
        let archive = Archive::open(out.join("second.abc")).unwrap();
        let mesh = PolyMesh::open(&archive, "/second/secondShape").unwrap();
        let stored = mesh.user_properties().unwrap().samples("crossings");
        let stored: Vec<Option<u64>> =
            (0..3).map(|sample| Some(u64::from(*stored?.values::<u32>(sample).unwrap().first().unwrap()))).collect();
        assert_eq!(stored, recorded);
        assert_eq!(stored[0].map(|count| count > 0), counted);
        let files: Vec<&Path> = report.files.iter().map(AsRef::as_ref).collect();
        let found = verify(&files, None).unwrap();
        let crosses = counted != Some(false);
        assert_eq!(
            found.failures.iter().any(|text| text.contains("second.abc: /second/secondShape intersect in ")),
            crosses
        );
    }
}

#[test]
fn only_the_part_that_a_rule_names_passes_through_its_garment() {
    // A coat with a pocket that crosses it, and a flap that crosses it elsewhere or hangs beside it.
    let coat = |flap: f64| -> Vec<Vec3> {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let across = |x: f64| [[x, 0.2, -0.5], [x, 0.2, 0.5], [x, 0.8, 0.5], [x, 0.8, -0.5]];
        [square, across(0.4), across(flap)].concat().into_iter().map(Vec3::from).collect()
    };
    for (flap, failures) in [(0.7, 1), (2.0, 0)] {
        let folder = tempfile::tempdir().unwrap();
        let mesh = PolygonMesh { points: coat(flap), face_counts: vec![4; 3], face_indices: (0..12).collect() };
        let mut scene = SceneDescription::new("coat");
        let mut garment = GarmentDescription::new("coat", mesh, 0.2);
        garment.parts.insert("pocket".to_owned(), vec![4, 5, 6, 7]);
        scene.garments.push(garment);
        let between = [ContactSide::Part(0, 0), ContactSide::Garment(0)];
        scene.contacts.push(ContactRule { ignore: true, ..ContactRule::new(between) });
        scene.effects.push(EffectRequest::of_scene("self_collision"));
        let shot = Shot::prepare(described(scene, [1, 2], &["abc"], Units::SI), None).unwrap();
        let report = shot.run(&RunOptions::new(folder.path().join("out")), &mut |_: &FrameReport<'_>| {}).unwrap();
        let files: Vec<&Path> = report.files.iter().map(AsRef::as_ref).collect();
        let found = verify(&files, None).unwrap();
        let allowed = |text: &String| text.contains("as the scene lets them pass through each other");
        assert!(found.facts.iter().any(allowed), "{:?}", found.facts);
        let crosses = |text: &&String| text.contains("coatShape: the cloth intersects itself");
        assert_eq!(found.failures.iter().filter(crosses).count(), failures, "{:?}", found.failures);
    }
}

//! A shot in the hands of another program has the bits of a run, also with bodies that the program moves, and after any pause.

use std::path::Path;

use drapery_alembic::{
    ArchiveOptions, ArchiveWriter, Durability, PolyMeshSample, PolyMeshWriter, TimeSampling, Topology, XformWriter,
};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::gather::VertexField;
use drapery_core::snapshot::Snapshot;
use drapery_io::checkpoint::Checkpoint;
use drapery_io::memory_mesh::MemoryMeshes;
use drapery_shot::ShotError;
use drapery_shot::fault::{Fault, FaultKind};
use drapery_shot::run::{FrameReport, Outcome, RunOptions};
use drapery_shot::scene_source::SceneSource;
use drapery_shot::session::{Progress, Session};

const FRAMES: [i64; 2] = [1001, 1004];

const FACES: [[u32; 3]; 4] = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];

/// A tetrahedron that rises and turns [m]; in single precision, as files have it.
fn hero(frame: i64) -> Vec<[f32; 3]> {
    let (y, x) = ((frame - FRAMES[0]) as f32 * 0.02, (frame - FRAMES[0]).pow(2) as f32 * 0.01);
    vec![[x - 0.4, y, -0.4], [0.6, y, -0.4], [-0.4, y, 0.6], [x, y + 0.45, 0.0]]
}

fn hero_si(frame: i64) -> Vec<Vec3> {
    hero(frame).into_iter().map(|point| Vec3::from(point.map(f64::from))).collect()
}

/// A square of cloth of n × n points over it.
fn sheet(n: u32) -> PolygonMesh {
    let at = |i: u32| f64::from(i) / f64::from(n - 1) - 0.5;
    let points = (0..n * n).map(|i| Vec3::new(at(i % n), 0.47, at(i / n))).collect();
    let cell = |c: u32| (c / (n - 1)) * n + c % (n - 1);
    let quad = |c: u32| [cell(c), cell(c) + n, cell(c) + n + 1, cell(c) + 1];
    let cells = (n - 1) * (n - 1);
    PolygonMesh { points, face_counts: vec![4; cells as usize], face_indices: (0..cells).flat_map(quad).collect() }
}

fn meshes() -> MemoryMeshes {
    let mut meshes = MemoryMeshes::default();
    meshes.insert("hero", PolygonMesh::from_triangles(hero_si(FRAMES[0]), &FACES)).unwrap();
    meshes.insert("sheet", sheet(9)).unwrap();
    meshes
}

/// The sheet over the tetrahedron, which comes from `body`.
fn source(folder: &Path, body: &str) -> SceneSource {
    let text = format!(
        "drapery = 1\n[shot]\nname = \"live\"\nframes = \"1001-1004\"\npreroll = {{ settle = 1, blend = 0 }}\n\
         [gravity]\n[self_repulsion]\n[self_collision]\n[output]\nsamples = 3\n\
         [[body]]\nname = \"hero\"\nfile = \"{body}\"\nunits = {{ length = \"m\", up = \"Y\" }}\n\
         [[body]]\nname = \"floor\"\nshape = {{ half_space = {{}} }}\nposition = [0, -1, 0]\n\
         [[garment]]\nname = \"sheet\"\nrest = \"memory:sheet\"\nmaterial = \"cotton_shirting\"\n"
    );
    let mut source = SceneSource::text(text, "live.toml", folder);
    source.meshes = meshes();
    source
}

fn body_file(folder: &Path) -> &'static str {
    let mut archive = ArchiveWriter::create(folder.join("hero.abc"), &ArchiveOptions::default()).unwrap();
    let times = (FRAMES[0]..=FRAMES[1]).map(|frame| frame as f64 / 24.0).collect();
    let sampling = archive.add_time_sampling(TimeSampling::acyclic(times).unwrap()).unwrap();
    let root = archive.root();
    let xform = XformWriter::still(&mut archive, root, "hero", None).unwrap();
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "heroShape", sampling).unwrap();
    // The format has corners clockwise.
    let indices: Vec<i32> = FACES.iter().flat_map(|face| face.iter().rev().map(|corner| *corner as i32)).collect();
    for frame in FRAMES[0]..=FRAMES[1] {
        let topology = Topology { face_counts: &[3; 4], face_indices: &indices };
        let points = hero(frame);
        mesh.write(&mut archive, &PolyMeshSample { topology: Some(topology), ..PolyMeshSample::of(&points) }).unwrap();
    }
    archive.finish(Durability::Flushed).unwrap();
    "hero.abc"
}

fn session(source: &SceneSource) -> Session {
    Session::new(source.prepare(None).unwrap_or_else(|fault| panic!("{fault}")))
}

/// Goes on to a frame, with the tetrahedron put where its file would have it if `moves`.
fn advance(session: &mut Session, frame: i64, moves: bool) {
    while session.frame().unwrap() < frame {
        if moves {
            session.move_body(0, &hero_si(session.frame().unwrap() + 1)).unwrap();
        }
        assert_eq!(session.next_frame(&mut || false).unwrap(), Progress::Frame);
    }
}

/// The solver's arrays, without what sessions add.
fn state(session: &Session, folder: &Path) -> Snapshot {
    let path = folder.join("state.h5");
    session.save_file(&path).unwrap();
    let mut snapshot = Checkpoint::read(&path).unwrap().snapshot;
    snapshot.sections.retain(|section| section.name != "moved_bodies");
    snapshot
}

#[test]
fn frames_have_the_bits_of_a_run_whether_a_file_or_the_program_moves_the_body() {
    let folder = tempfile::tempdir().unwrap();
    let (of_file, live) = (source(folder.path(), body_file(folder.path())), source(folder.path(), "memory:hero"));
    let out = folder.path().join("out");
    let report = of_file.prepare(None).unwrap().run(&RunOptions::new(out.clone()), &mut |_: &FrameReport<'_>| {});
    assert_eq!(report.unwrap().outcome, Outcome::Done);
    let run = Checkpoint::read(&out.join("checkpoints/frame_01004.h5")).unwrap().snapshot;
    let mut stepped = session(&of_file);
    advance(&mut stepped, 1004, false);
    assert!(state(&stepped, folder.path()) == run, "a body from a file");
    let mut moved = session(&live);
    advance(&mut moved, 1004, true);
    assert!(state(&moved, folder.path()) == run, "a body that the program moves");
    // That this would tell: where the body stays, the cloth ends elsewhere.
    let mut still = session(&live);
    advance(&mut still, 1004, false);
    assert!(state(&still, folder.path()) != run);
}

#[test]
fn a_cancelled_frame_goes_on_and_states_come_back_with_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let live = source(folder.path(), "memory:hero");
    let mut whole = session(&live);
    advance(&mut whole, 1004, true);
    let whole = state(&whole, folder.path());
    let mut paused = session(&live);
    advance(&mut paused, 1002, true);
    paused.move_body(0, &hero_si(1003)).unwrap();
    let at_frame = paused.save().unwrap();
    assert_eq!(paused.next_frame(&mut || true).unwrap(), Progress::Cancelled);
    assert!(paused.move_body(0, &hero_si(1003)).unwrap_err().to_string().contains("has already begun"));
    let (within, file) = (paused.save().unwrap(), folder.path().join("within.h5"));
    paused.save_file(&file).unwrap();
    assert_eq!(paused.next_frame(&mut || false).unwrap(), Progress::Frame);
    for back in [&within, &at_frame] {
        paused.restore(back).unwrap();
        assert_eq!(paused.frame().unwrap(), 1002);
        assert_eq!(paused.next_frame(&mut || false).unwrap(), Progress::Frame);
        advance(&mut paused, 1004, true);
        assert!(state(&paused, folder.path()) == whole);
    }
    // In another process the scene is prepared again.
    let mut other = session(&live);
    other.restore_file(&file).unwrap();
    assert_eq!(other.next_frame(&mut || false).unwrap(), Progress::Frame);
    advance(&mut other, 1004, true);
    assert!(state(&other, folder.path()) == whole);
    assert!(other.restore(&within).unwrap_err().to_string().contains("another simulation"));
}

#[test]
fn a_state_that_cannot_be_restored_leaves_bodies_where_the_program_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let body = body_file(folder.path());
    let (of_file, path) = (source(folder.path(), body), folder.path().join(body));
    let [mut tried, mut untried] = [session(&of_file), session(&of_file)];
    let start = tried.save().unwrap();
    advance(&mut tried, 1002, true);
    advance(&mut untried, 1002, true);
    let content = std::fs::read(&path).unwrap();
    std::fs::write(&path, "").unwrap();
    assert!(tried.restore(&start).is_err());
    std::fs::write(&path, content).unwrap();
    for session in [&mut tried, &mut untried] {
        assert_eq!(session.next_frame(&mut || false).unwrap(), Progress::Frame);
    }
    assert!(state(&tried, folder.path()) == state(&untried, folder.path()));
}

#[test]
fn fields_follow_the_state_in_the_order_of_the_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = session(&source(folder.path(), "memory:hero"));
    assert_eq!(session.field(0, VertexField::Positions).unwrap(), sheet(9).points);
    let before = session.field(0, VertexField::Positions).unwrap().as_ptr();
    assert_eq!(session.field(0, VertexField::Positions).unwrap().as_ptr(), before, "it is kept");
    advance(&mut session, 1001, true);
    // A corner hangs free of everything for a frame: it falls.
    assert!(session.field(0, VertexField::Positions).unwrap()[0].y < 0.47);
    assert!(session.field(0, VertexField::Velocities).unwrap()[0].y < 0.0);
    assert_eq!(session.summary().unwrap().frame, 1001);
}

#[test]
fn what_cannot_be_is_a_fault_with_object_frame_and_element_and_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let live = source(folder.path(), "memory:hero");
    let mut session = session(&live);
    let fault = |error: ShotError| {
        let Fault { kind, object, frame, element, .. } = Fault::from(error);
        (kind, object, frame, element)
    };
    let hero = || Some("hero".to_owned());
    let mut far = hero_si(1001);
    far[2].z = f64::NAN;
    assert_eq!(fault(session.move_body(0, &far).unwrap_err()), (FaultKind::BadInput, hero(), Some(1001), Some(2)));
    let short = session.move_body(0, &far[..3]).unwrap_err();
    assert_eq!(fault(short), (FaultKind::BadInput, hero(), Some(1001), None));
    let ideal = session.move_body(1, &far).unwrap_err();
    assert!(ideal.to_string().contains("analytic shape"), "{ideal}");
    assert!(session.move_body(2, &far).is_err() && session.field(1, VertexField::Positions).is_err());
    advance(&mut session, 1004, true);
    let end = session.next_frame(&mut || false).unwrap_err();
    assert_eq!(fault(end).0, FaultKind::Usage);
    let path = folder.path().join("state.h5");
    session.save_file(&path).unwrap();
    // Only a checkpoint is replaced.
    session.save_file(&path).unwrap();
    let notes = folder.path().join("notes.txt");
    std::fs::write(&notes, "mine").unwrap();
    let refused = session.save_file(&notes).unwrap_err();
    assert!(refused.to_string().contains("exists already and is no checkpoint of Drapery"), "{refused}");
    assert_eq!(fault(refused).0, FaultKind::CannotCreate);
    assert_eq!(std::fs::read_to_string(&notes).unwrap(), "mine");
    let mut other = live.clone();
    other.meshes.insert("sheet", sheet(8)).unwrap();
    let mut other = self::session(&other);
    let refused = other.restore_file(&path).unwrap_err().to_string();
    assert!(refused.contains("a different shot") && refused.contains("memory:sheet"), "{refused}");
    std::fs::write(&path, &std::fs::read(&path).unwrap()[..2000]).unwrap();
    assert_eq!(fault(other.restore_file(&path).unwrap_err()).0, FaultKind::BadInput);
    advance(&mut other, 1001, false);
    let mut unnamed = live;
    unnamed.meshes = MemoryMeshes::default();
    let fault = unnamed.prepare(None).err().expect("meshes are missing");
    assert!(fault.kind == FaultKind::BadInput && fault.message.contains("memory:hero"), "{fault}");
}

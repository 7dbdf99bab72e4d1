//! The frame loop: what a run leaves in its folder, and what it refuses before it writes anything.

mod common;

use std::path::{Path, PathBuf};

use drapery_alembic::{
    Archive, ArchiveOptions, ArchiveWriter, Durability, PolyMesh, PolyMeshSample, PolyMeshWriter, TimeSampling,
    Topology, XformWriter,
};
use drapery_core::Vec3;
use drapery_core::error::Problems;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, RigidMotion, SceneDescription, Timeline,
};
use drapery_io::error::IoError;
use drapery_io::mesh_source::MeshSource;
use drapery_io::shot::motion::{InputMotion, Preroll};
use drapery_io::shot::run::{FrameReport, Outcome, Resume, RunOptions};
use drapery_io::shot::{Shot, ShotDescription, ShotError};
use drapery_io::units::Units;

use common::described;

/// A square of cloth of 9 points, 1 m wide, at a height [m].
fn sheet(height: f64) -> PolygonMesh {
    let points = (0..9).map(|i| Vec3::new(f64::from(i % 3) / 2.0, height, f64::from(i / 3) / 2.0)).collect();
    let quad = |i: u32| [i, i + 3, i + 4, i + 1];
    PolygonMesh { points, face_counts: vec![4; 4], face_indices: [0, 1, 3, 4].map(quad).concat() }
}

/// A falling sheet, frames 1001 to 1003.
fn falling(folder: &Path) -> ShotDescription {
    let mut scene = SceneDescription::new("falling");
    scene.timeline = Timeline { origin: 1001, start: 1001, ..Timeline::default() };
    scene.garments.push(GarmentDescription::new("sheet", sheet(1.0), 0.2));
    scene.effects.push(EffectRequest::of_scene("gravity"));
    let described = described(scene, [1001, 1003], &["abc"], Units::SI);
    ShotDescription { scene_path: folder.join("falling.toml"), resolved: "# all settings\n".into(), ..described }
}

fn options(folder: &Path) -> RunOptions {
    RunOptions::new(folder.join("out"))
}

/// Writes a tetrahedron that rises by 1 cm a frame from frame 1001 on; `change` may alter a frame's points and faces.
fn body_file(folder: &Path, frames: &[i64], change: impl Fn(i64, &mut Vec<[f32; 3]>, &mut Vec<i32>)) -> PathBuf {
    let path = folder.join("body.abc");
    let mut archive = ArchiveWriter::create(&path, &ArchiveOptions::default()).unwrap();
    let times = frames.iter().map(|&frame| frame as f64 / 24.0).collect();
    let sampling = archive.add_time_sampling(TimeSampling::acyclic(times).unwrap()).unwrap();
    let root = archive.root();
    let xform = XformWriter::still(&mut archive, root, "body", None).unwrap();
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "bodyShape", sampling).unwrap();
    for &frame in frames {
        let y = (frame - 1001) as f32 * 0.01;
        let mut points = vec![[0.0, y, 0.0], [1.0, y, 0.0], [0.0, y, 1.0], [0.0, y + 0.9, 0.0]];
        let mut indices = vec![0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
        change(frame, &mut points, &mut indices);
        let topology = Topology { face_counts: &vec![3; indices.len() / 3], face_indices: &indices };
        mesh.write(&mut archive, &PolyMeshSample { topology: Some(topology), ..PolyMeshSample::of(&points) }).unwrap();
    }
    archive.finish(Durability::Flushed).unwrap();
    path
}

/// The falling sheet over a body from a file.
fn over_body(folder: &Path, file: &Path) -> Result<ShotDescription, IoError> {
    let source = MeshSource::open(file, Some("/body/*"), Units::SI)?;
    let mesh = source.mesh_at(1001.0 / 24.0)?.mesh;
    let mut shot = falling(folder);
    let shape = BodyShape::Surface { triangles: mesh.triangulate().0, point_count: mesh.points.len() };
    shot.scene.bodies.push(BodyDescription::new("hero", shape, RigidMotion::at(Vec3::zeros())));
    shot.scene.effects.push(EffectRequest::of_scene("body_collision"));
    shot.bodies.push(Some(InputMotion {
        label: "body \"hero\"".into(),
        source,
        rest: None,
        rows: None,
        own_units: false,
    }));
    Ok(shot)
}

/// All problems of a shot over a body file that `change` has broken.
fn problems_of(frames: &[i64], change: impl Fn(i64, &mut Vec<[f32; 3]>, &mut Vec<i32>)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let file = body_file(folder.path(), frames, change);
    match Shot::prepare(over_body(folder.path(), &file).unwrap(), None) {
        Err(ShotError::Problems(Problems(found))) => found.iter().map(|problem| format!("{problem}\n")).collect(),
        Err(other) => other.to_string(),
        Ok(_) => "no problem".into(),
    }
}

#[test]
fn a_run_leaves_caches_manifest_record_and_resolved_scene() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = Vec::new();
    let shot = Shot::prepare(falling(folder.path()), None).unwrap();
    let mut see = |frame: &FrameReport<'_>| frames.push((frame.frame, frame.done, frame.total));
    let report = shot.run(&options(folder.path()), &mut see).unwrap();
    assert_eq!(frames, [(1001, 1, 3), (1002, 2, 3), (1003, 3, 3)]);
    assert_eq!(report.frames, 3);
    let out = folder.path().join("out");
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&read("manifest.json")).unwrap();
    assert_eq!((manifest["state"].as_str(), manifest["last_complete_frame"].as_i64()), (Some("done"), Some(1003)));
    assert_eq!(manifest["garments"][0]["files"][0], "sheet.abc");
    assert_eq!(read("run.jsonl").lines().count(), 1 + 3 + 2, "header, frames, the checkpoint of the last one, end");
    assert_eq!(read("resolved.toml"), "# all settings\n");
    let archive = Archive::open(out.join("sheet.abc")).unwrap();
    let mesh = PolyMesh::open(&archive, "/sheet/sheetShape").unwrap();
    assert_eq!(mesh.sample_count(), 3);
    assert_eq!(mesh.time(0), 1001.0 / 24.0);
    // Free fall of two frames: g t²/2, to the precision of the file's f32.
    let fallen = 1.0 - f64::from(mesh.positions(2).unwrap()[4][1]);
    assert!((fallen - 0.5 * 9.81 / 144.0).abs() < 1e-6, "{fallen}");
}

#[test]
fn another_run_is_replaced_only_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let run = |resume, overwrite| {
        let options = RunOptions { resume, overwrite, ..options(folder.path()) };
        let shot = Shot::prepare(falling(folder.path()), Some([1001, 1002])).unwrap();
        shot.run(&options, &mut |_: &FrameReport<'_>| {})
    };
    assert_eq!(run(Resume::Never, false).unwrap().outcome, Outcome::Done);
    assert_eq!(run(Resume::Auto, false).unwrap().outcome, Outcome::NothingToDo);
    let refused = run(Resume::Never, false).unwrap_err();
    assert!(matches!(refused, ShotError::Io(IoError::OutputExists { .. })), "{refused}");
    assert!(refused.to_string().contains("--overwrite"));
    // A cache of the old run that the new one does not write goes too.
    let manifest = folder.path().join("out/manifest.json");
    let stale = folder.path().join("out/sheet.h5");
    std::fs::write(&stale, "old").unwrap();
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replace("\"sheet.abc\"", "\"sheet.abc\", \"sheet.h5\"")).unwrap();
    run(Resume::Auto, true).unwrap();
    assert!(!stale.exists());
}

#[test]
fn a_run_goes_on_with_more_frames_another_format_and_without_velocities() {
    let folder = tempfile::tempdir().unwrap();
    let run = |out: &str, formats: &[&str], velocities: bool, last: i64| {
        let mut shot = falling(folder.path());
        shot.output.formats = formats.iter().map(|&format| format.to_owned()).collect();
        shot.output.velocities = velocities;
        shot.resolved = format!("[output]\nvelocities = {velocities}\n");
        let options = RunOptions::new(folder.path().join(out));
        let mut frames = Vec::new();
        let mut see = |frame: &FrameReport<'_>| frames.push(frame.frame);
        let report = Shot::prepare(shot, Some([1001, last])).unwrap().run(&options, &mut see);
        report.map(|report| (report.outcome, frames))
    };
    let bytes = |out: &str, file: &str| std::fs::read(folder.path().join(out).join(file)).unwrap();
    run("whole", &["abc", "h5"], false, 1003).unwrap();
    run("out", &["abc"], true, 1002).unwrap();
    // Only the frame that is missing is simulated.
    assert_eq!(run("out", &["abc", "h5"], false, 1003).unwrap(), (Outcome::Done, vec![1003]));
    for file in ["sheet.abc", "sheet.h5"] {
        assert!(bytes("out", file) == bytes("whole", file), "{file}");
    }
    assert_eq!(run("out", &["abc", "h5"], false, 1003).unwrap().0, Outcome::NothingToDo);
    // Without a frame to simulate the form changes all the same.
    run("other", &["h5"], false, 1003).unwrap();
    assert_eq!(run("other", &["h5", "abc"], false, 1003).unwrap(), (Outcome::Done, vec![]));
    assert!(bytes("other", "sheet.abc") == bytes("whole", "sheet.abc"));
    // What was never stored cannot be made up.
    let refused = run("other", &["h5", "abc"], true, 1003).unwrap_err().to_string();
    assert!(refused.contains("no velocities") && refused.contains("--overwrite"), "{refused}");
}

#[test]
fn a_cache_never_replaces_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let mut shot = falling(folder.path());
    std::fs::create_dir(folder.path().join("out")).unwrap();
    let input = folder.path().join("out/sheet.abc");
    std::fs::write(&input, "the artist's file").unwrap();
    shot.input_files.push(input.clone());
    let options = RunOptions { overwrite: true, ..options(folder.path()) };
    let refused = Shot::prepare(shot, None).unwrap().run(&options, &mut |_: &FrameReport<'_>| {}).unwrap_err();
    assert!(matches!(refused, ShotError::Io(IoError::OutputIsInput { .. })), "{refused}");
    assert_eq!(std::fs::read_to_string(input).unwrap(), "the artist's file");
}

#[test]
fn the_preroll_is_simulated_but_not_delivered() {
    let folder = tempfile::tempdir().unwrap();
    let mut shot = falling(folder.path());
    shot.preroll = Preroll { settle: 2, blend: 1 };
    shot.scene.timeline.start = 998;
    let mut seen = Vec::new();
    let mut see = |frame: &FrameReport<'_>| seen.push((frame.frame, frame.is_preroll));
    Shot::prepare(shot, None).unwrap().run(&options(folder.path()), &mut see).unwrap();
    assert_eq!((seen[0], seen[2], seen[3]), ((998, true), (1000, true), (1001, false)));
    let archive = Archive::open(folder.path().join("out/sheet.abc")).unwrap();
    let mesh = PolyMesh::open(&archive, "/sheet/sheetShape").unwrap();
    assert_eq!((mesh.sample_count(), mesh.time(0)), (3, 1001.0 / 24.0));
    let fallen = 1.0 - f64::from(mesh.positions(0).unwrap()[4][1]);
    assert!((fallen - 0.5 * 9.81 * 9.0 / 576.0).abs() < 1e-6, "{fallen}");
}

#[test]
fn a_sound_body_has_no_problems() {
    assert_eq!(problems_of(&[1001, 1002, 1003], |_, _, _| {}), "no problem");
}

#[test]
fn a_nan_vertex_is_named_with_object_frame_and_vertex() {
    let text = problems_of(&[1001, 1002, 1003], |frame, points, _| {
        if frame == 1002 {
            points[3][1] = f32::NAN;
        }
    });
    for part in ["body \"hero\"", "/body/bodyShape", "frame 1002", "vertex 3", "finite"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn a_topology_change_is_named_with_its_frame() {
    let other_faces = problems_of(&[1001, 1002, 1003], |frame, _, indices| {
        if frame == 1003 {
            indices.truncate(9);
        }
    });
    assert!(other_faces.contains("frame 1003") && other_faces.contains("topology changes"), "{other_faces}");
    let other_order = problems_of(&[1001, 1002, 1003], |frame, _, indices| {
        if frame == 1002 {
            indices.rotate_left(3);
        }
    });
    assert!(other_order.contains("frame 1002") && other_order.contains("topology changes"), "{other_order}");
    let other_points = problems_of(&[1001, 1002, 1003], |frame, points, _| {
        if frame == 1002 {
            points.push([0.0; 3]);
        }
    });
    assert!(other_points.contains("frame 1002") && other_points.contains("points"), "{other_points}");
}

#[test]
fn missing_frames_and_frames_outside_the_file_are_named() {
    let hole = problems_of(&[1000, 1001, 1003, 1004], |_, _, _| {});
    assert!(hole.contains("between frames 1001 and 1003"), "{hole}");
    let short = problems_of(&[1001, 1002], |_, _, _| {});
    assert!(short.contains("from frame 1001 to 1002") && short.contains("frames 1001 to 1003"), "{short}");
}

#[test]
fn a_body_in_the_wrong_unit_is_recognised() {
    let text = problems_of(&[1001, 1002, 1003], |_, points, _| points.iter_mut().flatten().for_each(|x| *x *= 190.0));
    assert!(text.contains("looks like centimetres"), "{text}");
}

#[test]
fn several_problems_are_reported_at_once() {
    let text = problems_of(&[1001, 1002], |frame, points, _| {
        if frame == 1002 {
            points[0][0] = f32::INFINITY;
        }
    });
    assert!(text.contains("vertex 0") && text.contains("from frame 1001 to 1002"), "{text}");
}

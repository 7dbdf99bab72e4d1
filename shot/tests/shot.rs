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
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, SceneDescription, Timeline,
};
use drapery_io::error::IoError;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::input_motion::{InputMotion, Preroll};
use drapery_io::mesh_data::{MeshData, Uvs};
use drapery_io::mesh_source::MeshSource;
use drapery_io::scene_file;
use drapery_io::shot_description::ShotDescription;
use drapery_io::units::Units;
use drapery_shot::Shot;
use drapery_shot::ShotError;
use drapery_shot::run::{FrameReport, Observer, Outcome, Resume, RunOptions};

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
    mesh_file(folder, frames, 3, |frame| {
        let y = (frame - 1001) as f32 * 0.01;
        let mut points = vec![[0.0, y, 0.0], [1.0, y, 0.0], [0.0, y, 1.0], [0.0, y + 0.9, 0.0]];
        let mut indices = vec![0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
        change(frame, &mut points, &mut indices);
        (points, indices)
    })
}

/// Writes the mesh that `sample` gives for each frame, of faces with this number of corners.
fn mesh_file(
    folder: &Path,
    frames: &[i64],
    corners: usize,
    sample: impl Fn(i64) -> (Vec<[f32; 3]>, Vec<i32>),
) -> PathBuf {
    let path = folder.join("body.abc");
    let mut archive = ArchiveWriter::create(&path, &ArchiveOptions::default()).unwrap();
    let times = frames.iter().map(|&frame| frame as f64 / 24.0).collect();
    let sampling = archive.add_time_sampling(TimeSampling::acyclic(times).unwrap()).unwrap();
    let root = archive.root();
    let xform = XformWriter::still(&mut archive, root, "body", None).unwrap();
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "bodyShape", sampling).unwrap();
    for &frame in frames {
        let (points, indices) = sample(frame);
        let face_counts = vec![corners as i32; indices.len() / corners];
        let topology = Topology { face_counts: &face_counts, face_indices: &indices };
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
        is_made: false,
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
    assert!(short.contains("frames 1001 to 1002") && short.contains("frames 1001 to 1003"), "{short}");
}

#[test]
fn a_body_in_the_wrong_unit_is_recognised() {
    let text = problems_of(&[1001, 1002, 1003], |_, points, _| points.iter_mut().flatten().for_each(|x| *x *= 190.0));
    assert!(text.contains("looks like centimetres"), "{text}");
}

#[test]
fn a_small_body_is_accepted_where_it_fits_the_garments_and_doubted_with_both_sizes_elsewhere() {
    // A tetrahedron this wide [m], 0.9 times as high, below a square of cloth this wide [m].
    let sizes = |body: f32, cloth: f64, own_units: bool| {
        let folder = tempfile::tempdir().unwrap();
        let file = body_file(folder.path(), &[1001, 1002, 1003], |_, points, _| {
            points.iter_mut().flatten().for_each(|x| *x *= body);
        });
        let mut shot = over_body(folder.path(), &file).unwrap();
        shot.bodies[0].as_mut().unwrap().own_units = own_units;
        let mesh = &mut shot.scene.garments[0].mesh;
        mesh.points.iter_mut().for_each(|p| *p = Vec3::new(p.x * cloth, body.into(), p.z * cloth));
        shot.garments = vec![GarmentMesh::kept(MeshData::new(mesh.clone()))];
        let found = Shot::prepare(shot, None).map_err(|error| error.to_string())?;
        let warnings = found.warnings().iter().map(ToString::to_string);
        Ok::<_, String>(warnings.filter(|warning| warning.contains("when read as")).collect::<Vec<_>>())
    };
    // A doll and its dress; a person.
    assert_eq!(sizes(0.14, 0.12, false), Ok(vec![]));
    assert_eq!(sizes(1.7, 1.2, false), Ok(vec![]));
    // A hand under a table cloth may be meant; what it is compared with is there to see.
    let warnings = sizes(0.14, 2.0, false).unwrap();
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    let parts = [
        "body \"hero\"",
        "0.140 m across when read as metres",
        "the largest garment is 2.000 m across",
        "units.length",
    ];
    parts.iter().for_each(|part| assert!(warning.contains(part), "{part}: {warning}"));
    assert_eq!(sizes(0.14, 2.0, true), Ok(vec![]));
    // A giant in a sail is doubted; one that is a person in centimetres is refused, whatever it wears.
    assert!(sizes(25.0, 30.0, false).unwrap()[0].contains("25.000 m across"));
    for cloth in [1.2, 120.0] {
        let refused = sizes(172.0, cloth, false).unwrap_err();
        let parts = ["looks like centimetres; set units.length = \"cm\"", &format!("is {cloth:.3} m across")];
        parts.iter().for_each(|part| assert!(refused.contains(part), "{part}: {refused}"));
        assert!(sizes(172.0, cloth, true).unwrap()[0].contains("looks like centimetres"));
    }
}

#[test]
fn several_problems_are_reported_at_once() {
    let text = problems_of(&[1001, 1002], |frame, points, _| {
        if frame == 1002 {
            points[0][0] = f32::INFINITY;
        }
    });
    assert!(text.contains("vertex 0") && text.contains("frames 1001 to 1002"), "{text}");
}

#[test]
fn faces_that_rounding_has_taken_far_from_the_origin_are_told_from_bad_ones() {
    let shrunk = |far: f32| {
        problems_of(&[1001, 1002, 1003], move |_, points, _| {
            points.iter_mut().flatten().for_each(|x| *x = far + 1e-4 * *x);
        })
    };
    // Numbers of single precision are 1 mm apart there.
    let far = shrunk(1e4);
    for part in
        ["body \"hero\"", "frame 1001", "1-2-0", "10000 m from the origin", "resolves only 9.8e-4 m", "a transform"]
    {
        assert!(far.contains(part), "{part}: {far}");
    }
    assert!(!far.contains("delete these faces"), "{far}");
    let flat = problems_of(&[1001, 1002, 1003], |_, points, _| {
        let corner = points[1];
        points.fill(corner);
    });
    assert!(flat.contains("delete these faces") && !flat.contains("transform"), "{flat}");
}

#[test]
fn a_garment_deep_inside_a_body_is_refused() {
    let text = problems_of(&[1001, 1002, 1003], |_, points, indices| {
        points.iter_mut().flatten().for_each(|x| *x = 60.0 * *x - 13.0);
        // It faces outwards.
        indices.reverse();
    });
    assert!(text.contains("9 of its vertices start inside body \"hero\"") && text.contains("more than"), "{text}");
}

/// Hears what is said of a run.
#[derive(Default)]
struct Listener(Vec<String>);

impl Observer for Listener {
    fn note(&mut self, text: String) {
        self.0.push(text);
    }

    fn frame(&mut self, _: &FrameReport<'_>) {}
}

#[test]
fn pins_that_a_body_covers_are_named_before_a_run() {
    let folder = tempfile::tempdir().unwrap();
    // In the last frame the body encloses vertex 0, 10 cm from its nearest faces, and not vertex 1.
    let file = body_file(folder.path(), &[1001, 1002, 1003], |frame, points, _| {
        let up = if frame == 1003 { 0.48 } else { 0.0 };
        points.iter_mut().for_each(|p| *p = [p[0] - 0.1, p[1] + up, p[2] - 0.1]);
    });
    let check = |vertices: &[u32]| {
        let mut shot = over_body(folder.path(), &file).unwrap();
        shot.scene.pins.push(PinDescription {
            garment: 0,
            target: PinTarget::Path { anchor: PinAnchor::Start, vertices: vertices.to_vec(), offsets: Vec::new() },
            axes: [true; 3],
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            hold: PinHold::Hard,
        });
        shot.scene.effects.push(EffectRequest::of_scene("pins"));
        Shot::prepare(shot, None).unwrap().check_pins().unwrap().join("; ")
    };
    let text = check(&[0, 1]);
    for part in [
        "garment \"sheet\", frame 1003: body \"hero\" covers pinned vertices (1, deepest is vertex 0 with 100.0 mm)",
        "of 1 frames",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(check(&[1, 2]), "");
}

#[test]
fn pins_that_tear_neighbours_apart_are_told_before_a_run_and_in_it() {
    let folder = tempfile::tempdir().unwrap();
    // The body gets four times as wide in the last frame.
    let file = body_file(folder.path(), &[1001, 1002, 1003], |frame, points, _| {
        points.iter_mut().for_each(|p| p[0] *= if frame == 1003 { 4.0 } else { 1.0 });
    });
    let pinned = || {
        let mut shot = over_body(folder.path(), &file).unwrap();
        shot.scene.pins.push(PinDescription {
            garment: 0,
            target: PinTarget::BodyNearest { body: 0, vertices: vec![0, 1] },
            axes: [true; 3],
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            hold: PinHold::Hard,
        });
        shot.scene.effects.push(EffectRequest::of_scene("pins"));
        Shot::prepare(shot, None).unwrap()
    };
    let said = pinned().check_pins().unwrap().join("; ");
    for part in ["garment \"sheet\", frame 1003: vertices 0 and 1", "times their distance", "worst of 1 frames"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert_eq!(Shot::prepare(falling(folder.path()), None).unwrap().check_pins().unwrap(), Vec::<String>::new());
    let mut heard = Listener::default();
    let report = pinned().run(&options(folder.path()), &mut heard).unwrap();
    assert!(heard.0.iter().any(|note| said.starts_with(note.as_str())), "{:?}", heard.0);
    let exceeded: Vec<_> = report.exceeded.iter().map(|e| (e.name, e.total, e.first_frame)).collect();
    assert_eq!(exceeded, [("pins_stretched", 1, 1003)]);
    let record = std::fs::read_to_string(folder.path().join("out/run.jsonl")).unwrap();
    assert!(record.contains("\"strain_between_pins\":{\"garment\":\"sheet\""), "{record}");
    // Where there is nothing to do, the same is said again.
    let mut again = Listener::default();
    assert_eq!(pinned().run(&options(folder.path()), &mut again).unwrap().outcome, Outcome::NothingToDo);
    assert_eq!(again.0, heard.0);
}

#[test]
fn quads_of_a_body_are_cut_along_the_shorter_diagonal_of_the_first_frame_of_the_shot() {
    let folder = tempfile::tempdir().unwrap();
    // Sheared to the one side in the first sample of the file, and to the other one from the shot's first frame on.
    mesh_file(folder.path(), &[1000, 1001, 1002], 4, |frame| {
        let s = if frame == 1000 { -0.5 } else { 0.5 };
        (vec![[0.0, 0.0, 0.0], [s, 0.0, 1.0], [1.0 + s, 0.0, 1.0], [1.0, 0.0, 0.0]], vec![0, 1, 2, 3])
    });
    let scene = "drapery = 1\n[shot]\nframes = \"1001-1002\"\n[units]\nlength = \"m\"\nup = \"Y\"\n\
                 [[body]]\nname = \"quad\"\nfile = \"body.abc\"\n\
                 [[garment]]\nname = \"sheet\"\npanel = { resolution = 2, center = [0, 1, 0] }\ndensity = \"100 g/m²\"\n";
    let path = folder.path().join("quad.toml");
    std::fs::write(&path, scene).unwrap();
    let shot = scene_file::load(&path, &[]).unwrap().resolve().unwrap_or_else(|errors| panic!("{errors:?}"));
    let BodyShape::Surface { triangles, .. } = &shot.scene.bodies[0].shape else { panic!("it is a mesh") };
    // Corners run the other way in Alembic.
    assert_eq!(*triangles, [[3, 2, 1], [3, 1, 0]]);
}

#[test]
fn texture_coordinates_that_are_no_numbers_are_delivered() {
    let folder = tempfile::tempdir().unwrap();
    let run = |out: &str, last: i64| {
        let mut shot = falling(folder.path());
        shot.output.formats = vec!["abc".to_owned(), "h5".to_owned()];
        let (values, indices) = (vec![[f32::NAN, f32::INFINITY]; 9], shot.scene.garments[0].mesh.face_indices.clone());
        let uvs = Some(Uvs { name: String::new(), values, indices });
        shot.garments[0] = GarmentMesh::kept(MeshData { uvs, ..MeshData::new(sheet(1.0)) });
        let options = RunOptions::new(folder.path().join(out));
        Shot::prepare(shot, Some([1001, last])).unwrap().run(&options, &mut |_: &FrameReport<'_>| {}).unwrap()
    };
    run("whole", 1003);
    run("out", 1002);
    assert_eq!(run("out", 1003).outcome, Outcome::Done);
    for file in ["sheet.abc", "sheet.h5"] {
        let bytes = |out: &str| std::fs::read(folder.path().join(out).join(file)).unwrap();
        assert!(bytes("out") == bytes("whole"), "{file}");
    }
}

#[test]
fn a_body_that_jumps_and_grows_is_said_with_its_frame_before_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let warned = |change: &dyn Fn(i64, &mut Vec<[f32; 3]>)| {
        let file = body_file(folder.path(), &[1001, 1002, 1003], |frame, points, _| change(frame, points));
        let mut shot = over_body(folder.path(), &file).unwrap();
        // Out of the body's way.
        shot.scene.garments[0].mesh = sheet(5.0);
        // Of what no rule has.
        let shot = Shot::prepare(shot, None).unwrap();
        let said = shot.warnings().iter().filter(|warning| warning.rule.is_none()).map(ToString::to_string);
        said.collect::<Vec<_>>().join("\n")
    };
    assert_eq!(warned(&|_, _| {}), "");
    let jump = warned(&|frame, points| {
        if frame == 1003 {
            points.iter_mut().for_each(|p| p[0] += 100.0);
        }
    });
    assert!(jump.contains("body \"hero\"") && jump.contains("frame 1003: vertex 0 moves at 2400 m/s"), "{jump}");
    let grown = warned(&|frame, points| {
        if frame == 1002 {
            points.iter_mut().flatten().for_each(|c| *c *= 3.0);
        }
    });
    assert!(grown.contains("frame 1002: the body is 3.000 times as large as in the sample before"), "{grown}");
    let point = warned(&|frame, points| {
        if frame == 1002 {
            points.fill([0.0; 3]);
        }
    });
    assert!(point.contains("frame 1002") && point.contains("have no area"), "{point}");
}

#[test]
fn a_frame_of_far_more_steps_than_planned_ends_the_run_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut shot = falling(folder.path());
    let garment = &mut shot.scene.garments[0];
    garment.start_velocities = Some((0..9).map(|i| Vec3::x() * f64::from(i % 3)).collect());
    shot.scene.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 1e-3));
    // Edges that change by a millionth of their length in a step, at a rate of a few 1/s.
    shot.scene.solver.strain_per_step = Some(1e-7);
    let error =
        Shot::prepare(shot, None).unwrap().run(&options(folder.path()), &mut |_: &FrameReport<'_>| {}).unwrap_err();
    let said = error.to_string();
    assert!(said.starts_with("frame 1002, time ") && said.contains("not complete after 100000 steps"), "{said}");
    assert!(folder.path().join("out/debug").read_dir().unwrap().count() > 0, "a bundle is left behind");
}

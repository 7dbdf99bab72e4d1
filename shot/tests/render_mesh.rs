//! Render meshes: caches of their own, the same bytes after any stop, and what is said of bad bindings.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::geometry::surface_binding::SurfaceBinding;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{EffectRequest, GarmentDescription, SceneDescription, Timeline};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::formats::by_extension;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::MeshData;
use drapery_io::shot_description::{RenderMeshDescription, ShotDescription};
use drapery_io::units::{LengthUnit, Units, UpAxis};
use drapery_shot::Shot;
use drapery_shot::recorded_frames::RecordedCache;
use drapery_shot::run::{FrameReport, Outcome, RunOptions};
use drapery_shot::run_record::reader::Record;

use common::described;

const FRAMES: [i64; 2] = [1001, 1005];

/// A square of cloth of n × n points, 1 m wide, at a height [m].
fn sheet(n: u32, height: f64) -> PolygonMesh {
    let across = f64::from(n - 1);
    let point = |i: u32| Vec3::new(f64::from(i % n) / across, height, f64::from(i / n) / across);
    let quad = |i: u32| [i, i + n, i + n + 1, i + 1];
    let quads = (0..n - 1).flat_map(|row| (0..n - 1).map(move |column| row * n + column));
    let face_indices = quads.flat_map(quad).collect();
    PolygonMesh {
        points: (0..n * n).map(point).collect(),
        face_counts: vec![4; ((n - 1) * (n - 1)) as usize],
        face_indices,
    }
}

fn render_mesh(mesh: PolygonMesh, rigid: Vec<Vec<u32>>) -> RenderMeshDescription {
    RenderMeshDescription {
        garment: 0,
        name: "sheet_render".to_owned(),
        file: PathBuf::from("fine.obj"),
        units: Units::SI.into(),
        mesh: GarmentMesh::kept(MeshData::new(mesh)),
        max_distance: 0.02,
        rigid,
    }
}

/// A sheet that turns and bends as it flies, with a finer sheet 5 mm above it that follows.
fn flying(formats: &[&str], render_meshes: Vec<RenderMeshDescription>) -> ShotDescription {
    let mut scene = SceneDescription::new("flying");
    scene.timeline = Timeline { origin: FRAMES[0], start: FRAMES[0], ..Timeline::default() };
    let mut garment = GarmentDescription::new("sheet", sheet(4, 1.0), 0.2);
    let turning = |p: &Vec3| Vec3::new(2.0 * p.z, 3.0 * p.x * p.x, -2.0 * p.x);
    garment.start_velocities = Some(garment.mesh.points.iter().map(turning).collect());
    scene.garments.push(garment);
    scene.effects.push(EffectRequest::of_scene("gravity"));
    let units = Units { length: LengthUnit::Centimetre, up: UpAxis::Z };
    let shot = described(scene, FRAMES, formats, units);
    ShotDescription { resolved: "# all settings\n".into(), render_meshes, ..shot }
}

/// All formats of this build.
fn formats() -> Vec<&'static str> {
    ["abc", "h5", "usd"].into_iter().filter(|word| by_extension(word).is_some()).collect()
}

fn run(folder: &Path, formats: &[&str], last: i64) -> Outcome {
    let shot = flying(formats, vec![render_mesh(sheet(9, 1.005), vec![vec![0, 1, 9, 10]])]);
    let shot = Shot::prepare(shot, Some([FRAMES[0], last])).unwrap();
    assert!(shot.warnings().is_empty(), "{:?}", shot.warnings());
    shot.run(&RunOptions::new(folder.to_owned()), &mut |_: &FrameReport<'_>| {}).unwrap().outcome
}

/// Every file of a cache with its bytes.
fn bytes(folder: &Path, name: &str) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    let mut waiting = vec![folder.join(name)];
    while let Some(path) = waiting.pop() {
        if path.is_dir() {
            waiting.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else {
            files.push((path.strip_prefix(folder).unwrap().display().to_string(), fs::read(&path).unwrap()));
        }
    }
    files.sort();
    files
}

#[test]
fn a_render_mesh_has_caches_of_its_own_and_the_same_bytes_after_a_stop_or_in_a_later_format() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, stopped] = ["whole", "stopped"].map(|name| folder.path().join(name));
    assert_eq!(run(&whole, &formats(), FRAMES[1]), Outcome::Done);
    run(&stopped, &["abc"], 1003);
    assert_eq!(run(&stopped, &formats(), FRAMES[1]), Outcome::Done);
    assert_eq!(run(&stopped, &formats(), FRAMES[1]), Outcome::NothingToDo);
    let mut names: Vec<String> = formats().iter().map(|format| format!("sheet_render.{format}")).collect();
    names.extend(by_extension("usd").map(|_| "sheet_render.clips".to_owned()));
    for name in names {
        let (a, b) = (bytes(&whole, &name), bytes(&stopped, &name));
        assert!(!a.is_empty() && a == b, "{name}");
    }
    let manifest: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(whole.join("manifest.json")).unwrap()).unwrap();
    assert_eq!(manifest["garments"][1]["render_mesh_of"], "sheet");
    assert_eq!(manifest["garments"][1]["points"], 81);
    assert!(manifest["garments"][0].get("render_mesh_of").is_none());
    if by_extension("usd").is_some() {
        let stage = fs::read_to_string(whole.join("flying.usda")).unwrap();
        assert!(stage.contains("@./sheet_render.usd@"), "{stage}");
    }
}

#[test]
fn every_format_holds_the_same_numbers_and_changed_ones_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    run(out, &formats(), FRAMES[1]);
    let record = Record::read(&out.join("run.jsonl")).unwrap();
    let mut first = None;
    for format in formats() {
        let path = out.join(format!("sheet_render.{format}"));
        let cache = CacheFrames::open(&path).unwrap();
        let frames: Vec<_> = (0..5).map(|sample| cache.samples.frame(0, sample).unwrap()).collect();
        for frame in &frames {
            let normals = frame.normals.as_ref().unwrap();
            assert_eq!((normals.len(), frame.velocities.as_ref().unwrap().len()), (81, 81), "{format}");
            let lengths = normals.iter().map(|n| n.map(f64::from).into_iter().map(|c| c * c).sum::<f64>().sqrt());
            assert!(lengths.into_iter().all(|length| (length - 1.0).abs() < 1e-6), "{format}");
        }
        // Upwards, which is z here.
        assert!((frames[0].normals.as_ref().unwrap()[40][2] - 1.0).abs() < 1e-6, "{format}");
        let numbers: Vec<_> = frames.into_iter().map(|f| (f.positions, f.velocities, f.normals)).collect();
        assert!(*first.get_or_insert_with(|| numbers.clone()) == numbers, "{format}");
        let recorded = RecordedCache { path: &path, root: None, garment: "sheet_render" };
        assert_eq!(recorded.compare(&record, FRAMES, false).unwrap().sound, 5, "{format}");
    }
    let plain = CacheFrames::open(&out.join("sheet.h5")).unwrap();
    assert_eq!(plain.samples.frame(0, 0).unwrap().normals, None, "garments have none");
    // The last normal of the last frame but one.
    let path = out.join("sheet_render.h5");
    let (mut bytes, normals) = (fs::read(&path).unwrap(), first.unwrap()[3].2.clone().unwrap());
    let stored: Vec<u8> = normals.iter().flatten().flat_map(|n| n.to_ne_bytes()).collect();
    let place = bytes.windows(stored.len()).position(|window| window == stored).unwrap() + stored.len() - 1;
    bytes[place] ^= 1;
    fs::write(&path, bytes).unwrap();
    let compared = RecordedCache { path: &path, root: None, garment: "sheet_render" }.compare(&record, FRAMES, false);
    let faults = compared.unwrap().faults;
    assert_eq!((faults.len(), faults[0].frame), (1, 1004));
    assert!(faults[0].what.contains("normals"), "{}", faults[0]);
}

#[test]
fn a_bad_binding_is_told_before_anything_runs() {
    let warnings = |mesh: PolygonMesh, rigid: Vec<Vec<u32>>| {
        let shot = Shot::prepare(flying(&["abc"], vec![render_mesh(mesh, rigid)]), None).unwrap();
        shot.warnings().iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    let mut far = sheet(9, 1.005);
    far.points[40].y = 1.3;
    far.points[41].y = 1.1;
    let text = warnings(far.clone(), Vec::new());
    let expected =
        "garment \"sheet\", render mesh (fine.obj): 2 of 81 points are farther than 20.0 mm from the cloth at rest";
    assert!(text.contains(expected) && text.contains("point 40, 300.0 mm away"), "{text}");
    assert_eq!(warnings(far, vec![vec![40, 41, 49, 50]]), "", "of a rigid part its closest point counts");
    let mut turned = sheet(9, 1.005);
    turned.face_indices.reverse();
    assert!(warnings(turned, Vec::new()).contains("it is flipped"));
    let mut loose = sheet(9, 1.005);
    loose.points.push(Vec3::new(0.5, 1.0, 0.5));
    assert!(warnings(loose, Vec::new()).contains("1 points belong to no face"));
    let mut broken = sheet(9, 1.005);
    broken.points[7].x = f64::NAN;
    let refused = Shot::prepare(flying(&["h5"], vec![render_mesh(broken, Vec::new())]), None).err().unwrap();
    assert!(refused.to_string().contains("the position of point 7 is not finite"), "{refused}");
}

#[test]
fn samples_between_frames_are_bound_to_the_cloth_as_it_is_then() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let fine = sheet(9, 1.005);
    let mut shot = flying(&formats(), vec![render_mesh(fine.clone(), Vec::new())]);
    shot.output.sub_frames = vec![0.25, 0.75];
    let shot = Shot::prepare(shot, None).unwrap();
    shot.run(&RunOptions::new(out.to_owned()), &mut |_: &FrameReport<'_>| {}).unwrap();
    let cloth = sheet(4, 1.0);
    let binding = SurfaceBinding::new(cloth.points.clone(), cloth.triangulate().0, &fine.points, &[]).unwrap();
    for format in formats().into_iter().filter(|format| *format != "h5") {
        let open = |name: &str| CacheFrames::open(&out.join(format!("{name}.{format}"))).unwrap();
        let (plain, render) = (open("sheet"), open("sheet_render"));
        let between = &render.meshes[0].between;
        assert_eq!((between, between.len()), (&plain.meshes[0].between, 8), "{format}");
        let first = between[0];
        assert!(first.frame == 1001 && (first.behind - 0.25).abs() < 1e-9, "{format}");
        for sample in 0..13 {
            let x = plain.positions(0, sample).unwrap();
            let expected = binding.positions(&x);
            let found = render.positions(0, sample).unwrap();
            // Both were rounded to single precision, in centimetres, of places below 4 m; offsets turn with what is rounded, by
            // less than that.
            let off = found.iter().zip(&expected).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(off < 1e-6, "{format}, sample {sample}: {off}");
            assert!(render.samples.frame(0, sample).unwrap().normals.is_some(), "{format}");
        }
        // Not those of the frame before: it turns.
        let [frame, behind] = [0, 5].map(|sample| render.positions(0, sample).unwrap());
        assert!((frame[80] - behind[80]).norm() > 1e-3, "{format}");
    }
}

//! Meshes from files of other programs arrive where the reference library says, in world space, at every sample.

use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use drapery_io::input_motion::{InputMotion, Preroll};
use drapery_io::mesh_source::MeshSource;
use drapery_io::units::Units;
use serde_json::Value;

/// The shared test data, or `None` (said once) where the project is checked out alone.
fn shared(relative: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(relative);
    if !path.exists() {
        println!("skipped: no shared data");
        return None;
    }
    Some(path)
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn vector(value: &Value) -> Vec3 {
    Vec3::from_fn(|i, _| value[i].as_f64().unwrap())
}

fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    let empty = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    points.iter().fold(empty, |(low, high), p| (low.inf(p), high.sup(p)))
}

/// Volume enclosed by the faces as they are wound; positive when they are counter-clockwise seen from outside.
fn volume(points: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let at = |i: u32| points[i as usize];
    triangles.iter().map(|&[a, b, c]| at(a).dot(&at(b).cross(&at(c))) / 6.0).sum()
}

#[test]
fn the_walking_woman_is_where_the_reference_says_and_wound_outwards() {
    let Some(folder) = shared("woman_walk_dance") else { return };
    let source = MeshSource::open(&folder.join("body.abc"), None, Units::SI).unwrap();
    assert_eq!(source.objects(), ["/woman/woman"]);
    assert_eq!(source.sample_times().len(), 97);
    for sample in json(&folder.join("body_expected.json"))["samples"].as_array().unwrap() {
        let data = source.mesh_at(sample["time_s"].as_f64().unwrap()).unwrap();
        let points = &data.mesh.points;
        let (low, high) = bounds(points);
        for (found, expected) in [
            (points[0], "vertex_0"),
            (points[points.len() - 1], "vertex_last"),
            (low, "min"),
            (high, "max"),
            (points.iter().sum::<Vec3>() / points.len() as f64, "centroid"),
        ] {
            // Positions are f32 in the file: half a unit in the last place at 1.6 m is 6e-8 m.
            assert!((found - vector(&sample[expected])).norm() < 2e-7, "{expected} {found}");
        }
    }
    // The README gives -0.04796 m³ for the indices as stored, clockwise.
    let data = source.mesh_at(0.0).unwrap();
    let volume = volume(&data.mesh.points, &data.mesh.triangulate().0);
    assert!((volume - 0.04796).abs() < 1e-5, "{volume}");
}

#[test]
fn a_still_mesh_under_a_turning_transform_turns() {
    let Some(path) = shared("drape/sphere_spin.abc") else { return };
    let source = MeshSource::open(&path, None, Units::SI).unwrap();
    let at = |frame: f64| {
        let mut points = Vec::new();
        source.positions_at(frame / 24.0, &mut points).unwrap();
        points
    };
    assert!(source.covers(0.0, 5.0) && !source.covers(0.0, 5.1));
    let (still, quarter) = (at(24.0), at(36.0));
    for (p, q) in still.iter().zip(&quarter) {
        // A quarter turn about +y takes (x, y, z) to (z, y, -x).
        assert!((Vec3::new(p.z, p.y, -p.x) - q).norm() < 1e-6);
    }
    // Between samples, on the straight line between them; before the first, held.
    let (a, b, half) = (at(30.0), at(31.0), at(30.5));
    assert!(half.iter().zip(a.iter().zip(&b)).all(|(h, (a, b))| ((a + b) / 2.0 - h).norm() < 1e-12));
    assert_eq!(at(-3.0), at(0.0));
}

#[test]
fn foreign_archives_read_as_the_reference_library_reads_them() {
    let Some(folder) = shared("foreign_caches") else { return };
    let mut checked = 0;
    for file in json(&folder.join("expected.json"))["abc"].as_array().unwrap() {
        let path = folder.join("abc").join(file["file"].as_str().unwrap());
        // Below an instance the expected file leaves out the transform of the instance's source.
        let objects = file["objects"].as_array().into_iter().flatten();
        for object in objects.filter(|object| !object["path"].as_str().unwrap().contains("/f/g/")) {
            for sample in object["samples"].as_array().into_iter().flatten() {
                if sample.get("world_min").is_none() {
                    continue;
                }
                let source = MeshSource::open(&path, object["path"].as_str(), Units::SI).unwrap();
                let time = sample["time"].as_f64().unwrap();
                let points = source.mesh_at(time).unwrap().mesh.points;
                assert_eq!(points.len() as u64, sample["num_points"].as_u64().unwrap());
                let (low, high) = bounds(&points);
                let size = 1.0 + low.norm() + high.norm();
                for (found, expected) in [(low, "world_min"), (high, "world_max"), (points[0], "first_world")] {
                    let expected = vector(&sample[expected]);
                    assert!((found - expected).norm() < 2e-6 * size, "{} {time} s: {found} {expected}", path.display());
                }
                checked += 1;
            }
        }
    }
    assert!(checked >= 20, "{checked} samples compared");
}

#[test]
fn a_mirrored_parent_does_not_turn_the_mesh_inside_out() {
    let Some(path) = shared("foreign_caches/abc/blender_nested_mirrored_25fps.abc") else { return };
    let source = MeshSource::open(&path, None, Units::SI).unwrap();
    let mirrored = source.mesh_at(0.0).unwrap().mesh;
    let archive = drapery_alembic::Archive::open(&path).unwrap();
    let stored = drapery_alembic::PolyMesh::all(&archive).unwrap()[0].faces(0).unwrap();
    // Stored clockwise in a mirrored frame is counter-clockwise in the world.
    assert_eq!(mirrored.face_indices, stored.face_indices);
}

#[test]
fn half_frames_and_missing_meshes_are_seen() {
    let Some(folder) = shared("foreign_caches/abc") else { return };
    let halves = MeshSource::open(&folder.join("blender_half_frames.abc"), None, Units::SI).unwrap();
    assert_eq!(halves.times_between(1001.0 / 24.0, 1002.0 / 24.0).len(), 1);
    assert!(halves.covers(1001.0 / 24.0, 1013.0 / 24.0));
    let motion =
        InputMotion { label: "body".into(), source: halves, rest: None, rows: None, own_units: false, is_made: false };
    let timeline = Timeline { origin: 1001, start: 1001, ..Timeline::default() };
    let samples = motion.samples(timeline, Preroll::default(), 1003).unwrap();
    // One sample inside the frame and one exactly at its end, in seconds since the first frame.
    assert_eq!(samples.len(), 2);
    assert!((samples[0].time - 1.5 / 24.0).abs() < 1e-9 && samples[1].time == 2.0 / 24.0);
    let curves = MeshSource::open(&folder.join("cortex_curves.abc"), None, Units::SI).unwrap_err().to_string();
    assert!(curves.contains("it contains no mesh, only") && curves.contains("Curves"), "{curves}");
    let pattern = MeshSource::open(&folder.join("mayausd_cube.abc"), Some("/nothing/*"), Units::SI).unwrap_err();
    assert!(pattern.to_string().contains("its meshes are /"), "{pattern}");
}

#[test]
fn what_is_read_in_pieces_is_what_is_read_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let quads = folder.path().join("quads.obj");
    let (columns, rows) = (150, 100);
    let mut text: String = (0..columns * rows).map(|i| format!("v {} 0.5 {}\n", i % columns, i / columns)).collect();
    for i in (0..columns * (rows - 1)).filter(|i| i % columns + 1 < columns) {
        text += &format!("f {} {} {} {}\n", i + 1, i + 2, i + columns + 2, i + columns + 1);
    }
    std::fs::write(&quads, text).unwrap();
    let mut files = vec![quads];
    files.extend(shared("woman_walk_dance").map(|folder| folder.join("body.abc")));
    files.extend(shared("foreign_caches/abc").into_iter().flat_map(|folder| {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.extension().is_some_and(|extension| extension == "abc")).collect::<Vec<_>>()
    }));
    files.sort();
    for path in files {
        // Some hold no mesh, and one may change its number of points between samples.
        let Ok(source) = MeshSource::open(&path, None, Units::SI) else { continue };
        let first = source.first_time();
        for time in [first - 1.0, first, first + 0.03, first + 0.5] {
            let Ok(whole) = source.mesh_at(time) else { continue };
            let (mut points, mut counts, mut corners, mut most) = (Vec::new(), Vec::new(), Vec::new(), 0);
            source.points_at(time, &mut |piece| points.extend_from_slice(piece)).unwrap();
            source
                .faces_at(time, &mut |piece, indices| {
                    counts.extend_from_slice(piece);
                    corners.extend_from_slice(indices);
                    most = most.max(piece.len());
                })
                .unwrap();
            assert_eq!(points, whole.mesh.points, "{}, {time} s", path.display());
            assert_eq!((counts, corners), (whole.mesh.face_counts, whole.mesh.face_indices), "{}", path.display());
            assert!(most <= 8192, "{most} faces of {} at once", path.display());
        }
    }
}

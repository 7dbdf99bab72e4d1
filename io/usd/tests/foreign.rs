//! Stages of other programs read as Pixar's library reads them.

use std::path::{Path, PathBuf};

use drapery_usd::read::{Chosen, Entry, MeshSample, Stage};
use serde_json::Value;

fn shared_data() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    if !folder.is_dir() {
        println!("skipped: no shared data");
        return None;
    }
    Some(folder)
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[track_caller]
fn assert_close(ours: &[f64], expected: &Value, what: &str) {
    let expected: Vec<f64> = expected.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    // f32 of a scene of this size.
    let close = |(a, b): (&f64, &f64)| (a - b).abs() <= 2e-6 * b.abs().max(1.0);
    assert!(
        ours.len() == expected.len() && ours.iter().zip(&expected).all(close),
        "{what}: {ours:?}, not {expected:?}"
    );
}

/// Least and greatest coordinates.
fn extremes(points: &[[f64; 3]]) -> [[f64; 3]; 2] {
    let fold = |start: f64, pick: fn(f64, f64) -> f64| -> [f64; 3] {
        std::array::from_fn(|axis| points.iter().map(|p| p[axis]).fold(start, pick))
    };
    [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
}

fn choose(stage: &Stage, path: &str) -> Chosen {
    let place = stage.about().meshes.iter().position(|entry| entry.path == path);
    stage.choose(&[place.unwrap_or_else(|| panic!("no mesh {path}"))]).unwrap()
}

fn check_sample(sample: &MeshSample, expected: &Value, what: &str) {
    assert_eq!(sample.points.len() as u64, expected["num_points"].as_u64().unwrap(), "{what}");
    assert_close(&sample.points[0], &expected["first_world"], what);
    let [min, max] = extremes(&sample.points);
    assert_close(&min, &expected["world_min"], what);
    assert_close(&max, &expected["world_max"], what);
}

fn check_mesh(stage: &Stage, expected: &Value, file: &str) {
    let path = expected["path"].as_str().unwrap();
    let what = format!("{file} {path}");
    let chosen = choose(stage, path);
    for sample in expected["samples"].as_array().unwrap() {
        // At the default time nothing moves; the first code is nearest to it.
        let first = chosen.codes.first().copied().unwrap_or(0.0);
        let read = stage.mesh(0, sample["time"].as_f64().unwrap_or(first));
        if sample.get("num_points").is_none() {
            let error = read.unwrap_err().to_string();
            assert!(error.contains(path) && error.contains("points"), "{error}");
            continue;
        }
        let read = read.unwrap_or_else(|error| panic!("{what}: {error}"));
        check_sample(&read, sample, &what);
        assert_eq!(read.faces.counts.len() as u64, expected["face_counts"].as_u64().unwrap(), "{what}");
        assert_eq!(read.faces.indices.len() as u64, expected["face_indices"].as_u64().unwrap(), "{what}");
        assert_eq!(read.subdivision, expected["subdivision"], "{what}");
    }
}

#[test]
fn every_foreign_stage_reads_as_in_pixars_library() {
    let Some(folder) = shared_data() else { return };
    let folder = folder.join("foreign_caches");
    let (mut files, mut meshes) = (0, 0);
    for expected in json(&folder.join("expected.json"))["usd"].as_array().unwrap() {
        let file = expected["file"].as_str().unwrap();
        let stage = Stage::open(&folder.join("usd").join(file)).unwrap_or_else(|error| panic!("{error}"));
        files += 1;
        let about = stage.about();
        assert!(about.flaws.is_empty(), "{file}: {:?}", about.flaws);
        // What is not said has USD's default.
        assert_eq!(about.up_axis.as_deref().unwrap_or("Y"), expected["up_axis"], "{file}");
        assert_eq!(about.metres_per_unit.unwrap_or(0.01), expected["meters_per_unit"].as_f64().unwrap(), "{file}");
        assert_eq!(about.codes_per_second, expected["time_codes_per_second"].as_f64().unwrap(), "{file}");
        assert_eq!(about.frames_per_second.unwrap_or(24.0), expected["frames_per_second"].as_f64().unwrap(), "{file}");
        let range = ["start", "end"].map(|key| expected[key].as_f64().unwrap());
        assert_eq!(about.range.unwrap_or_default(), range, "{file}");
        let default = about.default_prim.as_ref().map(|name| format!("/{name}"));
        assert_eq!(default.as_deref(), expected["default_prim"].as_str(), "{file}");
        let mut paths: Vec<&str> =
            expected["meshes"].as_array().unwrap().iter().map(|mesh| mesh["path"].as_str().unwrap()).collect();
        paths.sort_unstable();
        assert_eq!(about.meshes.iter().map(|entry: &Entry| entry.path.as_str()).collect::<Vec<_>>(), paths, "{file}");
        for mesh in expected["meshes"].as_array().unwrap() {
            // This file holds the skeleton alone, and what is expected are its points before it moves them.
            if file != "usdwg_RiggedFigure.usdz" {
                check_mesh(&stage, mesh, file);
            }
            meshes += 1;
        }
    }
    assert!(files >= 24 && meshes >= 20, "{files} files, {meshes} meshes");
}

#[test]
fn a_character_in_a_package_moves_as_pixars_library_baked_it() {
    let Some(folder) = shared_data() else { return };
    let open = |file: &str| {
        let stage = Stage::open(&folder.join("foreign_caches/usd").join(file)).unwrap();
        let chosen = choose(&stage, "/RiggedFigure/Geom/Z_UP/Armature/torso_joint_1_2/Proxy_1");
        (stage, chosen)
    };
    let (baked, times) = open("riggedfigure_baked.usdc");
    let (skinned, codes) = open("usdwg_RiggedFigure.usdz");
    assert_eq!((codes.codes.first(), codes.codes.last()), (times.codes.first(), times.codes.last()));
    for code in [0.0, 7.0, 15.0, 30.0] {
        let [ours, theirs] = [&skinned, &baked].map(|stage| stage.points(0, code).unwrap());
        let apart = ours.iter().zip(&theirs).map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max));
        // A figure of 1.5 m in single precision, moved by a chain of joints that was computed in single precision.
        let apart = apart.fold(0.0, f64::max);
        assert!(apart < 2e-6, "time code {code}: {apart} m apart");
    }
}

#[test]
fn the_body_of_the_dressed_woman_is_where_it_is_expected() {
    let Some(folder) = shared_data() else { return };
    let folder = folder.join("woman_walk_dance");
    let stage = Stage::open(&folder.join("body_lowres.usdc")).unwrap();
    let chosen = stage.choose(&[0]).unwrap();
    assert_eq!(chosen.codes, (0..97).map(f64::from).collect::<Vec<_>>());
    for expected in json(&folder.join("body_lowres_expected.json"))["samples"].as_array().unwrap() {
        let frame = expected["frame"].as_f64().unwrap();
        let points = stage.points(0, frame).unwrap();
        let what = format!("frame {frame}");
        assert_close(&points[0], &expected["vertex_0"], &what);
        assert_close(&points[points.len() - 1], &expected["vertex_last"], &what);
        let [min, max] = extremes(&points);
        assert_close(&min, &expected["min"], &what);
        assert_close(&max, &expected["max"], &what);
    }
    // Counter-clockwise from outside: the volume is that of its README, positive.
    let MeshSample { points, faces, .. } = stage.mesh(0, 0.0).unwrap();
    let corners = faces.indices.chunks_exact(3).map(|face| [0, 1, 2].map(|i| points[face[i] as usize]));
    let volume: f64 = corners
        .map(|[a, b, c]| {
            let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
            (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]) / 6.0
        })
        .sum();
    assert!((volume - 0.04788).abs() < 1e-5, "{volume} m³");
}

//! Frames that have changed on the disk while a run stood still: found when it goes on, and by their record.

#[path = "../../shot/tests/common/mod.rs"]
mod common;

use std::fs;
use std::path::{Path, PathBuf};

use drapery_analysis::verify;
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{EffectRequest, GarmentDescription, SceneDescription, Timeline};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::units::Units;
use drapery_shot::Shot;
use drapery_shot::ShotError;
use drapery_shot::run::{FrameReport, Observer, Outcome, Resume, RunOptions, RunReport};

use common::described;

/// The caches of the run.
const FILES: [&str; 2] = ["sheet.abc", "sheet.h5"];

/// A triangle of cloth that falls past others in frames 1001 to 1008; crossings are counted.
fn shot(frames: i64) -> Shot {
    let mut scene = SceneDescription::new("falling");
    scene.timeline = Timeline { origin: 1001, start: 1001, ..Timeline::default() };
    let points = vec![Vec3::new(0.1, 1.0, 0.2), Vec3::new(0.4, 1.1, 0.3), Vec3::new(0.1, 1.0, 0.6)];
    scene.garments.push(GarmentDescription::new("sheet", PolygonMesh::from_triangles(points, &[[0, 1, 2]]), 0.2));
    for effect in ["gravity", "self_collision"] {
        scene.effects.push(EffectRequest::of_scene(effect));
    }
    let described = described(scene, [1001, 1008], &["abc", "h5"], Units::SI);
    Shot::prepare(described, Some([1001, frames])).unwrap()
}

/// Notes and frames that a run reports.
#[derive(Default)]
struct Heard {
    notes: Vec<String>,
    frames: Vec<i64>,
}

impl Observer for Heard {
    fn note(&mut self, text: String) {
        self.notes.push(text);
    }

    fn frame(&mut self, report: &FrameReport<'_>) {
        self.frames.push(report.frame);
    }
}

fn run(out: &Path, last: i64, resume: Resume) -> (Result<RunReport, ShotError>, Heard) {
    let options = RunOptions { pinned: vec![1003], resume, ..RunOptions::new(out.to_owned()) };
    let mut heard = Heard::default();
    let report = shot(last).run(&options, &mut heard);
    (report, heard)
}

/// A run of all frames, and the folder of one that has stopped behind frame 1006, with checkpoints of 1003 and 1006.
fn stopped() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (whole, out) = (folder.path().join("whole"), folder.path().join("out"));
    run(&whole, 1008, Resume::Auto).0.unwrap();
    run(&out, 1006, Resume::Auto).0.unwrap();
    (folder, whole, out)
}

/// Values of a frame that are changed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Values {
    Positions,
    Velocities,
    Bounds,
}

/// Flips the lowest bit of the first value of a frame of a cache.
fn flip(path: &Path, frame: i64, values: Values) {
    let cache = CacheFrames::open(path).unwrap();
    let sample = cache.meshes[0].frames.binary_search(&frame).unwrap();
    let stored = cache.samples.frame(0, sample).unwrap();
    drop(cache);
    let of = |vectors: &[[f32; 3]]| vectors.iter().flatten().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let sought = match values {
        Values::Positions => of(&stored.positions),
        Values::Velocities => of(&stored.velocities.unwrap()),
        // The least y: that of the first point, which the bounds hold in double precision.
        Values::Bounds => f64::from(stored.positions[0][1].min(stored.positions[2][1])).to_le_bytes().to_vec(),
    };
    let mut bytes = fs::read(path).unwrap();
    let at = bytes.windows(sought.len()).rposition(|window| window == sought).expect("the file holds the frame");
    bytes[at] ^= 1;
    fs::write(path, bytes).unwrap();
}

fn assert_same_caches(out: &Path, whole: &Path) {
    for file in FILES {
        assert!(fs::read(out.join(file)).unwrap() == fs::read(whole.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn a_frame_that_has_changed_on_the_disk_is_named_and_simulated_again_to_the_same_bytes() {
    let cases = [(0, Values::Positions), (0, Values::Velocities), (0, Values::Bounds), (1, Values::Positions)];
    for (file, values) in cases.into_iter().chain([(1, Values::Velocities)]) {
        let (_folder, whole, out) = stopped();
        flip(&out.join(FILES[file]), 1005, values);
        let (report, heard) = run(&out, 1008, Resume::Auto);
        assert_eq!(report.unwrap().outcome, Outcome::Done);
        assert_eq!(heard.frames, [1004, 1005, 1006, 1007, 1008], "{values:?}");
        let said = heard.notes.iter().find(|note| note.contains("frame 1005")).expect("the frame is named");
        assert!(said.contains(FILES[file]) && said.contains("do not match"), "{said}");
        assert_same_caches(&out, &whole);
        assert!(out.join("stale/attempt_002").join(FILES[file]).is_file(), "what was there is not lost");
        assert!(verify::recorded(&out, &[]).unwrap().failures.is_empty());
    }
}

#[test]
fn a_run_without_a_checkpoint_before_the_frame_that_has_changed_starts_anew() {
    let (_folder, whole, out) = stopped();
    flip(&out.join("sheet.h5"), 1002, Values::Positions);
    flip(&out.join("sheet.abc"), 1005, Values::Positions);
    let (report, heard) = run(&out, 1008, Resume::Auto);
    assert_eq!(report.unwrap().outcome, Outcome::Done);
    assert_eq!(heard.frames.first(), Some(&1001));
    assert!(heard.notes.iter().any(|note| note.contains("sheet.h5: frame 1002")), "{:?}", heard.notes);
    assert_same_caches(&out, &whole);
}

#[test]
fn a_checkpoint_that_was_asked_for_is_refused_behind_a_frame_that_has_changed() {
    let (_folder, whole, out) = stopped();
    flip(&out.join("sheet.abc"), 1005, Values::Positions);
    let refused = run(&out, 1008, Resume::Frame(1006)).0.unwrap_err().to_string();
    for part in ["sheet.abc", "frame 1005", "positions", "--resume", "--overwrite"] {
        assert!(refused.contains(part), "{part}: {refused}");
    }
    assert_eq!(run(&out, 1008, Resume::Frame(1003)).1.frames, [1004, 1005, 1006, 1007, 1008]);
    assert_same_caches(&out, &whole);
}

#[test]
fn a_run_goes_on_without_digests_and_verify_names_the_frames() {
    let (_folder, whole, out) = stopped();
    let record = fs::read_to_string(out.join("run.jsonl")).unwrap();
    fs::write(out.join("run.jsonl"), record.replace("\"digests\"", "\"other\"")).unwrap();
    let (report, heard) = run(&out, 1008, Resume::Auto);
    assert_eq!(report.unwrap().outcome, Outcome::Done);
    assert_eq!(heard.frames, [1007, 1008]);
    assert_eq!(heard.notes.len(), 1, "{:?}", heard.notes);
    assert!(heard.notes[0].contains("frames 1001-1006") && heard.notes[0].contains("cannot be verified"));
    assert_same_caches(&out, &whole);
    let found = verify::recorded(&out, &[]).unwrap();
    assert!(found.failures.len() == 2 && found.failures[0].contains("frames 1001-1006"), "{found:?}");
}

#[test]
fn a_cache_of_which_no_frame_could_be_compared_is_not_said_to_keep_every_rule() {
    let (_folder, whole, _) = stopped();
    fs::write(whole.join("run.jsonl"), "").unwrap();
    let found = verify::recorded(&whole, &[]).unwrap();
    assert!(found.failures.len() == 2 && found.failures[0].contains("no digests"), "{found:?}");
}

#[test]
fn a_run_whose_frames_are_said_to_be_there_looks_for_them() {
    let (_folder, whole, out) = stopped();
    assert_eq!(run(&whole, 1008, Resume::Auto).0.unwrap().outcome, Outcome::NothingToDo);
    fs::write(whole.join("sheet.h5"), "").unwrap();
    let refused = run(&whole, 1008, Resume::Auto).0.unwrap_err().to_string();
    assert!(refused.contains("sheet.h5") && refused.contains("help:"), "{refused}");
    let manifest = fs::read_to_string(out.join("manifest.json")).unwrap();
    let promised = manifest.replace("\"last_complete_frame\": 1006", "\"last_complete_frame\": 9999");
    assert_ne!(promised, manifest);
    fs::write(out.join("manifest.json"), promised).unwrap();
    let (report, heard) = run(&out, 1008, Resume::Auto);
    assert_eq!((report.unwrap().outcome, heard.frames), (Outcome::Done, vec![1007, 1008]));
}

#[test]
fn half_a_line_of_the_record_takes_no_other_with_it() {
    let (_folder, _, out) = stopped();
    fs::remove_file(out.join("checkpoints/frame_01006.json")).unwrap();
    let mut record = fs::read(out.join("run.jsonl")).unwrap();
    record.extend_from_slice(b"{\"record\":\"fra");
    fs::write(out.join("run.jsonl"), record).unwrap();
    run(&out, 1008, Resume::Auto).0.unwrap();
    let record = fs::read_to_string(out.join("run.jsonl")).unwrap();
    let broken = record.lines().filter(|line| serde_json::from_str::<serde_json::Value>(line).is_err());
    assert_eq!(broken.collect::<Vec<_>>(), ["{\"record\":\"fra"]);
}

#[test]
fn a_record_that_somebody_has_changed_is_not_cut_in_the_middle_of_a_line() {
    let (_folder, _, out) = stopped();
    let record = fs::read_to_string(out.join("run.jsonl")).unwrap();
    fs::write(out.join("run.jsonl"), record.replace("\"steps\":", "\"steps\":      ")).unwrap();
    run(&out, 1008, Resume::Auto).0.unwrap();
    let record = fs::read_to_string(out.join("run.jsonl")).unwrap();
    assert!(record.lines().all(|line| serde_json::from_str::<serde_json::Value>(line).is_ok()), "{record}");
    assert_eq!(run(&out, 1008, Resume::Auto).0.unwrap().uncounted, [[0; 2]; 0]);
}

#[test]
fn caches_are_compared_with_the_record_frame_by_frame_also_where_they_were_copied_to() {
    let (folder, whole, _) = stopped();
    let found = verify::recorded(&whole, &[]).unwrap();
    assert!(found.failures.is_empty() && found.warnings.is_empty(), "{found:?}");
    assert!(found.facts.iter().all(|fact| fact.ends_with("8 of 8 frames match the record")), "{found:?}");
    let copy = folder.path().join("sheet.abc");
    fs::copy(whole.join("sheet.abc"), &copy).unwrap();
    flip(&copy, 1004, Values::Velocities);
    flip(&copy, 1007, Values::Bounds);
    let failures = verify::recorded(&whole, &[&copy]).unwrap().failures;
    assert_eq!(failures.len(), 2, "{failures:?}");
    assert!(failures[0].contains("frame 1004: the velocities"), "{failures:?}");
    assert!(failures[1].contains("frame 1007: the bounds"), "{failures:?}");
    // What is the same in all frames: the corners of the triangle, clockwise in Alembic.
    fs::copy(whole.join("sheet.abc"), &copy).unwrap();
    let corners: Vec<u8> = [2_i32, 1, 0].iter().flat_map(|corner| corner.to_le_bytes()).collect();
    let mut bytes = fs::read(&copy).unwrap();
    let at = bytes.windows(corners.len()).position(|window| window == corners).expect("the file holds the faces");
    bytes[at..at + corners.len()].rotate_left(4);
    fs::write(&copy, bytes).unwrap();
    let failures = verify::recorded(&whole, &[&copy]).unwrap().failures;
    assert!(failures.len() == 1 && failures[0].contains(".faceIndices"), "{failures:?}");
    fs::remove_file(whole.join("sheet.h5")).unwrap();
    let failures = verify::recorded(&whole, &[]).unwrap().failures;
    assert!(failures.len() == 1 && failures[0].contains("sheet.h5: file not found"), "{failures:?}");
    let other = folder.path().join("trousers.abc");
    assert!(verify::recorded(&whole, &[&other]).unwrap_err().to_string().contains("sheet.abc"));
}

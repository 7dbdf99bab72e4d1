//! A whole run on many ranks: the files are those of one, and all ranks end together.

mod common;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, SceneDescription, Timeline,
};
use drapery_io::checkpoint::Every;
use drapery_io::scene_file::load;
use drapery_io::shot_description::ShotDescription;
use drapery_io::units::{LengthUnit, Units, UpAxis};
use drapery_shot::Shot;
use drapery_shot::ShotError;
use drapery_shot::farm::stop::{Reason, Signal, StopRequests};
use drapery_shot::remote_simulation::{shut_down, worker_loop};
use drapery_shot::run::{FrameReport, Outcome, RunOptions, RunReport};

use common::described;

/// Exit code with which rank 0 dismisses the others here.
const CODE: u8 = 42;

/// A square of cloth of `count`² points, 1 m wide, at a height [m].
fn sheet(count: u32, height: f64) -> PolygonMesh {
    let at = |i: u32| f64::from(i) / f64::from(count - 1);
    let points = (0..count * count).map(|i| Vec3::new(at(i % count), height, at(i / count))).collect();
    let quads: Vec<u32> = (0..count - 1)
        .flat_map(|row| (0..count - 1).map(move |column| row * count + column))
        .flat_map(|i| [i, i + count, i + count + 1, i + 1])
        .collect();
    PolygonMesh { points, face_counts: vec![4; quads.len() / 4], face_indices: quads }
}

/// Two sheets that fall, one held at a corner and one over a ball, frames 1001 to 1004. The larger one has several logical
/// parts.
fn shot() -> ShotDescription {
    let mut scene = SceneDescription::new("sheets");
    scene.timeline = Timeline { origin: 1001, start: 1001, ..Timeline::default() };
    let meshes = [sheet(80, 1.0), sheet(20, 0.5)];
    for (name, mesh) in ["large", "small"].into_iter().zip(&meshes) {
        scene.garments.push(GarmentDescription::new(name, mesh.clone(), 0.2));
        let garment = scene.garments.len() - 1;
        scene.effects.push(EffectRequest::of_garment("stretch", garment).with("stiffness", 200.0));
        scene.effects.push(EffectRequest::of_garment("bending", garment).with("stiffness", 5.0));
    }
    scene.effects.extend(["gravity", "pins", "body_collision"].map(EffectRequest::of_scene));
    scene.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0, 79], offsets: Vec::new() },
        axes: [true; 3],
        from: f64::NEG_INFINITY,
        until: f64::INFINITY,
        hold: PinHold::Hard,
    });
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.2 });
    scene.bodies.push(BodyDescription::new("ball", ball, RigidMotion::at(Vec3::new(0.5, 0.295, 0.5))));
    let units = Units { length: LengthUnit::Centimetre, up: UpAxis::Z };
    let described = described(scene, [1001, 1004], &["abc", "h5"], units);
    ShotDescription { resolved: "# all settings\n".into(), ..described }
}

/// End of a run: the result of rank 0, and the exit codes of the others.
type Ended = (Result<RunReport, ShotError>, Vec<u8>);

/// Runs a shot on a number of ranks. `signalled` gets a signal to stop before it starts.
fn run(
    ranks: usize,
    threads: usize,
    out: &Path,
    signalled: Option<usize>,
    shot: impl Fn() -> ShotDescription + Sync,
) -> Ended {
    let work = |communicator| {
        let ranks = Ranks::new(communicator);
        let requests = StopRequests::default();
        if signalled == Some(ranks.rank()) {
            requests.signal(Signal::User1, SystemTime::now());
        }
        if !ranks.is_first() {
            return (None, worker_loop(&ranks, &requests, &|_| Ok(1)));
        }
        let checkpoint_every = Every::Frames(2);
        let options = RunOptions { requests, checkpoint_every, ..RunOptions::new(out.to_owned()) };
        let prepared = Shot::prepare_on(&ranks, shot(), None);
        let report = prepared.and_then(|shot| shot.run(&options, &mut |_: &FrameReport<'_>| {}));
        shut_down(&ranks, CODE);
        (Some(report), CODE)
    };
    let mut ended = LocalRanks::run(ranks, threads, work).unwrap().into_iter();
    let (report, _) = ended.next().unwrap();
    (report.unwrap(), ended.map(|(_, code)| code).collect())
}

/// Bytes of caches and checkpoints, by their paths.
fn results(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for folder in ["", "checkpoints"] {
        for entry in std::fs::read_dir(out.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "abc" || e == "h5") {
                let name = path.strip_prefix(out).unwrap().display().to_string();
                found.insert(name, std::fs::read(path).unwrap());
            }
        }
    }
    found
}

fn assert_same(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>, place: &str) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{place}");
    for (name, bytes) in a {
        assert!(bytes == &b[name], "{place}: {name} is another");
    }
}

/// A scene file of the project, coarse and short.
fn scene(path: &str, parameters: &[(&str, &str)], frames: i64) -> ShotDescription {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    let parameters: Vec<_> = parameters.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect();
    let mut shot = load(&path, &parameters).expect("a scene file").resolve().expect("its files");
    shot.frames[1] = shot.frames[0] + frames;
    shot
}

/// The scenes by which the promise is measured: any number of ranks and threads leaves the same bytes of each.
fn has_the_same_bytes_everywhere(shot: impl Fn() -> ShotDescription + Sync) {
    let folder = tempfile::tempdir().unwrap();
    let mut of_one = None;
    for (ranks, threads) in [(1, 1), (2, 2), (3, 1), (4, 1), (7, 1), (8, 1)] {
        let out = folder.path().join(format!("{ranks}"));
        let (report, _) = run(ranks, threads, &out, None, &shot);
        assert_eq!(report.unwrap().outcome, Outcome::Done);
        let results = results(&out);
        assert_same(of_one.get_or_insert_with(|| results.clone()), &results, &format!("{ranks} ranks"));
    }
}

#[test]
fn the_twister_has_the_same_bytes_on_any_number_of_ranks() {
    has_the_same_bytes_everywhere(|| scene("sample_assets/scenes/twister.toml", &[("resolution", "30")], 1));
}

#[test]
fn the_spinning_ball_has_the_same_bytes_on_any_number_of_ranks() {
    has_the_same_bytes_everywhere(|| scene("sample_assets/scenes/spinning_ball.toml", &[("resolution", "60")], 1));
}

#[test]
fn the_leaves_have_the_same_bytes_on_any_number_of_ranks() {
    has_the_same_bytes_everywhere(|| scene("sample_assets/scenes/leaves.toml", &[("rows", "1")], 1));
}

#[test]
fn the_dressed_woman_has_the_same_bytes_on_any_number_of_ranks() {
    if !Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").is_dir() {
        println!("skipped: no shared data");
        return;
    }
    has_the_same_bytes_everywhere(|| scene("tests/scenes/dressed_woman.toml", &[], 1));
}

#[test]
fn any_number_of_ranks_writes_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut of_one = None;
    for (ranks, threads) in [(1, 2), (2, 1), (3, 2), (7, 1)] {
        let out = folder.path().join(format!("{ranks}"));
        let (report, others) = run(ranks, threads, &out, None, shot);
        let report = report.unwrap();
        assert_eq!((report.outcome, report.ranks, others), (Outcome::Done, ranks, vec![CODE; ranks - 1]));
        let results = results(&out);
        assert_eq!(results.len(), 4 + 2, "two caches of two garments, and the checkpoints of frames 1003 and 1004");
        assert_same(of_one.get_or_insert_with(|| results.clone()), &results, &format!("{ranks} ranks"));
        let record = std::fs::read_to_string(out.join("run.jsonl")).unwrap();
        let lines: Vec<serde_json::Value> = record.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines[0]["ranks"].as_u64(), Some(ranks as u64));
        let frame = lines.iter().find(|line| line["record"] == "frame").unwrap();
        assert_eq!(frame["counts"]["messages"].as_u64().is_some(), ranks > 1);
        assert_eq!(frame["stages"][0]["over_ranks"].is_object(), ranks > 1);
    }
}

#[test]
fn a_run_stops_on_any_rank_s_signal_and_goes_on_with_another_number_of_ranks() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    assert_eq!(run(2, 1, &whole, None, shot).0.unwrap().outcome, Outcome::Done);
    let out = folder.path().join("stopped");
    for (ranks, signalled) in [(4, 3), (3, 0), (8, 5)] {
        let (report, others) = run(ranks, 1, &out, Some(signalled), shot);
        let report = report.unwrap();
        assert_eq!(report.outcome, Outcome::Stopped(Reason::Signal(Signal::User1)), "rank {signalled} of {ranks}");
        assert_eq!(others, vec![CODE; ranks - 1]);
    }
    assert_eq!(run(2, 2, &out, None, shot).0.unwrap().outcome, Outcome::Done);
    let (mut stopped, mut whole) = (results(&out), results(&whole));
    // Stops write checkpoints of their own, and count frames from there.
    stopped.retain(|name, _| whole.contains_key(name));
    whole.retain(|name, _| !name.contains("frame_") || stopped.contains_key(name));
    assert!(whole.contains_key("checkpoints/frame_01004.h5"));
    assert_same(&whole, &stopped, "with three stops");
    let manifest = std::fs::read_to_string(out.join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let ranks: Vec<_> = manifest["attempts"].as_array().unwrap().iter().map(|a| a["ranks"].as_u64().unwrap()).collect();
    assert_eq!(ranks, [4, 3, 8, 2]);
}

#[test]
fn a_broken_scene_or_folder_ends_all_ranks() {
    let broken = || {
        let mut broken = shot();
        broken.scene.garments[1].mesh.face_indices[7] = 4_000;
        broken
    };
    let inside = || {
        let mut inside = shot();
        inside.scene.bodies[0].shape = BodyShape::Rigid(Shape::Sphere { radius: 5.0 });
        inside
    };
    let folder = tempfile::tempdir().unwrap();
    for (shot, what) in [(broken as fn() -> ShotDescription, "small"), (inside, "start inside body \"ball\"")] {
        let (report, others) = run(3, 1, &folder.path().join("out"), None, shot);
        let error = report.unwrap_err();
        assert!(matches!(error, ShotError::Problems(_)) && error.to_string().contains(what), "{error}");
        assert_eq!(others, [CODE; 2]);
    }
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let (report, others) = run(3, 1, &file, None, shot);
    assert!(matches!(report.unwrap_err(), ShotError::Io(_)));
    assert_eq!(others, [CODE; 2]);
}

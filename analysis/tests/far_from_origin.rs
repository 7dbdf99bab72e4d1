//! A shot far from the origin: its caches count positions from a place of their own, and hold what they would hold at the origin.

#[path = "../../shot/tests/common/mod.rs"]
mod common;

use std::path::Path;

use drapery_analysis::verify::verify;
use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, RigidMotion, SceneDescription, Timeline,
};
use drapery_io::cache::{CacheFrame, CachePlan, CacheWriter};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::error::IoError;
use drapery_io::formats::{alembic, by_extension, inspect};
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::MeshData;
use drapery_io::shot_description::ShotDescription;
use drapery_io::units::{LengthUnit, Units, UpAxis};
use drapery_shot::Shot;
use drapery_shot::farm::stop::StopRequests;
use drapery_shot::remote_simulation::{shut_down, worker_loop};
use drapery_shot::run::{FrameReport, Outcome, RunOptions, RunReport};
use nalgebra::Rotation3;

use common::described;

/// A place that is no whole number of metres from the origin.
const FAR: [f64; 3] = [1e5 + 0.375, -3e4, 2e4];

/// Centimetres, Z up: origin and positions are other numbers in the file.
const UNITS: Units = Units { length: LengthUnit::Centimetre, up: UpAxis::Z };

/// A square of cloth of 121 points, 30 cm wide, turned about the vertical [rad], around a place near the origin.
fn sheet(place: Vec3, turn: f64) -> PolygonMesh {
    let at = |i: u32| f64::from(i) * 0.03 - 0.15;
    let turned = Rotation3::from_axis_angle(&Vec3::y_axis(), turn);
    let points = (0..121).map(|i| place + turned * Vec3::new(at(i % 11), 0.0, at(i / 11))).collect();
    let corner = |i: u32| i / 10 * 11 + i % 10;
    let quads: Vec<u32> = (0..100).map(corner).flat_map(|i| [i, i + 11, i + 12, i + 1]).collect();
    PolygonMesh { points, face_counts: vec![4; 100], face_indices: quads }
}

/// Two sheets that fall onto each other and a ball, frames 1 to 4, around a place. The rest shapes stay where they are: they say
/// in which order vertices are worked on.
fn shot(place: Vec3) -> ShotDescription {
    let mut scene = SceneDescription::new("far");
    scene.timeline = Timeline { fps_numerator: 60, fps_denominator: 1, origin: 1, start: 1 };
    // Edges of the two sheets are never parallel: the closest points of parallel edges are decided by rounding.
    let meshes = [(0.065, 0.3), (0.058, 0.0)].map(|(height, turn)| sheet(Vec3::new(0.01 - height, height, 0.0), turn));
    for (name, mesh) in ["upper", "lower"].into_iter().zip(&meshes) {
        let mut garment = GarmentDescription::new(name, mesh.clone(), 0.2);
        garment.start = Some(mesh.points.iter().map(|p| p + place).collect());
        (garment.velocity, garment.thickness) = (Vec3::new(0.1, -1.0, 0.2), 0.0005);
        scene.garments.push(garment);
        let garment = scene.garments.len() - 1;
        scene.effects.push(EffectRequest::of_garment("stretch", garment).with("stiffness", 20.0));
        scene.effects.push(EffectRequest::of_garment("bending", garment).with("stiffness", 0.2));
    }
    let of_scene = ["gravity", "body_collision", "self_repulsion", "self_collision"];
    scene.effects.extend(of_scene.map(EffectRequest::of_scene));
    scene.solver.cg_tolerance = Some(1e-7);
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.05 });
    scene.bodies.push(BodyDescription::new("ball", ball, RigidMotion::at(place)));
    described(scene, [1, 4], &["abc", "h5"], UNITS)
}

/// Runs a shot on one rank up to a frame.
fn run(shot: ShotDescription, out: &Path, last: i64) -> RunReport {
    let options = RunOptions { with_changes: true, ..RunOptions::new(out.to_owned()) };
    Shot::prepare(shot, Some([1, last])).unwrap().run(&options, &mut |_: &FrameReport<'_>| {}).unwrap()
}

/// The same on many ranks.
fn run_on(ranks: usize, shot: impl Fn() -> ShotDescription + Sync, out: &Path) {
    let work = |communicator| {
        let ranks = Ranks::new(communicator);
        if !ranks.is_first() {
            worker_loop(&ranks, &StopRequests::default(), &|_| Ok(1));
            return;
        }
        let prepared = Shot::prepare_on(&ranks, shot(), None).unwrap();
        prepared.run(&RunOptions::new(out.to_owned()), &mut |_: &FrameReport<'_>| {}).unwrap();
        shut_down(&ranks, 0);
    };
    LocalRanks::run(ranks, 1, work).unwrap();
}

const FILES: [&str; 4] = ["upper.abc", "upper.h5", "lower.abc", "lower.h5"];

fn assert_same_bytes(a: &Path, b: &Path) {
    for name in FILES {
        assert!(std::fs::read(a.join(name)).unwrap() == std::fs::read(b.join(name)).unwrap(), "{name}");
    }
}

/// Largest distance of what two caches hold, one of them `by` from the other [m].
fn farthest(near: &Path, far: &Path, by: Vec3) -> f64 {
    let (near, far) = (CacheFrames::open(near).unwrap(), CacheFrames::open(far).unwrap());
    assert_eq!(near.meshes[0].frames, far.meshes[0].frames);
    let mut largest = 0.0;
    for sample in 0..near.meshes[0].frames.len() {
        let (a, b) = (near.positions(0, sample).unwrap(), far.positions(0, sample).unwrap());
        largest = a.iter().zip(&b).fold(largest, |largest: f64, (a, b)| largest.max((b - by - a).norm()));
    }
    largest
}

#[test]
fn caches_far_from_the_origin_hold_the_motion_at_the_origin_within_a_micrometre() {
    let folder = tempfile::tempdir().unwrap();
    let [here, there] = ["here", "there"].map(|name| folder.path().join(name));
    let moved = run(shot(Vec3::zeros()), &here, 4);
    assert!(moved.metrics.counted("collision_hits") > 0, "nothing has touched");
    run(shot(FAR.into()), &there, 4);
    for name in FILES {
        let off = farthest(&here.join(name), &there.join(name), FAR.into());
        assert!(off < 1e-6, "{name}: {off:.1e} m");
    }
    // Both formats say the same to the last bit, and what is stored does not cross.
    for name in ["upper", "lower"] {
        let [abc, h5] = ["abc", "h5"].map(|kind| CacheFrames::open(&there.join(format!("{name}.{kind}"))).unwrap());
        for sample in 0..4 {
            assert_eq!(abc.positions(0, sample).unwrap(), h5.positions(0, sample).unwrap());
            assert_eq!(abc.stored_positions(0, sample).unwrap(), h5.stored_positions(0, sample).unwrap());
        }
        // The place is given in whole metres: these are centimetres, Z up.
        assert_eq!(h5.stored_positions(0, 0).unwrap().unwrap().origin, [1e7, -2e6, -3e6]);
    }
    let [upper, lower] = ["upper.abc", "lower.abc"].map(|name| there.join(name));
    let found = verify(&[&upper, &lower], None).unwrap();
    assert!(found.failures.is_empty(), "{:?}", found.failures);
    let manifest = std::fs::read_to_string(there.join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["origin"], serde_json::json!([1e5, -3e4, 2e4]));
}

#[test]
fn a_far_shot_has_the_same_bytes_on_any_ranks_after_a_stop_and_in_a_later_format() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, ranks, stopped] = ["whole", "ranks", "stopped"].map(|name| folder.path().join(name));
    run(shot(FAR.into()), &whole, 4);
    run_on(3, || shot(FAR.into()), &ranks);
    assert_same_bytes(&whole, &ranks);
    let mut first = shot(FAR.into());
    first.output.formats.truncate(1);
    run(first, &stopped, 2);
    assert!(!stopped.join("upper.h5").exists());
    assert_eq!(run(shot(FAR.into()), &stopped, 4).outcome, Outcome::Done);
    assert_same_bytes(&whole, &stopped);
}

#[test]
fn a_run_that_goes_on_from_another_origin_counts_all_its_frames_from_there() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, moved] = ["whole", "moved"].map(|name| folder.path().join(name));
    let from = |x: f64| {
        let mut shot = shot(FAR.into());
        shot.scene.origin = Some(Vec3::new(x, -3e4, 2e4));
        shot.resolved = format!("[shot]\norigin = [{x:?}, -3e4, 2e4]\n");
        shot
    };
    run(from(1e5), &whole, 2);
    run(from(1e5), &moved, 2);
    run(from(1e5 + 8.0), &moved, 4);
    for name in FILES {
        let cache = CacheFrames::open(&moved.join(name)).unwrap();
        assert_eq!(cache.meshes[0].frames, [1, 2, 3, 4], "{name}");
        let old = CacheFrames::open(&whole.join(name)).unwrap();
        for sample in 0..2 {
            let stored = cache.stored_positions(0, sample).unwrap().unwrap();
            assert_eq!(stored.origin[0], 1e7 + 800.0, "{name}");
            let pairs = old.positions(0, sample).unwrap().into_iter().zip(cache.positions(0, sample).unwrap());
            // Half of what separates numbers of single precision at 8 m in centimetres, and the rounding of doubles at 100 km.
            assert!(pairs.into_iter().all(|(a, b)| (a - b).amax() < 0.5e-2 / f64::from(1 << 14) + 1e-10), "{name}");
        }
    }
}

/// A triangle that stands alone in its file, without a parent.
fn alone() -> GarmentMesh {
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::z()];
    let mesh = PolygonMesh::from_triangles(points, &[[0, 1, 2]]);
    GarmentMesh::kept(MeshData { object_path: "/flagShape".into(), ..MeshData::new(mesh) })
}

fn plan(mesh: &GarmentMesh, origin: Vec3) -> CachePlan<'_> {
    CachePlan {
        sub_frames: &[],
        garment: "flag",
        mesh,
        units: UNITS,
        origin,
        timeline: Timeline::default(),
        first_frame: 1,
        last_frame: 3,
        velocities: false,
        normals: false,
        crossings: false,
        attributes: Default::default(),
    }
}

fn write_frame(writer: &mut dyn CacheWriter, frame: i64) {
    let positions = [[0.1, 0.0, -0.0], [1.0, frame as f32, 0.0], [0.0, 0.3, 2.0]];
    writer
        .write(&CacheFrame {
            frame,
            sub_frame: 0,
            positions: &positions,
            velocities: &[],
            normals: &[],
            crossings: None,
            values: Default::default(),
        })
        .unwrap();
}

#[test]
fn a_cache_says_what_its_positions_are_counted_from_and_goes_on_from_no_other_place() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = alone();
    let origin = Vec3::new(2e5, 4.0, -3.0);
    for extension in ["abc", "h5"] {
        let format = by_extension(extension).unwrap();
        let (create, resume) = (format.create.unwrap(), format.resume.unwrap());
        let path = folder.path().join(format!("flag.{extension}"));
        let mut writer = create(&path, &plan(&mesh, origin)).unwrap();
        (1..3).for_each(|frame| write_frame(writer.as_mut(), frame));
        let mark = writer.mark();
        write_frame(writer.as_mut(), 3);
        // Until then it has room for more.
        writer.finish().unwrap();
        drop(writer);
        let whole = std::fs::read(&path).unwrap();
        for other in [Vec3::zeros(), origin + Vec3::x()] {
            let refused = resume(&path, &plan(&mesh, other), &mark).map(drop).unwrap_err();
            assert!(matches!(refused, IoError::Data { .. }), "{extension}: {refused}");
        }
        assert!(std::fs::read(&path).unwrap() == whole, "{extension}: what is refused stays as it is");
        let mut writer = resume(&path, &plan(&mesh, origin), &mark).unwrap();
        write_frame(writer.as_mut(), 3);
        writer.finish().unwrap();
        assert!(std::fs::read(&path).unwrap() == whole, "{extension}");

        let cache = CacheFrames::open(&path).unwrap();
        // Nothing could move a mesh without a parent.
        assert_eq!(cache.meshes[0].name, "/flag/flagShape", "{extension}");
        // Z up, in centimetres.
        let at = |p: Vec3| (p - origin - Vec3::new(0.01, 0.0, -0.02)).norm();
        assert!(at(cache.positions(0, 1).unwrap()[1]) < 1e-10, "{extension}");
        let stored = cache.stored_positions(0, 1).unwrap().unwrap();
        assert_eq!((stored.origin, stored.points[2]), ([2e7, 300.0, 400.0], [0.0, 0.3, 2.0]), "{extension}");
        let bounds = inspect(&path).unwrap().meshes[0].bounds;
        assert!(bounds.is_none_or(|[low, _]| low == [2e7, 300.0, 400.0]), "{extension}: {bounds:?}");
    }
    let said = inspect(&folder.path().join("flag.h5")).unwrap().properties;
    assert!(said.contains(&("origin".into(), "[20000000, 300, 400]".into())), "{said:?}");
    // As an input, in metres with Y up again.
    let read = alembic::AlembicMesh::open(&folder.path().join("flag.abc"), None).unwrap();
    let mut points = Vec::new();
    drapery_io::mesh_data::MeshReader::positions_at(&read, 2.0 / 24.0, &mut points).unwrap();
    assert!((UNITS.to_si(points[1]) - origin - Vec3::new(0.01, 0.0, -0.02)).norm() < 1e-10);
}

#[test]
fn a_cache_that_counts_from_the_origin_of_the_world_says_nothing_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = alone();
    for extension in ["abc", "h5"] {
        let path = folder.path().join(format!("flag.{extension}"));
        let mut writer =
            (by_extension(extension).unwrap().create.unwrap())(&path, &plan(&mesh, Vec3::zeros())).unwrap();
        write_frame(writer.as_mut(), 1);
        writer.finish().unwrap();
        let cache = CacheFrames::open(&path).unwrap();
        assert_eq!(cache.meshes[0].name, "/flagShape", "{extension}");
        assert!(!inspect(&path).unwrap().properties.iter().any(|(name, _)| name == "origin"), "{extension}");
        let bytes = std::fs::read(&path).unwrap();
        assert!(!bytes.windows(6).any(|word| word == b"origin"), "{extension}");
    }
}

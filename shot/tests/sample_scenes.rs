//! Every sample scene is read, resolved and accepted by the solver, and those with a closed-form answer give it.

use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::scene::{BodyShape, PinTarget, Scene};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_io::scene_file::{self, SceneErrorKind};
use drapery_io::shot_description::ShotDescription;
use drapery_shot::Shot;

const G: f64 = 9.81;

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn sample(name: &str) -> PathBuf {
    project().join("sample_assets/scenes").join(format!("{name}.toml"))
}

fn resolve(path: &Path, overrides: &[(&str, &str)]) -> ShotDescription {
    let overrides: Vec<_> = overrides.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let scene = scene_file::load(path, &overrides).unwrap_or_else(|e| panic!("{e}"));
    scene.resolve().unwrap_or_else(|errors| panic!("{}", errors[0]))
}

/// Simulates a scene without files; returns the positions of its first garment at the start and at the end.
fn simulate(path: &Path, overrides: &[(&str, &str)], frames: i64) -> [Vec<Vec3>; 2] {
    let shot = resolve(path, overrides);
    let start = shot.scene.timeline.start;
    let scene = Scene::validate(shot.scene).unwrap_or_else(|p| panic!("{p}"));
    let mut simulation = Simulation::new(scene, &FrameInput::to_frame(start)).unwrap_or_else(|p| panic!("{p}"));
    let mut positions = [Vec::new(), Vec::new()];
    simulation.garment_positions(0, &mut positions[0]);
    for frame in start + 1..=start + frames {
        simulation.advance(&FrameInput::to_frame(frame)).unwrap_or_else(|e| panic!("{e}"));
    }
    simulation.garment_positions(0, &mut positions[1]);
    positions
}

fn centre(points: &[Vec3]) -> Vec3 {
    points.iter().sum::<Vec3>() / points.len() as f64
}

#[test]
fn every_sample_scene_is_accepted_by_the_solver_at_any_resolution() {
    let mut names: Vec<_> = std::fs::read_dir(project().join("sample_assets/scenes"))
        .expect("the folder of sample scenes")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        // Their meshes are those of `drapery-assets`.
        .filter(|path| !path.ends_with("dressed_mannequin.toml") && !path.ends_with("coat.toml"))
        .collect();
    names.sort();
    assert_eq!(names.len(), 16);
    let tests = ["belt", "folded_stack", "soft_cloth", "storm", "two_sheets"];
    names.extend(tests.map(|name| project().join("tests/scenes").join(format!("{name}.toml"))));
    for path in names {
        let counts = ["3", "6"].map(|resolution| {
            let shot = resolve(&path, &[("resolution", resolution)]);
            let again = scene_file::parse(&shot.resolved, "resolved.toml", Path::new(""), &[]);
            let again = again.unwrap_or_else(|e| panic!("{e}")).resolve().unwrap_or_else(|e| panic!("{}", e[0]));
            assert_eq!(format!("{:?}", shot.scene.pins), format!("{:?}", again.scene.pins));
            assert_eq!(format!("{:?}", shot.scene.bodies), format!("{:?}", again.scene.bodies));
            assert_eq!(format!("{:?}", shot.scene.garments), format!("{:?}", again.scene.garments));
            let points = shot.scene.garments[0].point_count();
            let shot = Shot::prepare(shot, None).unwrap_or_else(|p| panic!("{}: {p}", path.display()));
            let mut of_rules = shot.warnings().iter().filter(|warning| warning.rule.is_some());
            assert_eq!(of_rules.next(), None, "{}: mend or silence it", path.display());
            points
        });
        assert!(counts[1] > 2 * counts[0], "{}: {counts:?}", path.display());
    }
}

#[test]
fn the_demo_scene_names_the_files_that_are_not_there_yet() {
    let set = [("assets".to_owned(), "/nowhere".to_owned())];
    let scene = scene_file::load(&sample("dressed_mannequin"), &set).unwrap_or_else(|e| panic!("{e}"));
    let errors = scene.resolve().expect_err("there are no such files");
    assert_eq!(errors.len(), 3);
    assert!(errors.iter().all(|e| e.kind == SceneErrorKind::Missing), "{errors:?}");
}

#[test]
fn the_dressed_woman_is_read_with_her_pins() {
    if !project().join("../shared/data").is_dir() {
        println!("skipped: no shared data");
        return;
    }
    for (quality, points, pins) in [("_lowres", [720, 1311], 36), ("", [11_088, 5148], 144)] {
        let shot = resolve(&project().join("tests/scenes/dressed_woman.toml"), &[("quality", quality)]);
        let counts: Vec<usize> = shot.scene.garments.iter().map(|g| g.point_count()).collect();
        assert_eq!(counts, points);
        let BodyShape::Surface { triangles, point_count } = &shot.scene.bodies[0].shape else { panic!("a surface") };
        assert_eq!((triangles.len(), *point_count), (26_756, 13_380));
        let body = shot.bodies[0].as_ref().expect("a file").source.mesh_at(0.0).expect("the first frame").mesh.points;
        let rest = shot.scene.garments[0].rest_positions().expect("the garment's file");
        match &shot.scene.pins[0].target {
            PinTarget::BodyNearest { vertices, .. } => assert_eq!((vertices.len(), quality), (pins, "_lowres")),
            PinTarget::Body { attachments, .. } => {
                assert_eq!((attachments.len(), quality), (pins, ""));
                for a in attachments {
                    let [p, q, r] = a.body_points.map(|i| body[i as usize]);
                    let tangent = (q - p).normalize();
                    let normal = (q - p).cross(&(r - p)).normalize();
                    let place = p * a.weights[0] + q * a.weights[1] + r * a.weights[2];
                    let place =
                        place + tangent * a.offset.x + normal.cross(&tangent) * a.offset.y + normal * a.offset.z;
                    // The file's own promise is 1e-6 m.
                    let point = rest[a.vertex as usize];
                    assert!((place - point).norm() < 2e-6, "vertex {}: {}", a.vertex, (place - point).norm());
                }
            }
            other => panic!("{other:?}"),
        }
        Shot::prepare(shot, Some([0, 0])).unwrap_or_else(|p| panic!("{p}"));
    }
}

#[test]
fn cloth_on_the_incline_slides_sticks_and_stops_as_a_block_does() {
    let slope = 36.0_f64.to_radians();
    let slid = |overrides: &[(&str, &str)]| {
        let [start, end] = simulate(&sample("incline"), overrides, 30);
        (centre(&end) - centre(&start)).dot(&Vec3::new(slope.cos(), -slope.sin(), 0.0))
    };
    let sliding = 0.5 * 9.8 * (slope.sin() - 0.6 * slope.cos());
    let found = slid(&[("resolution", "4")]);
    // It starts a little closer than the distance at which contact parks it, and is moved there in the first step.
    assert!((found - sliding).abs() < 1e-4 * sliding, "{found} {sliding}");
    assert!(slid(&[("resolution", "4"), ("friction", "0.8")]).abs() < 1e-9);
    let stopping = 0.5 / (9.8 * (slope.cos() - slope.sin()));
    let found = slid(&[("resolution", "4"), ("friction", "1.0"), ("speed", "1")]);
    assert!((found - stopping).abs() < 0.01 * stopping, "{found} {stopping}");
}

#[test]
fn a_patch_leaves_the_turntable_above_the_critical_speed() {
    let critical = (0.4 * G / 0.3_f64).sqrt();
    let radius = |factor: f64| {
        let omega = (factor * critical).to_string();
        let [_, end] = simulate(&sample("turntable"), &[("resolution", "2"), ("omega", &omega)], 24);
        let centre = centre(&end);
        centre.x.hypot(centre.z)
    };
    assert!((radius(0.99) - 0.3).abs() < 1e-3, "{}", radius(0.99));
    assert!(radius(1.01) > 0.303, "{}", radius(1.01));
}

#[test]
fn cloth_dropped_on_a_belt_lags_as_far_as_friction_allows() {
    let lag = 1.0 / (2.0 * 0.4 * G);
    let [start, end] = simulate(&project().join("tests/scenes/belt.toml"), &[], 100);
    let found = 1.0 - (centre(&end) - centre(&start)).x;
    assert!((found - lag).abs() < 0.01 * lag, "{found} {lag}");
}

#[test]
fn a_strip_over_a_cylinder_slips_beyond_the_capstan_ratio() {
    let critical = (0.3 * std::f64::consts::PI).exp();
    let slip = |factor: f64| {
        let ratio = (factor * critical).to_string();
        let [_, end] = simulate(&sample("capstan"), &[("resolution", "5"), ("ratio", &ratio)], 60);
        // The left end, which rises to the cylinder when the strip slips, and is gone soon after.
        (end[0] - Vec3::new(-0.1, -0.15, 0.0)).xy().norm()
    };
    // Within one per cent of the ratio it creeps by centimetres a second; beyond, it accelerates.
    let (held, slipped) = (slip(0.99), slip(1.01));
    assert!(held < 0.1, "{held}");
    assert!(slipped > 1.0, "{slipped}");
}

//! Numbers that change over time: what a curve says holds in each frame, with the same bits after a pause and on any ranks.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::vertex_maps::PaintedMap;
use drapery_core::scene::{
    BodyShape, EffectRequest, ElasticDescription, FacePoint, GarmentDescription, Integrator, RigidMotion, Scene,
    SceneDescription, SeamDescription,
};
use drapery_core::settings::SettingValue;
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_tests::*;

const G: f64 = 9.81;

fn number(value: f64) -> SettingValue {
    SettingValue::Number(value)
}

fn start_of(description: &SceneDescription) -> Simulation {
    start(description.clone())
}

/// A sheet that falls on a ball, with springs that soften and friction that goes away.
fn draped(integrator: Integrator) -> SceneDescription {
    let mut garment = GarmentDescription::new("sheet", sheet(16, 16, 0.025), 0.2);
    garment.mesh.points.iter_mut().for_each(|p| p.y = 0.205);
    garment.thickness = 0.002;
    let mut description = scene_of(garment, 24);
    description.solver.integrator = integrator;
    add_gravity(&mut description, [0.0, -G, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 300.0));
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", 1e-5));
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    description.effects.push(EffectRequest::of_scene("self_collision"));
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.2 });
    add_body(&mut description, ball, RigidMotion::at(Vec3::zeros()), 0.5);
    description.bodies[0].thickness = 0.002;
    description.curves = [
        ("garment.sheet.stretch.stiffness".to_owned(), vec![(2.0, number(300.0)), (6.0, number(60.0))]),
        ("body.ball.friction".to_owned(), vec![(0.0, number(0.5)), (4.0, number(0.0))]),
        ("self_repulsion.friction".to_owned(), vec![(3.0, number(0.4)), (5.0, number(0.1))]),
    ]
    .into();
    let ball = description.bodies[0].name.clone();
    let curve = description.curves.remove("body.ball.friction").expect("it is there");
    description.curves.insert(format!("body.{ball}.friction"), curve);
    description
}

#[test]
fn cloth_falls_with_the_gravity_of_each_frame() {
    for integrator in Integrator::ALL {
        let mut description = scene_of(GarmentDescription::new("sheet", sheet(2, 2, 0.1), 0.2), 24);
        description.solver.integrator = integrator;
        add_gravity(&mut description, [0.0, -1.0, 0.0]);
        let fall = |g: f64| SettingValue::Vector([0.0, -g, 0.0]);
        description.curves = [("gravity.acceleration".to_owned(), vec![(2.0, fall(0.0)), (6.0, fall(8.0))])].into();
        let mut simulation = start(description);
        let (dt, mut v, mut y) = (1.0 / 24.0, 0.0, 0.0);
        for frame in 1..=8 {
            run(&mut simulation, 1);
            let g = (2.0 * (f64::from(frame) - 2.0)).clamp(0.0, 8.0);
            y -= v * dt + 0.5 * g * dt * dt;
            v += g * dt;
            let found = centre(&positions(&simulation)).y;
            assert!((found - y).abs() < 1e-12, "{integrator:?}, frame {frame}: {found} for {y}");
        }
    }
}

#[test]
fn friction_that_goes_away_lets_cloth_slide_from_that_frame_on() {
    let angle = std::f64::consts::PI / 5.0;
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -angle);
    for integrator in Integrator::ALL {
        let mut garment = GarmentDescription::new("patch", sheet(2, 2, 0.1), 1.0);
        garment.mesh.points.iter_mut().for_each(|p| *p = turn * (*p + Vec3::y() * 1e-7));
        let mut description = scene_of(garment, 100);
        description.solver.integrator = integrator;
        add_gravity(&mut description, [0.0, -G, 0.0]);
        let motion = RigidMotion { rotation: turn, ..RigidMotion::at(Vec3::zeros()) };
        add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), motion, 0.9);
        let path = format!("body.{}.friction", description.bodies[0].name);
        description.curves = [(path, vec![(50.0, number(0.9)), (51.0, number(0.2))])].into();
        let mut simulation = start(description);
        let before = centre(&positions(&simulation));
        run(&mut simulation, 50);
        let stuck = (centre(&positions(&simulation)) - before).norm();
        run(&mut simulation, 50);
        let slid = (turn * Vec3::x()).dot(&(centre(&positions(&simulation)) - before));
        let expected = 0.5 * G * (angle.sin() - 0.2 * angle.cos()) * 0.25;
        assert!(stuck < 1e-5, "{integrator:?}: it crept by {stuck} m");
        assert!((slid - expected).abs() < 1e-4, "{integrator:?}: {slid} for {expected}");
    }
}

/// Positions of all garments.
fn everything(simulation: &Simulation) -> Vec<Vec<Vec3>> {
    let garments = 0..simulation.scene().description().garments.len();
    let of = |garment| {
        let mut x = Vec::new();
        simulation.garment_positions(garment, &mut x);
        x
    };
    garments.map(of).collect()
}

/// Eight frames have the same bits after a pause and on any ranks; returns them.
fn keeps_its_bits(description: &SceneDescription) -> Vec<Vec<Vec3>> {
    let integrator = description.solver.integrator;
    let whole = {
        let mut simulation = start_of(description);
        run(&mut simulation, 8);
        everything(&simulation)
    };
    for pause in [1, 3, 7] {
        let mut simulation = start_of(description);
        run(&mut simulation, pause);
        let scene = Scene::validate(description.clone()).unwrap_or_else(|p| panic!("{p}"));
        let (snapshot, input) = (simulation.snapshot(), FrameInput::to_frame(pause as i64));
        let mut restored = Simulation::restore(scene, &input, &snapshot).unwrap_or_else(|e| panic!("{e}"));
        run(&mut restored, 8 - pause);
        assert!(everything(&restored) == whole, "{integrator:?}, after a pause at frame {pause}");
    }
    for ranks in [2, 3] {
        let description = description.clone();
        let on_rank = move |communicator| {
            let ranks = Ranks::new(communicator);
            let given = ranks.is_first().then(|| description.clone());
            let scene = Scene::distribute(&ranks, given).unwrap_or_else(|p| panic!("{p}"));
            let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|p| panic!("{p}"));
            run(&mut simulation, 8);
            everything(&simulation)
        };
        let all = LocalRanks::run(ranks, 1, on_rank).expect("no rank ends early");
        assert!(all[0] == whole, "{integrator:?} on {ranks} ranks");
    }
    whole
}

#[test]
fn curves_have_the_same_bits_after_a_pause_and_on_any_ranks() {
    for integrator in Integrator::ALL {
        let description = draped(integrator);
        let mut plain = description.clone();
        plain.curves.clear();
        let mut simulation = start_of(&plain);
        run(&mut simulation, 8);
        assert!(keeps_its_bits(&description) != everything(&simulation), "{integrator:?}: the curves change nothing");
    }
}

/// The draped sheet shrinks and keeps its sharp folds, with an elastic band along one edge and a density painted by frame; a patch is
/// sewn to its faces, with a force at which stitches break that becomes smaller than its weight.
fn with_all_that_changes(integrator: Integrator) -> SceneDescription {
    let mut description = draped(integrator);
    let (columns, points) = (17, 17 * 17);
    let map =
        |value: f64| PaintedMap { values: (0..points).map(|p| value + 0.01 * p as f64).collect(), absolute: false };
    let sheet_of = &mut description.garments[0];
    sheet_of.map_curves.insert("density".into(), vec![(1.0, map(1.0)), (5.0, map(0.5))]);
    let vertices = (0..columns).collect();
    description.elastics.push(ElasticDescription { rest_scale: 0.9, ..ElasticDescription::new(0, vertices, 2.0) });
    description.effects.push(EffectRequest::of_scene("elastic_bands"));
    description.effects.push(EffectRequest::of_garment("plastic_wrinkles", 0).with("yield_radius", 0.2));
    let mut patch = GarmentDescription::new("patch", sheet(3, 3, 0.025), 0.3);
    patch.mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.003, 0.215, 0.004));
    patch.thickness = 0.002;
    description.garments.push(patch);
    description.effects.push(EffectRequest::of_garment("stretch", 1).with("stiffness", 300.0));
    let faces = (0..4).map(|k| {
        let corner = (8 + k) + columns * 8;
        FacePoint { vertex: k, corners: [corner, corner + columns, corner + 1], weights: [0.5, 0.25, 0.25] }
    });
    let seam = SeamDescription::new([1, 0], Vec::new(), 50.0);
    let faces = faces.collect();
    description.seams.push(SeamDescription { faces, keeps_gap: true, break_force: Some(10.0), ..seam });
    description.effects.push(EffectRequest::of_scene("seams"));
    for (path, curve) in [
        ("garment.sheet.rest_scale", vec![(1.0, number(1.0)), (6.0, number(0.93))]),
        ("garment.sheet.elastic.0.rest_scale", vec![(2.0, number(0.9)), (4.0, number(0.7))]),
        ("seam.0.break_force", vec![(2.0, number(10.0)), (4.0, number(1e-3))]),
        ("garment.patch.thickness", vec![(0.0, number(0.002)), (8.0, number(0.001))]),
    ] {
        description.curves.insert(path.to_owned(), curve);
    }
    description
}

#[test]
fn all_that_changes_has_the_same_bits_after_a_pause_and_on_any_ranks() {
    for integrator in Integrator::ALL {
        let description = with_all_that_changes(integrator);
        let mut simulation = start_of(&description);
        let broken = run(&mut simulation, 8).metrics.counted("stitches_broken");
        let all: u64 = {
            let mut simulation = start_of(&description);
            (0..8).map(|_| run(&mut simulation, 1).metrics.counted("stitches_broken")).sum()
        };
        assert!(all > 0 && broken <= all, "{integrator:?}: no stitch breaks");
        assert!(keeps_its_bits(&description) == everything(&simulation), "{integrator:?}");
        for left_out in ["elastic", "density", "rest_scale", "plastic_wrinkles"] {
            let mut without = description.clone();
            match left_out {
                "elastic" => {
                    without.elastics.clear();
                    without.effects.retain(|effect| effect.effect != "elastic_bands");
                    without.curves.retain(|path, _| !path.contains("elastic"));
                }
                "plastic_wrinkles" => without.effects.retain(|effect| effect.effect != "plastic_wrinkles"),
                "density" => without.garments[0].map_curves.clear(),
                _ => drop(without.curves.remove("garment.sheet.rest_scale")),
            }
            let mut other = start_of(&without);
            run(&mut other, 8);
            assert!(everything(&other) != everything(&simulation), "{integrator:?}: {left_out} changes nothing");
        }
    }
}

#[test]
fn a_map_by_frame_is_straight_between_its_keys() {
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(2, 2, 0.1), 0.2), 24);
    let map = |value: f64| PaintedMap { values: vec![value; 9], absolute: false };
    let keys = vec![(2.0, map(1.0)), (6.0, map(3.0))];
    description.garments[0].map_curves.insert("density".into(), keys);
    let mut simulation = start(description.clone());
    for frame in 1..=8 {
        run(&mut simulation, 1);
        let share = ((f64::from(frame) - 2.0) / 4.0).clamp(0.0, 1.0);
        let found: f64 = simulation.scene().masses().iter().sum();
        let expected = 0.2 * 0.04 * (1.0 + 2.0 * share);
        assert!((found - expected).abs() < 1e-15, "frame {frame}: {found} kg for {expected} kg");
    }
    description.garments[0].map_curves.insert("density".into(), vec![(3.0, map(1.0)), (3.0, map(2.0))]);
    let refused = Scene::validate(description).unwrap_err().to_string();
    assert!(refused.contains("map of density over time: frame 3 comes after frame 3"), "{refused}");
}

#[test]
fn numbers_that_a_program_sets_have_the_bits_of_a_curve() {
    for integrator in Integrator::ALL {
        let description = draped(integrator);
        let mut curved = start_of(&description);
        run(&mut curved, 8);
        let mut plain = description.clone();
        plain.curves.clear();
        let mut simulation = start_of(&plain);
        for frame in 1..=8 {
            let stiffness = 300.0 + (60.0 - 300.0) * ((f64::from(frame) - 2.0) / 4.0).clamp(0.0, 1.0);
            let on_body = 0.5 + (0.0 - 0.5) * (f64::from(frame) / 4.0).clamp(0.0, 1.0);
            let on_cloth = 0.4 + (0.1 - 0.4) * ((f64::from(frame) - 3.0) / 2.0).clamp(0.0, 1.0);
            let body = format!("body.{}.friction", description.bodies[0].name);
            let numbers = [
                ("garment.sheet.stretch.stiffness".to_owned(), number(stiffness)),
                (body, number(on_body)),
                ("self_repulsion.friction".to_owned(), number(on_cloth)),
            ];
            simulation.set(&numbers).unwrap_or_else(|p| panic!("{p}"));
            run(&mut simulation, 1);
        }
        assert_eq!(positions(&simulation), positions(&curved), "{integrator:?}");
        let wrong = |path: &str, value: f64| {
            let mut simulation = start_of(&plain);
            simulation.set(&[(path.to_owned(), number(value))]).expect_err("it cannot be").to_string()
        };
        assert!(wrong("garment.sheet.stretch.stiffness", -1.0).contains("stiffness"));
        assert!(wrong("garment.coat.stretch.stiffness", 1.0).contains("the scene has no number"));
        let error = curved.set(&[("self_repulsion.friction".to_owned(), number(0.2))]).expect_err("it has a curve");
        assert!(error.to_string().contains("a curve of the scene changes this number"), "{error}");
    }
}

/// A sheet in a wind, of a weave whose warp may turn.
fn in_the_wind() -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(6, 6, 0.05), 0.2), 24);
    description.effects.push(EffectRequest::of_garment("membrane", 0).with("warp", 300.0).with("weft", 200.0));
    let mut wind = EffectRequest::of_scene("wind").with("density", 1.2);
    wind.settings.insert("velocity".to_owned(), SettingValue::Vector([0.0, 0.0, 3.0]));
    description.effects.push(wind);
    description
}

#[test]
fn wind_may_fade_to_nothing_by_a_curve_and_by_a_program() {
    let mut fading = in_the_wind();
    fading.curves = [("wind.density".to_owned(), vec![(2.0, number(1.2)), (4.0, number(0.0))])].into();
    let mut curved = start_of(&fading);
    run(&mut curved, 6);
    let mut simulation = start_of(&in_the_wind());
    for frame in 1..=6 {
        let density = 1.2 + (0.0 - 1.2) * ((f64::from(frame) - 2.0) / 2.0).clamp(0.0, 1.0);
        simulation.set(&[("wind.density".to_owned(), number(density))]).unwrap_or_else(|p| panic!("{p}"));
        run(&mut simulation, 1);
    }
    assert_eq!(positions(&simulation), positions(&curved));
}

#[test]
fn what_an_effect_refuses_leaves_the_simulation_as_it_was_and_is_named_before_the_start_in_a_curve() {
    let path = "garment.sheet.membrane.grain".to_owned();
    let nothing = SettingValue::Vector([0.0; 3]);
    let mut simulation = start_of(&in_the_wind());
    run(&mut simulation, 2);
    let refused = simulation.set(&[(path.clone(), nothing.clone())]).expect_err("it has no direction").to_string();
    assert!(refused.contains("zero vector"), "{refused}");
    run(&mut simulation, 2);
    let mut other = start_of(&in_the_wind());
    run(&mut other, 4);
    assert_eq!(positions(&simulation), positions(&other));
    // Of many keys the extremes are looked at.
    for between in [0, 20] {
        let along = |share: f64| SettingValue::Vector([0.0, 0.0, share]);
        let mut keys: Vec<(f64, SettingValue)> =
            (0..=between).map(|k| (f64::from(k), along(1.0 - 0.01 * f64::from(k)))).collect();
        keys.push((30.0, nothing.clone()));
        let mut description = in_the_wind();
        description.curves = [(path.clone(), keys)].into();
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        let refused = Simulation::new(scene, &FrameInput::default()).err().expect("its last key").to_string();
        assert!(refused.contains("at frame 30: `grain` is a zero vector"), "{refused}");
    }
}

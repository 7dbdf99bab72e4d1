//! Numbers that change over time: what a curve says holds in each frame, with the same bits after a pause and on any ranks.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{
    BodyShape, EffectRequest, GarmentDescription, Integrator, RigidMotion, Scene, SceneDescription,
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

#[test]
fn curves_have_the_same_bits_after_a_pause_and_on_any_ranks() {
    for integrator in Integrator::ALL {
        let description = draped(integrator);
        let whole = {
            let mut simulation = start_of(&description);
            run(&mut simulation, 8);
            positions(&simulation)
        };
        let plain = {
            let mut plain = description.clone();
            plain.curves.clear();
            let mut simulation = start_of(&plain);
            run(&mut simulation, 8);
            positions(&simulation)
        };
        assert_ne!(whole, plain, "{integrator:?}: the curves change nothing");
        for pause in [1, 3, 7] {
            let mut simulation = start_of(&description);
            run(&mut simulation, pause);
            let scene = Scene::validate(description.clone()).unwrap_or_else(|p| panic!("{p}"));
            let (snapshot, input) = (simulation.snapshot(), FrameInput::to_frame(pause as i64));
            let mut restored = Simulation::restore(scene, &input, &snapshot).unwrap_or_else(|e| panic!("{e}"));
            run(&mut restored, 8 - pause);
            assert_eq!(positions(&restored), whole, "{integrator:?}, after a pause at frame {pause}");
        }
        for ranks in [2, 3] {
            let description = description.clone();
            let on_rank = move |communicator| {
                let ranks = Ranks::new(communicator);
                let given = ranks.is_first().then(|| description.clone());
                let scene = Scene::distribute(&ranks, given).unwrap_or_else(|p| panic!("{p}"));
                let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|p| panic!("{p}"));
                run(&mut simulation, 8);
                positions(&simulation)
            };
            let all = LocalRanks::run(ranks, 1, on_rank).expect("no rank ends early");
            assert_eq!(all[0], whole, "{integrator:?} on {ranks} ranks");
        }
    }
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

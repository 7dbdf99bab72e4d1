//! Rules of contact by pair: what ignores each other, and friction and thickness of two objects.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{
    BodyShape, ContactRule, ContactSide, EffectRequest, GarmentDescription, Integrator, RigidMotion, SceneDescription,
};
use drapery_core::simulation::{FrameSummary, Simulation};
use drapery_tests::*;
use nalgebra::UnitQuaternion;

use crate::{FPS, MeshBody, run_with_mesh};
use ContactSide::{Body, Garment};

const G: f64 = 9.81;

/// Cells of the sheets, and their size [m].
const CELLS: usize = 10;
const DX: f64 = 0.02;

/// A horizontal square sheet at a height [m], shifted along x and z [m].
fn level(name: &str, height: f64, shift: [f64; 2]) -> GarmentDescription {
    let mut mesh = sheet(CELLS, CELLS, DX);
    mesh.points.iter_mut().for_each(|p| *p += Vec3::new(shift[0], height, shift[1]));
    GarmentDescription { thickness: 0.002, ..GarmentDescription::new(name, mesh, 0.2) }
}

/// These garments under gravity, with contact of cloth; the first is held in all vertices if it is `held`.
fn scene(garments: Vec<GarmentDescription>, held: bool, integrator: Integrator) -> SceneDescription {
    let points = garments[0].mesh.points.len() as u32;
    let mut garments = garments.into_iter();
    let mut description = scene_of(garments.next().expect("there is one"), FPS);
    description.garments.extend(garments);
    description.solver.integrator = integrator;
    add_gravity(&mut description, [0.0, -G, 0.0]);
    for garment in 0..description.garments.len() {
        description.effects.push(EffectRequest::of_garment("stretch", garment).with("stiffness", 200.0));
    }
    description.effects.push(EffectRequest::of_scene("self_repulsion").with("friction", 0.4));
    description.effects.push(EffectRequest::of_scene("self_collision"));
    if held {
        add_pins(&mut description, (0..points).collect());
    }
    description
}

fn ignore(a: ContactSide, b: ContactSide) -> ContactRule {
    ContactRule { ignore: true, ..ContactRule::new([a, b]) }
}

/// Mean of the points of a garment [m].
fn middle(simulation: &Simulation, garment: usize) -> Vec3 {
    let mut points = Vec::new();
    simulation.garment_positions(garment, &mut points);
    centre(&points)
}

/// Mean height of a garment [m].
fn height(simulation: &Simulation, garment: usize) -> f64 {
    middle(simulation, garment).y
}

fn counted(summary: &FrameSummary, name: &str) -> u64 {
    summary.metrics.counted(name)
}

#[test]
fn garments_that_ignore_each_other_pass_through_and_meet_all_others() {
    for integrator in Integrator::ALL {
        let garments =
            || vec![level("shelf", 0.0, [0.0; 2]), level("ghost", 0.03, [0.003, 0.001]), level("rug", 0.06, [0.0; 2])];
        let mut description = scene(garments(), true, integrator);
        description.contacts = vec![ignore(Garment(1), Garment(0)), ignore(Garment(1), Garment(2))];
        let mut simulation = start(description);
        for frame in 1..=12 {
            let summary = run(&mut simulation, 1);
            assert_eq!(counted(&summary, "crossings"), 0, "{integrator:?}, frame {frame}");
        }
        let fallen = 0.03 - height(&simulation, 1);
        let free = 0.5 * G * 0.5 * 0.5;
        assert!((fallen / free - 1.0).abs() < 0.02, "{integrator:?}: it fell by {fallen} m and not by {free} m");
        let rests = height(&simulation, 2);
        assert!(rests > 0.0, "{integrator:?}: the rug fell through the shelf to {rests} m");
        // Without rules the ghost lies on the shelf.
        let mut simulation = start(scene(garments(), true, integrator));
        run(&mut simulation, 12);
        assert!(height(&simulation, 1) > 0.0);
    }
}

#[test]
fn layers_that_ignore_each_other_have_no_pairs() {
    for integrator in Integrator::ALL {
        let layers = |gap: f64| (0..4).map(|k| level(&format!("l{k}"), gap * f64::from(k), [0.0; 2])).collect();
        let pairs = |rules: &[ContactRule], gap: f64| {
            let mut description = scene(layers(gap), false, integrator);
            description.contacts = rules.to_vec();
            let mut simulation = start(description);
            let counts = |summary: FrameSummary| ["repulsions", "collision_hits"].map(|name| counted(&summary, name));
            (1..=4)
                .map(|_| counts(run(&mut simulation, 1)))
                .fold([0; 2], |all, more| [all[0] + more[0], all[1] + more[1]])
        };
        let all: Vec<ContactRule> = (0..4).flat_map(|a| (a..4).map(move |b| ignore(Garment(a), Garment(b)))).collect();
        assert_eq!(pairs(&all, 0.001), [0; 2], "{integrator:?}");
        assert!(pairs(&all[..5], 0.001)[0] > 0, "{integrator:?}: layers that do not ignore each other");
    }
}

#[test]
fn a_body_lets_a_garment_through_that_ignores_it_and_holds_the_others() {
    let (triangles, unit) = unit_ball(24, 48);
    let place = |_: f64| -> Vec<Vec3> { unit.iter().map(|p| p * 0.15 - Vec3::y() * 0.16).collect() };
    let body = MeshBody { triangles, points: &place };
    for integrator in Integrator::ALL {
        // One that ignores the body may start inside it.
        let ghost = level("ghost", -0.05, [0.0; 2]);
        let mut description = scene(vec![ghost, level("rug", 0.02, [0.0; 2])], false, integrator);
        description.contacts = vec![ignore(Garment(0), Body(0)), ignore(Garment(0), Garment(1))];
        let (mut heights, mut crossings) = ([0.0; 2], 0);
        run_with_mesh(
            description,
            &body,
            |body| body.thickness = 0.002,
            8,
            |simulation, summary| {
                heights = [0, 1].map(|garment| height(simulation, garment));
                crossings += counted(summary, "crossings");
            },
        );
        let free = 0.5 * G * (8.0 / f64::from(FPS)).powi(2);
        assert!((heights[0] + 0.05 + free).abs() < 0.01, "{integrator:?}: the ghost is at {} m", heights[0]);
        assert!(heights[1] > -0.1, "{integrator:?}: the rug is at {} m", heights[1]);
        assert_eq!(crossings, 0, "{integrator:?}");
    }
}

#[test]
fn friction_on_a_body_is_that_of_the_garment_and_the_body() {
    let angle = std::f64::consts::PI / 5.0;
    let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -angle);
    for integrator in Integrator::ALL {
        let mut garments = vec![level("wool", 0.0, [0.0, 0.0]), level("silk", 0.0, [0.0, 1.0])];
        let plane = |p: &mut Vec3| *p = turn * (*p + Vec3::y() * 1e-6);
        garments.iter_mut().for_each(|garment| garment.mesh.points.iter_mut().for_each(plane));
        let mut description = scene(garments, false, integrator);
        let motion = RigidMotion { rotation: turn, ..RigidMotion::at(Vec3::zeros()) };
        add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), motion, 0.6);
        description.contacts = vec![ContactRule { friction: Some(0.2), ..ContactRule::new([Body(0), Garment(1)]) }];
        let mut simulation = start(description);
        let along = |simulation: &Simulation, garment: usize| (turn * Vec3::x()).dot(&middle(simulation, garment));
        let before = [0, 1].map(|garment| along(&simulation, garment));
        run(&mut simulation, 12);
        for (garment, friction) in [(0, 0.6), (1, 0.2)] {
            let slid = along(&simulation, garment) - before[garment];
            let expected = 0.5 * G * (angle.sin() - friction * angle.cos()) * 0.25;
            assert!((slid - expected).abs() < 1e-4, "{integrator:?}, {friction}: {slid} for {expected}");
        }
    }
}

#[test]
fn friction_of_cloth_on_cloth_is_that_of_the_two_garments() {
    // On a held slope of cloth: one patch slides as its rule says, the other one stays.
    let angle = 0.25;
    let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -angle);
    for integrator in Integrator::ALL {
        let mut slope = sheet(40, 40, 0.03);
        slope.points.iter_mut().for_each(|p| *p = turn * *p);
        let slope = GarmentDescription { thickness: 0.002, ..GarmentDescription::new("slope", slope, 0.2) };
        let mut patches = vec![level("rough", 0.0021, [-0.4, -0.4]), level("smooth", 0.0021, [-0.4, 0.1])];
        patches.iter_mut().for_each(|patch| patch.mesh.points.iter_mut().for_each(|p| *p = turn * *p));
        let mut description = scene([vec![slope], patches].concat(), true, integrator);
        description.contacts = vec![ContactRule { friction: Some(0.1), ..ContactRule::new([Garment(2), Garment(0)]) }];
        let mut simulation = start(description);
        let along = |simulation: &Simulation, garment: usize| (turn * Vec3::x()).dot(&middle(simulation, garment));
        let before = [1, 2].map(|garment| along(&simulation, garment));
        run(&mut simulation, 12);
        let [rough, smooth] = [1, 2].map(|garment| along(&simulation, garment) - before[garment - 1]);
        let expected = 0.5 * G * (angle.sin() - 0.1 * angle.cos()) * 0.25;
        assert!(rough.abs() < 0.1 * expected, "{integrator:?}: {rough} m with a friction of 0.4");
        assert!((smooth / expected - 1.0).abs() < 0.1, "{integrator:?}: {smooth} m for {expected} m");
    }
}

#[test]
fn thickness_is_that_of_the_two_objects() {
    for integrator in Integrator::ALL {
        let garments = vec![
            level("shelf", 0.0, [0.0; 2]),
            level("thick", 0.007, [0.003, 0.001]),
            level("left", 0.007, [0.003, 0.5]),
            level("right", 0.007, [0.003, 1.0]),
        ];
        let mut description = scene(garments, true, integrator);
        let floor = RigidMotion::at(Vec3::zeros());
        add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), floor, 0.5);
        description.bodies[0].thickness = 0.001;
        let thick = |a, b, thickness| ContactRule { thickness: Some(thickness), ..ContactRule::new([a, b]) };
        description.contacts = vec![
            thick(Garment(0), Garment(1), 0.006),
            thick(Garment(2), Body(0), 0.004),
            ignore(Garment(0), Body(0)),
            ignore(Garment(1), Body(0)),
        ];
        let mut simulation = start(description);
        run(&mut simulation, 24);
        let found = [1, 2, 3].map(|garment| height(&simulation, garment));
        // Layers of cloth give way under their weight.
        assert!((0.0045..0.0066).contains(&found[0]), "{integrator:?}: {found:?}");
        assert!((found[1] - 0.004).abs() < 1e-4 && (found[2] - 0.001).abs() < 1e-4, "{integrator:?}: {found:?}");
    }
}

//! The same bits with any number of threads.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyDescription, BodyShape, EffectRequest, GarmentDescription, RigidMotion, Scene};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

/// Bits of all positions and velocities after some frames, with this number of threads.
fn bits_with(threads: usize, simulate: &(impl Fn() -> Simulation + Sync)) -> Vec<[u64; 3]> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
    let simulation = pool.install(simulate);
    let state = simulation.state();
    assert!(simulation.scene().parts().count() > 2, "several parts, or there is nothing to share among threads");
    state.x.iter().chain(&state.v).map(|x| [x.x, x.y, x.z].map(f64::to_bits)).collect()
}

fn assert_same_bits(simulate: impl Fn() -> Simulation + Sync) {
    let one = bits_with(1, &simulate);
    for threads in [2, 3, 7] {
        let many = bits_with(threads, &simulate);
        let differing = one.iter().zip(&many).filter(|(a, b)| a != b).count();
        assert_eq!(differing, 0, "{threads} threads change {differing} of {} vectors", one.len());
    }
}

/// A sheet of 71 by 71 vertices, 1 m wide, with stretch, bending and gravity.
fn cloth(height: f64) -> drapery_core::scene::SceneDescription {
    let mut mesh = sheet(70, 70, 1.0 / 70.0);
    mesh.points.iter_mut().for_each(|p| p.y += height);
    let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 24);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0));
    description.effects.push(EffectRequest::of_garment("bending", 0).with("stiffness", 5.0));
    description
}

#[test]
fn a_hanging_sheet_has_the_same_bits_with_1_2_3_and_7_threads() {
    assert_same_bits(|| {
        let mut description = cloth(0.0);
        add_pins(&mut description, vec![0, 70]);
        let mut simulation = start(description);
        run(&mut simulation, 3);
        simulation
    });
}

#[test]
fn a_sheet_that_falls_on_a_ball_has_the_same_bits_with_1_2_3_and_7_threads() {
    assert_same_bits(|| {
        let mut description = cloth(0.21);
        description.garments[0].velocity = Vec3::new(0.0, -1.0, 0.0);
        add_body(
            &mut description,
            BodyShape::Rigid(Shape::Sphere { radius: 0.2 }),
            RigidMotion::at(Vec3::zeros()),
            0.4,
        );
        let mut simulation = start(description);
        let summary = run(&mut simulation, 3);
        assert!(summary.metrics.counted("body_contacts") > 0, "it has landed");
        simulation
    });
}

#[test]
fn a_sheet_on_a_deforming_body_has_the_same_bits_with_1_2_3_and_7_threads() {
    assert_same_bits(|| {
        let mut description = cloth(0.21);
        let (triangles, points) = swelling_ball(0.0);
        let shape = BodyShape::Surface { triangles, point_count: points.len() };
        let body = BodyDescription::new("ball", shape, RigidMotion::at(Vec3::zeros()));
        description.bodies.push(BodyDescription { friction: 0.4, thickness: 2e-3, ..body });
        description.effects.push(EffectRequest::of_scene("body_collision"));
        let scene = Scene::validate(description).unwrap_or_else(|p| panic!("{p}"));
        let mut simulation = Simulation::new(scene, &ball_input(0)).unwrap_or_else(|p| panic!("{p}"));
        let contacts: u64 = (1..=4)
            .map(|frame| {
                let summary = simulation.advance(&ball_input(frame)).unwrap_or_else(|e| panic!("{e}"));
                summary.metrics.counted("body_contacts")
            })
            .sum();
        assert!(contacts > 0, "the ball has reached the sheet");
        simulation
    });
}

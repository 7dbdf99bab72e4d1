//! Drag of the ether against its closed form.

use drapery_core::Vec3;
use drapery_core::scene::{EffectRequest, GarmentDescription};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

/// A sheet without springs, thrown into a streaming medium, in steps of a frame.
fn thrown(rate: f64, fps: u32) -> Simulation {
    let mut garment = GarmentDescription::new("sheet", sheet(3, 2, 0.1), 0.2);
    garment.velocity = THROWN;
    let mut description = scene_of(garment, fps);
    description.solver.cg_tolerance = Some(1e-14);
    add_gravity(&mut description, GRAVITY.into());
    let drag = EffectRequest::of_scene("ether_drag").with("rate", rate);
    description.effects.push(drag.with_vector("velocity", STREAM.into()));
    start(description)
}

const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);
const STREAM: Vec3 = Vec3::new(0.5, 0.0, -2.0);
const THROWN: Vec3 = Vec3::new(3.0, 1.0, 0.0);

#[test]
fn a_fall_through_a_medium_ends_at_the_medium_s_velocity_plus_gravity_over_the_rate() {
    // Also where a step is many times longer than the drag needs: the drag is implicit.
    for rate in [2.0, 40.0, 1000.0] {
        let mut simulation = thrown(rate, 24);
        run(&mut simulation, 24 * 10);
        let terminal = STREAM + GRAVITY / rate;
        for v in velocities(&simulation) {
            // What is left of the start: each step turns it into (1 - rate dt / 2) / (1 + rate dt / 2) of what it was.
            let left = ((1.0 - rate / 48.0) / (1.0 + rate / 48.0)).abs().powi(240) * (THROWN - terminal).norm();
            assert!((v - terminal).norm() < 1e-12 + 1.001 * left, "rate {rate}: {v:?}, not {terminal:?}");
        }
    }
}

#[test]
fn a_fall_through_a_medium_follows_the_exponential_with_second_order() {
    let Some(truths) = truths() else { return };
    assert!(truths["fall_with_drag"]["formula"].as_str().unwrap().contains("(m g/c)(1-exp(-c t/m))"));
    let rate = 3.0;
    let terminal = STREAM + GRAVITY / rate;
    let exact = terminal + (THROWN - terminal) * (-rate).exp();
    let errors = [50, 100, 200].map(|fps| {
        let mut simulation = thrown(rate, fps);
        run(&mut simulation, fps as usize);
        (velocities(&simulation)[5] - exact).norm()
    });
    // Error of the trapezoidal rule after one second: v0 · rate³ dt² / 12 · exp(-rate).
    let theory = (THROWN - terminal).norm() * rate.powi(3) / 12.0 * (-rate).exp() / 50.0_f64.powi(2);
    assert!((errors[0] / theory - 1.0).abs() < 0.02, "{} against {theory}", errors[0]);
    for pair in errors.windows(2) {
        assert!((pair[0] / pair[1] / 4.0 - 1.0).abs() < 0.05, "{errors:?}");
    }
}

/// A sheet with springs as in the samples, thrown through a medium at rest for a second at the solves' own tolerance.
#[test]
fn drag_keeps_its_rate_at_the_tolerance_of_a_scene() {
    let mut garment = GarmentDescription::new("sheet", sheet(8, 8, 0.1), 0.2);
    garment.velocity = THROWN;
    let mut description = scene_of(garment, 24);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 500.0));
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 0.5));
    let mut simulation = start(description);
    run(&mut simulation, 24);
    let exact = THROWN * (-0.5_f64).exp();
    for v in velocities(&simulation) {
        assert!((v - exact).norm() < 1e-3 * exact.norm(), "{v:?}, not {exact:?}");
    }
}

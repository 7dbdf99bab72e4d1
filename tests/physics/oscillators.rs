//! One spring against the closed forms of truths.json, and the order of convergence in dt.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{GarmentDescription, Mass, PinHold};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

use crate::fit::assert_order;

/// A vertex on an attachment spring of zero rest length: an oscillator along every axis. Three of them make a triangle, whose
/// own edges carry no springs.
fn oscillator(omega: f64, zeta: f64, amplitude: f64, steps_per_second: u32) -> Simulation {
    let points: Vec<Vec3> = vec![Vec3::zeros(), Vec3::x(), Vec3::z()];
    let mesh = PolygonMesh::from_triangles(points.clone(), &[[0, 2, 1]]);
    let mut garment = GarmentDescription::new("masses", mesh, 1.0);
    garment.mass = Mass::UniformTotal(3.0);
    let mut description = scene_of(garment, steps_per_second);
    description.solver.cg_tolerance = Some(1e-15);
    description.solver.strain_per_step = Some(1e9);
    description.solver.cfl = 1e3;
    add_pins(&mut description, vec![0, 1, 2]);
    // The targets stand `amplitude` below the start, so that the start is the largest displacement, at rest.
    if let drapery_core::scene::PinTarget::Path { offsets, .. } = &mut description.pins[0].target {
        offsets.push((0.0, Vec3::new(0.0, -amplitude, 0.0)));
    }
    description.pins[0].hold = PinHold::Spring { stiffness: omega * omega, damping_ratio: zeta, break_force: None };
    description.effects[0].effect = "attachments".into();
    start(description)
}

#[test]
fn the_damped_oscillator_makes_the_tabulated_steps() {
    let Some(truths) = truths() else { return };
    for case in truths["oscillator"]["damped_table"].as_array().unwrap() {
        let [omega_dt, zeta] = ["omega_dt", "zeta"].map(|k| case[k].as_f64().unwrap());
        let steps_per_second = 50;
        let dt = 1.0 / f64::from(steps_per_second);
        let mut simulation = oscillator(omega_dt / dt, zeta, 1.0, steps_per_second);
        run(&mut simulation, 10);
        let (x, v) = (positions(&simulation)[0].y + 1.0, velocities(&simulation)[0].y * dt);
        let state = case["state_after_10"].as_array().unwrap();
        let error = (x - state[0].as_f64().unwrap()).hypot(v - state[1].as_f64().unwrap());
        assert!(error < 1e-12, "omega dt {omega_dt}, zeta {zeta}: off by {error}");
    }
}

#[test]
fn the_undamped_oscillator_keeps_its_amplitude_and_has_the_tabulated_phase() {
    let Some(truths) = truths() else { return };
    for case in truths["oscillator"]["undamped_table"].as_array().unwrap() {
        let omega_dt = case["omega_dt"].as_f64().unwrap();
        let phase = case["explicit_position"]["phase_per_step"].as_f64().unwrap();
        if omega_dt >= 2.0 {
            continue;
        }
        let mut simulation = oscillator(omega_dt * 50.0, 0.0, 1.0, 50);
        let mut largest = 0.0_f64;
        for step in 1..=200 {
            run(&mut simulation, 1);
            let x = positions(&simulation)[0].y + 1.0;
            largest = largest.max(x.abs());
            // Starting at rest, the positions are cosines of the numerical phase.
            assert!((x - (phase * f64::from(step)).cos()).abs() < 1e-9, "omega dt {omega_dt}, step {step}");
        }
        assert!(largest <= 1.0 + 1e-12);
    }
}

#[test]
fn a_damped_oscillator_converges_with_second_order() {
    let (omega, zeta) = (8.0_f64, 0.15_f64);
    let decay = zeta * omega;
    let damped = omega * (1.0 - zeta * zeta).sqrt();
    let exact = (-decay).exp() * (damped.cos() + decay / damped * damped.sin());
    let error = |steps: u32| {
        let mut simulation = oscillator(omega, zeta, 1.0, steps);
        run(&mut simulation, steps as usize);
        (f64::from(steps).recip(), (positions(&simulation)[0].y + 1.0 - exact).abs())
    };
    assert_order(&[40, 80, 160, 320].map(error), 2.0, "damped oscillator");
}

#[test]
fn a_swinging_sheet_converges_with_second_order() {
    let after = |steps_per_second: u32| {
        let garment = GarmentDescription::new("sheet", sheet(4, 4, 0.1), 0.3);
        let mut description = scene_of(garment, steps_per_second);
        description.solver.cg_tolerance = Some(1e-13);
        add_gravity(&mut description, [0.0, -9.81, 0.0]);
        add_springs(&mut description, 5.0, 0.3);
        description.effects.push(
            drapery_core::scene::EffectRequest::of_garment("bending", 0)
                .with("spring_stiffness", 1.0)
                .with("damping_ratio", 0.3),
        );
        add_pins(&mut description, vec![0, 4]);
        let mut simulation = start(description);
        let summary = run(&mut simulation, (steps_per_second / 4) as usize);
        assert_eq!(summary.steps, 1, "the step is the frame: otherwise the slope means nothing");
        positions(&simulation)
    };
    let finest = after(12_800);
    let error = |steps: u32| {
        let sum: f64 = after(steps).iter().zip(&finest).map(|(a, b)| (a - b).norm_squared()).sum();
        (f64::from(steps).recip(), sum.sqrt())
    };
    assert_order(&[400, 800, 1600, 3200].map(error), 2.0, "swinging sheet");
}

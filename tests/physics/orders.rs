//! Orders of convergence: problems with known answers, at four step lengths or mesh densities and more. The test in
//! `core/src/simulation/planted_errors.rs` shows that a planted error of first order breaks such a slope.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyShape, EffectRequest, GarmentDescription, Integrator, Mass, RigidMotion, SceneDescription,
};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

use crate::fit::assert_order;

/// Leaves the choice of the step to the frame: one step each, solves without error.
fn one_step_a_frame(description: &mut SceneDescription, integrator: Integrator) {
    set_steps_of_a_frame(description, integrator, 1);
    let solver = &mut description.solver;
    (solver.strain_per_step, solver.cg_tolerance) = (Some(1e9), Some(1e-15));
}

/// Three unit masses on a ring of three springs that starts 10 % too wide, at rest: each moves along its radius, like one on
/// a spring of stiffness ω². Its displacement over the one at the start, after a second.
fn ring(omega: f64, damping_ratio: f64, steps: u32, integrator: Integrator) -> f64 {
    let corner = |k: usize| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / 3.0).sin_cos();
        Vec3::new(cos, 0.0, sin)
    };
    let points: Vec<Vec3> = (0..3).map(corner).collect();
    let mut garment = GarmentDescription::new("ring", PolygonMesh::from_triangles(points.clone(), &[[0, 2, 1]]), 1.0);
    garment.mass = Mass::UniformTotal(3.0);
    garment.start = Some(points.iter().map(|p| p * 1.1).collect());
    let mut description = scene_of(garment, steps);
    one_step_a_frame(&mut description, integrator);
    // A radial displacement d makes each edge √3 d longer; both edges pull with the cosine of 30°: 3 k d together.
    let stiffness = omega * omega / 3.0;
    add_springs(&mut description, stiffness * 3.0_f64.sqrt(), damping_ratio);
    let mut simulation = start(description);
    let summary = run(&mut simulation, steps as usize);
    assert_eq!(summary.steps, 1);
    (positions(&simulation)[0].norm() - 1.0) / 0.1
}

#[test]
fn a_ring_of_springs_breathes_with_second_order() {
    let omega = 8.0_f64;
    let levels = [64, 128, 256, 512, 1024];
    for integrator in Integrator::ALL {
        let error = |steps: u32| (f64::from(steps).recip(), (ring(omega, 0.0, steps, integrator) - omega.cos()).abs());
        assert_order(&levels.map(error), 2.0, &format!("{integrator:?}"));
    }
}

#[test]
fn a_damped_ring_of_springs_comes_to_rest_with_second_order() {
    // The pairs' reduced mass is ½, so c = 2 ζ √(k/2), and the radial damping is 3 c as the stiffness is 3 k.
    let (omega, zeta) = (8.0_f64, 0.1_f64);
    let decay = 3.0 * zeta * (omega * omega / 6.0).sqrt();
    let damped = (omega * omega - decay * decay).sqrt();
    let exact = (-decay).exp() * (damped.cos() + decay / damped * damped.sin());
    let levels = [64, 128, 256, 512, 1024];
    for integrator in Integrator::ALL {
        let error = |steps: u32| (f64::from(steps).recip(), (ring(omega, zeta, steps, integrator) - exact).abs());
        assert_order(&levels.map(error), 2.0, &format!("{integrator:?}"));
    }
}

/// A ribbon one cell wide, stretched to twice its length between held ends, whose vertices can only move across (y).
fn taut_ribbon(cells: usize, fps: u32, displacement: impl Fn(f64) -> f64) -> SceneDescription {
    let mesh = sheet(cells, 1, 1.0 / cells as f64);
    let mut garment = GarmentDescription::new("ribbon", mesh.clone(), 1.0);
    garment.mass = Mass::UniformTotal((2 * (cells + 1)) as f64);
    garment.start = Some(mesh.points.iter().map(|p| Vec3::new(2.0 * p.x, displacement(p.x + 0.5), p.z)).collect());
    let mut description = scene_of(garment, fps);
    add_springs(&mut description, 1.0, 0.0);
    let last = cells as u32;
    let ends = vec![0, last, last + 1, 2 * last + 1];
    add_pins(&mut description, (0..2 * (last + 1)).filter(|v| !ends.contains(v)).collect());
    description.pins[0].axes = [true, false, true];
    add_pins(&mut description, ends);
    description
}

/// Small motion across the taut ribbon after `time` [s], from the eigenvectors of its springs: heights in solver order.
fn small_motion(simulation: &Simulation, time: f64) -> Vec<f64> {
    let (scene, x) = (simulation.scene(), &simulation.state().x);
    let count = x.len();
    let mut matrix = nalgebra::DMatrix::<f64>::zeros(count, count);
    let held = |v: usize| x[v].x.abs() > 1.0 - 1e-9;
    for edge in scene.meshes()[0].edges() {
        let [a, b] = edge.vertices.map(|v| v as usize);
        let (rest, flat) = (scene.meshes()[0].rest_length(*edge), x[b] - x[a]);
        // A spring at an angle to y pulls back with its tension over its length.
        let across = (1.0 / rest) * (1.0 - rest / flat.xz().norm());
        for (i, j) in [(a, b), (b, a)].into_iter().filter(|(i, _)| !held(*i)) {
            matrix[(i, i)] += across / scene.masses()[i];
            if !held(j) {
                matrix[(i, j)] -= across / scene.masses()[i];
            }
        }
    }
    let modes = nalgebra::SymmetricEigen::new(matrix);
    let start = nalgebra::DVector::from_iterator(count, x.iter().map(|p| p.y));
    let turned = modes.eigenvalues.map(|square: f64| (square.max(0.0).sqrt() * time).cos());
    (&modes.eigenvectors * (modes.eigenvectors.transpose() * start).component_mul(&turned)).iter().copied().collect()
}

#[test]
fn a_taut_string_swings_with_second_order() {
    // So small that what is not linear in it stays below the error of the finest step.
    let height = |s: f64| 1e-6 * ((std::f64::consts::PI * s).sin() + 0.5 * (3.0 * std::f64::consts::PI * s).sin());
    let levels = [64, 128, 256, 512];
    for integrator in Integrator::ALL {
        let error = |fps: u32| {
            let mut description = taut_ribbon(12, fps, height);
            one_step_a_frame(&mut description, integrator);
            let mut simulation = start(description);
            let exact = small_motion(&simulation, 1.0);
            run(&mut simulation, fps as usize);
            let squares = simulation.state().x.iter().zip(&exact).map(|(x, y)| (x.y - y).powi(2));
            (f64::from(fps).recip(), squares.sum::<f64>().sqrt())
        };
        assert_order(&levels.map(error), 2.0, &format!("{integrator:?}"));
    }
}

#[test]
fn implicit_springs_stay_bounded_at_steps_that_explicit_ones_do_not_survive() {
    // The fastest motion of the ribbon has ω dt of about 5; the explicit limit is 2.
    let height = |s: f64| 1e-6 * ((std::f64::consts::PI * s).sin() + (11.0 * std::f64::consts::PI * s).sin());
    let highest = |integrator| {
        let mut description = taut_ribbon(12, 1, height);
        one_step_a_frame(&mut description, integrator);
        let mut simulation = start(description);
        let before = positions(&simulation).iter().map(|p| p.y.abs()).fold(0.0, f64::max);
        run(&mut simulation, 60);
        positions(&simulation).iter().map(|p| p.y.abs()).fold(0.0, f64::max) / before
    };
    let (explicit, implicit) = (highest(Integrator::SemiImplicit), highest(Integrator::TrBdf2));
    assert!(implicit < 1.0 && explicit > 1e3, "implicit {implicit}, explicit {explicit} times the start");
}

/// A strip that hangs from its short edge and comes to rest: its vertices.
fn hanging_strip(fps: u32, integrator: Integrator) -> Vec<Vec3> {
    let mut garment = GarmentDescription::new("strip", sheet(6, 2, 0.05), 0.2);
    let down = nalgebra::Rotation3::from_axis_angle(&Vec3::z_axis(), -std::f64::consts::FRAC_PI_2);
    garment.mesh.points.iter_mut().for_each(|p| *p = down * *p);
    let mut description = scene_of(garment, fps);
    one_step_a_frame(&mut description, integrator);
    description.solver.cg_tolerance = Some(1e-11);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    add_springs(&mut description, 0.5, 2.0);
    let top = vec![0, 7, 14];
    add_pins(&mut description, top.clone());
    // It stretches and does not swing: springs hardly damp a pendulum.
    add_pins(&mut description, (0..21).filter(|v| !top.contains(v)).collect());
    description.pins[1].axes = [true, false, true];
    let mut simulation = start(description);
    run(&mut simulation, 4 * fps as usize);
    positions(&simulation)
}

#[test]
fn where_a_damped_strip_comes_to_rest_depends_neither_on_the_step_nor_on_the_integrator() {
    let reference = hanging_strip(480, Integrator::SemiImplicit);
    let stretched = reference.iter().map(|p| p.y).fold(f64::INFINITY, f64::min) + 0.15;
    assert!(stretched < -4e-3, "its weight stretches it by {stretched} m");
    let others = [(240, Integrator::SemiImplicit), (120, Integrator::SemiImplicit)];
    for (fps, integrator) in others.into_iter().chain([24, 120, 480].map(|fps| (fps, Integrator::TrBdf2))) {
        let at_rest = hanging_strip(fps, integrator);
        let off = at_rest.iter().zip(&reference).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(off < 1e-7, "{integrator:?} at {fps} steps a second: {off} m");
    }
}

#[test]
fn a_plane_wave_runs_with_the_speed_of_sound_to_second_order_of_the_mesh() {
    // Vertices move along x alone, between held ends: half a wave of u = A sin(πx). Per length across, sides give the stiffness
    // Y and diagonals Y/4 (the projection of Y/2 on x, twice).
    let (stiffness, density, amplitude): (f64, f64, f64) = (100.0, 0.2, 1e-7);
    let speed = (1.25 * stiffness / density).sqrt();
    // A quarter and a bit of a period: the displacement then changes as fast as it can.
    let time = 0.6 / speed;
    let error = |cells: usize| {
        let mesh = sheet(cells, 2, 1.0 / cells as f64);
        let wave = |p: &Vec3| amplitude * (std::f64::consts::PI * (p.x + 0.5)).sin();
        let mut garment = GarmentDescription::new("sheet", mesh.clone(), density);
        garment.start = Some(mesh.points.iter().map(|p| p + Vec3::x() * wave(p)).collect());
        // Steps become shorter with the edges, and their error falls like that of the mesh.
        let steps = 4 * cells as u32;
        let mut description = scene_of(garment, 1);
        let timeline = &mut description.timeline;
        (timeline.fps_numerator, timeline.fps_denominator) = (steps * 1_000_000, (time * 1e6).round() as u32);
        one_step_a_frame(&mut description, Integrator::SemiImplicit);
        let stretch = EffectRequest::of_garment("stretch", 0).with("stiffness", stiffness);
        description.effects.push(stretch.with("damping_ratio", 0.0).with("short_edges", 0.0));
        let last = cells as u32;
        let is_end = |v: &u32| v.is_multiple_of(last + 1) || v % (last + 1) == last;
        add_pins(&mut description, (0..3 * (last + 1)).filter(|v| !is_end(v)).collect());
        description.pins[0].axes = [false, true, true];
        add_pins(&mut description, (0..3 * (last + 1)).filter(is_end).collect());
        let mut simulation = start(description);
        let summary = run(&mut simulation, steps as usize);
        let cosine = (std::f64::consts::PI * speed * f64::from(steps) * summary.dt_max).cos();
        let found = positions(&simulation);
        let off = found.iter().zip(&mesh.points).map(|(x, p)| (x.x - p.x - wave(p) * cosine).powi(2)).sum::<f64>();
        (1.0 / cells as f64, (off / found.len() as f64).sqrt() / amplitude)
    };
    let errors = [8, 16, 32, 64].map(error);
    assert_order(&errors, 2.0, "mesh");
    assert!(errors[3].1 < 1e-3, "at 64 cells a wave is off by {} of its amplitude", errors[3].1);
}

#[test]
fn a_roller_without_friction_takes_no_momentum_along_its_axis() {
    let mut mesh = sheet(16, 16, 0.02);
    mesh.points.iter_mut().for_each(|p| p.y += 0.06);
    let mut garment = GarmentDescription::new("sheet", mesh, 0.2);
    garment.velocity = Vec3::new(0.1, -1.0, 0.4);
    let mut description = scene_of(garment, 60);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    add_springs(&mut description, 20.0, 1.0);
    description.effects.push(EffectRequest::of_garment("bending", 0).with("spring_stiffness", 1.0));
    // A cylinder along z rolls through below; its normals have no component along z.
    let along_z = nalgebra::UnitQuaternion::from_axis_angle(&Vec3::x_axis(), std::f64::consts::FRAC_PI_2);
    let path = vec![(0.0, Vec3::new(-0.05, 0.0, 0.0)), (0.5, Vec3::new(0.25, 0.03, 0.0))];
    let angular_velocity = Vec3::z() * -6.0;
    let motion = RigidMotion { path, rotation: along_z, angular_velocity, ..RigidMotion::at(Vec3::zeros()) };
    add_body(&mut description, BodyShape::Rigid(Shape::Cylinder { radius: 0.05, half_length: 5.0 }), motion, 0.0);
    let mut simulation = start(description);
    let momentum = |s: &Simulation| -> f64 { s.state().v.iter().zip(s.scene().masses()).map(|(v, m)| v.z * m).sum() };
    let before = momentum(&simulation);
    let mut contacts = 0;
    for frame in 0..24 {
        contacts += run(&mut simulation, 1).metrics.counted("body_contacts");
        let now = momentum(&simulation);
        assert!((now / before - 1.0).abs() < 1e-10, "frame {frame}: {now} of {before} kg m/s");
    }
    assert!(contacts > 1000, "the roller has met the sheet {contacts} times");
}

//! Altitude springs of triangles against the law of one spring.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{EffectRequest, GarmentDescription, Mass, SceneDescription};
use drapery_tests::*;

/// One triangle with a base of 1 m and an apex 0.4 m off it, above or below; the base is held, and the apex moves vertically.
fn triangle(apex: f64, gravity: f64, stiffness: f64) -> SceneDescription {
    let points = vec![Vec3::new(-0.5, 0.0, 0.0), Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.1, apex, 0.0)];
    let mut garment = GarmentDescription::new("triangle", PolygonMesh::from_triangles(points, &[[0, 1, 2]]), 1.0);
    garment.mass = Mass::UniformTotal(3.0 * MASS);
    let mut description = scene_of(garment, 50);
    description.solver.cg_tolerance = Some(1e-12);
    add_gravity(&mut description, [0.0, -gravity, 0.0]);
    let request = EffectRequest::of_garment("shear", 0).with("spring_stiffness", stiffness);
    description.effects.push(request.with("damping_ratio", 1.0));
    add_pins(&mut description, vec![0, 1]);
    add_pins(&mut description, vec![2]);
    description.pins[1].axes = [true, false, true];
    description
}

const MASS: f64 = 0.1;

/// Returns the height at which the apex comes to rest [m].
fn rest(description: SceneDescription) -> f64 {
    let mut simulation = start(description);
    run(&mut simulation, 500);
    assert!(velocities(&simulation)[2].norm() < 1e-9);
    positions(&simulation)[2].y
}

#[test]
fn a_weight_on_an_altitude_stretches_or_squeezes_it_as_hooke_says() {
    let (stiffness, gravity) = (20.0, 9.81);
    // k = E / l₀ with l₀ = 0.4 m.
    let change = MASS * gravity / (stiffness / 0.4);
    for apex in [-0.4, 0.4] {
        let y = rest(triangle(apex, gravity, stiffness));
        assert!((y - (apex - change)).abs() < 1e-9, "apex at {y} m, not {}", apex - change);
    }
}

#[test]
fn an_altitude_that_acts_when_compressed_does_nothing_before() {
    let (stiffness, gravity) = (20.0, 9.81);
    let only_compressed = |apex: f64, gravity: f64| {
        let mut description = triangle(apex, gravity, stiffness);
        let request = description.effects.iter_mut().find(|e| e.effect == "shear");
        let settings = &mut request.expect("the effect was asked for").settings;
        settings.insert("compressed_by".into(), drapery_core::settings::SettingValue::Number(0.02));
        description
    };
    // Compressed by 0.0196 m, 5 % of its length.
    let change = MASS * gravity / (stiffness / 0.4);
    assert!((rest(only_compressed(0.4, gravity)) - (0.4 - change)).abs() < 1e-9);
    // Stretched, it falls freely.
    let mut simulation = start(only_compressed(-0.4, gravity));
    run(&mut simulation, 10);
    let fallen = 0.5 * gravity * 0.2 * 0.2;
    assert!((positions(&simulation)[2].y + 0.4 + fallen).abs() < 1e-12);
}

#[test]
fn altitude_springs_keep_momentum_and_resist_what_edges_do_not() {
    // A square that collapses along its diagonal keeps all lengths of its edges but that one, which has no spring here.
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::new(1.0, 0.0, 1.0), Vec3::z()];
    let mesh = PolygonMesh::from_triangles(points.clone(), &[[0, 2, 1], [0, 3, 2]]);
    let mut garment = GarmentDescription::new("square", mesh, 0.2);
    let turned = |p: &Vec3| Vec3::new(p.x + 0.3 * p.z, 0.0, p.z - 0.3 * p.x) * 0.8;
    garment.start = Some(vec![points[0], points[1] * 0.8, turned(&points[2]), points[3] * 1.1]);
    let mut description = scene_of(garment, 200);
    description.solver.cg_tolerance = Some(1e-14);
    let request = EffectRequest::of_garment("shear", 0).with("stiffness", 5.0).with("damping_ratio", 0.1);
    description.effects.push(request);
    let mut simulation = start(description);
    let masses: Vec<f64> = simulation.scene().masses().to_vec();
    let mut fastest = 0.0_f64;
    for _ in 0..100 {
        run(&mut simulation, 1);
        let v = &simulation.state().v;
        let momentum: Vec3 = v.iter().zip(&masses).map(|(v, m)| v * *m).sum();
        fastest = v.iter().map(Vec3::norm).fold(fastest, f64::max);
        assert!(momentum.norm() < 1e-14, "{momentum:?}");
    }
    assert!(fastest > 0.1, "the springs push");
}

#[test]
fn slivers_and_triangles_squeezed_flat_stay_finite() {
    // Altitudes of a ten-thousandth of the length, and one triangle that starts without area.
    let length = 0.1;
    let points: Vec<Vec3> =
        (0..8).map(|k| Vec3::new(0.5 * length * k as f64, 0.0, f64::from(k % 2) * 1e-4 * length)).collect();
    let triangles: Vec<[u32; 3]> =
        (0..6).map(|k| if k % 2 == 0 { [k, k + 1, k + 2] } else { [k, k + 2, k + 1] }).collect();
    let mut garment = GarmentDescription::new("slivers", PolygonMesh::from_triangles(points.clone(), &triangles), 0.2);
    let mut squeezed = points;
    squeezed.iter_mut().take(4).for_each(|p| p.z = 0.0);
    garment.start = Some(squeezed);
    for effect in ["shear", "membrane", "stretch"] {
        let mut description = scene_of(garment.clone(), 24);
        add_gravity(&mut description, [0.0, -9.81, 1.0]);
        let name = if effect == "membrane" { "warp" } else { "stiffness" };
        description.effects.push(EffectRequest::of_garment(effect, 0).with(name, 1.0));
        add_pins(&mut description, vec![0]);
        // Steps follow the altitudes: a hundredth of a frame shows whether the forces are finite.
        description.timeline.fps_numerator = 24_000;
        let mut simulation = start(description);
        let summary = run(&mut simulation, 5);
        let energy = summary.kinetic_energy + summary.potential_energy;
        assert!(energy.is_finite() && positions(&simulation).iter().all(|p| p.norm() < 10.0), "{effect}: {energy} J");
    }
}

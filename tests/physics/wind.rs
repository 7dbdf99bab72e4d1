//! Drag of the air against closed forms.

use drapery_core::Vec3;
use drapery_core::mesh::TriangleMesh;
use drapery_core::scene::{EffectRequest, GarmentDescription, SceneDescription, WindGridShape};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_core::wind_grid::WindSample;
use drapery_tests::*;

/// A flat horizontal sheet of 0.2 kg/m² without springs: every vertex moves as if it were alone.
fn loose_sheet(wind: EffectRequest) -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(4, 3, 0.1), 0.2), 100);
    description.solver.cg_tolerance = Some(1e-14);
    description.effects.push(wind);
    description
}

/// Velocity of all vertices, which have to have the same.
fn common_velocity(simulation: &Simulation) -> Vec3 {
    let all = velocities(simulation);
    assert!(all.iter().all(|v| (v - all[0]).norm() < 1e-9), "the sheet moves as one");
    all[0]
}

/// Speed of a falling flat sheet after `frames` hundredths of a second, at steps of `dt` [s].
fn fallen(dt: f64, frames: usize) -> f64 {
    let mut description = loose_sheet(EffectRequest::of_scene("wind").with("density", 1.2));
    description.solver.max_dt = Some(dt);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    let mut simulation = start(description);
    run(&mut simulation, frames);
    -common_velocity(&simulation).y
}

#[test]
fn a_flat_sheet_falls_as_the_closed_form_says_up_to_its_terminal_speed() {
    // σ dv/dt = σ g − ρ v²: v = v∞ tanh(g t / v∞) with v∞ = √(σ g / ρ).
    let terminal = (0.2 * 9.81 / 1.2_f64).sqrt();
    let at = |t: f64| terminal * (9.81 * t / terminal).tanh();
    let errors = [0.005, 0.0025].map(|dt| (fallen(dt, 10) - at(0.1)).abs());
    // Second order: half the step leaves a quarter of the error.
    assert!(errors[0] < 1e-3 && (errors[0] / errors[1]).log2() > 1.8, "{errors:?}");
    // After 0.7 s it is within 1e-4 of its terminal speed. Later, rounding has tilted the loose triangles, and they glide apart.
    assert!((at(0.7) - terminal).abs() < 1e-4);
    assert!((fallen(0.01, 70) - at(0.7)).abs() < 1e-5, "{} and {}", fallen(0.01, 70), at(0.7));
}

#[test]
fn drag_along_and_across_the_sheet_fades_exponentially_towards_the_wind() {
    // σ du/dt = ν (w − u) along the sheet; du/dt = c (w − u) across it in the authors' form.
    for (term, strength, axis, rate) in [("tangential", 0.5, 0, 0.5 / 0.2), ("normal", 2.0, 1, 2.0)] {
        let request = EffectRequest::of_scene("wind").with(term, strength).with_vector("velocity", [3.0, 3.0, 0.0]);
        let mut description = loose_sheet(request);
        description.solver.max_dt = Some(0.001);
        let mut simulation = start(description);
        run(&mut simulation, 50);
        let v = common_velocity(&simulation);
        let expected = 3.0 * (1.0 - f64::exp(-rate * 0.5));
        // The trapezoidal rule: (rate · dt)² / 12 per unit of time.
        assert!((v[axis] - expected).abs() < 1e-5, "{term}: {v:?}, not {expected}");
        assert!((v.norm() - v[axis].abs()).abs() < 1e-12, "{term} acts in one direction alone: {v:?}");
    }
}

#[test]
fn a_gale_on_the_lightest_cloth_takes_it_along_and_never_beyond_itself() {
    // 5 g/m² in 60 m/s: explicit drag would need steps of 0.1 ms.
    let wind = EffectRequest::of_scene("wind").with("density", 1.2).with_vector("velocity", [0.0, 60.0, 0.0]);
    let mut description = loose_sheet(wind);
    description.garments[0].mass = drapery_core::scene::Mass::Density(0.005);
    let mut simulation = start(description);
    for _ in 0..20 {
        run(&mut simulation, 1);
        let v = common_velocity(&simulation);
        assert!(v.y > 0.0 && v.y < 120.0, "{v:?}");
    }
    assert!((common_velocity(&simulation).y - 60.0).abs() < 3.0);
}

#[test]
fn wind_over_time_follows_its_keys() {
    // With drag as fast as 1e4 1/s the cloth moves as the air does.
    let keys = vec![(0.0, [0.0; 3]), (0.1, [0.0, 2.0, 0.0])];
    let mut simulation =
        start(loose_sheet(EffectRequest::of_scene("wind").with("normal", 1e4).with_keys("keys", keys)));
    for frame in 1..=12 {
        run(&mut simulation, 1);
        let expected = (20.0 * 0.01 * frame as f64).min(2.0);
        // A step behind at most.
        assert!((common_velocity(&simulation).y - expected).abs() <= 0.2 + 1e-9, "frame {frame}");
    }
}

#[test]
fn a_grid_that_changes_over_time_blows_every_vertex_with_the_air_around_it() {
    // Air that turns as a whole about y, ever faster: linear in space and time, so the grid is exact.
    let shape = WindGridShape { origin: Vec3::repeat(-1.0), spacing: Vec3::repeat(1.0), counts: [3; 3] };
    let sample = |time: f64| {
        let node = |k: usize| Vec3::new((k % 3) as f64, (k / 3 % 3) as f64, (k / 9) as f64) - Vec3::repeat(1.0);
        WindSample { time, velocities: (0..27).map(|k| Vec3::y().cross(&node(k)) * (1.0 + time)).collect() }
    };
    let mut description = loose_sheet(EffectRequest::of_scene("wind").with("tangential", 0.01));
    description.effects[0].settings.insert("file".into(), drapery_core::settings::SettingValue::Text("wind.h5".into()));
    description.wind = Some(shape);
    let scene = drapery_core::scene::Scene::validate(description).unwrap_or_else(|p| panic!("{p}"));
    let input = |frame: i64| FrameInput { wind: vec![sample(frame as f64 * 0.01)], ..FrameInput::to_frame(frame) };
    let mut simulation = Simulation::new(scene, &input(0)).unwrap_or_else(|p| panic!("{p}"));
    let points = positions(&simulation);
    (1..=5).for_each(|frame| drop(simulation.advance(&input(frame)).unwrap_or_else(|e| panic!("{e}"))));
    // A triangle takes the air at its middle c: the torque is ν (1 + t) Σ A |c|². What the motion itself takes away is smaller
    // by (ν/σ) t = 2.5e-3.
    let mesh = TriangleMesh::new(&sheet(4, 3, 0.1));
    let middle = |corners: &[u32; 3]| corners.iter().map(|v| points[*v as usize]).sum::<Vec3>() / 3.0;
    let moment: f64 = mesh.triangles().iter().zip(mesh.rest_areas()).map(|(t, a)| a * middle(t).norm_squared()).sum();
    let mut masses = vec![0.0; points.len()];
    for (corners, area) in mesh.triangles().iter().zip(mesh.rest_areas()) {
        corners.iter().for_each(|v| masses[*v as usize] += 0.2 * area / 3.0);
    }
    let velocities = velocities(&simulation);
    let spin: f64 = points.iter().zip(&velocities).zip(&masses).map(|((x, v), m)| x.cross(v).y * m).sum();
    let expected = 0.01 * moment * (0.05 + 0.5 * 0.05 * 0.05);
    assert!((spin / expected - 1.0).abs() < 5e-3, "{spin}, not {expected}");
    let missing = simulation.advance(&FrameInput::to_frame(6)).unwrap_err().to_string();
    assert!(missing.contains("wind"), "{missing}");
}

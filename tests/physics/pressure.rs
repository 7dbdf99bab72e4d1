//! Closed garments under pressure against membrane theory and the gas law.

use drapery_core::Vec3;
use drapery_core::mesh::{PolygonMesh, TriangleMesh};
use drapery_core::scene::{EffectRequest, GarmentDescription, Integrator, Scene, SceneDescription};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_tests::*;

/// Radius of the ball at rest [m].
const RADIUS: f64 = 0.2;

/// An icosahedron whose faces are cut into four three times: nearly equilateral triangles, as membrane theory wants them.
fn unit_icosphere() -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut points: Vec<Vec3> = Vec::new();
    for (s, t) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        points.extend([Vec3::new(0.0, s, t), Vec3::new(s, t, 0.0), Vec3::new(t, 0.0, s)].map(|p| p.normalize()));
    }
    let count = points.len() as u32;
    let near = |a: u32, b: u32| (points[a as usize] - points[b as usize]).norm() < 1.1;
    let mut triangles = Vec::new();
    for (a, b, c) in (0..count).flat_map(|a| (a + 1..count).flat_map(move |b| (b + 1..count).map(move |c| (a, b, c)))) {
        if near(a, b) && near(b, c) && near(c, a) {
            let [p, q, r] = [a, b, c].map(|v| points[v as usize]);
            triangles.push(if p.dot(&q.cross(&r)) > 0.0 { [a, b, c] } else { [a, c, b] });
        }
    }
    for _ in 0..3 {
        let mut middles = std::collections::BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let cut = |[a, b, c]: [u32; 3]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        };
        triangles = triangles.into_iter().flat_map(cut).collect();
    }
    (triangles, points)
}

fn ball() -> PolygonMesh {
    let (triangles, points) = unit_icosphere();
    PolygonMesh::from_triangles(points.iter().map(|p| p * RADIUS).collect(), &triangles)
}

fn balloon(request: EffectRequest) -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("balloon", ball(), 0.1), 100);
    description.effects.push(request);
    description
}

/// A ball of springs of this stiffness [N/m], short edges as stiff as others, at an overpressure [Pa].
fn elastic_balloon(stiffness: f64, pressure: f64, damping_ratio: f64) -> SceneDescription {
    let mut description = balloon(pressed().with("overpressure", pressure));
    let stretch = EffectRequest::of_garment("stretch", 0).with("stiffness", stiffness).with("short_edges", 0.0);
    description.effects.push(stretch.with("damping_ratio", damping_ratio));
    description
}

fn pressed() -> EffectRequest {
    EffectRequest::of_garment("pressure", 0)
}

/// Volume between the points and the origin [m³].
fn volume(points: &[Vec3]) -> f64 {
    let triangles = unit_icosphere().0;
    triangles.iter().map(|t| t.map(|v| points[v as usize])).map(|[a, b, c]| a.dot(&b.cross(&c))).sum::<f64>() / 6.0
}

/// Spring network's `Σ k (l − l₀) l` [J], with k = Y A / l₀² as `stretch` takes it without softening.
fn virial(points: &[Vec3], stiffness: f64) -> f64 {
    let mesh = TriangleMesh::new(&ball());
    let spring = |(edge, area): (&drapery_core::mesh::Edge, f64)| {
        let (rest, [a, b]) = (mesh.rest_length(*edge), edge.vertices.map(|v| points[v as usize]));
        let length = (b - a).norm();
        stiffness * area / (rest * rest) * (length - rest) * length
    };
    mesh.edges().iter().zip(mesh.edge_areas()).map(spring).sum()
}

#[test]
fn a_balloon_swells_to_the_radius_of_membrane_theory_and_stays_where_it_is() {
    let (stiffness, pressure) = (100.0, 80.0);
    let mut simulation = start(elastic_balloon(stiffness, pressure, 10.0));
    let summary = run(&mut simulation, 200);
    let points = positions(&simulation);
    assert!(summary.kinetic_energy < 1e-9, "it is at rest: {} J", summary.kinetic_energy);
    // At rest the forces on any scaling vanish: Σ k (l − l₀) l = 3 p V, exactly.
    let (inner, outer) = (virial(&points, stiffness), 3.0 * pressure * volume(&points));
    assert!((inner / outer - 1.0).abs() < 1e-3, "{inner} J, {outer} J");
    // Springs with k = Y A / l₀² have the biaxial stiffness 1.5 Y: p R λ² = 3 Y (λ − 1).
    let scale = (volume(&points) / volume(&ball().points)).cbrt();
    let expected = {
        let (a, b) = (pressure * RADIUS, 3.0 * stiffness);
        (b - (b * b - 4.0 * a * b).sqrt()) / (2.0 * a)
    };
    // Triangles of an icosphere differ by a fifth.
    assert!((scale - expected).abs() < 0.03 * (expected - 1.0), "{scale}, not {expected}");
    assert!(centre(&velocities(&simulation)).norm() < 1e-12, "inner forces move nothing");
}

#[test]
fn gas_lets_a_ball_breathe_at_the_frequency_of_the_gas_law() {
    // Each vertex starts out along its share of the area, by its mass: the one mode that gas drives.
    let mesh = TriangleMesh::new(&ball());
    let (mut areas, mut masses) = (vec![Vec3::zeros(); mesh.rest_positions().len()], Vec::new());
    for (corners, area) in mesh.triangles().iter().zip(mesh.rest_areas()) {
        let [a, b, c] = corners.map(|v| mesh.rest_positions()[v as usize]);
        corners.iter().for_each(|v| areas[*v as usize] += (b - a).cross(&(c - a)) / 6.0);
        masses.resize(areas.len(), 0.0);
        corners.iter().for_each(|v| masses[*v as usize] += 0.1 * area / 3.0);
    }
    let rest = volume(mesh.rest_positions());
    let driven: f64 = areas.iter().zip(&masses).map(|(g, m)| g.norm_squared() / m).sum();
    let ambient = 5e3;
    let omega = (ambient / rest * driven).sqrt();
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let mut description = balloon(pressed().with_flag("gas", true).with("ambient", ambient));
        let parts_of_mode = mesh.rest_positions().iter().zip(areas.iter().zip(&masses));
        description.garments[0].start = Some(parts_of_mode.map(|(x, (g, m))| x + g / *m * 1e-6).collect());
        description.solver.integrator = integrator;
        description.solver.max_dt = Some(0.02 / omega);
        let mut simulation = start(description);
        let swing = volume(&positions(&simulation)) - rest;
        let summary = run(&mut simulation, 3);
        let phase = omega * 0.03;
        let found = (volume(&positions(&simulation)) - rest) / swing;
        // Second order in the step, and first in the way of the swing.
        assert!((found - phase.cos()).abs() < 0.01, "{integrator:?}: {found}, not {} at {phase} rad", phase.cos());
        let energy = 0.5 * ambient / rest * swing * swing;
        let lost = (summary.potential_energy + summary.kinetic_energy - energy).abs() / energy;
        assert!(lost < 1e-3, "{integrator:?}: {lost}");
    }
}

#[test]
fn long_steps_take_air_of_the_earth_into_their_matrix() {
    // The ball breathes at 3,900 rad/s: explicit gas needs 116 steps a frame.
    let mut description = balloon(pressed().with_flag("gas", true).with("overpressure", 50.0));
    description
        .effects
        .push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0).with("damping_ratio", 1.0));
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.timeline.fps_numerator = 24;
    description.solver.integrator = Integrator::TrBdf2;
    let mut simulation = start(description);
    let mut steps = 0;
    let fall = |frames: f64| 0.5 * 9.81 * (frames / 24.0).powi(2);
    for frame in 1..=12 {
        let summary = run(&mut simulation, 1);
        steps += summary.steps;
        let points = positions(&simulation);
        let scale = volume(&points) / volume(&ball().points);
        assert!((scale - 1.0).abs() < 0.01, "frame {frame}: {scale} of the volume");
        let fallen = centre(&ball().points).y - centre(&points).y;
        assert!((fallen - fall(f64::from(frame))).abs() < 1e-3, "frame {frame}: inner forces move nothing: {fallen} m");
    }
    assert!(steps <= 12 * 8, "{steps} steps");
}

#[test]
fn pressure_does_not_shorten_long_steps() {
    // As an explicit force, pressure that turns with its triangles would limit steps to 2.6 ms, half of what they have.
    let (stiffness, pressure) = (2000.0, 500.0);
    let mut description = elastic_balloon(stiffness, pressure, 1.0);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.timeline.fps_numerator = 24;
    description.solver.integrator = Integrator::TrBdf2;
    let mut simulation = start(description);
    for frame in 1..=24 {
        let steps = run(&mut simulation, 1).steps;
        // It swells fast at first, and the rate of strain shortens steps.
        assert!(frame <= 4 || steps == 8, "frame {frame}: {steps} steps");
        let points = positions(&simulation);
        let fallen = centre(&ball().points).y - centre(&points).y;
        let fall = 0.5 * 9.81 * (f64::from(frame) / 24.0).powi(2);
        assert!((fallen - fall).abs() < 1e-3, "frame {frame}: inner forces move nothing: {fallen} m, not {fall}");
    }
    // At rest inner and outer forces on any scaling balance, and all vertices fall alike.
    let (points, v) = (positions(&simulation), velocities(&simulation));
    let (inner, outer) = (virial(&points, stiffness), 3.0 * pressure * volume(&points));
    assert!((inner / outer - 1.0).abs() < 1e-3, "{inner} J, {outer} J");
    let mean = centre(&v);
    let fastest = v.iter().map(|velocity| (velocity - mean).norm()).fold(0.0, f64::max);
    assert!(fastest < 1e-3, "{fastest} m/s");
}

#[test]
fn gas_is_stable_at_the_step_that_it_sets_itself() {
    let mut description = balloon(pressed().with_flag("gas", true).with("overpressure", 200.0));
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
    let mut simulation = start(description);
    let summary = run(&mut simulation, 5);
    let scale = volume(&positions(&simulation)) / volume(&ball().points);
    // 101 kPa against 200 Pa: a thousandth of the volume is what the membrane can take.
    assert!((scale - 1.0).abs() < 0.01 && summary.kinetic_energy < 1.0, "{scale}, {} J", summary.kinetic_energy);
}

#[test]
fn a_garment_with_holes_or_turned_faces_is_refused_by_name_unless_it_may_be_open() {
    let attempt = |triangles: &[[u32; 3]], open: bool| {
        let mut description = balloon(pressed().with("overpressure", 10.0).with_flag("open", open));
        description.garments[0].mesh = PolygonMesh::from_triangles(ball().points, triangles);
        let scene = Scene::validate(description).unwrap_or_else(|p| panic!("{p}"));
        Simulation::new(scene, &FrameInput::to_frame(0)).map(drop).map_err(|p| p.to_string())
    };
    let mut triangles = unit_icosphere().0;
    triangles[5].swap(0, 1);
    let turned = attempt(&triangles, false).unwrap_err();
    assert!(turned.contains("balloon") && turned.contains("edges"), "{turned}");
    triangles.remove(5);
    assert!(attempt(&triangles, false).is_err());
    assert!(attempt(&triangles, true).is_ok());
    // All faces inwards is one way of looking at a ball.
    let mut inwards = unit_icosphere().0;
    inwards.iter_mut().for_each(|t| t.swap(0, 1));
    assert!(attempt(&inwards, false).is_ok());
}

//! Painted damping, breaking forces and grain against closed forms: every piece of a garment obeys what is painted on it.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::vertex_maps::PaintedMap;
use drapery_core::scene::{EffectRequest, GarmentDescription, Mass, PinHold, PinTarget, SceneDescription};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

/// Damping ratios that are painted on the pieces of a garment; none is the first.
const PAINTED: [f64; 4] = [0.0, 0.05, 0.2, 0.5];

/// Steps per second, and how long pieces swing [s].
const STEPS: u32 = 400;
const LONG: f64 = 0.5;

/// Mass of every vertex [kg].
const MASS: f64 = 0.01;

/// A garment of four equal pieces far apart, each with its own value of a map; nothing holds it, nothing acts on it.
fn pieces(points: &[Vec3], triangles: &[[u32; 3]], of: &str) -> SceneDescription {
    let count = points.len();
    let all = (0..4).flat_map(|n| points.iter().map(move |p| p + Vec3::x() * f64::from(n))).collect();
    let numbered = (0..4).flat_map(|n| triangles.iter().map(move |t| t.map(|v| v + n * count as u32)));
    let mesh = PolygonMesh::from_triangles(all, &numbered.collect::<Vec<_>>());
    let mut garment = GarmentDescription::new("pieces", mesh, 1.0);
    garment.mass = Mass::UniformTotal(MASS * 4.0 * count as f64);
    let values = PAINTED.iter().flat_map(|ratio| vec![*ratio; count]).collect();
    garment.maps.insert(of.into(), PaintedMap { values, absolute: true });
    let mut description = scene_of(garment, STEPS);
    description.solver.cg_tolerance = Some(1e-15);
    description.solver.strain_per_step = Some(1e9);
    description.solver.cfl = 1e3;
    description
}

/// Every piece starts displaced and at rest, and is compared with the damped oscillator of its angular frequency; `ratio` is how
/// much more than its own critical damping a piece has for a damping ratio of one.
fn assert_rings_down(
    description: SceneDescription,
    (omega, ratio): (f64, f64),
    displacement: impl Fn(&Simulation, usize) -> f64,
) {
    let mut simulation = start(description);
    let first: Vec<f64> = (0..4).map(|piece| displacement(&simulation, piece)).collect();
    for step in 1..=(LONG * f64::from(STEPS)) as u32 {
        run(&mut simulation, 1);
        let time = f64::from(step) / f64::from(STEPS);
        for (piece, painted) in PAINTED.into_iter().enumerate() {
            let zeta = ratio * painted;
            let damped = omega * (1.0 - zeta * zeta).sqrt();
            let (sin, cos) = (damped * time).sin_cos();
            let exact = (-zeta * omega * time).exp() * (cos + zeta * omega / damped * sin);
            let found = displacement(&simulation, piece) / first[piece];
            // Its phase is late by (ω dt)²/24 of an angle of ω t.
            assert!((found - exact).abs() < 0.01, "ratio {painted} after {time} s: {found}, not {exact}");
        }
    }
}

/// An equilateral triangle with corners at this distance from its centre [m].
const RADIUS: f64 = 0.1;

fn triangle() -> [Vec3; 3] {
    [0.0, 120.0, 240.0].map(|angle: f64| Vec3::new(angle.to_radians().cos(), 0.0, -angle.to_radians().sin()) * RADIUS)
}

/// Lets the pieces start `more` times as large as they are at rest.
fn swollen(mut description: SceneDescription, more: f64) -> SceneDescription {
    let rest = &description.garments[0].mesh.points;
    let start = rest.iter().map(|p| p.map(|c| c.round()).component_mul(&Vec3::x()));
    description.garments[0].start = Some(rest.iter().zip(start).map(|(p, at)| at + (p - at) * more).collect());
    description
}

/// Returns the growth of a piece of [`triangle`]s, relative to its size at rest.
fn swelling(simulation: &Simulation, piece: usize) -> f64 {
    let x = positions(simulation);
    let corners = &x[3 * piece..3 * piece + 3];
    (corners[0] - centre(corners)).norm() / RADIUS - 1.0
}

#[test]
fn every_triangle_of_a_membrane_rings_down_by_the_damping_painted_on_it() {
    let (stiffness, poisson) = (2.0, 0.25);
    let mut description = pieces(&triangle(), &[[0, 1, 2]], "membrane_damping");
    let request = EffectRequest::of_garment("membrane", 0).with("warp", stiffness).with("poisson", poisson);
    description.effects.push(request.with("thin_triangles", 0.0).with_vector("grain", [1.0, 0.0, 0.0]));
    // Energy Y/(1-ν) s² by area for the strain s in all directions, against three masses at the radius: its stiffest motion.
    let area = 0.75 * 3.0_f64.sqrt() * RADIUS * RADIUS;
    let omega = (2.0 * area * stiffness / (1.0 - poisson) / (3.0 * MASS * RADIUS * RADIUS)).sqrt();
    assert_rings_down(swollen(description, 1.1), (omega, 1.0), swelling);
}

#[test]
fn every_spring_rings_down_by_the_damping_painted_on_it() {
    let tension = 0.2;
    let mut description = pieces(&triangle(), &[[0, 1, 2]], "stretch_damping");
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("spring_stiffness", tension));
    // Two springs pull at each corner with √3 k r each, at 30 degrees to its radius; each is critical for half a mass.
    let stiffness = tension / (RADIUS * 3.0_f64.sqrt());
    let omega = (3.0 * stiffness / MASS).sqrt();
    assert_rings_down(swollen(description, 1.1), (omega, 1.5_f64.sqrt()), swelling);
}

#[test]
fn every_altitude_rings_down_by_the_damping_painted_on_it() {
    let (tension, height) = (0.3, 0.1);
    let points = [Vec3::zeros(), Vec3::x() * 0.3, Vec3::new(0.15, 0.0, -height)];
    let mut description = pieces(&points, &[[0, 1, 2]], "shear_damping");
    let start = description.garments[0].mesh.points.iter().map(|p| Vec3::new(p.x, 0.0, 1.1 * p.z)).collect();
    description.garments[0].start = Some(start);
    description.effects.push(EffectRequest::of_garment("shear", 0).with("spring_stiffness", tension));
    add_pins(&mut description, (0..12).filter(|v| v % 3 < 2).collect());
    // The longest edge is held; the damping is critical for it as if it were free, with half a mass at its middle.
    let omega = (tension / height / MASS).sqrt();
    let apex = |simulation: &Simulation, piece: usize| -positions(simulation)[3 * piece + 2].z / height - 1.0;
    assert_rings_down(description, (omega, 1.5_f64.sqrt().recip()), apex);
}

#[test]
fn every_angle_rings_down_by_the_damping_painted_on_it() {
    let (rigidity, edge) = (2e-3, 0.1);
    let height = 0.75_f64.sqrt() * edge;
    let points = [[0.0, 0.0], [edge, 0.0], [0.5 * edge, height], [0.5 * edge, -height]];
    let points = points.map(|[x, z]| Vec3::new(x, 0.0, z));
    let mut description = pieces(&points, &[[0, 2, 1], [0, 1, 3]], "dihedral_bending_damping");
    let lifted = |p: &Vec3| Vec3::new(p.x, 0.0, p.z) + Vec3::y() * (0.02 * p.z.abs());
    description.garments[0].start = Some(description.garments[0].mesh.points.iter().map(lifted).collect());
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", rigidity));
    // The curvature that agrees with the one known angle and costs least: h across the edge and -L²/4h along it per angle.
    let per_angle = height * height + (edge * edge / (4.0 * height)).powi(2);
    let moment = 2.0 * (0.5 * edge * height) * rigidity / per_angle;
    // The angle turns by 1/h for either opposite vertex, and by as much for either end of the edge.
    let omega = (moment * 4.0 / (height * height * MASS)).sqrt();
    let angle = |simulation: &Simulation, piece: usize| {
        let x = positions(simulation);
        let [a, b, c, d] = [0, 1, 2, 3].map(|v| x[4 * piece + v]);
        let slope = |opposite: Vec3| (opposite - 0.5 * (a + b)).y.atan2((opposite - 0.5 * (a + b)).z.abs());
        slope(c) + slope(d)
    };
    assert_rings_down(description, (omega, 1.0), angle);
}

/// Free vertices on springs, each to a place of its own `below` it [m].
fn on_springs(of: &str, below: f64, hold: PinHold) -> SceneDescription {
    let mut description = pieces(&triangle(), &[[0, 1, 2]], of);
    add_pins(&mut description, (0..12).collect());
    description.effects[0].effect = "attachments".into();
    if let PinTarget::Path { offsets, .. } = &mut description.pins[0].target {
        offsets.push((0.0, Vec3::y() * -below));
    }
    description.pins[0].hold = hold;
    description
}

#[test]
fn every_pin_rings_down_by_the_damping_painted_on_it() {
    let stiffness = 2.0;
    let description =
        on_springs("pin_damping", 0.1, PinHold::Spring { stiffness, damping_ratio: 0.0, break_force: None });
    let height = |simulation: &Simulation, piece: usize| positions(simulation)[3 * piece].y + 0.1;
    assert_rings_down(description, ((stiffness / MASS).sqrt(), 1.0), height);
}

#[test]
fn every_pin_breaks_at_the_force_painted_on_it() {
    let weight = MASS * 9.81;
    let hold = PinHold::Spring { stiffness: 20.0, damping_ratio: 1.0, break_force: Some(weight) };
    let mut description = on_springs("break_force", 0.0, hold);
    // A load that comes at once does not swing beyond itself at critical damping.
    let shares = [0.0, 0.9, 1.1, 4.0];
    let values = shares.iter().flat_map(|share| [*share; 3]).collect();
    description.garments[0].maps.insert("break_force".into(), PaintedMap { values, absolute: false });
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    let mut simulation = start(description);
    let broken: u64 = (0..STEPS).map(|_| run(&mut simulation, 1).metrics.counted("attachments_broken")).sum();
    assert_eq!(broken, 6);
    for (vertex, x) in positions(&simulation).iter().enumerate() {
        if shares[vertex / 3] < 1.0 {
            assert!(x.y < -1.0, "vertex {vertex} fell: {}", x.y);
        } else {
            assert!((x.y + weight / 20.0).abs() < 1e-4, "vertex {vertex} hangs: {}", x.y);
        }
    }
}

#[test]
fn a_strip_stretches_as_the_grain_painted_on_it_is_turned() {
    let (cells, cell, density, gravity) = (32_u32, 0.005, 0.2, 9.81);
    let angles = [0.0, 30.0, 60.0, 90.0].map(f64::to_radians);
    let columns = cells + 1;
    let at = |n: u32, i: u32, k: u32| n * 2 * columns + columns * k + i;
    let points: Vec<Vec3> = (0..4)
        .flat_map(|n| (0..2 * columns).map(move |v| (n, f64::from(v % columns), f64::from(v / columns))))
        .map(|(n, i, k)| Vec3::new(cell * i, 0.0, cell * k + f64::from(n)))
        .collect();
    let quads = (0..4_u32).flat_map(|n| (0..cells).map(move |i| (n, i)));
    let triangles: Vec<[u32; 3]> = quads
        .flat_map(|(n, i)| {
            let [a, b, c, d] = [at(n, i, 0), at(n, i + 1, 0), at(n, i + 1, 1), at(n, i, 1)];
            [[a, c, b], [a, d, c]]
        })
        .collect();
    let mut garment =
        GarmentDescription::new("strips", PolygonMesh::from_triangles(points.clone(), &triangles), density);
    let values = angles.iter().flat_map(|angle| vec![*angle; 2 * columns as usize]).collect();
    garment.maps.insert("grain_angle".into(), PaintedMap { values, absolute: true });
    let mut description = scene_of(garment, 50);
    add_gravity(&mut description, [gravity, 0.0, 0.0]);
    let length = f64::from(cells) * cell;
    let warp = 100.0 * density * gravity * length;
    let [weft, shear] = [0.5 * warp, 0.4 * warp];
    let membrane = EffectRequest::of_garment("membrane", 0).with("warp", warp).with("weft", weft).with("shear", shear);
    let membrane = membrane.with("poisson", 0.0).with("thin_triangles", 0.0);
    description.effects.push(membrane.with_vector("grain", [1.0, 0.0, 0.0]));
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 100.0));
    let held = (0..4).flat_map(|n| [at(n, 0, 0), at(n, 0, 1)]).collect();
    add_pins(&mut description, held);
    let mut simulation = start(description);
    run(&mut simulation, 50);
    let x = positions(&simulation);
    for (n, angle) in (0..4).zip(angles) {
        let ends = [at(n, cells, 0), at(n, cells, 1)].map(|v| x[v as usize].x - points[v as usize].x);
        let (sin, cos) = angle.sin_cos();
        // The compliance of an orthotropic strip off its axes.
        let compliance = cos.powi(4) / warp + sin.powi(4) / weft + (sin * cos).powi(2) / shear;
        let expected = 0.5 * density * gravity * length * length * compliance;
        let found = 0.5 * (ends[0] + ends[1]);
        assert!((found / expected - 1.0).abs() < 0.03, "turned by {angle}: {found} m, not {expected} m");
    }
}

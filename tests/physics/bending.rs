//! Dihedral bending against the elastica and the theory of plates.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{EffectRequest, GarmentDescription, Integrator};
use drapery_tests::*;

/// Weight per area [N/m²], and overhang of the strips [m].
const WEIGHT: f64 = 1.5;
const OVERHANG: f64 = 0.1;

/// Angle along a strip that is clamped level and hangs under its own weight, at `n + 1` places: B θ″ = −w (L − s) cos θ with
/// θ(0) = 0 and θ′(L) = 0, in units of the overhang, by shooting.
fn elastica(gamma: f64, n: usize) -> Vec<f64> {
    let shoot = |slope: f64| {
        let (h, mut state, mut angles) = (1.0 / n as f64, (0.0_f64, slope), vec![0.0]);
        let rate = |s: f64, (angle, turn): (f64, f64)| (turn, -gamma * (1.0 - s) * angle.cos());
        for step in 0..n {
            let s = step as f64 * h;
            let ahead = |k: (f64, f64), h: f64| (state.0 + h * k.0, state.1 + h * k.1);
            let k1 = rate(s, state);
            let k2 = rate(s + 0.5 * h, ahead(k1, 0.5 * h));
            let k3 = rate(s + 0.5 * h, ahead(k2, 0.5 * h));
            let k4 = rate(s + h, ahead(k3, h));
            let mean = |a: f64, b: f64, c: f64, d: f64| h * (a + 2.0 * b + 2.0 * c + d) / 6.0;
            state = (state.0 + mean(k1.0, k2.0, k3.0, k4.0), state.1 + mean(k1.1, k2.1, k3.1, k4.1));
            angles.push(state.0);
        }
        (state.1, angles)
    };
    let (mut low, mut high) = (0.0, gamma.max(1.0));
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if shoot(middle).0 < 0.0 { low = middle } else { high = middle }
    }
    shoot(0.5 * (low + high)).1
}

/// Arrangement of the triangles of a strip.
#[derive(Debug, Clone, Copy)]
enum Kind {
    /// Squares with parallel diagonals, as quads of equal diagonals are cut.
    Parallel,
    /// Rows that are shifted by half an edge.
    Shifted,
    /// Parallel diagonals, every inner vertex moved by up to a quarter of an edge.
    Uneven,
}

/// A strip from −dx to `cells` dx along x, `wide` cells wide, with its clamp at −dx/2.
fn strip(kind: Kind, cells: usize, wide: usize) -> (PolygonMesh, f64) {
    let dx = OVERHANG / (cells as f64 + 0.5);
    let columns = cells + 2;
    let mut seed = 1_u32;
    let mut random = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let dz = if matches!(kind, Kind::Shifted) { dx * 0.75_f64.sqrt() } else { dx };
    let mut points = Vec::new();
    for k in 0..=wide {
        for i in 0..columns {
            let mut p = Vec3::new((i as f64 - 1.0) * dx, 0.0, (k as f64 - 0.5 * wide as f64) * dz);
            let inner = i > 1 && i + 1 < columns;
            match kind {
                // The shift vanishes at the clamp and at the end, so that these stay straight.
                Kind::Shifted if inner && k % 2 == 1 => p.x += 0.5 * dx,
                Kind::Uneven if inner => p += Vec3::new(random(), 0.0, random()) * (0.5 * dx),
                _ => {}
            }
            points.push(p);
        }
    }
    let mut triangles = Vec::new();
    for k in 0..wide {
        for i in 0..columns - 1 {
            let at = |i: usize, k: usize| (i + columns * k) as u32;
            let (a, b, c, d) = (at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1));
            let rising = match kind {
                Kind::Parallel | Kind::Uneven => true,
                Kind::Shifted => k % 2 == 1,
            };
            triangles.extend(if rising { [[a, c, b], [a, d, c]] } else { [[a, d, b], [b, d, c]] });
        }
    }
    (PolygonMesh::from_triangles(points, &triangles), dx)
}

/// Drop of the end of a strip over its overhang, at rest.
fn drop_of(kind: Kind, cells: usize, wide: usize, gamma: f64) -> f64 {
    let (mesh, dx) = strip(kind, cells, wide);
    let clamped: Vec<u32> = (0..mesh.points.len() as u32).filter(|v| mesh.points[*v as usize].x < 0.5 * dx).collect();
    let n = 4000;
    let angles = elastica(gamma, n);
    let place = |p: &Vec3| {
        // From the clamp along the strip.
        let s = ((p.x + 0.5 * dx) / OVERHANG).max(0.0);
        if p.x < 0.5 * dx {
            return *p;
        }
        let steps = ((s * n as f64) as usize).min(n);
        let (x, y) = angles[..steps].iter().fold((0.0, 0.0), |(x, y), a| (x + a.cos(), y - a.sin()));
        Vec3::new(x * OVERHANG / n as f64 - 0.5 * dx, y * OVERHANG / n as f64, p.z)
    };
    let mut garment = GarmentDescription::new("strip", mesh, WEIGHT / 9.81);
    garment.start = Some(garment.mesh.points.iter().map(place).collect());
    let last = garment.mesh.points.iter().map(|p| p.x).fold(0.0, f64::max);
    let end: Vec<usize> =
        (0..garment.mesh.points.len()).filter(|v| garment.mesh.points[*v].x > last - 0.01 * dx).collect();
    let mut description = scene_of(garment, 100);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(
        EffectRequest::of_garment("stretch", 0)
            .with("stiffness", 400.0)
            .with("damping_ratio", 1.0)
            .with("short_edges", 0.0),
    );
    let rigidity = WEIGHT * OVERHANG.powi(3) / gamma;
    description.effects.push(
        EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", rigidity).with("damping_ratio", 100.0),
    );
    add_pins(&mut description, clamped);
    let mut simulation = start(description);
    run(&mut simulation, 30);
    let x = positions(&simulation);
    let speed = velocities(&simulation).iter().map(Vec3::norm).fold(0.0, f64::max);
    assert!(speed < 0.01, "{kind:?}, {cells} cells, gamma {gamma}: it still moves with {speed} m/s");
    -centre(&end.iter().map(|v| x[*v]).collect::<Vec<_>>()).y / OVERHANG
}

#[test]
fn a_cantilever_drops_as_the_elastica_says() {
    let Some(truths) = truths() else { return };
    let table = truths["heavy_elastica_cantilever"]["table"].as_array().unwrap();
    let kinds = [Kind::Parallel, Kind::Shifted, Kind::Uneven];
    let coarse = kinds.into_iter().flat_map(|kind| [1.0, 5.0, 20.0, 100.0].map(|gamma| (kind, 10, gamma)));
    for (kind, cells, gamma) in coarse.chain([(Kind::Shifted, 16, 10.0), (Kind::Uneven, 16, 50.0)]) {
        let row = table.iter().find(|row| row["gamma"].as_f64() == Some(gamma)).expect("a tabulated gamma");
        let expected = row["drop_over_L"].as_f64().unwrap();
        let share = drop_of(kind, cells, 4, gamma) / expected;
        assert!((share - 1.0).abs() < 0.03, "{kind:?}, {cells} cells, gamma {gamma}: {share} of the drop");
    }
}

/// A tube of eleven loops 5 cm apart, and of one more this far above the middle one [m]; 24 points around.
fn tube_with_a_loop_above_another(gap: f64) -> PolygonMesh {
    let mut heights: Vec<f64> = (0..11).map(|k| 0.8 + 0.05 * f64::from(k)).collect();
    heights.insert(6, heights[5] + gap);
    let ring = |height: &f64| {
        let height = *height;
        (0..24).map(move |k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 24.0).sin_cos();
            Vec3::new(0.25 * cos, height, 0.25 * sin)
        })
    };
    let points = heights.iter().flat_map(ring).collect();
    let triangle = |loop_: u32, k: u32| {
        let [a, b] = [k, (k + 1) % 24].map(|k| loop_ * 24 + k);
        [[a, a + 24, b + 24], [a, b + 24, b]]
    };
    let triangles: Vec<[u32; 3]> = (0..11).flat_map(|j| (0..24).flat_map(move |k| triangle(j, k))).collect();
    PolygonMesh::from_triangles(points, &triangles)
}

#[test]
fn cloth_with_loops_that_nearly_coincide_falls_as_it_is() {
    for integrator in Integrator::ALL {
        let mut garment = GarmentDescription::new("tube", tube_with_a_loop_above_another(1e-4), 0.235);
        garment.thickness = 0.000568;
        let mut description = scene_of(garment, 24);
        description.solver.integrator = integrator;
        add_gravity(&mut description, [0.0, -9.81, 0.0]);
        description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 97.0));
        description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", 11e-6));
        let mut simulation = start(description);
        let summary = run(&mut simulation, 24);
        let strain = summary.max_strain.map_or(0.0, |most| most.strain);
        assert!(strain < 0.5, "{integrator:?}: {strain}");
    }
}

//! The matrix against differences of the forces, effect by effect.

use super::*;
use crate::effects::registry::build_all;
use crate::mesh::PolygonMesh;
use crate::pins::PinTargets;
use crate::scene::{EffectRequest, GarmentDescription, Integrator, Scene, SceneDescription};
use crate::solve::implicit_velocity::by_part;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

const N: usize = 50;

/// An uneven sheet in two parts with these effects.
fn scene(effects: &[EffectRequest]) -> Scene {
    let wave = |k: usize, f: f64| 0.2 * (f * k as f64).sin();
    let at = |k: usize| Vec3::new((k % N) as f64 + wave(k, 1.3), 0.0, (k / N) as f64 + wave(k, 2.1)) * 0.01;
    let corners = (0..(N - 1) * N).filter(|k| k % N < N - 1).map(|k| k as u32);
    let triangles: Vec<_> =
        corners.flat_map(|k| [[k, k + N as u32, k + 1], [k + 1, k + N as u32, k + 1 + N as u32]]).collect();
    let mesh = PolygonMesh::from_triangles((0..N * N).map(at).collect(), &triangles);
    let mut description = SceneDescription::new("matrix");
    description.solver.integrator = Integrator::TrBdf2;
    description.garments.push(GarmentDescription::new("sheet", mesh, 0.2));
    description.effects.extend(effects.iter().cloned());
    Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"))
}

/// A direction of no particular kind.
fn direction(count: usize) -> Vec<Vec3> {
    (0..count).map(|i| Vec3::new((3.1 * i as f64).sin(), (5.3 * i as f64).sin(), (1.7 * i as f64).cos())).collect()
}

/// The forces of a scene, and their matrix with room for all elements.
fn forces(scene: &Scene) -> (PartForces, BlockMatrix, ElementSlots) {
    let effects = build_all(scene).unwrap_or_else(|p| panic!("{p}"));
    let forces = by_part(scene.parts(), effects.into_iter().flat_map(|(_, effect)| effect.forces));
    let (matrix, slots) = matrix_of(scene.parts(), &forces);
    (forces, matrix, slots)
}

/// Returns the product of the matrix, without masses, with the direction `s`, and minus the change of the force along
/// `s`, at `x` with `v`.
fn products(scene: &Scene, [x, v, s]: [&[Vec3]; 3], factors: BlockFactors) -> [Vec<Vec3>; 2] {
    let (mut forces, mut matrix, slots) = forces(scene);
    let (targets, wind, volumes) = (PinTargets::default(), WindGrid::default(), Volumes::default());
    let mut force = |x: &[Vec3], v_at: &[Vec3], matrix: Option<&mut BlockMatrix>| {
        let context = ForceContext { time: 0.0, targets: &targets, v, wind: &wind, volumes: &volumes };
        let (parts, masses, worked_on) = (scene.parts(), scene.masses(), &*vec![true; scene.parts().count()]);
        let at = ForceEvaluation { parts, masses, worked_on, x, v: v_at, fraction: 0.0, context };
        let mut f = vec![Vec3::zeros(); x.len()];
        match matrix {
            Some(matrix) => at.linearise(&mut forces, &mut f, factors, matrix, &slots),
            None => at.forces(&mut forces, &mut f),
        }
        f
    };
    let near = |from: &[Vec3], by: f64| -> Vec<Vec3> { from.iter().zip(s).map(|(x, s)| x + s * by).collect() };
    let step = 1e-7;
    let of_positions = [-step, step].map(|by| force(&near(x, by), v, None));
    let of_velocities = [-1.0, 1.0].map(|by| force(x, &near(v, by), None));
    let slope = |[low, high]: &[Vec<Vec3>; 2], i: usize, by: f64| (low[i] - high[i]) / (2.0 * by);
    let differences = (0..x.len())
        .map(|i| slope(&of_positions, i, step) * factors.stiffness + slope(&of_velocities, i, 1.0) * factors.damping);
    let differences: Vec<Vec3> = differences.collect();
    force(x, v, Some(&mut matrix));
    let mut product = vec![Vec3::zeros(); x.len()];
    for (range, rows) in scene.parts().ranges().iter().zip(matrix.parts()) {
        rows.multiply(s, &mut product[range.clone()]);
    }
    for ((product, s), mass) in product.iter_mut().zip(s).zip(scene.masses()) {
        *product -= s * *mass;
    }
    [product, differences]
}

fn assert_same(name: &str, [product, differences]: &[Vec<Vec3>; 2]) {
    let largest = differences.iter().map(Vec3::norm).fold(0.0, f64::max);
    assert!(largest > 0.0, "{name}: nothing resists");
    for (i, (found, expected)) in product.iter().zip(differences).enumerate() {
        // Blocks are stored in single precision; the differences of stiff forces have their own error.
        assert!((found - expected).norm() < 3e-6 * largest, "{name}, vertex {i}: {found:?} for {expected:?}");
    }
}

fn stretched(scene: &Scene) -> Vec<Vec3> {
    let x = &scene.start_state()[0];
    let bulge =
        |i: usize, x: &Vec3| x.component_mul(&Vec3::new(1.33, 1.0, 1.4)) + Vec3::y() * (0.3 * i as f64).sin() * 3e-4;
    x.iter().enumerate().map(|(i, x)| bulge(i, x)).collect()
}

const STIFFNESS: BlockFactors = BlockFactors { damping: 0.0, stiffness: 0.01 };
const DAMPING: BlockFactors = BlockFactors { damping: 0.03, stiffness: 0.0 };

#[test]
fn the_matrix_of_stretched_springs_is_the_slope_of_their_force() {
    for effect in ["stretch", "bending"] {
        let scene = scene(&[EffectRequest::of_garment(effect, 0).with("stiffness", 200.0)]);
        assert!(scene.parts().count() > 1, "some springs cross a border");
        let (x, s) = (stretched(&scene), direction(N * N));
        assert_same(effect, &products(&scene, [&x, &vec![Vec3::zeros(); N * N], &s], STIFFNESS));
    }
}

/// Cloth that stiffens up to 490 N/m at a strain of which a third to a half is reached, and at one that is far exceeded, where
/// it goes straight on.
fn stiffening(effect: &str, stiffness: &str) -> [EffectRequest; 2] {
    let cloth = EffectRequest::of_garment(effect, 0).with(stiffness, 200.0).with("load", 490.0).with("linearity", 0.6);
    [0.5, 0.1].map(|extension| cloth.clone().with("extension", extension))
}

#[test]
fn the_matrix_of_springs_that_stiffen_is_the_slope_of_their_force() {
    for effect in stiffening("stretch", "stiffness") {
        let scene = scene(&[effect]);
        let (x, s) = (stretched(&scene), direction(N * N));
        assert_same("stretch", &products(&scene, [&x, &vec![Vec3::zeros(); N * N], &s], STIFFNESS));
    }
}

#[test]
fn the_matrix_of_a_stiffening_membrane_is_the_slope_of_its_force_where_it_is_not_turned() {
    for effect in stiffening("membrane", "warp") {
        let scene = scene(&[effect.with("weft", 90.0)]);
        let map = |by: [f64; 3]| -> Vec<Vec3> {
            scene.start_state()[0].iter().map(|x| x.component_mul(&Vec3::from(by))).collect()
        };
        let (x, s) = (map([1.3, 1.0, 1.4]), map([1.0, 0.0, -0.4]));
        assert_same("membrane", &products(&scene, [&x, &vec![Vec3::zeros(); N * N], &s], STIFFNESS));
    }
}

#[test]
fn the_force_of_cloth_that_stiffens_is_the_slope_of_its_energy() {
    let weft = |effect: EffectRequest| effect.with("weft", 90.0);
    for effect in stiffening("stretch", "stiffness").into_iter().chain(stiffening("membrane", "warp").map(weft)) {
        let scene = scene(&[effect]);
        let (mut forces, ..) = forces(&scene);
        let (targets, wind, volumes) = (PinTargets::default(), WindGrid::default(), Volumes::default());
        let (x, s) = (stretched(&scene), direction(N * N));
        let context = ForceContext { time: 0.0, targets: &targets, v: &[], wind: &wind, volumes: &volumes };
        let (v, mut f) = (vec![Vec3::zeros(); N * N], vec![Vec3::zeros(); N * N]);
        let (parts, masses, worked_on) = (scene.parts(), scene.masses(), &*vec![true; scene.parts().count()]);
        ForceEvaluation { parts, masses, worked_on, x: &x, v: &v, fraction: 0.0, context }.forces(&mut forces, &mut f);
        let energy = |by: f64| -> f64 {
            let x: Vec<Vec3> = x.iter().zip(&s).map(|(x, s)| x + s * by).collect();
            let of_part = |(range, forces): (&std::ops::Range<usize>, &Vec<Box<dyn Force>>)| -> f64 {
                let masses = &masses[range.clone()];
                let view = PartView { start: range.start, masses, x: &x, fraction: 0.0, context };
                forces.iter().map(|force| force.energy(&view)).sum()
            };
            parts.ranges().iter().zip(&forces).map(of_part).sum()
        };
        let slope = (energy(1e-7) - energy(-1e-7)) / 2e-7;
        let work: f64 = f.iter().zip(&s).map(|(f, s)| f.dot(s)).sum();
        // Rounding of an energy of some joules over that way.
        assert!((slope + work).abs() < 1e-6 * f.iter().map(Vec3::norm).sum::<f64>(), "{slope} for {}", -work);
    }
}

#[test]
fn the_matrix_of_a_membrane_at_rest_is_the_slope_of_its_force() {
    let membrane = EffectRequest::of_garment("membrane", 0).with("warp", 300.0).with("weft", 90.0).with("shear", 20.0);
    let scene = scene(&[membrane]);
    let (x, s) = (scene.start_state()[0].clone(), direction(N * N));
    assert_same("membrane", &products(&scene, [&x, &vec![Vec3::zeros(); N * N], &s], STIFFNESS));
}

#[test]
fn the_damping_of_every_effect_is_the_slope_of_its_force_by_velocity() {
    let of_garment = |name: &str, key: &str, value: f64| EffectRequest::of_garment(name, 0).with(key, value);
    let effects = [
        of_garment("stretch", "stiffness", 200.0),
        of_garment("bending", "stiffness", 20.0),
        of_garment("shear", "stiffness", 20.0),
        of_garment("dihedral_bending", "stiffness", 1e-4),
        of_garment("membrane", "warp", 300.0),
        EffectRequest::of_scene("ether_drag").with("rate", 3.0),
        EffectRequest::of_scene("wind").with("tangential", 0.1),
        EffectRequest::of_scene("wind").with("normal", 2.0),
        EffectRequest::of_scene("wind").with("density", 1.2).with_vector("velocity", [1.0, 2.0, 0.0]),
    ];
    for effect in effects {
        let scene = scene(std::slice::from_ref(&effect));
        let (x, s, v) = (stretched(&scene), direction(N * N), vec![Vec3::new(0.3, 0.2, -0.1); N * N]);
        assert_same(&effect.effect, &products(&scene, [&x, &v, &s], DAMPING));
    }
}

#[test]
fn the_matrix_of_bending_is_never_softer_than_its_force() {
    let scene = scene(&[EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", 1e-4)]);
    let x = scene.start_state()[0].clone();
    for seed in 0..8 {
        let wave = |i: usize| Vec3::y() * (f64::from(seed) + (0.1 + 0.4 * f64::from(seed)) * i as f64).sin();
        let s: Vec<Vec3> = (0..N * N).map(wave).collect();
        let [product, differences] = products(&scene, [&x, &vec![Vec3::zeros(); N * N], &s], STIFFNESS);
        let [matrix, force] = [&product, &differences].map(|of| of.iter().zip(&s).map(|(f, s)| f.dot(s)).sum::<f64>());
        assert!(force > 0.0 && matrix > (1.0 - 1e-4) * force && matrix < 8.0 * force, "{matrix} for {force}");
    }
}

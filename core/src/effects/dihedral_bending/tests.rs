//! Energy, forces and damping of hinges against geometry, finite differences and power iteration.

use super::elements::{Rigidity, Shape, of_mesh, triangle_energy};
use super::part_hinges::spread;
use crate::Vec3;
use crate::effects::force::{Force, ForceContext, PartForce, PartMotion, PartView};
use crate::effects::registry::build_all;
use crate::mesh::{PolygonMesh, TriangleMesh};
use crate::parallel::parts::PART_SIZE;
use crate::parallel::simd4::Simd4;
use crate::pins::PinTargets;
use crate::scene::vertex_maps::PaintedMap;
use crate::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};
use crate::snapshot::elements::ElementRows;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

const RIGIDITY: f64 = 3e-5;

/// An uneven sheet of n by n vertices, 1 cm apart, with diagonals either way.
fn uneven(n: usize, seed: u32) -> PolygonMesh {
    let mut random = random(seed);
    let points: Vec<Vec3> = (0..n * n)
        .map(|k| (Vec3::new((k % n) as f64, 0.0, (k / n) as f64) + Vec3::new(random(), 0.0, random()) * 0.5) * 0.01)
        .collect();
    let at = |i: usize, k: usize| (i + n * k) as u32;
    let mut triangles = Vec::new();
    for k in 0..n - 1 {
        for i in 0..n - 1 {
            let [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            triangles.extend(if random() > 0.0 { [[a, c, b], [a, d, c]] } else { [[a, d, b], [b, d, c]] });
        }
    }
    PolygonMesh::from_triangles(points, &triangles)
}

/// Numbers from -1/2 to 1/2.
fn random(mut seed: u32) -> impl FnMut() -> f64 {
    move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    }
}

fn scene(mesh: PolygonMesh, wrinkles: bool) -> Scene {
    let mut description = SceneDescription::new("bent");
    description.garments.push(GarmentDescription::new("sheet", mesh, 0.2));
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", RIGIDITY));
    if wrinkles {
        let request = EffectRequest::of_garment("plastic_wrinkles", 0).with("yield_radius", 0.02);
        description.effects.push(request.with("hardening", 0.25).with("largest_angle", 1.0));
    }
    Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"))
}

/// The forces of a scene.
fn forces(scene: &Scene) -> Vec<PartForce> {
    let built = build_all(scene).unwrap_or_else(|problems| panic!("{problems}"));
    built.into_iter().flat_map(|(_, effect)| effect.forces).collect()
}

/// Work on a part of the scene, with nothing around it.
fn with_view<R>(scene: &Scene, part: usize, x: &[Vec3], work: impl FnOnce(&PartView<'_>) -> R) -> R {
    let (targets, wind, volumes) = (PinTargets::default(), WindGrid::default(), Volumes::default());
    let context = ForceContext { time: 0.0, targets: &targets, v: &[], wind: &wind, volumes: &volumes };
    let range = scene.parts().ranges()[part].clone();
    work(&PartView { start: range.start, masses: &scene.masses()[range], x, fraction: 0.0, context })
}

/// Returns the sums that `work` on each force adds to the vertices of its part.
fn sums(scene: &Scene, forces: &mut [PartForce], work: impl Fn(usize, &mut dyn Force, &mut [Simd4])) -> Vec<Vec3> {
    let mut sums = vec![Vec3::zeros(); scene.masses().len()];
    for (part, force) in forces {
        let own = &mut sums[scene.parts().ranges()[*part].clone()];
        let mut f = vec![Simd4::ZERO; own.len()];
        work(*part, force.as_mut(), &mut f);
        own.iter_mut().zip(f).for_each(|(sum, f)| *sum += Vec3::from(f));
    }
    sums
}

fn force_at(scene: &Scene, forces: &mut [PartForce], x: &[Vec3]) -> Vec<Vec3> {
    sums(scene, forces, |part, force, f| {
        let own: Vec<Simd4> = x[scene.parts().ranges()[part].clone()].iter().map(Simd4::from).collect();
        with_view(scene, part, x, |view| force.update(view, &own, f));
    })
}

/// At the positions of the last update.
fn damping_at(scene: &Scene, forces: &mut [PartForce], x: &[Vec3], v: &[Vec3]) -> Vec<Vec3> {
    sums(scene, forces, |part, force, f| {
        PartMotion::with(scene.parts().ranges()[part].clone(), x, v, |motion| force.add_damping(motion, f));
    })
}

fn crumpled(scene: &Scene, seed: u32) -> Vec<Vec3> {
    let (mut x, mut random) = (start(scene), random(seed));
    x.iter_mut().for_each(|p| *p += Vec3::new(random(), 2.0 * random(), random()) * 0.004);
    x
}

fn start(scene: &Scene) -> Vec<Vec3> {
    crate::state::State::at_start(scene).x
}

#[test]
fn a_sheet_of_any_mesh_bends_with_the_rigidity_that_was_asked_for() {
    for seed in 1..6 {
        let mesh = TriangleMesh::new(&uneven(14, seed));
        // Curvature so slight that angles are linear in it, in any direction, of either sign.
        for curvature in [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.5], [0.2, -0.7, 0.4], [1.0, 0.0, -1.0]] {
            let [xx, xz, zz] = curvature.map(|c| 1e-3 * c);
            let lift = |p: &Vec3| p + Vec3::y() * (0.5 * (xx * p.x * p.x + zz * p.z * p.z) + xz * p.x * p.z);
            let x: Vec<Vec3> = mesh.rest_positions().iter().map(lift).collect();
            let angles: Vec<f64> = of_mesh(&mesh, |_| Some(Rigidity::isotropic(RIGIDITY)), false)
                .iter()
                .map(|e| Shape::at(e.vertices.map(|v| x[v as usize])).angle())
                .collect();
            let by_area = 0.5 * RIGIDITY * (xx * xx + 2.0 * xz * xz + zz * zz);
            let mut inner = 0;
            for triangle in 0..mesh.triangles().len() {
                let Some(energy) = triangle_energy(&mesh, triangle, Rigidity::isotropic(RIGIDITY), &angles) else {
                    continue;
                };
                let share = energy / (by_area * mesh.rest_areas()[triangle]);
                // Only triangles whose six vertices lie near a conic may be softer.
                assert!(share < 1.0 + 1e-4, "triangle {triangle}: {share}");
                inner += usize::from(share > 1.0 - 1e-4);
            }
            assert!(inner > 280, "{inner} of 338 triangles have the whole energy");
        }
    }
}

#[test]
fn angles_are_softened_at_slivers_alone() {
    let softened = |mesh: &TriangleMesh| {
        let elements = of_mesh(mesh, |_| Some(Rigidity::isotropic(RIGIDITY)), false);
        elements.iter().map(|element| element.softening).filter(|factor| *factor < 1.0).collect::<Vec<_>>()
    };
    assert_eq!(softened(&TriangleMesh::new(&uneven(14, 1))), Vec::<f64>::new());
    // A strip between two wide ones, a hundredth as high as its edges are long.
    let rows = [0.0, 1.0, 1.01, 2.01];
    let points = rows.iter().flat_map(|z| (0..3).map(move |i| Vec3::new(f64::from(i), 0.0, *z))).collect();
    let cell = |a: u32| [[a, a + 3, a + 1], [a + 1, a + 3, a + 4]];
    let triangles: Vec<[u32; 3]> = (0..3).flat_map(|row| (0..2).flat_map(move |i| cell(3 * row + i))).collect();
    let found = softened(&TriangleMesh::new(&PolygonMesh::from_triangles(points, &triangles)));
    // Four edges along the strip have one low triangle, two diagonals have two; the edge between the diagonals is short below both.
    let mut expected = [0.04, 0.04, 0.04, 0.04, 0.0016, 0.0016, 0.0016];
    expected.sort_by(f64::total_cmp);
    let mut found = found;
    found.sort_by(f64::total_cmp);
    assert!(found.len() == 7 && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
}

#[test]
fn forces_are_the_slope_of_the_energy_and_keep_momentum() {
    let scene = scene(uneven(7, 1), false);
    let (mut forces, x) = (forces(&scene), crumpled(&scene, 5));
    let f = force_at(&scene, &mut forces, &x);
    let energy =
        |x: &[Vec3]| with_view(&scene, 0, x, |view| forces.iter().map(|(_, force)| force.energy(view)).sum::<f64>());
    let largest = f.iter().map(Vec3::norm).fold(0.0, f64::max);
    for vertex in (0..x.len()).step_by(5) {
        for axis in 0..3 {
            let [mut low, mut high] = [x.clone(), x.clone()];
            (low[vertex][axis], high[vertex][axis]) = (x[vertex][axis] - 1e-7, x[vertex][axis] + 1e-7);
            let slope = (energy(&high) - energy(&low)) / 2e-7;
            assert!((slope + f[vertex][axis]).abs() < 1e-5 * largest, "vertex {vertex}, axis {axis}");
        }
    }
    assert!(f.iter().sum::<Vec3>().norm() < 1e-12 * largest * x.len() as f64);
    assert!(f.iter().zip(&x).map(|(f, x)| x.cross(f)).sum::<Vec3>().norm() < 1e-12 * largest * x.len() as f64);
}

#[test]
fn damping_is_symmetric_and_never_adds_energy() {
    let scene = scene(uneven(7, 2), false);
    let (mut forces, mut random, x) = (forces(&scene), random(7), crumpled(&scene, 8));
    force_at(&scene, &mut forces, &x);
    let mut velocities = || -> Vec<Vec3> { x.iter().map(|_| Vec3::new(random(), random(), random())).collect() };
    let (a, b) = (velocities(), velocities());
    let mut damping = |v: &[Vec3]| damping_at(&scene, &mut forces, &x, v);
    let dot = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    let (ga, gb) = (damping(&a), damping(&b));
    assert!((dot(&b, &ga) - dot(&a, &gb)).abs() < 1e-12 * dot(&a, &ga).abs());
    assert!(dot(&a, &ga) < 0.0 && dot(&b, &gb) < 0.0);
    // Turning as one changes no angle.
    let turning: Vec<Vec3> = x.iter().map(|x| Vec3::new(0.3, -0.2, 0.9).cross(x)).collect();
    assert!(dot(&turning, &damping(&turning)).abs() < 1e-12 * dot(&a, &ga).abs());
}

#[test]
fn both_sides_of_a_border_of_parts_feel_the_same_hinges() {
    let scene = scene(uneven((2 * PART_SIZE).isqrt() + 1, 3), false);
    assert!(scene.parts().count() > 2);
    let (mut forces, x) = (forces(&scene), crumpled(&scene, 4));
    let v: Vec<Vec3> = crumpled(&scene, 6).iter().zip(&x).map(|(a, b)| a - b).collect();
    let f = force_at(&scene, &mut forces, &x);
    let d = damping_at(&scene, &mut forces, &x, &v);
    // A hinge that one side leaves out, or bends otherwise, would push the whole.
    for f in [f, d] {
        let largest = f.iter().map(Vec3::norm).fold(0.0, f64::max);
        assert!(f.iter().sum::<Vec3>().norm() < 1e-12 * largest * x.len() as f64);
        assert!(f.iter().zip(&x).map(|(f, x)| x.cross(f)).sum::<Vec3>().norm() < 1e-12 * largest * x.len() as f64);
    }
}

#[test]
fn hinges_that_follow_each_other_seldom_share_a_vertex() {
    let mesh = TriangleMesh::new(&uneven(16, 1));
    let elements = of_mesh(&mesh, |_| Some(Rigidity::isotropic(RIGIDITY)), false);
    let vertices = |n: u32| elements[n as usize].vertices;
    let spread = spread((0..elements.len() as u32).collect(), vertices);
    let close =
        spread.iter().zip(&spread[1..]).filter(|(a, b)| vertices(**a).iter().any(|v| vertices(**b).contains(v)));
    assert!(close.count() * 20 < elements.len());
    let mut sorted = spread.clone();
    sorted.sort_unstable();
    assert!(sorted.into_iter().eq(0..elements.len() as u32));
}

#[test]
fn no_motion_is_stiffer_than_the_step_limit_knows() {
    for seed in 1..4 {
        let scene = scene(uneven(9, seed), false);
        let (mut forces, mut random) = (forces(&scene), random(seed));
        let x = start(&scene);
        let mut sums = vec![0.0; x.len()];
        forces.iter().for_each(|(_, force)| force.add_stiffness(&mut sums));
        // A spring of stiffness k between masses m has the highest frequency √(2 k/m) and adds k at both ends.
        let known = sums.iter().zip(scene.masses()).map(|(k, m)| 2.0 * k / m).fold(0.0, f64::max);
        let mut v: Vec<Vec3> = x.iter().map(|_| Vec3::y() * random()).collect();
        let mut found = 0.0;
        for _ in 0..200 {
            let size = v.iter().map(Vec3::norm_squared).sum::<f64>().sqrt();
            v.iter_mut().for_each(|v| *v *= 1e-7 / size);
            let moved: Vec<Vec3> = x.iter().zip(&v).map(|(x, v)| x + v).collect();
            let f = force_at(&scene, &mut forces, &moved);
            v = f.iter().zip(scene.masses()).map(|(f, m)| -f / *m).collect();
            found = v.iter().map(Vec3::norm_squared).sum::<f64>().sqrt() / 1e-7;
        }
        assert!(found <= known, "squared frequency {found}, known {known}");
        assert!(found > 0.15 * known, "the bound is loose: {found} of {known}");
    }
}

#[test]
fn a_squashed_triangle_is_left_out_and_counted() {
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::new(0.5, 0.0, 1.0), Vec3::new(0.5, 0.0, -1.0)];
    let scene = scene(PolygonMesh::from_triangles(points, &[[0, 2, 1], [0, 1, 3]]), false);
    let mut forces = forces(&scene);
    let mut x = start(&scene);
    let moved = x.iter().position(|p| p.z == 1.0).expect("a vertex there");
    for (height, left_out) in [(0.3, 0), (0.09, 1), (0.0, 1)] {
        x[moved] = Vec3::new(0.5, 0.2 * height, height);
        let f = force_at(&scene, &mut forces, &x);
        assert_eq!(f.iter().all(|f| *f == Vec3::zeros()), left_out == 1, "height {height}");
        let mut counted = 0;
        forces.iter_mut().for_each(|(_, force)| force.take_counts(&mut |_, amount| counted += amount));
        assert_eq!(counted, left_out, "height {height}");
    }
}

#[cfg(feature = "effects")]
#[test]
fn a_fold_beyond_its_yield_angle_stays_and_hardens() {
    // Two triangles of height h = 1 cm, which yield at h over the radius of 2 cm: at 0.5 rad.
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::new(0.5, 0.0, 1.0), Vec3::new(0.5, 0.0, -1.0)];
    let points = points.into_iter().map(|p| p * 0.01).collect();
    let scene = scene(PolygonMesh::from_triangles(points, &[[0, 2, 1], [0, 1, 3]]), true);
    let mut forces = forces(&scene);
    let mut x = start(&scene);
    let moved = x.iter().position(|p| p.z > 0.0).expect("a vertex there");
    let folded = |angle: f64| Vec3::new(0.005, 0.01 * angle.sin(), 0.01 * angle.cos());
    let state = |forces: &[PartForce]| -> Vec<Vec<f64>> {
        let mut rows = ElementRows::new();
        forces.iter().filter_map(|(_, force)| force.plastic()).for_each(|force| force.save_elements(&mut rows));
        rows.values().map(|values| values.to_vec()).collect()
    };
    // (fold, rest angle, yield angle) after each: elastic; 0.3 beyond; elastic again; the other way; as far as it goes.
    let cases: [(f64, Option<[f64; 2]>); 5] = [
        (0.45, None),
        (0.8, Some([0.3, 0.575])),
        (0.7, Some([0.3, 0.575])),
        (-0.5, Some([0.075, 0.63125])),
        (2.5, Some([1.0, 0.63125 + 0.25 * (2.425 - 0.63125)])),
    ];
    for (fold, expected) in cases {
        x[moved] = folded(fold);
        forces.iter_mut().filter_map(|(_, force)| force.plastic_mut()).for_each(|force| force.update_plasticity(&x));
        let rows = state(&forces);
        assert_eq!(rows.len(), usize::from(expected.is_some()), "folded by {fold}");
        for (found, expected) in rows.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found.abs() - expected.abs()).abs() < 1e-12, "folded by {fold}: {found}, not {expected}");
        }
    }
}

/// Pairs of triangles of height 1 cm, far apart, each with its own values of some maps, and what yields is 2 cm and so on.
#[cfg(feature = "effects")]
fn painted_pairs(maps: &[(&str, [f64; 3])]) -> Scene {
    let pair = [Vec3::zeros(), Vec3::x(), Vec3::new(0.5, 0.0, 1.0), Vec3::new(0.5, 0.0, -1.0)];
    let points = (0..3).flat_map(|n| pair.map(|p| p * 0.01 + Vec3::x() * f64::from(n))).collect();
    let triangles = [0, 4, 8].map(|n| [[n, n + 2, n + 1], [n, n + 1, n + 3]]);
    let mut garment =
        GarmentDescription::new("pairs", PolygonMesh::from_triangles(points, triangles.as_flattened()), 0.2);
    for (name, [a, b, c]) in maps {
        // The mean of four vertices counts.
        let values = [a, b, c].iter().flat_map(|mean| [0.5, 1.5, 0.25, 1.75].map(|share| share * **mean)).collect();
        garment.maps.insert((*name).into(), PaintedMap { values, absolute: true });
    }
    let mut description = SceneDescription::new("bent");
    description.garments.push(garment);
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", RIGIDITY));
    let request = EffectRequest::of_garment("plastic_wrinkles", 0).with("yield_radius", 0.02);
    description.effects.push(request.with("hardening", 0.25).with("largest_angle", 1.0));
    Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"))
}

#[cfg(feature = "effects")]
#[test]
fn folds_yield_harden_and_end_as_is_painted_on_them() {
    // Rest angle and yield angle of each pair after a fold of 0.8 rad; `None` where nothing stays.
    let after = |maps: &[(&str, [f64; 3])]| {
        let scene = painted_pairs(maps);
        let mut forces = forces(&scene);
        let mut x = start(&scene);
        x.iter_mut().filter(|x| x.z > 0.0).for_each(|x| (x.y, x.z) = (0.01 * 0.8_f64.sin(), 0.01 * 0.8_f64.cos()));
        forces.iter_mut().filter_map(|(_, force)| force.plastic_mut()).for_each(|force| force.update_plasticity(&x));
        let mut rows = ElementRows::new();
        forces.iter().filter_map(|(_, force)| force.plastic()).for_each(|force| force.save_elements(&mut rows));
        let mut found = [None; 3];
        for (vertices, values) in &rows {
            found[start(&scene)[vertices[0] as usize].x.round() as usize] = Some([values[0].abs(), values[1]]);
        }
        found
    };
    let cases = [
        // A yield angle of 1 cm by the radius; none where the radius is nothing.
        (("yield_radius", [0.02, 0.04, 0.0]), [Some([0.3, 0.575]), Some([0.55, 0.25 + 0.25 * 0.55]), None]),
        (("hardening", [0.0, 0.25, 0.5]), [Some([0.3, 0.5]), Some([0.3, 0.575]), Some([0.3, 0.65])]),
        (("largest_angle", [0.1, 0.2, 1.7]), [Some([0.1, 0.575]), Some([0.2, 0.575]), Some([0.3, 0.575])]),
    ];
    for (map, expected) in cases {
        for (found, expected) in after(&[map]).into_iter().zip(expected) {
            let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
            assert_eq!(found.is_some(), expected.is_some(), "{map:?}");
            assert!(found.zip(expected).is_none_or(|(a, b)| apart(a, b) < 1e-12), "{map:?}: {found:?}, {expected:?}");
        }
    }
}

use nalgebra::{Rotation3, Unit};

use super::*;
use crate::geometry::random::SplitMix64;

/// A flat sheet in the plane y = 0 from the origin along x and z: cells of `cell` [m].
fn sheet([nx, nz]: [u32; 2], cell: f64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let id = |i: u32, j: u32| i * (nz + 1) + j;
    let point = |i: u32, j: u32| Vec3::new(f64::from(i), 0.0, f64::from(j)) * cell;
    let points = (0..=nx).flat_map(|i| (0..=nz).map(move |j| point(i, j))).collect();
    let cells = (0..nx).flat_map(|i| (0..nz).map(move |j| (i, j)));
    let halves =
        |(i, j): (u32, u32)| [[id(i, j), id(i, j + 1), id(i + 1, j)], [id(i + 1, j), id(i, j + 1), id(i + 1, j + 1)]];
    (points, cells.flat_map(halves).collect())
}

/// Points at random over a sheet, at most so far from it.
fn cloud(count: usize, [long, wide]: [f64; 2], away: f64) -> Vec<Vec3> {
    let mut random = SplitMix64::new(77);
    (0..count).map(|_| Vec3::new(random.unit() * long, random.signed() * away, random.unit() * wide)).collect()
}

fn turn() -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Unit::new_normalize(Vec3::new(1.0, -2.0, 0.5)), 2.3)
}

#[test]
fn rigid_motions_are_followed_to_rounding() {
    let (rest, triangles) = sheet([9, 7], 0.03);
    // Also beyond the edges.
    let points: Vec<Vec3> = cloud(500, [0.4, 0.3], 0.05).iter().map(|p| p - Vec3::new(0.05, 0.0, 0.05)).collect();
    let rigid = [(0..40).collect::<Vec<u32>>()];
    let binding = SurfaceBinding::new(rest.clone(), triangles, &points, &rigid).unwrap();
    let (to, spin, speed) = (Vec3::new(3.0, -20.0, 7.0), Vec3::new(4.0, 1.0, -9.0), Vec3::new(0.5, 2.0, -1.0));
    let x: Vec<Vec3> = rest.iter().map(|p| turn() * p + to).collect();
    let v: Vec<Vec3> = x.iter().map(|p| speed + spin.cross(p)).collect();
    let (positions, velocities) = binding.motion(&x, &v);
    assert_eq!(positions, binding.positions(&x));
    for ((point, place), velocity) in points.iter().zip(&positions).zip(&velocities) {
        let expected = turn() * point + to;
        assert!((place - expected).norm() < 1e-12 * expected.norm(), "{place} instead of {expected}");
        let expected = speed + spin.cross(&expected);
        // Rates are differences of rates over a cell of 3 cm, 20 m from where it turns.
        assert!((velocity - expected).norm() < 1e-11 * expected.norm(), "{velocity} instead of {expected}");
    }
}

#[test]
fn triangles_without_an_area_are_left_out() {
    let (rest, triangles) = sheet([4, 4], 0.1);
    let points = cloud(50, [0.3, 0.3], 0.02);
    let flat: Vec<[u32; 3]> = vec![[0, 0, 1], [5, 5, 5], [0, 1, 2]];
    assert_eq!((rest[0] + rest[2]) * 0.5, rest[1], "on one line");
    let with_flat = SurfaceBinding::new(rest.clone(), [&flat[..], &triangles].concat(), &points, &[]).unwrap();
    let without = SurfaceBinding::new(rest.clone(), triangles, &points, &[]).unwrap();
    let x: Vec<Vec3> = rest.iter().map(|p| turn() * p).collect();
    assert_eq!(with_flat.positions(&x), without.positions(&x));
    assert!(with_flat.places().eq(without.places()));
    assert!(SurfaceBinding::new(rest, flat, &points, &[]).is_none());
}

#[test]
fn at_rest_every_point_is_where_it_was_bound() {
    let (rest, triangles) = sheet([4, 4], 0.1);
    let points = cloud(200, [0.4, 0.4], 0.02);
    let binding = SurfaceBinding::new(rest.clone(), triangles, &points, &[]).unwrap();
    for (place, point) in binding.positions(&rest).iter().zip(&points) {
        assert!((place - point).norm() < 1e-15);
    }
    for (distance, point) in binding.distances().zip(&points) {
        assert!((distance - point.y.abs()).abs() < 1e-15);
    }
}

#[test]
fn layers_keep_their_distance_from_a_strip_that_is_bent_to_a_cylinder() {
    let (cell, height, radius) = (0.01, 0.004, 0.05);
    let (rest, triangles) = sheet([30, 4], cell);
    let x: Vec<Vec3> = rest
        .iter()
        .map(|p| {
            let angle = p.x / radius;
            Vec3::new(radius * angle.sin(), radius * (1.0 - angle.cos()), p.z)
        })
        .collect();
    // Not at the free ends, where a vertex has triangles on one side only.
    let middle = cloud(400, [0.28, 0.04], 0.0).into_iter().map(|p| p + Vec3::x() * cell);
    let points: Vec<Vec3> = middle.flat_map(|p| [height, -height].map(|h| p + Vec3::y() * h)).collect();
    let binding = SurfaceBinding::new(rest, triangles, &points, &[]).unwrap();
    // The surface is a prism inside of the cylinder, by the sagitta of a cell. Frames are blended linearly over the angle of a
    // cell, by which the normal of a layer is off by less than a quarter of it.
    let angle = cell / radius;
    let (sagitta, tilt) = (cell * cell / (8.0 * radius), height * (angle / 4.0) * (angle / 4.0) / 2.0);
    for (point, place) in points.iter().zip(binding.positions(&x)) {
        let from_axis = (place - Vec3::new(0.0, radius, place.z)).norm();
        // y is inwards: the axis is above.
        let off = from_axis - (radius - point.y);
        assert!(off.abs() < sagitta + tilt + 1e-12, "{off} at {point}");
        assert!((place.z - point.z).abs() < 2.0 * sagitta, "{place}");
    }
}

#[test]
fn nothing_collapses_or_jumps_at_a_fold_of_almost_180_degrees() {
    let (cell, height) = (0.01, 0.002);
    let (rest, triangles) = sheet([20, 6], cell);
    let crease = 10.0 * cell;
    let points: Vec<Vec3> = (0..4000)
        .map(|i| Vec3::new(0.2 * f64::from(i) / 4000.0, if i % 2 == 0 { height } else { -height }, 0.031))
        .collect();
    let binding = SurfaceBinding::new(rest.clone(), triangles.clone(), &points, &[]).unwrap();
    for degrees in [90.0_f64, 170.0, 179.0, 179.9] {
        let leaf = Rotation3::from_axis_angle(&Vec3::z_axis(), degrees.to_radians());
        let fold = |p: &Vec3| if p.x > crease { leaf * (p - Vec3::x() * crease) + Vec3::x() * crease } else { *p };
        let x: Vec<Vec3> = rest.iter().map(fold).collect();
        let placed = binding.positions(&x);
        for (side, (point, place)) in points.iter().zip(&placed).enumerate() {
            let base = fold(&Vec3::new(point.x, 0.0, point.z));
            assert!(((place - base).norm() - height).abs() < 1e-12, "{side}: it keeps its distance at {degrees}°");
        }
        // Neighbours of one layer are 0.1 mm apart; the layer turns by at most 180° over two cells.
        let step = 1e-4 + height * std::f64::consts::PI * 1e-4 / cell;
        for pair in placed.chunks(2).collect::<Vec<_>>().windows(2) {
            for (before, after) in pair[0].iter().zip(pair[1]) {
                assert!((after - before).norm() < 1.5 * step, "a jump at {degrees}°");
            }
        }
        // Right at the crease the layers stand half-way between the leaves, on both sides of it.
        let at_crease = points.iter().zip(&placed).find(|(point, _)| point.x >= crease && point.y > 0.0).unwrap().1;
        let half_way = Rotation3::from_axis_angle(&Vec3::z_axis(), degrees.to_radians() / 2.0) * Vec3::y();
        let apart = (at_crease - Vec3::new(crease, 0.0, 0.031)).normalize();
        assert!(apart.dot(&half_way) > 0.99, "{apart} at {degrees}°");
    }
}

#[test]
fn velocities_are_the_rate_of_the_positions() {
    let (rest, triangles) = sheet([8, 6], 0.05);
    let points = cloud(300, [0.4, 0.3], 0.02);
    let rigid = [(0..30).collect::<Vec<u32>>()];
    let binding = SurfaceBinding::new(rest.clone(), triangles, &points, &rigid).unwrap();
    let mut random = SplitMix64::new(5);
    let x: Vec<Vec3> =
        rest.iter().map(|p| turn() * (p + Vec3::y() * 0.05 * (20.0 * p.x).sin() + random.vector() * 0.01)).collect();
    let v: Vec<Vec3> = x.iter().map(|_| random.vector()).collect();
    let after = |time: f64| binding.positions(&x.iter().zip(&v).map(|(x, v)| x + v * time).collect::<Vec<_>>());
    let time = 1e-6;
    let (positions, velocities) = binding.motion(&x, &v);
    assert_eq!(positions, after(0.0));
    for ((before, after), velocity) in after(-time).iter().zip(after(time)).zip(&velocities) {
        let difference = (after - before) / (2.0 * time);
        // Rounding of 1e-16 m over 2 µs, and the third derivative over the square of the time.
        assert!((velocity - difference).norm() < 1e-7, "{velocity} instead of {difference}");
    }
}

#[test]
fn a_rigid_part_keeps_its_shape_on_a_surface_that_bends() {
    let (rest, triangles) = sheet([10, 10], 0.01);
    let points: Vec<Vec3> = cloud(50, [0.02, 0.02], 0.002).iter().map(|p| p + Vec3::new(0.04, 0.003, 0.04)).collect();
    let all: Vec<u32> = (0..50).collect();
    let binding = SurfaceBinding::new(rest.clone(), triangles.clone(), &points, &[all]).unwrap();
    let x: Vec<Vec3> = rest.iter().map(|p| p + Vec3::y() * (30.0 * p.x).sin() * 0.02).collect();
    let placed = binding.positions(&x);
    let soft = SurfaceBinding::new(rest, triangles, &points, &[]).unwrap().positions(&x);
    let changed = |placed: &[Vec3]| {
        let pairs = (1..50).map(|i| (placed[i] - placed[0]).norm() - (points[i] - points[0]).norm());
        pairs.map(f64::abs).fold(0.0, f64::max)
    };
    assert!(changed(&placed) < 1e-15);
    assert!(changed(&soft) > 1e-5, "the same points that are not rigid follow the surface");
}

#[test]
fn points_that_are_bound_to_two_layers_are_found() {
    // A strip that lies folded at rest, its layers 1 cm apart: 15 cells, a hem of one cell, 15 cells back.
    let cell = 0.01;
    let (mut rest, triangles) = sheet([31, 3], cell);
    for p in &mut rest {
        let cells = (p.x / cell).round();
        *p = if cells > 15.0 { Vec3::new((31.0 - cells) * cell, cell, p.z) } else { *p };
    }
    let at = |x: f64, y: f64| Vec3::new(x, y, 0.012);
    let points =
        [at(0.02, 0.004), at(0.0203, 0.006), at(0.0203, 0.004), at(0.12, 0.004), at(0.15, 0.002), at(0.15, 0.008)];
    let binding = SurfaceBinding::new(rest, triangles, &points, &[]).unwrap();
    let edges = [[0, 1], [0, 2], [0, 3], [4, 5]];
    assert_eq!(
        binding.torn(&points, edges.into_iter()),
        [[0, 1]],
        "only one leads from layer to layer far from the hem"
    );
}

#[test]
fn a_mesh_that_faces_the_other_way_is_told_from_a_shell() {
    let (rest, triangles) = sheet([4, 4], 0.1);
    let turned: Vec<[u32; 3]> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let binding = SurfaceBinding::new(rest.clone(), triangles.clone(), &rest, &[]).unwrap();
    let shell = [triangles.clone(), turned.clone()].concat();
    for (faces, share) in [(&triangles, 0.0), (&shell, 0.5), (&turned, 1.0)] {
        assert!((binding.facing_against(&rest, faces) - share).abs() < 1e-12);
    }
}

//! Small meshes and shapes for the tests of this module.

use super::shapes::Shape;
use crate::Vec3;

/// One shape of every kind.
pub(crate) const SHAPES: [Shape; 5] = [
    Shape::HalfSpace,
    Shape::Sphere { radius: 0.7 },
    Shape::Capsule { radius: 0.3, half_length: 0.5 },
    Shape::Cylinder { radius: 0.4, half_length: 0.6 },
    Shape::Box { half_extents: [0.5, 0.3, 0.7] },
];

/// A closed triangulated torus about the y axis, facing outwards; `n` segments around, `n / 2` across.
pub(crate) fn torus(n: u32, large: f64, small: f64) -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let m = n / 2;
    let mut points = Vec::new();
    for i in 0..n {
        let (sin_u, cos_u) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
        for j in 0..m {
            let (sin_v, cos_v) = (std::f64::consts::TAU * f64::from(j) / f64::from(m)).sin_cos();
            let r = large + small * cos_v;
            points.push(Vec3::new(r * cos_u, small * sin_v, r * sin_u));
        }
    }
    let id = |i: u32, j: u32| (i % n) * m + j % m;
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..m {
            triangles.push([id(i, j), id(i, j + 1), id(i + 1, j + 1)]);
            triangles.push([id(i, j), id(i + 1, j + 1), id(i + 1, j)]);
        }
    }
    (triangles, points)
}

/// The cube [-1, 1]³ as twelve triangles, facing outwards.
pub(crate) fn cube() -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let side = |bit: u32| if bit == 0 { -1.0 } else { 1.0 };
    let points = (0..8).map(|i| Vec3::new(side(i & 1), side(i & 2), side(i & 4))).collect();
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    (triangles, points)
}

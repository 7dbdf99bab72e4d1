//! The point of a triangle or parallelogram closest to the origin, with a direction to it that is good to the last
//! digits.

use crate::Vec3;
use crate::geometry::distance::{TriangleFeature, closest_on_segments, closest_on_triangle};

/// Closest point, and directions to try.
pub(super) struct Nearest {
    /// Unit vector to the closest point; zero if the origin is that point.
    pub(super) direction: Vec3,
    /// Length of that vector, about.
    pub(super) distance: f64,
    /// A normal of the triangle or of both edges, zero if there is none.
    pub(super) across: Vec3,
    /// Corners at the ends of the side on which the closest point lies, if it is inside one.
    pub(super) side: Option<[usize; 2]>,
    /// Weights of the four corners in the closest point.
    pub(super) shares: [f64; 4],
    /// Weights of the four original points, as in [`Contact`](super::Contact).
    pub(super) weights: [f64; 4],
}

/// Unit vector, or zero where there is no direction.
pub(super) fn unit(v: &Vec3) -> Vec3 {
    let length = v.norm();
    if length > 0.0 && length.is_finite() { v / length } else { Vec3::zeros() }
}

/// The part of `v` across `edge`. A second pass takes away what rounding left of the first.
fn across(v: &Vec3, edge: &Vec3) -> Vec3 {
    let length_squared = edge.norm_squared();
    if length_squared == 0.0 {
        return *v;
    }
    let once = v - edge * (v.dot(edge) / length_squared);
    once - edge * (once.dot(edge) / length_squared)
}

/// `normal` on the side of `v`.
fn towards(normal: &Vec3, v: &Vec3) -> Vec3 {
    if normal.dot(v) < 0.0 { -normal } else { *normal }
}

/// Point and triangle: corner k is the point less corner k of the triangle; the fourth repeats the third.
#[inline(always)]
pub(super) fn of_triangle(d: &[Vec3; 4]) -> Nearest {
    let found = closest_on_triangle(&Vec3::zeros(), &[d[0], d[1], d[2]]);
    let normal = (d[1] - d[0]).cross(&(d[2] - d[0]));
    let vector = match found.feature {
        TriangleFeature::Face => towards(&normal, &d[0]),
        TriangleFeature::Edge(i) => {
            let i = usize::from(i);
            across(&found.point, &(d[(i + 1) % 3] - d[i]))
        }
        TriangleFeature::Vertex(i) => d[usize::from(i)],
    };
    let [a, b, c] = found.weights;
    Nearest {
        direction: unit(&vector),
        distance: found.distance_squared.sqrt(),
        across: normal,
        side: match found.feature {
            TriangleFeature::Edge(i) => Some([usize::from(i), (usize::from(i) + 1) % 3]),
            _ => None,
        },
        shares: [a, b, c, 0.0],
        weights: [1.0, -a, -b, -c],
    }
}

/// Two edges: corners a0 − b0, a0 − b1, a1 − b0, a1 − b1.
#[inline(always)]
pub(super) fn of_parallelogram(d: &[Vec3; 4]) -> Nearest {
    let (a, b) = (d[2] - d[0], d[0] - d[1]);
    let found = closest_on_segments(&[d[0], d[2]], &[Vec3::zeros(), b]);
    let [alpha, beta] = found.parameters;
    let normal = a.cross(&b);
    let inside = |parameter: f64| 0.0 < parameter && parameter < 1.0;
    let between = found.points[0] - found.points[1];
    let vector = match (inside(alpha), inside(beta)) {
        (true, true) => towards(&normal, &d[0]),
        (true, false) => across(&between, &a),
        (false, true) => across(&between, &b),
        (false, false) => d[usize::from(alpha == 1.0) * 2 + usize::from(beta == 1.0)],
    };
    Nearest {
        direction: unit(&vector),
        distance: found.distance_squared.sqrt(),
        across: normal,
        side: match (inside(alpha), inside(beta)) {
            (true, false) => Some([0, 2]),
            (false, true) => Some([0, 1]),
            _ => None,
        },
        shares: [(1.0 - alpha) * (1.0 - beta), (1.0 - alpha) * beta, alpha * (1.0 - beta), alpha * beta],
        weights: [1.0 - alpha, alpha, beta - 1.0, -beta],
    }
}

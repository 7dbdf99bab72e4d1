//! Whether a segment meets a triangle, decided without rounding.
//!
//! Signs of determinants come from adaptive expansions (Shewchuk 1997, *Adaptive precision floating-point arithmetic and
//! fast robust geometric predicates*). They are exact as long as no product of three coordinates leaves the range of
//! `f64`: coordinates that are zero or between 1e-90 and 1e90 in size, as all `f32` are.

use robust::{Coord, Coord3D};

use crate::Vec3;
use crate::geometry::tolerances::SEPARATION;

/// Whether the closed segment and the closed triangle have a point in common. Exact, and never a failure: triangles
/// without area are the segments or points they are, and so are segments without length. Coordinates are finite.
#[inline]
pub(crate) fn segment_meets_triangle(segment: &[Vec3; 2], triangle: &[Vec3; 3]) -> bool {
    !are_certainly_apart(segment, triangle) && decide(segment, triangle)
}

/// Whether a plane separates the two beyond all rounding: the triangle's own, or one that stands on it along an edge or
/// along the segment. Spares neighbours in one plane, where determinants vanish, the long arithmetic.
#[inline]
fn are_certainly_apart(segment: &[Vec3; 2], triangle: &[Vec3; 3]) -> bool {
    // From one corner, so that rounding is relative to the size of the two and not to the place where they are.
    let [p, q] = [segment[0] - triangle[0], segment[1] - triangle[0]];
    let [b, c] = [triangle[1] - triangle[0], triangle[2] - triangle[0]];
    let size = [p, q, b, c].iter().map(|v| v.amax()).fold(0.0, f64::max);
    // Whatever the direction is, it is taken as exact, so it only matters what its products with four points round to.
    let separates = |direction: &Vec3| {
        let [p, q, b, c] = [p, q, b, c].map(|v| direction.dot(&v));
        let gap = (p.min(q) - b.max(c).max(0.0)).max(b.min(c).min(0.0) - p.max(q));
        let rounding = SEPARATION * (direction.x.abs() + direction.y.abs() + direction.z.abs()) * size;
        gap.is_finite() && gap > rounding + f64::MIN_POSITIVE
    };
    let normal = b.cross(&c);
    separates(&normal) || [q - p, b, c, c - b].iter().any(|along| separates(&normal.cross(along)))
}

/// The exact answer.
fn decide(segment: &[Vec3; 2], triangle: &[Vec3; 3]) -> bool {
    let [a, b, c] = triangle;
    let sides = segment.map(|p| volume(a, b, c, &p));
    if has_one_sign(&sides) {
        return false;
    }
    if sides == [0.0; 2] {
        return meets_in_plane(segment, triangle);
    }
    // The line is not in the plane: its turns about the three edges are the barycentric coordinates of where it pierces.
    let [p, q] = segment;
    let turns = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    !has_both_signs(&turns)
}

/// For five points in a plane, or a triangle without area and any segment.
fn meets_in_plane(segment: &[Vec3; 2], triangle: &[Vec3; 3]) -> bool {
    match projection_of(triangle) {
        Some(axes) => {
            // Dropping a coordinate is exact, and one-to-one on a plane that does not contain its axis.
            let [a, b, c] = triangle.map(|p| drop(&p, axes));
            let [p, q] = segment.map(|p| drop(&p, axes));
            is_inside(p, [a, b, c]) || [[a, b], [b, c], [c, a]].iter().any(|edge| segments_meet_2d([p, q], *edge))
        }
        // No area: the triangle is the union of its edges.
        None => (0..3).any(|k| segments_meet(segment, &[triangle[k], triangle[(k + 1) % 3]])),
    }
}

/// Whether two closed segments in space have a point in common.
fn segments_meet(s: &[Vec3; 2], t: &[Vec3; 2]) -> bool {
    if volume(&s[0], &s[1], &t[0], &t[1]) != 0.0 {
        return false;
    }
    let corners = [[s[0], s[1], t[0]], [s[0], s[1], t[1]], [s[0], t[0], t[1]], [s[1], t[0], t[1]]];
    match corners.iter().find_map(projection_of) {
        Some(axes) => segments_meet_2d(s.map(|p| drop(&p, axes)), t.map(|p| drop(&p, axes))),
        // All on one line: intervals that overlap in every coordinate overlap along the line.
        None => (0..3).all(|k| overlap([s[0][k], s[1][k]], [t[0][k], t[1][k]])),
    }
}

/// Two axes onto which the triangle projects with an area, `None` if it has none in space.
fn projection_of(triangle: &[Vec3; 3]) -> Option<[usize; 2]> {
    [[0, 1], [1, 2], [2, 0]].into_iter().find(|&axes| {
        let [a, b, c] = triangle.map(|p| drop(&p, axes));
        area(a, b, c) != 0.0
    })
}

/// Whether two closed segments in the plane have a point in common, whatever their length.
fn segments_meet_2d(s: [Coord<f64>; 2], t: [Coord<f64>; 2]) -> bool {
    let [p, q] = s;
    let [a, b] = t;
    let of_s = [area(p, q, a), area(p, q, b)];
    let of_t = [area(a, b, p), area(a, b, q)];
    // Boxes decide when all four points are on a line; otherwise no box of meeting segments is apart.
    let boxes_overlap = overlap([p.x, q.x], [a.x, b.x]) && overlap([p.y, q.y], [a.y, b.y]);
    boxes_overlap && !has_one_sign(&of_s) && !has_one_sign(&of_t)
}

/// Whether two closed intervals, given by their ends in any order, have a number in common.
fn overlap([a, b]: [f64; 2], [c, d]: [f64; 2]) -> bool {
    a.min(b) <= c.max(d) && c.min(d) <= a.max(b)
}

/// Whether a point lies in a closed triangle with an area.
fn is_inside(p: Coord<f64>, [a, b, c]: [Coord<f64>; 3]) -> bool {
    let turns = [area(a, b, p), area(b, c, p), area(c, a, p)];
    !has_both_signs(&turns)
}

fn has_both_signs(values: &[f64; 3]) -> bool {
    values.iter().any(|&v| v > 0.0) && values.iter().any(|&v| v < 0.0)
}

/// Whether both are positive, or both negative. Not by their product, which may be too small for a number.
fn has_one_sign(values: &[f64; 2]) -> bool {
    values.iter().all(|&v| v > 0.0) || values.iter().all(|&v| v < 0.0)
}

fn drop(p: &Vec3, [x, y]: [usize; 2]) -> Coord<f64> {
    Coord { x: p[x], y: p[y] }
}

/// Sign of the area of a triangle in the plane.
fn area(a: Coord<f64>, b: Coord<f64>, c: Coord<f64>) -> f64 {
    robust::orient2d(a, b, c)
}

/// Sign of the volume of a tetrahedron.
fn volume(a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3) -> f64 {
    let [a, b, c, d] = [a, b, c, d].map(|p| Coord3D { x: p.x, y: p.y, z: p.z });
    robust::orient3d(a, b, c, d)
}

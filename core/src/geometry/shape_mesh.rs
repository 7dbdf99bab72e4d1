//! Triangles around analytic shapes, for the edges and faces of cloth.

use std::f64::consts::{PI, TAU};

use crate::Vec3;
use crate::geometry::shapes::Shape;

/// Segments of the circle about the axis of a round shape.
const SEGMENTS: [f64; 2] = [16.0, 64.0];

/// Share of the distance that vertices of cloth keep that triangles may stand off a round shape.
const STANDOFF: f64 = 1.0 / 3.0;

/// Triangles of a shape, in its own frame; counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShapeMesh {
    pub points: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// Depth to which a triangle of cloth with edges of this length can cut into a shape whose surface its corners keep a distance
    /// of `thickness` from, counted from that distance [m]. Zero for the half space; infinite for shapes with sharp edges.
    pub(crate) fn cut(&self, edge: f64, thickness: f64) -> f64 {
        match *self {
            Shape::HalfSpace => 0.0,
            Shape::Box { .. } | Shape::Cylinder { .. } => f64::INFINITY,
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } => {
                // The circle about an equilateral triangle has a radius of edge / √3.
                let kept = radius + thickness;
                kept - (kept * kept - edge * edge / 3.0).max(0.0).sqrt()
            }
        }
    }

    /// Largest distance between a shape and the finest mesh of it, whatever distance vertices keep [m].
    pub(crate) fn finest_sagitta(&self) -> f64 {
        match *self {
            Shape::HalfSpace | Shape::Box { .. } => 0.0,
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } => 2.0 * sagitta(radius, SEGMENTS[1]),
            Shape::Cylinder { radius, .. } => sagitta(radius, SEGMENTS[1]),
        }
    }

    /// Triangles for the edges and faces of cloth whose vertices keep a distance of `thickness` [m] from the shape. Round sides are
    /// so fine that they stand off the shape by at most a third of it, and touch the shape where that is possible with 64 segments
    /// to the circle; else they cut into it. None for the half space, which faces cannot enter without their corners.
    pub(crate) fn mesh(&self, thickness: f64) -> Option<ShapeMesh> {
        let standoff = STANDOFF * thickness;
        // Quads of a ball bend in two directions.
        let ball = |radius: f64, half_length: f64| {
            let segments = segments((radius / (radius + standoff)).sqrt());
            let around = radius / (PI / segments as f64).cos().powi(2);
            revolved(&half_circle(around.min(radius + standoff), half_length, segments), segments)
        };
        match *self {
            Shape::HalfSpace => None,
            Shape::Sphere { radius } => Some(ball(radius, 0.0)),
            Shape::Capsule { radius, half_length } => Some(ball(radius, half_length)),
            Shape::Cylinder { radius, half_length: h } => {
                let segments = segments(radius / (radius + standoff));
                let around = (radius / (PI / segments as f64).cos()).min(radius + standoff);
                Some(revolved(&[[0.0, h], [around, h], [around, -h], [0.0, -h]], segments))
            }
            Shape::Box { half_extents } => Some(cuboid(&Vec3::from(half_extents))),
        }
    }
}

/// Height of the arc above a side of a regular polygon in a circle [m].
fn sagitta(radius: f64, segments: f64) -> f64 {
    radius * (1.0 - (PI / segments).cos())
}

/// Number of segments of a circle of which half a segment has at least this cosine; four quarters, so that a half circle has a point
/// at each pole and one between them.
fn segments(cosine: f64) -> usize {
    let [fewest, most] = SEGMENTS;
    ((PI / cosine.acos()).clamp(fewest, most).ceil() as usize).next_multiple_of(4)
}

/// Half a circle from the upper pole to the lower one, of this many segments for the whole circle, its quarters moved apart by twice
/// `half_length` [m]: distances from the axis and heights.
fn half_circle(radius: f64, half_length: f64, segments: usize) -> Vec<[f64; 2]> {
    let quarter = segments / 4;
    let at = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / segments as f64).sin_cos();
        // Exactly on the axis, and on the equator.
        [if k == 0 { 0.0 } else { radius * sin }, if k == quarter { 0.0 } else { radius * cos }]
    };
    let upper: Vec<[f64; 2]> = (0..=quarter).map(at).collect();
    // A sphere has one equator.
    let lower = upper.iter().rev().skip(usize::from(half_length == 0.0));
    let lower = lower.map(|[from_axis, height]| [*from_axis, -height - half_length]);
    upper.iter().map(|[from_axis, height]| [*from_axis, height + half_length]).chain(lower).collect()
}

/// Surface of revolution about the y axis of a line from a point on the axis down to another: distances from the axis and heights.
fn revolved(profile: &[[f64; 2]], segments: usize) -> ShapeMesh {
    let [[_, top], rings @ .., [_, bottom]] = profile else {
        return ShapeMesh { points: Vec::new(), triangles: Vec::new() };
    };
    let mut points = vec![Vec3::y() * *top, Vec3::y() * *bottom];
    for [from_axis, height] in rings {
        points.extend((0..segments).map(|k| {
            let (sin, cos) = (TAU * k as f64 / segments as f64).sin_cos();
            Vec3::new(from_axis * cos, *height, from_axis * sin)
        }));
    }
    let at = |ring: usize, k: usize| (2 + ring * segments + k % segments) as u32;
    let last = rings.len() - 1;
    let mut triangles = Vec::new();
    for k in 0..segments {
        triangles.push([0, at(0, k + 1), at(0, k)]);
        for ring in 0..last {
            triangles.push([at(ring, k), at(ring, k + 1), at(ring + 1, k)]);
            triangles.push([at(ring + 1, k), at(ring, k + 1), at(ring + 1, k + 1)]);
        }
        triangles.push([1, at(last, k), at(last, k + 1)]);
    }
    ShapeMesh { points, triangles }
}

/// A box with two triangles on each side.
fn cuboid(half_extents: &Vec3) -> ShapeMesh {
    let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
    let points = (0..8).map(|corner| half_extents.zip_map(&Vec3::from_fn(|axis, _| sign(corner, axis)), |h, s| h * s));
    // Corners of the sides by bits: x is 1, y is 2, z is 4.
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ShapeMesh { points: points.collect(), triangles }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const SHAPES: [(Shape, f64, f64); 4] = [
        (Shape::Sphere { radius: 0.3 }, 4.0 / 3.0 * PI * 0.027, 4.0 * PI * 0.09),
        (
            Shape::Capsule { radius: 0.1, half_length: 0.2 },
            4.0 / 3.0 * PI * 0.001 + PI * 0.01 * 0.4,
            4.0 * PI * 0.01 + TAU * 0.1 * 0.4,
        ),
        (Shape::Cylinder { radius: 0.2, half_length: 0.5 }, PI * 0.04, TAU * 0.04 + TAU * 0.2),
        (Shape::Box { half_extents: [0.1, 0.2, 0.3] }, 0.048, 0.88),
    ];

    #[test]
    fn meshes_are_closed_face_outwards_and_have_the_volume_and_area_of_their_shapes() {
        for (shape, volume, area) in SHAPES {
            for thickness in [0.0, 1e-3, 0.05] {
                let ShapeMesh { points, triangles } = shape.mesh(thickness).expect("it has a mesh");
                let mut edges = BTreeMap::new();
                for [a, b, c] in &triangles {
                    [[a, b], [b, c], [c, a]].iter().for_each(|[p, q]| *edges.entry([**p, **q]).or_insert(0) += 1);
                }
                for ([a, b], count) in &edges {
                    assert_eq!((*count, edges.get(&[*b, *a])), (1, Some(&1)), "{shape:?}");
                }
                assert_eq!(points.len() + triangles.len(), edges.len() / 2 + 2, "{shape:?}: Euler's formula");
                let corners = triangles.iter().map(|t| t.map(|p| points[p as usize]));
                let (mut inside, mut surface) = (0.0, 0.0);
                for [a, b, c] in corners {
                    inside += a.dot(&b.cross(&c)) / 6.0;
                    surface += (b - a).cross(&(c - a)).norm() / 2.0;
                }
                for (found, exact) in [(inside, volume), (surface, area)] {
                    let share = found / exact - 1.0;
                    assert!(
                        share.abs() < [0.005, 0.03, 0.08][(thickness * 1e3).ceil().min(2.0) as usize],
                        "{shape:?} {thickness}: {share}"
                    );
                }
            }
        }
        assert_eq!(Shape::HalfSpace.mesh(0.1), None);
    }

    #[test]
    fn triangles_touch_the_shape_and_stand_off_by_a_third_of_the_thickness() {
        for (shape, ..) in SHAPES {
            let thickness = 0.004;
            let ShapeMesh { points, triangles } = shape.mesh(thickness).expect("it has a mesh");
            for p in &points {
                let distance = shape.signed_distance(p).0;
                assert!((-1e-15..=thickness / 3.0 + 1e-15).contains(&distance), "{shape:?} {p:?}: {distance}");
            }
            let mut deepest = f64::INFINITY;
            for [a, b, c] in triangles.iter().map(|t| t.map(|p| points[p as usize])) {
                for p in [(a + b + c) / 3.0, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0] {
                    deepest = shape.signed_distance(&p).0.min(deepest);
                }
            }
            assert!((-1e-12..thickness / 6.0).contains(&deepest), "{shape:?}: {deepest}");
        }
    }

    #[test]
    fn triangles_of_bodies_without_thickness_lie_in_them_and_not_deeper_than_the_finest_mesh() {
        for (shape, ..) in SHAPES {
            let ShapeMesh { points, triangles } = shape.mesh(0.0).expect("it has a mesh");
            for [a, b, c] in triangles.iter().map(|t| t.map(|p| points[p as usize])) {
                let depths =
                    [a, b, c, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0].map(|p| -shape.signed_distance(&p).0);
                let on_sides = depths.iter().all(|depth| *depth < 1e-15 + shape.finest_sagitta());
                assert!(on_sides || shape.cut(1.0, 0.0).is_infinite(), "{shape:?}: {depths:?}");
                assert!(depths.iter().all(|depth| *depth > -1e-15), "{shape:?}: {depths:?}");
            }
        }
    }

    #[test]
    fn cuts_are_those_of_a_triangle_on_a_ball() {
        let ball = Shape::Sphere { radius: 0.1 };
        // An octahedron's triangle has its middle at r / √3.
        let cut = ball.cut(0.1 * 2.0_f64.sqrt(), 0.0);
        assert!((cut - 0.1 * (1.0 - 1.0 / 3.0_f64.sqrt())).abs() < 1e-15);
        assert_eq!(ball.cut(1.0, 0.0), 0.1);
        assert_eq!(Shape::HalfSpace.cut(1.0, 0.0), 0.0);
    }
}

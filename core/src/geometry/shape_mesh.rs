//! Triangles around analytic shapes with sharp edges, for the edges and faces of cloth.

use std::f64::consts::{PI, TAU};

use crate::Vec3;
use crate::geometry::shapes::Shape;

/// Segments of the circle about the axis of a cylinder.
const SEGMENTS: [f64; 2] = [16.0, 64.0];

/// Share of the distance that vertices of cloth keep that triangles may stand off a round side.
const STANDOFF: f64 = 1.0 / 3.0;

/// Triangles of a shape, in its own frame; counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShapeMesh {
    pub points: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// Triangles for the edges and faces of cloth whose vertices keep a distance of `thickness` [m] from the shape. The round side of
    /// a cylinder is so fine that it stands off by at most a third of it, and touches the shape where that is possible with 64
    /// segments to the circle; else it cuts into it. None for the half space, which faces cannot enter without their corners, and for
    /// shapes without sharp edges.
    pub(crate) fn mesh(&self, thickness: f64) -> Option<ShapeMesh> {
        match *self {
            Shape::HalfSpace | Shape::Sphere { .. } | Shape::Capsule { .. } => None,
            Shape::Cylinder { radius, half_length: h } => {
                let farthest = radius + STANDOFF * thickness;
                let segments = segments(radius / farthest);
                let around = (radius / libm::cos(PI / segments as f64)).min(farthest);
                Some(revolved(&[[0.0, h], [around, h], [around, -h], [0.0, -h]], segments))
            }
            Shape::Box { half_extents } => Some(cuboid(&Vec3::from(half_extents))),
        }
    }
}

/// Number of segments of a circle of which half a segment has at least this cosine.
fn segments(cosine: f64) -> usize {
    let [fewest, most] = SEGMENTS;
    (PI / libm::acos(cosine)).clamp(fewest, most).ceil() as usize
}

/// Surface of revolution about the y axis of a line from a point on the axis down to another: distances from the axis and heights.
fn revolved(profile: &[[f64; 2]], segments: usize) -> ShapeMesh {
    let [[_, top], rings @ .., [_, bottom]] = profile else {
        return ShapeMesh { points: Vec::new(), triangles: Vec::new() };
    };
    let mut points = vec![Vec3::y() * *top, Vec3::y() * *bottom];
    for [from_axis, height] in rings {
        points.extend((0..segments).map(|k| {
            let (sin, cos) = libm::sincos(TAU * k as f64 / segments as f64);
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

    const SHAPES: [(Shape, f64, f64); 2] = [
        (Shape::Cylinder { radius: 0.2, half_length: 0.5 }, PI * 0.04, TAU * 0.04 + TAU * 0.2),
        (Shape::Box { half_extents: [0.1, 0.2, 0.3] }, 0.048, 0.88),
    ];

    #[test]
    fn meshes_are_closed_face_outwards_and_have_the_volume_and_area_of_their_shapes() {
        for (shape, volume, area) in SHAPES {
            for (thickness, tolerance) in [(0.0, 0.002), (1e-3, 0.004), (0.05, 0.03)] {
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
                    assert!((found / exact - 1.0).abs() < tolerance, "{shape:?} {thickness}: {found} for {exact}");
                }
            }
        }
        for round in [Shape::HalfSpace, Shape::Sphere { radius: 0.3 }, Shape::Capsule { radius: 0.1, half_length: 0.2 }]
        {
            assert_eq!(round.mesh(0.1), None);
        }
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
            assert!(deepest.abs() < 1e-12, "{shape:?}: {deepest}");
        }
    }

    #[test]
    fn triangles_of_a_cylinder_without_thickness_have_their_corners_on_it() {
        let cylinder = Shape::Cylinder { radius: 0.2, half_length: 0.5 };
        let ShapeMesh { points, triangles } = cylinder.mesh(0.0).expect("it has a mesh");
        assert_eq!((points.len(), triangles.len()), (2 + 2 * 64, 4 * 64));
        assert!(points.iter().all(|p| cylinder.signed_distance(p).0.abs() < 1e-15));
    }
}

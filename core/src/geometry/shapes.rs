//! Analytic collision bodies in their own frame: exact signed distance, its gradient, and where a path enters.
//!
//! All shapes are convex. The gradient is a unit vector everywhere; where the closest point is not unique (centre,
//! axis, medial planes) one is chosen by a fixed rule, so that equal input gives equal output.

use crate::Vec3;
use crate::settings::{Default, Dimension, Field, Member, Settings, Written, written};

/// Tangent steps after which a path counts as having arrived. They at least halve the gap even at a grazing contact,
/// so that 64 of them use up the digits of a number.
const ENTRY_STEPS: usize = 64;

/// A convex body with an exact signed distance, centred at the origin. Lengths in metres.
///
/// ```
/// use drapery_core::Shape;
/// let table = Shape::Box { half_extents: [0.6, 0.02, 0.4] };
/// let (word, sizes) = table.written();
/// assert_eq!((word.name, sizes.len()), ("box", 1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Everything below the plane y = 0.
    HalfSpace,
    /// A ball.
    Sphere {
        /// Radius \[m\], positive.
        radius: f64,
    },
    /// All points within `radius` of a segment along the y axis.
    Capsule {
        /// Radius \[m\], positive.
        radius: f64,
        /// Half the length of the segment \[m\]; the caps come on top.
        half_length: f64,
    },
    /// A cylinder along the y axis with flat caps.
    Cylinder {
        /// Radius \[m\], positive.
        radius: f64,
        /// Half the length \[m\]: the caps lie at y = ± this.
        half_length: f64,
    },
    /// An axis-aligned box.
    Box {
        /// Half the edge lengths \[m\], positive.
        half_extents: [f64; 3],
    },
}

/// A shape as a scene writes it: a word, and a table of sizes.
#[derive(Debug)]
pub struct ShapeSpec {
    /// The word.
    pub name: &'static str,
    /// One line for help and the reference page.
    pub summary: &'static str,
    /// Its sizes.
    pub fields: &'static [Field],
    /// The shape of these sizes.
    pub of: fn(&Settings) -> Shape,
}

const fn size(name: &'static str, default: Default, help: &'static str) -> Field {
    Field { name, dimension: Dimension::Length, default, range: (1e-9, 1e9), help }
}

const RADIUS: Field = size("radius", Default::Required, "radius");

impl Shape {
    /// All shapes that a scene can write.
    pub const SPECS: &'static [ShapeSpec; 5] = &[
        ShapeSpec {
            name: "half_space",
            summary: "ground: everything below the plane y = 0",
            fields: &[],
            of: |_| Self::HalfSpace,
        },
        ShapeSpec {
            name: "sphere",
            summary: "a ball",
            fields: &[RADIUS],
            of: |settings| Self::Sphere { radius: settings.number("radius") },
        },
        ShapeSpec {
            name: "capsule",
            summary: "a cylinder along y with round ends",
            fields: &[
                RADIUS,
                size("half_length", Default::Required, "half the length of the axis between the round ends"),
            ],
            of: |settings| Self::Capsule {
                radius: settings.number("radius"),
                half_length: settings.number("half_length"),
            },
        },
        ShapeSpec {
            name: "cylinder",
            summary: "a cylinder along y",
            fields: &[RADIUS, size("half_length", Default::Required, "half the height")],
            of: |settings| Self::Cylinder {
                radius: settings.number("radius"),
                half_length: settings.number("half_length"),
            },
        },
        ShapeSpec {
            name: "box",
            summary: "a box",
            fields: &[size("half_extents", Default::RequiredVector, "half the edge lengths along x, y and z")],
            of: |settings| Self::Box { half_extents: settings.vector("half_extents") },
        },
    ];

    /// The shape as a scene would write it.
    pub fn written(&self) -> (&'static ShapeSpec, Written) {
        let [half_space, sphere, capsule, cylinder, cuboid] = Self::SPECS;
        let round =
            |radius: f64, half_length: f64| written([("radius", radius.value()), ("half_length", half_length.value())]);
        match *self {
            Self::HalfSpace => (half_space, Written::new()),
            Self::Sphere { radius } => (sphere, written([("radius", radius.value())])),
            Self::Capsule { radius, half_length } => (capsule, round(radius, half_length)),
            Self::Cylinder { radius, half_length } => (cylinder, round(radius, half_length)),
            Self::Box { half_extents } => (cuboid, written([("half_extents", half_extents.value())])),
        }
    }

    /// Signed distance of `p` \[m\], negative inside, and the outward unit gradient.
    pub(crate) fn signed_distance(&self, p: &Vec3) -> (f64, Vec3) {
        match *self {
            Shape::HalfSpace => (p.y, Vec3::y()),
            Shape::Sphere { radius } => from_centre(p, radius, Vec3::y()),
            Shape::Capsule { radius, half_length } => {
                let on_axis = Vec3::y() * p.y.clamp(-half_length, half_length);
                from_centre(&(p - on_axis), radius, Vec3::x())
            }
            Shape::Cylinder { radius, half_length } => {
                let (from_axis, radial) = direction(&Vec3::new(p.x, 0.0, p.z), Vec3::x());
                let (height, axial) = (p.y.abs() - half_length, Vec3::y() * side_of(p.y));
                from_slabs([from_axis - radius, height, f64::NEG_INFINITY], [radial, axial, Vec3::zeros()])
            }
            Shape::Box { half_extents: h } => {
                let axes = [Vec3::x() * side_of(p.x), Vec3::y() * side_of(p.y), Vec3::z() * side_of(p.z)];
                from_slabs([p.x.abs() - h[0], p.y.abs() - h[1], p.z.abs() - h[2]], axes)
            }
        }
    }

    /// The distance of [`Shape::signed_distance`] up to rounding, without the gradient, which is most of the work.
    #[inline]
    pub fn distance(&self, p: &Vec3) -> f64 {
        match *self {
            Shape::HalfSpace => p.y,
            Shape::Sphere { radius } => p.norm() - radius,
            Shape::Capsule { radius, half_length } => {
                Vec3::new(p.x, (p.y.abs() - half_length).max(0.0), p.z).norm() - radius
            }
            Shape::Cylinder { radius, half_length } => {
                let from_axis = (p.x * p.x + p.z * p.z).sqrt();
                slab_distance([from_axis - radius, p.y.abs() - half_length, f64::NEG_INFINITY])
            }
            Shape::Box { half_extents: h } => slab_distance([p.x.abs() - h[0], p.y.abs() - h[1], p.z.abs() - h[2]]),
        }
    }

    /// First parameter in \[0, 1\] at which the straight path from `p0` to `p1` has a signed distance of at most
    /// `offset` \[m\]; 0 if it starts there, none if it stays further out.
    ///
    /// The distance to a convex body is a convex function along a line, so its tangents lie below it: Newton's method
    /// from the outside never oversteps the first contact, and a tangent that no longer falls proves there is none.
    pub(crate) fn first_entry(&self, p0: &Vec3, p1: &Vec3, offset: f64) -> Option<f64> {
        let path = p1 - p0;
        let mut at = 0.0;
        for _ in 0..ENTRY_STEPS {
            let (distance, gradient) = self.signed_distance(&(p0 + path * at));
            let gap = distance - offset;
            if gap <= 0.0 {
                return Some(at);
            }
            let slope = gradient.dot(&path);
            if slope >= 0.0 {
                return None;
            }
            let next = at - gap / slope;
            if next > 1.0 {
                return None;
            }
            if next <= at {
                return Some(at);
            }
            at = next;
        }
        Some(at)
    }
}

/// +1 for zero and above, else −1.
fn side_of(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}

/// Length and unit direction of `v`, `fallback` for the zero vector.
fn direction(v: &Vec3, fallback: Vec3) -> (f64, Vec3) {
    let length = v.norm();
    if length > 0.0 { (length, v / length) } else { (0.0, fallback) }
}

fn from_centre(v: &Vec3, radius: f64, fallback: Vec3) -> (f64, Vec3) {
    let (length, normal) = direction(v, fallback);
    (length - radius, normal)
}

/// Intersection of slabs with perpendicular outward `normals`, the point being `q` beyond their faces: the largest `q`
/// inside (the first on a tie), the length of the positive part outside.
fn from_slabs(q: [f64; 3], normals: [Vec3; 3]) -> (f64, Vec3) {
    let first_largest = (1..3).fold(0, |best, k| if q[k] > q[best] { k } else { best });
    if q[first_largest] <= 0.0 {
        return (q[first_largest], normals[first_largest]);
    }
    let beyond: Vec3 = (0..3).map(|k| normals[k] * q[k].max(0.0)).sum();
    direction(&beyond, normals[first_largest])
}

/// The distance of [`from_slabs`].
fn slab_distance(q: [f64; 3]) -> f64 {
    let largest = q[0].max(q[1]).max(q[2]);
    if largest <= 0.0 { largest } else { Vec3::from(q.map(|q| q.max(0.0))).norm() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;
    use crate::geometry::testing::SHAPES;

    /// Inside by the shape's definition, without its distance.
    fn contains(shape: &Shape, p: &Vec3) -> bool {
        match *shape {
            Shape::HalfSpace => p.y < 0.0,
            Shape::Sphere { radius } => p.norm() < radius,
            Shape::Capsule { radius, half_length } => {
                let beyond = (p.y.abs() - half_length).max(0.0);
                p.x * p.x + p.z * p.z + beyond * beyond < radius * radius
            }
            Shape::Cylinder { radius, half_length } => libm::hypot(p.x, p.z) < radius && p.y.abs() < half_length,
            Shape::Box { half_extents: h } => (0..3).all(|k| p[k].abs() < h[k]),
        }
    }

    #[test]
    fn every_shape_is_read_as_it_is_written() {
        for shape in SHAPES {
            let (spec, written) = shape.written();
            assert_eq!((spec.of)(&Settings::check(spec.fields, &written).unwrap()), shape);
        }
        let words: std::collections::BTreeSet<&str> = SHAPES.iter().map(|shape| shape.written().0.name).collect();
        assert_eq!(words.len(), Shape::SPECS.len(), "each is tried");
    }

    #[test]
    fn the_sign_agrees_with_the_definition_of_the_body() {
        let mut random = SplitMix64::new(11);
        for shape in SHAPES {
            for _ in 0..2000 {
                let p = random.vector() * 1.5;
                assert_eq!(shape.signed_distance(&p).0 < 0.0, contains(&shape, &p), "{shape:?} {p:?}");
            }
        }
    }

    #[test]
    fn the_distance_alone_is_that_of_the_gradient() {
        let mut random = SplitMix64::new(15);
        for shape in SHAPES {
            for _ in 0..2000 {
                let p = random.vector() * 1.5;
                assert!((shape.distance(&p) - shape.signed_distance(&p).0).abs() < 1e-15, "{shape:?} {p:?}");
            }
        }
    }

    #[test]
    fn walking_the_distance_along_the_gradient_arrives_at_the_surface_and_nothing_is_closer() {
        let mut random = SplitMix64::new(12);
        for shape in SHAPES {
            for _ in 0..2000 {
                let p = random.vector() * 1.5;
                let (d, n) = shape.signed_distance(&p);
                assert!((n.norm() - 1.0).abs() < 1e-14);
                assert!(shape.signed_distance(&(p - n * d)).0.abs() < 1e-14, "{shape:?} {p:?}");
                // No point of the other kind within 99.9 % of the distance.
                let q = p + random.vector().normalize() * (0.999 * d.abs());
                assert_eq!(contains(&shape, &q), d < 0.0, "{shape:?} {p:?}");
            }
        }
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_distance() {
        let mut random = SplitMix64::new(13);
        let h = 1e-6;
        for shape in SHAPES {
            for _ in 0..500 {
                let p = random.vector() * 1.5;
                let (_, n) = shape.signed_distance(&p);
                let (_, nearby) = shape.signed_distance(&(p + random.vector() * (4.0 * h)));
                if (n - nearby).norm() > 1e-3 {
                    continue; // the closest point jumps here
                }
                for k in 0..3 {
                    let step = Vec3::from_fn(|i, _| if i == k { h } else { 0.0 });
                    let slope =
                        (shape.signed_distance(&(p + step)).0 - shape.signed_distance(&(p - step)).0) / (2.0 * h);
                    assert!((slope - n[k]).abs() < 1e-4, "{shape:?} {p:?} {slope} {}", n[k]); // curvature · h
                }
            }
        }
    }

    #[test]
    fn centres_axes_edges_and_corners_have_a_unit_gradient() {
        let points = [
            Vec3::zeros(),
            Vec3::y() * 0.5,
            Vec3::y() * 0.6,
            Vec3::y() * 2.0,
            Vec3::new(0.4, 0.6, 0.0),
            Vec3::new(0.5, 0.3, 0.7),
            Vec3::new(-0.5, 0.0, 0.0),
            Vec3::new(0.0, -0.1, 0.4),
        ];
        for (shape, p) in SHAPES.iter().flat_map(|s| points.iter().map(move |p| (s, p))) {
            let (d, n) = shape.signed_distance(p);
            assert!(d.is_finite() && (n.norm() - 1.0).abs() < 1e-14, "{shape:?} {p:?}");
        }
    }

    #[test]
    fn a_path_enters_where_fine_sampling_first_finds_it_inside() {
        let mut random = SplitMix64::new(14);
        let n = 2000;
        for shape in SHAPES {
            let mut entered = 0;
            for round in 0..400 {
                let (p0, p1) = (random.vector() * 2.0, random.vector() * 2.0);
                let offset = [0.0, 0.05, -0.05][round % 3];
                let gap = |s: f64| shape.signed_distance(&(p0 + (p1 - p0) * s)).0 - offset;
                let sampled = (0..=n).map(|i| f64::from(i) / f64::from(n)).find(|&s| gap(s) <= 0.0);
                match (shape.first_entry(&p0, &p1, offset), sampled) {
                    (Some(s), Some(sample)) => {
                        entered += 1;
                        assert!(s <= sample + 1e-12 && sample - s < 1.0 / f64::from(n) + 1e-12);
                        assert!(gap(s) < 1e-13);
                    }
                    (Some(s), None) => assert!(gap(s) < 1e-13, "{shape:?}"), // a graze between two samples
                    (None, Some(sample)) => panic!("{shape:?}: missed an entry at {sample}"),
                    (None, None) => {}
                }
            }
            assert!(entered > 25, "{shape:?}: {entered}");
        }
    }

    #[test]
    fn a_fast_path_through_a_thin_plate_is_seen() {
        let plate = Shape::Box { half_extents: [1.0, 1e-4, 1.0] };
        let at = plate.first_entry(&Vec3::new(0.1, 1.0, 0.2), &Vec3::new(0.2, -3.0, 0.1), 0.0);
        assert!((at.unwrap() - (1.0 - 1e-4) / 4.0).abs() < 1e-15);
        assert_eq!(plate.first_entry(&Vec3::y(), &Vec3::y(), 0.0), None);
    }
}

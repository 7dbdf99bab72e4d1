//! Closest points: point and segment, point and triangle, two segments. Any input gives an answer, also segments
//! without length and triangles without area.

use crate::Vec3;
use crate::geometry::tolerances::{PARALLEL_SINE_SQUARED, SLIVER_SINE};

/// The part of a triangle on which a point lies. Edge `i` runs from corner `i` to corner `(i + 1) % 3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriangleFeature {
    /// Corner 0, 1 or 2.
    Vertex(u8),
    /// Inside edge 0, 1 or 2.
    Edge(u8),
    /// Inside the triangle.
    Face,
}

/// A point of a triangle, closest to some other point.
#[derive(Clone, Copy, Debug)]
pub struct TrianglePoint {
    /// The point \[m\].
    pub point: Vec3,
    /// Barycentric weights of the three corners, not negative, sum 1.
    pub weights: [f64; 3],
    /// Feature of the triangle on which the point lies.
    pub feature: TriangleFeature,
    /// Squared distance to the other point \[m²\].
    pub distance_squared: f64,
}

/// Closest points of two segments.
#[derive(Clone, Copy, Debug)]
pub struct SegmentPair {
    /// Parameters in \[0, 1\] of the closest points along the first and the second segment.
    pub parameters: [f64; 2],
    /// The closest points \[m\].
    pub points: [Vec3; 2],
    /// Squared distance between them \[m²\].
    pub distance_squared: f64,
}

impl SegmentPair {
    #[inline]
    fn at(a: &[Vec3; 2], b: &[Vec3; 2], parameters: [f64; 2]) -> Self {
        let points = [a[0] + (a[1] - a[0]) * parameters[0], b[0] + (b[1] - b[0]) * parameters[1]];
        Self { parameters, points, distance_squared: (points[0] - points[1]).norm_squared() }
    }
}

/// Parameter in \[0, 1\] of the point of segment `a`–`b` closest to `p`; 0 for a segment without length.
#[inline]
pub(crate) fn closest_on_segment(p: &Vec3, a: &Vec3, b: &Vec3) -> f64 {
    let u = b - a;
    let along = (p - a).dot(&u);
    let length_squared = u.norm_squared();
    if along <= 0.0 {
        0.0
    } else if along >= length_squared {
        1.0
    } else {
        along / length_squared
    }
}

/// Point of the triangle `corners` closest to `p`.
///
/// Inside the triangle's prism the projection onto its plane, outside it the closest point of the edges that face `p`
/// (the first of them on a tie). A triangle thinner than the rounding of its normal is treated as its three edges.
#[inline]
pub fn closest_on_triangle(p: &Vec3, corners: &[Vec3; 3]) -> TrianglePoint {
    let [a, b, c] = corners;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let normal = ab.cross(&ac);
    let area = normal.norm_squared();
    // Barycentric weights times `area`.
    let beta = ap.cross(&ac).dot(&normal);
    let gamma = ab.cross(&ap).dot(&normal);
    let alpha = area - beta - gamma;
    let flat = area > SLIVER_SINE * SLIVER_SINE * ab.norm_squared() * ac.norm_squared();
    if flat && alpha >= 0.0 && beta >= 0.0 && gamma >= 0.0 {
        let (wb, wc) = (beta / area, gamma / area);
        let point = a + ab * wb + ac * wc;
        let weights = [(1.0 - wb - wc).max(0.0), wb, wc];
        return TrianglePoint {
            point,
            weights,
            feature: TriangleFeature::Face,
            distance_squared: (p - point).norm_squared(),
        };
    }
    let faces_p = [!flat || gamma < 0.0, !flat || alpha < 0.0, !flat || beta < 0.0];
    closest_on_edges(p, corners, faces_p)
}

/// Closest point among the edges that are `wanted`.
#[inline]
fn closest_on_edges(p: &Vec3, corners: &[Vec3; 3], wanted: [bool; 3]) -> TrianglePoint {
    let mut best = TrianglePoint {
        point: corners[0],
        weights: [1.0, 0.0, 0.0],
        feature: TriangleFeature::Vertex(0),
        distance_squared: f64::INFINITY,
    };
    for i in 0..3 {
        if !wanted[i] {
            continue;
        }
        let j = (i + 1) % 3;
        let t = closest_on_segment(p, &corners[i], &corners[j]);
        let point = if t == 1.0 { corners[j] } else { corners[i] + (corners[j] - corners[i]) * t };
        let distance_squared = (p - point).norm_squared();
        if distance_squared < best.distance_squared {
            let mut weights = [0.0; 3];
            weights[i] = 1.0 - t;
            weights[j] = t;
            let feature = if t == 0.0 {
                TriangleFeature::Vertex(i as u8)
            } else if t == 1.0 {
                TriangleFeature::Vertex(j as u8)
            } else {
                TriangleFeature::Edge(i as u8)
            };
            best = TrianglePoint { point, weights, feature, distance_squared };
        }
    }
    best
}

/// Closest points of the segments `a` and `b` if both lie between the ends, and the segments are not parallel.
#[inline]
pub(crate) fn closest_within_segments(a: &[Vec3; 2], b: &[Vec3; 2]) -> Option<SegmentPair> {
    let (u, v, w) = (a[1] - a[0], b[1] - b[0], b[0] - a[0]);
    let (uu, vv, uv) = (u.norm_squared(), v.norm_squared(), u.dot(&v));
    let (uw, vw) = (u.dot(&w), v.dot(&w));
    // The squared cross product, not uu·vv − uv², which cancels for nearly parallel segments.
    let d = u.cross(&v).norm_squared();
    let r1 = vv * uw - uv * vw;
    let r2 = uv * uw - uu * vw;
    let is_within = d > PARALLEL_SINE_SQUARED * uu * vv && 0.0 < r1 && r1 < d && 0.0 < r2 && r2 < d;
    is_within.then(|| SegmentPair::at(a, b, [r1 / d, r2 / d]))
}

/// Closest points of the segments `a` and `b` (C. Ericson, "Real-Time Collision Detection", 2005, 5.1.9).
///
/// Parallel and shortened segments take the best of the four end-to-segment distances, in the order first end of `a`,
/// second end of `a`, first end of `b`, second end of `b`; an earlier one wins a tie.
pub fn closest_on_segments(a: &[Vec3; 2], b: &[Vec3; 2]) -> SegmentPair {
    if let Some(within) = closest_within_segments(a, b) {
        return within;
    }
    let pair = |parameters| SegmentPair::at(a, b, parameters);
    let mut best = pair([0.0, closest_on_segment(&a[0], &b[0], &b[1])]);
    for candidate in [
        pair([1.0, closest_on_segment(&a[1], &b[0], &b[1])]),
        pair([closest_on_segment(&b[0], &a[0], &a[1]), 0.0]),
        pair([closest_on_segment(&b[1], &a[0], &a[1]), 1.0]),
    ] {
        if candidate.distance_squared < best.distance_squared {
            best = candidate;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    /// Smallest distance to a dense grid of the triangle's points: never below the true one.
    fn sampled_distance(p: &Vec3, t: &[Vec3; 3], n: u32) -> f64 {
        let mut best = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=n - i {
                let (wb, wc) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                best = best.min((p - (t[0] * (1.0 - wb - wc) + t[1] * wb + t[2] * wc)).norm());
            }
        }
        best
    }

    #[test]
    fn a_triangle_point_is_as_close_as_the_best_sample() {
        let mut random = SplitMix64::new(1);
        let n = 120;
        for round in 0..400 {
            let mut t = [random.vector(), random.vector(), random.vector()];
            if round % 4 == 0 {
                t[2] = t[0] * 0.3 + t[1] * 0.7 + random.vector() * 1e-3; // a thin one
            }
            let p = random.vector() * 2.0;
            let found = closest_on_triangle(&p, &t);
            let point = t[0] * found.weights[0] + t[1] * found.weights[1] + t[2] * found.weights[2];
            assert!((point - found.point).norm() < 1e-12);
            assert!((found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            assert!(found.weights.iter().all(|&w| w >= 0.0));
            let (exact, sampled) = (found.distance_squared.sqrt(), sampled_distance(&p, &t, n));
            // A sample lies within one grid spacing of every point; edges are at most 2√3 long.
            assert!(exact <= sampled + 1e-12 && sampled <= exact + 3.5 / f64::from(n), "{exact} {sampled}");
        }
    }

    #[test]
    fn the_feature_names_the_part_of_the_triangle_that_is_closest() {
        let t = [Vec3::zeros(), Vec3::x(), Vec3::y()];
        let cases = [
            (Vec3::new(0.2, 0.2, 1.0), TriangleFeature::Face, [0.6, 0.2, 0.2]),
            (Vec3::new(0.5, -1.0, 1.0), TriangleFeature::Edge(0), [0.5, 0.5, 0.0]),
            (Vec3::new(1.0, 1.0, 0.0), TriangleFeature::Edge(1), [0.0, 0.5, 0.5]),
            (Vec3::new(-1.0, 0.25, 0.0), TriangleFeature::Edge(2), [0.75, 0.0, 0.25]),
            (Vec3::new(-1.0, -1.0, 3.0), TriangleFeature::Vertex(0), [1.0, 0.0, 0.0]),
            (Vec3::new(3.0, 0.0, 0.0), TriangleFeature::Vertex(1), [0.0, 1.0, 0.0]),
            (Vec3::new(0.0, 2.0, 0.1), TriangleFeature::Vertex(2), [0.0, 0.0, 1.0]),
        ];
        for (p, feature, weights) in cases {
            let found = closest_on_triangle(&p, &t);
            assert_eq!(found.feature, feature, "{p:?}");
            assert!((Vec3::from(found.weights) - Vec3::from(weights)).norm() < 1e-15);
        }
    }

    #[test]
    fn a_triangle_without_area_is_its_edges() {
        let p = Vec3::new(0.25, 1.0, 0.0);
        let on_a_line = [Vec3::zeros(), Vec3::x(), Vec3::x() * 0.5];
        let found = closest_on_triangle(&p, &on_a_line);
        assert!((found.point - Vec3::x() * 0.25).norm() < 1e-15 && found.distance_squared == 1.0);
        let a_point = [Vec3::x(); 3];
        let found = closest_on_triangle(&p, &a_point);
        assert_eq!((found.point, found.weights), (Vec3::x(), [1.0, 0.0, 0.0]));
    }

    #[test]
    fn segments_are_as_close_as_the_best_sample() {
        let mut random = SplitMix64::new(2);
        let n = 200;
        for round in 0..300 {
            let a = [random.vector(), random.vector()];
            let mut b = [random.vector(), random.vector()];
            match round % 5 {
                0 => b[1] = b[0] + (a[1] - a[0]) * 0.7, // parallel
                1 => b[1] = b[0],                       // no length
                2 => b[1] = b[0] + (a[1] - a[0]) + random.vector() * 1e-7,
                _ => {}
            }
            let found = closest_on_segments(&a, &b);
            let mut sampled = f64::INFINITY;
            for i in 0..=n {
                let p = a[0] + (a[1] - a[0]) * (f64::from(i) / f64::from(n));
                let t = closest_on_segment(&p, &b[0], &b[1]);
                sampled = sampled.min((p - b[0] - (b[1] - b[0]) * t).norm());
            }
            let exact = found.distance_squared.sqrt();
            // Nearly parallel segments are judged at their ends: the error is at most the sine times a length.
            assert!(exact <= sampled + 4e-6 && sampled <= exact + 3.5 / f64::from(n), "{round}: {exact} {sampled}");
        }
    }

    #[test]
    fn parallel_overlapping_segments_start_at_the_first_end() {
        let found = closest_on_segments(&[Vec3::zeros(), Vec3::x()], &[Vec3::y() - Vec3::x(), Vec3::y() + Vec3::x()]);
        assert_eq!(found.parameters, [0.0, 0.5]);
        assert_eq!(found.distance_squared, 1.0);
    }
}

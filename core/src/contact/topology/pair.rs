//! A point and a triangle, or two edges: the pairs between which cloth touches, and where they are closest.

use crate::Vec3;
use crate::geometry::distance::{SegmentPair, closest_on_segments, closest_on_triangle, closest_within_segments};
use crate::parallel::message::codec;

/// Primitives that the four nodes of a pair form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum PairKind {
    /// A point and a triangle.
    PointTriangle,
    /// Two edges.
    EdgeEdge,
}

/// Both kinds, points and triangles first, as the paper treats them.
pub(crate) const KINDS: [PairKind; 2] = [PairKind::PointTriangle, PairKind::EdgeEdge];

/// Two primitives by their nodes: a point and the corners of a triangle, or the ends of two edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Pair {
    /// Primitives that the nodes form.
    pub kind: PairKind,
    /// Its nodes, in the solver's numbering.
    pub nodes: [u32; 4],
}

codec!(enum PairKind { 0 => PointTriangle, 1 => EdgeEdge });
codec!(struct Pair { kind, nodes });

/// The closest points of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Closest {
    /// From the closest point of the second primitive (the triangle, the second edge) to that of the first [m].
    pub apart: Vec3,
    /// Signed weights of the nodes in `apart`.
    pub weights: [f64; 4],
    /// Whether both points lie inside their primitives, not on a border.
    pub inside: bool,
}

impl Closest {
    fn of_edges(found: &SegmentPair, inside: bool) -> Self {
        let [s, t] = found.parameters;
        Self { apart: found.points[0] - found.points[1], weights: [1.0 - s, s, t - 1.0, -t], inside }
    }

    /// Returns the closest points of two edges with these ends, if they lie inside both.
    #[inline]
    pub(crate) fn inside_edges(x: &[Vec3; 4]) -> Option<Self> {
        closest_within_segments(&[x[0], x[1]], &[x[2], x[3]]).map(|found| Self::of_edges(&found, true))
    }
}

impl Pair {
    /// The positions of its nodes.
    #[inline]
    pub(crate) fn positions(&self, x: &[Vec3]) -> [Vec3; 4] {
        self.nodes.map(|node| x[node as usize])
    }

    /// Returns the closest points of the pair with its nodes at `x`.
    #[inline]
    pub(crate) fn closest(&self, x: &[Vec3; 4]) -> Closest {
        match self.kind {
            PairKind::PointTriangle => {
                let found = closest_on_triangle(&x[0], &[x[1], x[2], x[3]]);
                let [a, b, c] = found.weights;
                let inside = found.feature == crate::geometry::distance::TriangleFeature::Face;
                Closest { apart: x[0] - found.point, weights: [1.0, -a, -b, -c], inside }
            }
            PairKind::EdgeEdge => {
                let found = closest_on_segments(&[x[0], x[1]], &[x[2], x[3]]);
                let [s, t] = found.parameters;
                Closest::of_edges(&found, s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0)
            }
        }
    }

    /// Whether the direction between their middles alone proves that the two are farther apart than `distance` [m], as it does for
    /// most pairs whose boxes overlap: along no direction are two convex sets farther apart than they are.
    #[inline]
    pub(crate) fn is_beyond(&self, x: &[Vec3; 4], distance: f64) -> bool {
        let corners = match self.kind {
            PairKind::PointTriangle => [x[0] - x[1], x[0] - x[2], x[0] - x[3], x[0] - x[3]],
            PairKind::EdgeEdge => [x[0] - x[2], x[0] - x[3], x[1] - x[2], x[1] - x[3]],
        };
        let along = corners[0] + corners[1] + corners[2] + corners[3];
        let least = corners.iter().map(|corner| corner.dot(&along)).fold(f64::INFINITY, f64::min);
        least > 0.0 && least * least > distance * distance * along.norm_squared()
    }

    /// `combine` of a value over the nodes of the first primitive, and of the second.
    #[inline]
    pub(crate) fn fold(&self, value: &[f64], combine: impl Fn(f64, f64) -> f64) -> [f64; 2] {
        let [a, b, c, d] = self.nodes.map(|node| value[node as usize]);
        match self.kind {
            PairKind::PointTriangle => [a, combine(combine(b, c), d)],
            PairKind::EdgeEdge => [combine(a, b), combine(c, d)],
        }
    }
}

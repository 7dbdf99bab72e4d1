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
        let [a, b, c, d] = self.nodes;
        [x[a as usize], x[b as usize], x[c as usize], x[d as usize]]
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
        let corners = self.corners(x);
        let along = corners[0] + corners[1] + corners[2] + corners[3];
        let least = least_along(&corners, &along);
        is_farther(least, &along, distance)
    }

    /// The same everywhere on straight paths between two positions of the nodes: what is on one side of a plane at both ends is so between.
    #[inline]
    pub(crate) fn is_beyond_on_paths(&self, [start, end]: [&[Vec3; 4]; 2], distance: f64) -> bool {
        let corners = [self.corners(start), self.corners(end)];
        let [[a, b, c, d], [e, f, g, h]] = corners;
        let along = (a + b + c + d) + (e + f + g + h);
        let least = least_along(&corners[0], &along).min(least_along(&corners[1], &along));
        is_farther(least, &along, distance)
    }

    /// Whether a direction proves that the two stay farther apart than `distance` [m] wherever each node is between its two positions, not
    /// only where all have gone the same share of their paths. Tried are the direction between the middles and, of the first positions, the
    /// one between the closest points.
    pub(crate) fn is_beyond_between(&self, paths: [&[Vec3; 4]; 2], distance: f64) -> bool {
        let proves = |along: &Vec3| is_farther(self.least_between(paths, along), along, distance);
        let [start, end] = paths.map(|x| self.corners(x).iter().sum::<Vec3>());
        proves(&(start + end)) || proves(&self.closest(paths[0]).apart)
    }

    /// Least component along a direction of what leads from the second primitive to the first, with each node anywhere between its two
    /// positions.
    #[inline]
    fn least_between(&self, [start, end]: [&[Vec3; 4]; 2], along: &Vec3) -> f64 {
        let heights: [[f64; 2]; 4] = std::array::from_fn(|n| [start[n].dot(along), end[n].dot(along)]);
        let (first, second) = heights.split_at(match self.kind {
            PairKind::PointTriangle => 1,
            PairKind::EdgeEdge => 2,
        });
        let lowest = first.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        lowest - second.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// A bound from below on the distance of the pair with its nodes at `x` [m]: the one along a unit direction from the second primitive
    /// to the first.
    #[inline]
    pub(crate) fn distance_along(&self, x: &[Vec3; 4], direction: &Vec3) -> f64 {
        least_along(&self.corners(x), direction)
    }

    /// A bound from below on the distance everywhere on straight paths between two positions of the nodes [m], of which the first has these
    /// closest points.
    #[inline]
    pub(crate) fn distance_bound_on_paths(&self, closest: &Closest, [start, end]: [&[Vec3; 4]; 2]) -> f64 {
        let distance = closest.apart.norm();
        let axis = closest.apart / distance.max(f64::MIN_POSITIVE);
        let (before, after) = (self.corners(start), self.corners(end));
        let at_end = least_along(&after, &axis);
        let mut moved = 0.0_f64;
        for (before, after) in before.iter().zip(&after) {
            moved = moved.max((after - before).norm_squared());
        }
        distance.min(at_end).max(distance - moved.sqrt())
    }

    /// Differences between the nodes of the first primitive and those of the second.
    #[inline]
    fn corners(&self, x: &[Vec3; 4]) -> [Vec3; 4] {
        match self.kind {
            PairKind::PointTriangle => [x[0] - x[1], x[0] - x[2], x[0] - x[3], x[0] - x[3]],
            PairKind::EdgeEdge => [x[0] - x[2], x[0] - x[3], x[1] - x[2], x[1] - x[3]],
        }
    }

    /// `combine` of a value over the nodes of the first primitive, and of the second.
    #[inline]
    pub(crate) fn fold(&self, value: &[f64], combine: impl Fn(f64, f64) -> f64) -> [f64; 2] {
        let [a, b, c, d] = self.nodes;
        let [a, b, c, d] = [value[a as usize], value[b as usize], value[c as usize], value[d as usize]];
        match self.kind {
            PairKind::PointTriangle => [a, combine(combine(b, c), d)],
            PairKind::EdgeEdge => [combine(a, b), combine(c, d)],
        }
    }
}

/// Whether a component `least` along a direction of any length is more than `distance` [m].
#[inline]
fn is_farther(least: f64, along: &Vec3, distance: f64) -> bool {
    least > 0.0 && least * least > distance * distance * along.norm_squared()
}

/// Least component of four vectors along a direction.
#[inline]
fn least_along([a, b, c, d]: &[Vec3; 4], along: &Vec3) -> f64 {
    a.dot(along).min(b.dot(along)).min(c.dot(along).min(d.dot(along)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    #[test]
    fn the_distance_along_a_direction_is_never_more_than_the_distance() {
        let mut random = SplitMix64::new(91);
        let mut exact = 0;
        for round in 0..2000 {
            let pair = Pair { kind: KINDS[round % 2], nodes: [0, 1, 2, 3] };
            let at = [0.0, 0.4, 0.4, 0.4].map(|apart| random.vector() + Vec3::x() * apart);
            let (distance, direction) = (pair.closest(&at).apart.norm(), random.vector().normalize());
            assert!(pair.distance_along(&at, &direction) <= distance * (1.0 + 1e-12), "{at:?}");
            // It is the distance along the line of the closest points.
            let axis = pair.closest(&at).apart / distance;
            exact += usize::from((pair.distance_along(&at, &axis) - distance).abs() < 1e-9);
        }
        assert_eq!(exact, 2000);
    }

    #[test]
    fn pairs_beyond_a_distance_between_two_positions_are_beyond_it_wherever_their_nodes_stop() {
        let mut random = SplitMix64::new(92);
        let (mut proven, mut together) = (0, 0);
        for round in 0..4000 {
            let pair = Pair { kind: KINDS[round % 2], nodes: [0, 1, 2, 3] };
            let start = [0.0, 1.4, 1.4, 1.4].map(|apart| random.vector() + Vec3::x() * apart);
            let end = start.map(|x| x + random.vector() * 0.5);
            let distance = 0.2;
            if !pair.is_beyond_between([&start, &end], distance) {
                continue;
            }
            proven += 1;
            for _ in 0..20 {
                let mut at = start;
                for (x, end) in at.iter_mut().zip(&end) {
                    *x += (end - *x) * random.unit();
                }
                assert!(pair.closest(&at).apart.norm() > distance, "{start:?} {end:?} {at:?}");
            }
            together += usize::from(pair.is_beyond_on_paths([&start, &end], distance));
        }
        // It asks for more than paths that all nodes follow alike.
        assert!(proven > 200 && together > proven / 2, "{proven} {together}");
    }
}

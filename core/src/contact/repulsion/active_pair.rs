//! Pairs as repulsion sees them: with their sides, and those that are active with what the laws need of them.

use crate::Vec3;
use crate::contact::bodies::constraints::{BodyConstraints, share_borne_by_bodies};
use crate::contact::colouring::order::Order;
use crate::contact::tolerances::DISTANCE_ROUNDING;
use crate::contact::topology::pair::{Pair, PairKind};

/// A pair and its side.
#[derive(Debug, Clone, Copy)]
pub(super) struct OrientedPair {
    pub(super) pair: Pair,
    /// Thickness of the pair [m].
    pub(super) thickness: f32,
    /// Distance at the collision-free state [m]; negative for a point behind its triangle.
    pub(super) start_distance: f64,
    /// Unit direction from the closest point of the second primitive to that of the first at that state.
    pub(super) axis: Vec3,
}

impl OrientedPair {
    /// Thickness of the pair [m].
    #[inline]
    pub(super) fn thickness(&self) -> f64 {
        self.thickness.into()
    }

    /// Square of the largest difference between values of two nodes, one of each side.
    #[inline]
    pub(super) fn largest_difference_squared(&self, of_nodes: &[Vec3]) -> f64 {
        let [a, b, c, d] = self.pair.positions(of_nodes);
        let between = |one: &Vec3, other: &Vec3| (one - other).norm_squared();
        match self.pair.kind {
            PairKind::PointTriangle => between(&a, &b).max(between(&a, &c)).max(between(&a, &d)),
            PairKind::EdgeEdge => between(&a, &c).max(between(&a, &d)).max(between(&b, &c).max(between(&b, &d))),
        }
    }

    /// Bound from below on the distance of the pair [m] after displacements since the collision-free state [m]. The plane across the axis
    /// separated the two primitives, so that they are at least as far apart along it as their nodes are.
    #[inline]
    pub(super) fn distance_bound(&self, displacements: &[Vec3]) -> f64 {
        (1.0 - DISTANCE_ROUNDING) * self.start_distance.abs() - self.largest_approach(displacements)
    }

    /// Largest approach along the axis between values of two nodes, one of each side; negative where all move apart.
    #[inline]
    pub(super) fn largest_approach(&self, of_nodes: &[Vec3]) -> f64 {
        let [a, b, c, d] = self.pair.positions(of_nodes);
        let [a, b, c, d] = [a.dot(&self.axis), b.dot(&self.axis), c.dot(&self.axis), d.dot(&self.axis)];
        match self.pair.kind {
            PairKind::PointTriangle => b.max(c).max(d) - a,
            PairKind::EdgeEdge => c.max(d) - a.min(b),
        }
    }

    /// Whether displacements since the collision-free state [m] prove that the pair is farther apart than `reach` [m]. The distance of
    /// two points, one of each side, changes by at most the largest difference of displacements between the sides.
    #[inline]
    pub(super) fn is_beyond(&self, displacements: &[Vec3], reach: f64) -> bool {
        let room = (1.0 - DISTANCE_ROUNDING) * self.start_distance.abs() - reach;
        room > 0.0 && self.largest_difference_squared(displacements) < room * room
    }
}

/// A pair as the laws see it.
#[derive(Debug, Clone, Copy)]
pub(super) struct ActivePair {
    pub(super) nodes: [u32; 4],
    pub(super) weights: [f64; 4],
    pub(super) normal: Vec3,
    /// Signed distance [m].
    pub(super) distance: f64,
    pub(super) thickness: f64,
    /// Change of relative velocity per impulse [1/kg], as if all nodes were free.
    pub(super) response: f64,
    pub(super) mean_mobility: f64,
    pub(super) friction: f64,
}

impl ActivePair {
    /// Returns the factor on the normal impulse of a free pair that is needed where nodes that move with `v` [m/s]
    /// lie on bodies, which do not give way.
    pub(super) fn stiffer_on_bodies(&self, constraints: &[BodyConstraints], mobility: &[f64], v: &[Vec3; 4]) -> f64 {
        // Of each side: nodes with positive weight are pushed along the normal, the others against it.
        let mut firm = [0.0; 2];
        for ((node, weight), v) in self.nodes.into_iter().zip(self.weights).zip(v) {
            let direction = self.normal * weight.signum();
            let share = share_borne_by_bodies(&constraints[node as usize], v, &direction);
            firm[usize::from(weight < 0.0)] += share * weight * weight * mobility[node as usize];
        }
        // Between bodies that bear both sides, nodes in between would be thrown where their weights are small.
        let [one, other] = firm;
        if one > 0.0 && other > 0.0 { 1.0 } else { self.response / (self.response - one - other) }
    }
}

/// All pairs of one kind.
#[derive(Debug, Default)]
pub(super) struct PairsOfKind {
    pub(super) oriented: Vec<OrientedPair>,
    /// Upper bound on the damping time of each of `oriented` in this step [s]; for the solves of long steps.
    pub(super) damping_times: Vec<f32>,
    pub(super) order: Order,
    /// The active ones of `oriented` in a short step, in the order of their colours.
    pub(super) active: Vec<ActivePair>,
    pub(super) active_order: Order,
}

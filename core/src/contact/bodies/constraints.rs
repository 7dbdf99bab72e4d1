//! Bodies that nodes lie on, as repulsion sees them in B.8: what would move such a node into its body is borne by the body.
//!
//! Along the body's normal the node counts as infinitely heavy, so that all of an impulse goes to its partners. What it would
//! have taken is its *load*: it is handed over to B.7, where the body stops it and rubs with it.

use crate::Vec3;
use crate::contact::tolerances::RESTING;

/// Bodies that can hold a vertex at the same time.
pub(crate) const MAX_BODY_CONTACTS: usize = 2;

/// A body that a node lies on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BodyConstraint {
    /// Unit normal of the body, outwards.
    pub normal: Vec3,
    /// Least velocity along the normal with which the node does not get into the body in the next step [m/s].
    pub least: f64,
}

/// The bodies that one node lies on.
pub(crate) type BodyConstraints = [Option<BodyConstraint>; MAX_BODY_CONTACTS];

impl BodyConstraint {
    /// Whether a node with this velocity goes as far into the body as it can.
    fn rests(&self, v: &Vec3) -> bool {
        v.dot(&self.normal) - self.least <= RESTING * (v.norm() + self.least.abs())
    }
}

/// The velocity that bodies leave a node [m/s]; what they take goes to `load`.
pub(crate) fn project_velocity(constraints: &BodyConstraints, v: &Vec3, load: &mut Vec3) -> Vec3 {
    constraints.iter().flatten().fold(*v, |v, support| {
        let taken = support.normal * (support.least - v.dot(&support.normal)).max(0.0);
        *load += taken;
        v + taken
    })
}

/// Share of a node's mobility that bodies take from a push along `direction`, a unit vector.
pub(crate) fn share_borne_by_bodies(constraints: &BodyConstraints, v: &Vec3, direction: &Vec3) -> f64 {
    let resting = constraints.iter().flatten().filter(|support| support.rests(v));
    let along = resting.map(|support| support.normal.dot(direction).min(0.0).powi(2));
    along.sum::<f64>().min(1.0)
}

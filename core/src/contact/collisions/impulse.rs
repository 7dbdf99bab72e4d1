//! Impulses between the nodes of a pair: what every contact of cloth with cloth comes down to
//! (`docs/theory/self_contact.md#pairs-and-impulses`).
//!
//! A pair touches at one point of each of its two primitives. The relative velocity there is a weighted sum of the
//! velocities of four nodes, with weights that add up to zero: (1, −wa, −wb, −wc) for a point and a face, (1 − α,
//! α, −(1 − β), −β) for two edges. An impulse J gives the node q the velocity w_q M_q J, where M_q is its inverse
//! mass, so the sum of the impulses is zero, and a change Δ of the relative velocity along n takes J = Δ n / S, S =
//! Σ w_q² n·M_q n.
//!
//! Inverse masses are per axis and zero where a node is prescribed: nothing here can move such a node.

use crate::Vec3;
use crate::contact::tolerances::SHORTEST_LEVER_SQUARED;

/// A linear combination of the velocities of four nodes, and the direction in which it matters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Constraint {
    /// Indices into the slices of velocities and mobilities that go with it.
    pub nodes: [u32; 4],
    /// Weight of each node in the relative velocity; their sum is zero, and none is larger than one.
    pub weights: [f64; 4],
    /// Unit vector; the relative velocity along it is positive where the pair separates.
    pub normal: Vec3,
}

/// Relative velocity of the two points in contact [m/s].
pub(crate) fn relative_velocity(constraint: &Constraint, v: &[Vec3]) -> Vec3 {
    let [a, b, c, d] = constraint.nodes.map(|q| v[q as usize]);
    let [wa, wb, wc, wd] = constraint.weights;
    a * wa + b * wb + c * wc + d * wd
}

/// Component of the relative velocity along the normal [m/s].
pub(crate) fn normal_velocity(constraint: &Constraint, v: &[Vec3]) -> f64 {
    relative_velocity(constraint, v).dot(&constraint.normal)
}

/// Change of the relative normal velocity per unit of impulse along the normal [1/kg], from the inverse masses
/// `mobility` [1/kg].
///
/// Zero where no impulse can change it: all nodes prescribed, or the free ones with so short a lever that they
/// would have to be thrown at thousands of times the change asked for. Source: S of
/// `docs/theory/self_contact.md#pairs-and-impulses`.
pub(crate) fn response(constraint: &Constraint, mobility: &[Vec3]) -> f64 {
    let squares = constraint.normal.component_mul(&constraint.normal);
    let (mut sum, mut largest) = (0.0, 0.0_f64);
    for (q, w) in constraint.nodes.into_iter().zip(constraint.weights) {
        let node = &mobility[q as usize];
        sum += w * w * node.dot(&squares);
        largest = largest.max(node.max());
    }
    if sum > SHORTEST_LEVER_SQUARED * largest { sum } else { 0.0 }
}

/// Applies an impulse [N s] to the first point in contact and its opposite to the second.
pub(crate) fn apply_impulse(constraint: &Constraint, mobility: &[Vec3], v: &mut [Vec3], impulse: &Vec3) {
    for (q, w) in constraint.nodes.into_iter().zip(constraint.weights) {
        let q = q as usize;
        v[q] += mobility[q].component_mul(impulse) * w;
    }
}

/// Changes the relative normal velocity by `change` [m/s] with one impulse along the normal. Returns whether it
/// did: not where the `response` is zero.
pub(crate) fn change_normal_velocity(constraint: &Constraint, mobility: &[Vec3], v: &mut [Vec3], change: f64) -> bool {
    let response = response(constraint, mobility);
    if response > 0.0 {
        apply_impulse(constraint, mobility, v, &(constraint.normal * (change / response)));
    }
    response > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    /// A point over a face or two crossing edges at contact, masses of 1 to 3 kg, and random velocities.
    fn pair_in_contact(random: &mut SplitMix64, edges: bool) -> (Constraint, [Vec3; 4], Vec<Vec3>, Vec<Vec3>) {
        let [s, t] = [0.5 + 0.4 * random.signed(), 0.5 + 0.4 * random.signed()];
        let weights = if edges { [1.0 - s, s, t - 1.0, -t] } else { [1.0, -s * t, -s * (1.0 - t), s - 1.0] };
        let mut x: [Vec3; 4] = std::array::from_fn(|_| random.vector());
        // The two points in contact are a millimetre apart along the normal.
        let apart: Vec3 = x.iter().zip(weights).map(|(x, w)| x * w).sum();
        let normal = random.vector().normalize();
        x[0] += (normal * 1e-3 - apart) / weights[0];
        let mobility = (0..4).map(|_| Vec3::repeat(1.0 / (2.0 + random.signed()))).collect();
        let v = (0..4).map(|_| random.vector()).collect();
        (Constraint { nodes: [0, 1, 2, 3], weights, normal }, x, mobility, v)
    }

    #[test]
    fn every_impulse_keeps_momentum_and_gives_the_change_asked_for() {
        let mut random = SplitMix64::new(1);
        for trial in 0..200 {
            let (constraint, x, mobility, mut v) = pair_in_contact(&mut random, trial % 2 == 0);
            let momenta = |v: &[Vec3]| -> [Vec3; 2] {
                let of = |i: usize| v[i] / mobility[i].x;
                [(0..4).map(of).sum(), (0..4).map(|i| x[i].cross(&of(i))).sum()]
            };
            let (before, relative) = (momenta(&v), relative_velocity(&constraint, &v));
            assert!(change_normal_velocity(&constraint, &mobility, &mut v, 0.7));
            for (after, before) in momenta(&v).iter().zip(before) {
                assert!((after - before).norm() < 1e-12 * 10.0, "trial {trial}");
            }
            let changed = relative_velocity(&constraint, &v) - relative;
            // Equal inverse masses along all axes: the tangential velocity stays.
            assert!((changed - constraint.normal * 0.7).norm() < 1e-14, "trial {trial}");
        }
    }

    #[test]
    fn stopping_an_approach_never_adds_energy() {
        let mut random = SplitMix64::new(2);
        for trial in 0..200 {
            let (constraint, _, mobility, mut v) = pair_in_contact(&mut random, trial % 2 == 0);
            let energy = |v: &[Vec3]| -> f64 { (0..4).map(|i| 0.5 * v[i].norm_squared() / mobility[i].x).sum() };
            let (before, approach) = (energy(&v), normal_velocity(&constraint, &v));
            change_normal_velocity(&constraint, &mobility, &mut v, -approach);
            assert!(energy(&v) <= before);
        }
    }

    #[test]
    fn prescribed_nodes_and_directions_are_not_moved() {
        let mut random = SplitMix64::new(3);
        let (constraint, _, mut mobility, mut v) = pair_in_contact(&mut random, false);
        mobility[0] = Vec3::zeros();
        mobility[2].y = 0.0;
        let (before, approach) = (v.clone(), normal_velocity(&constraint, &v));
        assert!(change_normal_velocity(&constraint, &mobility, &mut v, 0.5));
        assert_eq!((v[0], v[2].y), (before[0], before[2].y));
        assert!((normal_velocity(&constraint, &v) - approach - 0.5).abs() < 1e-14);
        mobility.fill(Vec3::zeros());
        assert!(!change_normal_velocity(&constraint, &mobility, &mut v, 0.5));
    }

    #[test]
    fn an_impulse_is_not_tried_on_too_short_a_lever() {
        // A prescribed point over a face whose only free corner has almost no share in the contact.
        let contact = |share: f64| Constraint {
            nodes: [0, 1, 2, 3],
            weights: [1.0, -share, share - 1.0, 0.0],
            normal: Vec3::y(),
        };
        let mobility = [Vec3::zeros(), Vec3::repeat(3.0), Vec3::zeros(), Vec3::zeros()];
        assert_eq!(response(&contact(0.9e-4), &mobility), 0.0);
        assert!((response(&contact(1.1e-4), &mobility) - 3.0 * 1.1e-4 * 1.1e-4).abs() < 1e-20);
    }
}

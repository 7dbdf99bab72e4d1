//! Springs whose elastic force is implicit (method 2.2 iii): to the damping matrix comes the force's own derivative.
//!
//! With e the direction of a spring, l its length and k, c, l0 as ever, dF/dx on (x1, x2) is `-[K, -K; -K, K]` with
//! `K = k e eᵀ + k (1 - l0/l) (I - e eᵀ)`. Where the spring is shorter than at rest its second term is left out, so that the matrix
//! never adds energy.

use super::{Lanes, NEIGHBOURS, PartMotion, PartSprings, ROW, Rows, fetch};
use crate::Vec3;

impl Rows<'_, &[f64]> {
    /// Adds the product of every spring to its ends: along the spring as damping does, and across it.
    fn add_implicit<const N: usize>(&self, across: &[f64], x: &[Lanes], v: &[Lanes], f: &mut [Lanes]) {
        let (x, v) = (&x[..f.len()], &v[..f.len()]);
        let rows = self.vertices.iter().zip(self.others.as_chunks::<N>().0);
        let factors = self.scaled_damping.as_chunks::<N>().0.iter().zip(across.as_chunks::<N>().0);
        for ((i, others), (scaled, across)) in rows.zip(factors) {
            let i = usize::from(*i);
            let (xi, vi) = (x[i], v[i]);
            let mut sum = Lanes::ZERO;
            for n in 0..N {
                let j = usize::from(others[n]);
                let (u, change) = (xi - x[j], vi - v[j]);
                let force = u * (scaled[n] * u.dot(change)) + change * across[n];
                sum += force;
                f[j] += force;
            }
            f[i] -= sum;
        }
    }
}

impl PartSprings {
    /// Adds `over · K` to what damping was at the last update, at the same positions `x` [m]; `over` in s.
    pub(super) fn follow(&mut self, x: &[Vec3], over: f64) {
        let (mut scaled, mut across) = (std::mem::take(&mut self.scaled_damping), std::mem::take(&mut self.across));
        for (i, j, s, _) in self.ends() {
            let squared = (x[i] - x[j]).norm_squared();
            if squared > 0.0 {
                let stiffness = over * self.stiffness[s];
                across[s] = stiffness * (1.0 - self.rest_length[s] / squared.sqrt()).max(0.0);
                scaled[s] += (stiffness - across[s]) / squared;
            } else {
                across[s] = 0.0;
            }
        }
        (self.scaled_damping, self.across) = (scaled, across);
    }

    /// The products with damping and `over · K` together.
    pub(super) fn add_implicit(&self, motion: &PartMotion<'_>, f: &mut [Lanes]) {
        let (x, v) = (motion.own_x, motion.own_v);
        let mut first = 0;
        for (length, rows) in self.row_groups() {
            let across = &self.across[first..first + rows.others.len()];
            first += rows.others.len();
            match length {
                1 => rows.add_implicit::<1>(across, x, v, f),
                2 => rows.add_implicit::<2>(across, x, v, f),
                3 => rows.add_implicit::<3>(across, x, v, f),
                _ => rows.add_implicit::<ROW>(across, x, v, f),
            }
        }
        for (springs, neighbours) in self.border_groups() {
            let (far_x, far_v) = (fetch(neighbours, motion.x), fetch(neighbours, motion.v));
            let factors =
                self.scaled_damping[first..][springs.clone()].iter().zip(&self.across[first..][springs.clone()]);
            for ([i, j], (scaled, across)) in self.border[springs].iter().zip(factors) {
                let (i, j) = (usize::from(*i), usize::from(*j) % NEIGHBOURS);
                let (u, change) = (x[i] - far_x[j], v[i] - far_v[j]);
                f[i] -= u * (scaled * u.dot(change)) + change * *across;
            }
        }
    }
}

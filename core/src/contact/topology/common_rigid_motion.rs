//! The rigid motion that a set of points has in common, taken out before motions are compared with distances: cloth that
//! falls or turns as a whole brings no two of its points closer.

use std::ops::Range;

use nalgebra::{Matrix3, Rotation3};
use rayon::prelude::*;

use crate::Vec3;
use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::ranks::Ranks;
use crate::parallel::reduce::ReductionTree;

/// Every how many points one is looked at. Any motion will do; a better one saves work.
const STRIDE: usize = 4;

/// Sums over a point: its place relative to the centre of the reference, and the products of that with its place in the
/// reference, row by row.
const TERMS: usize = 12;

/// The nodes that stand for all: every fourth of each block of sums and of the bodies' points, on any rank. Sums over
/// them have the same bits on any number of ranks.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    /// Own nodes of each block, counted from the first own.
    blocks: Vec<Range<usize>>,
    shares: ReductionTree,
}

impl Samples {
    /// The samples of this rank's blocks, given by own vertices counted from the first; `starts` are the first blocks of all
    /// ranks, and the number of all at the end.
    pub(crate) fn new(ranks: &Ranks, blocks: Vec<Range<usize>>, starts: Vec<usize>) -> Self {
        Self { blocks, shares: ReductionTree::new(starts, ranks.rank()) }
    }

    /// The sums of the values of `term` over all samples of all ranks, which call it together.
    fn sum<const N: usize>(&self, nodes: &ContactNodes, term: impl Fn(usize) -> [f64; N] + Sync) -> [f64; N] {
        let add = |mut sums: [f64; N], node: usize| {
            sums.iter_mut().zip(term(node)).for_each(|(sum, value)| *sum += value);
            sums
        };
        let first = nodes.own().start;
        let of_block = |block: &Range<usize>| block.clone().step_by(STRIDE).map(|i| first + i).fold([0.0; N], add);
        let of_blocks: Vec<[f64; N]> = self.blocks.par_iter().map(of_block).collect();
        let columns: [Vec<f64>; N] = std::array::from_fn(|n| of_blocks.iter().map(|sums| sums[n]).collect());
        let of_cloth = self.shares.join_all(nodes.ranks(), &columns.each_ref().map(Vec::as_slice));
        (nodes.cloth()..nodes.count()).step_by(STRIDE).fold(of_cloth, add)
    }

    /// Returns the number of samples, and their centre [m].
    pub(crate) fn centre(&self, nodes: &ContactNodes, x: &[Vec3]) -> (f64, Vec3) {
        let [count, x, y, z] = self.sum(nodes, |node| [1.0, x[node].x, x[node].y, x[node].z]);
        let count = count.max(1.0);
        (count, Vec3::new(x, y, z) / count)
    }

    /// The rigid motions that bring `from`, with its centre, closest to `to` in the mean square.
    pub(crate) fn fits(
        &self,
        nodes: &ContactNodes,
        from: &[Vec3],
        centre: (f64, Vec3),
        to: [&[Vec3]; 2],
    ) -> [RigidFit; 2] {
        let terms = |node: usize, to: &[Vec3]| terms(&(from[node] - centre.1), &(to[node] - centre.1));
        // A shortcut for one rank: on several all have to take the same way, and all slices of a rank without cloth are equal.
        if nodes.ranks().is_alone() && std::ptr::eq(to[0], to[1]) {
            return [RigidFit::of(&self.sum(nodes, |node| terms(node, to[0])), centre); 2];
        }
        let both: [f64; 2 * TERMS] = self.sum(nodes, |node| {
            let ends = to.map(|to| terms(node, to));
            std::array::from_fn(|n| ends[n / TERMS][n % TERMS])
        });
        [0, 1].map(|end| RigidFit::of(&std::array::from_fn(|n| both[end * TERMS + n]), centre))
    }
}

/// Returns the terms that a point adds to the sums, from its places `a` and `b` relative to the centre of the
/// reference.
fn terms(a: &Vec3, b: &Vec3) -> [f64; TERMS] {
    [b.x, b.y, b.z, b.x * a.x, b.x * a.y, b.x * a.z, b.y * a.x, b.y * a.y, b.y * a.z, b.z * a.x, b.z * a.y, b.z * a.z]
}

/// A rotation and a translation [m].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RigidFit {
    rotation: Rotation3<f64>,
    /// Centres of the points before and after [m].
    centres: [Vec3; 2],
}

impl RigidFit {
    /// No motion.
    pub(crate) const NONE: Self = Self {
        rotation: Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
        centres: [Vec3::new(0.0, 0.0, 0.0); 2],
    };

    /// The rigid motion with these sums over the points (Kabsch 1976), with the number of these and their centre.
    fn of(sums: &[f64; TERMS], (count, centre): (f64, Vec3)) -> Self {
        // The places in the reference add up to zero, so it does not matter what those to which they move are relative to.
        let covariance = Matrix3::from_row_slice(&sums[3..]);
        let moved = centre + Vec3::new(sums[0], sums[1], sums[2]) / count;
        Self { rotation: nearest_rotation(&covariance), centres: [centre, moved] }
    }

    /// Returns the position of a point after the motion [m].
    #[inline]
    pub(crate) fn apply(&self, point: &Vec3) -> Vec3 {
        self.rotation * (point - self.centres[0]) + self.centres[1]
    }

    /// Returns the centre of the points after the motion [m].
    pub(crate) fn centre(&self) -> Vec3 {
        self.centres[1]
    }

    /// Shortest that a unit length can become on the straight paths from this motion to another: the mean of two rotations
    /// by an angle θ apart shortens by cos θ/2.
    pub(crate) fn min_stretch(&self, other: &Self) -> f64 {
        let cosine = 0.5 * ((self.rotation.matrix().transpose() * other.rotation.matrix()).trace() - 1.0);
        // The cosine of half the angle; rounding may take that of the angle out of bounds.
        (0.5 * (1.0 + cosine.clamp(-1.0, 1.0))).sqrt()
    }
}

/// The rotation closest to a matrix; none where it has no direction.
fn nearest_rotation(matrix: &Matrix3<f64>) -> Rotation3<f64> {
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return Rotation3::identity() };
    let turned = u * v;
    let rotation = if turned.determinant() > 0.0 {
        turned
    } else {
        // A flat set can be fitted by a reflection as well: turn the direction that matters least.
        u * Matrix3::from_diagonal(&Vec3::new(1.0, 1.0, -1.0)) * v
    };
    if rotation.iter().all(|x| x.is_finite()) {
        Rotation3::from_matrix_unchecked(rotation)
    } else {
        Rotation3::identity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    /// The common motion of points of one block on one rank.
    fn fit(from: &[Vec3], to: &[Vec3]) -> RigidFit {
        let ranks = Ranks::default();
        let nodes = ContactNodes::new(&ranks, &[0, from.len() as u32], Vec::new(), 0);
        let samples = Samples::new(&ranks, std::iter::once(0..from.len()).collect(), vec![0, 1]);
        let [fit, _] = samples.fits(&nodes, from, samples.centre(&nodes, from), [to, to]);
        fit
    }

    #[test]
    fn a_turned_and_shifted_cloud_has_no_motion_left() {
        let mut random = SplitMix64::new(81);
        for flat in [false, true] {
            let from: Vec<Vec3> = (0..100)
                .map(|_| random.vector().component_mul(&Vec3::new(1.0, if flat { 0.0 } else { 1.0 }, 1.0)))
                .collect();
            let turn = Rotation3::new(Vec3::new(0.3, -1.2, 0.4));
            let to: Vec<Vec3> = from.iter().map(|p| turn * p + Vec3::new(3.0, 1.0, -2.0)).collect();
            let moved = fit(&from, &to);
            assert!(from.iter().zip(&to).all(|(a, b)| (moved.apply(a) - b).norm() < 1e-14 * 10.0));
            let none = fit(&from, &from);
            assert!((none.min_stretch(&moved) - (0.5 * turn.angle()).cos()).abs() < 1e-12);
        }
    }

    #[test]
    fn one_point_and_points_in_one_place_are_only_shifted() {
        for count in [1, 7] {
            let fit = fit(&vec![Vec3::x(); count], &vec![Vec3::y(); count]);
            assert!((fit.apply(&Vec3::x()) - Vec3::y()).norm() < 1e-15);
            let lengths = fit.apply(&Vec3::z()) - fit.apply(&Vec3::zeros());
            assert!((lengths.norm() - 1.0).abs() < 1e-14);
        }
    }
}

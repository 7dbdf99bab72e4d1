//! What makes the directions of [`crate::solve::preconditioned_cg`] good: an approximation of the inverse of A.

use nalgebra::Matrix3;

use crate::Vec3;
use crate::block_matrix::BlockMatrix;
use crate::parallel::for_each_part::PerVertex;
use crate::parallel::parts::Parts;
use crate::solve::preconditioned_cg::{BlockSystem, Projection};

/// Inverses of the diagonal blocks.
#[derive(Debug)]
pub(super) struct Preconditioner {
    inverses: Vec<Matrix3<f64>>,
    starts: Vec<usize>,
}

impl Preconditioner {
    /// Zero, until it is prepared.
    pub(super) fn new(parts: &Parts, _matrix: &BlockMatrix, _rest: &[Vec3]) -> Self {
        let first = parts.own().start;
        Self {
            inverses: vec![Matrix3::zeros(); parts.own().len()],
            starts: parts.ranges().iter().map(|range| range.start - first).collect(),
        }
    }

    /// Makes it that of this system.
    pub(super) fn prepare(&mut self, system: &BlockSystem<'_, impl Projection>) {
        system.parts.for_each(PerVertex(&mut self.inverses), &|part, inverses| {
            let blocks = system.matrix.parts()[part].diagonal_blocks();
            for (inverse, block) in inverses.0.iter_mut().zip(blocks) {
                // A vertex that nothing holds and that has no mass stays where it is.
                let symmetric = (block + block.transpose()) * 0.5;
                *inverse = symmetric.cholesky().map_or(Matrix3::zeros(), |factor| factor.inverse());
            }
        });
    }

    /// `z = W r` of one part.
    pub(super) fn apply(&self, part: usize, r: &[Vec3], z: &mut [Vec3]) {
        let inverses = &self.inverses[self.starts[part]..];
        z.iter_mut().zip(r).zip(inverses).for_each(|((z, r), inverse)| *z = inverse * r);
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.inverses) + size_of_val(&*self.starts)
    }
}

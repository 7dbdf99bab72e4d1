//! Inverses of the diagonal blocks of A.

use nalgebra::Matrix3;

use crate::block_matrix::block::stored_symmetric;
use crate::parallel::simd4::Simd4;

/// Inverses of symmetric blocks, by d = (xx, yy, zz) and e = (xy, yz, zx) in single precision, and what is read behind the last.
#[derive(Debug, Clone)]
pub(super) struct BlockInverses(Vec<f32>);

impl BlockInverses {
    /// Zeros.
    pub(super) fn new(count: usize) -> Self {
        Self(vec![0.0; 6 * count + 1])
    }

    /// Takes the inverse of a symmetric block; zero of one that is not positive definite: what nothing holds and has no mass
    /// stays where it is.
    pub(super) fn set(&mut self, place: usize, block: &Matrix3<f64>) {
        let symmetric = (block + block.transpose()) * 0.5;
        let inverse = symmetric.cholesky().map_or(Matrix3::zeros(), |factor| factor.inverse());
        self.0[6 * place..6 * place + 6].copy_from_slice(&stored_symmetric(&inverse).map(|value| value as f32));
    }

    /// Blocks in order, to be multiplied by [`BlockInverses::times`].
    #[inline(always)]
    pub(super) fn blocks(&self) -> impl Iterator<Item = &[f32]> {
        self.0.windows(7).step_by(6)
    }

    /// The product with one of the blocks.
    #[inline(always)]
    pub(super) fn times(block: &[f32], r: Simd4) -> Simd4 {
        let four = |at: usize| Simd4::widened(&[block[at], block[at + 1], block[at + 2], block[at + 3]]);
        let (d, e) = (four(0), four(3));
        e.mul_add(r.turned(), d.component_mul(r)) + e.component_mul(r).turned_back()
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.0)
    }
}

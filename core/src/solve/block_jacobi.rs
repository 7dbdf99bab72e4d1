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
        let [xx, yy, zz, xy, yz, zx] = stored_symmetric(block);
        let [of_xx, of_xy, of_zx] = [yy * zz - yz * yz, yz * zx - xy * zz, xy * yz - yy * zx];
        let determinant = xx * of_xx + xy * of_xy + zx * of_zx;
        let is_definite = zz > 0.0 && of_xx > 0.0 && determinant > 0.0;
        let factor = if is_definite { determinant.recip() } else { 0.0 };
        let cofactors = [of_xx, zz * xx - zx * zx, xx * yy - xy * xy, of_xy, xy * zx - xx * yz, of_zx];
        self.0[6 * place..6 * place + 6].copy_from_slice(&cofactors.map(|cofactor| (cofactor * factor) as f32));
    }

    /// Blocks in order, to be multiplied by [`BlockInverses::times`].
    #[inline(always)]
    pub(super) fn blocks(&self) -> impl Iterator<Item = &[f32]> {
        self.0.windows(7).step_by(6)
    }

    /// One of the blocks, with what is read behind it.
    pub(super) fn block(&self, place: usize) -> [f32; 7] {
        std::array::from_fn(|lane| self.0[6 * place + lane])
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;

    #[test]
    fn inverses_of_stiff_blocks_are_inverses_and_those_of_what_nothing_holds_are_zero() {
        let e = Vec3::new(0.48, -0.6, 0.64);
        let stiff = Matrix3::identity() + e * e.transpose() * 1e7;
        let mut inverses = BlockInverses::new(3);
        inverses.set(0, &stiff);
        inverses.set(1, &Matrix3::zeros());
        inverses.set(2, &(e * e.transpose()));
        let expected = stiff.try_inverse().expect("it is definite");
        for (number, block) in inverses.blocks().enumerate() {
            for axis in [Vec3::x(), Vec3::y(), Vec3::z()] {
                let found = Vec3::from(BlockInverses::times(block, Simd4::from(&axis)));
                let expected = if number == 0 { expected * axis } else { Vec3::zeros() };
                // Single precision.
                assert!((found - expected).amax() < 1e-6 || number == 2, "{number}: {found} {expected}");
                assert!(found.amax().is_finite());
            }
        }
    }
}

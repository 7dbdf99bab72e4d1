//! The level that is solved directly.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::level::Level;
use crate::Vec3;
use crate::parallel::simd4::Simd4;

/// The Cholesky factor of a level; none if the level has no factor, or none yet.
#[derive(Debug, Clone, Default)]
pub(super) struct Coarsest {
    factor: Option<Cholesky<f64, Dyn>>,
    values: DVector<f64>,
}

impl Coarsest {
    /// Computes the Cholesky factor of a level.
    pub(super) fn new(level: &Level) -> Self {
        let mut dense: DMatrix<f64> = level.dense();
        // What is held as a whole has rows of zeros.
        for row in 0..dense.nrows() {
            if dense[(row, row)] == 0.0 {
                dense[(row, row)] = 1.0;
            }
        }
        Self { values: DVector::zeros(dense.nrows()), factor: Cholesky::new(dense) }
    }

    /// `x = A⁻¹ b`; by the diagonal blocks alone where there is no factor.
    pub(super) fn solve(&mut self, level: &mut Level) {
        let Some(factor) = &self.factor else {
            level.smooth_from_zero();
            return;
        };
        for (values, b) in self.values.as_mut_slice().as_chunks_mut::<3>().0.iter_mut().zip(&level.b) {
            *values = Vec3::from(*b).into();
        }
        factor.solve_mut(&mut self.values);
        for (x, values) in level.x.iter_mut().zip(self.values.as_slice().as_chunks::<3>().0) {
            *x = Simd4::from(&Vec3::from(*values));
        }
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        (self.values.len() + 1) * self.values.len() * size_of::<f64>()
    }
}

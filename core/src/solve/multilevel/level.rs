//! A coarse level: the rows of all nodes, held by every rank.

use nalgebra::{DMatrix, Matrix3};
use rayon::prelude::*;

use super::runs;
use crate::block_matrix::block::{Coefficients, full_block, stored_block};
use crate::geometry::random::SplitMix64;
use crate::long_steps::{EIGENVALUE_PRODUCTS, SMOOTHING};
use crate::parallel::simd4::Simd4;
use crate::solve::block_jacobi::BlockInverses;

/// A matrix in the form of [`crate::block_matrix`], with all couplings of each row:
/// `(A x)_i = D_i x_i + sum_j B_ij (x_i - x_j)`.
#[derive(Debug)]
pub(super) struct Level {
    /// First coupling of each row, and the number of all at the end.
    starts: Vec<u32>,
    /// The other node of each coupling.
    columns: Vec<u32>,
    /// D, and one that is read behind the last.
    diagonal: Vec<[f32; 9]>,
    /// B, likewise.
    couplings: Vec<[f32; 9]>,
    inverses: BlockInverses,
    /// Weight of the smoother.
    weight: f64,
    /// First node of each aggregate, and the number of all at the end.
    ends: Vec<u32>,
    /// Coupling of the coarser level of each coupling; the number of all for those within an aggregate.
    coarser: Vec<u32>,
    /// Right-hand side.
    pub(super) b: Vec<Simd4>,
    /// Solution.
    pub(super) x: Vec<Simd4>,
    /// Residual.
    r: Vec<Simd4>,
}

/// Rows that a task works on. The tasks do not share a sum, so it changes no bit.
const TASK: usize = 512;

impl Level {
    /// A matrix of zeros, by the number of couplings of each row and their other nodes.
    pub(super) fn new(lengths: &[u32], columns: Vec<u32>) -> Self {
        let mut starts = vec![0];
        lengths.iter().for_each(|length| starts.push(starts[starts.len() - 1] + length));
        let count = lengths.len();
        let zeros = vec![Simd4::ZERO; count];
        Self {
            starts,
            diagonal: vec![[0.0; 9]; count + 1],
            couplings: vec![[0.0; 9]; columns.len() + 1],
            inverses: BlockInverses::new(count),
            weight: 0.0,
            ends: Vec::new(),
            coarser: Vec::new(),
            b: zeros.clone(),
            x: zeros.clone(),
            r: zeros,
            columns,
        }
    }

    /// Number of nodes.
    pub(super) fn count(&self) -> usize {
        self.b.len()
    }

    /// Makes aggregates of about `size` nodes; returns the level of these.
    pub(super) fn coarsen(&mut self, size: usize) -> Self {
        self.ends = runs(self.count(), size);
        let mut aggregates = vec![0_u32; self.count()];
        for (aggregate, ends) in (0..).zip(self.ends.windows(2)) {
            aggregates[ends[0] as usize..ends[1] as usize].fill(aggregate);
        }
        let of_all: Vec<(u32, u32)> =
            self.pairs().map(|(row, column)| (aggregates[row], aggregates[column as usize])).collect();
        let mut pairs: Vec<(u32, u32)> = of_all.iter().copied().filter(|pair| pair.0 != pair.1).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let place =
            |pair: &(u32, u32)| if pair.0 == pair.1 { pairs.len() } else { pairs.partition_point(|p| p < pair) };
        self.coarser = of_all.iter().map(|pair| place(pair) as u32).collect();
        let start = |row: usize| pairs.partition_point(|pair| (pair.0 as usize) < row);
        let lengths: Vec<u32> = (1..self.ends.len()).map(|row| (start(row) - start(row - 1)) as u32).collect();
        Self::new(&lengths, pairs.iter().map(|pair| pair.1).collect())
    }

    /// Row and column of each coupling.
    fn pairs(&self) -> impl Iterator<Item = (usize, u32)> {
        let rows = self.starts.windows(2).enumerate();
        rows.flat_map(|(row, ends)| self.columns[ends[0] as usize..ends[1] as usize].iter().map(move |c| (row, *c)))
    }

    /// Takes over D and B.
    pub(super) fn set(&mut self, diagonal: &[[f32; 9]], couplings: &[[f32; 9]]) {
        self.diagonal[..diagonal.len()].copy_from_slice(diagonal);
        self.couplings[..couplings.len()].copy_from_slice(couplings);
        let mut sums: Vec<Matrix3<f64>> = diagonal.iter().map(full_block).collect();
        self.pairs().zip(couplings).for_each(|((row, _), block)| sums[row] += full_block(block));
        sums.iter().enumerate().for_each(|(row, sum)| self.inverses.set(row, sum));
    }

    /// Computes the coarser level: aggregates move as one.
    pub(super) fn assemble_coarser(&self, coarser: &mut Self) {
        let mut couplings = vec![Matrix3::<f64>::zeros(); coarser.columns.len()];
        for (block, place) in self.couplings.iter().zip(&self.coarser) {
            // Within an aggregate nothing is apart.
            if let Some(sum) = couplings.get_mut(*place as usize) {
                *sum += full_block(block);
            }
        }
        let of_aggregate =
            |ends: &[u32]| self.diagonal[ends[0] as usize..ends[1] as usize].iter().map(full_block).sum();
        let diagonal: Vec<Matrix3<f64>> = self.ends.windows(2).map(of_aggregate).collect();
        let [diagonal, couplings] =
            [diagonal, couplings].map(|blocks| blocks.iter().map(stored_block).collect::<Vec<_>>());
        coarser.set(&diagonal, &couplings);
    }

    /// Takes the weight of the smoother from the largest eigenvalue of diag(A)⁻¹ A, found by its powers.
    pub(super) fn choose_weight(&mut self) {
        let mut random = SplitMix64::new(self.count() as u64);
        self.x.iter_mut().for_each(|x| *x = Simd4::from(&random.vector()));
        self.b.fill(Simd4::ZERO);
        let length = |x: &[Simd4]| x.iter().map(|x| x.dot(*x)).sum::<f64>().sqrt();
        let mut largest = 1.0_f64;
        for _ in 0..EIGENVALUE_PRODUCTS {
            let before = length(&self.x);
            self.compute_residual();
            for ((x, r), block) in self.x.iter_mut().zip(&self.r).zip(self.inverses.blocks()) {
                *x = BlockInverses::times(block, *r) * before.recip();
            }
            // No level has a smaller one; a level without a row has none.
            largest = length(&self.x).max(1.0);
        }
        self.weight = SMOOTHING / largest;
    }

    /// `r = b - A x`.
    pub(super) fn compute_residual(&mut self) {
        let Self { starts, columns, diagonal, couplings, b, x, r, .. } = self;
        let (diagonal, couplings, x) = (diagonal.as_flattened(), couplings.as_flattened(), x.as_slice());
        r.par_chunks_mut(TASK).zip(b.par_chunks(TASK)).enumerate().for_each(|(task, (r, b))| {
            let first = task * TASK;
            let blocks = diagonal[9 * first..].windows(12).step_by(9);
            let rows = starts[first..].windows(2).zip(blocks).zip(&x[first..]);
            for (((ends, block), own), (b, r)) in rows.zip(b.iter().zip(r)) {
                let (start, end) = (ends[0] as usize, ends[1] as usize);
                let mut sum = Coefficients::of(block).times(*own);
                let blocks = couplings[9 * start..9 * end + 9].windows(12).step_by(9);
                for (column, block) in columns[start..end].iter().zip(blocks) {
                    sum += Coefficients::of(block).times(*own - x[*column as usize]);
                }
                *r = *b - sum;
            }
        });
    }

    /// `x = ω diag(A)⁻¹ b`.
    pub(super) fn smooth_from_zero(&mut self) {
        for ((x, b), block) in self.x.iter_mut().zip(&self.b).zip(self.inverses.blocks()) {
            *x = BlockInverses::times(block, *b) * self.weight;
        }
    }

    /// `x += ω diag(A)⁻¹ r`.
    pub(super) fn smooth(&mut self) {
        for ((x, r), block) in self.x.iter_mut().zip(&self.r).zip(self.inverses.blocks()) {
            *x += BlockInverses::times(block, *r) * self.weight;
        }
    }

    /// Sums of the residual over the aggregates.
    pub(super) fn restrict(&self, coarser: &mut [Simd4]) {
        for (sum, ends) in coarser.iter_mut().zip(self.ends.windows(2)) {
            *sum = Simd4::ZERO;
            self.r[ends[0] as usize..ends[1] as usize].iter().for_each(|r| *sum += *r);
        }
    }

    /// Adds corrections of the aggregates, times `factor`.
    pub(super) fn correct(&mut self, coarser: &[Simd4], factor: f64) {
        for (correction, ends) in coarser.iter().zip(self.ends.windows(2)) {
            self.x[ends[0] as usize..ends[1] as usize].iter_mut().for_each(|x| *x += *correction * factor);
        }
    }

    /// The symmetric part of A.
    pub(super) fn dense(&self) -> DMatrix<f64> {
        let mut dense = DMatrix::zeros(3 * self.count(), 3 * self.count());
        let mut add = |row: usize, column: usize, block: Matrix3<f64>| {
            let mut view = dense.view_mut((3 * row, 3 * column), (3, 3));
            view += block;
        };
        let diagonal = self.diagonal[..self.count()].iter().enumerate();
        diagonal.for_each(|(row, block)| add(row, row, full_block(block)));
        for ((row, column), block) in self.pairs().zip(&self.couplings) {
            add(row, row, full_block(block));
            add(row, column as usize, -full_block(block));
        }
        (&dense + dense.transpose()) * 0.5
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        let indices = self.starts.len() + self.columns.len() + self.ends.len() + self.coarser.len();
        indices * size_of::<u32>()
            + (self.diagonal.len() + self.couplings.len()) * size_of::<[f32; 9]>()
            + self.inverses.bytes()
            + 3 * size_of_val(&*self.b)
    }
}

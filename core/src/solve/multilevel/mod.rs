//! Coarse levels of the preconditioner: aggregates of neighbouring vertices that move as one
//! (`docs/theory/linear_solver.md#preconditioner`).
//!
//! Vertices are stored in the order of a bisection of the rest shape, so aggregates are runs of that order, halves of halves of
//! a part: they follow from the scene alone. The first level has a node for each run; its rows are computed by the parts and
//! gathered from all ranks, and everything coarser is computed by every rank alike.

mod coarsest;
mod level;
mod part_aggregates;
#[cfg(test)]
mod tests;

use std::ops::Range;

use crate::block_matrix::BlockMatrix;
use crate::parallel::for_each_part::PerPart;
use crate::parallel::parts::Parts;
use crate::parallel::simd4::Simd4;
use crate::solve::constraints::Constraints;
use coarsest::Coarsest;
use level::Level;
use part_aggregates::PartAggregates;

/// Vertices of an aggregate, by a quarter less or half more. Half of it takes hardly fewer iterations, and half as much time
/// again for each.
const AGGREGATE: usize = 8;

/// Nodes of an aggregate of a coarser level, likewise.
const COARSER_AGGREGATE: usize = 4;

/// Largest number of nodes of a level that is solved directly, which takes as long as a product of 2000 vertices.
const DIRECT: usize = 24;

/// What corrections of coarser levels are multiplied by. Aggregates that move as one are stiffer than the cloth: D. Braess,
/// "Towards algebraic multigrid for elliptic problems of second order", Computing 55, 1995, who takes 1.8. Smaller aggregates
/// need less.
const OVERCORRECTION: f64 = 1.5;

/// All levels but that of the vertices.
#[derive(Debug)]
pub(super) struct Multilevel {
    parts: Vec<PartAggregates>,
    /// Finest first.
    levels: Vec<Level>,
    /// The last level.
    coarsest: Coarsest,
    /// Nodes of each rank on the first level.
    node_counts: Vec<usize>,
    /// Couplings in the rows of each rank on the first level.
    coupling_counts: Vec<usize>,
}

impl Multilevel {
    /// The levels for the pattern of this matrix. All ranks call it together.
    pub(super) fn new(parts: &Parts, matrix: &BlockMatrix) -> Self {
        let ranks = parts.ranks();
        let ends: Vec<Vec<u32>> = parts.ranges().iter().map(|range| runs(range.len(), AGGREGATE)).collect();
        let own: usize = ends.iter().map(|ends| ends.len() - 1).sum();
        let node_counts = ranks.all_gather(&[own as u64], &vec![1; ranks.count()]);
        let node_counts: Vec<usize> = node_counts.into_iter().map(|count| count as usize).collect();
        let first = node_counts[..ranks.rank()].iter().sum();
        let nodes = nodes_of_local_vertices(parts, first, &ends);
        let with_rows = parts.ranges().iter().zip(ends).zip(matrix.parts());
        let aggregates: Vec<PartAggregates> =
            with_rows.map(|((range, ends), rows)| PartAggregates::new(range, ends, &nodes, rows)).collect();
        let lengths: Vec<u32> = aggregates.iter().flat_map(PartAggregates::row_lengths).collect();
        let columns: Vec<u32> = aggregates.iter().flat_map(|part| part.columns().iter().copied()).collect();
        let lengths = ranks.all_gather(&lengths, &node_counts);
        let columns = ranks.all_gather_v(&columns);
        let coupling_counts = columns.iter().map(Vec::len).collect();
        let mut levels = vec![Level::new(&lengths, columns.concat())];
        while levels[levels.len() - 1].count() > DIRECT {
            let last = levels.len() - 1;
            let coarser = levels[last].coarsen(COARSER_AGGREGATE);
            levels.push(coarser);
        }
        Self { parts: aggregates, levels, coarsest: Coarsest::default(), node_counts, coupling_counts }
    }

    /// Makes it that of this matrix and these constraints. All ranks call it together.
    pub(super) fn prepare(&mut self, parts: &Parts, matrix: &BlockMatrix, constraints: &Constraints) {
        let ranks = parts.ranks();
        let projections = constraints.of_local_vertices(parts);
        parts.for_each(PerPart(&mut self.parts), &|part, aggregates| {
            aggregates.0[0].assemble(&matrix.parts()[part], parts.ranges()[part].start, &projections);
        });
        let own: Vec<[f32; 9]> = self.parts.iter().flat_map(PartAggregates::diagonal).collect();
        let diagonal = ranks.all_gather(&own, &self.node_counts);
        let own: Vec<[f32; 9]> = self.parts.iter().flat_map(PartAggregates::couplings).collect();
        let couplings = ranks.all_gather(&own, &self.coupling_counts);
        self.levels[0].set(&diagonal, &couplings);
        for coarser in 1..self.levels.len() {
            let (finer, rest) = self.levels.split_at_mut(coarser);
            finer[coarser - 1].assemble_coarser(&mut rest[0]);
        }
        self.levels.iter_mut().for_each(Level::choose_weight);
        self.coarsest = Coarsest::new(&self.levels[self.levels.len() - 1]);
    }

    /// What the parts restrict their residuals to.
    pub(super) fn parts_mut(&mut self) -> &mut [PartAggregates] {
        &mut self.parts
    }

    /// Solves for what the parts have restricted; returns the product of residual and correction. All ranks call it together.
    pub(super) fn solve(&mut self, parts: &Parts) -> f64 {
        let residuals = self.parts.iter().flat_map(|part| part.residual());
        if parts.ranks().is_alone() {
            self.levels[0].b.iter_mut().zip(residuals).for_each(|(b, residual)| *b = *residual);
        } else {
            let own: Vec<Simd4> = residuals.copied().collect();
            self.levels[0].b.copy_from_slice(&parts.ranks().all_gather(&own, &self.node_counts));
        }
        cycle(&mut self.levels, &mut self.coarsest);
        let Level { b, x, .. } = &self.levels[0];
        b.iter().zip(x).map(|(b, x)| b.dot(*x)).sum()
    }

    /// The correction of each vertex of a part.
    #[inline(always)]
    pub(super) fn corrections(&self, part: usize) -> impl Iterator<Item = Simd4> {
        self.parts[part].corrections(&self.levels[0].x)
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        self.parts.iter().map(PartAggregates::bytes).sum::<usize>()
            + self.levels.iter().map(Level::bytes).sum::<usize>()
            + self.coarsest.bytes()
    }
}

/// About `A⁻¹ b` on the first of these levels: a symmetric V-cycle.
fn cycle(levels: &mut [Level], coarsest: &mut Coarsest) {
    let [level, coarser @ ..] = levels else { return };
    if coarser.is_empty() {
        coarsest.solve(level);
        return;
    }
    level.smooth_from_zero();
    level.compute_residual();
    level.restrict(&mut coarser[0].b);
    cycle(coarser, coarsest);
    level.correct(&coarser[0].x, OVERCORRECTION);
    level.compute_residual();
    level.smooth();
}

/// First of each run, and the number of all at the end, of things that are halved until there are about `size`.
fn runs(count: usize, size: usize) -> Vec<u32> {
    fn halve(things: Range<usize>, size: usize, ends: &mut Vec<u32>) {
        if 2 * things.len() > 3 * size {
            let middle = things.start + things.len() / 2;
            halve(things.start..middle, size, ends);
            halve(middle..things.end, size, ends);
        } else if !things.is_empty() {
            ends.push(things.end as u32);
        }
    }
    let mut ends = vec![0];
    halve(0..count, size, &mut ends);
    ends
}

/// The node of each local vertex, if runs of the own parts have the nodes from `first` on. All ranks call it together.
fn nodes_of_local_vertices(parts: &Parts, first: usize, runs: &[Vec<u32>]) -> Vec<u32> {
    let mut nodes = vec![0_u32; parts.local_count()];
    let mut node = first as u32;
    for (range, ends) in parts.ranges().iter().zip(runs) {
        for run in ends.windows(2) {
            nodes[range.start + run[0] as usize..range.start + run[1] as usize].fill(node);
            node += 1;
        }
    }
    parts.halo().update(parts.ranks(), &mut nodes);
    nodes
}

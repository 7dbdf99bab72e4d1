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

use nalgebra::Matrix3;

use crate::block_matrix::BlockMatrix;
use crate::block_matrix::block::stored_block;
use crate::long_steps::{AGGREGATE, COARSER_AGGREGATE, DIRECT, OVERCORRECTION};
use crate::parallel::for_each_part::PerPart;
use crate::parallel::parts::Parts;
use crate::parallel::simd4::Simd4;
use crate::solve::constraints::Constraints;
use crate::solve::pair_terms::PairTerms;
use coarsest::Coarsest;
use level::Level;
use part_aggregates::PartAggregates;

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
    /// Couplings in the rows of each rank on the first level, by elements.
    coupling_counts: Vec<usize>,
    /// Lengths of the rows of the first level, and their columns, by elements.
    by_elements: [Vec<u32>; 2],
    /// Node of each local vertex.
    nodes: Vec<u32>,
    /// Whether the levels have couplings of pairs in touch.
    with_pairs: bool,
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
        let by_elements = [lengths, columns.concat()];
        Self {
            parts: aggregates,
            levels: levels_of(Level::new(&by_elements[0], by_elements[1].clone())),
            coarsest: Coarsest::default(),
            node_counts,
            coupling_counts,
            by_elements,
            nodes,
            with_pairs: false,
        }
    }

    /// Makes it that of this matrix with these pairs and constraints. All ranks call it together.
    pub(super) fn prepare(
        &mut self,
        parts: &Parts,
        matrix: &BlockMatrix,
        pairs: &PairTerms,
        constraints: &Constraints,
    ) {
        let ranks = parts.ranks();
        let projections = constraints.of_local_vertices(parts);
        let around = pairs.nodes_around(parts, &self.nodes, &projections);
        let mut of_pairs: Vec<Vec<([u32; 2], Matrix3<f64>)>> = vec![Vec::new(); parts.count()];
        parts.for_each((PerPart(&mut self.parts), PerPart(&mut of_pairs)), &|part, (aggregates, of_pairs)| {
            aggregates.0[0].assemble(&matrix.parts()[part], parts.ranges()[part].start, &projections);
            of_pairs.0[0] = aggregates.0[0].add_pairs(pairs, part, &around);
        });
        let own: Vec<[f32; 9]> = self.parts.iter().flat_map(PartAggregates::diagonal).collect();
        let diagonal = ranks.all_gather(&own, &self.node_counts);
        let own: Vec<[f32; 9]> = self.parts.iter().flat_map(PartAggregates::couplings).collect();
        let couplings = ranks.all_gather(&own, &self.coupling_counts);
        let couplings = if pairs.is_empty() {
            if self.with_pairs {
                self.levels = levels_of(Level::new(&self.by_elements[0], self.by_elements[1].clone()));
            }
            couplings
        } else {
            let nodes: Vec<[u32; 2]> = of_pairs.iter().flatten().map(|(nodes, _)| *nodes).collect();
            let blocks: Vec<[f32; 9]> = of_pairs.iter().flatten().map(|(_, block)| stored_block(block)).collect();
            let (nodes, blocks) = (ranks.all_gather_v(&nodes).concat(), ranks.all_gather_v(&blocks).concat());
            let rows = Rows { lengths: &self.by_elements[0], columns: &self.by_elements[1], couplings: &couplings };
            let (lengths, columns, couplings) = rows.with(&nodes, &blocks);
            self.levels = levels_of(Level::new(&lengths, columns));
            couplings
        };
        self.with_pairs = !pairs.is_empty();
        self.levels[0].set(&diagonal, &couplings);
        for coarser in 1..self.levels.len() {
            let (finer, rest) = self.levels.split_at_mut(coarser);
            finer[coarser - 1].assemble_coarser(&mut rest[0]);
        }
        self.levels.iter_mut().for_each(Level::choose_weight);
        self.coarsest = Coarsest::new(&self.levels[self.levels.len() - 1]);
    }

    /// Returns the aggregates that the parts restrict their residuals to.
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
            + (self.by_elements.iter().map(Vec::len).sum::<usize>() + self.nodes.len()) * size_of::<u32>()
    }
}

/// Couplings of the first level, row by row.
struct Rows<'a> {
    lengths: &'a [u32],
    columns: &'a [u32],
    couplings: &'a [[f32; 9]],
}

impl Rows<'_> {
    /// With others behind those of each row, given by row and column, ascending.
    fn with(&self, nodes: &[[u32; 2]], blocks: &[[f32; 9]]) -> (Vec<u32>, Vec<u32>, Vec<[f32; 9]>) {
        let mut lengths = Vec::with_capacity(self.lengths.len());
        let mut columns = Vec::with_capacity(self.columns.len() + nodes.len());
        let mut couplings = Vec::with_capacity(columns.capacity());
        let (mut first, mut others) = (0, nodes.iter().zip(blocks).peekable());
        for (row, length) in self.lengths.iter().enumerate() {
            let own = first..first + *length as usize;
            let before = columns.len();
            columns.extend_from_slice(&self.columns[own.clone()]);
            couplings.extend_from_slice(&self.couplings[own.clone()]);
            while let Some((nodes, block)) = others.next_if(|(nodes, _)| nodes[0] as usize == row) {
                columns.push(nodes[1]);
                couplings.push(*block);
            }
            lengths.push((columns.len() - before) as u32);
            first = own.end;
        }
        (lengths, columns, couplings)
    }
}

/// A level and all coarser ones.
fn levels_of(first: Level) -> Vec<Level> {
    let mut levels = vec![first];
    while levels[levels.len() - 1].count() > DIRECT {
        let last = levels.len() - 1;
        let coarser = levels[last].coarsen(COARSER_AGGREGATE);
        levels.push(coarser);
    }
    levels
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

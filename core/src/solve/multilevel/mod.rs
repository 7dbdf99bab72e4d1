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

use bytemuck::{Pod, Zeroable};
use nalgebra::Matrix3;

use crate::block_matrix::BlockMatrix;
use crate::block_matrix::block::stored_block;
use crate::long_steps::{AGGREGATE, COARSER_AGGREGATE, DIRECT, OVERCORRECTION};
use crate::parallel::for_each_part::PerPart;
use crate::parallel::message::{Codec, Decoder};
use crate::parallel::parts::Parts;
use crate::parallel::ranks::Ranks;
use crate::parallel::simd4::Simd4;
use crate::solve::constraints::Constraints;
use crate::solve::ghost_directions::GhostDirections;
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

    /// Makes it that of this matrix with these pairs and constraints, of which `ghosts` know those of other ranks. All ranks call it
    /// together.
    pub(super) fn prepare(
        &mut self,
        parts: &Parts,
        matrix: &BlockMatrix,
        pairs: &PairTerms,
        constraints: &Constraints,
        ghosts: &GhostDirections,
    ) {
        let ranks = parts.ranks();
        let projections =
            constraints.of_local_vertices(parts, ghosts.local_rows().map(|(ghost, row)| (ghost, row.columns)));
        let around = pairs.nodes_around(parts, &self.nodes, &projections, ghosts.node_rows());
        let mut of_pairs: Vec<Vec<([u32; 2], Matrix3<f64>)>> = vec![Vec::new(); parts.count()];
        parts.for_each((PerPart(&mut self.parts), PerPart(&mut of_pairs)), &|part, (aggregates, of_pairs)| {
            aggregates.0[0].assemble(&matrix.parts()[part], parts.ranges()[part].start, &projections);
            of_pairs.0[0] = aggregates.0[0].add_pairs(pairs, part, &around);
        });
        let (diagonal, couplings, pair_counts) = self.gather_rows(ranks, of_pairs.iter().map(Vec::len).sum());
        let couplings = if pairs.is_empty() {
            if self.with_pairs {
                self.levels = levels_of(Level::new(&self.by_elements[0], self.by_elements[1].clone()));
            }
            couplings
        } else {
            let stored =
                |(nodes, block): &([u32; 2], Matrix3<f64>)| PairCoupling { nodes: *nodes, block: stored_block(block) };
            let own: Vec<PairCoupling> = of_pairs.iter().flatten().map(stored).collect();
            let others = ranks.all_gather(&own, &pair_counts);
            let rows = Rows { lengths: &self.by_elements[0], columns: &self.by_elements[1], couplings: &couplings };
            let (lengths, columns, couplings) = rows.with(&others);
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

    /// The blocks that elements have in the rows of all ranks: those of the diagonal, and those of couplings; and how many couplings of
    /// pairs each rank has, this one `own_pairs`.
    fn gather_rows(&self, ranks: &Ranks, own_pairs: usize) -> (Vec<[f32; 9]>, Vec<[f32; 9]>, Vec<usize>) {
        let (of_nodes, of_couplings) = (
            self.parts.iter().flat_map(PartAggregates::diagonal),
            self.parts.iter().flat_map(PartAggregates::couplings),
        );
        if ranks.is_alone() {
            return (of_nodes.collect(), of_couplings.collect(), vec![own_pairs]);
        }
        let mut own = (own_pairs as u64).to_ne_bytes().to_vec();
        of_nodes.chain(of_couplings).for_each(|block| own.extend_from_slice(bytemuck::bytes_of(&block)));
        let counts = || self.node_counts.iter().copied().zip(self.coupling_counts.iter().copied());
        let length = |(nodes, couplings)| size_of::<u64>() + (nodes + couplings) * size_of::<[f32; 9]>();
        let all = ranks.all_gather(&own, &counts().map(length).collect::<Vec<usize>>());
        let mut message = Decoder::new(ranks.rank(), "rows of the coarse levels", &all);
        let (mut diagonal, mut couplings, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
        for (of_nodes, of_couplings) in counts() {
            pairs.push(usize::take(&mut message));
            diagonal.append(&mut message.values(of_nodes));
            couplings.append(&mut message.values(of_couplings));
        }
        message.end();
        (diagonal, couplings, pairs)
    }

    /// Returns the aggregates that the parts restrict their residuals to.
    pub(super) fn parts_mut(&mut self) -> &mut [PartAggregates] {
        &mut self.parts
    }

    /// Solves for what the parts have restricted; returns the product of residual and correction, added to the sum of `blocks`, and
    /// the largest `value` of all ranks. All ranks call it together.
    pub(super) fn solve(&mut self, parts: &Parts, blocks: &[f64], value: f64) -> (f64, f64) {
        let residuals = self.parts.iter().flat_map(|part| part.residual());
        let (sum, largest) = if parts.ranks().is_alone() {
            self.levels[0].b.iter_mut().zip(residuals).for_each(|(b, residual)| *b = *residual);
            parts.join_with_max(blocks, value)
        } else {
            let own: Vec<Simd4> = residuals.copied().collect();
            let (sum, largest, all) = parts.join_with_rows(blocks, value, (&own, &self.node_counts));
            self.levels[0].b.copy_from_slice(&all);
            (sum, largest)
        };
        cycle(&mut self.levels, &mut self.coarsest);
        let Level { b, x, .. } = &self.levels[0];
        let of_coarse: f64 = b.iter().zip(x).map(|(b, x)| b.dot(*x)).sum();
        (sum + of_coarse, largest)
    }

    /// Node of the first level that a local vertex moves with.
    pub(super) fn node(&self, vertex: usize) -> u32 {
        self.nodes[vertex]
    }

    /// Returns the correction of the vertices of a node.
    pub(super) fn correction(&self, node: u32) -> Simd4 {
        self.levels[0].x[node as usize]
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

/// A coupling of pairs in touch, by row and column.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct PairCoupling {
    nodes: [u32; 2],
    block: [f32; 9],
}

/// Couplings of the first level, row by row.
struct Rows<'a> {
    lengths: &'a [u32],
    columns: &'a [u32],
    couplings: &'a [[f32; 9]],
}

impl Rows<'_> {
    /// With others, ascending, behind those of each row.
    fn with(&self, others: &[PairCoupling]) -> (Vec<u32>, Vec<u32>, Vec<[f32; 9]>) {
        let mut lengths = Vec::with_capacity(self.lengths.len());
        let mut columns = Vec::with_capacity(self.columns.len() + others.len());
        let mut couplings = Vec::with_capacity(columns.capacity());
        let (mut first, mut others) = (0, others.iter().peekable());
        for (row, length) in self.lengths.iter().enumerate() {
            let own = first..first + *length as usize;
            let before = columns.len();
            columns.extend_from_slice(&self.columns[own.clone()]);
            couplings.extend_from_slice(&self.couplings[own.clone()]);
            while let Some(other) = others.next_if(|other| other.nodes[0] as usize == row) {
                columns.push(other.nodes[1]);
                couplings.push(other.block);
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

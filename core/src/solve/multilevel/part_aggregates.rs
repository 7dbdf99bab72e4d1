//! Aggregates of the vertices of a part, and their rows of the first coarse level.

use std::ops::Range;

use nalgebra::Matrix3;

use crate::block_matrix::PartBlocks;
use crate::block_matrix::block::stored_block;
use crate::parallel::simd4::Simd4;
use crate::solve::constraints::LocalProjections;
use crate::solve::pair_terms::{NodesAround, PairTerms};
use crate::tolerances::CONSTRAINED_STIFFNESS;

/// The aggregates of a part.
#[derive(Debug)]
pub(in crate::solve) struct PartAggregates {
    /// First vertex of each aggregate, counted from the part's first, and the number of all at the end.
    ends: Vec<u32>,
    /// Node of the first aggregate.
    first: usize,
    /// Aggregate of each vertex.
    of_vertices: Vec<u16>,
    /// First coupling of each aggregate's row, and the number of all at the end.
    starts: Vec<u32>,
    /// Nodes that the rows are coupled to.
    columns: Vec<u32>,
    /// Couplings that each pair inside the part belongs to, in the row of its first and of its other vertex, counted from the
    /// row's first; without meaning within an aggregate.
    inside: Vec<[u16; 2]>,
    /// Likewise for pairs that reach out.
    outside: Vec<u16>,
    /// D of the rows.
    diagonal: Vec<Matrix3<f64>>,
    /// B of the rows.
    couplings: Vec<Matrix3<f64>>,
    /// Sums of residuals.
    residual: Vec<Simd4>,
}

impl PartAggregates {
    /// Aggregates with these ends of the part with these vertices; `nodes` are those of all local vertices.
    pub(super) fn new(range: &Range<usize>, ends: Vec<u32>, nodes: &[u32], rows: &PartBlocks) -> Self {
        let own = &nodes[range.clone()];
        let first = own.first().map_or(0, |node| *node as usize);
        let of_vertices: Vec<u16> = own.iter().map(|node| (*node as usize - first) as u16).collect();
        let of_outside = |pair: &(u32, u32)| (of_vertices[pair.0 as usize], nodes[pair.1 as usize]);
        let mut pairs: Vec<(u16, u32)> = rows.outside_pairs().iter().map(of_outside).collect();
        for (a, b) in rows.inside_pairs().filter(|(a, b)| of_vertices[*a] != of_vertices[*b]) {
            pairs.extend([(of_vertices[a], own[b]), (of_vertices[b], own[a])]);
        }
        pairs.sort_unstable();
        pairs.dedup();
        let start = |row: usize| pairs.partition_point(|pair| usize::from(pair.0) < row) as u32;
        let starts: Vec<u32> = (0..ends.len()).map(start).collect();
        let columns: Vec<u32> = pairs.iter().map(|pair| pair.1).collect();
        let place = |(row, node): (u16, u32)| {
            let (start, end) = (starts[usize::from(row)] as usize, starts[usize::from(row) + 1] as usize);
            columns[start..end].partition_point(|column| *column < node) as u16
        };
        let of_inside = |(a, b): (usize, usize)| [place((of_vertices[a], own[b])), place((of_vertices[b], own[a]))];
        Self {
            first,
            inside: rows.inside_pairs().map(of_inside).collect(),
            outside: rows.outside_pairs().iter().map(|pair| place(of_outside(pair))).collect(),
            diagonal: vec![Matrix3::zeros(); ends.len() - 1],
            couplings: vec![Matrix3::zeros(); columns.len()],
            residual: vec![Simd4::ZERO; ends.len() - 1],
            of_vertices,
            starts,
            columns,
            ends,
        }
    }

    /// Numbers of couplings of the rows.
    pub(super) fn row_lengths(&self) -> impl Iterator<Item = u32> {
        self.starts.windows(2).map(|ends| ends[1] - ends[0])
    }

    /// Nodes that the rows are coupled to.
    pub(super) fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// D of the rows.
    pub(super) fn diagonal(&self) -> impl Iterator<Item = [f32; 9]> {
        self.diagonal.iter().map(stored_block)
    }

    /// B of the rows.
    pub(super) fn couplings(&self) -> impl Iterator<Item = [f32; 9]> {
        self.couplings.iter().map(stored_block)
    }

    /// Sums of the residual that was restricted last.
    pub(super) fn residual(&self) -> &[Simd4] {
        &self.residual
    }

    /// Computes the rows for `P A P`: those of vertices that move as one where constraints let them. `rows` are those of the part
    /// from the local vertex `start` on, `projections` those of all local vertices.
    pub(super) fn assemble(&mut self, rows: &PartBlocks, start: usize, projections: &LocalProjections) {
        self.diagonal.fill(Matrix3::zeros());
        self.couplings.fill(Matrix3::zeros());
        for (vertex, block) in rows.own_diagonal().enumerate() {
            let within = projections
                .of(start + vertex)
                .map_or(block, |p| p * block * p + (Matrix3::identity() - p) * (CONSTRAINED_STIFFNESS * block.trace()));
            self.diagonal[usize::from(self.of_vertices[vertex])] += within;
        }
        for (((a, b), places), block) in rows.inside_pairs().zip(&self.inside).zip(rows.inside_blocks()) {
            let [i, j] = [a, b].map(|vertex| usize::from(self.of_vertices[vertex]));
            let (across, at_a, at_b) = projected(&block, projections.of(start + a), projections.of(start + b));
            self.diagonal[i] += at_a;
            self.diagonal[j] += at_b;
            if i != j {
                self.couplings[self.starts[i] as usize + usize::from(places[0])] += across;
                self.couplings[self.starts[j] as usize + usize::from(places[1])] += across.transpose();
            }
        }
        for (((a, b), place), block) in rows.outside_pairs().iter().zip(&self.outside).zip(rows.outside_blocks()) {
            let (a, b) = (*a as usize, *b as usize);
            let i = usize::from(self.of_vertices[a]);
            let (across, at_a, _) = projected(&block, projections.of(start + a), projections.of(b));
            self.diagonal[i] += at_a;
            self.couplings[self.starts[i] as usize + usize::from(*place)] += across;
        }
    }

    /// Adds what pairs in touch have in the rows: to the diagonal, and as couplings of nodes that no element joins, which are returned
    /// by row and column.
    pub(super) fn add_pairs(
        &mut self,
        pairs: &PairTerms,
        part: usize,
        around: &NodesAround,
    ) -> Vec<([u32; 2], Matrix3<f64>)> {
        let mut couplings = Vec::new();
        pairs.visit_aggregates(part, around, |row, coupling, block| {
            self.diagonal[row as usize - self.first] += match coupling {
                Some(column) => {
                    couplings.push(([row, column], block));
                    Matrix3::zeros()
                }
                None => block,
            };
        });
        // Stable: the order of the pairs stays.
        couplings.sort_by_key(|(nodes, _)| *nodes);
        couplings.dedup_by(|next, sum| {
            let is_same = next.0 == sum.0;
            if is_same {
                sum.1 += next.1;
            }
            is_same
        });
        couplings.shrink_to_fit();
        couplings
    }

    /// Sums up a residual of the part's vertices.
    pub(in crate::solve) fn restrict(&mut self, r: &[Simd4]) {
        for (sum, ends) in self.residual.iter_mut().zip(self.ends.windows(2)) {
            *sum = Simd4::ZERO;
            r[ends[0] as usize..ends[1] as usize].iter().for_each(|r| *sum += *r);
        }
    }

    /// Returns the correction of each vertex, given the corrections `x` of all nodes.
    #[inline(always)]
    pub(super) fn corrections(&self, x: &[Simd4]) -> impl Iterator<Item = Simd4> {
        let x = &x[self.first..];
        self.of_vertices.iter().map(move |aggregate| x[usize::from(*aggregate)])
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        let words = self.ends.len() + self.starts.len() + self.columns.len() + self.inside.len();
        words * size_of::<u32>()
            + (self.of_vertices.len() + self.outside.len()) * size_of::<u16>()
            + (self.diagonal.len() + self.couplings.len()) * size_of::<Matrix3<f64>>()
            + size_of_val(&*self.residual)
    }
}

/// A coupling B of two vertices with projections P and Q, `(P a - Q b)ᵀ B (P a - Q b)`: the coupling P B Q, and what the two have
/// of it when they move alike, P B (P - Q) and Q Bᵀ (Q - P).
#[inline]
fn projected(
    block: &Matrix3<f64>,
    p: Option<&Matrix3<f64>>,
    q: Option<&Matrix3<f64>>,
) -> (Matrix3<f64>, Matrix3<f64>, Matrix3<f64>) {
    if p.is_none() && q.is_none() {
        return (*block, Matrix3::zeros(), Matrix3::zeros());
    }
    let [p, q] = [p, q].map(|projection| projection.copied().unwrap_or_else(Matrix3::identity));
    let across = p * block * q;
    (across, p * block * p - across, q * block.transpose() * q - across.transpose())
}

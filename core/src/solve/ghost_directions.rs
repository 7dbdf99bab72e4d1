//! Search directions of ghosts, which take no message of their own.
//!
//! The direction `s = P (W r + β s)` of a vertex follows from its residual, from its block of the preconditioner and its
//! constraints, and from the coarse levels, which every rank has. So owners send residuals, which are there before all ranks join
//! their sums, and this message is on its way meanwhile; blocks and constraints go with the first one of a solve. Ghosts of the
//! elements and of the pairs in touch come in the same message.

use std::collections::BTreeMap;
use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::Vec3;
use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::halo::Halo;
use crate::parallel::parts::Parts;
use crate::parallel::ranks::Ranks;
use crate::parallel::simd4::Simd4;
use crate::solve::block_jacobi::BlockInverses;
use crate::solve::constraints::{FREE, projected};

/// Data that the direction of a vertex follows from, beside the coarse levels, at the start of a solve.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GhostRow {
    /// Projections of the unit vectors.
    pub columns: [Vec3; 3],
    /// Lanes of its residual.
    pub r: [f64; 4],
    /// Its block of the preconditioner's finest level, as [`BlockInverses::times`] reads it.
    pub inverse: [f32; 7],
    /// Its node of the first coarse level; [`AT_REST`] if its part is not solved for.
    pub node: u32,
}

/// Marks a vertex that stays as it is in a solve.
pub(super) const AT_REST: u32 = u32::MAX;

/// Ghosts of a solve: of elements, and of pairs in touch.
#[derive(Debug, Default)]
pub(super) struct GhostDirections {
    /// Own vertices are counted from the first own one, and ghosts by themselves, ascending in the scene's numbering.
    halo: Halo,
    /// Places of ghosts in arrays over the local vertices: ghost, place.
    local: Vec<[u32; 2]>,
    /// Places of ghosts in arrays over the nodes of cloth of contact.
    nodes: Vec<[u32; 2]>,
    /// Rows of own vertices for the first message of the solve, ascending.
    own_rows: Vec<(u32, GhostRow)>,
    /// Rows of the ghosts, which came with that message.
    rows: Vec<GhostRow>,
    /// Whether that message is yet to be sent.
    is_first: bool,
    r: Vec<Simd4>,
    s: Vec<Simd4>,
    d: Vec<Simd4>,
}

impl GhostDirections {
    /// Begins a solve with the ghosts of elements and, if there are any, of pairs; `row_of` says of own vertices, by their local
    /// numbers, all but their residuals.
    pub(super) fn begin(&mut self, parts: &Parts, of_pairs: Option<&ContactNodes>, row_of: impl Fn(usize) -> GhostRow) {
        if parts.ranks().is_alone() {
            return;
        }
        let mut numbers: Vec<u32> = parts.ghost_places().map(|ghost| parts.number(ghost)).collect();
        numbers.extend(of_pairs.iter().flat_map(|nodes| nodes.ghosts()));
        numbers.sort_unstable();
        numbers.dedup();
        let count = numbers.len();
        let place_of = |number: u32| numbers.binary_search(&number).map_or(u32::MAX, |place| place as u32);
        self.local = parts.ghost_places().map(|ghost| [place_of(parts.number(ghost)), ghost as u32]).collect();
        self.nodes.clear();
        if let Some(nodes) = of_pairs {
            self.nodes.extend(nodes.ghost_places().map(|ghost| [place_of(nodes.number(ghost as u32)), ghost as u32]));
        }
        self.halo = Halo::of_lists(joined_sends(parts, of_pairs), runs_by_owner(&numbers, parts.rank_starts()));
        let mut sent: Vec<u32> = self.halo.sends().iter().flat_map(|(_, list)| list).copied().collect();
        sent.sort_unstable();
        sent.dedup();
        let first = parts.own().start;
        self.own_rows = sent.into_iter().map(|vertex| (vertex, row_of(first + vertex as usize))).collect();
        self.rows.clear();
        self.rows.resize(count, GhostRow::zeroed());
        self.is_first = true;
        for vectors in [&mut self.r, &mut self.s, &mut self.d] {
            vectors.clear();
            vectors.resize(count, Simd4::ZERO);
        }
    }

    /// Sends what ghosts know at once, without residuals. All ranks call it together.
    pub(super) fn send_rows(&mut self, ranks: &Ranks) {
        self.is_first = false;
        let own_rows = &self.own_rows;
        self.halo.start_rows(ranks, |vertex| row_of(own_rows, vertex)).finish(&mut self.rows);
    }

    /// Brings the residuals `r` of the own vertices to the ghosts, while this rank does something else; returns what that has found.
    pub(super) fn send_residuals<R>(&mut self, ranks: &Ranks, r: &[Simd4], meanwhile: impl FnOnce() -> R) -> R {
        let is_first = std::mem::take(&mut self.is_first);
        let flight = if is_first {
            self.own_rows.iter_mut().for_each(|(vertex, row)| row.r = bytemuck::cast(r[*vertex as usize]));
            let own_rows = &self.own_rows;
            self.halo.start_rows(ranks, |vertex| row_of(own_rows, vertex))
        } else {
            self.halo.start(ranks, r)
        };
        let result = meanwhile();
        if is_first {
            flight.finish(&mut self.rows);
            self.r.iter_mut().zip(&self.rows).for_each(|(r, row)| *r = bytemuck::cast(row.r));
        } else {
            flight.finish(&mut self.r);
        }
        result
    }

    /// `d += α s` and `s = P (W r + β s)`, as the owners do; `correction` is what the coarse levels say of a node.
    pub(super) fn advance(&mut self, alpha: f64, beta: f64, correction: impl Fn(u32) -> Simd4) {
        let vectors = self.d.iter_mut().zip(&mut self.s).zip(&self.r);
        for (((d, s), r), row) in vectors.zip(&self.rows).filter(|(_, row)| row.node != AT_REST) {
            *d += *s * alpha;
            *s = BlockInverses::times(&row.inverse, *r) + correction(row.node) + *s * beta;
            if row.columns != FREE {
                *s = projected(&row.columns, *s);
            }
        }
    }

    /// `d += α s` at the end of a solve.
    pub(super) fn finish(&mut self, alpha: f64) {
        self.d.iter_mut().zip(&self.s).for_each(|(d, s)| *d += *s * alpha);
    }

    /// Rows of the ghosts, by the places of local vertices.
    pub(super) fn local_rows(&self) -> impl Iterator<Item = (usize, &GhostRow)> {
        self.local.iter().map(|[ghost, place]| (*place as usize, &self.rows[*ghost as usize]))
    }

    /// The same by the places of nodes of contact.
    pub(super) fn node_rows(&self) -> impl Iterator<Item = (usize, &GhostRow)> {
        self.nodes.iter().map(|[ghost, place]| (*place as usize, &self.rows[*ghost as usize]))
    }

    /// Directions by the places of local vertices.
    pub(super) fn local_directions(&self) -> impl Iterator<Item = (usize, Simd4)> {
        self.local.iter().map(|[ghost, place]| (*place as usize, self.s[*ghost as usize]))
    }

    /// The same of solutions.
    pub(super) fn local_solutions(&self) -> impl Iterator<Item = (usize, Simd4)> {
        self.local.iter().map(|[ghost, place]| (*place as usize, self.d[*ghost as usize]))
    }

    /// Directions by the places of nodes of contact.
    pub(super) fn node_directions(&self) -> impl Iterator<Item = (usize, Simd4)> {
        self.nodes.iter().map(|[ghost, place]| (*place as usize, self.s[*ghost as usize]))
    }

    /// The same of solutions.
    pub(super) fn node_solutions(&self) -> impl Iterator<Item = (usize, Simd4)> {
        self.nodes.iter().map(|[ghost, place]| (*place as usize, self.d[*ghost as usize]))
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        (self.local.len() + self.nodes.len()) * size_of::<[u32; 2]>()
            + self.rows.capacity() * size_of::<GhostRow>()
            + self.own_rows.capacity() * size_of::<(u32, GhostRow)>()
            + 3 * self.s.len() * size_of::<Simd4>()
    }
}

/// The row of an own vertex that is sent.
fn row_of(own_rows: &[(u32, GhostRow)], vertex: u32) -> GhostRow {
    own_rows[own_rows.partition_point(|(other, _)| *other < vertex)].1
}

/// Own vertices, counted from the first, that elements or pairs of other ranks reach, rank by rank. Their order is the one in which
/// the receivers have them: that of the scene.
fn joined_sends(parts: &Parts, of_pairs: Option<&ContactNodes>) -> Vec<(usize, Vec<u32>)> {
    let mut joined: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    let mut add = |halo: &Halo, first: usize| {
        for (to, list) in halo.sends() {
            joined.entry(*to).or_default().extend(list.iter().map(|vertex| vertex - first as u32));
        }
    };
    add(parts.halo(), parts.own().start);
    of_pairs.iter().for_each(|nodes| add(nodes.halo(), nodes.own().start));
    for list in joined.values_mut() {
        list.sort_unstable();
        list.dedup();
    }
    joined.into_iter().collect()
}

/// The runs of vertices of each rank among these, ascending by their numbers in the scene.
fn runs_by_owner(numbers: &[u32], rank_starts: &[u32]) -> Vec<(usize, Range<usize>)> {
    let place = |end: u32| numbers.partition_point(|number| *number < end);
    let runs = rank_starts.windows(2).map(|ends| place(ends[0])..place(ends[1])).enumerate();
    runs.filter(|(_, run)| !run.is_empty()).collect()
}

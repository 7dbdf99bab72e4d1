//! The split of the vertices into parts, and a rank's share of them.
//!
//! Vertices are stored in the order that recursive bisection of the rest positions gives them (`bisection`); parts are what it
//! has halved until it is small enough. The same bisection goes on inside a part, so that neighbours on the cloth are
//! neighbours in memory. A rank owns a run of parts. Its arrays hold [ghosts below | own vertices | ghosts above]: *local*
//! numbers, which ascend as those of the scene do.

use std::ops::Range;

use bytemuck::Pod;

use crate::parallel::ghosted_index::LocalVertices;
use crate::parallel::halo::Halo;
use crate::parallel::ranks::Ranks;
use crate::parallel::reduce::{ReductionTree, SUM_BLOCK};

/// Largest number of vertices of a part. Small enough for rounds of Newton's method to leave out what is done
/// (`docs/dev/decisions/0029-newton-rounds.md`) and for dozens of ranks to have equal shares, large enough for the springs that
/// cross a border (and are evaluated on both sides) to be one in ten.
pub const PART_SIZE: usize = 512;

/// The parts of all garments, alike on all ranks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Partition {
    /// First vertex of each part in the scene's numbering, and the number of all vertices at the end.
    starts: Vec<usize>,
    /// Vertices of each garment.
    garments: Vec<Range<usize>>,
}

impl Default for Partition {
    fn default() -> Self {
        Self { starts: vec![0], garments: Vec::new() }
    }
}

impl Partition {
    /// The partition with these first vertices of parts, with the number of all at the end, and these vertices of garments.
    #[cfg(test)]
    pub(crate) fn new(starts: Vec<usize>, garments: Vec<Range<usize>>) -> Self {
        Self { starts, garments }
    }

    /// Adds a garment of `vertices` vertices; no part holds vertices of two garments. Returns their numbers in the scene.
    pub(crate) fn add_garment(&mut self, vertices: usize) -> Range<usize> {
        let first = self.vertex_count();
        part_ends(first, vertices, &mut self.starts);
        self.garments.push(first..first + vertices);
        first..first + vertices
    }

    /// Number of vertices of all garments.
    pub fn vertex_count(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    /// First vertex of each part in the scene's numbering, and the number of all vertices at the end.
    pub(crate) fn starts(&self) -> &[usize] {
        &self.starts
    }

    /// Vertices of each garment in the scene's numbering.
    pub fn garments(&self) -> &[Range<usize>] {
        &self.garments
    }

    /// First part of every rank, and the number of all parts at the end, such that the ranks' shares of `costs`, one for each
    /// part, are nearly equal.
    pub(crate) fn balance(&self, costs: &[f64], ranks: usize) -> Vec<usize> {
        let total: f64 = costs.iter().sum();
        let mut starts = vec![0];
        let (mut part, mut before) = (0, 0.0);
        for rank in 1..ranks {
            let wanted = total * rank as f64 / ranks as f64;
            // A part goes to the side on which its middle lies.
            while part < costs.len() && before + 0.5 * costs[part] <= wanted {
                before += costs[part];
                part += 1;
            }
            starts.push(part);
        }
        starts.push(costs.len());
        starts
    }

    /// Number of vertices of each part, which is what it costs before anything is measured.
    pub fn sizes(&self) -> Vec<f64> {
        self.starts.windows(2).map(|w| (w[1] - w[0]) as f64).collect()
    }
}

/// A rank's share of the parts, and the maps between its numbers, those of the scene and those of the garments.
#[derive(Debug, Clone)]
pub struct Parts {
    partition: Partition,
    vertices: LocalVertices,
    /// First part of every rank, and the number of all at the end.
    assignment: Vec<usize>,
    /// Own parts, in local numbers.
    ranges: Vec<Range<usize>>,
    /// First block of sums of each own part, counted from the rank's first, and their number at the end.
    block_starts: Vec<usize>,
    blocks: ReductionTree,
    part_shares: ReductionTree,
    /// Local vertices of each garment, ghosts included.
    garments: Vec<Range<usize>>,
    /// Number in its garment of each local vertex.
    own_numbers: Vec<u32>,
}

impl Parts {
    /// The share of this rank, with these ghosts (by their numbers in the scene, ascending) and the number that each local
    /// vertex has in its garment. All ranks call it together.
    pub(crate) fn new(
        ranks: Ranks,
        partition: Partition,
        assignment: Vec<usize>,
        ghosts: Vec<u32>,
        own_numbers: Vec<u32>,
    ) -> Self {
        let rank = ranks.rank();
        let rank_starts = assignment.iter().map(|part| partition.starts[*part] as u32).collect();
        let vertices = LocalVertices::new(ranks, rank_starts, ghosts);
        let (first, low) = (vertices.owned().start as usize, vertices.own().start);
        let run = assignment[rank]..assignment[rank + 1];
        let local = |vertex: usize| vertex - first + low;
        let ranges = run.clone().map(|p| local(partition.starts[p])..local(partition.starts[p + 1])).collect();
        let mut all_blocks = vec![0];
        for sizes in partition.starts.windows(2) {
            all_blocks.push(all_blocks[all_blocks.len() - 1] + (sizes[1] - sizes[0]).div_ceil(SUM_BLOCK));
        }
        let block_starts = all_blocks[run.start..=run.end].iter().map(|block| block - all_blocks[run.start]).collect();
        let blocks = ReductionTree::new(assignment.iter().map(|part| all_blocks[*part]).collect(), rank);
        let part_shares = ReductionTree::new(assignment.clone(), rank);
        let mut parts = Self {
            partition,
            vertices,
            assignment,
            ranges,
            block_starts,
            blocks,
            part_shares,
            garments: Vec::new(),
            own_numbers,
        };
        parts.garments =
            parts.partition.garments.iter().map(|g| parts.local_index(g.start)..parts.local_index(g.end)).collect();
        parts
    }

    /// Counts the local vertices that come before a number of the scene.
    fn local_index(&self, vertex: usize) -> usize {
        let ghosts = self.vertices.ghosts().partition_point(|ghost| (*ghost as usize) < vertex);
        let owned = self.vertices.owned();
        ghosts + vertex.clamp(owned.start as usize, owned.end as usize) - owned.start as usize
    }

    /// This rank and the others.
    pub fn ranks(&self) -> &Ranks {
        self.vertices.ranks()
    }

    /// The parts of all ranks.
    pub fn partition(&self) -> &Partition {
        &self.partition
    }

    /// First part of every rank, and the number of all at the end.
    pub(crate) fn assignment(&self) -> &[usize] {
        &self.assignment
    }

    /// First vertex of every rank in the scene's numbering, and the number of all at the end.
    pub(crate) fn rank_starts(&self) -> &[u32] {
        self.vertices.rank_starts()
    }

    /// The ghosts' messages.
    pub(crate) fn halo(&self) -> &Halo {
        self.vertices.halo()
    }

    /// Vertices of each own part, in local numbers.
    pub fn ranges(&self) -> &[Range<usize>] {
        &self.ranges
    }

    /// Number of own parts.
    pub fn count(&self) -> usize {
        self.ranges.len()
    }

    /// Number of local vertices, ghosts included: the length of the rank's arrays.
    pub fn local_count(&self) -> usize {
        self.vertices.count()
    }

    /// Own vertices, in local numbers.
    pub fn own(&self) -> Range<usize> {
        self.vertices.own()
    }

    /// Ghosts, in local numbers.
    pub(crate) fn ghost_places(&self) -> impl Iterator<Item = usize> + use<> {
        self.vertices.ghost_places()
    }

    /// First block of sums of each own part, counted from the rank's first, and their number at the end.
    pub(crate) fn block_starts(&self) -> &[usize] {
        &self.block_starts
    }

    /// Number of own blocks of sums.
    pub(crate) fn block_count(&self) -> usize {
        self.block_starts[self.block_starts.len() - 1]
    }

    /// First block of sums of every rank, and the number of all at the end.
    pub(crate) fn rank_block_starts(&self) -> Vec<usize> {
        self.blocks.starts().to_vec()
    }

    /// Joins one value for each block, of all ranks, in an order that depends on the scene alone.
    pub(crate) fn tree_sum(&self, blocks: &[f64]) -> f64 {
        self.blocks.tree_sum(self.ranks(), blocks)
    }

    /// Joins one value for each block, and takes the largest of one more value of each rank, in one exchange.
    pub(crate) fn join_with_max(&self, blocks: &[f64], value: f64) -> (f64, f64) {
        self.blocks.join_with_max(self.ranks(), blocks, value)
    }

    /// The same with rows of every rank, as many as `numbers` says, which come in the order of ranks.
    pub(crate) fn join_with_rows<T: Pod>(
        &self,
        blocks: &[f64],
        value: f64,
        (rows, numbers): (&[T], &[usize]),
    ) -> (f64, f64, Vec<T>) {
        self.blocks.join_with_rows(self.ranks(), blocks, value, (rows, numbers))
    }

    /// Joins one value for each part, of all ranks.
    pub(crate) fn join_parts<const N: usize>(&self, parts: &[&[f64]; N]) -> [f64; N] {
        self.part_shares.join_all(self.ranks(), parts)
    }

    /// Local vertices of a garment, ghosts included.
    pub fn garment(&self, garment: usize) -> Range<usize> {
        self.garments[garment].clone()
    }

    /// Own vertices of a garment, in local numbers.
    pub fn own_of_garment(&self, garment: usize) -> Range<usize> {
        let Range { start, end } = self.garment(garment);
        let own = self.own();
        let start = start.max(own.start);
        start..end.min(own.end).max(start)
    }

    /// Garment of a local vertex.
    pub(crate) fn garment_of(&self, local: usize) -> usize {
        self.garments.partition_point(|range| range.end <= local)
    }

    /// Garment of a local vertex, and its number there.
    pub fn own_vertex(&self, local: usize) -> (usize, u32) {
        (self.garment_of(local), self.own_numbers[local])
    }

    /// Number of each local vertex in its garment.
    pub fn own_numbers(&self) -> &[u32] {
        &self.own_numbers
    }

    /// Number of a local vertex in the scene.
    pub fn number(&self, local: usize) -> u32 {
        self.vertices.number(local)
    }

    /// The local number of a vertex of the scene, if it is own or a ghost.
    pub fn local(&self, number: u32) -> Option<usize> {
        self.vertices.local(number)
    }

    /// The rank that owns a vertex of the scene.
    pub fn owner(&self, number: u32) -> usize {
        self.vertices.owner(number)
    }

    /// Own part that holds an own vertex, counted from the rank's first.
    pub fn part_of(&self, local: usize) -> usize {
        self.ranges.partition_point(|range| range.end <= local)
    }
}

/// Appends the ends of the parts of `vertices` vertices from `first` on: each half is halved again until it is small enough.
fn part_ends(first: usize, vertices: usize, ends: &mut Vec<usize>) {
    if vertices > PART_SIZE {
        let low = vertices / 2;
        part_ends(first, low, ends);
        part_ends(first + low, vertices - low, ends);
    } else if vertices > 0 {
        ends.push(first + vertices);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::local_ranks::LocalRanks;

    #[test]
    fn parts_cover_every_vertex_once_and_no_part_holds_two_garments() {
        let mut partition = Partition::default();
        assert_eq!([4900, 121].map(|count| partition.add_garment(count)), [0..4900, 4900..5021]);
        assert_eq!(partition.vertex_count(), 4900 + 121);
        assert!(partition.starts().windows(2).all(|w| w[0] < w[1] && w[1] - w[0] <= PART_SIZE));
        assert!(partition.starts().contains(&4900));
    }

    #[test]
    fn ranks_share_the_parts_and_ghosts_follow_their_owners() {
        for ranks in [1, 2, 3, 5] {
            let numbers = LocalRanks::run(ranks, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                let mut partition = Partition::default();
                partition.add_garment(4900);
                // Some order of the vertices.
                let order: Vec<u32> = (0..4900).map(|place| 4899 - place).collect();
                let assignment = partition.balance(&partition.sizes(), ranks.count());
                let starts: Vec<usize> = assignment.iter().map(|part| partition.starts()[*part]).collect();
                let own = starts[ranks.rank()]..starts[ranks.rank() + 1];
                // Every hundredth vertex of the others.
                let ghosts: Vec<u32> =
                    (0..4900).step_by(100).filter(|v| !own.contains(v) && !own.is_empty()).map(|v| v as u32).collect();
                let mut local: Vec<u32> = ghosts.iter().copied().chain(own.clone().map(|v| v as u32)).collect();
                local.sort_unstable();
                let numbers = local.iter().map(|v| order[*v as usize]).collect();
                let parts = Parts::new(ranks.clone(), partition, assignment, ghosts, numbers);
                for (i, number) in local.iter().enumerate() {
                    assert_eq!((parts.number(i), parts.local(*number)), (*number, Some(i)));
                    assert_eq!(parts.own_vertex(i), (0, order[*number as usize]));
                }
                assert_eq!(parts.garment(0), 0..local.len());
                let mut values: Vec<u32> = vec![u32::MAX; local.len()];
                parts.own().for_each(|i| values[i] = local[i]);
                parts.halo().update(&ranks, &mut values);
                assert_eq!(values, local);
                // Of those, a third changes.
                let changed = |v: u32| v.is_multiple_of(300).then_some(2 * v);
                let copies = (0..local.len()).filter(|i| !parts.own().contains(i));
                let expected: Vec<_> = copies.filter_map(|i| Some((i, changed(local[i])?))).collect();
                let mut came = Vec::new();
                let own = |i: u32| changed(local[i as usize]);
                parts.halo().update_changed(&ranks, own, |place, value| came.push((place, value)));
                assert_eq!(came, expected);
                parts.own().len()
            });
            assert_eq!(numbers.expect("no rank ends early").iter().sum::<usize>(), 4900);
        }
    }
}

//! Sums whose bits do not depend on who computes them: blocks of fixed size inside a part are added in order, block sums
//! are joined by a fixed tree over block numbers. Every rank joins the subtrees that are its own; what is left is
//! exchanged.

use std::ops::Range;

use bytemuck::Pod;

use crate::Vec3;
use crate::parallel::message::{Codec, Decoder};
use crate::parallel::ranks::Ranks;

/// Number of vertices of a block. A constant, never taken from the machine: it fixes the order of every sum.
pub(crate) const SUM_BLOCK: usize = 512;

/// Joins block sums by halves: the tree depends on their number alone.
pub(crate) fn tree_sum(blocks: &[f64]) -> f64 {
    match blocks {
        [] => 0.0,
        [one] => *one,
        _ => {
            let (low, high) = blocks.split_at(blocks.len() / 2);
            tree_sum(low) + tree_sum(high)
        }
    }
}

/// Assignment of the blocks of a sum to ranks.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct ReductionTree {
    /// First block of every rank, and the number of all at the end.
    starts: Vec<usize>,
    /// Largest subtrees of this rank, in order.
    own: Vec<Range<usize>>,
    /// Number of such subtrees of every rank.
    counts: Vec<usize>,
}

impl ReductionTree {
    /// The shares of ranks that own runs of blocks, of which `starts` are the first ones, and the number of all.
    pub(crate) fn new(starts: Vec<usize>, rank: usize) -> Self {
        let all = starts.last().copied().unwrap_or(0);
        let subtrees = |rank: usize| {
            let mut found = Vec::new();
            largest_subtrees(0..all, &(starts[rank]..starts[rank + 1]), &mut found);
            found
        };
        let counts = (0..starts.len() - 1).map(|rank| subtrees(rank).len()).collect();
        let own = subtrees(rank);
        Self { starts, own, counts }
    }

    /// First block of every rank, and the number of all at the end.
    pub(crate) fn starts(&self) -> &[usize] {
        &self.starts
    }

    /// The sum of the blocks of all ranks, of which `blocks` are this rank's; the same as [`tree_sum`] of all together.
    pub(crate) fn tree_sum(&self, ranks: &Ranks, blocks: &[f64]) -> f64 {
        let [sum] = self.join_all(ranks, &[blocks]);
        sum
    }

    /// Several sums at once.
    pub(crate) fn join_all<const N: usize>(&self, ranks: &Ranks, blocks: &[&[f64]; N]) -> [f64; N] {
        if ranks.is_alone() {
            return blocks.map(tree_sum);
        }
        let first = self.starts[ranks.rank()];
        let local = |tree: &Range<usize>| tree.start - first..tree.end - first;
        let own: Vec<[f64; N]> =
            self.own.iter().map(|tree| blocks.map(|blocks| tree_sum(&blocks[local(tree)]))).collect();
        let counts: Vec<usize> = self.counts.iter().map(|count| count * N).collect();
        let all = ranks.all_gather(own.as_flattened(), &counts);
        let mut next = all.as_chunks::<N>().0.iter();
        self.assemble(0..*self.starts.last().unwrap_or(&0), &mut next)
    }

    /// A sum, and the largest of one more value of every rank, in one exchange.
    pub(crate) fn join_with_max(&self, ranks: &Ranks, blocks: &[f64], value: f64) -> (f64, f64) {
        if ranks.is_alone() {
            return (tree_sum(blocks), value);
        }
        let (sum, largest, _) = self.join_with_rows::<f64>(ranks, blocks, value, (&[], &vec![0; ranks.count()]));
        (sum, largest)
    }

    /// The same, and the rows of every rank in the order of ranks; their numbers say how many each gives.
    pub(crate) fn join_with_rows<T: Pod>(
        &self,
        ranks: &Ranks,
        blocks: &[f64],
        value: f64,
        (rows, numbers): (&[T], &[usize]),
    ) -> (f64, f64, Vec<T>) {
        if ranks.is_alone() {
            return (tree_sum(blocks), value, rows.to_vec());
        }
        let first = self.starts[ranks.rank()];
        let own = self.own.iter().map(|tree| tree_sum(&blocks[tree.start - first..tree.end - first]));
        let mut own: Vec<u8> = own.chain([value]).flat_map(f64::to_ne_bytes).collect();
        own.extend_from_slice(bytemuck::cast_slice(rows));
        let lengths = self.counts.iter().zip(numbers);
        let lengths = lengths.map(|(sums, rows)| (sums + 1) * size_of::<f64>() + rows * size_of::<T>());
        let all = ranks.all_gather(&own, &lengths.collect::<Vec<usize>>());
        let mut message = Decoder::new(ranks.rank(), "sums and rows of all ranks", &all);
        let (mut trees, mut largest) = (Vec::with_capacity(self.counts.iter().sum()), 0.0_f64);
        let mut all_rows = Vec::with_capacity(numbers.iter().sum());
        for (sums, rows) in self.counts.iter().zip(numbers) {
            trees.extend(message.values::<f64>(*sums).into_iter().map(|sum| [sum]));
            largest = largest.max(f64::take(&mut message));
            all_rows.append(&mut message.values(*rows));
        }
        message.end();
        let [sum] = self.assemble(0..*self.starts.last().unwrap_or(&0), &mut trees.iter());
        (sum, largest, all_rows)
    }

    /// Joins subtrees, each the next of `values`, as [`tree_sum`] does.
    fn assemble<'a, const N: usize>(
        &self,
        tree: Range<usize>,
        values: &mut impl Iterator<Item = &'a [f64; N]>,
    ) -> [f64; N] {
        if tree.is_empty() {
            return [0.0; N];
        }
        let rank = self.starts.partition_point(|start| *start <= tree.start) - 1;
        if tree.end <= self.starts[rank + 1] {
            return *values.next().expect("every rank gives the sums of its subtrees");
        }
        let middle = tree.start + tree.len() / 2;
        let (low, high) = (self.assemble(tree.start..middle, values), self.assemble(middle..tree.end, values));
        std::array::from_fn(|n| low[n] + high[n])
    }
}

/// The largest subtrees below `tree` that lie in `run`, in order.
fn largest_subtrees(tree: Range<usize>, run: &Range<usize>, found: &mut Vec<Range<usize>>) {
    let (start, end) = (tree.start.max(run.start), tree.end.min(run.end));
    if start >= end {
        return;
    }
    if run.start <= tree.start && tree.end <= run.end {
        found.push(tree);
        return;
    }
    let middle = tree.start + tree.len() / 2;
    largest_subtrees(tree.start..middle, run, found);
    largest_subtrees(middle..tree.end, run, found);
}

/// Largest of the block values; zero if there are none.
pub(crate) fn largest(blocks: &[f64]) -> f64 {
    blocks.iter().copied().fold(0.0, f64::max)
}

/// Sum of `m a·b` over a block, one running sum per axis.
pub(crate) fn weighted_dot(m: &[f64], a: &[Vec3], b: &[Vec3]) -> f64 {
    let mut sum = Vec3::zeros();
    for ((m, a), b) in m.iter().zip(a).zip(b) {
        sum += a.component_mul(b) * *m;
    }
    sum.x + sum.y + sum.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::local_ranks::LocalRanks;

    #[test]
    fn any_split_among_ranks_gives_the_bits_of_the_whole_sum() {
        for count in [0, 1, 2, 5, 37] {
            let blocks: Vec<f64> = (0..count).map(|i| 1.0 / (1.0 + i as f64) - 0.37).collect();
            for starts in [vec![0, count], vec![0, count / 3, count], vec![0, 0, count / 2, count / 2, count, count]] {
                let sums = LocalRanks::run(starts.len() - 1, 1, |communicator| {
                    let ranks = Ranks::new(communicator);
                    let own = &blocks[starts[ranks.rank()]..starts[ranks.rank() + 1]];
                    ReductionTree::new(starts.clone(), ranks.rank()).tree_sum(&ranks, own)
                });
                assert!(
                    sums.expect("no rank ends early").iter().all(|sum| sum.to_bits() == tree_sum(&blocks).to_bits())
                );
            }
        }
    }

    #[test]
    fn rows_of_all_ranks_come_in_their_order_beside_a_sum_and_the_largest_value() {
        let (blocks, starts, numbers) = ([0.1, 0.7, -0.3, 1e-9, 12.0], vec![0, 2, 2, 5], [1, 0, 2]);
        let found = LocalRanks::run(3, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let rank = ranks.rank();
            let rows: Vec<[u32; 3]> = (0..numbers[rank]).map(|row| [rank as u32, row as u32, 7]).collect();
            let (own, value) = (&blocks[starts[rank]..starts[rank + 1]], [3.0, 5.0, 4.0][rank]);
            let before = ranks.sent().collectives;
            let joined = ReductionTree::new(starts.clone(), rank).join_with_rows(&ranks, own, value, (&rows, &numbers));
            assert_eq!(ranks.sent().collectives - before, 1);
            joined
        });
        let expected = (tree_sum(&blocks), 5.0, vec![[0, 0, 7], [2, 0, 7], [2, 1, 7]]);
        assert_eq!(found, Ok(vec![expected; 3]));
    }
}

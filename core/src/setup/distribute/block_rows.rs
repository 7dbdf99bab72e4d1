//! Rows that rank 0 reads piece by piece, spread evenly over the ranks, so that no rank holds all of them; and questions to
//! the rank that has a row.

use std::ops::Range;

use bytemuck::Pod;

use crate::parallel::communicator::{Expected, Message};
use crate::parallel::message;
use crate::parallel::ranks::Ranks;

/// Rows of a message: few enough for rank 0 to hold, enough for messages to be few.
pub(crate) const PIECE: usize = 8192;

/// Even shares of a number of rows, one for each rank.
#[derive(Debug, Clone)]
pub(crate) struct BlockDistribution {
    /// First row of every rank, and the number of all at the end.
    starts: Vec<usize>,
}

impl BlockDistribution {
    /// The shares of `rows` rows.
    pub(crate) fn new(rows: usize, ranks: usize) -> Self {
        Self { starts: (0..=ranks).map(|rank| rows * rank / ranks).collect() }
    }

    /// Rows of a rank.
    pub(crate) fn rows(&self, rank: usize) -> Range<usize> {
        self.starts[rank]..self.starts[rank + 1]
    }

    /// The rank that has a row.
    pub(crate) fn of(&self, row: usize) -> usize {
        self.starts.partition_point(|start| *start <= row) - 1
    }

    /// Number of all rows.
    pub(crate) fn count(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }
}

/// Rank 0's side of [`scatter_rows`].
struct Reading<'a, T, const N: usize> {
    ranks: &'a Ranks,
    blocks: &'a BlockDistribution,
    /// Rows that were given.
    given: usize,
    own: [Vec<T>; N],
    /// Values of the next messages, one message for each column, and their number of rows.
    waiting: [Vec<T>; N],
    rows: usize,
}

impl<T: Pod, const N: usize> Reading<'_, T, N> {
    fn push(&mut self, row: [&[T]; N]) {
        if self.given == self.blocks.count() {
            return;
        }
        let to = self.blocks.of(self.given);
        self.given += 1;
        if to == 0 {
            self.own.iter_mut().zip(row).for_each(|(column, values)| column.extend_from_slice(values));
            return;
        }
        self.waiting.iter_mut().zip(row).for_each(|(column, values)| column.extend_from_slice(values));
        self.rows += 1;
        if self.rows == PIECE || self.given == self.blocks.rows(to).end {
            for column in &mut self.waiting {
                self.ranks.start(vec![Message::of_rows(to, column)], &[]).finish();
                column.clear();
            }
            self.rows = 0;
        }
    }
}

/// This rank's share of rows that rank 0 gives one after the other, each as its values in every column; `give` is called there
/// alone. What is given beyond the shares is passed over, and what is missing has no values. All ranks call it together.
pub(crate) fn scatter_rows<T: Pod, const N: usize>(
    ranks: &Ranks,
    blocks: &BlockDistribution,
    give: impl FnOnce(&mut dyn FnMut([&[T]; N])),
) -> [Vec<T>; N] {
    let mut own = [(); N].map(|()| Vec::new());
    if ranks.is_first() {
        let waiting = own.clone();
        let mut reading = Reading { ranks, blocks, given: 0, own, waiting, rows: 0 };
        give(&mut |row| reading.push(row));
        while reading.given < blocks.count() {
            reading.push([&[]; N]);
        }
        return reading.own;
    }
    for _ in 0..blocks.rows(ranks.rank()).len().div_ceil(PIECE) {
        for column in &mut own {
            let received = ranks.start(Vec::new(), &[Expected { from: 0, length: None }]).finish();
            column.extend(message::rows::<T>(ranks.rank(), "rows that rank 0 reads", &received[0]));
        }
    }
    own
}

/// Asks for rows where they are: `owner` says on which rank, and `answer` there what is asked for. All ranks call it together.
pub(crate) fn fetch<T: Pod>(
    ranks: &Ranks,
    wanted: &[u32],
    owner: impl Fn(u32) -> usize,
    answer: impl Fn(u32) -> T,
) -> Vec<T> {
    let mut questions = vec![Vec::new(); ranks.count()];
    wanted.iter().for_each(|row| questions[owner(*row)].push(*row));
    let asked = ranks.all_to_all_v(questions);
    let answers = asked.into_iter().map(|rows| rows.into_iter().map(&answer).collect()).collect();
    let answers: Vec<Vec<T>> = ranks.all_to_all_v(answers);
    let mut next: Vec<_> = answers.iter().map(|list| list.iter().copied()).collect();
    wanted.iter().map(|row| next[owner(*row)].next().expect("each question has its answer")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::local_ranks::LocalRanks;

    #[test]
    fn every_rank_gets_its_share_of_what_is_read_and_can_ask_for_the_rest() {
        for (ranks, rows) in [(1, 20_000), (3, 50_000), (5, 3), (4, 0)] {
            let all = LocalRanks::run(ranks, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                let blocks = BlockDistribution::new(rows, ranks.count());
                // Row r has r mod 3 values, and one that counts them.
                let [counts, own] = scatter_rows(&ranks, &blocks, |take| {
                    (0..rows as u32 + 7).for_each(|row| take([&[row % 3], &vec![row; row as usize % 3]]));
                });
                let mine = blocks.rows(ranks.rank());
                assert!(counts.iter().copied().eq(mine.clone().map(|row| row as u32 % 3)));
                assert!(own.iter().copied().eq(mine.flat_map(|row| vec![row as u32; row % 3])));
                let wanted: Vec<u32> = (0..rows as u32).rev().step_by(5).collect();
                let answers = fetch(
                    &ranks,
                    &wanted,
                    |row| blocks.of(row as usize),
                    |row| {
                        assert!(blocks.rows(ranks.rank()).contains(&(row as usize)));
                        2 * u64::from(row)
                    },
                );
                assert!(answers.into_iter().eq(wanted.iter().map(|row| 2 * u64::from(*row))));
                own.len()
            });
            assert!(all.is_ok());
        }
    }

    #[test]
    fn rows_that_are_missing_hold_nobody_up() {
        let all = LocalRanks::run(4, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let [own] = scatter_rows::<u32, 1>(&ranks, &BlockDistribution::new(40_000, 4), |take| {
                (0..15_000).for_each(|row| take([&[row]]))
            });
            own.len()
        });
        assert_eq!(all.expect("no rank waits for ever"), [10_000, 5000, 0, 0]);
    }
}

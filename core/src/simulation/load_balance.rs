//! Assignment of the parts to ranks: made by the measured costs of the parts, and made anew between frames where that
//! is worth it. It changes no bit of the result.

use std::sync::Arc;

use super::Simulation;
use super::rebuild_error::RebuildError;
use crate::Vec3;
use crate::clock::Watch;
use crate::contact::bodies::{Sample, Samples};
use crate::scene::{Pinned, Scene};
use crate::snapshot::SnapshotError;
use crate::snapshot::rows::OwnTarget;

/// Frames that are looked at together.
const FRAMES: u32 = 4;

/// Share of the time of the slowest rank that another assignment has to save.
const WORTH: f64 = 0.1;

/// Time that the ranks have taken since the parts were last given to them.
#[derive(Debug, Clone, Default)]
pub(super) struct Balance {
    /// Seconds that this rank worked, waiting for others apart.
    busy: f64,
    frames: u32,
    /// Seconds that this rank had waited at the last frame.
    waited: f64,
    /// Time that the last assignment took [s].
    cost: f64,
}

impl Simulation {
    /// Notes what the frame took, and gives the parts anew if that is worth it. All ranks call it together.
    pub(super) fn rebalance(&mut self) {
        let ranks = self.ranks().clone();
        if ranks.is_alone() {
            return;
        }
        let (worked, waited) = (self.metrics.last_seconds(), ranks.waited());
        self.balance.busy += (worked - (waited - std::mem::replace(&mut self.balance.waited, waited))).max(0.0);
        self.balance.frames += 1;
        if self.balance.frames < FRAMES {
            return;
        }
        let busy = ranks.all_gather(&[self.balance.busy], &vec![1; ranks.count()]);
        let [cost] = ranks.max_of([self.balance.cost]);
        (self.balance.busy, self.balance.frames) = (0.0, 0);
        let parts = self.scene.parts();
        let costs = costs(parts.partition().sizes(), parts.assignment(), &busy);
        let assignment = parts.partition().balance(&costs, ranks.count());
        let slowest = |assignment: &[usize]| {
            assignment.windows(2).map(|run| costs[run[0]..run[1]].iter().sum::<f64>()).fold(0.0, f64::max)
        };
        let (now, then) = (slowest(parts.assignment()), slowest(&assignment));
        if now - then > WORTH * now && now - then > cost {
            let watch = Watch::start();
            // A failure would be one of handing over what was whole before: there is nothing to fall back on.
            self.assign(assignment).unwrap_or_else(|error| panic!("parts could not change their rank: {error}"));
            self.balance.cost = watch.seconds();
            self.metrics.count_once(&ranks, "parts_reassigned", 1);
        }
    }

    /// Gives every rank the parts from the one that `assignment` says to the one before the next rank's (first part of every
    /// rank, and the number of all parts at the end). Changes no bit of the result. All ranks call it together, between
    /// frames.
    ///
    /// # Errors
    /// Fails if the data handed over do not fit: never, unless the program is at fault.
    pub fn assign(&mut self, assignment: Vec<usize>) -> Result<(), SnapshotError> {
        let scene = Arc::new(self.scene.reassigned(assignment));
        let (old, new) = (self.scene.parts(), scene.parts());
        let target = |p: &Pinned| OwnTarget { number: p.number, vertex: old.number(p.vertex as usize) };
        let pinned: Vec<OwnTarget> = self.scene.pinned().iter().map(target).collect();
        let mut memory = self.saved_sections();
        memory.iter_mut().for_each(|(_, section)| section.migrate(old, new, &pinned));
        let tracks = self.moved_tracks(&scene);
        self.rebuild(scene, Some(tracks), &memory).map_err(RebuildError::into_error)
    }

    /// The rows of the tracks' samples that this rank's pins follow in `scene`.
    fn moved_tracks(&self, scene: &Scene) -> Vec<Samples> {
        let ranks = self.ranks();
        let one = |(track, samples): (usize, &Samples)| {
            let rows = ranks.all_gather_v(&self.scene.track_rows(track)).concat();
            let wanted = scene.track_rows(track);
            let moved = |sample: &Sample| {
                let positions: Vec<Vec3> = ranks.all_gather_v(&sample.positions).concat();
                let mut known: Vec<(u32, Vec3)> = rows.iter().copied().zip(positions).collect();
                known.sort_unstable_by_key(|(row, _)| *row);
                let place = |row: &u32| known.partition_point(|(known, _)| known < row);
                Sample { time: sample.time, positions: wanted.iter().map(|row| known[place(row)].1).collect() }
            };
            Samples { a: moved(&samples.a), b: moved(&samples.b) }
        };
        self.prescribed.tracks.iter().enumerate().map(one).collect()
    }
}

/// Cost of each part [s]: every rank's seconds, shared among its parts by their sizes.
fn costs(mut sizes: Vec<f64>, assignment: &[usize], busy: &[f64]) -> Vec<f64> {
    for (run, seconds) in assignment.windows(2).zip(busy) {
        let of_rank = &mut sizes[run[0]..run[1]];
        let all: f64 = of_rank.iter().sum();
        of_rank.iter_mut().for_each(|size| *size *= seconds / all);
    }
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::parts::Partition;

    #[test]
    fn parts_of_a_slow_rank_go_to_the_others() {
        let partition = Partition::new((0..=8).map(|part| 100 * part).collect(), std::iter::once(0..800).collect());
        let costs = costs(partition.sizes(), &[0, 4, 8], &[3.0, 1.0]);
        assert_eq!(costs, [0.75, 0.75, 0.75, 0.75, 0.25, 0.25, 0.25, 0.25]);
        assert_eq!(partition.balance(&costs, 2), [0, 3, 8]);
        assert_eq!(partition.balance(&[1.0; 8], 3), [0, 3, 5, 8]);
    }
}

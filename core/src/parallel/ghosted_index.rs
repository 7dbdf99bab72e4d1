//! The vertices that a rank knows of: [ghosts below | own | ghosts above]. Local numbers ascend as those of the scene do, so
//! whatever is sorted by the one is sorted by the other.

use std::ops::Range;

use crate::parallel::halo::Halo;
use crate::parallel::ranks::Ranks;

/// A rank's own run of the scene's vertices, its ghosts, and the messages that keep them.
#[derive(Debug, Clone)]
pub(crate) struct LocalVertices {
    ranks: Ranks,
    /// First vertex of every rank in the scene's numbering, and the number of all at the end.
    rank_starts: Vec<u32>,
    /// Numbers of the ghosts in the scene, ascending.
    ghosts: Vec<u32>,
    own: Range<usize>,
    halo: Halo,
}

impl LocalVertices {
    /// The vertices of this rank, with these ghosts (by their numbers in the scene, ascending; none is own); `rank_starts` are
    /// the first vertices of every rank in the scene, and the number of all at the end. All ranks call it together.
    pub(crate) fn new(ranks: Ranks, rank_starts: Vec<u32>, ghosts: Vec<u32>) -> Self {
        let (first, end) = (rank_starts[ranks.rank()], rank_starts[ranks.rank() + 1]);
        let low = ghosts.partition_point(|ghost| *ghost < first);
        let halo = Halo::new(&ranks, &ghosts, &rank_starts);
        let own = low..low + (end - first) as usize;
        Self { ranks, rank_starts, ghosts, own, halo }
    }

    /// The same own vertices with other ghosts. All ranks call it together.
    pub(crate) fn with_ghosts(&self, ghosts: Vec<u32>) -> Self {
        Self::new(self.ranks.clone(), self.rank_starts.clone(), ghosts)
    }

    /// This rank and the others.
    pub(crate) fn ranks(&self) -> &Ranks {
        &self.ranks
    }

    /// First vertex of every rank in the scene's numbering, and the number of all at the end.
    pub(crate) fn rank_starts(&self) -> &[u32] {
        &self.rank_starts
    }

    /// The ghosts' messages.
    pub(crate) fn halo(&self) -> &Halo {
        &self.halo
    }

    /// Numbers of the ghosts in the scene, ascending.
    pub(crate) fn ghosts(&self) -> &[u32] {
        &self.ghosts
    }

    /// Number of local vertices, ghosts included.
    pub(crate) fn count(&self) -> usize {
        self.own.len() + self.ghosts.len()
    }

    /// Own vertices, in local numbers.
    pub(crate) fn own(&self) -> Range<usize> {
        self.own.clone()
    }

    /// Own vertices, by their numbers in the scene.
    pub(crate) fn owned(&self) -> Range<u32> {
        let rank = self.ranks.rank();
        self.rank_starts[rank]..self.rank_starts[rank + 1]
    }

    /// Ghosts, in local numbers.
    pub(crate) fn ghost_places(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.own.start).chain(self.own.end..self.count())
    }

    /// Number in the scene of a local vertex.
    pub(crate) fn number(&self, local: usize) -> u32 {
        if local < self.own.start {
            self.ghosts[local]
        } else if local < self.own.end {
            self.owned().start + (local - self.own.start) as u32
        } else {
            self.ghosts[local - self.own.len()]
        }
    }

    /// The local number of a vertex of the scene, if it is own or a ghost.
    pub(crate) fn local(&self, number: u32) -> Option<usize> {
        let owned = self.owned();
        if owned.contains(&number) {
            return Some((number - owned.start) as usize + self.own.start);
        }
        let place = self.ghosts.binary_search(&number).ok()?;
        Some(if place < self.own.start { place } else { place + self.own.len() })
    }

    /// The rank that owns a vertex of the scene.
    pub(crate) fn owner(&self, number: u32) -> usize {
        self.rank_starts.partition_point(|start| *start <= number) - 1
    }

    /// Number of all vertices of the scene.
    pub(crate) fn all(&self) -> u32 {
        self.rank_starts[self.rank_starts.len() - 1]
    }
}

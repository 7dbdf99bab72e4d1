//! A pair of the proximity list, and the ranks that have it: all that own one of its nodes. Its canonical rank, which finds
//! it, sends it to the others.

use bytemuck::{Pod, Zeroable};

use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::{KINDS, Pair, PairKind};
use crate::parallel::message::is_broken;

/// A pair of the list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CandidatePair {
    /// The pair.
    pub pair: Pair,
    /// Not more than its distance when the list was made, or than the least on the paths that it was made around [m].
    pub distance: f32,
    /// Thickness of the pair [m]; zero where repulsions do not act.
    pub thickness: f32,
}

/// A pair of the list as it is kept: there are millions, and those of a kind are kept together.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KeptPair {
    nodes: [u32; 4],
    distance: f32,
    thickness: f32,
}

impl KeptPair {
    /// The pair, of this kind.
    #[inline(always)]
    pub(crate) fn of_kind(self, kind: PairKind) -> CandidatePair {
        let Self { nodes, distance, thickness } = self;
        CandidatePair { pair: Pair { kind, nodes }, distance, thickness }
    }

    /// Its nodes, to be renumbered.
    pub(crate) fn nodes_mut(&mut self) -> &mut [u32; 4] {
        &mut self.nodes
    }
}

impl From<CandidatePair> for KeptPair {
    fn from(CandidatePair { pair, distance, thickness }: CandidatePair) -> Self {
        Self { nodes: pair.nodes, distance, thickness }
    }
}

/// A pair of the list as it is sent, by numbers of the scene.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct CandidateRow {
    nodes: [u32; 4],
    /// Place of the pair's kind in [`KINDS`].
    kind: u32,
    distance: f32,
    thickness: f32,
}

impl CandidateRow {
    fn new(CandidatePair { pair, distance, thickness }: &CandidatePair) -> Self {
        Self { nodes: pair.nodes, kind: pair.kind as u32, distance: *distance, thickness: *thickness }
    }

    /// The pair that came to a rank.
    ///
    /// # Panics
    /// It is of no kind.
    fn received(self, rank: usize) -> CandidatePair {
        let Self { nodes, kind, distance, thickness } = self;
        let Some(kind) = KINDS.get(kind as usize).copied() else {
            is_broken(rank, "pairs of the proximity list", format_args!("{kind} is no kind of a pair"));
        };
        CandidatePair { pair: Pair { kind, nodes }, distance, thickness }
    }
}

/// Sends the pairs found here to the other ranks that own one of their nodes, and appends those that come from others. All
/// ranks call it together. The nodes of all pairs have their numbers in the scene.
pub(crate) fn replicate_pairs(nodes: &ContactNodes, pairs: &mut Vec<CandidatePair>) {
    let ranks = nodes.ranks();
    if ranks.is_alone() {
        return;
    }
    let mut outgoing: Vec<Vec<CandidateRow>> = vec![Vec::new(); ranks.count()];
    for candidate in pairs.iter() {
        let owner = |node| if node < nodes.global_cloth_count() { nodes.owner(node) } else { ranks.rank() };
        let mut owners = candidate.pair.nodes.map(owner);
        owners.sort_unstable();
        for (place, owner) in owners.iter().enumerate() {
            if *owner != ranks.rank() && owners[..place].last() != Some(owner) {
                outgoing[*owner].push(CandidateRow::new(candidate));
            }
        }
    }
    let received = ranks.all_to_all_v(outgoing).into_iter().flatten();
    pairs.extend(received.map(|row| row.received(ranks.rank())));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_comes_as_it_was_sent_and_one_of_no_kind_ends_the_run() {
        let pair = Pair { kind: PairKind::EdgeEdge, nodes: [3, 9, 4, 7] };
        let sent = CandidatePair { pair, distance: 0.1, thickness: 0.002 };
        let row = CandidateRow::new(&sent);
        assert_eq!(row.received(1), sent);
        let ended = std::panic::catch_unwind(|| CandidateRow { kind: 2, ..row }.received(1));
        let said = ended.expect_err("there are two kinds").downcast::<String>().expect("a panic with words");
        assert!(said.contains("\"pairs of the proximity list\" to rank 1 cannot be decoded: 2 is no kind"), "{said}");
    }
}

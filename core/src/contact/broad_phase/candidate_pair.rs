//! A pair of the proximity list, and the ranks that have it: all that own one of its nodes. Its canonical rank, which finds
//! it, sends it to the others.

use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::{KINDS, Pair};

/// A pair of the list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CandidatePair {
    /// The pair.
    pub pair: Pair,
    /// Not more than its distance when the list was made [m].
    pub distance: f32,
    /// Thickness of the pair [m]; zero where repulsions do not act.
    pub thickness: f32,
}

/// A pair of the list by numbers of the scene: its nodes, its kind, and the bits of its distance and thickness.
type PairRow = [u32; 7];

/// Sends the pairs found here to the other ranks that own one of their nodes, and appends those that come from others. All
/// ranks call it together. The nodes of all pairs have their numbers in the scene.
pub(crate) fn replicate_pairs(nodes: &ContactNodes, pairs: &mut Vec<CandidatePair>) {
    let ranks = nodes.ranks();
    if ranks.is_alone() {
        return;
    }
    let mut outgoing: Vec<Vec<PairRow>> = vec![Vec::new(); ranks.count()];
    for CandidatePair { pair, distance, thickness } in pairs.iter() {
        let mut owners =
            pair.nodes.map(|node| if node < nodes.global_cloth_count() { nodes.owner(node) } else { ranks.rank() });
        owners.sort_unstable();
        let [a, b, c, d] = pair.nodes;
        for (place, owner) in owners.iter().enumerate() {
            if *owner != ranks.rank() && owners[..place].last() != Some(owner) {
                outgoing[*owner].push([a, b, c, d, pair.kind as u32, distance.to_bits(), thickness.to_bits()]);
            }
        }
    }
    let received = ranks.all_to_all_v(outgoing).into_iter().flatten();
    pairs.extend(received.map(|[a, b, c, d, kind, distance, thickness]| CandidatePair {
        pair: Pair { kind: KINDS[kind as usize], nodes: [a, b, c, d] },
        distance: f32::from_bits(distance),
        thickness: f32::from_bits(thickness),
    }));
}

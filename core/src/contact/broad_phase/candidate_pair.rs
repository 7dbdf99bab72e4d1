//! A pair of the proximity list, and the ranks that hold it: all that own one of its nodes. Its home, which found it, tells the others.

use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::{KINDS, Pair};

/// A pair of the list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Neighbour {
    /// The pair.
    pub pair: Pair,
    /// Not more than its distance when the list was made [m].
    pub distance: f32,
    /// Thickness of the pair [m]; zero where repulsions do not act.
    pub thickness: f32,
}

/// A pair of the list by numbers of the scene: its nodes, its kind, and the bits of its distance and thickness.
type Told = [u32; 7];

/// Tells the other holders of the pairs found here, and appends those that others found and this rank holds. All ranks call
/// it together. The nodes of all pairs have their numbers in the scene.
pub(crate) fn spread(nodes: &ContactNodes, pairs: &mut Vec<Neighbour>) {
    let ranks = nodes.ranks();
    if ranks.is_alone() {
        return;
    }
    let mut told: Vec<Vec<Told>> = vec![Vec::new(); ranks.count()];
    for Neighbour { pair, distance, thickness } in pairs.iter() {
        let mut owners = pair.nodes.map(|node| if node < nodes.all_cloth() { nodes.owner(node) } else { ranks.rank() });
        owners.sort_unstable();
        let [a, b, c, d] = pair.nodes;
        for (place, owner) in owners.iter().enumerate() {
            if *owner != ranks.rank() && owners[..place].last() != Some(owner) {
                told[*owner].push([a, b, c, d, pair.kind as u32, distance.to_bits(), thickness.to_bits()]);
            }
        }
    }
    let heard = ranks.send_lists(told).into_iter().flatten();
    pairs.extend(heard.map(|[a, b, c, d, kind, distance, thickness]| Neighbour {
        pair: Pair { kind: KINDS[kind as usize], nodes: [a, b, c, d] },
        distance: f32::from_bits(distance),
        thickness: f32::from_bits(thickness),
    }));
}

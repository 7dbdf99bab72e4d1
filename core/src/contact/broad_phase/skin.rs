//! Reach of a proximity list: far enough to last, but where layers lie close on each other no farther than pays.
//!
//! In a heap the pairs of a list grow with the cube of its reach, and with them all that is done with it, so that a short list
//! that is often made anew costs less than a long one that lasts.

use crate::contact::broad_phase::candidate_pair::KeptPair;
use crate::contact::broad_phase::proximity_list::ProximityList;
use crate::scene::RepulsionPlace;

/// Reach of a list that is to last where there is room, as a share of a node's edges. Below 0.35 no two primitives of flat
/// cloth come within reach of each other.
pub(crate) const LONG_SKIN: f64 = 0.33;

/// Shortest that a heap makes it.
const SHORTEST_LASTING: f64 = LONG_SKIN / 8.0;

/// Reach around predicted paths of the first list of its kind, and the largest of those after it.
pub(crate) const FIRST_PREDICTED: f64 = 0.1;
const LARGEST_PREDICTED: f64 = 0.2;

/// Least reach around predicted paths where pairs repel each other in this way. Impulses act in several time steps of a collision step, and
/// have to find the pairs that come close in the later ones.
pub(crate) const fn least_predicted(place: RepulsionPlace) -> f64 {
    match place {
        RepulsionPlace::Impulses => 0.1,
        RepulsionPlace::Solves => 0.05,
    }
}

/// Shares of all nodes that leave their reach around predicted paths below and above which the reach shrinks and grows, and by how much.
const FEW: (f64, f64) = (0.01, 0.87);
const MANY: (f64, f64) = (0.05, 1.35);

/// Collision steps that a list which is to last has to last.
const LASTING: f64 = 4.0;

/// Pairs per vertex that it is to have at most: two layers that lie flat on each other have a third of it.
const CROWDED: f64 = 40.0;

/// Memory of a list over `vertices` vertices where layers lie on each other [bytes].
pub(crate) fn bytes_in_heap(vertices: usize) -> usize {
    vertices * CROWDED as usize * size_of::<KeptPair>()
}

/// Reach of a list that is made now and is to last, as a share of a node's edges, where a node goes `displacement` of them in a collision
/// step; `None` where it would not last, and is made around predicted paths.
pub(crate) fn lasting_after(list: &ProximityList, displacement: f64) -> Option<f64> {
    // A list around paths has about the pairs of one that has its first reach.
    let reach = if list.reference().is_some() { list.full_skin() } else { FIRST_PREDICTED };
    let lasting = lasting(reach, list.density());
    (LASTING * displacement <= lasting).then_some(lasting)
}

/// Reach of the next list around predicted paths, at least `least`, after one of which this share of all nodes has left its reach.
pub(crate) fn predicted_after(reach: f64, left: f64, least: f64) -> f64 {
    let factor = match left {
        _ if left < FEW.0 => FEW.1,
        _ if left > MANY.0 => MANY.1,
        _ => 1.0,
    };
    (reach * factor).clamp(least, LARGEST_PREDICTED)
}

/// Reach of a list that is to last, after one of this reach with `density` pairs per vertex. Between layers that lie on each other
/// the number of pairs grows with the square of the reach, and in heaps faster.
pub(crate) fn lasting(reach: f64, density: f64) -> f64 {
    let crowded = reach * (CROWDED / density).sqrt();
    if density > 0.0 { crowded.clamp(SHORTEST_LASTING, LONG_SKIN) } else { LONG_SKIN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heaps_have_short_lists_and_what_lies_alone_has_long_ones() {
        assert_eq!(lasting(0.0, 0.0), LONG_SKIN);
        assert_eq!(lasting(FIRST_PREDICTED, 3.0), LONG_SKIN);
        assert_eq!(lasting(LONG_SKIN, 39.0), LONG_SKIN);
        assert_eq!(lasting(LONG_SKIN, 4.0 * CROWDED), 0.5 * LONG_SKIN);
        assert_eq!(lasting(LONG_SKIN, 1e9), SHORTEST_LASTING);
        for (left, least, expected) in [(0.0, 0.1, 0.1), (0.0, 0.05, 0.087), (0.03, 0.05, 0.1), (0.2, 0.05, 0.135)] {
            assert!((predicted_after(FIRST_PREDICTED, left, least) - expected).abs() < 1e-12);
        }
        // Where pairs grow with the cube, the reach comes to rest where there are as many as are wanted.
        let density = |reach: f64| 5.0 * CROWDED * (reach / LONG_SKIN).powi(3);
        let settled = (0..40).fold(LONG_SKIN, |reach, _| lasting(reach, density(reach)));
        assert!((density(settled) - CROWDED).abs() < 1e-6 * CROWDED, "{settled}");
    }
}

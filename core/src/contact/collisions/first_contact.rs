//! First contact of a pair on its way, in which it comes too close.

use crate::Vec3;
use crate::contact::ccd::{self, Contact};
use crate::contact::tolerances::CLOSER_THAN_GAP;
use crate::contact::topology::pair::{Pair, PairKind};

/// Returns the contact in which a pair comes closer than `gap` on its way, and the pair's distance at the start [m].
/// A pair that is that close already must come closer still.
pub(super) fn first_contact(kind: PairKind, start: &[Vec3; 4], end: &[Vec3; 4], gap: f64) -> Option<(Contact, f64)> {
    let test = |gap: f64| match kind {
        PairKind::PointTriangle => ccd::point_triangle(start, end, gap),
        PairKind::EdgeEdge => ccd::edge_edge(start, end, gap),
    };
    let contact = test(gap)?;
    // The nodes' numbers do not matter for how far they are apart.
    let start_distance = Pair { kind, nodes: [0; 4] }.closest(start).apart.norm();
    if start_distance > gap {
        return Some((contact, start_distance));
    }
    Some((test(CLOSER_THAN_GAP * start_distance)?, start_distance))
}

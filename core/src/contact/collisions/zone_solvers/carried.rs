//! A zone that follows what is prescribed in it.

use nalgebra::Matrix3;

use super::rigid::{Turned, ZoneNode, mass, spread_and_covariance};
use crate::contact::tolerances::CARRIED_SPREAD;

/// Moves all nodes as those do that cannot move, and returns the largest distance along an axis of an end that is prescribed
/// from that motion [m].
///
/// The motion is the affine map nearest to theirs in the sum of squares. No affine map of one orientation brings into
/// contact what is apart. Bodies move along straight lines between two samples, so a rigid body that turns has such a map; so has
/// any triangle. Across a plane, a line or a point that they lie on, the map is the rigid motion of the zone ([`super::rigid`]).
pub(crate) fn carried(nodes: &mut [ZoneNode]) -> f64 {
    let Some(turned) = Turned::of(nodes) else { return 0.0 };
    let (frame, rotation) = (&turned.frame, turned.rotation());
    let prescribed = nodes.iter().filter(|node| mass(node) == 0.0);
    let (spread, covariance) = spread_and_covariance(prescribed, &frame.centre, &frame.centre_end);
    let weight = CARRIED_SPREAD * spread.trace();
    let inverse = (spread + Matrix3::identity() * weight).try_inverse();
    let map = inverse.map_or(rotation, |inverse| rotation + (covariance - rotation * spread) * inverse);
    let deviation = |node: &mut ZoneNode| node.move_to(&(frame.centre_end + map * (node.start - frame.centre)));
    nodes.iter_mut().map(deviation).fold(0.0, f64::max)
}

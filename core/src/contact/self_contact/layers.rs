//! Sides on which garments that are worn in an order lie.

use std::collections::BTreeMap;

use super::{CollisionSettings, SelfContact};
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::topology::pair::PairKind;
use crate::contact::topology::wearing_order::WearingOrder;
use crate::scene::Scene;

/// Reach within which points and faces are looked at, as a share of their edges.
const REACH: f64 = 0.5;

/// Points that are close to a face of another garment, over its inside: two garments, the outer one first, with those on the side that
/// the order says and those on the other. The same on all ranks, which call it together with the positions `x` [m] of their vertices.
pub(crate) fn layer_sides(scene: &Scene, x: &[Vec3], bodies: &Bodies) -> BTreeMap<[usize; 2], [u64; 2]> {
    let Some(order) = WearingOrder::of(scene) else { return BTreeMap::new() };
    let mut contact = SelfContact::new(scene, None, Some(CollisionSettings { max_steps: 1 }));
    contact.surface.gather(x, bodies, &mut contact.paths.start);
    contact.gap = contact.gap_now();
    contact.rebuild(REACH, None);
    let (surface, start) = (&contact.surface, &contact.paths.start);
    // The closest face of each garment, to each point.
    let mut closest_faces: BTreeMap<(u32, usize), (f64, [usize; 2], bool)> = BTreeMap::new();
    for candidate in contact.proximity.list(PairKind::PointTriangle) {
        let pair = &candidate.pair;
        let [point, corner] = [pair.nodes[0], pair.nodes[1]];
        let numbers = [point, corner].map(|node| surface.nodes().number(node));
        let Some(is_outer) = order.compare(numbers[0], numbers[1]).map(std::cmp::Ordering::is_gt) else { continue };
        let at = pair.positions(start);
        let closest = pair.closest(&at);
        if !surface.nodes().is_own(point) || !closest.inside {
            continue;
        }
        let normal = (at[2] - at[1]).cross(&(at[3] - at[1]));
        let is_right = (closest.apart.dot(&normal) > 0.0) == is_outer;
        let [of_point, of_face] = [point, corner].map(|node| surface.garment(node) as usize);
        let garments = if is_outer { [of_point, of_face] } else { [of_face, of_point] };
        let found = (closest.apart.norm(), garments, is_right);
        let known = closest_faces.entry((point, of_face)).or_insert(found);
        if found.0 < known.0 {
            *known = found;
        }
    }
    let mut own: BTreeMap<[usize; 2], [u64; 2]> = BTreeMap::new();
    for (_, garments, is_right) in closest_faces.values() {
        own.entry(*garments).or_default()[usize::from(!*is_right)] += 1;
    }
    let rows: Vec<[u64; 4]> = own.iter().map(|([a, b], [c, d])| [*a as u64, *b as u64, *c, *d]).collect();
    let mut all: BTreeMap<[usize; 2], [u64; 2]> = BTreeMap::new();
    for [outer, inner, right, wrong] in surface.ranks().all_gather_v(&rows).concat() {
        let sides = all.entry([outer as usize, inner as usize]).or_default();
        *sides = [sides[0] + right, sides[1] + wrong];
    }
    all
}

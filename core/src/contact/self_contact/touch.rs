//! Contact of vertices with other cloth, for caches.

use super::SelfContact;
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::collision::touch::contact_at;
use crate::contact::broad_phase::bvh_search::PairSearch;
use crate::contact::broad_phase::proximity_list::ProximityList;
use crate::contact::topology::pair::PairKind;

impl SelfContact {
    /// Raises the contact of each own vertex to that with other cloth, at the positions `x` [m] of the scene's local vertices; one
    /// number for each of these. Nothing without repulsion, which keeps the distance. All ranks call it together.
    ///
    /// The search has lists of its own: a run that asks for contact takes the same steps as one that does not.
    pub(crate) fn raise_contact(&self, x: &[Vec3], bodies: &Bodies, contact: &mut [f64]) {
        if !self.repels() {
            return;
        }
        let mut surface = self.surface.clone();
        let mut positions = Vec::new();
        surface.gather(x, bodies, &mut positions);
        let kept = (0..surface.nodes().cloth()).map(|node| surface.kept_distance(node)).fold(0.0, f64::max);
        let farthest = surface.ranks().max(kept);
        let mut near = ProximityList::new(&surface);
        near.rebuild(&mut surface, &mut PairSearch::new(), &mut positions, 0.0, farthest, None);
        let (nodes, place) = (surface.nodes(), surface.place());
        let of_cloth = |node: &u32| !surface.is_body(*node);
        for candidate in near.list(PairKind::PointTriangle) {
            let (point, kept) = (candidate.pair.nodes[0], f64::from(candidate.thickness));
            if kept > 0.0 && nodes.is_own(point) && candidate.pair.nodes.iter().all(of_cloth) {
                let vertex = point as usize - nodes.own().start + place.start;
                contact[vertex] = contact[vertex].max(contact_at(f64::from(candidate.distance), kept));
            }
        }
    }
}

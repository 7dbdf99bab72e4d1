//! The list of pairs that are close: made by a search now and then, and used by many steps.
//!
//! Each node has a *reach*. As long as no node is farther than its reach from where it was when the list was made, every
//! pair within touching distance is in the list, and for each pair of it the distance then, less what its nodes have moved,
//! bounds the distance now. Most pairs are dismissed by that bound alone (`docs/theory/self_contact.md#the-proximity-list`). Motion
//! that all nodes have in common does not count.
//!
//! A list of cloth that moves too fast for it to last is made for one collision step, around the paths that the nodes are expected to take:
//! displacements are then those from these paths, and distances the least on them.
//!
//! Every rank that owns a node of a pair holds the pair, with the same entry.

use std::ops::Range;

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::broad_phase::bvh_search::PairSearch;
use crate::contact::broad_phase::candidate_pair::{self, CandidatePair, KeptPair};
use crate::contact::tolerances::USABLE_SKIN;
use crate::contact::topology::common_rigid_motion::RigidFit;
use crate::contact::topology::nodes::{ContactNodes, IndexMap};
use crate::contact::topology::pair::{KINDS, Pair, PairKind};
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::aabb::Aabb;

/// Repulsions act on pairs closer than this times their thickness
/// (`docs/theory/self_contact.md#repulsion-with-history`).
pub(crate) const ACTIVE: f64 = 1.1;

/// Pairs of one garment that are closer at rest than this times the distance at which repulsions act are left out for good
/// (`docs/theory/self_contact.md#repulsion-with-history`).
const CLOSE_AT_REST: f64 = 1.5;

/// Reach of points of bodies over the reach of cloth in a list around predicted paths: how bodies move is known.
const REACH_OF_BODIES: f64 = 0.2;

/// Nodes that one task moves.
const CHUNK: usize = 4096;

/// Paths that the nodes are expected to take after a list is made.
#[derive(Debug, Clone)]
pub(crate) struct PredictedPaths {
    /// Ends of the paths [m].
    pub ends: Vec<Vec3>,
    /// Duration [s].
    pub duration: f64,
}

/// A piece of the list: points and triangles, then edges.
type OfKinds = [Vec<KeptPair>; 2];

/// The list.
#[derive(Debug)]
pub(crate) struct ProximityList {
    /// Points and triangles, then edges; in the pieces in which the search has met them.
    lists: [Vec<Vec<KeptPair>>; 2],
    /// Positions of the nodes when the list was made [m]; none before.
    reference: Option<Vec<Vec3>>,
    /// Paths that it was made around; none for a list that is to last.
    predicted: Option<PredictedPaths>,
    /// Displacement common to the nodes on these [m].
    predicted_shift: Vec3,
    /// Share of these that lies behind the nodes at both ends of the paths noted last.
    shares: [f64; 2],
    /// Measure of the reach of each node [m]: the mean rest length of its edges, or less for bodies.
    edge_length: Vec<f64>,
    /// Own nodes of cloth: pairs with the smallest node among them are canonical here.
    own: Range<u32>,
    /// Number and centre of the nodes that stand for all, when the list was made [m].
    centre: (f64, Vec3),
    /// Reach of the present list, as a share of those lengths.
    skin: f64,
    /// Pairs per vertex of the present list, on all ranks.
    density: f64,
    /// Upper bound on the displacement of each node since the list was made, besides the common motion [m].
    displacements: Vec<f64>,
    /// The common motion since the list was made, at both ends of the paths noted last.
    common: [RigidFit; 2],
    /// Least share of any distance that is left on the paths between these two motions.
    shortening: f64,
}

impl ProximityList {
    /// An empty list over a surface.
    pub(crate) fn new(surface: &ContactSurface) -> Self {
        let (edge_length, skin) = (surface.edge_length().to_vec(), 0.0);
        let (predicted, predicted_shift, shares) = (None, Vec3::zeros(), [0.0; 2]);
        let displacements = vec![0.0; surface.nodes().count()];
        let (lists, density) = Default::default();
        let (common, centre) = ([RigidFit::NONE; 2], (0.0, Vec3::zeros()));
        let (reference, shortening, own) = (None, 1.0, own_nodes(surface));
        Self {
            lists,
            reference,
            predicted,
            predicted_shift,
            shares,
            edge_length,
            own,
            centre,
            skin,
            density,
            displacements,
            common,
            shortening,
        }
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        let pairs = self.lists.iter().flatten().map(Vec::capacity).sum::<usize>();
        let predicted = self.predicted.as_ref().map_or(0, |predicted| size_of_val(predicted.ends.as_slice()));
        pairs * size_of::<KeptPair>()
            + predicted
            + self.displacements.len() * (3 * size_of::<f64>() + size_of::<Vec3>())
    }

    /// Pairs of a kind, in the order in which the search has met them.
    pub(crate) fn list(&self, kind: PairKind) -> impl Iterator<Item = CandidatePair> {
        self.pieces(kind).iter().flatten().map(move |kept| kept.of_kind(kind))
    }

    /// The same in pieces.
    pub(crate) fn pieces(&self, kind: PairKind) -> &[Vec<KeptPair>] {
        &self.lists[kind as usize]
    }

    /// Returns the displacement of nodes beyond which the list lacks pairs, as a share of their edges.
    pub(crate) fn skin(&self) -> f64 {
        USABLE_SKIN * self.skin
    }

    /// The reach that the list was made with, as a share of the nodes' edges.
    pub(crate) fn full_skin(&self) -> f64 {
        self.skin
    }

    /// Pairs per vertex in the lists of all ranks, which know it alike; none before there is a list.
    pub(crate) fn density(&self) -> f64 {
        self.density
    }

    /// Positions of the nodes when a list that is to last was made [m]; none before, and none of other lists.
    pub(crate) fn reference(&self) -> Option<&[Vec3]> {
        self.reference.as_deref().filter(|_| self.predicted.is_none())
    }

    /// Duration of the paths that the list was made around [s]; `None` for a list that is to last.
    pub(crate) fn predicted_duration(&self) -> Option<f64> {
        self.predicted.as_ref().map(|predicted| predicted.duration)
    }

    /// Drops the list, after one with this reach and this number of pairs per vertex.
    pub(crate) fn forget(&mut self, skin: f64, density: f64) {
        (self.reference, self.predicted, self.skin, self.density) = (None, None, skin, density);
        self.lists = Default::default();
    }

    /// Makes the list anew around `x`, the positions of all nodes [m], or around the paths predicted from there, with a reach given as a
    /// share of the nodes' edges, and the gap that collisions keep [m]. All ranks call it together; the surface gets the ghosts that the
    /// pairs need, and `x` is laid out for them.
    pub(crate) fn rebuild(
        &mut self,
        surface: &mut ContactSurface,
        search: &mut PairSearch,
        x: &mut Vec<Vec3>,
        reach: f64,
        gap: f64,
        predicted: Option<PredictedPaths>,
    ) {
        self.skin = reach;
        self.predicted = predicted;
        // Long lists are not in memory twice.
        self.lists = Default::default();
        let centre = surface.samples().centre(surface.nodes(), x);
        self.predicted_shift = match &self.predicted {
            Some(predicted) => surface.samples().centre(surface.nodes(), &predicted.ends).1 - centre.1,
            None => Vec3::zeros(),
        };
        self.fit(surface, search, x, [reach, gap]);
        let is_predicted = self.predicted.is_some();
        let measure = measures(surface, is_predicted);
        let ends = self.predicted.as_ref().map(|predicted| predicted.ends.as_slice());
        let criterion = Criterion { surface, x, ends, measure: &measure, reach, gap };
        let keep = |pair: Pair, out: &mut OfKinds| {
            out[pair.kind as usize].extend(criterion.candidate(pair).map(KeptPair::from))
        };
        let finish = |out: &mut OfKinds| out.iter_mut().for_each(Vec::shrink_to_fit);
        let mut pieces = search.pieces_of_pairs(surface, keep, &finish);
        self.density = per_vertex(surface, pieces.iter().flatten().map(Vec::len).sum::<usize>() as u64);
        if let Some(renumber) = replicate_pairs(surface, &mut pieces) {
            self.lay_out(&renumber, surface, x);
        }
        for piece in pieces {
            let of_kinds = self.lists.iter_mut().zip(piece);
            of_kinds.filter(|(_, piece)| !piece.is_empty()).for_each(|(list, piece)| list.push(piece));
        }
        self.edge_length = measures(surface, is_predicted);
        self.own = own_nodes(surface);
        self.displacements.resize(x.len(), 0.0);
        self.centre = centre;
        let reference = self.reference.get_or_insert_default();
        reference.clear();
        reference.extend_from_slice(x);
    }

    /// Pairs per vertex of a list around `x` [m] with this reach, which is not made. All ranks call it together; `x` is laid out for the
    /// ghosts that come.
    pub(crate) fn density_with(
        &mut self,
        surface: &mut ContactSurface,
        search: &mut PairSearch,
        x: &mut Vec<Vec3>,
        reach: f64,
        gap: f64,
    ) -> f64 {
        self.fit(surface, search, x, [reach, gap]);
        let measure = measures(surface, false);
        let criterion = Criterion { surface, x, ends: None, measure: &measure, reach, gap };
        let count = |pair: Pair, found: &mut u64| *found += u64::from(criterion.candidate(pair).is_some());
        per_vertex(surface, search.pieces_of_pairs(surface, count, &|_| ()).iter().sum())
    }

    /// Fits the boxes of the search to the reach of the nodes around `x` [m], or around the predicted paths, and fetches the ghosts that
    /// come near.
    fn fit(
        &mut self,
        surface: &mut ContactSurface,
        search: &mut PairSearch,
        x: &mut Vec<Vec3>,
        [reach, gap]: [f64; 2],
    ) {
        let (shift, is_predicted) = (self.predicted_shift, self.predicted.is_some());
        let around = |surface: &ContactSurface, x: &[Vec3], ends: Option<&PredictedPaths>, i: usize| {
            let reach = ACTIVE * surface.kept_distance(i) + reach * measure_of(surface, is_predicted, i) + gap;
            Aabb::around_path([&x[i], ends.map_or(&x[i], |predicted| &predicted.ends[i])], &shift, reach)
        };
        search.refit(surface, |i| around(surface, x, self.predicted.as_ref(), i));
        if let Some(renumber) = search.import_ghosts(surface) {
            self.lay_out(&renumber, surface, x);
        }
        search.refit_ghosts(surface, |i| around(surface, x, self.predicted.as_ref(), i));
    }

    /// Lays positions out for other ghosts, and fetches those of the ghosts.
    fn lay_out(&mut self, renumber: &IndexMap, surface: &ContactSurface, x: &mut Vec<Vec3>) {
        for x in [Some(x), self.predicted.as_mut().map(|predicted| &mut predicted.ends)].into_iter().flatten() {
            renumber.apply(x, Vec3::zeros());
            surface.nodes().update(x);
        }
    }

    /// Lays everything out for other ghosts.
    pub(crate) fn renumber(&mut self, renumber: &IndexMap, surface: &ContactSurface) {
        renumber.renumber(self.lists.iter_mut().flatten().flatten().flat_map(KeptPair::nodes_mut));
        self.edge_length = measures(surface, self.predicted.is_some());
        if let Some(predicted) = &mut self.predicted {
            renumber.apply(&mut predicted.ends, Vec3::zeros());
        }
        self.own = own_nodes(surface);
        renumber.apply(&mut self.displacements, 0.0);
        if let Some(reference) = &mut self.reference {
            renumber.apply(reference, Vec3::zeros());
        }
    }

    /// Notes the way of every node on the straight path from `start` to `end` [m], where it is so long after a list around predicted paths
    /// was made [s]. Returns the longest of all ranks as a share of the node's edges: above the reach the list may lack pairs. Infinite
    /// before the list is made. All ranks call it together.
    pub(crate) fn update_displacements(
        &mut self,
        surface: &ContactSurface,
        [start, end]: [&[Vec3]; 2],
        elapsed: [f64; 2],
    ) -> f64 {
        let Some(reference) = &self.reference else { return f64::INFINITY };
        if let Some(predicted) = &self.predicted {
            self.shares = elapsed.map(|elapsed| (elapsed / predicted.duration).min(1.0));
            self.shortening = 1.0;
        } else {
            self.common = surface.samples().fits(surface.nodes(), reference, self.centre, [start, end]);
            self.shortening = self.common[0].min_stretch(&self.common[1]);
        }
        let expected =
            Expected { reference, predicted: self.predicted.as_ref(), common: self.common, shares: self.shares };
        let chunks = self.displacements.par_chunks_mut(CHUNK).enumerate();
        let largest = chunks.map(|(c, displacements)| {
            let mut largest = 0.0_f64;
            for (i, displacement) in displacements.iter_mut().enumerate() {
                let node = c * CHUNK + i;
                let [a, b] =
                    [(start, 0), (end, 1)].map(|(x, at)| (x[node] - expected.position(node, at)).norm_squared());
                *displacement = a.max(b).sqrt();
                largest = largest.max(*displacement / self.edge_length[node]);
            }
            largest
        });
        // A path between two rotations shortens distances.
        surface.ranks().max(largest.reduce(|| 0.0, f64::max)) / self.shortening
    }

    /// Returns the displacement common to all nodes on the paths noted last [m].
    pub(crate) fn common_shift(&self) -> Vec3 {
        match self.predicted {
            Some(_) => self.predicted_shift * (self.shares[1] - self.shares[0]),
            None => self.common[1].centre() - self.common[0].centre(),
        }
    }

    /// Number of nodes of all ranks that have moved so far that the list may lack pairs of them if they move a share `margin` of their edges
    /// farther. All ranks call it together.
    pub(crate) fn count_beyond_skin(&self, nodes: &ContactNodes, margin: f64) -> u64 {
        let count = |range: Range<usize>| range.filter(|node| self.is_beyond_skin(*node, margin)).count() as u64;
        let [of_cloth] = nodes.ranks().sum_of([count(nodes.own())]);
        of_cloth + count(nodes.cloth()..nodes.count())
    }

    /// Marks these nodes; one entry for each node.
    pub(crate) fn mark_beyond_skin(&self, margin: f64, marks: &mut [u8]) {
        marks.iter_mut().enumerate().for_each(|(node, mark)| *mark = u8::from(self.is_beyond_skin(node, margin)));
    }

    fn is_beyond_skin(&self, node: usize, margin: f64) -> bool {
        let moved = self.displacements[node] / (self.edge_length[node] * self.shortening);
        moved + margin > self.skin()
    }

    /// Whether a node with a new end has moved no farther than noted, up to a share of its edges.
    pub(crate) fn is_within_skin(&self, node: usize, end: &Vec3, margin: f64) -> bool {
        self.displacement_of(node, end) <= self.displacements[node] + margin * self.edge_length[node]
    }

    /// Notes the way of one node again, after its end has changed. Returns it as a share of the node's edges.
    pub(crate) fn update_displacement(&mut self, node: usize, end: &Vec3) -> f64 {
        self.displacements[node] = self.displacements[node].max(self.displacement_of(node, end));
        self.displacements[node] / (self.edge_length[node] * self.shortening)
    }

    /// Brings the ways of ghosts to what their owners have noted again. All ranks call it together.
    pub(crate) fn exchange_displacements(&mut self, nodes: &ContactNodes) {
        nodes.update(&mut self.displacements);
    }

    /// Infinite before the list is made.
    fn displacement_of(&self, node: usize, end: &Vec3) -> f64 {
        let Some(reference) = &self.reference else { return f64::INFINITY };
        let (predicted, common, shares) = (self.predicted.as_ref(), self.common, self.shares);
        (end - Expected { reference, predicted, common, shares }.position(node, 1)).norm()
    }

    /// The pairs canonical here that may come within `gap` [m] on the paths noted last, also if all nodes move a share `margin`
    /// of their edges farther.
    pub(crate) fn close_pairs(&self, gap: f64, margin: f64, out: &mut Vec<Vec<Pair>>) {
        // One piece, in the memory of an earlier one.
        out.truncate(1);
        let mut close = out.pop().unwrap_or_default();
        close.clear();
        let may_meet = |n: &CandidatePair| self.may_come_within(n, gap, margin) && self.is_canonical(&n.pair);
        for kind in KINDS {
            let chunks = self.pieces(kind).par_iter().flat_map(|piece| piece.par_chunks(CHUNK));
            let of_kind = chunks.flat_map_iter(|chunk| chunk.iter().map(|kept| kept.of_kind(kind)));
            close.par_extend(of_kind.filter(may_meet).map(|n| n.pair));
        }
        out.push(close);
    }

    /// Marks the nodes of pairs held here that may touch on the paths noted last, also if all nodes move a share `margin` of
    /// their edges farther; one entry for each node. Own nodes are marked by their owner.
    pub(crate) fn mark_in_contact(&self, margin: f64, marks: &mut [u8]) {
        let touching = KINDS.iter().flat_map(|kind| self.list(*kind)).filter(|n| self.may_come_within(n, 0.0, margin));
        touching.flat_map(|n| n.pair.nodes).for_each(|node| marks[node as usize] = 1);
    }

    /// Whether a pair may come within `gap` [m] on the paths noted last, also if its nodes move a share `margin` of their edges
    /// farther.
    #[inline]
    fn may_come_within(&self, neighbour: &CandidatePair, gap: f64, margin: f64) -> bool {
        let [a, b] = neighbour.pair.fold(&self.edge_length, f64::max);
        self.distance_bound(neighbour) - margin * (a + b) <= gap
    }

    /// Whether this rank owns the smallest node of a pair.
    #[inline]
    fn is_canonical(&self, pair: &Pair) -> bool {
        let [a, b, c, d] = pair.nodes;
        self.own.contains(&a.min(b).min(c.min(d)))
    }

    /// A bound from below on the distance of a pair anywhere on the paths noted last [m].
    #[inline]
    pub(crate) fn distance_bound(&self, neighbour: &CandidatePair) -> f64 {
        let [a, b] = neighbour.pair.fold(&self.displacements, f64::max);
        f64::from(neighbour.distance) * self.shortening - a - b
    }
}

/// Measure of the reach of a node [m], in a list around predicted paths or in one that is to last.
fn measure_of(surface: &ContactSurface, is_predicted: bool, node: usize) -> f64 {
    let share = if is_predicted && surface.is_body(node as u32) { REACH_OF_BODIES } else { 1.0 };
    surface.edge_length()[node] * share
}

/// The measures of all nodes [m].
fn measures(surface: &ContactSurface, is_predicted: bool) -> Vec<f64> {
    (0..surface.node_count()).map(|node| measure_of(surface, is_predicted, node)).collect()
}

/// Own nodes of cloth, in local numbers.
fn own_nodes(surface: &ContactSurface) -> Range<u32> {
    let own = surface.nodes().own();
    own.start as u32..own.end as u32
}

/// Positions of the nodes at both ends of the paths noted last if they moved as expected.
struct Expected<'a> {
    reference: &'a [Vec3],
    predicted: Option<&'a PredictedPaths>,
    common: [RigidFit; 2],
    shares: [f64; 2],
}

impl Expected<'_> {
    #[inline]
    fn position(&self, node: usize, at: usize) -> Vec3 {
        let from = &self.reference[node];
        match self.predicted {
            Some(predicted) => from + (predicted.ends[node] - from) * self.shares[at],
            None => self.common[at].apply(from),
        }
    }
}

/// Pairs of all ranks per vertex of cloth, of which this rank has `found`. All ranks call it together.
fn per_vertex(surface: &ContactSurface, found: u64) -> f64 {
    let [all_found] = surface.ranks().sum_of([found]);
    all_found as f64 / f64::from(surface.nodes().global_cloth_count().max(1))
}

/// Pairs that a list takes.
struct Criterion<'a> {
    surface: &'a ContactSurface,
    /// Positions of the nodes [m].
    x: &'a [Vec3],
    /// Ends of predicted paths from there [m].
    ends: Option<&'a [Vec3]>,
    /// Measure of the reach of each node [m].
    measure: &'a [f64],
    reach: f64,
    gap: f64,
}

impl Criterion<'_> {
    /// The entry of a pair, if it is close enough for the list.
    fn candidate(&self, pair: Pair) -> Option<CandidatePair> {
        let Self { surface, x, ends, measure, reach, gap } = *self;
        let [a, b] = pair.fold(measure, f64::max);
        let body = surface.body_of(&pair.nodes);
        let thick = body.map_or_else(|| surface.pair_thickness(&pair), |body| body.thickness);
        let limit = ACTIVE * thick + reach * (a + b) + gap;
        let start = pair.positions(x);
        let distance = match ends {
            None if pair.is_beyond(&start, limit) => return None,
            None => pair.closest(&start).apart.norm(),
            Some(ends) => {
                let paths = [&start, &pair.positions(ends)];
                if pair.is_beyond_on_paths(paths, limit) {
                    return None;
                }
                pair.distance_bound_on_paths(&pair.closest(&start), paths).max(0.0)
            }
        };
        if distance > limit {
            return None;
        }
        let repels = body.is_some() || surface.repels(&pair) && !is_close_at_rest(surface, &pair, thick);
        let thickness = if repels { thick as f32 } else { 0.0 };
        Some(CandidatePair { pair, distance: below(distance), thickness })
    }
}

/// Brings the pairs found to all ranks that hold them, and leaves no ghosts but those that pairs or triangles need.
fn replicate_pairs(surface: &mut ContactSurface, pieces: &mut Vec<OfKinds>) -> Option<IndexMap> {
    if surface.ranks().is_alone() {
        return None;
    }
    let nodes = surface.nodes();
    let of_piece = |piece: OfKinds| {
        KINDS.into_iter().zip(piece).flat_map(|(kind, kept)| kept.into_iter().map(move |kept| kept.of_kind(kind)))
    };
    let mut pairs: Vec<CandidatePair> = std::mem::take(pieces).into_iter().flat_map(of_piece).collect();
    pairs.iter_mut().for_each(|n| n.pair = nodes.numbered(&n.pair));
    candidate_pair::replicate_pairs(nodes, &mut pairs);
    let is_ghost = |number: &u32| *number < nodes.global_cloth_count() && !nodes.owns(*number);
    let mut ghosts: Vec<u32> = pairs.iter().flat_map(|n| n.pair.nodes).filter(is_ghost).collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    let renumber = surface.set_ghosts(ghosts);
    let local = |number: u32| surface.nodes().local(number).expect("the nodes of held pairs are own or ghosts");
    pairs.iter_mut().for_each(|n| n.pair.nodes = n.pair.nodes.map(local));
    let mut of_kinds = OfKinds::default();
    pairs.into_iter().for_each(|n| of_kinds[n.pair.kind as usize].push(n.into()));
    pieces.push(of_kinds);
    renumber
}

/// `f32` not above a positive `x`.
fn below(x: f64) -> f32 {
    x as f32 * (1.0 - f32::EPSILON)
}

/// Whether the two belong to one garment and lie this close by construction.
fn is_close_at_rest(surface: &ContactSurface, pair: &Pair, thickness: f64) -> bool {
    let limit = CLOSE_AT_REST * ACTIVE * thickness;
    let is_close =
        |at: &[Vec3; 4]| !pair.is_beyond(at, limit) && pair.closest(at).apart.norm_squared() <= limit * limit;
    surface.is_one_garment(pair) && is_close(&pair.positions(surface.rest()))
}

#[cfg(test)]
pub(crate) mod tests;

//! Geometric collisions: what is left to pass through something between two states is stopped
//! (`docs/theory/self_contact.md`).
//!
//! All nodes move straight from a collision-free state to where the time steps have put them. A pair *meets* when it
//! comes closer than a small gap on the way (`ccd`); it then gets an impulse. When impulses alone do not end it, the
//! pairs that still meet form impact zones: first inelastic ones, where everything may slide but nothing approach, then
//! rigid ones, and at last the nodes stay where they were. The loop always ends, since the state it started from is
//! free of collisions.
//!
//! Pairs are judged by their canonical rank, that of their smallest node (`response` says who answers). What is decided for all
//! is decided by all ranks alike.
//!
//! The gap is wider than the rounding of a position to single precision, so that what a cache stores is as free of
//! crossings as what is computed.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::broad_phase::bvh_search::PairSearch;
use crate::contact::broad_phase::proximity_list::ProximityList;
use crate::contact::broad_phase::swept_search::{Inflation, SweptPairs};
use crate::contact::ccd::Contact;
use crate::contact::collisions::first_contact::first_contact;
use crate::contact::collisions::impact_zones::Collision;
use crate::contact::collisions::response::{IMPULSE_ATTEMPTS, Kinematics, Response};
use crate::contact::tolerances::OPEN_GAP;
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::nodes::NodePaths;
use crate::contact::topology::pair::Pair;
use crate::contact::topology::surface::ContactSurface;
use crate::metrics::Metrics;

/// Attempts with impulses that are added where the usual ones failed.
const MORE_ATTEMPTS: u32 = 3 * IMPULSE_ATTEMPTS;

/// A collision step is hard if more than one vertex in this number is left to impact zones: small zones cost less than
/// the shorter steps that avoid them (`docs/dev/decisions/0037-heaps.md`).
const HARD_SHARE: u64 = 5;

/// Edge lengths per second at which pairs closer than the gap are opened [1/s].
const OPENING_RATE: f64 = 1.0;

/// Margin by which a node may come farther than on its path until pairs are looked for again, as a share of the edges
/// around it.
pub(crate) const MARGIN: f64 = 0.02;

/// Number of nodes of which at most one has left its reach where the paths of these nodes alone are searched.
const SEARCHED_ALONE: u64 = 8;

/// Pairs that one task looks at.
const CHUNK: usize = 1024;

/// Surfaces and settings that the collisions work on.
pub(crate) struct Collisions<'a> {
    /// The surfaces. Ghosts may come to those they have.
    pub surface: &'a mut ContactSurface,
    /// Distance that everything keeps [m].
    pub gap: f64,
    /// Length of the interval [s].
    pub duration: f64,
    /// Pairs that are left alone because they cross at the start, by the scene's numbers of their nodes.
    pub ignored: &'a (dyn Fn(&Pair) -> bool + Sync),
    /// Whether the loop may end for a rewind to a shorter collision step, instead of resolving in zones.
    pub may_rewind: bool,
    /// Strategy of the resolution.
    pub strategy: Strategy,
}

/// Strategy of resolving collisions: a stronger one where the usual one failed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Strategy {
    /// Some attempts with impulses, then zones.
    #[default]
    Usual,
    /// More attempts with impulses.
    MoreAttempts,
    /// Zones from the beginning.
    Zones,
}

impl Strategy {
    /// Returns the number of the usual attempt that the attempt of this number is like.
    fn attempt(self, number: u32) -> u32 {
        match self {
            Self::Usual => number,
            Self::MoreAttempts => number.saturating_sub(MORE_ATTEMPTS).max(1),
            Self::Zones => number + IMPULSE_ATTEMPTS,
        }
    }
}

/// Outcome of the collision loop; all but the vertices is the same on all ranks.
#[derive(Debug, Default)]
pub(crate) struct LoopOutcome {
    /// Own cloth vertices whose end was changed, ascending, by the local numbers that they have now.
    pub moved: Vec<u32>,
    /// Whether large impact zones were needed.
    pub hard: bool,
    /// Whether pairs were given up, so that cloth may cross what is prescribed.
    pub pinched: bool,
    /// Whether nothing was resolved, so that the collision step is rewound and retried shorter.
    pub rewound: bool,
    /// Whether zones stayed where they were, because nothing else resolved them.
    pub stopped: bool,
    /// Nodes of such zones of this rank, by their numbers in the scene.
    pub stopped_nodes: Vec<u32>,
}

/// Arrays of the loop, over the nodes of this rank.
#[derive(Debug, Default)]
pub(crate) struct CollisionLoop {
    /// Displacements over the interval [m].
    displacements: Vec<Vec3>,
    /// Not zero for nodes that the last attempt has changed, and for those that any has.
    recent: Vec<u8>,
    moved: Vec<u8>,
    /// Pairs canonical here that may meet, in pieces.
    candidates: Vec<Vec<Pair>>,
    /// Not zero for own nodes that have come out of what the candidates were looked for in.
    left: Vec<u8>,
}

impl CollisionLoop {
    /// Changes the ends of `paths` until nothing meets. All ranks call it together.
    pub(crate) fn resolve(
        &mut self,
        collisions: &mut Collisions<'_>,
        proximity: &mut ProximityList,
        search: &mut PairSearch,
        paths: &mut NodePaths,
        mut departure: Departure,
        metrics: &mut Metrics,
    ) -> LoopOutcome {
        let ranks = collisions.surface.ranks().clone();
        let mut response = Response::default();
        let mut source = CandidateSource::of(departure, collisions.surface.nodes(), proximity);
        [&mut self.recent, &mut self.moved, &mut self.left].into_iter().for_each(Vec::clear);
        self.displacements.clear();
        self.prepare(source, collisions, proximity, search, paths, metrics);
        let mut detected = self.detect(collisions, paths, &response);
        let [mut everywhere] = ranks.sum_of([detected.len() as u64]);
        if everywhere == 0 {
            return LoopOutcome::default();
        }
        self.displacements.extend(paths.start.iter().zip(&paths.end).map(|(a, b)| b - a));
        let all = paths.start.len();
        [&mut self.recent, &mut self.moved, &mut self.left].into_iter().for_each(|marks| marks.resize(all, 0));
        let is_hard = |collisions: &Collisions<'_>, nodes: u64| {
            nodes * HARD_SHARE > u64::from(collisions.surface.nodes().global_cloth_count())
        };
        let mut attempts = 0;
        while everywhere > 0 {
            attempts += 1;
            let attempt = collisions.strategy.attempt(attempts);
            if attempt == IMPULSE_ATTEMPTS + 1 && collisions.may_rewind && is_hard(collisions, everywhere) {
                return LoopOutcome { rewound: true, ..LoopOutcome::default() };
            }
            metrics.count("collision_hits", detected.len() as u64);
            let (surface, gap) = (&*collisions.surface, collisions.gap);
            let field = Kinematics { nodes: surface.nodes(), start: &paths.start, mobility: surface.mobility(), gap };
            let touched = response.respond(&field, attempt, detected, &mut self.displacements, metrics);
            let covers = |node: u32, path: [&Vec3; 2]| {
                let is_within_skin = || proximity.is_within_skin(node as usize, path[1], MARGIN);
                let is_searched = || search.covers(node, path, MARGIN * surface.edge_length()[node as usize]);
                match source {
                    CandidateSource::Swept | CandidateSource::Renewed => is_searched(),
                    CandidateSource::ProximityList => is_within_skin(),
                    CandidateSource::Both => is_within_skin() && is_searched(),
                }
            };
            let covered = self.note_touched(surface.nodes(), &touched, paths, covers);
            if ranks.any(!covered) {
                let nodes = surface.nodes();
                let moved = nodes.own().filter(|&node| self.moved[node] != 0);
                let farthest = moved.map(|node| proximity.update_displacement(node, &paths.end[node]));
                let used = ranks.max(farthest.fold(departure.used, f64::max));
                proximity.exchange_displacements(nodes);
                departure = Departure::of(used, proximity, nodes);
                source = CandidateSource::of(departure, nodes, proximity).after(source);
                self.prepare(source, collisions, proximity, search, paths, metrics);
            }
            detected = self.detect(collisions, paths, &response);
            [everywhere] = ranks.sum_of([detected.len() as u64]);
        }
        metrics.count_once(&ranks, "collision_attempts", attempts.into());
        metrics.count_once(&ranks, "collision_loops", 1);
        let nodes = collisions.surface.nodes();
        let [zone_nodes, given_up, stopped] = response.report(nodes, metrics);
        let moved = nodes.own().filter(|&node| self.moved[node] != 0).map(|node| node as u32).collect();
        let hard = is_hard(collisions, zone_nodes);
        LoopOutcome {
            moved,
            hard,
            pinched: given_up > 0,
            rewound: false,
            stopped: stopped > 0,
            stopped_nodes: response.stopped_nodes,
        }
    }

    /// Frees the candidates but for one piece: after a search along paths they would be the largest memory beside the next step's solves.
    pub(crate) fn release_candidates(&mut self) {
        self.candidates.truncate(1);
    }

    /// Finds the pairs that may meet on these paths, with a little more, so that impulses seldom lead beyond.
    fn prepare(
        &mut self,
        source: CandidateSource,
        collisions: &mut Collisions<'_>,
        proximity: &mut ProximityList,
        search: &mut PairSearch,
        paths: &mut NodePaths,
        metrics: &mut Metrics,
    ) {
        let (inflation, surface) = (Inflation { gap: collisions.gap, margin: MARGIN }, &mut *collisions.surface);
        let found = &mut self.candidates;
        let renumber = match source {
            CandidateSource::ProximityList => return proximity.close_pairs(inflation.gap, inflation.margin, found),
            CandidateSource::Swept => {
                metrics.count_once(surface.ranks(), "swept_searches", 1);
                search.swept_pairs(surface, proximity, paths, inflation, found)
            }
            CandidateSource::Both => {
                metrics.count_once(surface.ranks(), "swept_renewals", 1);
                proximity.close_pairs(inflation.gap, inflation.margin, found);
                self.left.resize(surface.nodes().count(), 0);
                proximity.mark_beyond_skin(MARGIN, &mut self.left);
                let pairs = SweptPairs { left: &mut self.left, found };
                search.swept_pairs_of_marked(surface, proximity, paths, inflation, pairs)
            }
            CandidateSource::Renewed => {
                metrics.count_once(surface.ranks(), "swept_renewals", 1);
                let pairs = SweptPairs { left: &mut self.left, found };
                search.update_swept_pairs(surface, proximity, paths, inflation, pairs)
            }
        };
        self.left.fill(0);
        if let Some(renumber) = renumber.filter(|_| !self.displacements.is_empty()) {
            let nodes = collisions.surface.nodes();
            renumber.apply(&mut self.displacements, Vec3::zeros());
            self.left.resize(nodes.count(), 0);
            [&mut self.recent, &mut self.moved].into_iter().for_each(|marks| renumber.apply(marks, 0));
            nodes.update_all(&mut [&mut self.displacements, &mut self.recent, &mut self.moved]);
        }
    }

    /// The candidates that meet, sorted; of these, once nodes have been changed, only those with such a node, which
    /// have not moved as one body: they are as far apart at the end as at the start.
    fn detect(&self, collisions: &Collisions<'_>, paths: &NodePaths, response: &Response) -> Vec<Collision> {
        let concerns =
            |pair: &Pair| self.recent.is_empty() || pair.nodes.iter().any(|&node| self.recent[node as usize] != 0);
        let judge = |pair: &Pair| {
            let (contact, start_distance) =
                first_contact(pair.kind, &pair.positions(&paths.start), &pair.positions(&paths.end), collisions.gap)?;
            let collision = collisions.collision(pair, &contact, start_distance);
            let left_alone = (collisions.ignored)(&collision.pair) || response.leaves_alone(&collision);
            (!left_alone).then_some(collision)
        };
        let chunks = self.candidates.par_iter().flat_map(|piece| piece.par_chunks(CHUNK));
        let mut detected: Vec<Collision> =
            chunks.flat_map_iter(|chunk| chunk.iter().filter(|p| concerns(p)).filter_map(judge)).collect();
        detected.sort_unstable_by_key(|collision| collision.pair);
        detected
    }

    /// Brings the ends of own nodes, and of the copies of such nodes, to their new displacements. Returns whether the
    /// pairs that were looked for with `covers` still hold.
    fn note_touched(
        &mut self,
        nodes: &ContactNodes,
        touched: &[u32],
        paths: &mut NodePaths,
        covers: impl Fn(u32, [&Vec3; 2]) -> bool,
    ) -> bool {
        self.recent.fill(0);
        let mut covered = true;
        for &node in touched {
            let end = self.note(node, paths);
            if !covers(node, [&paths.start[node as usize], &end]) {
                (covered, self.left[node as usize]) = (false, 1);
            }
        }
        let mut copies = Vec::new();
        let (recent, displacements) = (&self.recent, &self.displacements);
        let own = |node: u32| (recent[node as usize] != 0).then(|| displacements[node as usize]);
        nodes.halo().update_changed(nodes.ranks(), own, |copy, displacement: Vec3| copies.push((copy, displacement)));
        for (copy, displacement) in copies {
            self.displacements[copy] = displacement;
            self.note(copy as u32, paths);
        }
        covered
    }

    /// Brings the end of a node to its new displacement; returns it.
    fn note(&mut self, node: u32, paths: &mut NodePaths) -> Vec3 {
        let node = node as usize;
        let end = paths.start[node] + self.displacements[node];
        (paths.end[node], self.recent[node], self.moved[node]) = (end, 1, 1);
        end
    }
}

/// Departure of the nodes from what the proximity list was made around.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Departure {
    /// The longest way of a node as a share of its edges ([`ProximityList::update_displacements`]).
    pub used: f64,
    /// Number of nodes for which the list may lack pairs ([`ProximityList::count_beyond_skin`]).
    pub beyond: u64,
}

impl Departure {
    /// Notes it. All ranks call it together.
    pub(crate) fn of(used: f64, proximity: &ProximityList, nodes: &ContactNodes) -> Self {
        let beyond = if holds_all(proximity, used) { 0 } else { proximity.count_beyond_skin(nodes, MARGIN) };
        Self { used, beyond }
    }
}

/// Whether the proximity list holds all that can meet where `used` is the longest way of a node, and a little farther.
pub(crate) fn holds_all(proximity: &ProximityList, used: f64) -> bool {
    used + MARGIN <= proximity.skin()
}

/// Source of the pairs to look at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CandidateSource {
    /// The proximity list holds all that can meet.
    ProximityList,
    /// Few nodes have left their reach: their paths are searched, and the list holds all others that can meet.
    Both,
    /// Many have: the paths themselves are searched.
    Swept,
    /// They have been searched, but some nodes have left what was searched.
    Renewed,
}

impl CandidateSource {
    fn of(Departure { used, beyond }: Departure, nodes: &ContactNodes, proximity: &ProximityList) -> Self {
        let all = u64::from(nodes.global_cloth_count()) + (nodes.count() - nodes.cloth()) as u64;
        match used {
            _ if holds_all(proximity, used) => Self::ProximityList,
            _ if beyond * SEARCHED_ALONE <= all => Self::Both,
            _ => Self::Swept,
        }
    }

    /// This source where the candidates are from `before`.
    fn after(self, before: Self) -> Self {
        match before {
            Self::ProximityList => self,
            Self::Both => Self::Swept,
            Self::Swept | Self::Renewed => Self::Renewed,
        }
    }
}

impl Collisions<'_> {
    /// Returns the [`Collision`] that describes a pair that meets.
    fn collision(&self, pair: &Pair, contact: &Contact, start_distance: f64) -> Collision {
        let (nodes, mobility) = (self.surface.nodes(), self.surface.mobility());
        // A gap opened at once would throw the vertices of a short interval.
        let slowly = OPENING_RATE * self.duration * self.surface.edge_length()[pair.nodes[0] as usize];
        Collision {
            pair: nodes.numbered(pair),
            moves: pair.nodes.map(|node| mobility[node as usize] != Vec3::zeros()),
            weights: contact.weights,
            normal: contact.normal,
            target: (OPEN_GAP * self.gap - start_distance).clamp(0.0, slowly),
        }
    }
}

#[cfg(test)]
mod tests;

//! Geometric collisions: what is left to pass through something between two states is stopped (method section 4).
//!
//! All nodes move straight from a collision-free state to where the time steps have put them. A pair *meets* when it comes
//! closer than a small gap on the way (`ccd`); it then gets an impulse. When impulses alone do not end it, the pairs that
//! still meet form impact zones: first inelastic ones, where everything may slide but nothing approach, then rigid ones, and
//! at last the nodes stay where they were. The loop always ends, since the state it started from is free of collisions.
//!
//! The gap is wider than the rounding of a position to single precision, so that what a cache stores is as free of
//! crossings as what is computed.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::ccd::{self, Contact};
use crate::contact::impact_zone::{self, ZoneNode};
use crate::contact::impulse::{Constraint, change_normal_velocity, normal_velocity, response};
use crate::contact::neighbours::Neighbours;
use crate::contact::pair::{Pair, PairKind};
use crate::contact::search::PairSearch;
use crate::contact::surface::{ContactSurface, NodePaths};
use crate::contact::tolerances::{CLOSER_THAN_GAP, OPEN_GAP};
use crate::contact::zones::Zones;
use crate::geometry::aabb::Aabb;
use crate::metrics::Metrics;

/// Attempts with impulses alone. The authors make three, and ten or twenty in older scenes (method 4.6): most of what three
/// leave are a handful of pairs that a few more end.
const IMPULSE_ATTEMPTS: usize = 6;

/// A collision step is hard if more than one in so many vertices is left to impact zones: small zones cost less than the
/// shorter steps that avoid them (`docs/decisions/0007-self-contact.md`).
const HARD_SHARE: usize = 5;

/// Attempts with inelastic zones; then pairs with a prescribed node are given up, and as many attempts follow.
const INELASTIC_ATTEMPTS: usize = 12;

/// Attempts with rigid zones, before their nodes stay where they were (method 4.8).
const RIGID_ATTEMPTS: usize = 8;

/// Attempts after which what still meets is left alone: the loop ends also where a vertex that is held in some directions
/// is driven through something.
const LAST_ATTEMPT: usize = IMPULSE_ATTEMPTS + 2 * INELASTIC_ATTEMPTS + 2 * RIGID_ATTEMPTS + 50;

/// Edge lengths per second at which pairs closer than the gap are opened [1/s].
const OPENING_RATE: f64 = 1.0;

/// How much farther than on its path a node may come until pairs are looked for again, as a share of the edges around it.
const MARGIN: f64 = 0.02;

/// Pairs that one task looks at.
const CHUNK: usize = 1024;

/// A pair that meets on the way.
#[derive(Debug, Clone, Copy)]
struct Hit {
    pair: Pair,
    contact: Contact,
    /// Distance of the pair at the collision-free state [m].
    start_distance: f64,
}

/// What the collisions work on.
pub struct Collisions<'a> {
    /// The surfaces.
    pub surface: &'a ContactSurface,
    /// Inverse masses per axis [1/kg]; zero for what is prescribed.
    pub mobility: &'a [Vec3],
    /// Distance that everything keeps [m].
    pub gap: f64,
    /// Length of the interval [s].
    pub duration: f64,
    /// Pairs that are left alone because they cross at the start.
    pub ignored: &'a (dyn Fn(&Pair) -> bool + Sync),
    /// Whether what impulses do not resolve is given back for a shorter collision step.
    pub may_give_back: bool,
}

/// What was done.
#[derive(Debug, Default)]
pub struct Resolution {
    /// Cloth vertices whose end was changed, ascending.
    pub moved: Vec<u32>,
    /// Whether large impact zones were needed.
    pub hard: bool,
    /// Whether pairs were given up, so that cloth may cross what is prescribed.
    pub pinched: bool,
    /// Whether nothing was resolved, for a shorter collision step to try.
    pub given_back: bool,
}

/// Arrays of the loop.
#[derive(Debug)]
pub struct CollisionLoop {
    /// Displacements over the interval [m].
    displacements: Vec<Vec3>,
    recent: Vec<bool>,
    moved: Vec<bool>,
    given_up: Vec<Pair>,
    /// Pairs that may meet.
    candidates: Vec<Pair>,
}

impl CollisionLoop {
    /// A loop over so many nodes.
    pub fn new(nodes: usize) -> Self {
        Self {
            displacements: Vec::new(),
            recent: vec![false; nodes],
            moved: vec![false; nodes],
            given_up: Vec::new(),
            candidates: Vec::new(),
        }
    }

    /// Changes the ends of `paths` until nothing meets. `used` is the longest way of a node ([`Neighbours::note_ways`] for
    /// these paths).
    pub fn resolve(
        &mut self,
        collisions: &Collisions<'_>,
        neighbours: &mut Neighbours,
        search: &mut PairSearch,
        paths: &mut NodePaths,
        mut used: f64,
        metrics: &mut Metrics,
    ) -> Resolution {
        self.given_up.clear();
        let mut source = Source::of(used, neighbours);
        source.prepare(collisions, neighbours, search, paths, &mut self.candidates, metrics);
        let mut hits = self.detect(collisions, paths, None);
        if hits.is_empty() {
            return Resolution::default();
        }
        self.displacements.clear();
        self.displacements.extend(paths.start.iter().zip(&paths.end).map(|(a, b)| b - a));
        self.moved.fill(false);
        let mut zones = Zones::new(collisions.surface.node_count());
        let mut attempts = 0;
        let is_hard = |nodes: usize| nodes * HARD_SHARE > collisions.surface.nodes().cloth();
        while !hits.is_empty() {
            attempts += 1;
            if attempts == IMPULSE_ATTEMPTS + 1 && collisions.may_give_back && is_hard(hits.len()) {
                return Resolution { given_back: true, ..Resolution::default() };
            }
            metrics.count("collision_hits", hits.len() as u64);
            let touched = self.respond(collisions, attempts, &hits, &mut zones, paths, metrics);
            self.recent.fill(false);
            let mut covered = true;
            for node in touched {
                let end = paths.start[node as usize] + self.displacements[node as usize];
                paths.end[node as usize] = end;
                self.recent[node as usize] = true;
                self.moved[node as usize] = true;
                covered &= match source {
                    Source::Swept => search.covers(node, &end),
                    Source::Neighbours => neighbours.covers(node as usize, &end, MARGIN),
                };
            }
            if !covered {
                let moved = (0..self.moved.len()).filter(|&node| self.moved[node]);
                used = moved.map(|node| neighbours.note_way(node, &paths.end[node])).fold(used, f64::max);
                source = Source::of(used, neighbours);
                source.prepare(collisions, neighbours, search, paths, &mut self.candidates, metrics);
            }
            hits = self.detect(collisions, paths, Some(&self.recent));
            // What moves as one rigid body is as far apart at the end as at the start.
            hits.retain(|hit| !zones.are_rigid(&hit.pair.nodes));
        }
        metrics.count("collision_attempts", attempts as u64);
        metrics.count("collision_loops", 1);
        metrics.count("pairs_pinched", self.given_up.len() as u64);
        zones.report(metrics);
        let cloth = 0..collisions.surface.nodes().cloth() as u32;
        let moved = cloth.filter(|&node| self.moved[node as usize]).collect();
        Resolution { moved, hard: is_hard(zones.node_count()), pinched: !self.given_up.is_empty(), given_back: false }
    }

    /// The candidates that meet, sorted; only those with a node in `recent` if given.
    fn detect(&self, collisions: &Collisions<'_>, paths: &NodePaths, recent: Option<&[bool]>) -> Vec<Hit> {
        let concerns = |pair: &Pair| recent.is_none_or(|r| pair.nodes.iter().any(|&node| r[node as usize]));
        let judge = |pair: &Pair| {
            let hit = meet(pair, paths, collisions.gap)?;
            let left_alone = (collisions.ignored)(&collisions.surface.nodes().numbered(pair))
                || self.given_up.binary_search(pair).is_ok();
            (!left_alone).then_some(hit)
        };
        let chunks = self.candidates.par_chunks(CHUNK);
        let mut hits: Vec<Hit> =
            chunks.flat_map_iter(|chunk| chunk.iter().filter(|p| concerns(p)).filter_map(judge)).collect();
        hits.sort_unstable_by_key(|hit| hit.pair);
        hits
    }

    /// Changes the displacements so that the hits go away, more firmly with every attempt; returns the nodes changed.
    fn respond(
        &mut self,
        collisions: &Collisions<'_>,
        attempt: usize,
        hits: &[Hit],
        zones: &mut Zones,
        paths: &NodePaths,
        metrics: &mut Metrics,
    ) -> Vec<u32> {
        let hits = self.give_up(collisions, attempt, hits, zones);
        if attempt <= IMPULSE_ATTEMPTS {
            return self.impulses(collisions, &hits, paths);
        }
        let targets = hits.iter().map(|hit| (hit.constraint(), hit.opening(collisions)));
        zones.add(targets);
        let rigid_from = IMPULSE_ATTEMPTS + 2 * INELASTIC_ATTEMPTS;
        let seeds = hits.iter().map(|hit| hit.pair.nodes[0]);
        if attempt <= rigid_from {
            let (rigid, inelastic): (Vec<_>, Vec<_>) = seeds.partition(|&node| zones.contradicts(node));
            let mut touched = zones.make_inelastic(&inelastic, collisions.mobility, &mut self.displacements, metrics);
            touched.extend(self.make_rigid(collisions, &rigid, zones, paths));
            return touched;
        }
        let seeds: Vec<u32> = seeds.collect();
        if attempt <= rigid_from + RIGID_ATTEMPTS {
            return self.make_rigid(collisions, &seeds, zones, paths);
        }
        zones.stop(&seeds, |i| {
            let free = collisions.mobility[i as usize].map(|w| f64::from(w == 0.0));
            self.displacements[i as usize].component_mul_assign(&free);
        })
    }

    /// Makes the zones that one of `seeds` belongs to rigid; returns the nodes that may have changed.
    fn make_rigid(
        &mut self,
        collisions: &Collisions<'_>,
        seeds: &[u32],
        zones: &mut Zones,
        paths: &NodePaths,
    ) -> Vec<u32> {
        let node = |i: u32, displacements: &[Vec3]| {
            let start = paths.start[i as usize];
            let (end, mobility) = (start + displacements[i as usize], collisions.mobility[i as usize]);
            ZoneNode { start, end, mobility }
        };
        zones.make_rigid(seeds, |members| {
            let mut nodes: Vec<ZoneNode> = members.iter().map(|&i| node(i, &self.displacements)).collect();
            impact_zone::rigid(&mut nodes, 1.0);
            for (&i, node) in members.iter().zip(&nodes) {
                self.displacements[i as usize] = node.end - node.start;
            }
        })
    }

    /// Leaves alone what cannot be helped: pairs of prescribed nodes only, and, when zones have failed, pairs with one.
    fn give_up(&mut self, collisions: &Collisions<'_>, attempt: usize, hits: &[Hit], zones: &mut Zones) -> Vec<Hit> {
        let prescribed = |node: &u32| collisions.mobility[*node as usize] == Vec3::zeros();
        let last_chance = attempt > IMPULSE_ATTEMPTS + INELASTIC_ATTEMPTS;
        let (given_up, kept): (Vec<_>, Vec<_>) = hits.iter().copied().partition(|hit| {
            let hopeless = response(&hit.constraint(), collisions.mobility) == 0.0;
            let with_prescribed = hit.pair.nodes.iter().any(prescribed);
            attempt > LAST_ATTEMPT
                || (hopeless || last_chance || zones.has_let_go(hit.pair.nodes[0])) && with_prescribed
        });
        self.given_up.extend(given_up.iter().map(|hit| hit.pair));
        self.given_up.sort_unstable();
        kept
    }

    /// One Gauss-Seidel pass over the hits: each is looked at again with what those before it have changed.
    fn impulses(&mut self, collisions: &Collisions<'_>, hits: &[Hit], paths: &NodePaths) -> Vec<u32> {
        let mut touched = Vec::new();
        for hit in hits {
            let start = hit.pair.positions(&paths.start);
            let end = [0, 1, 2, 3].map(|q| start[q] + self.displacements[hit.pair.nodes[q] as usize]);
            let Some(hit) = meet_at(&hit.pair, &start, &end, collisions.gap) else { continue };
            let constraint = hit.constraint();
            let wanted = hit.opening(collisions);
            let change = wanted - normal_velocity(&constraint, &self.displacements);
            if change > 0.0 {
                change_normal_velocity(&constraint, collisions.mobility, &mut self.displacements, change);
            }
            // What met but needed no change turns a lot, and has to be looked at again.
            touched.extend_from_slice(&hit.pair.nodes);
        }
        touched.retain(|&node| collisions.mobility[node as usize] != Vec3::zeros());
        touched.sort_unstable();
        touched.dedup();
        touched
    }
}

/// Where the pairs to look at come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// The list of neighbours holds all that can meet.
    Neighbours,
    /// Nodes have left their reach: the paths themselves are searched.
    Swept,
}

impl Source {
    fn of(used: f64, neighbours: &Neighbours) -> Self {
        if used + MARGIN <= neighbours.reach() { Self::Neighbours } else { Self::Swept }
    }

    /// Finds the pairs that may meet on these paths, with a little more, so that impulses seldom lead beyond.
    fn prepare(
        &self,
        collisions: &Collisions<'_>,
        neighbours: &Neighbours,
        search: &mut PairSearch,
        paths: &NodePaths,
        candidates: &mut Vec<Pair>,
        metrics: &mut Metrics,
    ) {
        match self {
            Self::Neighbours => neighbours.close_pairs(collisions.gap, MARGIN, candidates),
            Self::Swept => {
                metrics.count("swept_searches", 1);
                let (start, end, edges) = (&paths.start, &paths.end, collisions.surface.edge_length());
                let margin = |i: usize| collisions.gap + MARGIN * edges[i];
                search.fit(collisions.surface, |i| Aabb::of_segment(&start[i], &end[i]).enlarged(margin(i)));
                search.pairs(collisions.surface, |pair, out| out.push(pair), candidates);
            }
        }
    }
}

impl Hit {
    fn constraint(&self) -> Constraint {
        Constraint { nodes: self.pair.nodes, weights: self.contact.weights, normal: self.contact.normal }
    }

    /// How far the pair has to open during the interval [m]: zero, unless it is closer than twice the gap. It opens slowly:
    /// a gap opened at once would throw the vertices of a short interval.
    fn opening(&self, collisions: &Collisions<'_>) -> f64 {
        let slowly = OPENING_RATE * collisions.duration * collisions.surface.edge_length()[self.pair.nodes[0] as usize];
        (OPEN_GAP * collisions.gap - self.start_distance).clamp(0.0, slowly)
    }
}

/// Whether a pair comes closer than `gap` on its way; less, if it is that close already.
fn meet(pair: &Pair, paths: &NodePaths, gap: f64) -> Option<Hit> {
    meet_at(pair, &pair.positions(&paths.start), &pair.positions(&paths.end), gap)
}

fn meet_at(pair: &Pair, start: &[Vec3; 4], end: &[Vec3; 4], gap: f64) -> Option<Hit> {
    let test = |gap: f64| match pair.kind {
        PairKind::PointTriangle => ccd::point_triangle(start, end, gap),
        PairKind::EdgeEdge => ccd::edge_edge(start, end, gap),
    };
    let contact = test(gap)?;
    let start_distance = pair.closest(start).apart.norm();
    if start_distance > gap {
        return Some(Hit { pair: *pair, contact, start_distance });
    }
    let contact = test(CLOSER_THAN_GAP * start_distance)?;
    Some(Hit { pair: *pair, contact, start_distance })
}

//! History-based repulsion: impulses between pairs that are close, in every short step (`docs/theory/self_contact.md#repulsion-with-history`);
//! forces of the same pairs in the solves of long ones ([`pair_forces`]).
//!
//! At a collision-free state every pair gets its *side*: which way it has to be apart. Until the next such state the
//! signed distance is measured against it. A pair that has passed through has a negative distance, and the same laws
//! that push others apart then pull it back: attraction.
//!
//! Every rank treats all pairs that it holds, and so its ghosts too, with the same operands and results as their
//! owners. What the pairs of a colour that it does not hold do to its ghosts comes after that colour (`colour_halo`).

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::bodies::constraints::{BodyConstraints, project_velocity};
use crate::contact::broad_phase::candidate_pair::CandidatePair;
use crate::contact::broad_phase::proximity_list::{ACTIVE, ProximityList};
use crate::contact::colouring::order::Order;
use crate::contact::repulsion::active_pair::{ActivePair, OrientedPair, PairsOfKind};
use crate::contact::repulsion::atomic_vectors::AtomicVectors;
use crate::contact::repulsion::colour_halo::{HaloPerColour, starts_of_sweeps};
use crate::contact::repulsion::pair_forces::{PairForce, PairStage, pair_forces};
use crate::contact::tolerances::TRUSTED_SIDE;
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::{Closest, KINDS, Pair, PairKind};
use crate::contact::topology::pair_friction::PairFriction;
use crate::metrics::Metrics;
use crate::scene::RepulsionPlace;
use crate::tolerances::NO_DIRECTION;

mod active_pair;
pub(crate) mod atomic_vectors;
mod colour_halo;
pub(crate) mod ghost_constraints;
pub(crate) mod pair_forces;

/// A Gauss-Seidel sweep through the pairs of one kind.
#[derive(Debug, Clone, Copy)]
struct Sweep {
    kind: PairKind,
    /// Whether its law is a spring's; that of the others is an inelastic impact's.
    is_elastic: bool,
}

/// The sweeps of a pass (`docs/theory/self_contact.md#repulsion-with-history`); without springs there are no elastic ones.
const SWEEPS: [Sweep; 8] = [
    Sweep { kind: PairKind::PointTriangle, is_elastic: false },
    Sweep { kind: PairKind::PointTriangle, is_elastic: false },
    Sweep { kind: PairKind::PointTriangle, is_elastic: false },
    Sweep { kind: PairKind::EdgeEdge, is_elastic: false },
    Sweep { kind: PairKind::EdgeEdge, is_elastic: false },
    Sweep { kind: PairKind::EdgeEdge, is_elastic: false },
    Sweep { kind: PairKind::PointTriangle, is_elastic: true },
    Sweep { kind: PairKind::EdgeEdge, is_elastic: true },
];

/// Pairs of one colour below which a second thread costs more than it brings.
const PARALLEL: usize = 512;

/// Pairs that one task looks at.
const CHUNK: usize = 1024;

/// Pieces of a list of pairs that are oriented at once.
const PIECES: usize = 64;

/// Size of the lists of sides up to which their memory is kept from step to step [bytes].
const KEPT_SIDES: usize = 16 << 20;

/// Bound on a distance, over the distance at which pairs act, from which on no rounding brings them to act.
const CERTAINLY_APART: f64 = 1.01;

/// Settings of the laws (`docs/theory/self_contact.md#repulsion-with-history`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Laws {
    /// Repulsion modulus E_r [N s²/(kg m) per unit of overlap; the authors' Young's modulus of repulsion].
    pub stiffness: f64,
    /// Largest fraction of the overlap that one step may restore.
    pub limit: f64,
    /// Coulomb friction between cloth and cloth.
    pub friction: f64,
    /// Cosine between the direction of two edges now and at the collision-free state below which they have passed
    /// through each other; below -1 edges never attract.
    pub edge_attraction: f64,
}

/// Passes that run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Passes {
    /// Inelastic and elastic, with friction: B.2.
    Full,
    /// Inelastic, with friction: B.8.
    WithoutSprings,
}

/// Input of the sweeps; arrays over this rank's nodes of cloth, ghosts included.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RepulsionStep<'a> {
    /// The numbering of the nodes.
    pub nodes: &'a ContactNodes,
    /// Length of the time step [s].
    pub dt: f64,
    /// Positions, the ghosts' as their owners have them [m].
    pub x: &'a [Vec3],
    /// Inverse masses, zero where a vertex is held [1/kg].
    pub mobility: &'a [f64],
    /// Friction where it differs from that of the laws.
    pub friction: PairFriction<'a>,
    /// Bodies that the nodes lie on; `None` where repulsion does not care.
    pub constraints: Option<&'a [BodyConstraints]>,
}

/// A law of `docs/theory/self_contact.md#repulsion-with-history`: the change of a pair's normal velocity [m/s], if it
/// acts, from that velocity.
type Law<'a> = dyn Fn(&ActivePair, f64) -> Option<f64> + Sync + 'a;

/// The repulsions of a scene.
#[derive(Debug)]
pub(crate) struct Repulsions {
    laws: Laws,
    place: RepulsionPlace,
    kinds: [PairsOfKind; 2],
    velocities: AtomicVectors,
    /// Load that bodies bear, as changes of velocities; only with supports.
    loads: AtomicVectors,
    /// Nodes of active pairs.
    nodes: Vec<u32>,
    seen: Vec<bool>,
    /// Messages between ranks during a pass.
    halo_per_colour: HaloPerColour,
    /// Active pairs canonical here, and those of them that have passed through each other.
    active: u64,
    inverted: u64,
    /// Whether the active pairs are those of the positions that come next.
    fresh: bool,
}

impl Repulsions {
    /// Repulsions without pairs yet; `place` is the part of a step in which they act.
    pub(crate) fn new(laws: Laws, place: RepulsionPlace) -> Self {
        let (kinds, velocities, loads) = (Default::default(), AtomicVectors::new(0), AtomicVectors::new(0));
        let (nodes, seen, halo_per_colour) = Default::default();
        Self {
            laws,
            place,
            kinds,
            velocities,
            loads,
            nodes,
            seen,
            halo_per_colour,
            active: 0,
            inverted: 0,
            fresh: false,
        }
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        let kind = |k: &PairsOfKind| {
            k.oriented.capacity() * size_of::<OrientedPair>()
                + k.active.capacity() * size_of::<ActivePair>()
                + k.damping_times.capacity() * size_of::<f32>()
        };
        let vectors = (self.velocities.count() + self.loads.count()) * size_of::<Vec3>();
        self.kinds.iter().map(kind).sum::<usize>() + vectors + self.seen.len()
    }

    /// A: gives every pair that may come within touching distance its side, at the collision-free positions `x` [m].
    /// `slack` is how far any two nodes may approach until the next collision-free state [m]; pairs for which `ignored`
    /// holds, by the scene's numbers of their nodes, get none.
    pub(crate) fn record_orientations(
        &mut self,
        nodes: &ContactNodes,
        proximity: &ProximityList,
        x: &[Vec3],
        slack: f64,
        ignored: &(impl Fn(&Pair) -> bool + Sync),
    ) {
        for kind in KINDS {
            let of_kind = &mut self.kinds[kind as usize];
            let near = |n: &CandidatePair| {
                let limit = ACTIVE * f64::from(n.thickness) + slack;
                if n.thickness <= 0.0 || proximity.distance_bound(n) > limit {
                    return None;
                }
                oriented(n, x, limit).filter(|s| !ignored(&nodes.numbered(&s.pair)))
            };
            of_kind.oriented.clear();
            // Some at a time: long lists are not in memory twice.
            for pieces in proximity.pieces(kind).chunks(PIECES) {
                let chunks = pieces.par_iter().flat_map(|piece| piece.par_chunks(CHUNK));
                let found: Vec<Vec<OrientedPair>> =
                    chunks.map(|chunk| chunk.iter().filter_map(|kept| near(&kept.of_kind(kind))).collect()).collect();
                of_kind.oriented.reserve_exact(found.iter().map(Vec::len).sum());
                found.into_iter().for_each(|found| of_kind.oriented.extend(found));
            }
        }
        if self.place == RepulsionPlace::Impulses {
            self.sort_by_colours(nodes);
        }
        self.fresh = false;
    }

    /// Puts the pairs of each kind into the order of their colours, no two pairs of which share a node, and in it by their nodes.
    fn sort_by_colours(&mut self, nodes: &ContactNodes) {
        self.kinds
            .iter_mut()
            .for_each(|of_kind| of_kind.oriented.par_sort_unstable_by_key(|oriented| oriented.pair.nodes));
        let lists = self.kinds.each_mut().map(|of_kind| &mut of_kind.oriented);
        let orders = Order::of(lists, nodes, |oriented| oriented.pair.nodes);
        self.kinds.iter_mut().zip(orders).for_each(|(of_kind, order)| of_kind.order = order);
    }

    /// Gives long lists of sides back, which nothing needs until they are recorded anew.
    pub(crate) fn release_sides(&mut self) {
        let bytes: usize =
            self.kinds.iter().map(|of_kind| of_kind.oriented.capacity() * size_of::<OrientedPair>()).sum();
        if bytes > KEPT_SIDES {
            self.kinds.iter_mut().for_each(|of_kind| (of_kind.oriented, of_kind.damping_times) = Default::default());
        }
    }

    /// Number of pairs canonical here that [`Repulsions::record_orientations`] gave a side.
    pub(crate) fn near(&self, nodes: &ContactNodes) -> u64 {
        let oriented = self.kinds.iter().flat_map(|of_kind| &of_kind.oriented);
        oriented.filter(|oriented| nodes.is_canonical_rank(&oriented.pair.nodes)).count() as u64
    }

    /// The positions have changed since the last pass.
    pub(crate) fn positions_changed(&mut self) {
        self.fresh = false;
    }

    /// B.2 or B.8: changes the velocities `v` [m/s], over this rank's nodes of cloth, of the nodes of all active pairs.
    /// Velocities of ghosts may have any value before, and are of no use after. With supports, velocities point into
    /// bodies afterwards by what these have to bear. All ranks call it together.
    pub(crate) fn apply(&mut self, passes: Passes, at: &RepulsionStep<'_>, v: &mut [Vec3], metrics: &mut Metrics) {
        if !self.fresh {
            self.refresh(at);
            self.fresh = true;
        }
        if self.nodes.is_empty() {
            return;
        }
        self.nodes.iter().for_each(|&node| self.velocities.set(node, &v[node as usize]));
        self.project_on_supports(at);
        self.halo_per_colour.before_sweeps(at.nodes.ranks(), &self.velocities);
        let dt = at.dt;
        let laws = self.laws;
        let with_springs = passes == Passes::Full;
        let sweeps = SWEEPS.into_iter().zip(starts_of_sweeps(&self.kinds));
        for (Sweep { kind, is_elastic }, start) in sweeps.filter(|(sweep, _)| with_springs || !sweep.is_elastic) {
            let law: &Law<'_> = if is_elastic {
                &|t, approach| laws.elastic_change(t, approach, dt)
            } else {
                &|t, approach| laws.inelastic_change(t, approach, dt)
            };
            self.sweep((kind, start), at, law);
        }
        self.nodes.iter().for_each(|&node| v[node as usize] = self.velocities.get(node));
        if at.constraints.is_some() {
            self.nodes.iter().for_each(|&node| v[node as usize] -= self.loads.get(node));
        }
        self.count(metrics);
    }

    /// The forces of all pairs in touch at a stage of a long step, in an order that the scene fixes; those canonical here are
    /// counted as the active ones.
    pub(crate) fn pair_forces(&mut self, at: &PairStage<'_>, before: &[PairForce]) -> Vec<PairForce> {
        let found = pair_forces(&mut self.kinds, &self.laws, at, before);
        (self.active, self.inverted) = (0, 0);
        for pair in found.iter().filter(|pair| at.surface.nodes().is_canonical_rank(&pair.nodes)) {
            self.active += 1;
            self.inverted += u64::from(pair.distance < 0.0);
        }
        found
    }

    /// Counts the active pairs of the last pass.
    pub(crate) fn count(&self, metrics: &mut Metrics) {
        metrics.count("repulsions", self.active - self.inverted);
        metrics.count("attractions", self.inverted);
    }

    /// Whether bodies have to bear something of what the last pass, which knew of them, did to a node.
    pub(crate) fn is_pressed(&self, node: u32) -> bool {
        self.seen.get(node as usize).is_some_and(|seen| *seen) && self.loads.get(node) != Vec3::zeros()
    }

    /// Number of active pairs canonical here that had passed through each other at the positions of the last pass.
    pub(crate) fn inverted(&self) -> u64 {
        self.inverted
    }

    /// Finds the active pairs and their geometry.
    fn refresh(&mut self, at: &RepulsionStep<'_>) {
        let laws = self.laws;
        for of_kind in &mut self.kinds {
            let PairsOfKind { oriented, order, active, active_order, .. } = of_kind;
            let of_chunk = |(chunk, pairs): (usize, &[OrientedPair])| -> Vec<(u32, ActivePair)> {
                let places = (chunk * CHUNK) as u32..;
                pairs.iter().zip(places).filter_map(|(pair, place)| Some((place, pair.active(&laws, at)?))).collect()
            };
            let pieces: Vec<_> = oriented.par_chunks(CHUNK).enumerate().map(of_chunk).collect();
            let places: Vec<u32> = pieces.iter().flatten().map(|(place, _)| *place).collect();
            active.clear();
            pieces.into_iter().for_each(|piece| active.extend(piece.into_iter().map(|(_, pair)| pair)));
            *active_order = order.restricted(&places);
        }
        self.nodes.iter().for_each(|&node| self.seen[node as usize] = false);
        self.nodes.clear();
        if self.seen.len() != at.nodes.cloth() {
            self.seen = vec![false; at.nodes.cloth()];
            self.velocities = AtomicVectors::new(at.nodes.cloth());
        }
        (self.active, self.inverted) = (0, 0);
        for pair in self.kinds.iter().flat_map(|of_kind| &of_kind.active) {
            let is_canonical = at.nodes.is_canonical_rank(&pair.nodes);
            self.active += u64::from(is_canonical);
            self.inverted += u64::from(is_canonical && pair.distance < 0.0);
            for node in pair.nodes {
                if !std::mem::replace(&mut self.seen[node as usize], true) {
                    self.nodes.push(node);
                }
            }
        }
        self.halo_per_colour = HaloPerColour::of(at.nodes, &self.kinds, &self.seen);
        self.halo_per_colour.put_first(&mut self.kinds);
    }

    /// Before the sweeps: nothing on a body moves into it any more.
    fn project_on_supports(&mut self, at: &RepulsionStep<'_>) {
        let Some(constraints) = at.constraints else { return };
        if self.loads.count() != at.nodes.cloth() {
            self.loads = AtomicVectors::new(at.nodes.cloth());
        }
        for &node in &self.nodes {
            let mut load = Vec3::zeros();
            self.velocities
                .set(node, &project_velocity(&constraints[node as usize], &self.velocities.get(node), &mut load));
            self.loads.set(node, &load);
        }
    }

    /// Gives a node the velocity that an impulse would; what bodies bear of it goes to its load.
    fn apply_impulse(&self, at: &RepulsionStep<'_>, node: u32, velocity: &Vec3) {
        let Some(constraints) = at.constraints else { return self.velocities.set(node, velocity) };
        let mut load = self.loads.get(node);
        self.velocities.set(node, &project_velocity(&constraints[node as usize], velocity, &mut load));
        self.loads.set(node, &load);
    }

    /// A sweep in the order of the colours, of which the first has the number `start` of those of all sweeps. `law` gives the change
    /// of the normal velocity that it wants, from that velocity.
    fn sweep(&self, (kind, start): (PairKind, usize), at: &RepulsionStep<'_>, law: &Law<'_>) {
        let of_kind = &self.kinds[kind as usize];
        let one = |t: &ActivePair| {
            let v = t.nodes.map(|node| self.velocities.get(node));
            let [a, b, c, d] = t.weights;
            let relative = v[0] * a + v[1] * b + v[2] * c + v[3] * d;
            let Some(change) = law(t, relative.dot(&t.normal)) else { return };
            let stiffer = at.constraints.map_or(1.0, |constraints| t.stiffer_on_bodies(constraints, at.mobility, &v));
            let impulse = self.laws.with_friction(t, &relative, change * stiffer) / t.response;
            for ((node, weight), v) in t.nodes.into_iter().zip(t.weights).zip(v) {
                let share = weight * at.mobility[node as usize];
                self.apply_impulse(at, node, &(v + impulse * share));
            }
        };
        let treat = |pairs: &[ActivePair]| {
            if pairs.len() >= PARALLEL {
                pairs.par_iter().with_min_len(PARALLEL / 4).for_each(one);
            } else {
                pairs.iter().for_each(one);
            }
        };
        for (number, colour) in of_kind.active_order.colours().iter().enumerate() {
            let pairs = &of_kind.active[colour.clone()];
            let place = (kind as usize, number, start + number);
            self.halo_per_colour.with_colour(at.nodes.ranks(), place, pairs, &self.velocities, treat);
        }
    }
}

/// The side of a pair at a collision-free state, unless it is farther apart than `limit` or next to each other rather
/// than in front of each other, where no side can be trusted.
fn oriented(neighbour: &CandidatePair, x: &[Vec3], limit: f64) -> Option<OrientedPair> {
    let pair = neighbour.pair;
    let at = pair.positions(x);
    let apart = pair.closest(&at).apart;
    let distance = apart.norm();
    if distance > limit || distance <= NO_DIRECTION {
        return None;
    }
    let across = match pair.kind {
        PairKind::PointTriangle => (at[2] - at[1]).cross(&(at[3] - at[1])),
        PairKind::EdgeEdge => (at[1] - at[0]).cross(&(at[3] - at[2])),
    };
    let along = across.try_normalize(NO_DIRECTION)?.dot(&apart);
    if along.abs() < TRUSTED_SIDE * distance {
        return None;
    }
    let start_distance = match pair.kind {
        PairKind::PointTriangle => distance.copysign(along),
        PairKind::EdgeEdge => distance,
    };
    Some(OrientedPair { pair, thickness: neighbour.thickness, start_distance, axis: apart / distance })
}

impl OrientedPair {
    /// Weights, normal and signed distance [m] of the pair at `x`, if its two are in front of each other and no farther apart
    /// than `reaches` [m]: before, and after they have passed through each other.
    #[inline]
    fn touch(&self, laws: &Laws, x: &[Vec3], reaches: [f64; 2]) -> Option<([f64; 4], Vec3, f64)> {
        let at = self.pair.positions(x);
        match self.pair.kind {
            PairKind::PointTriangle => self.point_triangle(&at, reaches),
            PairKind::EdgeEdge => self.edges(laws, &at, reaches),
        }
    }

    /// The pair at `x`, if it is within touching distance and in front of each other
    /// (`docs/theory/self_contact.md#repulsion-with-history`).
    #[inline]
    fn active(&self, laws: &Laws, step: &RepulsionStep<'_>) -> Option<ActivePair> {
        let reach = ACTIVE * self.thickness();
        // A bound that costs less than the distance: along the line of the closest points at A.
        if self.pair.distance_along(&self.pair.positions(step.x), &self.axis) > CERTAINLY_APART * reach {
            return None;
        }
        let (weights, normal, distance) = self.touch(laws, step.x, [reach; 2])?;
        let nodes = self.pair.nodes;
        // A held node takes its share of the impulse and stays: the others would be thrown where their weights are
        // small.
        let [a, b, c, d] = nodes.map(|node| step.mobility[node as usize]);
        let free = a.max(b).max(c).max(d);
        let (mut response, sum) = (0.0, a + b + c + d);
        for (own, w) in [a, b, c, d].into_iter().zip(weights) {
            response += w * w * if own > 0.0 { own } else { free };
        }
        let (thickness, mean_mobility) = (self.thickness(), 0.25 * sum);
        let friction = step.friction.of(laws.friction, nodes, weights);
        (response > 0.0).then_some(ActivePair {
            nodes,
            weights,
            normal,
            distance,
            thickness,
            response,
            mean_mobility,
            friction,
        })
    }

    #[inline]
    fn point_triangle(&self, x: &[Vec3; 4], reaches: [f64; 2]) -> Option<([f64; 4], Vec3, f64)> {
        let (ab, ac, ap) = (x[2] - x[1], x[3] - x[1], x[0] - x[1]);
        let across = ab.cross(&ac);
        let area = across.norm_squared();
        let height = ap.dot(&across);
        let side = self.start_distance.signum();
        let reach = reaches[usize::from(height * side < 0.0)];
        if height * height > reach * reach * area || area <= NO_DIRECTION {
            return None;
        }
        let (b, c) = (ap.cross(&ac).dot(&across), ab.cross(&ap).dot(&across));
        if b < 0.0 || c < 0.0 || b + c > area {
            return None;
        }
        let (wb, wc) = (b / area, c / area);
        let length = area.sqrt();
        Some(([1.0, wb + wc - 1.0, -wb, -wc], across * (side / length), height * side / length))
    }

    #[inline]
    fn edges(&self, laws: &Laws, x: &[Vec3; 4], [before, after]: [f64; 2]) -> Option<([f64; 4], Vec3, f64)> {
        let found = Closest::inside_edges(x)?;
        let squared = found.apart.norm_squared();
        if squared > before.max(after).powi(2) {
            return None;
        }
        let distance = squared.sqrt();
        let normal = if distance > NO_DIRECTION { found.apart / distance } else { self.axis };
        if normal.dot(&self.axis) < laws.edge_attraction {
            return (squared <= after * after).then_some((found.weights, -normal, -distance));
        }
        (squared <= before * before).then_some((found.weights, normal, distance))
    }
}

impl Laws {
    /// Approach speed that a pair may keep in a step [m/s] (`docs/theory/self_contact.md#repulsion-with-history`).
    fn speed_limit(&self, t: &ActivePair, dt: f64) -> f64 {
        self.limit / dt * (t.thickness - t.distance)
    }

    /// Returns the change of the relative velocity by the repulsion spring in a step [m/s].
    fn spring(&self, t: &ActivePair, dt: f64) -> f64 {
        dt * self.stiffness * t.mean_mobility / t.thickness * (t.thickness - t.distance).max(0.0)
    }

    /// Law (a): the repulsion spring.
    fn elastic_change(&self, t: &ActivePair, normal_velocity: f64, dt: f64) -> Option<f64> {
        let limit = self.speed_limit(t, dt);
        let change = || (limit - normal_velocity).min(self.spring(t, dt));
        (normal_velocity < limit).then(change)
    }

    /// Law (b): approach is stopped; pairs slightly apart may still approach slowly.
    fn inelastic_change(&self, t: &ActivePair, normal_velocity: f64, dt: f64) -> Option<f64> {
        let limit = if t.distance < t.thickness { 0.0 } else { self.speed_limit(t, dt) };
        let approaches = normal_velocity < 0.0 && normal_velocity < limit;
        approaches.then_some(limit - normal_velocity)
    }

    /// A change of the normal velocity, and with it law (c): Coulomb friction that this change bears. What other pairs of
    /// the same vertices have borne already is no load any more.
    fn with_friction(&self, t: &ActivePair, relative: &Vec3, change: f64) -> Vec3 {
        let tangential = relative - t.normal * relative.dot(&t.normal);
        let speed = tangential.norm();
        let share = if speed > NO_DIRECTION { (t.friction * change / speed).min(1.0) } else { 0.0 };
        t.normal * change - tangential * share
    }
}

#[cfg(test)]
mod tests;

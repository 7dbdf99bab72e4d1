//! Response to the pairs that meet, and the rank that gives it: impulses first, then impact zones.
//!
//! Pairs that hang together by nodes that can move are answered together, in the order of their nodes; others do not
//! concern them. Where all of that belongs to one rank it is *closed* and stays there. The rest is *open*: all ranks
//! receive it, the rank of its smallest node answers, and sends the answer to the others. An open zone stays open.

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::collisions::first_contact::first_contact;
use crate::contact::collisions::impact_zones::{Action, Collision, Motion, Zone, ZoneSolution, Zones};
use crate::contact::collisions::impulse::{change_normal_velocity, normal_velocity, response};
use crate::contact::collisions::messages::{MovedNode, Opened, ZoneAnswer};
use crate::contact::collisions::union_find::UnionFind;
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::Pair;
use crate::metrics::Metrics;
use crate::parallel::message;

/// Attempts with impulses alone. The authors make three, and ten or twenty in older scenes
/// (`docs/theory/self_contact.md#impact-zones`): most of what three leave are a handful of pairs that a few more end.
pub(super) const IMPULSE_ATTEMPTS: u32 = 6;

/// Attempts with inelastic zones; then those with a prescribed node follow it, and as many attempts follow.
const INELASTIC_ATTEMPTS: u32 = 12;

/// Attempts after which pairs with a prescribed node that did not move like the others of its zone are given up.
const DROP_FROM: u32 = IMPULSE_ATTEMPTS + INELASTIC_ATTEMPTS + INELASTIC_ATTEMPTS / 2;

/// Attempts after which zones are rigid.
const RIGID_FROM: u32 = IMPULSE_ATTEMPTS + 2 * INELASTIC_ATTEMPTS;

/// Attempts with rigid zones (`docs/theory/self_contact.md#impact-zones`).
const RIGID_ATTEMPTS: u32 = 8;

/// Attempts after which zones stay where they were.
const FREEZE_AFTER: u32 = RIGID_FROM + RIGID_ATTEMPTS;

/// Attempts after which what still meets is left alone: the loop ends also where a vertex that is held in some
/// directions is driven through something.
const LAST_ATTEMPT: u32 = FREEZE_AFTER + RIGID_ATTEMPTS + 50;

/// Positions and mobilities of the nodes of this rank.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kinematics<'a> {
    pub(super) nodes: &'a ContactNodes,
    /// Positions at the collision-free state [m].
    pub(super) start: &'a [Vec3],
    /// Inverse masses per axis [1/kg]; zero for what is prescribed.
    pub(super) mobility: &'a [Vec3],
    /// Distance that everything keeps [m].
    pub(super) gap: f64,
}

impl Kinematics<'_> {
    /// The local number of a node of a pair that is known here.
    fn local(&self, number: u32) -> u32 {
        self.nodes.local(number).expect("the nodes of canonical pairs are known")
    }

    fn motion(&self, number: u32, displacements: &[Vec3]) -> Motion {
        let node = self.local(number) as usize;
        Motion { start: self.start[node], displacement: displacements[node], mobility: self.mobility[node] }
    }
}

/// Pairs given up, and zones so far, of one loop of collisions.
#[derive(Debug, Default)]
pub(super) struct Response {
    /// Pairs canonical here that are left alone, ascending.
    given_up: Vec<Pair>,
    /// Zones of this rank alone.
    closed: Zones,
    /// Zones that all ranks keep, alike.
    open: Zones,
    /// Motions of the nodes of open pairs and zones, by their numbers in the scene; alike on all ranks.
    remote_motion: BTreeMap<u32, Motion>,
    /// Numbers of times that zones were carried, made rigid, and stopped, here.
    carried: u64,
    rigid: u64,
    stopped: u64,
    /// Nodes of stopped zones that were solved here.
    pub(super) stopped_nodes: Vec<u32>,
}

impl Response {
    /// Whether a pair canonical here is left alone: because it was given up, or because its nodes moved as one body.
    pub(super) fn leaves_alone(&self, collision: &Collision) -> bool {
        self.given_up.binary_search(&collision.pair).is_ok()
            || self.closed.are_rigid(collision)
            || self.open.are_rigid(collision)
    }

    /// Changes the displacements of own nodes to resolve the collisions, sorted, more firmly with every attempt;
    /// returns the nodes that may have changed, ascending. All ranks call it together.
    pub(super) fn respond(
        &mut self,
        kinematics: &Kinematics<'_>,
        attempt: u32,
        collisions: Vec<Collision>,
        displacements: &mut [Vec3],
        metrics: &mut Metrics,
    ) -> Vec<u32> {
        let collisions = self.drop_failed(kinematics, attempt, collisions);
        let (own, shared, opened) = self.exchange_open(kinematics, collisions, displacements);
        let mut touched = Vec::new();
        if attempt <= IMPULSE_ATTEMPTS {
            for collision in own {
                let places = collision.pair.nodes.map(|number| kinematics.local(number));
                let nodes =
                    CollidingNodes { start: kinematics.start, mobility: kinematics.mobility, gap: kinematics.gap };
                if impulse(&collision, places, &nodes, displacements) {
                    touched.extend(collision.moving().map(|number| kinematics.local(number)));
                }
            }
            self.shared_impulses(kinematics, &shared, displacements, &mut touched);
        } else {
            self.open.add(opened, attempt, &[]);
            let (own, shared) = self.drop_released(kinematics.nodes, attempt, own, shared);
            let active = [self.closed.add(Vec::new(), attempt, &own), self.open.add(Vec::new(), attempt, &shared)];
            self.zones(kinematics, attempt, &active, displacements, &mut touched, metrics);
        }
        touched.sort_unstable();
        touched.dedup();
        touched
    }

    /// Counts what there was; returns the nodes of zones, the pairs given up, and how often zones were stopped, on all ranks.
    pub(super) fn report(&self, nodes: &ContactNodes, metrics: &mut Metrics) -> [u64; 3] {
        let ranks = nodes.ranks();
        self.closed.report(metrics);
        if ranks.is_first() {
            self.open.report(metrics);
        }
        metrics.count("zones_carried", self.carried);
        metrics.count("zones_rigid", self.rigid);
        metrics.count("zone_fallbacks", self.stopped);
        metrics.count("pairs_pinched", self.given_up.len() as u64);
        let zone_nodes = self.closed.node_count() + if ranks.is_first() { self.open.node_count() } else { 0 };
        ranks.sum_of([zone_nodes, self.given_up.len() as u64, self.stopped])
    }

    /// Gives up what cannot be helped: pairs that no impulse can change, and after the last attempt all.
    fn drop_failed(&mut self, kinematics: &Kinematics<'_>, attempt: u32, collisions: Vec<Collision>) -> Vec<Collision> {
        let is_immovable = |collision: &Collision| {
            let constraint = collision.constraint(collision.pair.nodes.map(|number| kinematics.local(number)));
            response(&constraint, kinematics.mobility) == 0.0
        };
        let mark_failed = |collision: &Collision| attempt > LAST_ATTEMPT || is_immovable(collision);
        let (given_up, kept): (Vec<_>, Vec<_>) = collisions.into_iter().partition(mark_failed);
        self.mark_failed(given_up);
        kept
    }

    /// Gives up pairs with a prescribed node that touch a zone which has let go of these, and in late attempts those that touch
    /// a zone whose prescribed nodes did not move alike.
    fn drop_released(
        &mut self,
        nodes: &ContactNodes,
        attempt: u32,
        own: Vec<Collision>,
        shared: Vec<Collision>,
    ) -> (Vec<Collision>, Vec<Collision>) {
        let (closed, open) = (&self.closed, &self.open);
        let let_go = |zones: &Zones, collision: &Collision| {
            let lets_go = |zone: &Zone| zone.has_released_prescribed || (attempt > DROP_FROM && zone.was_carried);
            collision.has_prescribed() && zones.touched_by(collision, lets_go)
        };
        let (mut given_up, own): (Vec<_>, Vec<_>) = own.into_iter().partition(|collision| let_go(closed, collision));
        let (of_all, shared): (Vec<_>, Vec<_>) = shared.into_iter().partition(|collision| let_go(open, collision));
        let is_canonical =
            |collision: &Collision| collision.pair.nodes.into_iter().min().is_some_and(|number| nodes.owns(number));
        given_up.extend(of_all.into_iter().filter(is_canonical));
        self.mark_failed(given_up);
        (own, shared)
    }

    fn mark_failed(&mut self, collisions: Vec<Collision>) {
        if !collisions.is_empty() {
            self.given_up.extend(collisions.iter().map(|collision| collision.pair));
            self.given_up.sort_unstable();
        }
    }

    /// Sends open collisions, and the zones that they open, to all ranks. Returns the collisions that stay here, the
    /// open collisions of all ranks, in order, and the open zones.
    fn exchange_open(
        &mut self,
        kinematics: &Kinematics<'_>,
        collisions: Vec<Collision>,
        displacements: &[Vec3],
    ) -> (Vec<Collision>, Vec<Collision>, Vec<Zone>) {
        let nodes = kinematics.nodes;
        if nodes.ranks().is_alone() {
            return (collisions, Vec::new(), Vec::new());
        }
        let (own, collisions, zones) = self.split(nodes, collisions);
        let concerned =
            collisions.iter().flat_map(|collision| collision.pair.nodes).chain(zones.iter().flat_map(Zone::members));
        let motions = concerned.map(|number| (number, kinematics.motion(number, displacements))).collect();
        let opens = !collisions.is_empty() || !zones.is_empty();
        let opened = opens.then_some(Opened { collisions, zones, motions });
        let mut all = Opened::default();
        for opened in nodes.ranks().all_gather_encoded("open collisions and zones", opened.into_iter().collect()) {
            all.collisions.extend(opened.collisions);
            all.zones.extend(opened.zones);
            self.remote_motion.extend(opened.motions);
        }
        all.collisions.sort_unstable_by_key(|collision| collision.pair);
        (own, all.collisions, all.zones)
    }

    /// Splits the collisions into those that concern this rank alone and the others, and takes out the zones of this
    /// rank that concern others from now on.
    fn split(
        &mut self,
        nodes: &ContactNodes,
        collisions: Vec<Collision>,
    ) -> (Vec<Collision>, Vec<Collision>, Vec<Zone>) {
        let named = named_by_others(nodes, &collisions);
        let is_open = |number: &u32| {
            !nodes.owns(*number) || named.binary_search(number).is_ok() || self.open.of(*number).is_some()
        };
        let mut sets = UnionFind::default();
        let mut open_seeds = Vec::new();
        let mut push = |of: &mut dyn Iterator<Item = u32>| {
            let of: Vec<u32> = of.collect();
            open_seeds.push(of.iter().any(is_open));
            sets.push(of);
        };
        collisions.iter().for_each(|collision| push(&mut collision.moving()));
        self.closed.zones().iter().for_each(|zone| push(&mut zone.nodes.iter().copied()));
        let smallest = sets.representatives();
        let mut open: Vec<u32> = smallest.iter().zip(open_seeds).filter(|(_, open)| *open).map(|(s, _)| *s).collect();
        open.sort_unstable();
        open.dedup();
        let mut is_open = smallest.iter().map(|smallest| open.binary_search(smallest).is_ok());
        let (mut own, mut shared) = (Vec::new(), Vec::new());
        for (collision, is_open) in collisions.into_iter().zip(&mut is_open) {
            if is_open { &mut shared } else { &mut own }.push(collision);
        }
        let places: Vec<usize> = is_open.enumerate().filter(|(_, is_open)| *is_open).map(|(place, _)| place).collect();
        (own, shared, self.closed.take(&places))
    }

    /// One Gauss-Seidel pass over the open collisions, each by the rank of the smallest node of its component.
    fn shared_impulses(
        &mut self,
        kinematics: &Kinematics<'_>,
        shared: &[Collision],
        displacements: &mut [Vec3],
        touched: &mut Vec<u32>,
    ) {
        if shared.is_empty() {
            return;
        }
        let nodes = kinematics.nodes;
        let mut sets = UnionFind::default();
        shared.iter().for_each(|collision| sets.push(collision.moving()));
        let numbers: Vec<u32> = self.remote_motion.keys().copied().collect();
        let start: Vec<Vec3> = self.remote_motion.values().map(|motion| motion.start).collect();
        let mobility: Vec<Vec3> = self.remote_motion.values().map(|motion| motion.mobility).collect();
        let mut moved: Vec<Vec3> = self.remote_motion.values().map(|motion| motion.displacement).collect();
        let mut changed = Vec::new();
        for (collision, _) in shared.iter().zip(sets.representatives()).filter(|(_, smallest)| nodes.owns(*smallest)) {
            let place = |number: u32| numbers.partition_point(|n| *n < number) as u32;
            let nodes = CollidingNodes { start: &start, mobility: &mobility, gap: kinematics.gap };
            if impulse(collision, collision.pair.nodes.map(place), &nodes, &mut moved) {
                changed.extend(collision.moving().map(place));
            }
        }
        changed.sort_unstable();
        changed.dedup();
        let changed = changed.into_iter().map(|place| place as usize);
        let changed = changed.map(|place| MovedNode { number: numbers[place], displacement: moved[place] }).collect();
        for MovedNode { number, displacement } in nodes.ranks().all_gather_encoded("nodes of open collisions", changed)
        {
            if nodes.owns(number) {
                displacements[kinematics.local(number) as usize] = displacement;
                touched.push(kinematics.local(number));
            }
        }
    }

    /// Solves the closed and the open zones at these places, each by itself.
    fn zones(
        &mut self,
        kinematics: &Kinematics<'_>,
        attempt: u32,
        [closed, open]: &[Vec<usize>; 2],
        displacements: &mut [Vec3],
        touched: &mut Vec<u32>,
        metrics: &mut Metrics,
    ) {
        let mut tasks: Vec<Task<'_>> = Vec::new();
        for &place in closed {
            let zone = &self.closed.zones()[place];
            tasks.push(Task::new(zone, attempt, place, |number| kinematics.motion(number, displacements)));
        }
        for &place in open.iter().filter(|place| kinematics.nodes.owns(self.open.zones()[**place].nodes[0])) {
            let motion = |number: u32| self.remote_motion[&number];
            tasks.push(Task::new(&self.open.zones()[place], attempt, place, motion));
        }
        let mut solved: Vec<ZoneSolution> = tasks.par_iter().map(|task| task.solve(kinematics.gap)).collect();
        metrics.count("zone_sweeps", solved.iter().map(|answer| answer.solved.passes).sum());
        let count = |action| solved.iter().filter(|answer| answer.action == action).count() as u64;
        (self.carried, self.rigid) = (self.carried + count(Action::Carry), self.rigid + count(Action::Rigid));
        for answer in solved.iter().filter(|answer| answer.action == Action::Freeze) {
            self.stopped += 1;
            self.stopped_nodes.extend(&answer.members);
        }
        let shared = solved.split_off(closed.len());
        for answer in solved {
            answer.apply(kinematics, displacements, touched);
            self.closed.zone_mut(answer.place).note(answer.action, answer.solved.fails);
        }
        if open.is_empty() {
            return;
        }
        let (ranks, answers) = (kinematics.nodes.ranks(), shared.into_iter().map(ZoneAnswer::of).collect());
        for answer in ranks.all_gather_encoded(ZoneAnswer::NAME, answers) {
            let zones = self.open.zones();
            let place = message::index(ranks.rank(), ZoneAnswer::NAME, answer.place, zones.len());
            let solution = answer.solution(ranks.rank(), Task::members(&zones[place], attempt));
            for (number, displacement) in solution.moved() {
                self.remote_motion.entry(number).and_modify(|motion| motion.displacement = *displacement);
            }
            solution.apply(kinematics, displacements, touched);
            self.open.zone_mut(place).note(solution.action, solution.solved.fails);
        }
    }
}

/// A zone to be solved.
struct Task<'a> {
    zone: &'a Zone,
    place: usize,
    action: Action,
    members: Vec<u32>,
    motions: Vec<Motion>,
}

impl<'a> Task<'a> {
    fn new(zone: &'a Zone, attempt: u32, place: usize, motion: impl Fn(u32) -> Motion) -> Self {
        let (action, members) = Task::members(zone, attempt);
        let motions = members.iter().map(|number| motion(*number)).collect();
        Self { zone, place, action, members, motions }
    }

    /// Returns the action of a zone in an attempt, and the members of the zone.
    fn members(zone: &Zone, attempt: u32) -> (Action, Vec<u32>) {
        let is_due = zone.contradicts || attempt > IMPULSE_ATTEMPTS + INELASTIC_ATTEMPTS;
        let action = match attempt {
            ..=FREEZE_AFTER if is_due && !zone.was_carried && zone.has_prescribed() => Action::Carry,
            ..=RIGID_FROM if !zone.contradicts => Action::Inelastic,
            ..=FREEZE_AFTER => Action::Rigid,
            _ => Action::Freeze,
        };
        (action, zone.members())
    }

    fn solve(&self, gap: f64) -> ZoneSolution {
        let solved = self.zone.solve(self.action, &self.members, &self.motions, gap);
        let moves = self.motions.iter().map(|motion| motion.mobility != Vec3::zeros()).collect();
        ZoneSolution { place: self.place, action: self.action, members: self.members.clone(), moves, solved }
    }
}

impl ZoneSolution {
    /// Moves the own nodes among the members.
    fn apply(&self, kinematics: &Kinematics<'_>, displacements: &mut [Vec3], touched: &mut Vec<u32>) {
        for (number, displacement) in self.moved().filter(|(number, _)| kinematics.nodes.owns(*number)) {
            displacements[kinematics.local(number) as usize] = *displacement;
            touched.push(kinematics.local(number));
        }
    }
}

/// Nodes of collisions, in any numbering.
struct CollidingNodes<'a> {
    /// Positions at the collision-free state [m].
    start: &'a [Vec3],
    /// Inverse masses per axis [1/kg].
    mobility: &'a [Vec3],
    /// Distance that everything keeps [m].
    gap: f64,
}

/// Tests a collision again after the changes of those before it, and stops it if the pair still meets; returns whether
/// it does. A pair that meets but needs no change turns a lot, and has to be tested again. Nodes are at `places` of the
/// arrays.
fn impulse(collision: &Collision, places: [u32; 4], nodes: &CollidingNodes<'_>, displacements: &mut [Vec3]) -> bool {
    let CollidingNodes { start, mobility, gap } = *nodes;
    let start = places.map(|place| start[place as usize]);
    let end = [0, 1, 2, 3].map(|q| start[q] + displacements[places[q] as usize]);
    let Some((contact, _)) = first_contact(collision.pair.kind, &start, &end, gap) else { return false };
    let collision = Collision { weights: contact.weights, normal: contact.normal, ..*collision };
    let constraint = collision.constraint(places);
    let change = collision.target - normal_velocity(&constraint, displacements);
    if change > 0.0 {
        change_normal_velocity(&constraint, mobility, displacements, change);
    }
    true
}

/// Own nodes that collisions of other ranks name, by their numbers in the scene, ascending.
fn named_by_others(nodes: &ContactNodes, collisions: &[Collision]) -> Vec<u32> {
    let halo = nodes.halo();
    let ghosts = collisions.iter().flat_map(Collision::moving).filter(|number| !nodes.owns(*number));
    let mut ghosts: Vec<u32> = ghosts.filter_map(|number| nodes.local(number)).collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    let named_of = |range: &Range<usize>| {
        let place = |end: usize| ghosts.partition_point(|ghost| (*ghost as usize) < end);
        let named = &ghosts[place(range.start)..place(range.end)];
        named.iter().map(|ghost| ghost - range.start as u32).collect()
    };
    const NAME: &str = "nodes of collisions";
    let mut named = Vec::new();
    for ((_, list), places) in halo.sends().iter().zip(halo.send_to_owners::<u32>(nodes.ranks(), NAME, named_of)) {
        let place = |place: u32| message::index(nodes.ranks().rank(), NAME, place, list.len());
        named.extend(places.into_iter().map(|at| nodes.number(list[place(at)])));
    }
    named.sort_unstable();
    named.dedup();
    named
}

#[cfg(test)]
mod tests;

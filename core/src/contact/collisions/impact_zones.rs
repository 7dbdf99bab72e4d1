//! Impact zones as they grow during one loop of collisions: which pairs belong together, and what each zone does.
//!
//! A zone is all pairs that hang together by nodes that can move: what is prescribed is in many zones and joins none.
//! Zones only grow, each is solved by itself, and all numbers of nodes are those of the scene, so that it does not
//! matter which rank keeps it.

use std::collections::BTreeMap;

use crate::Vec3;
use crate::contact::collisions::impulse::Constraint;
use crate::contact::collisions::union_find::UnionFind;
use crate::contact::collisions::zone_solvers;
use crate::contact::collisions::zone_solvers::ZoneNode;
use crate::contact::tolerances::CARRIED;
use crate::contact::topology::pair::Pair;
use crate::metrics::Metrics;

/// Sizes of zones that are counted apart, in nodes.
const LARGE_ZONE: usize = 100;

/// A pair that meets on the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Collision {
    /// The pair, by the scene's numbers of its nodes.
    pub pair: Pair,
    /// Whether each of its nodes can move.
    pub moves: [bool; 4],
    /// Weights of the nodes in the relative displacement.
    pub weights: [f64; 4],
    /// Direction in which it separates.
    pub normal: Vec3,
    /// Relative displacement along the normal that it needs [m].
    pub target: f64,
}

impl Collision {
    /// Its nodes that can move.
    pub(crate) fn moving(&self) -> impl Iterator<Item = u32> {
        self.pair.nodes.into_iter().zip(self.moves).filter(|(_, moves)| *moves).map(|(node, _)| node)
    }

    /// Whether one of its nodes is prescribed.
    pub(crate) fn has_prescribed(&self) -> bool {
        self.moves.contains(&false)
    }

    /// Returns the constraint between the nodes, given by other numbers.
    pub(crate) fn constraint(&self, nodes: [u32; 4]) -> Constraint {
        Constraint { nodes, weights: self.weights, normal: self.normal }
    }
}

/// Motion of a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Motion {
    /// Position at the collision-free state [m].
    pub start: Vec3,
    /// Displacement since then [m].
    pub displacement: Vec3,
    /// Inverse mass per axis [1/kg]; zero for what is prescribed.
    pub mobility: Vec3,
}

/// Action of a zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Action {
    /// Everything may slide, but nothing approach.
    Inelastic,
    /// It follows what is prescribed in it.
    Carry,
    /// It moves as one body.
    Rigid,
    /// It stays where it was.
    Freeze,
}

/// Outcome of an action of a zone.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Solved {
    /// Displacement of each member [m].
    pub displacements: Vec<Vec3>,
    /// Passes over the pairs.
    pub passes: u64,
    /// Whether the action did not do. Inelastic: the pairs contradict each other, as between bodies that close, and impulses
    /// grow without end; the zone stays as it was. Carry: what is prescribed does not move alike, and pairs may still meet.
    pub fails: bool,
}

/// Pairs that hang together.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Zone {
    /// Nodes that can move of all pairs it ever had, ascending; the first stands for it.
    pub nodes: Vec<u32>,
    /// Its pairs, each with the attempt in which it met; ascending by attempt and pair.
    pub collisions: Vec<(u32, Collision)>,
    /// The nodes that last moved as one body, or with what is prescribed, ascending; none if they did not.
    pub rigid: Vec<u32>,
    /// Whether it has let go of what is prescribed, because its pairs contradicted each other.
    pub has_released_prescribed: bool,
    /// Whether its pairs contradict each other, so that it has to follow what is prescribed, or be rigid if nothing is.
    pub contradicts: bool,
    /// Whether it has followed what is prescribed, which did not move alike.
    pub was_carried: bool,
}

impl Zone {
    /// Nodes of its pairs, ascending.
    pub(crate) fn members(&self) -> Vec<u32> {
        let mut members: Vec<u32> = self.collisions.iter().flat_map(|(_, collision)| collision.pair.nodes).collect();
        members.sort_unstable();
        members.dedup();
        members
    }

    /// Whether one of its pairs has a prescribed node.
    pub(crate) fn has_prescribed(&self) -> bool {
        self.collisions.iter().any(|(_, collision)| collision.has_prescribed())
    }

    /// Applies the action to the members, which move like `motions`, and returns the outcome; `gap` is the distance that all
    /// pairs keep [m].
    pub(crate) fn solve(&self, action: Action, members: &[u32], motions: &[Motion], gap: f64) -> Solved {
        let mut displacements: Vec<Vec3> = motions.iter().map(|motion| motion.displacement).collect();
        let (mut passes, mut fails) = (0, false);
        match action {
            Action::Inelastic => {
                let place = |node: u32| members.partition_point(|member| *member < node) as u32;
                let constraints: Vec<_> = self
                    .collisions
                    .iter()
                    .map(|(_, collision)| collision.constraint(collision.pair.nodes.map(place)))
                    .collect();
                let targets: Vec<f64> = self.collisions.iter().map(|(_, collision)| collision.target).collect();
                let mobility: Vec<Vec3> = motions.iter().map(|motion| motion.mobility).collect();
                let outcome = zone_solvers::inelastic(&constraints, &targets, &mobility, &mut displacements);
                passes = outcome.iterations as u64;
                if !outcome.converged {
                    fails = true;
                    displacements = motions.iter().map(|motion| motion.displacement).collect();
                }
            }
            Action::Carry | Action::Rigid => {
                let node = |&Motion { start, displacement, mobility }: &Motion| ZoneNode {
                    start,
                    end: start + displacement,
                    mobility,
                };
                let mut nodes: Vec<ZoneNode> = motions.iter().map(node).collect();
                if action == Action::Carry {
                    fails = zone_solvers::carried(&mut nodes) > CARRIED * gap;
                } else {
                    zone_solvers::rigid(&mut nodes);
                }
                displacements = nodes.iter().map(|node| node.end - node.start).collect();
            }
            Action::Freeze => {
                for (displacement, motion) in displacements.iter_mut().zip(motions) {
                    displacement.component_mul_assign(&motion.mobility.map(|w| f64::from(w == 0.0)));
                }
            }
        }
        Solved { displacements, passes, fails }
    }

    /// Notes the outcome of an action.
    pub(crate) fn note(&mut self, action: Action, fails: bool) {
        let is_one_body = matches!(action, Action::Carry | Action::Rigid) && !fails;
        self.rigid = if is_one_body { self.members() } else { Vec::new() };
        if !fails {
            return;
        }
        if action == Action::Carry {
            // Near to where it may be: an inelastic solve from there has another chance.
            (self.was_carried, self.contradicts) = (true, false);
        } else if self.was_carried && self.has_prescribed() {
            self.collisions.retain(|(_, collision)| !collision.has_prescribed());
            self.has_released_prescribed = true;
        } else {
            self.contradicts = true;
        }
    }

    fn join(&mut self, other: Self) {
        if self.nodes.is_empty() {
            *self = other;
            return;
        }
        self.nodes.extend(other.nodes);
        self.collisions.extend(other.collisions);
        self.rigid.clear();
        self.has_released_prescribed |= other.has_released_prescribed;
        self.contradicts |= other.contradicts;
        self.was_carried |= other.was_carried;
    }
}

/// Solution of the zone at a place.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ZoneSolution {
    pub place: usize,
    pub action: Action,
    pub members: Vec<u32>,
    /// Whether each member can move.
    pub moves: Vec<bool>,
    pub solved: Solved,
}

impl ZoneSolution {
    /// The members that can move, and their displacements.
    pub(crate) fn moved(&self) -> impl Iterator<Item = (u32, &Vec3)> {
        let members = self.members.iter().zip(&self.moves).zip(&self.solved.displacements);
        members.filter(|((_, moves), _)| **moves).map(|((number, _), displacement)| (*number, displacement))
    }
}

/// Zones that share no node that can move.
#[derive(Debug, Default)]
pub(crate) struct Zones {
    /// In the order of their first nodes.
    zones: Vec<Zone>,
    /// Nodes that can move, ascending, each with the place of its zone.
    places: Vec<(u32, u32)>,
}

impl Zones {
    /// The zones, in the order of their first nodes.
    pub(crate) fn zones(&self) -> &[Zone] {
        &self.zones
    }

    /// One of them.
    pub(crate) fn zone_mut(&mut self, place: usize) -> &mut Zone {
        &mut self.zones[place]
    }

    /// The zone that a node which can move belongs to.
    pub(crate) fn of(&self, node: u32) -> Option<&Zone> {
        let found = self.places.binary_search_by_key(&node, |(node, _)| *node).ok()?;
        Some(&self.zones[self.places[found].1 as usize])
    }

    /// Whether a zone that the collision touches meets a condition.
    pub(crate) fn touched_by(&self, collision: &Collision, condition: impl Fn(&Zone) -> bool) -> bool {
        collision.moving().any(|node| self.of(node).is_some_and(&condition))
    }

    /// Whether the nodes of a collision have moved as one body, or with what is prescribed: they cannot have met.
    pub(crate) fn are_rigid(&self, collision: &Collision) -> bool {
        let zone = collision.moving().next().and_then(|node| self.of(node));
        zone.is_some_and(|zone| collision.pair.nodes.iter().all(|node| zone.rigid.binary_search(node).is_ok()))
    }

    /// Adds zones, and pairs that have met in an attempt; what hangs together becomes one. Returns the places of the
    /// zones that have got one of these pairs.
    pub(crate) fn add(&mut self, others: Vec<Zone>, attempt: u32, collisions: &[Collision]) -> Vec<usize> {
        if others.is_empty() && collisions.is_empty() {
            return Vec::new();
        }
        let before: Vec<Zone> = std::mem::take(&mut self.zones).into_iter().chain(others).collect();
        let mut sets = UnionFind::default();
        before.iter().for_each(|zone| sets.push(zone.nodes.iter().copied()));
        collisions.iter().for_each(|collision| sets.push(collision.moving()));
        let smallest = sets.representatives();
        let (of_zones, of_collisions) = smallest.split_at(before.len());
        let mut joined: BTreeMap<u32, (Zone, bool)> = BTreeMap::new();
        for (zone, first) in before.into_iter().zip(of_zones) {
            joined.entry(*first).or_default().0.join(zone);
        }
        for (collision, first) in collisions.iter().zip(of_collisions) {
            let (zone, collides) = joined.entry(*first).or_default();
            zone.nodes.extend(collision.moving());
            zone.collisions.push((attempt, *collision));
            *collides = true;
        }
        let mut active = Vec::new();
        for (place, (mut zone, collides)) in joined.into_values().enumerate() {
            zone.nodes.sort_unstable();
            zone.nodes.dedup();
            zone.collisions.sort_unstable_by_key(|(attempt, collision)| (*attempt, collision.pair));
            self.zones.push(zone);
            active.extend(collides.then_some(place));
        }
        self.note_places();
        active
    }

    /// Takes out zones, by their places, which ascend.
    pub(crate) fn take(&mut self, places: &[usize]) -> Vec<Zone> {
        if places.is_empty() {
            return Vec::new();
        }
        let all = std::mem::take(&mut self.zones).into_iter().enumerate();
        let (taken, kept): (Vec<_>, Vec<_>) = all.partition(|(place, _)| places.binary_search(place).is_ok());
        self.zones = kept.into_iter().map(|(_, zone)| zone).collect();
        self.note_places();
        taken.into_iter().map(|(_, zone)| zone).collect()
    }

    fn note_places(&mut self) {
        self.places.clear();
        for (zone, place) in self.zones.iter().zip(0..) {
            self.places.extend(zone.nodes.iter().map(|node| (*node, place)));
        }
        self.places.sort_unstable();
    }

    /// Nodes of all zones.
    pub(crate) fn node_count(&self) -> u64 {
        self.zones.iter().map(|zone| zone.members().len() as u64).sum()
    }

    /// Counts what there was.
    pub(crate) fn report(&self, metrics: &mut Metrics) {
        let sizes: Vec<usize> = self.zones.iter().map(|zone| zone.members().len()).filter(|size| *size > 0).collect();
        metrics.count("zones", sizes.len() as u64);
        metrics.count("zones_large", sizes.iter().filter(|size| **size > LARGE_ZONE).count() as u64);
        metrics.count("zone_nodes", sizes.iter().map(|size| *size as u64).sum());
    }
}

#[cfg(test)]
mod tests;

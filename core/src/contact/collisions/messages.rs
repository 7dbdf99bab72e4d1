//! Hits and zones as they travel between ranks.

use std::collections::BTreeMap;

use crate::contact::collisions::impact_zones::{Action, Collision, Motion, Solved, Zone};
use crate::contact::collisions::packing::{Packed, Unpacked};
use crate::contact::collisions::response::ZoneSolution;
use crate::contact::topology::pair::{KINDS, Pair};

impl Packed {
    /// A hit, with how its nodes move.
    pub(super) fn shared_hit(&mut self, hit: &Collision, motion: impl Fn(u32) -> Motion) {
        self.hit(hit);
        hit.pair.nodes.iter().for_each(|number| self.motion(&motion(*number)));
    }

    /// A zone, with how its members move.
    pub(super) fn zone(&mut self, zone: &Zone, motion: impl Fn(u32) -> Motion) {
        self.number(zone.has_released_prescribed);
        self.number(zone.contradicts);
        self.list(&zone.nodes, |packed, node| packed.number(*node));
        self.list(&zone.rigid, |packed, node| packed.number(*node));
        self.list(&zone.hits, |packed, (attempt, hit)| {
            packed.number(*attempt);
            packed.hit(hit);
        });
        self.list(&zone.members(), |packed, number| {
            packed.number(*number);
            packed.motion(&motion(*number));
        });
    }

    /// What came out of solving a zone; its members and what it did are known.
    pub(super) fn answer(&mut self, answer: &ZoneSolution) {
        self.number(answer.place as u64);
        self.number(answer.solved.contradicts);
        for (moves, displacement) in answer.moves.iter().zip(&answer.solved.displacements) {
            self.number(*moves);
            self.vector(displacement);
        }
    }

    fn hit(&mut self, hit: &Collision) {
        self.number(hit.pair.kind as u64);
        hit.pair.nodes.iter().for_each(|node| self.number(*node));
        hit.moves.iter().for_each(|moves| self.number(*moves));
        hit.weights.iter().for_each(|weight| self.float(*weight));
        self.vector(&hit.normal);
        self.float(hit.target);
    }

    fn motion(&mut self, motion: &Motion) {
        [motion.start, motion.displacement, motion.mobility].iter().for_each(|vector| self.vector(vector));
    }
}

impl Unpacked<'_> {
    /// A hit; how its nodes move is noted.
    pub(super) fn shared_hit(&mut self, remote_motion: &mut BTreeMap<u32, Motion>) -> Collision {
        let hit = self.hit();
        for number in hit.pair.nodes {
            remote_motion.insert(number, self.motion());
        }
        hit
    }

    /// A zone; how its members move is noted.
    pub(super) fn zone(&mut self, remote_motion: &mut BTreeMap<u32, Motion>) -> Zone {
        let [has_released_prescribed, contradicts] = [(); 2].map(|()| self.flag());
        let nodes = self.list(Self::node);
        let rigid = self.list(Self::node);
        let hits = self.list(|unpacked| (unpacked.number() as u32, unpacked.hit()));
        self.list(|unpacked| remote_motion.insert(unpacked.node(), unpacked.motion()));
        Zone { nodes, hits, rigid, has_released_prescribed, contradicts }
    }

    /// See [`Packed::answer`]; `known` tells what a zone did, and its members.
    pub(super) fn answer(&mut self, known: impl FnOnce(usize) -> (Action, Vec<u32>)) -> ZoneSolution {
        let (place, contradicts) = (self.number() as usize, self.flag());
        let (action, members) = known(place);
        let (moves, displacements) = members.iter().map(|_| (self.flag(), self.vector())).unzip();
        ZoneSolution { place, action, members, moves, solved: Solved { displacements, passes: 0, contradicts } }
    }

    fn hit(&mut self) -> Collision {
        let kind = KINDS[self.number() as usize];
        let nodes = [(); 4].map(|()| self.node());
        let moves = [(); 4].map(|()| self.flag());
        let weights = [(); 4].map(|()| self.float());
        let (normal, target) = (self.vector(), self.float());
        Collision { pair: Pair { kind, nodes }, moves, weights, normal, target }
    }

    fn motion(&mut self) -> Motion {
        let [start, displacement, mobility] = [(); 3].map(|()| self.vector());
        Motion { start, displacement, mobility }
    }
}

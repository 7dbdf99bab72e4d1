//! Hits and zones as they travel between ranks: words of 64 bits, read in the order in which they were written.

use std::collections::BTreeMap;

use crate::Vec3;
use crate::contact::geometric::response::Answer;
use crate::contact::pair::{KINDS, Pair};
use crate::contact::zones::{Action, Hit, Motion, Solved, Zone};

/// Words to be sent.
#[derive(Debug, Default)]
pub(super) struct Packed(Vec<u64>);

impl Packed {
    pub(super) fn words(&self) -> &[u64] {
        &self.0
    }

    pub(super) fn number(&mut self, number: u64) {
        self.0.push(number);
    }

    pub(super) fn vector(&mut self, vector: &Vec3) {
        self.0.extend(vector.iter().map(|x| x.to_bits()));
    }

    pub(super) fn list<T>(&mut self, list: &[T], mut each: impl FnMut(&mut Self, &T)) {
        self.number(list.len() as u64);
        list.iter().for_each(|item| each(self, item));
    }

    /// A hit, with how its nodes move.
    pub(super) fn shared_hit(&mut self, hit: &Hit, motion: impl Fn(u32) -> Motion) {
        self.hit(hit);
        hit.pair.nodes.iter().for_each(|number| self.motion(&motion(*number)));
    }

    /// A zone, with how its members move.
    pub(super) fn zone(&mut self, zone: &Zone, motion: impl Fn(u32) -> Motion) {
        self.number(zone.has_let_go.into());
        self.number(zone.contradicts.into());
        self.list(&zone.nodes, |packed, node| packed.number((*node).into()));
        self.list(&zone.rigid, |packed, node| packed.number((*node).into()));
        self.list(&zone.hits, |packed, (attempt, hit)| {
            packed.number((*attempt).into());
            packed.hit(hit);
        });
        self.list(&zone.members(), |packed, number| {
            packed.number((*number).into());
            packed.motion(&motion(*number));
        });
    }

    /// What came out of solving a zone; its members and what it did are known.
    pub(super) fn answer(&mut self, answer: &Answer) {
        self.number(answer.place as u64);
        self.number(answer.solved.contradicts.into());
        for (moves, displacement) in answer.moves.iter().zip(&answer.solved.displacements) {
            self.number((*moves).into());
            self.vector(displacement);
        }
    }

    fn hit(&mut self, hit: &Hit) {
        let [a, b, c, d] = hit.pair.nodes;
        let moves = hit.moves.iter().fold(0, |mask, moves| 2 * mask + u64::from(*moves));
        self.0.extend([hit.pair.kind as u64, a.into(), b.into(), c.into(), d.into(), moves]);
        self.0.extend(hit.weights.map(f64::to_bits));
        self.vector(&hit.normal);
        self.number(hit.target.to_bits());
    }

    fn motion(&mut self, motion: &Motion) {
        [motion.start, motion.displacement, motion.mobility].iter().for_each(|vector| self.vector(vector));
    }
}

/// Words that were received.
pub(super) struct Unpacked<'a>(&'a [u64]);

impl<'a> Unpacked<'a> {
    pub(super) fn new(words: &'a [u64]) -> Self {
        Self(words)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn number(&mut self) -> u64 {
        let (first, rest) = self.0.split_first().expect("a message is read as it was written");
        self.0 = rest;
        *first
    }

    fn float(&mut self) -> f64 {
        f64::from_bits(self.number())
    }

    pub(super) fn vector(&mut self) -> Vec3 {
        let [x, y, z] = [(); 3].map(|()| self.float());
        Vec3::new(x, y, z)
    }

    pub(super) fn list<T>(&mut self, mut each: impl FnMut(&mut Self) -> T) -> Vec<T> {
        let count = self.number();
        (0..count).map(|_| each(self)).collect()
    }

    /// A hit; how its nodes move is noted.
    pub(super) fn shared_hit(&mut self, told: &mut BTreeMap<u32, Motion>) -> Hit {
        let hit = self.hit();
        for number in hit.pair.nodes {
            told.insert(number, self.motion());
        }
        hit
    }

    /// A zone; how its members move is noted.
    pub(super) fn zone(&mut self, told: &mut BTreeMap<u32, Motion>) -> Zone {
        let [has_let_go, contradicts] = [(); 2].map(|()| self.number() != 0);
        let nodes = self.list(|unpacked| unpacked.number() as u32);
        let rigid = self.list(|unpacked| unpacked.number() as u32);
        let hits = self.list(|unpacked| (unpacked.number() as u32, unpacked.hit()));
        self.list(|unpacked| told.insert(unpacked.number() as u32, unpacked.motion()));
        Zone { nodes, hits, rigid, has_let_go, contradicts }
    }

    /// See [`Packed::answer`]; `known` tells what a zone did, and its members.
    pub(super) fn answer(&mut self, known: impl FnOnce(usize) -> (Action, Vec<u32>)) -> Answer {
        let (place, contradicts) = (self.number() as usize, self.number() != 0);
        let (action, members) = known(place);
        let (moves, displacements) = members.iter().map(|_| (self.number() != 0, self.vector())).unzip();
        Answer { place, action, members, moves, solved: Solved { displacements, passes: 0, contradicts } }
    }

    fn hit(&mut self) -> Hit {
        let kind = KINDS[self.number() as usize];
        let nodes = [(); 4].map(|()| self.number() as u32);
        let mask = self.number();
        let moves = [8, 4, 2, 1].map(|bit| mask & bit != 0);
        let weights = [(); 4].map(|()| self.float());
        let (normal, target) = (self.vector(), self.float());
        Hit { pair: Pair { kind, nodes }, moves, weights, normal, target }
    }

    fn motion(&mut self) -> Motion {
        let [start, displacement, mobility] = [(); 3].map(|()| self.vector());
        Motion { start, displacement, mobility }
    }
}

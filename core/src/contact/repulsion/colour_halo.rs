//! What ranks tell each other during the sweeps: after each colour, the velocities of nodes that somebody has a copy
//! of, in a pair that he does not hold.
//!
//! Both sides know beforehand what is told after which colour, for the pairs that are active: a colour that changes
//! nothing of this kind takes no message. The
//! pairs that change what is told go first, and the others while it is on its way.

use crate::Vec3;
use crate::contact::repulsion::active_contact::{ActiveContact, PairsOfKind};
use crate::contact::repulsion::atomic_vectors::AtomicVectors;
use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::communicator::{Exchange, Expected, Message};
use crate::parallel::message;
use crate::parallel::ranks::Ranks;

/// What is told when.
#[derive(Debug, Default)]
pub(super) struct HaloPerColour {
    /// Before the first sweep: all ghosts of active pairs.
    first: HaloExchange,
    /// After each colour of each kind.
    rounds: [Vec<HaloExchange>; 2],
}

/// Velocities told at one time; local nodes.
#[derive(Debug, Clone, Default)]
struct HaloExchange {
    /// How many active pairs of the colour change what is told; they stand first.
    ahead: usize,
    sends: Vec<(usize, Vec<u32>)>,
    receives: Vec<(usize, Vec<u32>)>,
}

impl HaloPerColour {
    /// The borders of pairs that are active, with a mark for each of their nodes. All ranks call it together.
    pub(super) fn of(nodes: &ContactNodes, kinds: &[PairsOfKind; 2], marked: &[bool]) -> Self {
        let halo = nodes.halo();
        if halo.is_empty() {
            return Self::default();
        }
        let (wanted, first) = wanted(nodes, marked);
        let near = near(nodes, kinds, &wanted);
        let mut rounds = [0, 1].map(|kind| vec![HaloExchange::default(); kinds[kind].live_order.colours().len()]);
        let mut messages = Vec::new();
        for ((to, list), wanted) in halo.sends().iter().zip(&wanted) {
            let words = announced_pairs(nodes, &near, (*to, list), wanted);
            for ([kind, colour], places) in Entries(&words) {
                let sent = places.iter().map(|place| list[*place as usize]).collect();
                rounds[kind][colour].sends.push((*to, sent));
            }
            messages.push(Message { to: *to, bytes: bytemuck::cast_slice(&words).to_vec() });
        }
        let expected = |(from, _): &(usize, _)| Expected { from: *from, length: None };
        let expected: Vec<Expected> = halo.receives().iter().map(expected).collect();
        let answers = nodes.ranks().start(messages, &expected).finish();
        for ((from, range), bytes) in halo.receives().iter().zip(answers) {
            let words: Vec<u32> = message::values(nodes.ranks().rank(), "places of active pairs", &bytes);
            for ([kind, colour], places) in Entries(&words) {
                let received = places.iter().map(|place| range.start as u32 + place).collect();
                rounds[kind][colour].receives.push((*from, received));
            }
        }
        Self { first, rounds }
    }

    /// Puts the active pairs that change what is told before the others of their colour.
    pub(super) fn put_first(&mut self, kinds: &mut [PairsOfKind; 2]) {
        for (rounds, of_kind) in self.rounds.iter_mut().zip(kinds) {
            let PairsOfKind { live, live_order, contacts, .. } = of_kind;
            for (round, range) in rounds.iter_mut().zip(live_order.colours()).filter(|(r, _)| !r.sends.is_empty()) {
                let mut sent: Vec<u32> = round.sends.iter().flat_map(|(_, list)| list).copied().collect();
                sent.sort_unstable();
                let is_announced =
                    |contacts: &ActiveContact| contacts.nodes.iter().any(|node| sent.binary_search(node).is_ok());
                let live = &mut live[range.clone()];
                let (ahead, rest): (Vec<u32>, Vec<u32>) =
                    live.iter().partition(|pair| contacts[**pair as usize].as_ref().is_some_and(is_announced));
                round.ahead = ahead.len();
                live[..ahead.len()].copy_from_slice(&ahead);
                live[ahead.len()..].copy_from_slice(&rest);
            }
        }
    }

    /// Gives the ghosts of active pairs their velocities.
    pub(super) fn before_sweeps(&self, ranks: &Ranks, velocities: &AtomicVectors) {
        if let Some(exchange) = self.first.start(ranks, velocities) {
            self.first.finish(ranks, exchange, velocities);
        }
    }

    /// Treats the pairs of a colour, and gives ghosts the velocities that it has changed elsewhere.
    pub(super) fn with_colour(
        &self,
        ranks: &Ranks,
        [kind, colour]: [usize; 2],
        live: &[u32],
        velocities: &AtomicVectors,
        treat: impl Fn(&[u32]),
    ) {
        let Some(round) = self.rounds[kind].get(colour) else { return treat(live) };
        let (ahead, rest) = live.split_at(round.ahead);
        treat(ahead);
        let exchange = round.start(ranks, velocities);
        treat(rest);
        if let Some(exchange) = exchange {
            round.finish(ranks, exchange, velocities);
        }
    }
}

impl HaloExchange {
    /// Sends the velocities as they are now.
    fn start<'a>(&self, ranks: &'a Ranks, velocities: &AtomicVectors) -> Option<Box<dyn Exchange + 'a>> {
        if self.sends.is_empty() && self.receives.is_empty() {
            return None;
        }
        let message = |(to, list): &(usize, Vec<u32>)| {
            let values: Vec<Vec3> = list.iter().map(|node| velocities.get(*node)).collect();
            Message { to: *to, bytes: bytemuck::cast_slice(&values).to_vec() }
        };
        let length = |list: &[u32]| size_of::<Vec3>() * list.len();
        let expected = |(from, list): &(usize, Vec<u32>)| Expected { from: *from, length: Some(length(list)) };
        let messages = self.sends.iter().map(message).collect();
        let expected: Vec<Expected> = self.receives.iter().map(expected).collect();
        Some(ranks.start(messages, &expected))
    }

    /// Waits for those of others.
    fn finish(&self, ranks: &Ranks, exchange: Box<dyn Exchange + '_>, velocities: &AtomicVectors) {
        for ((_, list), bytes) in self.receives.iter().zip(exchange.finish()) {
            let values: Vec<Vec3> = message::values(ranks.rank(), "velocities of active pairs", &bytes);
            list.iter().zip(&values).for_each(|(node, value)| velocities.set(*node, value));
        }
    }
}

/// Which of the nodes that it has copies of each rank has in active pairs: their places in the list of what is sent to
/// it, rank by rank as in the halo; and the round that gives all of them.
fn wanted(nodes: &ContactNodes, marked: &[bool]) -> (Vec<Vec<u32>>, HaloExchange) {
    let halo = nodes.halo();
    let is_wanted = |range: &std::ops::Range<usize>| marked[range.clone()].iter().map(|m| u8::from(*m)).collect();
    let ask = |(to, range): &(usize, _)| Message { to: *to, bytes: is_wanted(range) };
    let messages = halo.receives().iter().map(ask).collect();
    let asked = |(from, list): &(usize, Vec<u32>)| Expected { from: *from, length: Some(list.len()) };
    let asked: Vec<Expected> = halo.sends().iter().map(asked).collect();
    let answers = nodes.ranks().start(messages, &asked).finish();
    let places = |marks: &Vec<u8>| (0..marks.len() as u32).filter(|place| marks[*place as usize] != 0).collect();
    let wanted: Vec<Vec<u32>> = answers.iter().map(places).collect();
    let mut first = HaloExchange::default();
    for ((to, list), wanted) in halo.sends().iter().zip(&wanted).filter(|(_, wanted)| !wanted.is_empty()) {
        first.sends.push((*to, wanted.iter().map(|place| list[*place as usize]).collect()));
    }
    for (from, range) in halo.receives() {
        let ghosts: Vec<u32> = range.clone().filter(|node| marked[*node]).map(|node| node as u32).collect();
        if !ghosts.is_empty() {
            first.receives.push((*from, ghosts));
        }
    }
    (wanted, first)
}

/// Kind and colour, and nodes, of the active pairs that have a node which somebody wants; in the order of the sweeps.
fn near(nodes: &ContactNodes, kinds: &[PairsOfKind; 2], wanted: &[Vec<u32>]) -> Vec<([u32; 2], [u32; 4])> {
    let mut watched = vec![false; nodes.cloth()];
    for ((_, list), wanted) in nodes.halo().sends().iter().zip(wanted) {
        wanted.iter().for_each(|place| watched[list[*place as usize] as usize] = true);
    }
    let mut near = Vec::new();
    for (kind, of_kind) in kinds.iter().enumerate() {
        for (colour, range) in of_kind.live_order.colours().iter().enumerate() {
            let active = of_kind.live[range.clone()].iter().filter_map(|&i| of_kind.contacts[i as usize].as_ref());
            let watched = active.filter(|t| t.nodes.iter().any(|node| watched[*node as usize]));
            near.extend(watched.map(|t| ([kind as u32, colour as u32], t.nodes)));
        }
    }
    near
}

/// What the rank `to` is told, which has copies of the nodes in `list`, as [`Entries`]: those that it wants, in pairs
/// that it does not hold.
fn announced_pairs(
    nodes: &ContactNodes,
    near: &[([u32; 2], [u32; 4])],
    (to, list): (usize, &[u32]),
    wanted: &[u32],
) -> Vec<u32> {
    let received = nodes.halo().receives().iter().find(|(from, _)| *from == to);
    let theirs = received.map_or(0..0, |(_, range)| range.clone());
    let mut place_of: Vec<(u32, u32)> = wanted.iter().map(|place| (list[*place as usize], *place)).collect();
    place_of.sort_unstable();
    let mut words = Vec::new();
    for same in near.chunk_by(|a, b| a.0 == b.0) {
        let not_held = same.iter().filter(|(_, of)| !of.iter().any(|node| theirs.contains(&(*node as usize))));
        let place = |node: &u32| place_of.binary_search_by_key(node, |(n, _)| *n).ok();
        let places: Vec<u32> = not_held.flat_map(|(_, of)| of).filter_map(place).map(|i| place_of[i].1).collect();
        if !places.is_empty() {
            let [kind, colour] = same[0].0;
            words.extend([kind, colour, places.len() as u32]);
            words.extend(places);
        }
    }
    words
}

/// Entries of a message: kind, colour, how many, and so many places.
struct Entries<'a>(&'a [u32]);

impl<'a> Iterator for Entries<'a> {
    type Item = ([usize; 2], &'a [u32]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let [kind, colour, count, rest @ ..] = self.0 else { unreachable!("a message holds whole entries") };
        let (places, rest) = rest.split_at(*count as usize);
        self.0 = rest;
        Some(([*kind as usize, *colour as usize], places))
    }
}

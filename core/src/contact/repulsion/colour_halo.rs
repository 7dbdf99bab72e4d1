//! Messages between ranks during the sweeps: after each colour, the velocities of nodes of which another rank has a
//! copy, in a pair that this other rank does not hold.
//!
//! Both sides know beforehand what is sent after which colour, for the pairs that are active: a colour that changes
//! nothing of this kind takes no message. The
//! pairs that change what is sent go first, and the others while it is on its way.

use std::ops::Range;

use crate::Vec3;
use crate::contact::repulsion::active_pair::{ActivePair, PairsOfKind};
use crate::contact::repulsion::atomic_vectors::AtomicVectors;
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::{KINDS, PairKind};
use crate::parallel::communicator::{Exchange, Expected, Message};
use crate::parallel::message::{self, codec};
use crate::parallel::ranks::Ranks;

/// Schedule of the velocity exchanges.
#[derive(Debug, Default)]
pub(super) struct HaloPerColour {
    /// Before the first sweep: all ghosts of active pairs.
    first: HaloExchange,
    /// After each colour of each kind.
    rounds: [Vec<HaloExchange>; 2],
}

/// Velocities sent at one time; local nodes.
#[derive(Debug, Clone, Default)]
struct HaloExchange {
    /// Number of active pairs of the colour that change the velocities sent; they stand first.
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
        let mut lists = Vec::new();
        for ((to, list), wanted) in halo.sends().iter().zip(&wanted) {
            let announced = announced_pairs(nodes, &near, *to, list, wanted);
            for Announced { kind, colour, places } in &announced {
                let sent = places.iter().map(|place| list[*place as usize]).collect();
                rounds[*kind as usize][*colour as usize].sends.push((*to, sent));
            }
            lists.push(announced);
        }
        let (ranks, rank) = (nodes.ranks(), nodes.ranks().rank());
        let received = halo.tell_holders_encoded(ranks, Announced::NAME, &lists);
        for ((from, range), announced) in halo.receives().iter().zip(received) {
            for Announced { kind, colour, places } in announced {
                let rounds = &mut rounds[kind as usize];
                let colour = message::index(rank, Announced::NAME, colour, rounds.len());
                let place = |place| range.start + message::index(rank, Announced::NAME, place, range.len());
                let ghosts = places.into_iter().map(|at| place(at) as u32).collect();
                rounds[colour].receives.push((*from, ghosts));
            }
        }
        Self { first, rounds }
    }

    /// Puts the active pairs that change what is sent before the others of their colour.
    pub(super) fn put_first(&mut self, kinds: &mut [PairsOfKind; 2]) {
        for (rounds, of_kind) in self.rounds.iter_mut().zip(kinds) {
            let PairsOfKind { live, live_order, contacts, .. } = of_kind;
            for (round, range) in rounds.iter_mut().zip(live_order.colours()).filter(|(r, _)| !r.sends.is_empty()) {
                let mut sent: Vec<u32> = round.sends.iter().flat_map(|(_, list)| list).copied().collect();
                sent.sort_unstable();
                let is_announced =
                    |contacts: &ActivePair| contacts.nodes.iter().any(|node| sent.binary_search(node).is_ok());
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
        let values = |list: &[u32]| list.iter().map(|node| velocities.get(*node)).collect::<Vec<Vec3>>();
        let message = |(to, list): &(usize, Vec<u32>)| Message::of_rows(*to, &values(list));
        let length = |list: &[u32]| size_of::<Vec3>() * list.len();
        let expected = |(from, list): &(usize, Vec<u32>)| Expected { from: *from, length: Some(length(list)) };
        let messages = self.sends.iter().map(message).collect();
        let expected: Vec<Expected> = self.receives.iter().map(expected).collect();
        Some(ranks.start(messages, &expected))
    }

    /// Waits for those of others.
    fn finish(&self, ranks: &Ranks, exchange: Box<dyn Exchange + '_>, velocities: &AtomicVectors) {
        for ((_, list), bytes) in self.receives.iter().zip(exchange.finish()) {
            let mut values = vec![Vec3::zeros(); list.len()];
            message::copy_rows(ranks.rank(), "velocities of active pairs", &bytes, &mut values);
            list.iter().zip(&values).for_each(|(node, value)| velocities.set(*node, value));
        }
    }
}

/// Finds the nodes that each rank has copies of and has in active pairs: their places in the list of nodes sent to
/// it, rank by rank as in the halo; and the round that gives all of them.
fn wanted(nodes: &ContactNodes, marked: &[bool]) -> (Vec<Vec<u32>>, HaloExchange) {
    let halo = nodes.halo();
    let marks = |range: &Range<usize>| marked[range.clone()].iter().map(|m| u8::from(*m)).collect();
    let answers = halo.tell_owners::<u8>(nodes.ranks(), "nodes of active pairs", marks);
    let wanted: Vec<Vec<u32>> =
        halo.sends().iter().zip(answers).map(|((_, list), marks)| places(nodes, list, &marks)).collect();
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

/// The places that are marked in a list, which has as many.
fn places(nodes: &ContactNodes, list: &[u32], marks: &[u8]) -> Vec<u32> {
    if marks.len() != list.len() {
        let what = format_args!("{} of {} nodes are marked", marks.len(), list.len());
        message::is_broken(nodes.ranks().rank(), "nodes of active pairs", what);
    }
    (0..).zip(marks).filter(|(_, mark)| **mark != 0).map(|(place, _)| place).collect()
}

/// An active pair that has a node which somebody wants.
struct NearPair {
    kind: PairKind,
    colour: u32,
    nodes: [u32; 4],
}

/// The active pairs that have a node which somebody wants, in the order of the sweeps.
fn near(nodes: &ContactNodes, kinds: &[PairsOfKind; 2], wanted: &[Vec<u32>]) -> Vec<NearPair> {
    let mut watched = vec![false; nodes.cloth()];
    for ((_, list), wanted) in nodes.halo().sends().iter().zip(wanted) {
        wanted.iter().for_each(|place| watched[list[*place as usize] as usize] = true);
    }
    let mut near = Vec::new();
    for (kind, of_kind) in KINDS.into_iter().zip(kinds) {
        for (colour, range) in (0..).zip(of_kind.live_order.colours()) {
            let active = of_kind.live[range.clone()].iter().filter_map(|&i| of_kind.contacts[i as usize].as_ref());
            let watched = active.filter(|t| t.nodes.iter().any(|node| watched[*node as usize]));
            near.extend(watched.map(|t| NearPair { kind, colour, nodes: t.nodes }));
        }
    }
    near
}

/// Nodes that a rank has copies of and that change in the pairs of a colour.
struct Announced {
    kind: PairKind,
    colour: u32,
    /// Places in the list of what is sent to the rank.
    places: Vec<u32>,
}

codec!(struct Announced { kind, colour, places });

impl Announced {
    /// The report of a broken message says.
    const NAME: &str = "places of active pairs";
}

/// Lists the nodes sent to the rank `to`, which has copies of the nodes in `list`: the nodes that it wants, in pairs
/// that it does not hold.
fn announced_pairs(nodes: &ContactNodes, near: &[NearPair], to: usize, list: &[u32], wanted: &[u32]) -> Vec<Announced> {
    let received = nodes.halo().receives().iter().find(|(from, _)| *from == to);
    let theirs = received.map_or(0..0, |(_, range)| range.clone());
    let mut place_of: Vec<(u32, u32)> = wanted.iter().map(|place| (list[*place as usize], *place)).collect();
    place_of.sort_unstable();
    let place = |node: &u32| place_of.binary_search_by_key(node, |(n, _)| *n).ok();
    let announced = |same: &[NearPair]| {
        let not_held = same.iter().filter(|pair| !pair.nodes.iter().any(|node| theirs.contains(&(*node as usize))));
        let places = not_held.flat_map(|pair| &pair.nodes).filter_map(place).map(|i| place_of[i].1).collect();
        Announced { kind: same[0].kind, colour: same[0].colour, places }
    };
    let colours = near.chunk_by(|a, b| (a.kind, a.colour) == (b.kind, b.colour));
    colours.map(announced).filter(|announced| !announced.places.is_empty()).collect()
}

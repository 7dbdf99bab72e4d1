//! Messages between ranks during the sweeps: velocities of nodes of which another rank has a copy, changed by a pair that this other
//! rank does not hold.
//!
//! A copy needs such a velocity before the next pair of its rank reads it. So there is an interval of colours after any of which it can
//! be sent: from the last change to the colour before that pair. Two ranks tell each other the intervals of both directions and find, by
//! the same rule, the fewest rounds that meet all of them (earliest end first: J. Kleinberg, E. Tardos, Algorithm Design, 4.1). Where a
//! rank sends after a colour, the pairs that change what is sent go first, and the others while it is on its way.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::Vec3;
use crate::contact::repulsion::active_pair::{ActivePair, PairsOfKind};
use crate::contact::repulsion::atomic_vectors::AtomicVectors;
use crate::contact::repulsion::{SWEEPS, Sweep};
use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::communicator::{Exchange, Expected, Message};
use crate::parallel::message::{self, codec};
use crate::parallel::ranks::Ranks;

/// Schedule of the velocity exchanges.
#[derive(Debug, Default)]
pub(super) struct HaloPerColour {
    /// Before the first sweep: all ghosts of active pairs.
    first: HaloExchange,
    /// After each colour of each sweep, one sweep behind the other; none where nothing is ever exchanged.
    rounds: Vec<HaloExchange>,
    /// Numbers of active pairs of each colour of each kind that change the velocities sent after it in some sweep; they stand first.
    ahead: [Vec<usize>; 2],
}

/// Velocities sent at one time; local nodes.
#[derive(Debug, Clone, Default)]
struct HaloExchange {
    sends: Vec<(usize, Vec<u32>)>,
    receives: Vec<(usize, Vec<u32>)>,
}

/// When a copy of a node has to get its velocity: after a colour from `from` on, before the colour `until`. Colours are counted from
/// the first one of the first sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Interval {
    /// Place in the list of what is sent to the rank.
    place: u32,
    from: u32,
    until: u32,
}

codec!(struct Interval { place, from, until });

impl Interval {
    /// Name of the message in the error of a damaged one.
    const NAME: &str = "intervals of velocities";
}

/// Intervals of both directions between this rank and another.
#[derive(Debug, Default)]
struct Between {
    sent: Vec<Interval>,
    received: Vec<Interval>,
}

impl HaloPerColour {
    /// The borders of pairs that are active, with a mark for each of their nodes. All ranks call it together.
    pub(super) fn of(nodes: &ContactNodes, kinds: &[PairsOfKind; 2], marked: &[bool]) -> Self {
        let halo = nodes.halo();
        if halo.is_empty() {
            return Self::default();
        }
        let starts = starts_of_sweeps(kinds);
        let colours = starts[SWEEPS.len()];
        let events = Events::of(nodes, kinds);
        let (mut first, mut rounds) = (HaloExchange::default(), vec![HaloExchange::default(); colours]);
        let mut lists = Vec::new();
        for (to, list) in halo.sends() {
            let (wanted, intervals) = events.sent_to(nodes, (*to, list.as_slice()), &starts);
            if !wanted.is_empty() {
                first.sends.push((*to, wanted));
            }
            lists.push(intervals);
        }
        let received = halo.send_to_ghost_ranks(nodes.ranks(), Interval::NAME, &lists);
        let mut between: BTreeMap<usize, Between> = BTreeMap::new();
        for ((to, _), sent) in halo.sends().iter().zip(lists) {
            between.entry(*to).or_default().sent = sent;
        }
        for ((from, range), received) in halo.receives().iter().zip(received) {
            received.iter().for_each(|interval| interval.check(nodes.ranks().rank(), range.len(), colours));
            between.entry(*from).or_default().received = received;
            let ghosts: Vec<u32> = range.clone().filter(|node| marked[*node]).map(|node| node as u32).collect();
            if !ghosts.is_empty() {
                first.receives.push((*from, ghosts));
            }
        }
        for (other, Between { sent, received }) in between {
            let times = fewest_rounds(sent.iter().chain(&received));
            if let Some((_, list)) = halo.sends().iter().find(|(to, _)| *to == other) {
                put(&mut rounds, &times, sent, |round| &mut round.sends, (other, |place| list[place as usize]));
            }
            if let Some((_, range)) = halo.receives().iter().find(|(from, _)| *from == other) {
                let ghost = |place| range.start as u32 + place;
                put(&mut rounds, &times, received, |round| &mut round.receives, (other, ghost));
            }
        }
        Self { first, rounds, ahead: Default::default() }
    }

    /// Puts the active pairs that change what is sent before the others of their colour.
    pub(super) fn put_first(&mut self, kinds: &mut [PairsOfKind; 2]) {
        if self.rounds.is_empty() {
            return;
        }
        let starts = starts_of_sweeps(kinds);
        for (kind, (ahead, of_kind)) in self.ahead.iter_mut().zip(kinds).enumerate() {
            let PairsOfKind { active, active_order, .. } = of_kind;
            for (colour, range) in active_order.colours().iter().enumerate() {
                let of_kind = SWEEPS.iter().zip(starts).filter(|(sweep, _)| sweep.kind as usize == kind);
                let rounds = of_kind.map(|(_, start)| &self.rounds[start + colour]);
                let mut sent: Vec<u32> =
                    rounds.flat_map(|round| &round.sends).flat_map(|(_, list)| list).copied().collect();
                sent.sort_unstable();
                let is_sent = |pair: &ActivePair| pair.nodes.iter().any(|node| sent.binary_search(node).is_ok());
                let pairs = &mut active[range.clone()];
                let (first, rest): (Vec<ActivePair>, Vec<ActivePair>) = pairs.iter().partition(|pair| is_sent(pair));
                ahead.push(first.len());
                pairs[..first.len()].copy_from_slice(&first);
                pairs[first.len()..].copy_from_slice(&rest);
            }
        }
    }

    /// Gives the ghosts of active pairs their velocities.
    pub(super) fn before_sweeps(&self, ranks: &Ranks, velocities: &AtomicVectors) {
        if let Some(exchange) = self.first.start(ranks, velocities) {
            self.first.finish(ranks, exchange, velocities);
        }
    }

    /// Treats the pairs of a colour of a sweep, the one with the number `place` of all colours of all sweeps, and gives ghosts the
    /// velocities that have changed elsewhere.
    pub(super) fn with_colour(
        &self,
        ranks: &Ranks,
        (kind, colour, place): (usize, usize, usize),
        pairs: &[ActivePair],
        velocities: &AtomicVectors,
        treat: impl Fn(&[ActivePair]),
    ) {
        let round = self.rounds.get(place).filter(|round| !round.is_empty());
        let Some(round) = round else { return treat(pairs) };
        let (ahead, rest) = pairs.split_at(self.ahead[kind][colour]);
        treat(ahead);
        let exchange = round.start(ranks, velocities);
        treat(rest);
        if let Some(exchange) = exchange {
            round.finish(ranks, exchange, velocities);
        }
    }
}

/// First colour of each sweep, of all colours one sweep behind the other, and their number at the end.
pub(super) fn starts_of_sweeps(kinds: &[PairsOfKind; 2]) -> [usize; SWEEPS.len() + 1] {
    let mut starts = [0; SWEEPS.len() + 1];
    for (sweep, Sweep { kind, .. }) in SWEEPS.iter().enumerate() {
        starts[sweep + 1] = starts[sweep] + kinds[*kind as usize].active_order.colours().len();
    }
    starts
}

impl HaloExchange {
    fn is_empty(&self) -> bool {
        self.sends.is_empty() && self.receives.is_empty()
    }

    /// Sends the velocities as they are now.
    fn start<'a>(&self, ranks: &'a Ranks, velocities: &AtomicVectors) -> Option<Box<dyn Exchange + 'a>> {
        if self.is_empty() {
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

impl Interval {
    /// Makes sure that an interval to this rank names one of `count` ghosts, and a time between two of `colours` colours.
    fn check(&self, rank: usize, count: usize, colours: usize) {
        message::index(rank, Self::NAME, self.place, count);
        let until = message::index(rank, Self::NAME, self.until, colours);
        message::index(rank, Self::NAME, self.from, until);
    }
}

/// An active pair at an own node of which another rank has a copy.
struct Event {
    node: u32,
    kind: usize,
    colour: usize,
    /// All nodes of the pair.
    nodes: [u32; 4],
}

/// The active pairs at each own node of which another rank has a copy, in the order of a sweep.
struct Events(Vec<Event>);

impl Events {
    fn of(nodes: &ContactNodes, kinds: &[PairsOfKind; 2]) -> Self {
        let mut is_sent = vec![false; nodes.cloth()];
        nodes.halo().sends().iter().flat_map(|(_, list)| list).for_each(|node| is_sent[*node as usize] = true);
        let mut all = Vec::new();
        for (kind, of_kind) in kinds.iter().enumerate() {
            for (colour, range) in of_kind.active_order.colours().iter().enumerate() {
                for pair in &of_kind.active[range.clone()] {
                    let sent = pair.nodes.into_iter().filter(|node| is_sent[*node as usize]);
                    all.extend(sent.map(|node| Event { node, kind, colour, nodes: pair.nodes }));
                }
            }
        }
        // Stable: the order of a sweep stays.
        all.sort_by_key(|event| event.node);
        Self(all)
    }

    /// Returns the nodes of a list, those that a rank has copies of, that are in active pairs which it holds, and the intervals in which
    /// it needs their velocities. It holds a pair if it owns one of its nodes, which then has a copy here.
    fn sent_to(
        &self,
        nodes: &ContactNodes,
        (to, list): (usize, &[u32]),
        starts: &[usize; SWEEPS.len() + 1],
    ) -> (Vec<u32>, Vec<Interval>) {
        let theirs = nodes.halo().receives().iter().find(|(from, _)| *from == to);
        let theirs = theirs.map_or(0..0, |(_, range)| range.clone());
        let is_held = |event: &Event| event.nodes.iter().any(|node| theirs.contains(&(*node as usize)));
        let (mut wanted, mut intervals) = (Vec::new(), Vec::new());
        for (place, node) in (0..).zip(list) {
            let first = self.0.partition_point(|event| event.node < *node);
            let of_node: Vec<(usize, usize, bool)> = self.0[first..]
                .iter()
                .take_while(|event| event.node == *node)
                .map(|event| (event.kind, event.colour, is_held(event)))
                .collect();
            if of_node.iter().any(|(.., is_held)| *is_held) {
                wanted.push(*node);
                let of_sweeps = intervals_of(&of_node, starts);
                intervals.extend(of_sweeps.map(|Range { start, end }| Interval { place, from: start, until: end }));
            }
        }
        (wanted, intervals)
    }
}

/// Intervals in which the copy of a node needs its velocity, given the kinds and colours of its pairs in the order of a sweep, and whether
/// the copy's rank holds them.
fn intervals_of(
    pairs: &[(usize, usize, bool)],
    starts: &[usize; SWEEPS.len() + 1],
) -> impl Iterator<Item = Range<u32>> {
    let in_order = SWEEPS.iter().zip(starts).flat_map(move |(sweep, start)| {
        let of_kind = pairs.iter().filter(move |(kind, ..)| *kind == sweep.kind as usize);
        of_kind.map(move |(_, colour, is_held)| ((start + colour) as u32, *is_held))
    });
    let mut changed = None;
    in_order.filter_map(move |(at, is_held)| {
        if is_held {
            return changed.take().map(|from| from..at);
        }
        changed = Some(at);
        None
    })
}

/// The fewest colours, ascending, such that each interval has one after which its velocity can be sent.
fn fewest_rounds<'a>(intervals: impl Iterator<Item = &'a Interval>) -> Vec<u32> {
    let mut ends: Vec<Range<u32>> = intervals.map(|interval| interval.from..interval.until).collect();
    ends.sort_unstable_by_key(|interval| interval.end);
    let mut rounds: Vec<u32> = Vec::new();
    for interval in ends {
        if rounds.last().is_none_or(|last| *last < interval.start) {
            rounds.push(interval.end - 1);
        }
    }
    rounds
}

/// Puts each interval's node, which `node` finds by its place, into the last of these rounds that it allows; those of a round by place,
/// so that both ranks have the same order.
fn put(
    rounds: &mut [HaloExchange],
    times: &[u32],
    mut intervals: Vec<Interval>,
    list_of: impl Fn(&mut HaloExchange) -> &mut Vec<(usize, Vec<u32>)>,
    (other, node): (usize, impl Fn(u32) -> u32),
) {
    let time = |interval: &Interval| times[times.partition_point(|time| *time < interval.until) - 1];
    intervals.sort_unstable_by_key(|interval| (time(interval), interval.place));
    for same in intervals.chunk_by(|a, b| time(a) == time(b)) {
        let list = same.iter().map(|interval| node(interval.place)).collect();
        list_of(&mut rounds[time(&same[0]) as usize]).push((other, list));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    /// Whether each interval has one of these rounds.
    fn meets(rounds: &[u32], intervals: &[Interval]) -> bool {
        intervals.iter().all(|interval| rounds.iter().any(|round| (interval.from..interval.until).contains(round)))
    }

    #[test]
    fn rounds_meet_every_interval_and_no_fewer_would() {
        let mut random = SplitMix64::new(5);
        let mut below = |count: u32| ((random.signed() + 1.0) * 0.5 * f64::from(count)) as u32;
        for count in [0, 1, 3, 6, 12] {
            for _ in 0..40 {
                let one = |_| {
                    let from = below(11);
                    Interval { place: 0, from, until: from + 1 + below(12 - from - 1) }
                };
                let intervals: Vec<Interval> = (0..count).map(one).collect();
                let rounds = fewest_rounds(intervals.iter());
                assert!(rounds.is_sorted_by(|a, b| a < b) && meets(&rounds, &intervals), "{rounds:?} {intervals:?}");
                // All choices of colours.
                let chosen = |choice: u32| (0..12).filter(|colour| choice >> colour & 1 == 1).collect::<Vec<u32>>();
                let fewest = (0..1_u32 << 12).filter(|choice| meets(&chosen(*choice), &intervals));
                assert_eq!(fewest.map(u32::count_ones).min(), Some(rounds.len() as u32), "{rounds:?} {intervals:?}");
            }
        }
    }

    #[test]
    fn a_copy_needs_the_last_change_before_the_next_pair_of_its_rank() {
        // Four colours of points and triangles, three of edges.
        let mut starts = [0; SWEEPS.len() + 1];
        for (sweep, Sweep { kind, .. }) in SWEEPS.iter().enumerate() {
            starts[sweep + 1] = starts[sweep] + [4, 3][*kind as usize];
        }
        let of = |pairs: &[(usize, usize, bool)]| intervals_of(pairs, &starts).collect::<Vec<Range<u32>>>();
        assert_eq!(of(&[(0, 1, false), (1, 2, false)]), []);
        assert_eq!(of(&[(0, 1, true), (1, 2, true)]), []);
        // Two changes, then a pair that the rank holds: three times points and triangles, and once more at the end.
        assert_eq!(of(&[(0, 0, false), (0, 1, false), (0, 3, true)]), [1..3, 5..7, 9..11, 22..24]);
        // From one sweep to the next.
        assert_eq!(of(&[(0, 1, true), (0, 2, false)]), [2..5, 6..9, 10..22]);
        // From points and triangles to edges and back.
        assert_eq!(of(&[(0, 1, false), (1, 1, true)]), [9..13, 22..26]);
    }
}

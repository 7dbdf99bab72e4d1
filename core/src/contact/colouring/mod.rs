//! Colours of pairs, alike on any number of ranks: greedily in an order that looks random, so that what waits for what
//! does not reach far, and that follows from the scene's numbers of the nodes alone.
//!
//! A pair takes the first colour that none before it has taken at one of its nodes. Pairs with nodes in several logical
//! parts come before those within one, which no other rank has to wait for. 128 colours are a *batch*; pairs that find
//! none of them free wait for the next batch, where all are free again.
//!
//! Each rank colours all pairs it *holds*, those with a node of its own. It knows all pairs of its own nodes, so a pair
//! of these alone can be decided when all before it are. For the others ranks tell each other in rounds, for every node
//! that somebody else has a copy of, the first pair there that is undecided and the colours taken (M. Jones, P.
//! Plassmann, "A parallel graph coloring heuristic", SIAM Journal on Scientific Computing 14, 1993): a pair that is the
//! first at all its nodes is decided by all ranks that own one of its nodes in the same round, with the same result. A rank
//! that has decided all its pairs says so with its last message, and leaves the rounds to the others.

pub(crate) mod order;
#[cfg(test)]
mod tests;

use std::ops::Range;

use rayon::prelude::*;

use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::message::codec;

/// The colour of pairs that have none.
pub(crate) const NO_COLOUR: u32 = u32::MAX;

/// Colours of a batch: bits of a mask.
const BATCH: u32 = u128::BITS;

/// Classes of the order: pairs go class by class, those of a class by their nodes. Many enough that few pairs of one node
/// are in one class, and few enough that neighbours in memory are still met one soon after the other. First those of pairs
/// between parts, then those of pairs within a part.
const CLASSES: usize = 2 * WITHIN;

/// Number of the first class of pairs within a part.
const WITHIN: usize = 256;

/// Class of pairs that get no colour.
const NO_CLASS: u16 = u16::MAX;

/// Least number of pairs whose classes a thread computes: below, passing the work on takes longer.
const CHUNK: usize = 4096;

/// Rounds after which ranks look for pairs that cannot get a colour of a batch: few enough that a batch does not take a
/// round for each of them, and more than there are where contacts are few.
const ROUNDS_UNTIL_FULL: usize = 16;

/// A pair by the scene's numbers of its nodes; [`NOBODY`] for none.
type Key = [u32; 4];

const NOBODY: Key = [u32::MAX; 4];

/// The colour of each pair of several lists, of which these are the numbers of pairs, and each list's number of colours, the same on all
/// ranks; `nodes_of` has the nodes of a pair of a list, by which pairs are ascending. Lists know nothing of each other; they are coloured
/// at the same time because ranks then wait for one another once. Pairs with a point of a body have [`NO_COLOUR`]: nothing acts on them in
/// the order of colours. All ranks call it together.
pub(crate) fn colours<const N: usize>(
    counts: [usize; N],
    nodes: &ContactNodes,
    nodes_of: impl Fn(usize, usize) -> [u32; 4] + Sync,
) -> [(Vec<u32>, usize); N] {
    let mut colours = counts.map(|count| vec![NO_COLOUR; count]);
    let order_of = |list: usize| order(counts[list], nodes, |pair| nodes_of(list, pair));
    let numbers: Vec<usize> = if nodes.ranks().is_alone() {
        let each = colours.par_iter_mut().enumerate().map(|(list, colours)| {
            let used_colours = &mut UsedColours::new(nodes.cloth());
            colour_one_by_one(&order_of(list).0, |pair| nodes_of(list, pair), colours, used_colours);
            number_of(colours)
        });
        each.collect()
    } else {
        let orders: Vec<(Vec<u32>, usize)> = (0..N).map(order_of).collect();
        colour_together(nodes, nodes_of, &orders, &mut colours)
    };
    let mut numbers = numbers.into_iter();
    colours.map(|colours| (colours, numbers.next().unwrap_or_default()))
}

/// Number of colours up to the highest of these.
fn number_of(colours: &[u32]) -> usize {
    colours.iter().filter(|colour| **colour != NO_COLOUR).max().map_or(0, |colour| *colour as usize + 1)
}

/// Colours pairs of this rank alone, before which all is decided.
fn colour_one_by_one(
    order: &[u32],
    nodes_of: impl Fn(usize) -> [u32; 4],
    colours: &mut [u32],
    used_colours: &mut UsedColours,
) {
    for &pair in order {
        let of = nodes_of(pair as usize);
        colours[pair as usize] = used_colours.first_free(&of);
        used_colours.take(&of, colours[pair as usize]);
    }
}

/// Colours the pairs between parts of each list, which several ranks hold, batch by batch, and then those within parts; `orders` has the
/// order of each list and how many pairs of it are between parts. Returns the numbers of colours of all ranks.
fn colour_together(
    nodes: &ContactNodes,
    nodes_of: impl Fn(usize, usize) -> [u32; 4],
    orders: &[(Vec<u32>, usize)],
    colours: &mut [Vec<u32>],
) -> Vec<usize> {
    let (cloth, lists) = (nodes.cloth(), orders.len());
    let nodes_of = |list: usize, pair: usize| nodes_of(list, pair).map(|node| node + (list * cloth) as u32);
    let mut used_colours = UsedColours::new(lists * cloth);
    let between =
        (0..).zip(orders).flat_map(|(list, (order, between))| order[..*between].iter().map(move |pair| [list, *pair]));
    let order: Vec<[u32; 2]> = between.collect();
    let mut colouring = Colouring {
        nodes,
        nodes_of: &nodes_of,
        order: &order,
        colours,
        used: vec![0; lists * cloth],
        waits: vec![false; lists * cloth],
        announced: vec![NOBODY; lists * cloth],
        has_changed: vec![false; lists * cloth],
    };
    let mut waiting: Vec<u32> = (0..order.len() as u32).collect();
    let mut within = Some(orders);
    for batch in 0.. {
        waiting = colouring.batch(batch, waiting);
        used_colours.keep(batch, &colouring.used);
        // A pair within a part is of one rank. Where none of this rank's pairs waits, all before those within parts is decided.
        for (list, (order, between)) in within.take_if(|_| waiting.is_empty()).into_iter().flatten().enumerate() {
            let colours = &mut colouring.colours[list];
            colour_one_by_one(&order[*between..], |pair| nodes_of(list, pair), colours, &mut used_colours);
        }
        let mut largest: Vec<f64> = colouring.colours.iter().map(|colours| number_of(colours) as f64).collect();
        largest.push(f64::from(u8::from(!waiting.is_empty())));
        let mut largest = nodes.ranks().max_each(largest);
        if largest.pop() == Some(0.0) {
            return largest.into_iter().map(|number| number as usize).collect();
        }
    }
    unreachable!("each batch decides some of the pairs")
}

/// Colours that are taken at each node, in all batches.
struct UsedColours {
    /// Masks of each node.
    batches: usize,
    masks: Vec<u128>,
}

impl UsedColours {
    /// No colour at any of `nodes` nodes.
    fn new(nodes: usize) -> Self {
        Self { batches: 1, masks: vec![0; nodes] }
    }

    /// Masks of a node.
    fn at(&self, node: u32) -> &[u128] {
        &self.masks[node as usize * self.batches..][..self.batches]
    }

    /// The first colour that is free at all these nodes.
    fn first_free(&self, of: &[u32; 4]) -> u32 {
        let [a, b, c, d] = of.map(|node| self.at(node));
        let masks = a.iter().zip(b).zip(c).zip(d).map(|(((a, b), c), d)| a | b | c | d);
        let free = |(batch, mask): (u32, u128)| (mask != u128::MAX).then(|| batch * BATCH + mask.trailing_ones());
        (0..).zip(masks).find_map(free).unwrap_or(self.batches as u32 * BATCH)
    }

    /// Takes a colour at these nodes.
    fn take(&mut self, of: &[u32; 4], colour: u32) {
        let batch = (colour / BATCH) as usize;
        self.make_room(batch);
        of.iter().for_each(|node| self.masks[*node as usize * self.batches + batch] |= 1 << (colour % BATCH));
    }

    /// Takes the taken colours of a batch at every node.
    fn keep(&mut self, batch: u32, used: &[u128]) {
        self.make_room(batch as usize);
        for (masks, used) in self.masks.chunks_mut(self.batches).zip(used) {
            masks[batch as usize] = *used;
        }
    }

    /// Makes room for a batch and, so that it is seldom done, for as many again.
    fn make_room(&mut self, batch: usize) {
        if batch >= self.batches {
            let batches = 2 * batch.max(1);
            let mut masks = vec![0; self.masks.len() / self.batches * batches];
            for (wide, narrow) in masks.chunks_mut(batches).zip(self.masks.chunks(self.batches)) {
                wide[..narrow.len()].copy_from_slice(narrow);
            }
            (self.batches, self.masks) = (batches, masks);
        }
    }
}

/// The pairs without bodies in the order in which they choose, and how many of them are between parts.
fn order(count: usize, nodes: &ContactNodes, nodes_of: impl Fn(usize) -> [u32; 4] + Sync) -> (Vec<u32>, usize) {
    let class = |pair: usize| {
        let of = nodes_of(pair);
        if of.iter().any(|node| nodes.is_body(*node)) {
            return NO_CLASS;
        }
        let key = of.map(|node| nodes.number(node));
        u16::from(class(&key)) + if nodes.is_in_one_part(&key) { WITHIN as u16 } else { 0 }
    };
    let mut starts = [0usize; CLASSES + 1];
    let mut classes = vec![NO_CLASS; count];
    classes.par_iter_mut().enumerate().with_min_len(CHUNK).for_each(|(pair, of)| *of = class(pair));
    let of_cloth = |class: &u16| (*class != NO_CLASS).then_some(usize::from(*class));
    classes.iter().filter_map(of_cloth).for_each(|class| starts[class + 1] += 1);
    (0..CLASSES).for_each(|class| starts[class + 1] += starts[class]);
    let between = starts[WITHIN];
    let mut order = vec![0; starts[CLASSES]];
    for (pair, class) in classes.iter().enumerate() {
        if let Some(class) = of_cloth(class) {
            let place = &mut starts[class];
            order[*place] = pair as u32;
            *place += 1;
        }
    }
    (order, between)
}

/// A number that looks random, from those of the nodes.
fn class(key: &Key) -> u8 {
    // The odd number nearest to 2⁶⁴ over the golden ratio (D. Knuth, The Art of Computer Programming 3, 6.4).
    let mix = |mixed: u64, node: &u32| {
        let mixed = (mixed ^ u64::from(*node)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        mixed ^ (mixed >> 32)
    };
    let [.., class] = key.iter().fold(0, mix).wrapping_mul(0x9E37_79B9_7F4A_7C15).to_le_bytes();
    class
}

/// State while a batch is filled. Each list has nodes of its own here: those of the second list come behind those of the first.
struct Colouring<'a, F> {
    nodes: &'a ContactNodes,
    nodes_of: F,
    /// Pairs in the order in which they choose, by list and place in it.
    order: &'a [[u32; 2]],
    /// Colours of each list.
    colours: &'a mut [Vec<u32>],
    /// Colours of the batch that are taken at each node.
    used: Vec<u128>,
    /// Nodes of which this pass has met a pair that it could not decide.
    waits: Vec<bool>,
    /// The first undecided pair at each node as of the last round, until it is decided.
    announced: Vec<Key>,
    /// Own nodes of which the others do not know yet what has changed; none between rounds.
    has_changed: Vec<bool>,
}

impl<F: Fn(usize, usize) -> [u32; 4]> Colouring<'_, F> {
    /// Gives the colours of a batch to the pairs at these places of the order, ascending; returns the pairs that found
    /// none free.
    fn batch(&mut self, batch: u32, undecided: Vec<u32>) -> Vec<u32> {
        self.used.fill(0);
        let mut full = Vec::new();
        let left = self.pass(batch, undecided, &mut full);
        self.rounds(batch, left, &mut full);
        full.sort_unstable();
        full
    }

    /// Decides, in their order, those that this rank can decide by itself; returns the others.
    fn pass(&mut self, batch: u32, mut undecided: Vec<u32>, full: &mut Vec<u32>) -> Vec<u32> {
        self.waits.fill(false);
        undecided.retain(|place| {
            let of = self.nodes_at(*place);
            let is_left = !self.is_own(&of) || of.iter().any(|node| self.waits[*node as usize]);
            if is_left {
                of.iter().for_each(|node| self.waits[*node as usize] = true);
            } else {
                self.decide(batch, *place, &of, full);
            }
            is_left
        });
        undecided
    }

    /// Decides these pairs together with the other ranks that hold them. A round looks only at pairs that are the first
    /// at a node, because where everything is near everything there are very many rounds.
    fn rounds(&mut self, batch: u32, left: Vec<u32>, full: &mut Vec<u32>) {
        let mut others = self.nodes.halo().neighbours();
        let mut wait_lists = WaitLists::new(left, self.used.len(), |place| self.nodes_at(place));
        let mut changed = wait_lists.nodes();
        let mut round = 0;
        loop {
            let mut looked_at = self.send_to_ghosts(&wait_lists, &changed, &mut others);
            if wait_lists.is_empty() {
                break;
            }
            changed.clear();
            round += 1;
            if round % ROUNDS_UNTIL_FULL == 0 {
                self.take_out_full(&mut wait_lists, full, &mut changed);
                looked_at.extend_from_slice(&changed);
            }
            while let Some(node) = looked_at.pop() {
                let Some(turn) = wait_lists.first(node) else { continue };
                let of = wait_lists.nodes_of(turn);
                if of.iter().all(|node| wait_lists.first(*node) == Some(turn)) && self.is_known(&of) {
                    self.decide(batch, wait_lists.place(turn), &of, full);
                    wait_lists.take_out(turn);
                    looked_at.extend(of);
                    changed.extend(of);
                }
            }
        }
    }

    /// Moves pairs that cannot get a colour of this batch to `full`: colours that are taken stay taken. Called right
    /// after an exchange, so that all ranks with a node of a pair decide alike.
    fn take_out_full(&self, wait_lists: &mut WaitLists, full: &mut Vec<u32>, changed: &mut Vec<u32>) {
        for turn in wait_lists.left() {
            let of = wait_lists.nodes_of(turn);
            if self.used_colours(&of) == u128::MAX {
                full.push(wait_lists.place(turn));
                wait_lists.take_out(turn);
                changed.extend(of);
            }
        }
    }

    /// Gives the pair of these nodes, at this place of the order, the first free colour of the batch, or moves it to `full`.
    fn decide(&mut self, batch: u32, place: u32, of: &[u32; 4], full: &mut Vec<u32>) {
        let colour = (!self.used_colours(of)).trailing_zeros();
        if colour < BATCH {
            of.iter().for_each(|node| self.used[*node as usize] |= 1 << colour);
            let [list, pair] = self.order[place as usize].map(|number| number as usize);
            self.colours[list][pair] = batch * BATCH + colour;
        } else {
            full.push(place);
        }
    }

    /// Colours of the batch that are taken at any of these nodes.
    fn used_colours(&self, of: &[u32; 4]) -> u128 {
        of.iter().fold(0, |used_colours, node| used_colours | self.used[*node as usize])
    }

    /// Nodes of the pair at a place of the order.
    fn nodes_at(&self, place: u32) -> [u32; 4] {
        let [list, pair] = self.order[place as usize].map(|number| number as usize);
        (self.nodes_of)(list, pair)
    }

    /// The node of contact that a list's node is.
    fn node(&self, node: u32) -> u32 {
        node % self.nodes.cloth() as u32
    }

    fn is_own(&self, of: &[u32; 4]) -> bool {
        of.iter().all(|node| self.nodes.is_own(self.node(*node)))
    }

    /// A pair by the scene's numbers of its nodes.
    fn key(&self, of: &[u32; 4]) -> Key {
        of.map(|node| self.nodes.number(self.node(node)))
    }

    /// Whether all ranks with a node of this pair, the first at its nodes, know that it is.
    fn is_known(&mut self, of: &[u32; 4]) -> bool {
        if self.is_own(of) {
            return true;
        }
        let key = self.key(of);
        let is_announced = of.iter().all(|node| self.announced[*node as usize] == key);
        if is_announced {
            // What comes next at these nodes is not known to everybody yet.
            of.iter().for_each(|node| self.announced[*node as usize] = NOBODY);
        }
        is_announced
    }

    /// Sends the ghosts of own nodes that have `changed` the first pairs there and the colours taken; returns nodes of
    /// which something else is known now. Of `others`, the ranks that are still in the rounds, those that leave are taken out.
    fn send_to_ghosts(&mut self, wait_lists: &WaitLists, changed: &[u32], others: &mut Vec<usize>) -> Vec<u32> {
        let (nodes, cloth) = (self.nodes, self.nodes.cloth());
        let mut known: Vec<u32> = changed.iter().copied().filter(|node| nodes.is_own(self.node(*node))).collect();
        if others.is_empty() {
            return known;
        }
        for node in &known {
            let first = wait_lists.first(*node).map(|turn| self.key(&wait_lists.nodes_of(turn)));
            self.announced[*node as usize] = first.unwrap_or(NOBODY);
            self.has_changed[*node as usize] = true;
        }
        let (announced, used, has_changed) = (&self.announced, &self.used, &self.has_changed);
        let changed = |node: u32| {
            let of_lists = (0_u8..).zip((node as usize..used.len()).step_by(cloth));
            let changed = of_lists.filter(move |(_, node)| has_changed[*node]);
            changed.map(move |(list, node)| Announcement { list, first: announced[node], used: used[node] })
        };
        let mut copies = Vec::new();
        let take = |copy: usize, state: Announcement| copies.push((copy + usize::from(state.list) * cloth, state));
        nodes.halo().update_changed_in_rounds(nodes.ranks(), (others, wait_lists.is_empty()), changed, take);
        known.iter().for_each(|node| self.has_changed[*node as usize] = false);
        for (copy, Announcement { first, used, .. }) in copies {
            (self.announced[copy], self.used[copy]) = (first, used);
            known.push(copy as u32);
        }
        known
    }
}

/// Message from the owner of a node to the ranks that have a copy of it.
struct Announcement {
    /// List of pairs that it is about.
    list: u8,
    /// The first undecided pair there.
    first: Key,
    /// Colours of the batch that are taken there.
    used: u128,
}

codec!(struct Announcement { list, first, used });

/// Undecided pairs of each node in the order in which they choose. A pair is known by its *turn*, its place among those that
/// began undecided; what a look at a pair needs is close together in memory, since each is looked at many times.
struct WaitLists {
    /// Place in the order of all pairs, by turn.
    places: Vec<u32>,
    /// Nodes of each pair, by turn.
    nodes: Vec<[u32; 4]>,
    /// The first undecided pair of each node; [`NO_TURN`] for none.
    first: Vec<u32>,
    /// Pairs of all nodes, ascending for each of them.
    turns: Vec<u32>,
    /// Range of the pairs of each node in `turns`, from the first undecided one on.
    ranges: Vec<Range<usize>>,
    /// Whether the pair has been taken out, by turn.
    is_out: Vec<bool>,
    /// Number of pairs that are left.
    count: usize,
}

const NO_TURN: u32 = u32::MAX;

impl WaitLists {
    /// Makes the lists of the pairs at these places, ascending.
    fn new(places: Vec<u32>, node_count: usize, nodes_at: impl Fn(u32) -> [u32; 4]) -> Self {
        let nodes: Vec<[u32; 4]> = places.iter().map(|place| nodes_at(*place)).collect();
        let mut ranges = vec![0..0; node_count];
        nodes.iter().flatten().for_each(|node| ranges[*node as usize].end += 1);
        let mut total = 0;
        for range in &mut ranges {
            let count = range.end;
            *range = total..total;
            total += count;
        }
        let mut turns = vec![0; total];
        for (turn, of) in (0..).zip(&nodes) {
            for node in of {
                let end = &mut ranges[*node as usize].end;
                turns[*end] = turn;
                *end += 1;
            }
        }
        let first = ranges.iter().map(|range| if range.is_empty() { NO_TURN } else { turns[range.start] }).collect();
        let (is_out, count) = (vec![false; places.len()], places.len());
        Self { places, nodes, first, turns, ranges, is_out, count }
    }

    fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Nodes that have any.
    fn nodes(&self) -> Vec<u32> {
        (0..self.first.len() as u32).filter(|node| self.first(*node).is_some()).collect()
    }

    /// The first pair of a node.
    fn first(&self, node: u32) -> Option<u32> {
        let turn = self.first[node as usize];
        (turn != NO_TURN).then_some(turn)
    }

    /// Nodes of a pair.
    fn nodes_of(&self, turn: u32) -> [u32; 4] {
        self.nodes[turn as usize]
    }

    /// Place of a pair in the order of all.
    fn place(&self, turn: u32) -> u32 {
        self.places[turn as usize]
    }

    /// Pairs that are left, ascending.
    fn left(&self) -> Vec<u32> {
        (0..).zip(&self.is_out).filter_map(|(turn, is_out)| (!is_out).then_some(turn)).collect()
    }

    /// Takes out a pair.
    fn take_out(&mut self, turn: u32) {
        self.is_out[turn as usize] = true;
        self.count -= 1;
        for node in self.nodes[turn as usize] {
            if self.first[node as usize] != turn {
                continue;
            }
            let range = &mut self.ranges[node as usize];
            while range.start < range.end && self.is_out[self.turns[range.start] as usize] {
                range.start += 1;
            }
            self.first[node as usize] = if range.start < range.end { self.turns[range.start] } else { NO_TURN };
        }
    }
}

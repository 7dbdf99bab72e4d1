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
//! first at all its nodes is decided by all ranks that own one of its nodes in the same round, with the same result.

pub(crate) mod order;
#[cfg(test)]
mod tests;

use std::ops::Range;

use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::message::codec;

/// The colour of pairs that have none.
pub(crate) const NO_COLOUR: u32 = u32::MAX;

/// Colours of a batch: bits of a mask.
const BATCH: u32 = u128::BITS;

/// Classes of the order: pairs go class by class, those of a class by their nodes. So many that few pairs of one node
/// are in one class, and so few that neighbours in memory are still met one soon after the other. First those of pairs
/// between parts, then those of pairs within a part.
const CLASSES: usize = 2 * WITHIN;

/// Number of the first class of pairs within a part.
const WITHIN: usize = 256;

/// Rounds after which ranks look for pairs that cannot get a colour of a batch: few enough that a batch does not take a
/// round for each of them, and more than there are where contacts are few.
const ROUNDS_UNTIL_FULL: usize = 16;

/// A pair by the scene's numbers of its nodes; [`NOBODY`] for none.
type Key = [u32; 4];

const NOBODY: Key = [u32::MAX; 4];

/// The colour of each of `count` pairs, ascending by their nodes, and the number of colours, the same on all ranks.
/// Pairs with a point of a body have [`NO_COLOUR`]: nothing acts on them in the order of colours. All ranks call it
/// together.
pub(crate) fn colours(count: usize, nodes: &ContactNodes, nodes_of: impl Fn(usize) -> [u32; 4]) -> (Vec<u32>, usize) {
    let (order, between) = order(count, nodes, &nodes_of);
    let (mut colours, mut used_colours) = (vec![NO_COLOUR; count], UsedColours::new(nodes.cloth()));
    let alone = nodes.ranks().is_alone();
    let decided = if alone { 0 } else { between };
    if !alone {
        colour_together(nodes, &nodes_of, &order[..decided], &mut colours, &mut used_colours);
    }
    // What is within a part is of one rank, and all before it is decided.
    for &pair in &order[decided..] {
        let of = nodes_of(pair as usize);
        colours[pair as usize] = used_colours.first_free(&of);
        used_colours.take(&of, colours[pair as usize]);
    }
    let highest = colours.iter().filter(|colour| **colour != NO_COLOUR).max();
    let number = nodes.ranks().max(highest.map_or(0.0, |colour| f64::from(*colour) + 1.0));
    (colours, number as usize)
}

/// Colours the pairs of `order`, which several ranks hold, batch by batch.
fn colour_together(
    nodes: &ContactNodes,
    nodes_of: impl Fn(usize) -> [u32; 4],
    order: &[u32],
    colours: &mut [u32],
    used_colours: &mut UsedColours,
) {
    let has_copies = !nodes.halo().is_empty();
    let copied = if has_copies { nodes.cloth() } else { 0 };
    let mut colouring = Colouring {
        nodes,
        nodes_of,
        order,
        colours,
        used: vec![0; nodes.cloth()],
        waits: vec![false; nodes.cloth()],
        announced: vec![NOBODY; copied],
        has_changed: vec![false; copied],
    };
    let mut waiting: Vec<u32> = (0..order.len() as u32).collect();
    for batch in 0.. {
        if !nodes.ranks().any(!waiting.is_empty()) {
            break;
        }
        waiting = colouring.batch(batch, waiting);
        used_colours.keep(batch, &colouring.used);
    }
}

/// Colours that are taken at each node, in all batches.
struct UsedColours {
    /// Masks of each node.
    batches: usize,
    masks: Vec<u128>,
}

impl UsedColours {
    /// None at so many nodes.
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
fn order(count: usize, nodes: &ContactNodes, nodes_of: impl Fn(usize) -> [u32; 4]) -> (Vec<u32>, usize) {
    let class = |pair: usize| {
        let of = nodes_of(pair);
        (!of.iter().any(|node| nodes.is_body(*node))).then(|| {
            let key = of.map(|node| nodes.number(node));
            usize::from(class(&key)) + if nodes.is_in_one_part(&key) { WITHIN } else { 0 }
        })
    };
    let mut starts = [0usize; CLASSES + 1];
    let classes: Vec<Option<usize>> = (0..count).map(class).collect();
    classes.iter().flatten().for_each(|class| starts[class + 1] += 1);
    (0..CLASSES).for_each(|class| starts[class + 1] += starts[class]);
    let between = starts[WITHIN];
    let mut order = vec![0; starts[CLASSES]];
    for (pair, class) in classes.iter().enumerate() {
        if let Some(class) = class {
            let place = &mut starts[*class];
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

/// State while a batch is filled.
struct Colouring<'a, F> {
    nodes: &'a ContactNodes,
    nodes_of: F,
    /// Pairs in the order in which they choose.
    order: &'a [u32],
    colours: &'a mut [u32],
    /// Colours of the batch that are taken at each node.
    used: Vec<u128>,
    /// Nodes of which this pass has met a pair that it could not decide.
    waits: Vec<bool>,
    /// The first undecided pair at each node as of the last round, until it is decided.
    announced: Vec<Key>,
    /// Own nodes of which the others do not know yet what has changed; none between rounds.
    has_changed: Vec<bool>,
}

impl<F: Fn(usize) -> [u32; 4]> Colouring<'_, F> {
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
                self.decide(batch, *place, full);
            }
            is_left
        });
        undecided
    }

    /// Decides these pairs together with the other ranks that hold them. A round looks only at pairs that are the first
    /// at a node, because where everything is near everything there are very many rounds.
    fn rounds(&mut self, batch: u32, mut left: Vec<u32>, full: &mut Vec<u32>) {
        if !self.nodes.ranks().any(!left.is_empty()) {
            return;
        }
        let mut wait_lists = WaitLists::new(&left, self.nodes.cloth(), |place| self.nodes_at(place));
        let mut changed = wait_lists.nodes();
        let mut round = 0;
        loop {
            let mut looked_at = self.tell(&wait_lists, &changed);
            changed.clear();
            round += 1;
            if round % ROUNDS_UNTIL_FULL == 0 {
                self.take_out_full(&mut left, &mut wait_lists, full, &mut changed);
                looked_at.extend_from_slice(&changed);
            }
            while let Some(node) = looked_at.pop() {
                let Some(place) = wait_lists.first(node) else { continue };
                let of = self.nodes_at(place);
                if of.iter().all(|node| wait_lists.first(*node) == Some(place)) && self.is_known(&of) {
                    self.decide(batch, place, full);
                    wait_lists.take_out(place, &of);
                    looked_at.extend(of);
                    changed.extend(of);
                }
            }
            if !self.nodes.ranks().any(!wait_lists.is_empty()) {
                break;
            }
        }
    }

    /// Moves pairs that cannot get a colour of this batch to `full`: colours that are taken stay taken. Called right
    /// after an exchange, so that all ranks with a node of a pair decide alike.
    fn take_out_full(
        &self,
        left: &mut Vec<u32>,
        wait_lists: &mut WaitLists,
        full: &mut Vec<u32>,
        changed: &mut Vec<u32>,
    ) {
        left.retain(|place| {
            if wait_lists.is_out(*place) {
                return false;
            }
            let of = self.nodes_at(*place);
            let is_full = self.used_colours(&of) == u128::MAX;
            if is_full {
                full.push(*place);
                wait_lists.take_out(*place, &of);
                changed.extend(of);
            }
            !is_full
        });
    }

    /// Gives the pair at this place of the order the first free colour of the batch, or moves it to `full`.
    fn decide(&mut self, batch: u32, place: u32, full: &mut Vec<u32>) {
        let of = self.nodes_at(place);
        let colour = (!self.used_colours(&of)).trailing_zeros();
        if colour < BATCH {
            of.iter().for_each(|node| self.used[*node as usize] |= 1 << colour);
            self.colours[self.order[place as usize] as usize] = batch * BATCH + colour;
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
        (self.nodes_of)(self.order[place as usize] as usize)
    }

    fn is_own(&self, of: &[u32; 4]) -> bool {
        of.iter().all(|node| self.nodes.is_own(*node))
    }

    /// Whether all ranks with a node of this pair, the first at its nodes, know that it is.
    fn is_known(&mut self, of: &[u32; 4]) -> bool {
        if self.is_own(of) {
            return true;
        }
        let key = of.map(|node| self.nodes.number(node));
        let is_announced = of.iter().all(|node| self.announced[*node as usize] == key);
        if is_announced {
            // What comes next at these nodes is not known to everybody yet.
            of.iter().for_each(|node| self.announced[*node as usize] = NOBODY);
        }
        is_announced
    }

    /// Tells the copies of those own nodes that have `changed` what is first there and what is taken; returns nodes of
    /// which something else is known now.
    fn tell(&mut self, wait_lists: &WaitLists, changed: &[u32]) -> Vec<u32> {
        let nodes = self.nodes;
        let mut known: Vec<u32> = changed.iter().copied().filter(|node| nodes.is_own(*node)).collect();
        if nodes.halo().is_empty() {
            return known;
        }
        for node in &known {
            let first = wait_lists.first(*node).map(|place| self.nodes_at(place).map(|node| nodes.number(node)));
            self.announced[*node as usize] = first.unwrap_or(NOBODY);
            self.has_changed[*node as usize] = true;
        }
        let (announced, used, has_changed) = (&self.announced, &self.used, &self.has_changed);
        let mut copies = Vec::new();
        let own = |node: usize| Announcement { first: announced[node], used: used[node] };
        let changed = |node: u32| has_changed[node as usize].then(|| own(node as usize));
        nodes.halo().update_changed(nodes.ranks(), changed, |copy, state: Announcement| copies.push((copy, state)));
        known.iter().for_each(|node| self.has_changed[*node as usize] = false);
        for (copy, Announcement { first, used }) in copies {
            (self.announced[copy], self.used[copy]) = (first, used);
            known.push(copy as u32);
        }
        known
    }
}

/// Message from the owner of a node to the ranks that have a copy of it.
struct Announcement {
    /// The first undecided pair there.
    first: Key,
    /// Colours of the batch that are taken there.
    used: u128,
}

codec!(struct Announcement { first, used });

/// The undecided pairs of each node, by their places in the order, ascending.
struct WaitLists {
    places: Vec<u32>,
    /// Range of the pairs of each node in `places`.
    ranges: Vec<Range<usize>>,
    /// Whether the pair at a place has been taken out.
    is_out: Vec<bool>,
    /// Number of pairs that are left.
    count: usize,
}

impl WaitLists {
    /// Makes the lists of the pairs at these places, ascending.
    fn new(left: &[u32], nodes: usize, nodes_at: impl Fn(u32) -> [u32; 4]) -> Self {
        let mut ranges = vec![0..0; nodes];
        left.iter().for_each(|place| nodes_at(*place).iter().for_each(|node| ranges[*node as usize].end += 1));
        let mut total = 0;
        for range in &mut ranges {
            let count = range.end;
            *range = total..total;
            total += count;
        }
        let mut places = vec![0; total];
        for place in left {
            for node in nodes_at(*place) {
                let end = &mut ranges[node as usize].end;
                places[*end] = *place;
                *end += 1;
            }
        }
        let is_out = vec![false; left.last().map_or(0, |last| *last as usize + 1)];
        Self { places, ranges, is_out, count: left.len() }
    }

    fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Nodes that have any.
    fn nodes(&self) -> Vec<u32> {
        (0..self.ranges.len() as u32).filter(|node| self.first(*node).is_some()).collect()
    }

    /// The first pair of a node.
    fn first(&self, node: u32) -> Option<u32> {
        let range = &self.ranges[node as usize];
        (!range.is_empty()).then(|| self.places[range.start])
    }

    /// Whether a pair that was there is not any more.
    fn is_out(&self, place: u32) -> bool {
        self.is_out[place as usize]
    }

    /// Takes out a pair of these nodes.
    fn take_out(&mut self, place: u32, of: &[u32; 4]) {
        self.is_out[place as usize] = true;
        self.count -= 1;
        for node in of {
            let range = &mut self.ranges[*node as usize];
            while range.start < range.end && self.is_out[self.places[range.start] as usize] {
                range.start += 1;
            }
        }
    }
}

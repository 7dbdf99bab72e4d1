//! The order in which pairs are treated: colours, no two pairs of a colour sharing a node.
//!
//! Gauss-Seidel passes go through the colours one after the other and through the pairs of a colour in any order, hence in
//! parallel. The colours depend on the sorted pairs alone, so the result has the same bits whoever does the work.

use std::ops::Range;

/// Colours that pairs can have; what finds none free goes into the last group, one pair after the other.
const COLOURS: usize = 128;

/// Pairs in colour order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Order {
    /// Pairs of each colour.
    colours: Vec<Range<usize>>,
    /// Pairs without a colour, at the end; to be treated one after the other.
    rest: Range<usize>,
}

impl Order {
    /// Reorders `pairs`, whose order must not depend on the work that found them, by colour; `nodes_of` tells their nodes,
    /// `node_count` how many there are. Pairs of a colour keep their order.
    pub fn of<T: Clone>(pairs: &mut Vec<T>, node_count: usize, nodes_of: impl Fn(&T) -> [u32; 4]) -> Self {
        let mut used = vec![0u128; node_count];
        let mut counts = [0usize; COLOURS + 1];
        let colour_of: Vec<u8> = pairs
            .iter()
            .map(|pair| {
                let nodes = nodes_of(pair);
                let taken = nodes.iter().fold(0, |taken, n| taken | used[*n as usize]);
                let colour = (!taken).trailing_zeros() as usize;
                if colour < COLOURS {
                    nodes.iter().for_each(|n| used[*n as usize] |= 1 << colour);
                }
                counts[colour] += 1;
                colour as u8
            })
            .collect();
        let mut starts = [0; COLOURS + 2];
        for colour in 0..=COLOURS {
            starts[colour + 1] = starts[colour] + counts[colour];
        }
        let mut places = starts;
        let mut order = vec![0u32; pairs.len()];
        for (pair, colour) in colour_of.iter().enumerate() {
            let place = &mut places[*colour as usize];
            order[*place] = pair as u32;
            *place += 1;
        }
        *pairs = order.iter().map(|pair| pairs[*pair as usize].clone()).collect();
        let colours = (0..COLOURS).map(|c| starts[c]..starts[c + 1]).take_while(|range| !range.is_empty()).collect();
        Self { colours, rest: starts[COLOURS]..pairs.len() }
    }

    /// The order of the pairs that `keep` names by their place, counted anew.
    pub fn restricted(&self, kept: &[u32]) -> Self {
        let place = |end: usize| kept.partition_point(|&pair| (pair as usize) < end);
        let range = |range: &Range<usize>| place(range.start)..place(range.end);
        Self { colours: self.colours.iter().map(range).collect(), rest: range(&self.rest) }
    }

    /// Pairs of each colour, by their place.
    pub fn colours(&self) -> &[Range<usize>] {
        &self.colours
    }

    /// Pairs to be treated one after the other when the colours are done.
    pub fn rest(&self) -> Range<usize> {
        self.rest.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::testing::Random;

    #[test]
    fn no_two_pairs_of_a_colour_share_a_node_and_none_is_lost() {
        let mut random = Random(71);
        let mut node = |count: usize| (random.number().abs() * count as f64) as u32 % count as u32;
        for (pairs, nodes) in [(0, 4), (1, 4), (500, 300), (2000, 40)] {
            let mut list: Vec<[u32; 4]> = (0..pairs).map(|_| [0; 4].map(|_| node(nodes))).collect();
            let before = list.clone();
            let order = Order::of(&mut list, nodes, |pair| *pair);
            let mut covered = 0;
            for colour in order.colours() {
                let mut seen = vec![usize::MAX; nodes];
                for pair in colour.clone() {
                    for n in list[pair] {
                        assert!(seen[n as usize] == usize::MAX || seen[n as usize] == pair);
                        seen[n as usize] = pair;
                    }
                }
                covered += colour.len();
            }
            assert_eq!(covered + order.rest().len(), pairs);
            assert!(pairs < 2000 || !order.rest().is_empty(), "so many pairs of so few nodes run out of colours");
            let sorted = |mut list: Vec<[u32; 4]>| {
                list.sort_unstable();
                list
            };
            assert_eq!(sorted(list), sorted(before));
        }
    }

    #[test]
    fn a_restricted_order_keeps_the_colours_of_what_is_left() {
        let mut list: Vec<[u32; 4]> = vec![[0, 1, 2, 3], [0, 4, 5, 6], [7, 8, 9, 10], [0, 7, 11, 12]];
        let order = Order::of(&mut list, 13, |pair| *pair);
        assert_eq!(order.colours(), [0..2, 2..3, 3..4]);
        assert_eq!(order.restricted(&[1, 3]).colours(), [0..1, 1..1, 1..2]);
    }
}

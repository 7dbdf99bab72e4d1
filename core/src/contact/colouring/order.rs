//! The order in which pairs are treated: colours, no two pairs of a colour sharing a node of cloth.
//!
//! Gauss-Seidel passes go through the colours one after the other and through the pairs of a colour in any order, hence
//! in parallel. The colours depend on the pairs and on the scene's numbers of their nodes alone (`colouring`), so the
//! result has the same bits on any number of threads and ranks.

use std::ops::Range;

use rayon::prelude::*;

use crate::contact::colouring::{self, NO_COLOUR};
use crate::contact::topology::nodes::ContactNodes;

/// Pairs in colour order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Order {
    /// Pairs of each colour. All ranks have equally many colours, some of them without pairs.
    colours: Vec<Range<usize>>,
}

impl Order {
    /// Reorders lists of pairs, each of which has all that this rank holds, ascending by their nodes, by colour; `nodes_of` tells
    /// their nodes. Pairs of a colour keep their order. Pairs with a point of a body have no colour, and stand behind
    /// the others. All ranks call it together.
    pub(crate) fn of<const N: usize, T: Copy + Send + Sync>(
        lists: [&mut Vec<T>; N],
        nodes: &ContactNodes,
        nodes_of: impl Fn(&T) -> [u32; 4] + Sync,
    ) -> [Self; N] {
        let counts = lists.each_ref().map(|list| list.len());
        let colours = colouring::colours(counts, nodes, |list, pair| nodes_of(&lists[list][pair]));
        let mut orders = [const { Self { colours: Vec::new() } }; N];
        let coloured = lists.into_par_iter().zip(colours);
        orders.par_iter_mut().zip(coloured).for_each(|(order, (list, (colours, count)))| {
            *order = Self::by_colour(list, &colours, count);
        });
        orders
    }

    /// Reorders pairs by their `count` colours.
    fn by_colour<T: Copy>(pairs: &mut [T], colours: &[u32], count: usize) -> Self {
        let place_of = |colour: u32| if colour == NO_COLOUR { count } else { colour as usize };
        let mut starts = vec![0usize; count + 2];
        colours.iter().for_each(|colour| starts[place_of(*colour) + 1] += 1);
        (0..=count).for_each(|colour| starts[colour + 1] += starts[colour]);
        let mut places = starts.clone();
        let mut order = vec![0u32; pairs.len()];
        for (pair, colour) in colours.iter().enumerate() {
            let place = &mut places[place_of(*colour)];
            order[*place] = pair as u32;
            *place += 1;
        }
        permute(pairs, &mut order);
        Self { colours: (0..count).map(|colour| starts[colour]..starts[colour + 1]).collect() }
    }

    /// The order of the pairs that `kept` names by their place, counted anew.
    pub(crate) fn restricted(&self, kept: &[u32]) -> Self {
        let place = |end: usize| kept.partition_point(|&pair| (pair as usize) < end);
        Self { colours: self.colours.iter().map(|range| place(range.start)..place(range.end)).collect() }
    }

    /// Pairs of each colour, by their place.
    pub(crate) fn colours(&self) -> &[Range<usize>] {
        &self.colours
    }
}

/// Puts the item that `sources` names for each place into that place, without another list of the items.
fn permute<T: Copy>(items: &mut [T], sources: &mut [u32]) {
    for start in 0..items.len() {
        let (first, mut place) = (items[start], start);
        // A cycle of places. Each becomes its own source once it has its item.
        loop {
            let source = std::mem::replace(&mut sources[place], place as u32) as usize;
            if source == start {
                items[place] = first;
                break;
            }
            items[place] = items[source];
            place = source;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::ranks::Ranks;

    fn alone(nodes: u32) -> ContactNodes {
        ContactNodes::new(&Ranks::default(), &[0, nodes], Vec::new(), 10)
    }

    #[test]
    fn pairs_of_a_colour_keep_their_order_and_those_with_bodies_come_last() {
        let mut list: Vec<[u32; 4]> = vec![[0, 1, 2, 3], [4, 5, 6, 20], [7, 8, 9, 10], [11, 12, 13, 14]];
        let [order] = Order::of([&mut list], &alone(20), |pair| *pair);
        assert_eq!(order.colours(), std::slice::from_ref(&(0..3)));
        assert_eq!(list, [[0, 1, 2, 3], [7, 8, 9, 10], [11, 12, 13, 14], [4, 5, 6, 20]]);
    }

    #[test]
    fn items_take_the_places_of_their_cycles() {
        // A cycle of three, one of two, and an item that stays.
        let mut items = ["a", "b", "c", "d", "e", "f"];
        let mut sources = [2, 4, 3, 0, 1, 5];
        permute(&mut items, &mut sources);
        assert_eq!(items, ["c", "e", "d", "a", "b", "f"]);
        assert_eq!(sources, [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn a_restricted_order_keeps_the_colours_of_what_is_left() {
        // Three pairs that all share a node, and one by itself: three colours.
        let mut list: Vec<[u32; 4]> = vec![[0, 1, 2, 3], [0, 4, 5, 6], [0, 7, 11, 12], [13, 14, 15, 16]];
        let [order] = Order::of([&mut list], &alone(20), |pair| *pair);
        assert_eq!(order.colours(), [0..2, 2..3, 3..4]);
        assert_eq!(order.restricted(&[1, 3]).colours(), [0..1, 1..1, 1..2]);
    }
}

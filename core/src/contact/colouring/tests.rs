use super::*;
use crate::contact::testing::{below, held, on_ranks, random_starts};
use crate::geometry::random::SplitMix64;

/// Random pairs of nodes that lie near each other in number, one in ten with any; ascending.
fn random_pairs(random: &mut SplitMix64, count: usize, nodes: usize, bodies: usize) -> Vec<[u32; 4]> {
    let mut pairs: Vec<[u32; 4]> = Vec::new();
    for _ in 0..count {
        let first = below(random, nodes);
        let mut pair = [first as u32; 4];
        for i in 1..4 {
            while pair[..i].contains(&pair[i]) {
                let far = below(random, 10) == 0;
                let next = if far { below(random, nodes) } else { (first + below(random, 20)) % nodes };
                pair[i] = next as u32;
            }
        }
        if bodies > 0 && below(random, 20) == 0 {
            pair[3] = (nodes + below(random, bodies)) as u32;
        }
        pairs.push(pair);
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The definition: one after the other.
fn greedy(pairs: &[[u32; 4]], nodes: u32) -> Vec<u32> {
    let mut order: Vec<usize> = (0..pairs.len()).filter(|i| pairs[*i].iter().all(|node| *node < nodes)).collect();
    order.sort_by_key(|i| (class(&pairs[*i]), pairs[*i]));
    let mut colours = vec![NO_COLOUR; pairs.len()];
    let mut batch = 0;
    while !order.is_empty() {
        let mut used_colours = vec![[false; BATCH as usize]; nodes as usize];
        order.retain(|i| {
            let free = (0..BATCH as usize).find(|c| pairs[*i].iter().all(|node| !used_colours[*node as usize][*c]));
            let Some(free) = free else { return true };
            pairs[*i].iter().for_each(|node| used_colours[*node as usize][free] = true);
            colours[*i] = batch * BATCH + free as u32;
            false
        });
        batch += 1;
    }
    colours
}

/// Checks that any number of ranks finds the colours of the definition; returns how many there are.
fn check(random: &mut SplitMix64, pairs: Vec<[u32; 4]>, nodes: usize, bodies: usize) -> usize {
    let expected = greedy(&pairs, nodes as u32);
    let most = expected.iter().filter(|c| **c != NO_COLOUR).max().map_or(0, |c| *c as usize + 1);
    for ranks in [1, 2, 3, 5] {
        let starts = random_starts(random, ranks, nodes);
        let (expected, pairs) = (expected.clone(), pairs.clone());
        let numbers = on_ranks(ranks, move |ranks| {
            let (nodes, held) = held(&ranks, &starts, bodies, &pairs);
            let [(found, number)] = colours([held.len()], &nodes, |_, i| held[i].1);
            for ((place, _), colour) in held.iter().zip(&found) {
                assert_eq!(*colour, expected[*place], "{ranks:?} of {starts:?}, pair {:?}", pairs[*place]);
            }
            number
        });
        assert_eq!(numbers, vec![most; ranks]);
    }
    most
}

#[test]
fn any_number_of_ranks_finds_the_colours_of_one_after_the_other() {
    let mut random = SplitMix64::new(71);
    for (count, nodes, bodies) in [(0, 4, 0), (1, 4, 0), (500, 300, 0), (4000, 700, 30), (3000, 100, 5)] {
        let pairs = random_pairs(&mut random, count, nodes, bodies);
        check(&mut random, pairs, nodes, bodies);
    }
}

#[test]
fn lists_are_coloured_at_the_same_time_as_if_each_were_alone() {
    let mut random = SplitMix64::new(74);
    let lists = [(2500, 60), (400, 60), (0, 60)].map(|(count, nodes)| random_pairs(&mut random, count, nodes, 3));
    let expected = lists.each_ref().map(|pairs| greedy(pairs, 60));
    for ranks in [1, 2, 4] {
        let starts = random_starts(&mut random, ranks, 60);
        let (lists, expected) = (lists.clone(), expected.clone());
        on_ranks(ranks, move |ranks| {
            let all = lists.concat();
            let (nodes, _) = held(&ranks, &starts, 3, &all);
            let own = starts[ranks.rank()]..starts[ranks.rank() + 1];
            let local = |number: &u32| nodes.local(*number).expect("a node of a pair that is held");
            let held = lists.each_ref().map(|pairs| {
                let is_held = |(_, pair): &(usize, &[u32; 4])| pair.iter().any(|node| own.contains(node));
                let held = pairs.iter().enumerate().filter(is_held);
                held.map(|(place, pair)| (place, pair.each_ref().map(local))).collect::<Vec<_>>()
            });
            let found = colours(held.each_ref().map(Vec::len), &nodes, |list, pair| held[list][pair].1);
            for ((held, expected), (found, number)) in held.iter().zip(&expected).zip(found) {
                assert!(held.iter().zip(&found).all(|((place, _), colour)| expected[*place] == *colour));
                let most = expected.iter().filter(|colour| **colour != NO_COLOUR).max();
                assert_eq!(number, most.map_or(0, |colour| *colour as usize + 1));
            }
        });
    }
}

#[test]
fn pairs_that_find_no_colour_free_wait_for_the_next_page() {
    let mut random = SplitMix64::new(72);
    let pairs = random_pairs(&mut random, 2500, 30, 0);
    let most = check(&mut random, pairs, 30, 0);
    assert!(most > BATCH as usize, "many pairs of few nodes need a second batch, not {most} colours");
}

#[test]
fn no_two_pairs_of_a_colour_share_a_node() {
    let mut random = SplitMix64::new(73);
    let pairs = random_pairs(&mut random, 3000, 200, 0);
    let (nodes, held) = held(&crate::parallel::ranks::Ranks::default(), &[0, 200], 0, &pairs);
    let [(found, number)] = colours([held.len()], &nodes, |_, i| held[i].1);
    let mut seen = vec![false; 200 * number];
    for (pair, colour) in pairs.iter().zip(found) {
        for node in pair {
            let place = &mut seen[200 * colour as usize + *node as usize];
            assert!(!std::mem::replace(place, true), "{pair:?}");
        }
    }
}

#[test]
fn a_pair_that_is_there_twice_has_two_colours_alike_on_all_ranks() {
    let pairs = vec![[0, 1, 4, 5], [0, 1, 4, 5], [0, 1, 4, 5], [2, 3, 6, 7]];
    let expected = [0, 1, 2, 0];
    for starts in [vec![0, 8], vec![0, 4, 8], vec![0, 1, 5, 8]] {
        let pairs = pairs.clone();
        on_ranks(starts.len() - 1, move |ranks| {
            let (nodes, held) = held(&ranks, &starts, 0, &pairs);
            let [(found, _)] = colours([held.len()], &nodes, |_, i| held[i].1);
            assert!(held.iter().zip(found).all(|((place, _), colour)| expected[*place] == colour));
        });
    }
}

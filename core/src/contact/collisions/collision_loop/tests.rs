use std::sync::Arc;

use super::*;
use crate::contact::broad_phase::proximity_list::tests::ranks::Heap;
use crate::contact::testing::on_ranks;
use crate::geometry::random::SplitMix64;
use crate::parallel::ranks::Ranks;

/// Counts that have to be the same on any number of ranks.
const COUNTS: [&str; 13] = [
    "collision_hits",
    "collision_attempts",
    "collision_loops",
    "swept_searches",
    "swept_renewals",
    "zones",
    "zones_large",
    "zone_nodes",
    "zone_sweeps",
    "zones_carried",
    "zones_rigid",
    "zone_fallbacks",
    "pairs_pinched",
];

/// Outcome of the collisions of a heap.
#[derive(Debug, Clone, PartialEq)]
struct Outcome {
    /// Ends of own nodes, as bits, and the scene's numbers of those that were moved.
    ends: Vec<[u64; 3]>,
    moved: Vec<u32>,
    is_hard: bool,
    is_pinched: bool,
    is_rewound: bool,
    counts: [u64; 13],
}

impl Outcome {
    fn counted(&self, name: &str) -> u64 {
        COUNTS.iter().zip(self.counts).filter(|(n, _)| **n == name).map(|(_, count)| count).sum()
    }
}

/// Motion of a heap: a multiple of the way between its first two times, for one node in 16 another multiple.
#[derive(Debug, Clone, Copy)]
struct Moves {
    usual: f64,
    some: f64,
    /// Reach of the proximity list.
    reach: f64,
}

impl Moves {
    fn all(times: f64) -> Self {
        Self { usual: times, some: times, reach: 0.3 }
    }
}

/// Resolves the collisions of a heap that moves.
fn resolve(heap: &Heap, ranks: &Ranks, starts: &[usize], moves: Moves, may_rewind: bool) -> Outcome {
    let mut surface = heap.surface(ranks, starts);
    let nodes = surface.nodes().clone();
    surface.change_mobility(|mobility| {
        for node in nodes.own() {
            match nodes.number(node as u32) {
                number if number.is_multiple_of(31) => mobility[node] = Vec3::zeros(),
                number if number.is_multiple_of(23) => mobility[node].y = 0.0,
                _ => {}
            }
        }
    });
    let (mut search, mut proximity) = (PairSearch::new(), ProximityList::new(&surface));
    let mut start = heap.at(&surface, 0);
    proximity.rebuild(&mut surface, &mut search, &mut start, moves.reach, 1e-6, None);
    let times = |node: usize| match surface.nodes().number(node as u32) {
        number if number.is_multiple_of(16) => moves.some,
        _ => moves.usual,
    };
    let paths = start.iter().zip(heap.at(&surface, 1)).enumerate();
    let end = paths.map(|(node, (a, b))| a + (b - a) * times(node)).collect();
    let mut paths = NodePaths { start, end };
    let used = proximity.update_displacements(&surface, [&paths.start, &paths.end].map(Vec::as_slice), [0.0; 2]);
    let departure = Departure::of(used, &proximity, surface.nodes());
    let ignored = |pair: &Pair| pair.nodes[0].is_multiple_of(97);
    let mut collisions = Collisions {
        surface: &mut surface,
        gap: 1e-6,
        duration: 0.1,
        ignored: &ignored,
        may_rewind,
        strategy: Strategy::Usual,
    };
    let mut metrics = Metrics::default();
    let mut work = CollisionLoop::default();
    let resolution = work.resolve(&mut collisions, &mut proximity, &mut search, &mut paths, departure, &mut metrics);
    let nodes = surface.nodes();
    let mut refreshed = paths.end.clone();
    nodes.update(&mut refreshed);
    assert_eq!(refreshed, paths.end, "copies end where their owners do");
    Outcome {
        ends: nodes.own().map(|node| paths.end[node]).map(|x| [x.x, x.y, x.z].map(f64::to_bits)).collect(),
        moved: resolution.moved.iter().map(|node| nodes.number(*node)).collect(),
        is_hard: resolution.hard,
        is_pinched: resolution.pinched,
        is_rewound: resolution.rewound,
        counts: ranks.sum_of(COUNTS.map(|name| metrics.counted(name))),
    }
}

/// The outcome on one rank, which is checked to be that on several.
fn check(random: &mut SplitMix64, mixed: bool, moves: Moves, may_rewind: bool) -> Outcome {
    let heap = Arc::new(Heap::random(random, mixed));
    check_heap(random, heap, moves, may_rewind)
}

fn check_heap(random: &mut SplitMix64, heap: Arc<Heap>, moves: Moves, may_rewind: bool) -> Outcome {
    let alone = resolve(&heap, &Ranks::default(), &heap.cut(random, 1), moves, may_rewind);
    for count in [2, 3, 5] {
        let (heap, starts) = (heap.clone(), heap.cut(random, count));
        let found = on_ranks(count, move |ranks| resolve(&heap, &ranks, &starts, moves, may_rewind));
        for rank in &found {
            let flags = |outcome: &Outcome| [outcome.is_hard, outcome.is_pinched, outcome.is_rewound];
            assert_eq!((flags(rank), rank.counts), (flags(&alone), alone.counts), "{count} ranks");
        }
        let moved: Vec<u32> = found.iter().flat_map(|rank| &rank.moved).copied().collect();
        assert_eq!(moved, alone.moved, "{count} ranks");
        let ends: Vec<[u64; 3]> = found.iter().flat_map(|rank| &rank.ends).copied().collect();
        assert!(ends == alone.ends, "{count} ranks");
    }
    alone
}

#[test]
fn impulses_and_small_zones_give_the_same_bits_on_any_number_of_ranks() {
    let mut random = SplitMix64::new(51);
    for mixed in [false, true] {
        let outcome = check(&mut random, mixed, Moves::all(5.0), false);
        assert!(outcome.counted("collision_hits") > 100 && outcome.counted("zones") > 0, "{:?}", outcome.counts);
        assert!(outcome.counted("swept_renewals") > 1, "ghosts come and go meanwhile");
    }
}

#[test]
fn searching_the_paths_of_few_nodes_finds_what_searching_all_paths_finds_on_any_number_of_ranks() {
    let mut random = SplitMix64::new(54);
    for mixed in [false, true] {
        let heap = Arc::new(Heap::random(&mut random, mixed));
        let few = Moves { usual: 0.05, some: 12.0, reach: 0.3 };
        let outcome = check_heap(&mut random, heap.clone(), few, false);
        assert!(outcome.counted("swept_renewals") > 0, "few nodes have left the list: {:?}", outcome.counts);
        assert!(outcome.counted("collision_hits") > 10, "{:?}", outcome.counts);
        let all = check_heap(&mut random, heap, Moves { reach: 0.01, ..few }, false);
        assert_eq!(all.counted("swept_searches"), 1, "all nodes have left the list: {:?}", all.counts);
        assert_eq!((outcome.ends, outcome.moved), (all.ends, all.moved));
    }
}

#[test]
fn large_zones_that_let_go_and_turn_give_the_same_bits_on_any_number_of_ranks() {
    let mut random = SplitMix64::new(52);
    for mixed in [false, true] {
        let outcome = check(&mut random, mixed, Moves::all(25.0), false);
        assert!(["zones_large", "zones_rigid", "pairs_pinched"].iter().all(|name| outcome.counted(name) > 0));
        assert!(outcome.is_hard && outcome.is_pinched && !outcome.is_rewound);
    }
}

#[test]
fn any_number_of_ranks_rewinds_a_hard_collision_step() {
    let mut random = SplitMix64::new(53);
    let outcome = check(&mut random, false, Moves::all(25.0), true);
    assert!(outcome.is_rewound);
}

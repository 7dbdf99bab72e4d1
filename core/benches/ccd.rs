//! Queries a second of continuous collision detection, one thread: `cargo bench -p drapery-core --bench ccd`.
//!
//! Queries are the size of cloth, edges of about a centimetre, with the solver's gap of a micrometre and swept boxes
//! that overlap, as a tree hands them out; the motion of a collision step is a tenth of an edge (most pairs miss) or
//! a whole one. Prints the fastest and the median of some passes, over all queries and over those that miss.

use std::hint::black_box;
use std::time::Instant;

use drapery_core::Vec3;
use drapery_core::contact::ccd::{Contact, edge_edge, point_triangle};
use drapery_core::geometry::random::SplitMix64;

/// Queries of each kind.
const COUNT: usize = 20_000;

/// Times that all are asked.
const PASSES: usize = 25;

/// Length of an edge [m].
const EDGE: f64 = 0.01;

/// The solver's gap [m].
const GAP: f64 = 1e-6;

type Query = [[Vec3; 4]; 2];
type Ask = fn(&[Vec3; 4], &[Vec3; 4], f64) -> Option<Contact>;

/// Do the boxes around the motions of the first `split` points and of the others overlap?
fn swept_boxes_overlap(query: &Query, split: usize) -> bool {
    let bounds = |points: std::ops::Range<usize>| {
        let moved = query.iter().flat_map(|x| x[points.clone()].to_vec());
        moved.fold([Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN)], |[low, high], x| [low.inf(&x), high.sup(&x)])
    };
    let ([low, high], [other_low, other_high]) = (bounds(0..split), bounds(split..4));
    (0..3).all(|i| low[i] <= other_high[i] && other_low[i] <= high[i])
}

/// Queries whose points move by up to `motion`, together by as much again.
fn queries(motion: f64, split: usize) -> Vec<Query> {
    let mut random = SplitMix64::new(1);
    let mut found = Vec::new();
    while found.len() < COUNT {
        let start = [(); 4].map(|()| random.vector() * EDGE);
        let drift = random.vector() * motion;
        let query = [start, start.map(|x| x + drift + random.vector() * motion)];
        if swept_boxes_overlap(&query, split) {
            found.push(query);
        }
    }
    found
}

/// Fastest and median nanoseconds of a query.
fn time(queries: &[Query], ask: Ask) -> [f64; 2] {
    let mut passes: Vec<f64> = (0..PASSES)
        .map(|_| {
            let begin = Instant::now();
            queries.iter().for_each(|[start, end]| {
                black_box(ask(start, end, GAP));
            });
            begin.elapsed().as_secs_f64() * 1e9 / queries.len() as f64
        })
        .collect();
    passes.sort_unstable_by(f64::total_cmp);
    [passes[0], passes[PASSES / 2]]
}

fn main() {
    println!("query, motion, which: queries, fastest (median) ns each, million a second");
    let kinds: [(&str, usize, Ask); 2] = [("point, triangle", 1, point_triangle), ("edge, edge", 2, edge_edge)];
    for (name, split, ask) in kinds {
        for motion in [0.1 * EDGE, EDGE] {
            let all = queries(motion, split);
            let misses = all.iter().filter(|[start, end]| ask(start, end, GAP).is_none()).copied().collect();
            let hits = all.iter().filter(|[start, end]| ask(start, end, GAP).is_some()).copied().collect();
            for (which, queries) in [("all", all), ("misses", misses), ("hits", hits)] {
                let [fastest, median] = time(&queries, ask);
                println!(
                    "{name:<16} {:>4.1} mm {which:<7} {:>6} {fastest:>7.1} ns ({median:.1} ns) {:>7.2}",
                    motion * 1e3,
                    queries.len(),
                    1e3 / fastest
                );
            }
        }
    }
}

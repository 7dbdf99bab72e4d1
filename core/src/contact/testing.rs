//! Helpers that tests of contact over several ranks share.

use std::sync::mpsc::channel;
use std::time::Duration;

use crate::contact::topology::nodes::ContactNodes;
use crate::geometry::random::SplitMix64;
use crate::parallel::local_ranks::LocalRanks;
use crate::parallel::ranks::Ranks;

/// Ranks that take longer than this in a test wait for each other for ever [s]; far beyond what a loaded machine needs.
const LIMIT: u64 = 1200;

/// Runs `work` on `count` ranks, and returns its result on each.
pub(crate) fn on_ranks<T: Send + 'static>(count: usize, work: impl Fn(Ranks) -> T + Send + Sync + 'static) -> Vec<T> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || sender.send(LocalRanks::run(count, 1, |communicator| work(Ranks::new(communicator)))));
    let results = receiver.recv_timeout(Duration::from_secs(LIMIT)).expect("ranks wait for each other");
    results.unwrap_or_else(|error| panic!("{error}"))
}

/// A number below `count`.
pub(crate) fn below(random: &mut SplitMix64, count: usize) -> usize {
    ((random.signed() + 1.0) * 0.5 * count as f64) as usize % count
}

/// First nodes of `ranks` ranks at random places, and the number of all at the end. Some ranks may have none.
pub(crate) fn random_starts(random: &mut SplitMix64, ranks: usize, nodes: usize) -> Vec<u32> {
    let mut starts: Vec<u32> = (1..ranks).map(|_| below(random, nodes + 1) as u32).collect();
    starts.extend([0, nodes as u32]);
    starts.sort_unstable();
    starts
}

/// The nodes of a rank that holds those of `all`, four nodes each by their numbers in the scene, that have a node of
/// its own; and these, by local nodes, each with its place in `all`.
pub(crate) fn held(
    ranks: &Ranks,
    starts: &[u32],
    bodies: usize,
    all: &[[u32; 4]],
) -> (ContactNodes, Vec<(usize, [u32; 4])>) {
    let own = starts[ranks.rank()]..starts[ranks.rank() + 1];
    let held = || all.iter().enumerate().filter(|(_, nodes)| nodes.iter().any(|node| own.contains(node)));
    let cloth = starts[starts.len() - 1];
    let is_ghost = |node: &u32| *node < cloth && !own.contains(node);
    let mut ghosts: Vec<u32> = held().flat_map(|(_, nodes)| *nodes).filter(is_ghost).collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    let nodes = ContactNodes::new(ranks, starts, ghosts, bodies);
    let local = |node: u32| nodes.local(node).expect("a node of a pair that is held is here");
    let pairs = held().map(|(place, pair)| (place, pair.map(local))).collect();
    (nodes, pairs)
}

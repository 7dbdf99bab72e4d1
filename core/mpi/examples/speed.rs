//! Speed of communication between ranks: as MPI processes under `mpirun`, else as two threads of this process.
//!
//! ```sh
//! cargo build --release --package drapery-mpi --examples
//! target/release/examples/speed
//! mpirun -n 2 target/release/examples/speed
//! ```

use std::time::Instant;

use drapery_core::parallel::communicator::{Communicator, Expected, Message};
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_mpi::World;

/// Number of repetitions of a measurement.
const TRIES: usize = 20;

fn main() -> Result<(), String> {
    match World::start().map_err(|e| e.to_string())? {
        Some(world) => measure(&world),
        None => drop(LocalRanks::run(2, 1, |comm| measure(&*comm)).map_err(|e| e.to_string())?),
    }
    Ok(())
}

/// Prints, on rank 0, microseconds per call, and megabytes per second that a rank sends while it receives as many. Filling
/// the messages is part of it; threads then hand over the memory itself.
fn measure(comm: &dyn Communicator) {
    let ranks = comm.ranks();
    let report = |what: &str, bytes: usize, repeat: usize, seconds: f64| {
        if comm.rank() == 0 {
            let (each, rate) = (1e6 * seconds / repeat as f64, 1e-6 * (bytes * repeat) as f64 / seconds);
            println!("{ranks} ranks  {what:<18} {bytes:>9} bytes  {each:>10.2} µs  {rate:>8.1} MB/s");
        }
    };
    report("barrier", 0, 200, timed(comm, 200, || comm.barrier()));
    report("max", 8, 200, timed(comm, 200, || comm.max(&mut [1.0])));
    for bytes in [8, 4096, 65_536] {
        let (own, lengths) = (vec![1; bytes], vec![bytes; ranks]);
        report("all_gather", bytes, 200, timed(comm, 200, || drop(comm.all_gather(&own, &lengths))));
    }
    for (bytes, repeat) in [(8, 200), (4096, 200), (65_536, 50), (1 << 20, 10), (1 << 24, 1), (1 << 26, 1)] {
        for known in [true, false] {
            let what = if known { "exchange, known" } else { "exchange, unknown" };
            report(what, bytes, repeat, timed(comm, repeat, || exchange_round(comm, bytes, known)));
        }
    }
}

/// Seconds that `repeat` calls take. The best of some tries: other programs on the machine can only make it longer.
fn timed(comm: &dyn Communicator, repeat: usize, call: impl Fn()) -> f64 {
    let try_once = |_| {
        comm.barrier();
        let start = Instant::now();
        (0..repeat).for_each(|_| call());
        start.elapsed().as_secs_f64()
    };
    (0..TRIES).map(try_once).fold(f64::INFINITY, f64::min)
}

/// Each rank sends to the next one.
fn exchange_round(comm: &dyn Communicator, bytes: usize, known: bool) {
    let (rank, ranks) = (comm.rank(), comm.ranks());
    let from = [Expected { from: (rank + ranks - 1) % ranks, length: known.then_some(bytes) }];
    comm.start(vec![Message { to: (rank + 1) % ranks, bytes: vec![1; bytes] }], &from).finish();
}

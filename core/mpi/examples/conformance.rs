//! Checks MPI ranks against the promises of a communicator, or lets one of them fail.
//!
//! ```sh
//! cargo build --release --package drapery-mpi --examples
//! mpirun -n 4 target/release/examples/conformance           # rank 0 says what has been checked
//! mpirun -n 4 target/release/examples/conformance panic     # rank 2 panics while the others wait for it
//! mpirun -n 4 target/release/examples/conformance abort     # rank 2 ends the job with exit code 3
//! mpirun -n 4 target/release/examples/conformance wait      # all say their process, then wait for rank 0's end of input
//! ```

use drapery_core::parallel::communicator::{Communicator, Expected};
use drapery_core::parallel::serial::Serial;
use drapery_mpi::World;
use drapery_tests::conformance::conformance;

fn main() -> Result<(), String> {
    let world = World::start().map_err(|e| e.to_string())?;
    let comm: &dyn Communicator = world.as_ref().map_or(&Serial, |world| world);
    // MPI is called from a thread of a pool, as the solver does.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().map_err(|e| e.to_string())?;
    let todo = std::env::args().nth(1).unwrap_or_default();
    pool.install(|| match todo.as_str() {
        "" => {
            conformance(comm);
            if comm.rank() == 0 {
                println!("{} ranks keep the promises", comm.ranks());
            }
        }
        "panic" | "abort" => {
            conformance(comm);
            if comm.rank() == 2.min(comm.ranks() - 1) {
                match todo.as_str() {
                    "panic" => rayon::join(|| (), || panic!("the cloth has come apart")),
                    _ => drapery_mpi::abort(3),
                };
            }
            wait_for_the_next(comm);
        }
        "wait" => {
            println!("rank {} is process {}", comm.rank(), std::process::id());
            if comm.rank() == 0 {
                let _ = std::io::stdin().lines().count();
            }
            wait_for_the_next(comm);
        }
        other => panic!("there is nothing called {other:?} to check"),
    });
    Ok(())
}

/// Waits for a message that nobody sends.
fn wait_for_the_next(comm: &dyn Communicator) {
    let next = Expected { from: (comm.rank() + 1) % comm.ranks(), length: None };
    comm.start(Vec::new(), &[next]).finish();
}

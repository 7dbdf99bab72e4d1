//! Ranks as processes of an MPI job: [`World`] is a [`Communicator`], and [`heartbeats`] notice that a rank is lost.
//!
//! ```
//! use std::sync::Arc;
//! use drapery_core::parallel::{communicator::Communicator, serial::Serial};
//!
//! let ranks: Arc<dyn Communicator> = match drapery_mpi::World::start()? {
//!     Some(world) => Arc::new(world),
//!     None => Arc::new(Serial),
//! };
//! assert!(ranks.rank() < ranks.ranks()); // alone, unless a launcher such as mpirun has started this program
//! # Ok::<(), drapery_mpi::StartError>(())
//! ```
//!
//! Limits: messages move while a rank computes only as far as the MPI library sees to it by itself; most libraries send
//! small ones at once and large ones when both ranks are inside a call.

mod addresses;
mod connections;
mod exchange;
pub mod heartbeats;

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use drapery_core::parallel::communicator::{Communicator, Exchange, Expected, Message};
use mpi::Threading;
use mpi::collective::SystemOperation;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, CommunicatorCollectives as _, Root as _};

pub use crate::connections::How;
use crate::exchange::{EXCHANGE, GATHER, PIECE, Underway};

/// Exit code of a job in which a rank panicked: an internal error.
const INTERNAL_ERROR: i32 = 70;

/// Variables by which launchers say how many processes they have started: Open MPI's, and those of MPICH, Intel and
/// Slurm.
const SIZES: [&str; 2] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"];

/// Variables of launchers that say only that they are there.
const PRESENT: [&str; 2] = ["PMIX_RANK", "PMI_RANK"];

/// Why a rank could not join the others.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StartError {
    /// The launcher and the library belong to different MPIs.
    #[error(
        "started as one of {started} processes, but the MPI library sees {seen}: program and launcher use different \
         MPI installations ({library})\n  help: start it with the mpirun of that library, or build it with the MPI of \
         this mpirun (MPICC=...)"
    )]
    OtherLauncher {
        /// Processes that the launcher says it has started.
        started: usize,
        /// Ranks that the library knows.
        seen: usize,
        /// Name and version of the library.
        library: String,
    },
    /// Ranks use MPI from the threads of their pools.
    #[error(
        "the MPI library can be called from one thread only ({library})\n  help: build it with support of \
         MPI_THREAD_SERIALIZED, as the packages of Debian are"
    )]
    Threads {
        /// Name and version of the library.
        library: String,
    },
    /// MPI can be started once in the life of a process.
    #[error("MPI has been started before in this process\n  help: keep the first World and share it")]
    Again,
}

/// All ranks of the job. MPI ends with it, which waits for all ranks to come to their end: a rank that has to end
/// without the others calls [`abort`].
///
/// Open MPI's `mpirun` ends the other processes as soon as one process returns another exit code than zero, even after MPI
/// has ended. So rank 0, the last to have work, returns the code of the job, and the others return zero.
pub struct World {
    rank: usize,
    ranks: usize,
    /// Held during every call: threads of a rank may call MPI in turn, never at once.
    turn: Mutex<()>,
    exchanging: AtomicBool,
    /// Ends MPI when dropped.
    _universe: Universe,
}

impl World {
    /// Joins the ranks that a launcher such as `mpirun` has started; none if this process was started alone.
    ///
    /// From here on a panic, on any thread, prints its message with the number of the rank and ends all ranks with exit
    /// code 70. To be called by the main thread, which also drops the world.
    pub fn start() -> Result<Option<Self>, StartError> {
        let sizes = SIZES.iter().filter_map(|name| std::env::var(name).ok()?.parse::<usize>().ok());
        let started: Option<usize> = sizes.max();
        if started.is_none() && PRESENT.iter().all(|name| std::env::var_os(name).is_none()) {
            return Ok(None);
        }
        let (universe, threading) = mpi::initialize_with_threading(Threading::Serialized).ok_or(StartError::Again)?;
        if threading < Threading::Serialized {
            return Err(StartError::Threads { library: library_name() });
        }
        let (rank, ranks) = (universe.world().rank() as usize, universe.world().size() as usize);
        if let Some(started) = started.filter(|started| *started != ranks) {
            return Err(StartError::OtherLauncher { started, seen: ranks, library: library_name() });
        }
        end_the_job_on_panic(rank, ranks);
        let (turn, exchanging) = (Mutex::new(()), AtomicBool::new(false));
        Ok(Some(Self { rank, ranks, turn, exchanging, _universe: universe }))
    }

    /// MPI's own world, and the right to call it.
    fn mpi(&self) -> (SimpleCommunicator, MutexGuard<'_, ()>) {
        (SimpleCommunicator::world(), self.turn.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Gathers what fits into one call.
    fn all_gather_at_once(&self, own: &[u8], lengths: &[usize]) -> Vec<u8> {
        if lengths.iter().all(|length| *length == 0) {
            return Vec::new();
        }
        // The address of an empty slice may be 1, which is Open MPI's MPI_IN_PLACE.
        let own = if own.is_empty() { &[0][..0] } else { own };
        let counts: Vec<i32> = lengths.iter().map(|length| count(*length)).collect();
        let starts: Vec<i32> = counts.iter().scan(0, |end, n| Some(std::mem::replace(end, *end + n))).collect();
        let mut all = vec![0; lengths.iter().sum()];
        let (world, _turn) = self.mpi();
        world.all_gather_varcount_into(own, &mut PartitionMut::new(&mut all[..], counts, starts));
        all
    }
}

/// Ends all ranks at once; `mpirun` returns the code. Says nothing: the caller has printed why.
///
/// For errors of this rank alone: the others may be waiting for it, and would for ever. Without MPI ends this process.
pub fn abort(code: i32) -> ! {
    if mpi::environment::is_initialized() && !mpi::environment::is_finalized() {
        // Takes no turn: whatever another thread is doing inside MPI ends here.
        SimpleCommunicator::world().abort(code);
    }
    std::process::exit(code)
}

/// The others cannot go on without a rank that panics, and would wait for it.
fn end_the_job_on_panic(rank: usize, ranks: usize) {
    std::panic::set_hook(Box::new(move |panic| {
        let backtrace = std::backtrace::Backtrace::capture();
        let backtrace = match backtrace.status() {
            std::backtrace::BacktraceStatus::Captured => format!("\n{backtrace}"),
            _ => String::new(),
        };
        // In one piece: all ranks write to the same terminal.
        let message = format!("rank {rank} of {ranks}: {panic}{backtrace}\n");
        let _ = std::io::stderr().write_all(message.as_bytes());
        abort(INTERNAL_ERROR)
    }));
}

/// Name and version of the MPI library, without how it was built.
fn library_name() -> String {
    let all = mpi::environment::library_version().unwrap_or_default();
    all.split([',', '\n', '\0']).next().unwrap_or_default().replace('\t', " ")
}

/// A number of bytes as MPI counts them.
fn count(length: usize) -> i32 {
    i32::try_from(length).expect("longer messages go in pieces")
}

/// Numbers in the order of values (the negative zero before the positive one), and back.
fn ordered(bits: i64) -> i64 {
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

impl Communicator for World {
    fn rank(&self) -> usize {
        self.rank
    }

    fn ranks(&self) -> usize {
        self.ranks
    }

    fn barrier(&self) {
        let (world, _turn) = self.mpi();
        world.barrier();
    }

    fn max(&self, values: &mut [f64]) {
        if values.is_empty() {
            return;
        }
        // Integers, because the largest of two zeros would depend on the order in which the library compares them.
        let own: Vec<i64> = values.iter().map(|value| ordered(value.to_bits() as i64)).collect();
        let mut largest = own.clone();
        let (world, _turn) = self.mpi();
        world.all_reduce_into(&own[..], &mut largest[..], SystemOperation::max());
        values.iter_mut().zip(largest).for_each(|(to, bits)| *to = f64::from_bits(ordered(bits) as u64));
    }

    fn broadcast(&self, bytes: &mut Vec<u8>) {
        let (world, _turn) = self.mpi();
        let first = world.process_at_rank(0);
        let mut length = [bytes.len() as u64];
        first.broadcast_into(&mut length[..]);
        bytes.resize(length[0] as usize, 0);
        bytes.chunks_mut(PIECE).for_each(|piece| first.broadcast_into(piece));
    }

    fn all_gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8> {
        assert_eq!(own.len(), lengths[self.rank], "a rank gives as many bytes as all ranks expect of it");
        // MPI counts the bytes of all ranks together in 31 bits.
        let at_once = PIECE.min(i32::MAX as usize / self.ranks);
        let longest = lengths.iter().copied().max().unwrap_or(0);
        if longest <= at_once {
            return self.all_gather_at_once(own, lengths);
        }
        let mut all: Vec<Vec<u8>> = lengths.iter().map(|length| Vec::with_capacity(*length)).collect();
        for start in (0..longest).step_by(at_once) {
            let part = |length: usize| start.min(length)..(start + at_once).min(length);
            let counts: Vec<usize> = lengths.iter().map(|length| part(*length).len()).collect();
            let received = self.all_gather_at_once(&own[part(own.len())], &counts);
            let mut rest = &received[..];
            for (all, count) in all.iter_mut().zip(counts) {
                all.extend_from_slice(rest.split_off(..count).expect("as much was received as was asked for"));
            }
        }
        all.concat()
    }

    fn gather(&self, own: Vec<u8>) -> Vec<Vec<u8>> {
        if self.rank > 0 {
            Underway::start(self, vec![Message { to: 0, bytes: own }], &[], GATHER).wait();
            return Vec::new();
        }
        let others: Vec<Expected> = (1..self.ranks).map(|from| Expected { from, length: None }).collect();
        let received = Underway::start(self, Vec::new(), &others, GATHER).wait();
        std::iter::once(own).chain(received).collect()
    }

    fn start(&self, messages: Vec<Message>, from: &[Expected]) -> Box<dyn Exchange + '_> {
        let unfinished = self.exchanging.swap(true, Ordering::Relaxed);
        assert!(!unfinished, "an exchange is finished before the next one starts");
        Box::new(Underway::start(self, messages, from, EXCHANGE))
    }
}

impl Exchange for Underway<'_> {
    fn finish(self: Box<Self>) -> Vec<Vec<u8>> {
        let world = self.world();
        let received = self.wait();
        world.exchanging.store(false, Ordering::Relaxed);
        received
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_stand_for_values_in_their_order() {
        let values = [f64::NEG_INFINITY, -1.5, -f64::MIN_POSITIVE, -0.0, 0.0, 1e-300, 2.0, f64::INFINITY];
        let keys = values.map(|value| ordered(value.to_bits() as i64));
        assert!(keys.is_sorted_by(|a, b| a < b));
        assert_eq!(keys.map(|key| ordered(key) as u64), values.map(f64::to_bits));
    }
}

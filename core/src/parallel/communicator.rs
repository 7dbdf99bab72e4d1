//! Ranks that work on one scene, and how they speak with each other: the only thing the solver knows of message passing.
//!
//! All ranks call the same methods in the same order. Two ranks receive each other's messages in the order in which they were
//! sent. A rank that is lost ends the others: nothing here returns an error, because nothing can go on without a part of
//! the cloth (`local_ranks` says how its ranks end; the MPI library ends the whole job when a process
//! ends, and heartbeats of `core/mpi` do when one falls silent).
//!
//! Nothing communicates inside a parallel loop, so that ranks and the threads of a pool never wait for one another.

/// One of the ranks of a run. A program implements it over its own message passing.
///
/// ```
/// use drapery_core::LocalRanks;
/// let largest = LocalRanks::run(3, 1, |communicator| {
///     let mut values = [communicator.rank() as f64];
///     communicator.max(&mut values);
///     values[0]
/// });
/// assert_eq!(largest, Ok(vec![2.0; 3]));
/// ```
pub trait Communicator: Send + Sync {
    /// Number of this rank, from zero.
    fn rank(&self) -> usize;

    /// Number of ranks.
    fn ranks(&self) -> usize;

    /// Waits until all ranks have come here.
    fn barrier(&self);

    /// Replaces every value by the largest of all ranks. Values are not NaN.
    fn max(&self, values: &mut [f64]);

    /// Replaces the bytes of every rank by those of rank 0.
    fn broadcast(&self, bytes: &mut Vec<u8>);

    /// The bytes of all ranks, one after the other; `lengths` says how many each gives, alike on all ranks.
    fn all_gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8>;

    /// The bytes of all ranks in the order of ranks on rank 0; nothing on the others.
    fn gather(&self, own: Vec<u8>) -> Vec<Vec<u8>>;

    /// Starts to send messages and to receive one from each rank of `from`, neither of which is this rank; the bytes go on
    /// their way while the caller works. The receiving rank waits for the sending one, and the other way round.
    fn start(&self, messages: Vec<Message>, from: &[Expected]) -> Box<dyn Exchange + '_>;
}

/// Bytes for another rank.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// The rank that gets them.
    pub to: usize,
    /// Bytes that it gets.
    pub bytes: Vec<u8>,
}

/// A message that will come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Expected {
    /// The rank that sends it.
    pub from: usize,
    /// Its length, if that is known: such a message can arrive while the receiver works.
    pub length: Option<usize>,
}

/// Messages on their way. Has to be finished before the next exchange starts.
pub trait Exchange {
    /// Waits for all of them: what was received, in the order in which it was expected.
    fn finish(self: Box<Self>) -> Vec<Vec<u8>>;
}

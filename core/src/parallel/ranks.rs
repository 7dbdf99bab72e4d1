//! The ranks of a run as the solver uses them: typed messages over a [`Communicator`], counted.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use bytemuck::Pod;

use crate::clock::Watch;
use crate::parallel::communicator::{Communicator, Exchange, Expected, Message};
use crate::parallel::message::{self, Codec};
use crate::parallel::serial::Serial;

/// This rank, and the way to the others.
///
/// ```
/// use drapery_core::{LocalRanks, Ranks};
/// let alone = Ranks::default();
/// assert!(alone.is_alone() && alone.is_first());
/// let found = LocalRanks::run(3, 1, |communicator| Ranks::new(communicator).max(0.5));
/// assert_eq!(found, Ok(vec![0.5; 3]));
/// ```
#[derive(Clone)]
pub struct Ranks {
    communicator: Arc<dyn Communicator>,
    traffic: Arc<Traffic>,
}

/// Counters of the messages that a rank has sent.
#[derive(Debug, Default)]
struct Traffic {
    messages: AtomicU64,
    exchanges: AtomicU64,
    bytes: AtomicU64,
    collectives: AtomicU64,
    /// Nanoseconds spent in waiting for others.
    waited: AtomicU64,
}

/// Traffic that a rank has sent so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sent {
    /// Messages to single ranks.
    pub messages: u64,
    /// Exchanges of such messages, in which the rank sends to some ranks and gets something from some at one time.
    pub exchanges: u64,
    /// Bytes given away, in messages and collective operations.
    pub bytes: u64,
    /// Collective operations, in which all ranks take part.
    pub collectives: u64,
}

impl Traffic {
    fn waiting<T>(&self, operation: impl FnOnce() -> T) -> T {
        let watch = Watch::start();
        let result = operation();
        self.waited.fetch_add(watch.nanoseconds(), Relaxed);
        result
    }
}

/// Messages on their way, for which the time of the wait is noted.
struct Waited<'a> {
    exchange: Box<dyn Exchange + 'a>,
    traffic: &'a Traffic,
}

impl Exchange for Waited<'_> {
    fn finish(self: Box<Self>) -> Vec<Vec<u8>> {
        self.traffic.waiting(|| self.exchange.finish())
    }
}

impl std::fmt::Debug for Ranks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "rank {} of {}", self.rank(), self.count())
    }
}

impl Default for Ranks {
    /// One rank alone.
    fn default() -> Self {
        Self::new(Arc::new(Serial))
    }
}

impl Ranks {
    /// The ranks of a communicator.
    pub fn new(communicator: Arc<dyn Communicator>) -> Self {
        Self { communicator, traffic: Arc::default() }
    }

    /// Number of this rank.
    pub fn rank(&self) -> usize {
        self.communicator.rank()
    }

    /// Number of ranks.
    pub fn count(&self) -> usize {
        self.communicator.ranks()
    }

    /// Whether there is no other rank.
    pub fn is_alone(&self) -> bool {
        self.count() == 1
    }

    /// Whether this is rank 0, which reads and writes.
    pub fn is_first(&self) -> bool {
        self.rank() == 0
    }

    /// Messages and bytes that this rank has sent so far.
    pub fn sent(&self) -> Sent {
        let Traffic { messages, exchanges, bytes, collectives, .. } = &*self.traffic;
        let [messages, exchanges, bytes, collectives] =
            [messages, exchanges, bytes, collectives].map(|count| count.load(Relaxed));
        Sent { messages, exchanges, bytes, collectives }
    }

    /// Seconds that this rank has waited for others so far, the way of the messages included.
    pub(crate) fn waited(&self) -> f64 {
        Duration::from_nanos(self.traffic.waited.load(Relaxed)).as_secs_f64()
    }

    /// Takes part in a collective operation with a contribution of `bytes` bytes.
    fn together<T>(&self, bytes: usize, operation: impl FnOnce(&dyn Communicator) -> T) -> T {
        self.traffic.collectives.fetch_add(1, Relaxed);
        self.traffic.bytes.fetch_add(bytes as u64, Relaxed);
        self.traffic.waiting(|| operation(&*self.communicator))
    }

    /// Waits for all ranks.
    pub fn barrier(&self) {
        self.together(0, |communicator| communicator.barrier());
    }

    /// The largest value of all ranks. Not NaN.
    pub fn max(&self, value: f64) -> f64 {
        let [largest] = self.max_of([value]);
        largest
    }

    /// The largest of all ranks, value by value. None is NaN.
    pub(crate) fn max_of<const N: usize>(&self, mut values: [f64; N]) -> [f64; N] {
        if !self.is_alone() {
            self.together(N * size_of::<f64>(), |communicator| communicator.max(&mut values));
        }
        values
    }

    /// The largest of all ranks, value by value; all have as many.
    pub(crate) fn max_each(&self, mut values: Vec<f64>) -> Vec<f64> {
        if !self.is_alone() && !values.is_empty() {
            self.together(size_of_val(values.as_slice()), |communicator| communicator.max(&mut values));
        }
        values
    }

    /// Whether it holds on some rank.
    pub fn any(&self, holds: bool) -> bool {
        let [any] = self.any_of([holds]);
        any
    }

    /// Whether each of these holds on some rank.
    pub(crate) fn any_of<const N: usize>(&self, hold: [bool; N]) -> [bool; N] {
        self.max_of(hold.map(|holds| f64::from(u8::from(holds)))).map(|largest| largest > 0.0)
    }

    /// Sums of counts over all ranks, value by value.
    pub(crate) fn sum_of<const N: usize>(&self, values: [u64; N]) -> [u64; N] {
        if self.is_alone() {
            return values;
        }
        let all = self.all_gather(&values, &vec![N; self.count()]);
        std::array::from_fn(|n| all.iter().skip(n).step_by(N).sum())
    }

    /// Sums of counts over all ranks, value by value; all have as many.
    pub(crate) fn sum_each(&self, values: Vec<u64>) -> Vec<u64> {
        if self.is_alone() {
            return values;
        }
        let all = self.all_gather(&values, &vec![values.len(); self.count()]);
        (0..values.len()).map(|n| all.iter().skip(n).step_by(values.len()).sum()).collect()
    }

    /// The values of all ranks in the order of ranks; `counts` says how many each gives.
    pub fn all_gather<T: Pod>(&self, own: &[T], counts: &[usize]) -> Vec<T> {
        if self.is_alone() {
            return own.to_vec();
        }
        let lengths: Vec<usize> = counts.iter().map(|count| count * size_of::<T>()).collect();
        let gather = |c: &dyn Communicator| c.all_gather(bytemuck::cast_slice(own), &lengths);
        message::rows(self.rank(), "rows of all ranks", &self.together(size_of_val(own), gather))
    }

    /// The values of all ranks, each by itself, where nobody knows how many others give.
    pub fn all_gather_v<T: Pod>(&self, own: &[T]) -> Vec<Vec<T>> {
        if self.is_alone() {
            return vec![own.to_vec()];
        }
        let counts = self.all_gather(&[own.len() as u64], &vec![1; self.count()]);
        let counts: Vec<usize> = counts.iter().map(|count| *count as usize).collect();
        if counts.iter().all(|count| *count == 0) {
            return vec![Vec::new(); counts.len()];
        }
        let mut rest = self.all_gather(own, &counts);
        let cut = |count: &usize| {
            let tail = rest.split_off(*count);
            std::mem::replace(&mut rest, tail)
        };
        counts.iter().map(cut).collect()
    }

    /// The values of all ranks in the order of ranks on rank 0; nothing elsewhere.
    pub fn gather<T: Pod>(&self, own: &[T]) -> Vec<Vec<T>> {
        if self.is_alone() {
            return vec![own.to_vec()];
        }
        let all = self.together(size_of_val(own), |c| c.gather(bytemuck::cast_slice(own).to_vec()));
        all.iter().map(|bytes| message::rows(self.rank(), "rows of a rank", bytes)).collect()
    }

    /// The values of all ranks, those of rank 0 first; `name` is for the error of a damaged message, as in the functions below.
    pub(crate) fn all_gather_encoded<T: Codec>(&self, name: &'static str, own: Vec<T>) -> Vec<T> {
        if self.is_alone() {
            return own;
        }
        let all = self.all_gather_v(&message::encode_all(&own));
        all.iter().flat_map(|bytes| message::decode_all(self.rank(), name, bytes)).collect()
    }

    /// The value of every rank in the order of ranks on rank 0; nothing elsewhere.
    ///
    /// # Panics
    /// The received bytes cannot be decoded.
    pub fn gather_encoded<T: Codec>(&self, name: &'static str, own: &T) -> Vec<T> {
        let all = self.gather(&own.to_bytes());
        all.iter().map(|bytes| message::decode(self.rank(), name, bytes)).collect()
    }

    /// The value of rank 0, on every rank; it is given there alone.
    ///
    /// # Panics
    /// The received bytes cannot be decoded.
    pub fn broadcast_encoded<T: Codec>(&self, name: &'static str, value: Option<T>) -> T {
        let mut bytes = Vec::new();
        if !self.is_alone() {
            value.iter().for_each(|value| value.put(&mut bytes));
            self.broadcast(&mut bytes);
        }
        match value {
            Some(value) if self.is_first() => value,
            _ => message::decode(self.rank(), name, &bytes),
        }
    }

    /// Returns the value that rank 0 has for this rank: `value_of` makes it there, for one rank after the other.
    pub(crate) fn scatter_encoded<T: Codec>(&self, name: &'static str, value_of: impl Fn(usize) -> T) -> T {
        if !self.is_first() {
            let received = self.start(Vec::new(), &[Expected { from: 0, length: None }]).finish();
            return message::decode(self.rank(), name, &received[0]);
        }
        for to in 1..self.count() {
            self.start(vec![Message { to, bytes: value_of(to).to_bytes() }], &[]).finish();
        }
        value_of(0)
    }

    /// Gives every rank its list; returns what each rank gave this one. A list for this rank comes back as it is.
    pub(crate) fn all_to_all_encoded<T: Codec>(&self, name: &'static str, mut lists: Vec<Vec<T>>) -> Vec<Vec<T>> {
        if self.is_alone() {
            return lists;
        }
        let mine = std::mem::take(&mut lists[self.rank()]);
        // Each list is forgotten when it is encoded.
        let encoded = lists.into_iter().map(|list| message::encode_all(&list)).collect();
        let received = self.all_to_all_v(encoded);
        let mut all: Vec<Vec<T>> = received.iter().map(|bytes| message::decode_all(self.rank(), name, bytes)).collect();
        all[self.rank()] = mine;
        all
    }

    /// The bytes of rank 0, on every rank.
    pub fn broadcast(&self, bytes: &mut Vec<u8>) {
        if !self.is_alone() {
            let given = if self.is_first() { bytes.len() } else { 0 };
            self.together(given, |communicator| communicator.broadcast(bytes));
        }
    }

    /// Starts messages to some ranks and from others.
    pub fn start<'a>(&'a self, messages: Vec<Message>, from: &[Expected]) -> Box<dyn Exchange + 'a> {
        self.traffic.exchanges.fetch_add(u64::from(!messages.is_empty() || !from.is_empty()), Relaxed);
        self.traffic.messages.fetch_add(messages.len() as u64, Relaxed);
        self.traffic.bytes.fetch_add(messages.iter().map(|m| m.bytes.len() as u64).sum(), Relaxed);
        Box::new(Waited { exchange: self.communicator.start(messages, from), traffic: &self.traffic })
    }

    /// Sends the values of one rank to rank 0, which gets them; nothing elsewhere. Only these two ranks need to call it.
    pub(crate) fn send_to_root<T: Pod>(&self, from: usize, own: &[T]) -> Vec<T> {
        if self.rank() == from {
            self.start(vec![Message::of_rows(0, own)], &[]).finish();
        } else if self.is_first() {
            let received = self.start(Vec::new(), &[Expected { from, length: None }]).finish();
            return message::rows(self.rank(), "rows for rank 0", &received[0]);
        }
        Vec::new()
    }

    /// Gives every rank its list; returns what each rank gave this one. A list for this rank comes back as it is.
    pub(crate) fn all_to_all_v<T: Pod>(&self, mut lists: Vec<Vec<T>>) -> Vec<Vec<T>> {
        if self.is_alone() {
            return lists;
        }
        let (rank, count) = (self.rank(), self.count());
        let mine = std::mem::take(&mut lists[rank]);
        // Who sends how much to whom; a message is sent only where there is something to say.
        let lengths: Vec<u64> = lists.iter().map(|list| size_of_val(list.as_slice()) as u64).collect();
        let lengths = self.all_gather(&lengths, &vec![count; count]);
        let to_me = |from: usize| lengths[from * count + rank] as usize;
        let expected: Vec<Expected> = (0..count)
            .filter(|&from| from != rank && to_me(from) > 0)
            .map(|from| Expected { from, length: Some(to_me(from)) })
            .collect();
        let filled = lists.iter().enumerate().filter(|(_, list)| !list.is_empty());
        let messages = filled.map(|(to, list)| Message::of_rows(to, list)).collect();
        let received = self.start(messages, &expected).finish();
        let mut all: Vec<Vec<T>> = (0..count).map(|_| Vec::new()).collect();
        for (expected, bytes) in expected.iter().zip(received) {
            all[expected.from] = message::rows(self.rank(), "rows for a rank", &bytes);
        }
        all[rank] = mine;
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::local_ranks::LocalRanks;

    /// Returns the error message about ranks that do this.
    fn said_of(work: impl Fn(&Ranks) + Sync) -> String {
        let ended = LocalRanks::run(2, 1, |communicator| work(&Ranks::new(communicator)));
        ended.map(|_| ()).expect_err("no rank continues without its message").to_string()
    }

    #[test]
    fn rows_that_cannot_be_decoded_end_all_ranks_and_are_named() {
        let said = said_of(|ranks| {
            let half_a_row = [0_u8; 6];
            match ranks.rank() {
                0 => drop(ranks.send_to_root::<u32>(1, &[])),
                _ => drop(ranks.send_to_root(1, &half_a_row)),
            }
            ranks.barrier();
        });
        assert!(said.contains("rank 0: the message \"rows for rank 0\" to rank 0 cannot be decoded"), "{said}");
        assert!(said.contains("rows of 4 (u32)"), "{said}");
    }

    #[test]
    fn encoded_values_that_cannot_be_decoded_end_all_ranks_and_are_named() {
        let said = said_of(|ranks| {
            match ranks.rank() {
                0 => drop(ranks.all_gather_encoded("garments", vec![String::from("skirt")])),
                _ => drop(ranks.all_gather_v(&[1_u8; 5])),
            }
            ranks.barrier();
        });
        assert!(said.contains("rank 0: the message \"garments\" to rank 0 cannot be decoded"), "{said}");
        // Nobody gives anything, which is not the same as an empty list.
        let said = said_of(|ranks| drop(ranks.broadcast_encoded::<Vec<u32>>("input", None)));
        assert!(said.contains("the message \"input\" to rank") && said.contains("and 0 are left"), "{said}");
    }

    #[test]
    fn encoded_values_reach_whom_they_are_for() {
        for count in 1..4 {
            let all = LocalRanks::run(count, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                let name = |from: usize, to: usize| format!("{from} to {to}");
                let to_all = (0..count).map(|to| vec![name(ranks.rank(), to); to]).collect();
                let received = ranks.all_to_all_encoded("names", to_all);
                let here = ranks.rank();
                assert!(received.into_iter().eq((0..count).map(|from| vec![name(from, here); here])));
                assert_eq!(ranks.scatter_encoded("name", |to| name(0, to)), name(0, here));
                assert_eq!(ranks.broadcast_encoded("name", ranks.is_first().then(|| name(0, 9))), name(0, 9));
                let gathered = ranks.all_gather_encoded("names", vec![name(here, 9); here]);
                assert!(gathered.into_iter().eq((0..count).flat_map(|from| vec![name(from, 9); from])));
                ranks.gather_encoded("name", &name(here, 0)).len()
            });
            let counts = all.expect("no rank ends early");
            assert!(counts.iter().enumerate().all(|(rank, got)| *got == if rank == 0 { count } else { 0 }));
        }
    }
}

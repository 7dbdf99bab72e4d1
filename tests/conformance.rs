//! Requirements on every implementation of communication between ranks. All ranks of a run call [`conformance`] together; a rank
//! that sees something else than promised panics, and its way of ending the others is part of the test.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use drapery_core::parallel::communicator::{Communicator, Expected, Message};

/// Checks all promises of `comm`.
pub fn conformance(comm: &dyn Communicator) {
    ranks_are_numbered_from_zero(comm);
    a_barrier_lets_nobody_pass_alone(comm);
    the_largest_value_reaches_everybody(comm);
    rank_0_tells_everybody(comm);
    everybody_learns_what_all_give(comm);
    rank_0_collects(comm);
    neighbours_exchange(comm);
    lengths_need_not_be_known(comm);
    many_small_messages_stay_in_order(comm);
    large_messages_cross(comm);
    work_goes_on_during_an_exchange(comm);
}

/// Bytes that say who wrote them for whom, and which message it was.
fn letter(from: usize, to: usize, number: usize, length: usize) -> Vec<u8> {
    // A period that is no power of two: no piece of a long message looks like the one before.
    let period: [u8; 251] = std::array::from_fn(|k| (31 * from + 17 * to + 7 * number + k) as u8);
    let mut bytes = period.repeat(length.div_ceil(period.len()));
    bytes.truncate(length);
    bytes
}

fn ranks_are_numbered_from_zero(comm: &dyn Communicator) {
    assert!(comm.rank() < comm.ranks());
    let all = comm.all_gather(&[comm.rank() as u8], &vec![1; comm.ranks()]);
    let numbers: Vec<u8> = (0..comm.ranks() as u8).collect();
    assert_eq!(all, numbers, "each number is given once");
}

fn a_barrier_lets_nobody_pass_alone(comm: &dyn Communicator) {
    // All ranks of the suite run on one machine, hence by one clock.
    let now = || SystemTime::now().duration_since(UNIX_EPOCH).expect("it is later than 1970").as_nanos() as u64;
    for late in 0..comm.ranks() {
        if comm.rank() == late {
            std::thread::sleep(Duration::from_millis(2));
        }
        let came = now();
        comm.barrier();
        let all = comm.all_gather(&[came, now()].map(u64::to_le_bytes).concat(), &vec![16; comm.ranks()]);
        let times: Vec<u64> = all.as_chunks::<8>().0.iter().map(|time| u64::from_le_bytes(*time)).collect();
        let (last_came, first_left) = (times.iter().step_by(2).max(), times.iter().skip(1).step_by(2).min());
        assert!(last_came <= first_left, "a rank left before the last one had come");
    }
}

fn the_largest_value_reaches_everybody(comm: &dyn Communicator) {
    let (rank, ranks) = (comm.rank() as f64, comm.ranks() as f64);
    let mut values = [rank, -rank, -1.0 - rank, 1.0 / (1.0 + rank), f64::NEG_INFINITY, rank * f64::MIN_POSITIVE];
    comm.max(&mut values);
    let expected = [ranks - 1.0, 0.0, -1.0, 1.0, f64::NEG_INFINITY, (ranks - 1.0) * f64::MIN_POSITIVE];
    assert_eq!(values, expected);
    for zero_on in [0, comm.ranks() - 1] {
        let mut zero = [if comm.rank() == zero_on { 0.0 } else { -0.0 }];
        comm.max(&mut zero);
        assert_eq!(zero[0].to_bits(), 0.0_f64.to_bits(), "the positive zero is the larger, on any rank");
    }
    let mut infinite = [if comm.rank() == comm.ranks() / 2 { f64::INFINITY } else { f64::MAX }];
    comm.max(&mut infinite);
    assert_eq!(infinite, [f64::INFINITY]);
    comm.max(&mut []);
}

fn rank_0_tells_everybody(comm: &dyn Communicator) {
    for length in [0, 1, 13, 100_000] {
        // What the others had before, longer or shorter, is gone.
        let mut bytes = if comm.rank() == 0 { letter(0, 0, length, length) } else { vec![9; 50 * comm.rank()] };
        comm.broadcast(&mut bytes);
        assert!(bytes == letter(0, 0, length, length), "{length} bytes of rank 0");
    }
}

fn everybody_learns_what_all_give(comm: &dyn Communicator) {
    let lengths_of: [fn(usize) -> usize; 4] = [|_| 0, |_| 8, |rank| 1000 * (rank % 3), |rank| 300_000 / (rank + 1)];
    for (number, length) in lengths_of.into_iter().enumerate() {
        let lengths: Vec<usize> = (0..comm.ranks()).map(length).collect();
        let all = comm.all_gather(&letter(comm.rank(), 0, number, lengths[comm.rank()]), &lengths);
        let expected: Vec<u8> = lengths.iter().enumerate().flat_map(|(rank, n)| letter(rank, 0, number, *n)).collect();
        assert!(all == expected, "lengths {lengths:?}");
    }
}

fn rank_0_collects(comm: &dyn Communicator) {
    for (number, scale) in [0, 1, 50_000].into_iter().enumerate() {
        let all = comm.gather(letter(comm.rank(), 0, number, scale * comm.rank()));
        let expected: Vec<Vec<u8>> = match comm.rank() {
            0 => (0..comm.ranks()).map(|rank| letter(rank, 0, number, scale * rank)).collect(),
            _ => Vec::new(),
        };
        assert!(all == expected, "rank {} of {}, {number}", comm.rank(), comm.ranks());
    }
}

/// Sends a letter of `length(from, to)` bytes along every pair that `joined` names, and checks what arrives. Ranks are
/// expected in descending order: the order of the answer is the receiver's choice.
fn exchange(
    comm: &dyn Communicator,
    number: usize,
    known: bool,
    joined: impl Fn(usize, usize) -> bool,
    length: impl Fn(usize, usize) -> usize,
) {
    let own = comm.rank();
    let peers = || (0..comm.ranks()).rev().filter(|peer| *peer != own);
    let bytes = |from: usize, to: usize| letter(from, to, number, length(from, to));
    let messages = peers().filter(|to| joined(own, *to)).map(|to| Message { to, bytes: bytes(own, to) }).collect();
    let from: Vec<usize> = peers().filter(|from| joined(*from, own)).collect();
    let expect = |from: &usize| Expected { from: *from, length: known.then(|| length(*from, own)) };
    let expected: Vec<Expected> = from.iter().map(expect).collect();
    let received = comm.start(messages, &expected).finish();
    assert_eq!(received.len(), from.len());
    for (from, received) in from.into_iter().zip(received) {
        assert!(received == bytes(from, own), "message {number} of rank {from} to rank {own}");
    }
}

fn neighbours_exchange(comm: &dyn Communicator) {
    for known in [true, false] {
        exchange(comm, 0, known, |_, _| false, |_, _| 0);
        exchange(comm, 1, known, |_, _| true, |_, _| 0);
        exchange(comm, 2, known, |a, b| a.abs_diff(b) == 1, |a, b| 100 * a + b);
        exchange(comm, 3, known, |_, _| true, |a, b| 3000 * (a % 3) + b);
        // One way only: ranks that only send, and ranks that only receive.
        exchange(comm, 4, known, |a, b| a < b, |a, _| 10 + a);
    }
}

fn lengths_need_not_be_known(comm: &dyn Communicator) {
    let own = comm.rank();
    let peers: Vec<usize> = (0..comm.ranks()).filter(|peer| *peer != own).collect();
    let messages = peers.iter().map(|to| Message { to: *to, bytes: letter(own, *to, 0, 70_000 + own) }).collect();
    // Of one message the length is known, of the next it is not.
    let expect = |from: &usize| Expected { from: *from, length: from.is_multiple_of(2).then_some(70_000 + from) };
    let received = comm.start(messages, &peers.iter().map(expect).collect::<Vec<_>>()).finish();
    let expected: Vec<_> = peers.iter().map(|from| letter(*from, own, 0, 70_000 + from)).collect();
    assert!(received == expected);
}

fn many_small_messages_stay_in_order(comm: &dyn Communicator) {
    for number in 0..300 {
        let apart = 1 + number % 3;
        exchange(comm, number, number % 2 == 0, |a, b| a.abs_diff(b) == apart, |a, _| (number * (a + 1)) % 40);
    }
}

fn large_messages_cross(comm: &dyn Communicator) {
    let last = comm.ranks() - 1;
    // Around 2²⁴ bytes a message may be cut into pieces, and a piece may be empty.
    let piece = 1 << 24;
    let lengths =
        [(5_000_000, true), (piece - 1, false), (piece, true), (piece, false), (piece + 1, true), (2 * piece, false)];
    for (number, (length, known)) in lengths.into_iter().enumerate() {
        exchange(comm, number, known, |a, b| a.abs_diff(b) == last, |_, _| length);
    }
    exchange(comm, 9, false, |a, b| a.abs_diff(b) == 1, |_, _| 3_000_000);
    let lengths: Vec<usize> = (0..comm.ranks()).map(|rank| if rank == last { (1 << 24) + 5 } else { rank }).collect();
    let all = comm.all_gather(&letter(comm.rank(), 0, 0, lengths[comm.rank()]), &lengths);
    let expected: Vec<u8> = lengths.iter().enumerate().flat_map(|(rank, n)| letter(rank, 0, 0, *n)).collect();
    assert!(all == expected, "all_gather of large messages");
    let mut bytes = if comm.rank() == 0 { letter(0, 0, 0, (1 << 24) + 3) } else { Vec::new() };
    comm.broadcast(&mut bytes);
    assert!(bytes == letter(0, 0, 0, (1 << 24) + 3), "broadcast of a large message");
}

fn work_goes_on_during_an_exchange(comm: &dyn Communicator) {
    let (own, ranks) = (comm.rank(), comm.ranks());
    for known in [true, false] {
        let (next, previous) = ((own + 1) % ranks, (own + ranks - 1) % ranks);
        let messages =
            if ranks > 1 { vec![Message { to: next, bytes: letter(own, next, 1, 200_000) }] } else { vec![] };
        let expected = Expected { from: previous, length: known.then_some(200_000) };
        let underway = comm.start(messages, if ranks > 1 { std::slice::from_ref(&expected) } else { &[] });
        // What all do together does not take the exchange's messages for its own.
        comm.barrier();
        let mut largest = [own as f64];
        comm.max(&mut largest);
        assert_eq!(largest, [(ranks - 1) as f64]);
        assert_eq!(comm.all_gather(&[own as u8; 2], &vec![2; ranks]).len(), 2 * ranks);
        assert_eq!(comm.gather(vec![7; own]).len(), if own == 0 { ranks } else { 0 });
        let mut received = vec![own as u8; 3];
        comm.broadcast(&mut received);
        assert_eq!(received, [0; 3]);
        let received = underway.finish();
        let expected = if ranks > 1 { vec![letter(previous, own, 1, 200_000)] } else { vec![] };
        assert!(received == expected, "the exchange that was underway");
    }
}

//! Ranks of one process keep the promises of a communicator, and end together when one of them fails.

use std::sync::Arc;
use std::time::Duration;

use drapery_core::parallel::communicator::{Communicator, Expected, Message};
use drapery_core::parallel::local_ranks::{CommError, LocalRanks};
use drapery_core::parallel::serial::Serial;
use drapery_tests::conformance::conformance;

#[test]
fn one_rank_alone_keeps_the_promises() {
    conformance(&Serial);
}

#[test]
fn ranks_as_threads_keep_the_promises() {
    for ranks in [1, 2, 3, 4, 7, 8] {
        let numbers = LocalRanks::run(ranks, 1, |comm| {
            conformance(&*comm);
            comm.rank()
        });
        assert_eq!(numbers, Ok((0..ranks).collect()), "results come in the order of ranks");
    }
}

#[test]
fn each_rank_has_its_own_threads() {
    let threads = LocalRanks::run(3, 2, |comm| {
        comm.barrier();
        (rayon::current_num_threads(), rayon::current_thread_index().is_some())
    });
    assert_eq!(threads, Ok(vec![(2, true); 3]));
}

/// Runs ranks of which some fail, and gives up on them if they hang.
fn end_of<T: Send + 'static>(
    ranks: usize,
    work: impl Fn(Arc<dyn Communicator>) -> T + Sync + Send + 'static,
) -> Result<Vec<T>, CommError> {
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || sender.send(LocalRanks::run(ranks, 1, work)));
    receiver.recv_timeout(Duration::from_secs(1200)).expect("ranks that lost one of them do not wait for ever")
}

#[test]
fn a_rank_that_panics_ends_the_others_with_its_message() {
    type Wait = fn(&dyn Communicator);
    let waits: [Wait; 5] = [
        |comm| comm.barrier(),
        |comm| comm.max(&mut [1.0]),
        |comm| comm.broadcast(&mut Vec::new()),
        |comm| drop(comm.all_gather(&[1], &vec![1; comm.ranks()])),
        |comm| drop(comm.gather(vec![1])),
    ];
    for wait in waits {
        // Rank 0 is waited for in all of them.
        let end = end_of(4, move |comm| match comm.rank() {
            0 => panic!("the knee of rank {} is not a number", comm.rank()),
            _ => (0..1000).for_each(|_| wait(&*comm)),
        });
        assert_eq!(end, Err(CommError { rank: 0, message: "the knee of rank 0 is not a number".to_owned() }));
    }
}

#[test]
fn a_rank_lost_behind_others_is_named_and_not_those_in_between() {
    // Each waits for the next one, the last one never answers.
    let end = end_of(5, |comm| {
        let next = comm.rank() + 1;
        if next == comm.ranks() {
            std::panic::panic_any(7);
        }
        let received = comm.start(Vec::new(), &[Expected { from: next, length: None }]).finish();
        comm.start(vec![Message { to: comm.rank() - 1, bytes: received.concat() }], &[]).finish();
    });
    assert_eq!(end, Err(CommError { rank: 4, message: "a panic without words".to_owned() }));
}

#[test]
fn a_panic_on_a_thread_of_a_rank_ends_all_ranks() {
    let end = end_of(3, |comm| {
        if comm.rank() == 2 {
            rayon::join(|| (), || panic!("a worker of rank 2"));
        }
        comm.barrier();
    });
    assert_eq!(end, Err(CommError { rank: 2, message: "a worker of rank 2".to_owned() }));
}

#[test]
fn a_rank_that_ends_too_early_is_an_error() {
    let kept = Arc::new(std::sync::Mutex::new(Vec::new()));
    let end = end_of(3, move |comm| {
        // A communicator that outlives its rank keeps nobody waiting.
        kept.lock().expect("no rank panics").push(comm.clone());
        if comm.rank() > 0 {
            comm.barrier();
        }
    });
    let error = end.expect_err("two ranks wait for one that has returned");
    assert!(error.rank > 0 && error.message.ends_with("which had already ended"), "{error}");
}

#[test]
fn an_exchange_that_nobody_finished_is_noticed() {
    let end = end_of(2, |comm| {
        drop(comm.start(Vec::new(), &[]));
        comm.start(Vec::new(), &[]).finish();
    });
    assert_eq!(end.expect_err("both ranks panic").message, "an exchange is finished before the next one starts");
}

#[test]
fn a_message_of_the_wrong_length_is_noticed() {
    let end = end_of(2, |comm| {
        let to = 1 - comm.rank();
        comm.start(vec![Message { to, bytes: vec![0; 3] }], &[Expected { from: to, length: Some(4) }]).finish();
    });
    assert!(end.expect_err("both ranks panic").message.contains("sends 3 bytes"));
}

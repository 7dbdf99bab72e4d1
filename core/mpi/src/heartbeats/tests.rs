use std::io::Write as _;
use std::sync::mpsc::channel;

use drapery_core::parallel::local_ranks::LocalRanks;

use super::*;

/// Longer than any machine needs.
const PATIENCE: Duration = Duration::from_secs(60);

const TIMEOUT: Duration = Duration::from_millis(1500);

fn pair() -> [TcpStream; 2] {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let caller = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    [caller, listener.accept().unwrap().0]
}

/// The watch of rank 0 among `ranks`, and its listener.
fn watch(ranks: usize) -> (Watch, TcpListener) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    listener.set_nonblocking(true).unwrap();
    let names = (0..ranks).map(|rank| format!("host:{rank}"));
    let own = listener.try_clone().unwrap();
    (Watch::new(Handshake { run: 9, from: 0, to: 0 }, TIMEOUT, names, Some(own)), listener)
}

#[test]
fn a_rank_that_ends_without_a_word_is_lost_to_all_others_and_one_that_says_so_is_not() {
    let received = LocalRanks::run(4, 1, |communicator| {
        let ranks = Ranks::new(communicator);
        let (news, incoming) = channel();
        let report = move |one| drop(news.send(one));
        // What others than rank 0 ask for does not count.
        let timeout = if ranks.is_first() { Some(TIMEOUT) } else { None };
        let beats = Heartbeats::start(&ranks, timeout, &format!("host:{}", ranks.rank()), report).unwrap().unwrap();
        while (0..4).any(|rank| rank != ranks.rank() && !beats.1[rank].load(Ordering::Acquire)) {
            thread::sleep(POLL_INTERVAL);
        }
        ranks.barrier();
        match ranks.rank() {
            3 => {
                beats.bye();
                drop(beats);
                None
            }
            2 => {
                // It is heard of while it lives, much longer than silence may last.
                thread::sleep(2 * TIMEOUT);
                drop(beats);
                None
            }
            _ => Some([(); 2].map(|()| incoming.recv_timeout(PATIENCE))),
        }
    });
    let lost = Lost { rank: 2, ranks: 4, name: "host:2".to_owned(), how: How::Ended, timeout: TIMEOUT };
    assert_eq!(lost.to_string(), "rank 2 of 4 (host:2) ended before the others");
    for received in received.unwrap().into_iter().flatten() {
        assert_eq!(received, [Ok(News::Connected), Ok(News::Lost(vec![lost.clone()]))]);
    }
}

#[test]
fn no_heartbeats_are_made_where_rank_0_wants_none() {
    let made = LocalRanks::run(2, 1, |communicator| {
        let ranks = Ranks::new(communicator);
        let timeout = (!ranks.is_first()).then_some(TIMEOUT);
        Heartbeats::start(&ranks, timeout, "host:1", |_| {}).unwrap().is_some()
    });
    assert_eq!(made, Ok(vec![false, false]));
}

#[test]
fn silence_is_a_loss_when_it_has_lasted_and_names_all_that_are_as_silent() {
    let (mut watch, _) = watch(4);
    let mut streams = [1, 2, 3].map(|rank| {
        let [other, own] = pair();
        watch.add(rank, Link::new(own));
        (Link::new(other).unwrap(), rank)
    });
    streams.iter_mut().for_each(|(stream, _)| stream.send(Signal::Heartbeat));
    while watch.peers.iter().filter(|peer| peer.is_known).count() < 3 {
        assert_eq!(watch.receive(Duration::ZERO), []);
    }
    watch.peers[2].silence = TIMEOUT - Duration::from_millis(1);
    watch.peers[3].silence = TIMEOUT - Duration::from_millis(200);
    assert_eq!(watch.receive(Duration::ZERO), []);
    watch.peers[2].silence = TIMEOUT;
    let lost = watch.receive(Duration::ZERO);
    assert_eq!(lost.iter().map(|lost| (lost.rank, lost.how)).collect::<Vec<_>>(), [(2, How::Silent), (3, How::Silent)]);
    assert_eq!(lost[0].to_string(), "rank 2 of 4 (host:2) sent no heartbeat for 1.5 s");
    // The others learn it.
    let mut signals = Vec::new();
    while signals.len() < 3 {
        signals.extend(streams[0].0.receive().0);
    }
    assert_eq!(signals, [Signal::Heartbeat, Signal::Lost(2, How::Silent), Signal::Lost(3, How::Silent)]);
    // A word ends the silence.
    streams[1].0.send(Signal::Heartbeat);
    while watch.peers[2].silence > Duration::ZERO {
        watch.receive(Duration::ZERO);
    }
}

#[test]
fn what_another_rank_says_of_a_loss_is_believed() {
    let (mut watch, _) = watch(3);
    let [other, own] = pair();
    watch.add(1, Link::new(own));
    let mut other = Link::new(other).unwrap();
    other.send(Signal::Lost(2, How::Ended));
    let lost = loop {
        let lost = watch.receive(Duration::ZERO);
        if !lost.is_empty() {
            break lost;
        }
    };
    assert_eq!(lost.iter().map(|lost| (lost.rank, lost.how)).collect::<Vec<_>>(), [(2, How::Ended)]);
}

#[test]
fn strangers_who_call_are_not_taken_for_ranks() {
    let (mut watch, listener) = watch(3);
    let at = listener.local_addr().unwrap();
    let call = |name: &[u8]| {
        let mut stream = TcpStream::connect(at).unwrap();
        stream.write_all(name).unwrap();
        stream
    };
    let name =
        |run: u128, from: u32, to: u32| [&run.to_le_bytes()[..], &from.to_le_bytes(), &to.to_le_bytes()].concat();
    let strangers =
        [name(8, 1, 0), name(9, 1, 2), name(9, 3, 0), name(9, 0, 0), b"GET / HTTP/1.1\r\n\r\n......".to_vec()];
    let _kept: Vec<TcpStream> = strangers.iter().map(|name| call(name)).collect();
    let _rank = call(&name(9, 2, 0));
    while watch.peers[2].links.is_empty() {
        watch.accept_connections(Duration::ZERO);
    }
    assert!(watch.pending.is_empty() && watch.peers[0].links.is_empty() && watch.peers[1].links.is_empty());
}

#[test]
fn ranks_that_cannot_be_reached_are_named_once() {
    let (mut watch, _) = watch(3);
    let [_other, own] = pair();
    watch.add(1, Link::new(own));
    watch.peers[1].is_known = true;
    assert_eq!(watch.end_of_connecting(CONNECT_WINDOW / 2), None);
    assert_eq!(
        watch.end_of_connecting(CONNECT_WINDOW / 2),
        Some(News::Unreachable(vec!["rank 2 (host:2)".to_owned()]))
    );
    assert_eq!(watch.end_of_connecting(CONNECT_WINDOW), None);
    assert!(watch.listener.is_none());
}

#[test]
fn rank_infos_are_read_as_they_were_written_and_loopback_serves_one_machine_alone() {
    let info = |name: &str, port| RankInfo {
        timeout: Some(Duration::from_millis(2500)),
        run: any_number(),
        name: name.to_owned(),
        port,
        addresses: ["10.0.0.1", "2001:db8::1", "127.0.0.1"].map(|text| text.parse().unwrap()).to_vec(),
    };
    for one in [info("render042:17", Some(40_000)), info("a:1", None)] {
        assert_eq!(RankInfo::read(&one.text()), one);
    }
    assert_ne!(any_number(), any_number());
    let [here, there] = ["render042:17", "render043:17"].map(|name| info(name, Some(1)));
    let text = |addresses: Vec<IpAddr>| addresses.iter().map(IpAddr::to_string).collect::<Vec<_>>();
    assert_eq!(text(here.addresses_for(&here)), ["127.0.0.1", "10.0.0.1", "2001:db8::1"]);
    assert_eq!(text(here.addresses_for(&there)), ["10.0.0.1", "2001:db8::1"]);
}

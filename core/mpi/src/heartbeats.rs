//! Heartbeats between ranks. MPI does not report that a machine or the network is lost: a rank that waits for its message waits for ever.
//! So each rank has a thread that exchanges heartbeats with all others over plain TCP.
//!
//! The thread touches neither MPI nor the cloth, and sends while a rank computes. Silence is counted by its own clock, which stops
//! with the process: a rank that was stopped and resumes does not take the others for dead. A failure to connect is reported once,
//! and the run continues without.

use std::collections::hash_map::RandomState;
use std::fmt::Write;
use std::hash::BuildHasher;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use drapery_core::parallel::ranks::Ranks;

use crate::addresses;
use crate::connections::{Handshake, How, Link, PendingConnection, Signal, connect};

/// Heartbeats in the time after which a rank that is silent counts as lost, and the longest and shortest time between two.
const HEARTBEATS_PER_TIMEOUT: u32 = 10;
const LONGEST_INTERVAL: Duration = Duration::from_secs(1);
const SHORTEST_INTERVAL: Duration = Duration::from_millis(50);

/// Time given to the launcher to end all ranks after one has ended.
const GRACE: Duration = Duration::from_secs(5);

/// Time in which ranks connect, and interval between the checks meanwhile.
const CONNECT_WINDOW: Duration = Duration::from_secs(20);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Time after which a rank also connects to those that should have connected to it: a firewall may let one side through alone.
const REVERSE_CONNECT_DELAY: Duration = Duration::from_secs(4);

/// Threads that connect at the same time.
const CONNECTORS: usize = 16;

/// A rank that is lost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// Its number, and the number of all.
    pub rank: usize,
    /// Number of all ranks.
    pub ranks: usize,
    /// Name that the rank gave itself.
    pub name: String,
    /// Way in which it was lost.
    pub how: How,
    /// The time after which silence is a loss.
    pub timeout: Duration,
}

impl std::fmt::Display for Lost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { rank, ranks, name, how, timeout } = self;
        match how {
            How::Silent => {
                write!(f, "rank {rank} of {ranks} ({name}) sent no heartbeat for {} s", timeout.as_secs_f64())
            }
            How::Ended => write!(f, "rank {rank} of {ranks} ({name}) ended before the others"),
        }
    }
}

/// News of the other ranks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum News {
    /// The connections to all other ranks are established. Said once.
    Connected,
    /// No connection to these exists, so their loss will not be noticed. Said once.
    Unreachable(Vec<String>),
    /// These are lost. Said once, and nothing after it.
    Lost(Vec<Lost>),
}

/// The heartbeats of this rank. When they are dropped before [`Heartbeats::bye`], the others take this rank for lost.
#[derive(Debug)]
pub struct Heartbeats(Sender<Event>, #[cfg(test)] Arc<[AtomicBool]>);

/// Event that comes to the watching thread.
#[derive(Debug)]
enum Event {
    /// A rank has answered the handshake.
    Answered(usize, TcpStream),
    /// A goodbye goes to the others; then the sender is dropped.
    Bye(Sender<()>),
}

impl Heartbeats {
    /// Starts to send and to receive heartbeats. All ranks call this together. `timeout` counts as rank 0 gives it: the silence
    /// after which a rank is lost, or `None` for no heartbeats. `name` is the name of this rank in the messages of others. `report`
    /// is called on a thread of its own.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn start(
        ranks: &Ranks,
        timeout: Option<Duration>,
        name: &str,
        report: impl FnMut(News) + Send + 'static,
    ) -> std::io::Result<Option<Self>> {
        let listener = TcpListener::bind((Ipv6Addr::UNSPECIFIED, 0));
        let listener = listener.or_else(|_| TcpListener::bind((Ipv4Addr::UNSPECIFIED, 0))).ok();
        let listener = listener.filter(|listener| listener.set_nonblocking(true).is_ok());
        let port = listener.as_ref().and_then(|listener| Some(listener.local_addr().ok()?.port()));
        let own = RankInfo {
            timeout,
            run: any_number(),
            name: name.to_owned(),
            port,
            addresses: addresses::of_this_machine(),
        };
        let infos = ranks.all_gather_v(own.text().as_bytes());
        let infos: Vec<RankInfo> = infos.iter().map(|text| RankInfo::read(&String::from_utf8_lossy(text))).collect();
        let (Some(timeout), run, me) = (infos[0].timeout, infos[0].run, ranks.rank()) else { return Ok(None) };
        let (events, incoming) = channel();
        let handshake = Handshake { run, from: me as u32, to: 0 };
        let watch = Watch::new(handshake, timeout, infos.iter().map(|info| info.name.clone()), listener);
        let linked = Arc::clone(&watch.linked);
        let report = Box::new(report);
        thread::Builder::new().name("heartbeats".to_owned()).spawn(move || watch.run(&incoming, report))?;
        let others: Vec<usize> = (0..infos.len()).filter(|rank| *rank != me).collect();
        let infos = Arc::new(infos);
        for first in 0..CONNECTORS.min(others.len()) {
            let ranks: Vec<usize> = others.iter().copied().skip(first).step_by(CONNECTORS).collect();
            let connector =
                Connector { handshake, infos: Arc::clone(&infos), linked: Arc::clone(&linked), events: events.clone() };
            // Without it others connect, or a rank is unreachable.
            let _ = thread::Builder::new().name("connector".to_owned()).spawn(move || connector.connect_all(&ranks));
        }
        Ok(Some(Self(
            events,
            #[cfg(test)]
            linked,
        )))
    }

    /// Sends the others a goodbye: this rank may end from now on.
    pub fn bye(&self) {
        let (done, is_done) = channel();
        if self.0.send(Event::Bye(done)).is_ok() {
            // Nothing comes: its end is dropped.
            let _ = is_done.recv_timeout(LONGEST_INTERVAL);
        }
    }
}

/// A number that another run will not have.
fn any_number() -> u128 {
    let [low, high] = [(); 2].map(|()| u128::from(RandomState::new().hash_one(())));
    high << 64 | low
}

/// Description that a rank sends of itself over MPI, one item per line.
#[derive(Debug, Clone, PartialEq, Eq)]
struct RankInfo {
    timeout: Option<Duration>,
    run: u128,
    name: String,
    port: Option<u16>,
    addresses: Vec<IpAddr>,
}

impl RankInfo {
    fn text(&self) -> String {
        let Self { timeout, run, name, port, addresses } = self;
        let timeout = timeout.map_or(0, |timeout| timeout.as_millis());
        let mut text = format!("{timeout}\n{run}\n{}\n{}\n", name.replace('\n', " "), port.unwrap_or(0));
        // Writing into a text cannot fail.
        addresses.iter().for_each(|address| _ = writeln!(text, "{address}"));
        text
    }

    fn read(text: &str) -> Self {
        let mut lines = text.lines();
        let mut next = || lines.next().unwrap_or_default();
        Self {
            timeout: next().parse().ok().filter(|millis| *millis > 0).map(Duration::from_millis),
            run: next().parse().unwrap_or(0),
            name: next().to_owned(),
            port: next().parse().ok().filter(|port| *port > 0),
            addresses: lines.filter_map(|line| line.parse().ok()).collect(),
        }
    }

    fn host(&self) -> &str {
        self.name.rsplit_once(':').map_or(&self.name, |(host, _)| host)
    }

    /// Returns the addresses for a connection from the machine of `other`, first the ones where an answer is likely.
    fn addresses_for(&self, other: &Self) -> Vec<IpAddr> {
        // Its own address means another machine elsewhere.
        let (local, others): (Vec<_>, Vec<_>) = self.addresses.iter().partition(|address| address.is_loopback());
        if self.host() == other.host() { [local, others].concat() } else { others }
    }
}

/// Connects to other ranks until all are connected.
struct Connector {
    handshake: Handshake,
    infos: Arc<Vec<RankInfo>>,
    linked: Arc<[AtomicBool]>,
    events: Sender<Event>,
}

impl Connector {
    fn connect_all(&self, ranks: &[usize]) {
        let (begun, me) = (Instant::now(), self.handshake.from as usize);
        let mut answered = vec![None::<Instant>; self.infos.len()];
        while begun.elapsed() < CONNECT_WINDOW {
            let missing = ranks.iter().copied().filter(|rank| !self.linked[*rank].load(Ordering::Acquire));
            let missing: Vec<usize> = missing.collect();
            if missing.is_empty() {
                return;
            }
            for rank in missing {
                // One that has answered is connected in a moment.
                let waits = answered[rank].is_some_and(|at| at.elapsed() < REVERSE_CONNECT_DELAY);
                let Some(port) = self.infos[rank].port else { continue };
                if waits || (rank > me && begun.elapsed() < REVERSE_CONNECT_DELAY) {
                    continue;
                }
                let addresses = self.infos[rank].addresses_for(&self.infos[me]);
                if let Some(stream) = connect(&addresses, port, Handshake { to: rank as u32, ..self.handshake }) {
                    answered[rank] = Some(Instant::now());
                    if self.events.send(Event::Answered(rank, stream)).is_err() {
                        return;
                    }
                }
            }
            thread::sleep(POLL_INTERVAL);
        }
    }
}

/// Another rank, as this one sees it.
#[derive(Debug)]
struct Peer {
    name: String,
    links: Vec<Link>,
    /// Whether it ever sent a signal.
    is_known: bool,
    said_bye: bool,
    silence: Duration,
}

/// State of the watching thread.
struct Watch {
    handshake: Handshake,
    timeout: Duration,
    peers: Vec<Peer>,
    /// Whether each rank is connected; for the connecting threads.
    linked: Arc<[AtomicBool]>,
    /// None once all are connected, or the time for that is over.
    listener: Option<TcpListener>,
    pending: Vec<(PendingConnection, Duration)>,
    connecting: Duration,
    said_bye: bool,
}

impl Watch {
    fn new(
        handshake: Handshake,
        timeout: Duration,
        names: impl Iterator<Item = String>,
        listener: Option<TcpListener>,
    ) -> Self {
        let peer = |name| Peer { name, links: Vec::new(), is_known: false, said_bye: false, silence: Duration::ZERO };
        let peers: Vec<Peer> = names.map(peer).collect();
        let linked = peers.iter().map(|_| AtomicBool::new(false)).collect();
        let (pending, connecting) = (Vec::new(), Duration::ZERO);
        Self { handshake, timeout, peers, linked, listener, pending, connecting, said_bye: false }
    }

    /// Runs until a rank is lost or all have ended.
    fn run(mut self, events: &Receiver<Event>, mut report: Box<dyn FnMut(News) + Send>) {
        let beat = (self.timeout / HEARTBEATS_PER_TIMEOUT).clamp(SHORTEST_INTERVAL, LONGEST_INTERVAL);
        let mut last = Instant::now();
        loop {
            let tick = if self.is_connecting() { POLL_INTERVAL.min(beat) } else { beat };
            match events.recv_timeout(tick) {
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            // Time in which this thread did not run is no silence of the others.
            let now = Instant::now();
            let passed = (now - std::mem::replace(&mut last, now)).min(2 * beat);
            self.accept_connections(passed);
            self.send(Signal::Heartbeat);
            let lost = self.receive(passed);
            if !lost.is_empty() {
                return report(News::Lost(lost));
            }
            if let Some(news) = self.end_of_connecting(passed) {
                report(news);
            }
        }
    }

    fn is_connecting(&self) -> bool {
        self.connecting < CONNECT_WINDOW
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Answered(rank, stream) => self.add(rank, Link::new(stream)),
            Event::Bye(done) => {
                self.said_bye = true;
                self.send(Signal::Bye);
                drop(done);
            }
        }
    }

    /// Adds a connection; one that cannot be used is dropped.
    fn add(&mut self, rank: usize, link: std::io::Result<Link>) {
        if let Ok(mut link) = link {
            link.send(if self.said_bye { Signal::Bye } else { Signal::Heartbeat });
            self.peers[rank].links.push(link);
        }
    }

    fn send(&mut self, signal: Signal) {
        self.peers.iter_mut().flat_map(|peer| &mut peer.links).for_each(|link| link.send(signal));
    }

    /// Accepts connections, and answers their handshakes.
    fn accept_connections(&mut self, passed: Duration) {
        while let Some(Ok((stream, _))) = self.listener.as_ref().map(TcpListener::accept) {
            if let (Ok(connection), true) = (
                PendingConnection::new(stream),
                self.pending.len() < 2 * self.peers.len() + HEARTBEATS_PER_TIMEOUT as usize,
            ) {
                self.pending.push((connection, Duration::ZERO));
            }
        }
        for (mut connection, waited) in std::mem::take(&mut self.pending) {
            match connection.handshake() {
                Ok(None) if waited < GRACE => self.pending.push((connection, waited + passed)),
                Ok(Some(handshake)) => {
                    let from = handshake.from as usize;
                    let is_one = from < self.peers.len() && handshake.from != self.handshake.from;
                    if is_one
                        && handshake == (Handshake { from: handshake.from, to: self.handshake.from, ..self.handshake })
                    {
                        self.add(from, connection.accept(handshake));
                    }
                }
                Ok(None) | Err(()) => {}
            }
        }
    }

    /// Receives the signals of the others; returns the lost ranks.
    fn receive(&mut self, passed: Duration) -> Vec<Lost> {
        let (mut reported, mut is_late) = (Vec::new(), false);
        for (rank, peer) in self.peers.iter_mut().enumerate() {
            let was_linked = !peer.links.is_empty();
            let mut has_received = false;
            peer.links.retain_mut(|link| {
                let (signals, is_open) = link.receive();
                for signal in signals {
                    has_received = true;
                    peer.said_bye |= signal == Signal::Bye;
                    if let Signal::Lost(lost, how) = signal {
                        reported.push((lost as usize, how));
                    }
                }
                peer.is_known |= link.is_proven;
                is_open
            });
            self.linked[rank].store(peer.is_known, Ordering::Release);
            let is_cut = was_linked && peer.links.is_empty();
            peer.silence = if has_received || is_cut { Duration::ZERO } else { peer.silence + passed };
            is_late |= peer.is_lost(self.timeout, self.said_bye);
        }
        if is_late || !reported.is_empty() {
            return self.all_lost(&reported);
        }
        Vec::new()
    }

    /// Returns the lost ranks, and the ranks that are as silent as ranks on the same machine would be; sends
    /// them to the others.
    fn all_lost(&mut self, reported: &[(usize, How)]) -> Vec<Lost> {
        let mut lost = Vec::new();
        for (rank, peer) in self.peers.iter().enumerate() {
            let own = peer.is_lost(self.timeout / 2, self.said_bye).then(|| peer.how());
            let how = own.or_else(|| reported.iter().find(|(of, _)| *of == rank).map(|(_, how)| *how));
            if let (Some(how), true) = (how, rank != self.handshake.from as usize) {
                let (ranks, name) = (self.peers.len(), peer.name.clone());
                lost.push(Lost { rank, ranks, name, how, timeout: self.timeout });
            }
        }
        for one in &lost {
            self.send(Signal::Lost(one.rank as u32, one.how));
        }
        lost
    }

    /// Closes the listener when the time to connect is over or all are connected. Returns once whether all are connected.
    fn end_of_connecting(&mut self, passed: Duration) -> Option<News> {
        if !self.is_connecting() {
            return None;
        }
        self.connecting += passed;
        let me = self.handshake.from as usize;
        let missing = |(rank, peer): &(usize, &Peer)| *rank != me && !peer.is_known;
        let missing =
            self.peers.iter().enumerate().filter(missing).map(|(rank, peer)| format!("rank {rank} ({})", peer.name));
        let missing: Vec<String> = missing.collect();
        if missing.is_empty() {
            self.connecting = CONNECT_WINDOW;
        }
        if self.is_connecting() {
            return None;
        }
        self.listener = None;
        self.pending.clear();
        Some(if missing.is_empty() { News::Connected } else { News::Unreachable(missing) })
    }
}

impl Peer {
    /// Whether it is lost, with silence as a loss after `timeout`. Of two that may both end, neither is.
    fn is_lost(&self, timeout: Duration, may_end: bool) -> bool {
        match self.how() {
            How::Silent => self.is_known && self.silence >= timeout,
            How::Ended => self.is_known && !self.said_bye && !may_end && self.silence >= timeout.min(GRACE),
        }
    }

    fn how(&self) -> How {
        if self.links.is_empty() { How::Ended } else { How::Silent }
    }
}

#[cfg(test)]
mod tests;

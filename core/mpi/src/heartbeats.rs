//! Heartbeats between ranks. MPI does not say that a machine or the network is lost: whoever waits for its message waits for ever.
//! So each rank has a thread that tells all others over plain TCP that it is there, and hears whether they are.
//!
//! The thread touches neither MPI nor the cloth, and beats while a rank computes. Silence is counted by its own clock, which stands
//! while it stands: a rank that was stopped and goes on does not take the others for dead. Where no connection comes about, that is
//! said once and the run goes on without.

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
use crate::connections::{Guest, Hello, How, Link, Word, call};

/// Beats in the time after which a rank that is silent counts as lost, and the longest and shortest time between two.
const BEATS: u32 = 10;
const SLOWEST: Duration = Duration::from_secs(1);
const FASTEST: Duration = Duration::from_millis(50);

/// Time given after a rank has ended for the launcher, which knows how, to end all; a launcher that cannot is not
/// waited for.
const GRACE: Duration = Duration::from_secs(5);

/// Time in which connections may come about, and interval between the checks meanwhile.
const CALLING: Duration = Duration::from_secs(20);
const LOOK: Duration = Duration::from_millis(100);

/// After this time a rank also calls those who should have called it: a firewall may let one side through alone.
const OTHER_SIDE: Duration = Duration::from_secs(4);

/// Threads that call others at the same time.
const CALLERS: usize = 16;

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
    /// With these no connection came about, so their loss will not be noticed. Said once.
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
    /// A rank has answered a call.
    Answered(usize, TcpStream),
    /// The others are to know that this rank may end; then the sender is dropped.
    Bye(Sender<()>),
}

impl Heartbeats {
    /// Begins to beat and to listen. All ranks call this together. `timeout` counts as rank 0 gives it: the silence after which
    /// a rank is lost, or `None` for no heartbeats. `name` is what others call this rank. `tell` is called on a thread of its own.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn start(
        ranks: &Ranks,
        timeout: Option<Duration>,
        name: &str,
        tell: impl FnMut(News) + Send + 'static,
    ) -> std::io::Result<Option<Self>> {
        let listener = TcpListener::bind((Ipv6Addr::UNSPECIFIED, 0));
        let listener = listener.or_else(|_| TcpListener::bind((Ipv4Addr::UNSPECIFIED, 0))).ok();
        let listener = listener.filter(|listener| listener.set_nonblocking(true).is_ok());
        let port = listener.as_ref().and_then(|listener| Some(listener.local_addr().ok()?.port()));
        let own =
            Card { timeout, run: any_number(), name: name.to_owned(), port, addresses: addresses::of_this_machine() };
        let cards = ranks.all_gather_v(own.text().as_bytes());
        let cards: Vec<Card> = cards.iter().map(|text| Card::read(&String::from_utf8_lossy(text))).collect();
        let (Some(timeout), run, me) = (cards[0].timeout, cards[0].run, ranks.rank()) else { return Ok(None) };
        let (events, to_come) = channel();
        let hello = Hello { run, from: me as u32, to: 0 };
        let watch = Watch::new(hello, timeout, cards.iter().map(|card| card.name.clone()), listener);
        let linked = Arc::clone(&watch.linked);
        let tell = Box::new(tell);
        thread::Builder::new().name("heartbeats".to_owned()).spawn(move || watch.run(&to_come, tell))?;
        let others: Vec<usize> = (0..cards.len()).filter(|rank| *rank != me).collect();
        let cards = Arc::new(cards);
        for first in 0..CALLERS.min(others.len()) {
            let whom: Vec<usize> = others.iter().copied().skip(first).step_by(CALLERS).collect();
            let caller =
                Caller { hello, cards: Arc::clone(&cards), linked: Arc::clone(&linked), events: events.clone() };
            // Without it others call, or somebody is unreachable.
            let _ = thread::Builder::new().name("calls".to_owned()).spawn(move || caller.call_all(&whom));
        }
        Ok(Some(Self(
            events,
            #[cfg(test)]
            linked,
        )))
    }

    /// Says to the others that this rank may end from now on.
    pub fn bye(&self) {
        let (done, is_done) = channel();
        if self.0.send(Event::Bye(done)).is_ok() {
            // Nothing comes: its end is dropped.
            let _ = is_done.recv_timeout(SLOWEST);
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
struct Card {
    timeout: Option<Duration>,
    run: u128,
    name: String,
    port: Option<u16>,
    addresses: Vec<IpAddr>,
}

impl Card {
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

    /// Returns the addresses for a call from the machine of `caller`, first the ones where an answer is likely.
    fn addresses_for(&self, caller: &Self) -> Vec<IpAddr> {
        // Its own address means another machine elsewhere.
        let (local, others): (Vec<_>, Vec<_>) = self.addresses.iter().partition(|address| address.is_loopback());
        if self.host() == caller.host() { [local, others].concat() } else { others }
    }
}

/// Calls other ranks until they are all connected.
struct Caller {
    hello: Hello,
    cards: Arc<Vec<Card>>,
    linked: Arc<[AtomicBool]>,
    events: Sender<Event>,
}

impl Caller {
    fn call_all(&self, whom: &[usize]) {
        let (begun, me) = (Instant::now(), self.hello.from as usize);
        let mut answered = vec![None::<Instant>; self.cards.len()];
        while begun.elapsed() < CALLING {
            let missing = whom.iter().copied().filter(|rank| !self.linked[*rank].load(Ordering::Acquire));
            let missing: Vec<usize> = missing.collect();
            if missing.is_empty() {
                return;
            }
            for rank in missing {
                // One that has answered is connected in a moment.
                let waits = answered[rank].is_some_and(|at| at.elapsed() < OTHER_SIDE);
                let Some(port) = self.cards[rank].port else { continue };
                if waits || (rank > me && begun.elapsed() < OTHER_SIDE) {
                    continue;
                }
                let addresses = self.cards[rank].addresses_for(&self.cards[me]);
                if let Some(stream) = call(&addresses, port, Hello { to: rank as u32, ..self.hello }) {
                    answered[rank] = Some(Instant::now());
                    if self.events.send(Event::Answered(rank, stream)).is_err() {
                        return;
                    }
                }
            }
            thread::sleep(LOOK);
        }
    }
}

/// Another rank, as this one sees it.
#[derive(Debug)]
struct Peer {
    name: String,
    links: Vec<Link>,
    /// Whether it was ever heard of.
    is_known: bool,
    said_bye: bool,
    silence: Duration,
}

/// State of the watching thread.
struct Watch {
    hello: Hello,
    timeout: Duration,
    peers: Vec<Peer>,
    /// Whether each rank is connected; for those who call.
    linked: Arc<[AtomicBool]>,
    /// None once all have called, or the time for that is over.
    listener: Option<TcpListener>,
    guests: Vec<(Guest, Duration)>,
    calling: Duration,
    said_bye: bool,
}

impl Watch {
    fn new(
        hello: Hello,
        timeout: Duration,
        names: impl Iterator<Item = String>,
        listener: Option<TcpListener>,
    ) -> Self {
        let peer = |name| Peer { name, links: Vec::new(), is_known: false, said_bye: false, silence: Duration::ZERO };
        let peers: Vec<Peer> = names.map(peer).collect();
        let linked = peers.iter().map(|_| AtomicBool::new(false)).collect();
        let (guests, calling) = (Vec::new(), Duration::ZERO);
        Self { hello, timeout, peers, linked, listener, guests, calling, said_bye: false }
    }

    /// Until a rank is lost, or nobody needs it any more.
    fn run(mut self, events: &Receiver<Event>, mut tell: Box<dyn FnMut(News) + Send>) {
        let beat = (self.timeout / BEATS).clamp(FASTEST, SLOWEST);
        let mut last = Instant::now();
        loop {
            let tick = if self.is_calling() { LOOK.min(beat) } else { beat };
            match events.recv_timeout(tick) {
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            // However long this thread did not run, the others could be heard for no longer than it takes to look.
            let now = Instant::now();
            let passed = (now - std::mem::replace(&mut last, now)).min(2 * beat);
            self.receive_guests(passed);
            self.say(Word::Beat);
            let lost = self.listen(passed);
            if !lost.is_empty() {
                return tell(News::Lost(lost));
            }
            if let Some(news) = self.end_of_calls(passed) {
                tell(news);
            }
        }
    }

    fn is_calling(&self) -> bool {
        self.calling < CALLING
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Answered(rank, stream) => self.add(rank, Link::new(stream)),
            Event::Bye(done) => {
                self.said_bye = true;
                self.say(Word::Bye);
                drop(done);
            }
        }
    }

    /// A connection that cannot be used is one that did not come about.
    fn add(&mut self, rank: usize, link: std::io::Result<Link>) {
        if let Ok(mut link) = link {
            link.say(if self.said_bye { Word::Bye } else { Word::Beat });
            self.peers[rank].links.push(link);
        }
    }

    fn say(&mut self, word: Word) {
        self.peers.iter_mut().flat_map(|peer| &mut peer.links).for_each(|link| link.say(word));
    }

    /// Takes calls, and learns who calls.
    fn receive_guests(&mut self, passed: Duration) {
        while let Some(Ok((stream, _))) = self.listener.as_ref().map(TcpListener::accept) {
            if let (Ok(guest), true) = (Guest::new(stream), self.guests.len() < 2 * self.peers.len() + BEATS as usize) {
                self.guests.push((guest, Duration::ZERO));
            }
        }
        for (mut guest, waited) in std::mem::take(&mut self.guests) {
            match guest.name() {
                Ok(None) if waited < GRACE => self.guests.push((guest, waited + passed)),
                Ok(Some(name)) => {
                    let from = name.from as usize;
                    let is_one = from < self.peers.len() && name.from != self.hello.from;
                    if is_one && name == (Hello { from: name.from, to: self.hello.from, ..self.hello }) {
                        self.add(from, guest.welcome(name));
                    }
                }
                Ok(None) | Err(()) => {}
            }
        }
    }

    /// Hears the others; returns those that are lost.
    fn listen(&mut self, passed: Duration) -> Vec<Lost> {
        let (mut reported, mut is_late) = (Vec::new(), false);
        for (rank, peer) in self.peers.iter_mut().enumerate() {
            let was_linked = !peer.links.is_empty();
            let mut is_heard = false;
            peer.links.retain_mut(|link| {
                let (words, is_open) = link.listen();
                for word in words {
                    is_heard = true;
                    peer.said_bye |= word == Word::Bye;
                    if let Word::Lost(lost, how) = word {
                        reported.push((lost as usize, how));
                    }
                }
                peer.is_known |= link.is_proven;
                is_open
            });
            self.linked[rank].store(peer.is_known, Ordering::Release);
            let is_cut = was_linked && peer.links.is_empty();
            peer.silence = if is_heard || is_cut { Duration::ZERO } else { peer.silence + passed };
            is_late |= peer.is_lost(self.timeout, self.said_bye);
        }
        if is_late || !reported.is_empty() {
            return self.all_lost(&reported);
        }
        Vec::new()
    }

    /// Returns the lost ranks, and the ranks that are as silent as ranks on the same machine would be; tells the
    /// others.
    fn all_lost(&mut self, reported: &[(usize, How)]) -> Vec<Lost> {
        let mut lost = Vec::new();
        for (rank, peer) in self.peers.iter().enumerate() {
            let own = peer.is_lost(self.timeout / 2, self.said_bye).then(|| peer.how());
            let how = own.or_else(|| reported.iter().find(|(of, _)| *of == rank).map(|(_, how)| *how));
            if let (Some(how), true) = (how, rank != self.hello.from as usize) {
                let (ranks, name) = (self.peers.len(), peer.name.clone());
                lost.push(Lost { rank, ranks, name, how, timeout: self.timeout });
            }
        }
        for one in &lost {
            self.say(Word::Lost(one.rank as u32, one.how));
        }
        lost
    }

    /// When the time for calls is over, or all are connected: nobody calls any more. Returns once whether all are connected.
    fn end_of_calls(&mut self, passed: Duration) -> Option<News> {
        if !self.is_calling() {
            return None;
        }
        self.calling += passed;
        let me = self.hello.from as usize;
        let missing = |(rank, peer): &(usize, &Peer)| *rank != me && !peer.is_known;
        let missing =
            self.peers.iter().enumerate().filter(missing).map(|(rank, peer)| format!("rank {rank} ({})", peer.name));
        let missing: Vec<String> = missing.collect();
        if missing.is_empty() {
            self.calling = CALLING;
        }
        if self.is_calling() {
            return None;
        }
        self.listener = None;
        self.guests.clear();
        Some(if missing.is_empty() { News::Connected } else { News::Unreachable(missing) })
    }
}

impl Peer {
    /// Whether it is lost, if silence is a loss after so long. Of two that may both end, neither is.
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

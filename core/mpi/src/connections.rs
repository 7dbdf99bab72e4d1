//! Connections between ranks beside MPI: plain TCP, over which they exchange heartbeats.
//!
//! A handshake comes first: both ends send their rank, the other's rank, and a number that only ranks of this run know: the same
//! address may be another machine elsewhere, and a port another program.

use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::time::Duration;

/// Time limit for a connection to be accepted.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// Time limit for the answer to the handshake: the accepting process may be busy.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);

/// First message of both ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Handshake {
    /// Number of the run.
    pub(crate) run: u128,
    /// Sending rank.
    pub(crate) from: u32,
    /// Receiving rank.
    pub(crate) to: u32,
}

impl Handshake {
    /// Length of a handshake [bytes].
    pub(crate) const LENGTH: usize = 24;

    fn bytes(self) -> [u8; Self::LENGTH] {
        let mut bytes = [0; Self::LENGTH];
        bytes[..16].copy_from_slice(&self.run.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.from.to_le_bytes());
        bytes[20..].copy_from_slice(&self.to.to_le_bytes());
        bytes
    }

    fn read(bytes: &[u8]) -> Option<Self> {
        let (run, ranks) = bytes.split_first_chunk::<16>()?;
        let (from, to) = ranks.split_first_chunk::<4>()?;
        let number = u32::from_le_bytes;
        Some(Self { run: u128::from_le_bytes(*run), from: number(*from), to: number(to.try_into().ok()?) })
    }

    /// Returns the first message of the other end.
    pub(crate) fn answer(self) -> Self {
        Self { from: self.to, to: self.from, ..self }
    }
}

/// Way in which a rank was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum How {
    /// No signal came for too long: its machine or the network is lost, or the process is stopped.
    Silent,
    /// It has ended without a [`Signal::Bye`].
    Ended,
}

/// Signal between ranks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Signal {
    /// The sender is alive.
    Heartbeat,
    /// The sender has finished, and may end.
    Bye,
    /// This rank is lost; the sender ends.
    Lost(u32, How),
}

impl Signal {
    const LENGTH: usize = 5;

    fn bytes(self) -> [u8; Self::LENGTH] {
        let (kind, rank) = match self {
            Self::Heartbeat => (0, 0),
            Self::Bye => (1, 0),
            Self::Lost(rank, How::Silent) => (2, rank),
            Self::Lost(rank, How::Ended) => (3, rank),
        };
        let [a, b, c, d] = u32::to_le_bytes(rank);
        [kind, a, b, c, d]
    }

    fn read([kind, rank @ ..]: [u8; Self::LENGTH]) -> Option<Self> {
        let rank = u32::from_le_bytes(rank);
        [Self::Heartbeat, Self::Bye, Self::Lost(rank, How::Silent), Self::Lost(rank, How::Ended)]
            .get(usize::from(kind))
            .copied()
    }
}

/// A connection to another rank. Nothing waits: bytes that cannot be sent at once go with the next signal.
#[derive(Debug)]
pub(crate) struct Link {
    stream: TcpStream,
    begun: Vec<u8>,
    unsent: Vec<u8>,
    /// Whether a signal came after the handshake: then the connection exists at both ends.
    pub(crate) is_proven: bool,
}

impl Link {
    /// A connection after the handshake.
    pub(crate) fn new(stream: TcpStream) -> std::io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        Ok(Self { stream, begun: Vec::new(), unsent: Vec::new(), is_proven: false })
    }

    /// Sends a signal. A broken connection is noticed by [`Self::receive`].
    pub(crate) fn send(&mut self, signal: Signal) {
        if self.unsent.is_empty() || signal != Signal::Heartbeat {
            self.unsent.extend(signal.bytes());
        }
        if let Ok(sent) = self.stream.write(&self.unsent) {
            self.unsent.drain(..sent);
        }
    }

    /// Returns the signals received since the last call, and whether more may come.
    pub(crate) fn receive(&mut self) -> (Vec<Signal>, bool) {
        let is_open = read_available(&mut self.stream, &mut self.begun, usize::MAX);
        let whole = self.begun.len() / Signal::LENGTH * Signal::LENGTH;
        let signals =
            self.begun[..whole].as_chunks().0.iter().filter_map(|bytes| Signal::read(*bytes)).collect::<Vec<_>>();
        self.begun.drain(..whole);
        self.is_proven |= !signals.is_empty();
        (signals, is_open)
    }
}

/// An accepted connection before its handshake.
#[derive(Debug)]
pub(crate) struct PendingConnection {
    stream: TcpStream,
    received: Vec<u8>,
}

impl PendingConnection {
    /// The handshake is awaited on an accepted connection.
    pub(crate) fn new(stream: TcpStream) -> std::io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self { stream, received: Vec::new() })
    }

    /// The handshake, once it is complete; `Err` if the connection was closed before.
    pub(crate) fn handshake(&mut self) -> Result<Option<Handshake>, ()> {
        // Not more: signals that follow belong to the link.
        let missing = Handshake::LENGTH - self.received.len();
        let is_open = read_available(&mut self.stream, &mut self.received, missing);
        match Handshake::read(&self.received) {
            None if !is_open => Err(()),
            handshake => Ok(handshake),
        }
    }

    /// Answers the handshake.
    pub(crate) fn accept(mut self, handshake: Handshake) -> std::io::Result<Link> {
        self.stream.write_all(&handshake.answer().bytes())?;
        Link::new(self.stream)
    }
}

/// Appends the bytes that have arrived, `most` at most; returns whether more may come.
fn read_available(stream: &mut TcpStream, to: &mut Vec<u8>, most: usize) -> bool {
    let (mut buffer, mut left) = ([0; 256], most);
    while left > 0 {
        let room = left.min(buffer.len());
        match stream.read(&mut buffer[..room]) {
            Ok(0) => return false,
            Ok(count) => {
                to.extend_from_slice(&buffer[..count]);
                left -= count;
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return error.kind() == ErrorKind::WouldBlock,
        }
    }
    true
}

/// Tries the addresses of a rank, one after the other; returns the first connection at which that rank answers the handshake.
pub(crate) fn connect(addresses: &[IpAddr], port: u16, handshake: Handshake) -> Option<TcpStream> {
    addresses.iter().find_map(|address| connect_at(SocketAddr::new(*address, port), handshake).ok().flatten())
}

fn connect_at(address: SocketAddr, handshake: Handshake) -> std::io::Result<Option<TcpStream>> {
    let mut stream = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT)?;
    stream.set_read_timeout(Some(HANDSHAKE_TIMEOUT))?;
    stream.write_all(&handshake.bytes())?;
    let mut answer = [0; Handshake::LENGTH];
    stream.read_exact(&mut answer)?;
    Ok((Handshake::read(&answer) == Some(handshake.answer())).then_some(stream))
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, TcpListener};

    use super::*;

    fn pair() -> [TcpStream; 2] {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let caller = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        [caller, listener.accept().unwrap().0]
    }

    #[test]
    fn signals_arrive_whole_and_in_order_however_they_are_cut() {
        let signals = [
            Signal::Heartbeat,
            Signal::Bye,
            Signal::Lost(7, How::Silent),
            Signal::Lost(u32::MAX, How::Ended),
            Signal::Heartbeat,
        ];
        let [mut raw, stream] = pair();
        let (mut link, mut received) = (Link::new(stream).unwrap(), Vec::new());
        for byte in signals.iter().flat_map(|signal| signal.bytes()) {
            raw.write_all(&[byte]).unwrap();
            received.extend(link.receive().0);
        }
        while received.len() < signals.len() {
            received.extend(link.receive().0);
        }
        assert_eq!(received, signals);
        drop(raw);
        while link.receive().1 {}
    }

    #[test]
    fn a_connection_is_accepted_by_the_rank_that_is_meant_and_by_no_other_process() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let name = Handshake { run: 5, from: 3, to: 0 };
        // Another program at the address answers something else.
        let answers = [Handshake { run: 6, ..name.answer() }, Handshake { from: 1, ..name.answer() }, name.answer()];
        let taken = std::thread::spawn(move || {
            answers.map(|answer| {
                let mut connection = PendingConnection::new(listener.accept().unwrap().0).unwrap();
                let said = loop {
                    if let Some(said) = connection.handshake().unwrap() {
                        break said;
                    }
                };
                connection.accept(answer.answer()).map(|_| said).unwrap()
            })
        });
        let local = [IpAddr::from(Ipv4Addr::LOCALHOST)];
        let calls = [0, 1, 2].map(|_| connect(&local, port, name).is_some());
        assert_eq!((calls, taken.join().unwrap()), ([false, false, true], [name; 3]));
        // No process listens any more.
        assert!(connect(&local, port, name).is_none());
    }
}

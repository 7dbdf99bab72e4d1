//! Connections between ranks beside MPI: plain TCP, over which they tell each other that they are there.
//!
//! Both ends say first who they are, to whom they speak, and a number that only ranks of this run know: the same address may be
//! another machine elsewhere, and a port another program.

use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::time::Duration;

/// Time that a call waits to be accepted.
const RINGS: Duration = Duration::from_secs(2);

/// Time that the caller then waits for an answer: the process that accepts it may have much to do.
const ANSWERS: Duration = Duration::from_secs(5);

/// First message of both ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Hello {
    /// Number of the run.
    pub(crate) run: u128,
    /// Rank that speaks.
    pub(crate) from: u32,
    /// To whom.
    pub(crate) to: u32,
}

impl Hello {
    /// Bytes of one.
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
    /// Nothing was heard of it for too long: its machine or the network is lost, or it stands still.
    Silent,
    /// It has ended, and has not said that it would.
    Ended,
}

/// Message between ranks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Word {
    /// I am there.
    Beat,
    /// I have nothing more to do, and may end.
    Bye,
    /// This rank is lost; I end.
    Lost(u32, How),
}

impl Word {
    const LENGTH: usize = 5;

    fn bytes(self) -> [u8; Self::LENGTH] {
        let (kind, rank) = match self {
            Self::Beat => (0, 0),
            Self::Bye => (1, 0),
            Self::Lost(rank, How::Silent) => (2, rank),
            Self::Lost(rank, How::Ended) => (3, rank),
        };
        let [a, b, c, d] = u32::to_le_bytes(rank);
        [kind, a, b, c, d]
    }

    fn read([kind, rank @ ..]: [u8; Self::LENGTH]) -> Option<Self> {
        let rank = u32::from_le_bytes(rank);
        [Self::Beat, Self::Bye, Self::Lost(rank, How::Silent), Self::Lost(rank, How::Ended)]
            .get(usize::from(kind))
            .copied()
    }
}

/// A connection to another rank. Nothing waits: what cannot be sent at once goes with the next word.
#[derive(Debug)]
pub(crate) struct Link {
    stream: TcpStream,
    begun: Vec<u8>,
    unsent: Vec<u8>,
    /// Whether the other end has said anything after its name: then both ends have it.
    pub(crate) is_proven: bool,
}

impl Link {
    /// After both ends have said who they are.
    pub(crate) fn new(stream: TcpStream) -> std::io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        Ok(Self { stream, begun: Vec::new(), unsent: Vec::new(), is_proven: false })
    }

    /// Says something. Trouble is noticed by listening.
    pub(crate) fn say(&mut self, word: Word) {
        if self.unsent.is_empty() || word != Word::Beat {
            self.unsent.extend(word.bytes());
        }
        if let Ok(sent) = self.stream.write(&self.unsent) {
            self.unsent.drain(..sent);
        }
    }

    /// Returns the messages received since the last call, and whether more may come.
    pub(crate) fn listen(&mut self) -> (Vec<Word>, bool) {
        let is_open = read_at_hand(&mut self.stream, &mut self.begun, usize::MAX);
        let whole = self.begun.len() / Word::LENGTH * Word::LENGTH;
        let words = self.begun[..whole].as_chunks().0.iter().filter_map(|bytes| Word::read(*bytes)).collect::<Vec<_>>();
        self.begun.drain(..whole);
        self.is_proven |= !words.is_empty();
        (words, is_open)
    }
}

/// Somebody who has called and not said yet who it is.
#[derive(Debug)]
pub(crate) struct Guest {
    stream: TcpStream,
    said: Vec<u8>,
}

impl Guest {
    /// From an accepted connection.
    pub(crate) fn new(stream: TcpStream) -> std::io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self { stream, said: Vec::new() })
    }

    /// The name, once it is there; `Err` if none can come any more.
    pub(crate) fn name(&mut self) -> Result<Option<Hello>, ()> {
        // Not more: what follows is for the link.
        let missing = Hello::LENGTH - self.said.len();
        let is_open = read_at_hand(&mut self.stream, &mut self.said, missing);
        match Hello::read(&self.said) {
            None if !is_open => Err(()),
            name => Ok(name),
        }
    }

    /// Answers who has called.
    pub(crate) fn welcome(mut self, name: Hello) -> std::io::Result<Link> {
        self.stream.write_all(&name.answer().bytes())?;
        Link::new(self.stream)
    }
}

/// Appends what is there, at most so many bytes; returns whether more may come.
fn read_at_hand(stream: &mut TcpStream, to: &mut Vec<u8>, most: usize) -> bool {
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

/// Calls a rank at its addresses, one after the other; returns the first connection at which that rank answers.
pub(crate) fn call(addresses: &[IpAddr], port: u16, name: Hello) -> Option<TcpStream> {
    addresses.iter().find_map(|address| call_at(SocketAddr::new(*address, port), name).ok().flatten())
}

fn call_at(address: SocketAddr, name: Hello) -> std::io::Result<Option<TcpStream>> {
    let mut stream = TcpStream::connect_timeout(&address, RINGS)?;
    stream.set_read_timeout(Some(ANSWERS))?;
    stream.write_all(&name.bytes())?;
    let mut answer = [0; Hello::LENGTH];
    stream.read_exact(&mut answer)?;
    Ok((Hello::read(&answer) == Some(name.answer())).then_some(stream))
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
    fn words_arrive_whole_and_in_order_however_they_are_cut() {
        let words = [Word::Beat, Word::Bye, Word::Lost(7, How::Silent), Word::Lost(u32::MAX, How::Ended), Word::Beat];
        let [mut raw, stream] = pair();
        let (mut link, mut heard) = (Link::new(stream).unwrap(), Vec::new());
        for byte in words.iter().flat_map(|word| word.bytes()) {
            raw.write_all(&[byte]).unwrap();
            heard.extend(link.listen().0);
        }
        while heard.len() < words.len() {
            heard.extend(link.listen().0);
        }
        assert_eq!(heard, words);
        drop(raw);
        while link.listen().1 {}
    }

    #[test]
    fn a_call_is_taken_by_the_rank_that_is_meant_and_by_nobody_else() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let name = Hello { run: 5, from: 3, to: 0 };
        // Another program at the address answers something else.
        let answers = [Hello { run: 6, ..name.answer() }, Hello { from: 1, ..name.answer() }, name.answer()];
        let taken = std::thread::spawn(move || {
            answers.map(|answer| {
                let mut guest = Guest::new(listener.accept().unwrap().0).unwrap();
                let said = loop {
                    if let Some(said) = guest.name().unwrap() {
                        break said;
                    }
                };
                guest.welcome(answer.answer()).map(|_| said).unwrap()
            })
        });
        let local = [IpAddr::from(Ipv4Addr::LOCALHOST)];
        let calls = [0, 1, 2].map(|_| call(&local, port, name).is_some());
        assert_eq!((calls, taken.join().unwrap()), ([false, false, true], [name; 3]));
        // Nobody is there any more.
        assert!(call(&local, port, name).is_none());
    }
}

//! Messages to and from single ranks, on their way while the rank works.
//!
//! Buffers and requests have to live together and outlive the function that starts them, which the scopes of the `mpi`
//! crate do not allow: these calls are made directly.
#![allow(unsafe_code)]

use std::mem::MaybeUninit;
use std::ops::Range;

use drapery_core::parallel::communicator::{Expected, Message};
use mpi::ffi::{self, MPI_Request, MPI_Status};
use mpi::point_to_point::Source as _;
use mpi::traits::{AsRaw as _, Communicator as _, Equivalence as _};

use crate::{World, count};

/// Tag of the messages of an exchange.
pub(crate) const EXCHANGE: i32 = 1;

/// Tag of what rank 0 collects, perhaps while an exchange is underway.
pub(crate) const GATHER: i32 = 2;

/// Longest piece in which a message is sent. MPI counts bytes in 31 bits, so long messages have to be cut; pieces as
/// short as this cost nothing either and are met often enough to be tested.
pub(crate) const PIECE: usize = 1 << 24;

/// Pieces of a message. All but the last are full and the last is not, even if it has to be empty: so a receiver knows
/// the end of a message whose length it does not know.
pub(crate) fn pieces(length: usize) -> impl Iterator<Item = Range<usize>> {
    (0..=length / PIECE).map(move |k| k * PIECE..length.min((k + 1) * PIECE))
}

/// Messages on their way, with the memory that MPI reads and writes meanwhile.
pub(crate) struct Underway<'a> {
    world: &'a World,
    tag: i32,
    /// Requests of the sends, and of the receives of known length: MPI works on `messages` and `received` until they
    /// are waited for.
    requests: Vec<MPI_Request>,
    /// Rank and number of bytes of each request that receives; these come first.
    promised: Vec<(usize, usize)>,
    messages: Vec<Message>,
    expected: Vec<Expected>,
    received: Vec<Vec<u8>>,
}

impl<'a> Underway<'a> {
    /// Starts to receive and to send.
    pub(crate) fn start(world: &'a World, messages: Vec<Message>, from: &[Expected], tag: i32) -> Self {
        let received = from.iter().map(|expected| vec![0; expected.length.unwrap_or(0)]).collect();
        let (requests, promised, expected) = (Vec::new(), Vec::new(), from.to_vec());
        let mut underway = Self { world, tag, requests, promised, messages, expected, received };
        underway.start_to_receive();
        underway.start_to_send();
        underway
    }

    /// The ranks that take part.
    pub(crate) fn world(&self) -> &'a World {
        self.world
    }

    fn start_to_receive(&mut self) {
        let (mpi, _turn) = self.world.mpi();
        for (expected, buffer) in self.expected.iter().zip(&mut self.received) {
            let Some(length) = expected.length else { continue };
            for piece in pieces(length) {
                self.promised.push((expected.from, piece.len()));
                let buffer = &mut buffer[piece];
                // SAFETY: the memory belongs to `received`, which is neither changed nor freed before the request has
                // been waited for: by `wait`, or else by `drop`. If the exchange is leaked, so is the memory.
                self.requests.push(request(|request| unsafe {
                    let (source, world) = (expected.from as i32, mpi.as_raw());
                    let (to, bytes) = (buffer.as_mut_ptr().cast(), count(buffer.len()));
                    ffi::MPI_Irecv(to, bytes, u8::equivalent_datatype().as_raw(), source, self.tag, world, request)
                }));
            }
        }
    }

    fn start_to_send(&mut self) {
        let (mpi, _turn) = self.world.mpi();
        for message in &self.messages {
            for piece in pieces(message.bytes.len()) {
                let bytes = &message.bytes[piece];
                // SAFETY: as above, with the memory of `messages`.
                self.requests.push(request(|request| unsafe {
                    let (to, world) = (message.to as i32, mpi.as_raw());
                    let (from, bytes) = (bytes.as_ptr().cast(), count(bytes.len()));
                    ffi::MPI_Isend(from, bytes, u8::equivalent_datatype().as_raw(), to, self.tag, world, request)
                }));
            }
        }
    }

    /// Waits for all messages: what was received.
    pub(crate) fn wait(mut self) -> Vec<Vec<u8>> {
        self.receive_what_has_unknown_length();
        let lengths = self.wait_for_requests();
        for ((from, promised), length) in self.promised.iter().zip(lengths) {
            assert!(*promised == length, "rank {from} sends {length} bytes, expected was another number");
        }
        std::mem::take(&mut self.received)
    }

    fn receive_what_has_unknown_length(&mut self) {
        let (mpi, _turn) = self.world.mpi();
        for (expected, buffer) in self.expected.iter().zip(&mut self.received).filter(|(e, _)| e.length.is_none()) {
            let peer = mpi.process_at_rank(expected.from as i32);
            loop {
                let (message, status) = peer.matched_probe_with_tag(self.tag);
                let (start, length) = (buffer.len(), status.count(u8::equivalent_datatype()) as usize);
                buffer.resize(start + length, 0);
                message.matched_receive_into(&mut buffer[start..]);
                if length < PIECE {
                    break;
                }
            }
        }
    }

    /// Waits until MPI has let go of all memory: numbers of bytes that the requests have moved.
    fn wait_for_requests(&mut self) -> Vec<usize> {
        let (_, _turn) = self.world.mpi();
        let number = self.requests.len();
        let mut statuses = vec![MaybeUninit::<MPI_Status>::uninit(); number];
        // SAFETY: both arrays are as long as said. MPI fills in the statuses of all requests, or ends the job.
        unsafe {
            ffi::MPI_Waitall(count(number), self.requests.as_mut_ptr(), statuses.as_mut_ptr().cast());
        }
        self.requests.clear();
        let length = |status: &MaybeUninit<MPI_Status>| {
            let mut bytes = 0;
            // SAFETY: see above; the status was filled in.
            unsafe { ffi::MPI_Get_count(status.as_ptr(), u8::equivalent_datatype().as_raw(), &mut bytes) };
            bytes as usize
        };
        statuses[..self.promised.len()].iter().map(length).collect()
    }
}

impl Drop for Underway<'_> {
    /// Nothing is left to wait for unless the exchange was not finished.
    fn drop(&mut self) {
        if !self.requests.is_empty() {
            self.wait_for_requests();
        }
    }
}

/// The request that a call makes. MPI's own handler of errors, which is not replaced, ends the job if the call fails.
fn request(call: impl FnOnce(*mut MPI_Request) -> i32) -> MPI_Request {
    let mut request = MaybeUninit::uninit();
    call(request.as_mut_ptr());
    // SAFETY: a call that returns has made its request.
    unsafe { request.assume_init() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_goes_in_pieces_of_which_only_the_last_is_shorter() {
        for (length, expected) in [(0, vec![0]), (5, vec![5]), (PIECE, vec![PIECE, 0]), (PIECE + 1, vec![PIECE, 1])] {
            let ranges: Vec<_> = pieces(length).collect();
            assert_eq!(ranges.iter().map(|range| range.len()).collect::<Vec<_>>(), expected);
            assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start));
            assert_eq!(ranges.last().map(|range| range.end), Some(length));
        }
    }
}

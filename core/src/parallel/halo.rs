//! Ghosts: copies of vertices that other ranks own, and the messages that keep them as their owners have them.

use std::ops::Range;

use bytemuck::Pod;

use crate::parallel::communicator::{Exchange, Expected, Message};
use crate::parallel::message::{self, Codec, Decoder};
use crate::parallel::ranks::Ranks;

/// Own vertices that go to each rank, and places of the copies of other ranks' vertices here. Numbers are local:
/// places in arrays that hold [ghosts below | own vertices | ghosts above], ascending in the scene's numbering.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Halo {
    sends: Vec<(usize, Vec<u32>)>,
    receives: Vec<(usize, Range<usize>)>,
}

/// Values on their way to the ghosts.
pub(crate) struct InFlight<'a> {
    exchange: Option<Box<dyn Exchange + 'a>>,
    receives: &'a [(usize, Range<usize>)],
    /// The rank that gets them.
    rank: usize,
}

impl Halo {
    /// The halo for these ghosts, given by their numbers in the scene, ascending; none is this rank's own. `starts` are the
    /// first vertices of every rank in the scene, and the number of all at the end. All ranks call it together.
    pub(crate) fn new(ranks: &Ranks, ghosts: &[u32], starts: &[u32]) -> Self {
        if ranks.is_alone() {
            return Self::default();
        }
        let rank = ranks.rank();
        let (first, own) = (starts[rank], (starts[rank + 1] - starts[rank]) as usize);
        let low = ghosts.partition_point(|ghost| *ghost < first);
        let (mut wanted, mut receives) = (Vec::new(), Vec::new());
        for owner in 0..ranks.count() {
            let place = |end: u32| ghosts.partition_point(|ghost| *ghost < end);
            let range = place(starts[owner])..place(starts[owner + 1]);
            wanted.push(ghosts[range.clone()].to_vec());
            if !range.is_empty() {
                let shift = if range.start < low { 0 } else { own };
                receives.push((owner, range.start + shift..range.end + shift));
            }
        }
        let asked = ranks.all_to_all_v(wanted).into_iter().enumerate().filter(|(_, list)| !list.is_empty());
        let local = |vertex: &u32| vertex - first + low as u32;
        let sends = asked.map(|(to, list)| (to, list.iter().map(local).collect())).collect();
        Self { sends, receives }
    }

    /// Whether nothing is exchanged.
    pub(crate) fn is_empty(&self) -> bool {
        self.sends.is_empty() && self.receives.is_empty()
    }

    /// Own vertices that some other rank has a copy of, rank by rank.
    pub(crate) fn sends(&self) -> &[(usize, Vec<u32>)] {
        &self.sends
    }

    /// Returns the places of the copies of other ranks' vertices, rank by rank.
    pub(crate) fn receives(&self) -> &[(usize, Range<usize>)] {
        &self.receives
    }

    /// Sends own values; the ghosts get theirs when the flight is finished.
    pub(crate) fn start<'a, T: Pod>(&'a self, ranks: &'a Ranks, values: &[T]) -> InFlight<'a> {
        let (receives, rank) = (self.receives.as_slice(), ranks.rank());
        if self.is_empty() {
            return InFlight { exchange: None, receives, rank };
        }
        let pack = |list: &[u32]| {
            let mut bytes = Vec::with_capacity(size_of::<T>() * list.len());
            list.iter().for_each(|i| bytes.extend_from_slice(bytemuck::bytes_of(&values[*i as usize])));
            bytes
        };
        let exchange = self.exchange(ranks, pack, |range| Some(size_of::<T>() * range.len()));
        InFlight { exchange: Some(exchange), receives, rank }
    }

    /// Sends each rank what `pack` makes of the own vertices that it has copies of; what comes has the `length` for these
    /// copies, or any.
    fn exchange<'a>(
        &self,
        ranks: &'a Ranks,
        pack: impl Fn(&[u32]) -> Vec<u8>,
        length: impl Fn(&Range<usize>) -> Option<usize>,
    ) -> Box<dyn Exchange + 'a> {
        let messages = self.sends.iter().map(|(to, list)| Message { to: *to, bytes: pack(list) }).collect();
        let expected: Vec<Expected> =
            self.receives.iter().map(|(from, range)| Expected { from: *from, length: length(range) }).collect();
        ranks.start(messages, &expected)
    }

    /// Sends the values of own vertices that have `changed`, and gives those that come to `take` with the ghost's place:
    /// rank by rank, ascending. For values of which few change.
    pub(crate) fn update_changed<T: Codec>(
        &self,
        ranks: &Ranks,
        changed: impl Fn(u32) -> Option<T>,
        mut take: impl FnMut(usize, T),
    ) {
        if self.is_empty() {
            return;
        }
        let pack = |list: &[u32]| {
            let mut bytes = Vec::new();
            for (place, vertex) in (0_u32..).zip(list) {
                changed(*vertex).iter().for_each(|value| {
                    place.put(&mut bytes);
                    value.put(&mut bytes);
                });
            }
            bytes
        };
        let received = self.exchange(ranks, pack, |_| None).finish();
        for ((_, range), bytes) in self.receives.iter().zip(received) {
            let mut message = Decoder::new(ranks.rank(), "values that have changed", &bytes);
            while !message.is_empty() {
                let place = message.index(range.len());
                take(range.start + place, T::take(&mut message));
            }
        }
    }

    /// Sends the ranks with copies of own vertices a list each, in the order of [`Halo::sends`]; returns the lists of the owners
    /// of ghosts, in the order of [`Halo::receives`].
    pub(crate) fn tell_holders_encoded<T: Codec>(
        &self,
        ranks: &Ranks,
        name: &'static str,
        lists: &[Vec<T>],
    ) -> Vec<Vec<T>> {
        let message = |((to, _), list): (&(usize, _), &Vec<T>)| Message { to: *to, bytes: message::encode_all(list) };
        let messages = self.sends.iter().zip(lists).map(message).collect();
        let expected: Vec<Expected> =
            self.receives.iter().map(|(from, _)| Expected { from: *from, length: None }).collect();
        let received = ranks.start(messages, &expected).finish();
        received.iter().map(|bytes| message::decode_all(ranks.rank(), name, bytes)).collect()
    }

    /// The other way round: sends the owners of ghosts the rows that `of` has for each run of ghosts; returns what comes for own
    /// vertices, in the order of [`Halo::sends`].
    pub(crate) fn tell_owners<T: Pod>(
        &self,
        ranks: &Ranks,
        name: &'static str,
        of: impl Fn(&Range<usize>) -> Vec<T>,
    ) -> Vec<Vec<T>> {
        let messages = self.receives.iter().map(|(to, range)| Message::of_rows(*to, &of(range))).collect();
        let expected: Vec<Expected> =
            self.sends.iter().map(|(from, _)| Expected { from: *from, length: None }).collect();
        let received = ranks.start(messages, &expected).finish();
        received.iter().map(|bytes| message::rows(ranks.rank(), name, bytes)).collect()
    }

    /// Brings the ghosts to their owners' values.
    pub(crate) fn update<T: Pod>(&self, ranks: &Ranks, values: &mut [T]) {
        self.start(ranks, values).finish(values);
    }
}

impl InFlight<'_> {
    /// Waits for the ghosts' values, of the type that was sent, and puts them into place.
    pub(crate) fn finish<T: Pod>(self, values: &mut [T]) {
        let Some(exchange) = self.exchange else { return };
        for ((_, range), bytes) in self.receives.iter().zip(exchange.finish()) {
            message::copy_rows(self.rank, "values of ghosts", &bytes, &mut values[range.clone()]);
        }
    }
}

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

/// An array over the local vertices, which is exchanged beside others.
pub(crate) trait GhostedArray {
    /// Bytes of a value.
    fn row(&self) -> usize;

    /// Appends the values of these vertices.
    fn put(&self, list: &[u32], message: &mut Vec<u8>);

    /// Takes the values of these ghosts.
    fn take(&mut self, ghosts: Range<usize>, message: &mut Decoder<'_>);
}

/// Appends the values of these vertices.
fn put_values<T: Pod>(values: &[T], list: &[u32], message: &mut Vec<u8>) {
    list.iter().for_each(|vertex| message.extend_from_slice(bytemuck::bytes_of(&values[*vertex as usize])));
}

impl<T: Pod> GhostedArray for &mut [T] {
    fn row(&self) -> usize {
        size_of::<T>()
    }

    fn put(&self, list: &[u32], message: &mut Vec<u8>) {
        put_values(self, list, message);
    }

    fn take(&mut self, ghosts: Range<usize>, message: &mut Decoder<'_>) {
        let bytes = message.bytes(size_of::<T>() * ghosts.len());
        bytemuck::cast_slice_mut::<T, u8>(&mut self[ghosts]).copy_from_slice(bytes);
    }
}

impl<T: Pod> GhostedArray for Vec<T> {
    fn row(&self) -> usize {
        size_of::<T>()
    }

    fn put(&self, list: &[u32], message: &mut Vec<u8>) {
        put_values(self, list, message);
    }

    fn take(&mut self, ghosts: Range<usize>, message: &mut Decoder<'_>) {
        self.as_mut_slice().take(ghosts, message);
    }
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

    /// The halo of own vertices that go to each rank, and of the places of the copies of other ranks' vertices; each side in the
    /// order of the other, rank by rank.
    pub(crate) fn of_lists(sends: Vec<(usize, Vec<u32>)>, receives: Vec<(usize, Range<usize>)>) -> Self {
        Self { sends, receives }
    }

    /// The ranks that this one sends to or gets something from, ascending.
    pub(crate) fn neighbours(&self) -> Vec<usize> {
        let mut ranks: Vec<usize> = self.sends.iter().map(|(to, _)| *to).collect();
        ranks.extend(self.receives.iter().map(|(from, _)| *from));
        ranks.sort_unstable();
        ranks.dedup();
        ranks
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
        self.start_rows(ranks, |vertex| values[vertex as usize])
    }

    /// Sends what `row_of` says of own vertices; the ghosts get it when the flight is finished.
    pub(crate) fn start_rows<'a, T: Pod>(&'a self, ranks: &'a Ranks, row_of: impl Fn(u32) -> T) -> InFlight<'a> {
        let (receives, rank) = (self.receives.as_slice(), ranks.rank());
        if self.is_empty() {
            return InFlight { exchange: None, receives, rank };
        }
        let pack = |list: &[u32]| {
            let mut bytes = Vec::with_capacity(size_of::<T>() * list.len());
            list.iter().for_each(|vertex| bytes.extend_from_slice(bytemuck::bytes_of(&row_of(*vertex))));
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
            put_changed(list, &changed, &mut bytes);
            bytes
        };
        let received = self.exchange(ranks, pack, |_| None).finish();
        for ((_, range), bytes) in self.receives.iter().zip(received) {
            take_changed(Decoder::new(ranks.rank(), CHANGED, &bytes), range, &mut take);
        }
    }

    /// A round of such updates, which ranks leave one after the other: `others` are the neighbours that are still in the rounds, at
    /// first all, and one that says that it `is_leaving` is taken out. This rank leaves by saying so and calling it no more.
    pub(crate) fn update_changed_in_rounds<T: Codec, I: IntoIterator<Item = T>>(
        &self,
        ranks: &Ranks,
        (others, is_leaving): (&mut Vec<usize>, bool),
        changed: impl Fn(u32) -> I,
        mut take: impl FnMut(usize, T),
    ) {
        let message = |to: &usize| {
            let mut bytes = is_leaving.to_bytes();
            let list = self.sends.iter().find(|(rank, _)| rank == to);
            list.iter().for_each(|(_, list)| put_changed(list, &changed, &mut bytes));
            Message { to: *to, bytes }
        };
        let expected: Vec<Expected> = others.iter().map(|from| Expected { from: *from, length: None }).collect();
        let received = ranks.start(others.iter().map(message).collect(), &expected).finish();
        let mut received = received.iter();
        others.retain(|from| {
            let bytes = received.next().map_or(&[][..], Vec::as_slice);
            let mut message = Decoder::new(ranks.rank(), CHANGED, bytes);
            let leaves = bool::take(&mut message);
            let range = self.receives.iter().find(|(rank, _)| rank == from).map_or(0..0, |(_, range)| range.clone());
            take_changed(message, &range, &mut take);
            !leaves
        });
    }

    /// Sends the ranks with copies of own vertices a list each, in the order of [`Halo::sends`]; returns the lists of the owners
    /// of ghosts, in the order of [`Halo::receives`].
    pub(crate) fn send_to_ghost_ranks<T: Codec>(
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

    /// Sends the owners of ghosts the rows that `of` has for each run of ghosts; returns what comes for own
    /// vertices, in the order of [`Halo::sends`].
    pub(crate) fn send_to_owners<T: Pod>(
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

    /// The same in several arrays, with one message for each rank.
    pub(crate) fn update_all(&self, ranks: &Ranks, arrays: &mut [&mut dyn GhostedArray]) {
        if self.is_empty() {
            return;
        }
        let row: usize = arrays.iter().map(|array| array.row()).sum();
        let pack = |list: &[u32]| {
            let mut bytes = Vec::with_capacity(row * list.len());
            arrays.iter().for_each(|array| array.put(list, &mut bytes));
            bytes
        };
        let received = self.exchange(ranks, pack, |range| Some(row * range.len())).finish();
        for ((_, range), bytes) in self.receives.iter().zip(received) {
            let mut message = Decoder::new(ranks.rank(), "values of ghosts", &bytes);
            arrays.iter_mut().for_each(|array| array.take(range.clone(), &mut message));
            message.end();
        }
    }
}

/// Name of messages with values that have changed, for the error of a damaged one.
const CHANGED: &str = "values that have changed";

/// Appends the values of the vertices of a list that have changed, any number of each, with their places in it.
fn put_changed<T: Codec, I: IntoIterator<Item = T>>(list: &[u32], changed: impl Fn(u32) -> I, bytes: &mut Vec<u8>) {
    for (place, vertex) in (0_u32..).zip(list) {
        changed(*vertex).into_iter().for_each(|value| {
            place.put(bytes);
            value.put(bytes);
        });
    }
}

/// Gives the values in the rest of a message to `take`, with the places of their ghosts, which are these.
fn take_changed<T: Codec>(mut message: Decoder<'_>, ghosts: &Range<usize>, mut take: impl FnMut(usize, T)) {
    while !message.is_empty() {
        let place = message.index(ghosts.len());
        take(ghosts.start + place, T::take(&mut message));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::local_ranks::LocalRanks;

    /// Twelve vertices, shared alike; ghosts of a rank are all those of its two neighbours in a ring.
    fn ring(ranks: &Ranks) -> (Halo, Vec<u32>) {
        let (rank, count) = (ranks.rank() as u32, ranks.count() as u32);
        let starts: Vec<u32> = (0..=count).map(|rank| rank * 12 / count).collect();
        let near = |owner: u32| (owner + 1) % count == rank || (rank + 1) % count == owner;
        let owner = |vertex: u32| starts.partition_point(|start| *start <= vertex) as u32 - 1;
        let ghosts: Vec<u32> = (0..12).filter(|vertex| owner(*vertex) != rank && near(owner(*vertex))).collect();
        let halo = Halo::new(ranks, &ghosts, &starts);
        let mut local = ghosts;
        local.extend(starts[rank as usize]..starts[rank as usize + 1]);
        local.sort_unstable();
        (halo, local)
    }

    fn on_ranks(count: usize, work: impl Fn(&Ranks) + Sync) {
        LocalRanks::run(count, 1, |communicator| work(&Ranks::new(communicator))).expect("no rank ends early");
    }

    #[test]
    fn several_arrays_come_in_one_message() {
        on_ranks(4, |ranks| {
            let (halo, local) = ring(ranks);
            let is_ghost = |place: usize| halo.receives().iter().any(|(_, range)| range.contains(&place));
            let known = |place: usize, value: f64| if is_ghost(place) { f64::NAN } else { value };
            let mut small: Vec<u8> = (0..local.len()).map(|i| known(i, f64::from(local[i])) as u8).collect();
            let mut large: Vec<[f64; 3]> = (0..local.len()).map(|i| [known(i, 0.5 * f64::from(local[i])); 3]).collect();
            let (mut slice, before) = (&mut large[..], ranks.sent());
            halo.update_all(ranks, &mut [&mut small, &mut slice]);
            assert_eq!(ranks.sent().messages - before.messages, 2);
            for ((small, large), number) in small.iter().zip(&large).zip(&local) {
                assert_eq!((u32::from(*small), *large), (*number, [0.5 * f64::from(*number); 3]));
            }
        });
    }

    #[test]
    fn ranks_leave_rounds_one_after_the_other_and_messages_still_match() {
        on_ranks(4, |ranks| {
            let (halo, local) = ring(ranks);
            let (mut others, mut rounds) = (halo.neighbours(), 0);
            assert_eq!(others.len(), 2);
            let mut found = vec![u32::MAX; local.len()];
            // Rank 2 leaves first, then 3, 0 and 1.
            let last = (ranks.rank() + 2) % 4;
            loop {
                let is_leaving = rounds == last;
                let changed = |vertex: u32| (rounds == 0).then(|| local[vertex as usize]);
                halo.update_changed_in_rounds(ranks, (&mut others, is_leaving), changed, |place, number| {
                    found[place] = number
                });
                if is_leaving {
                    break;
                }
                rounds += 1;
            }
            let came = (0..local.len()).filter(|place| found[*place] != u32::MAX);
            assert_eq!(came.clone().count(), local.len() - 3);
            came.for_each(|place| assert_eq!(found[place], local[place]));
            // What follows is not mixed up with what a rank that has left was not told.
            let mut values: Vec<u32> =
                local.iter().map(|number| number * u32::from(number / 3 == ranks.rank() as u32)).collect();
            halo.update(ranks, &mut values);
            assert_eq!(values, local);
        });
    }
}

//! Rows of an array on a rank, their gathering on rank 0, and the way back.

use std::ops::Range;

use crate::parallel::message::{Codec, codec};
use crate::parallel::parts::Parts;
use crate::parallel::ranks::Ranks;
use crate::snapshot::elements::{ElementRows, elements_of, flat, renumbered};
use crate::snapshot::{SnapshotError, Value};

/// Rows that travel together.
const CHUNK: usize = 1 << 16;

codec!(struct SnapshotError { section, what });

/// A pin target of a rank.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OwnTarget {
    /// Its number.
    pub(crate) number: u32,
    /// Number of its vertex in the scene.
    pub(crate) vertex: u32,
}

/// The numbers of pin targets.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TargetNumbers<'a> {
    /// Numbers of this rank, ascending.
    pub(crate) own: &'a [u32],
    /// Number of targets on all ranks.
    pub(crate) all: usize,
}

/// Rows of an array: those that one rank has, and behind them those that all ranks have.
pub(super) struct Rows {
    /// Numbers of the rows that this rank has, ascending.
    pub(super) keys: Vec<u32>,
    /// Number of each of them among the values of this rank.
    places: Vec<u32>,
    /// First row that all ranks have, and the number of all rows.
    known: Range<usize>,
}

impl Rows {
    /// Own vertices by the order of the garments' own numbers, and behind them `known` rows that all ranks have.
    pub(super) fn of_vertices(parts: &Parts, known: usize) -> Self {
        let mut rows: Vec<(u32, u32)> = parts.own().map(|local| own_number(parts, local)).zip(0..).collect();
        rows.sort_unstable();
        let cloth = parts.partition().vertex_count();
        let behind = |n: usize| ((cloth + n) as u32, (parts.own().len() + n) as u32);
        let (keys, places) = rows.into_iter().chain((0..known).map(behind)).unzip();
        Self { keys, places, known: cloth..cloth + known }
    }

    /// Own pin targets.
    pub(super) fn of_targets(TargetNumbers { own, all }: TargetNumbers<'_>) -> Self {
        Self { keys: own.to_vec(), places: (0..own.len() as u32).collect(), known: all..all }
    }

    /// Rows that all ranks have.
    pub(super) fn known(count: usize) -> Self {
        Self { keys: (0..count as u32).collect(), places: (0..count as u32).collect(), known: 0..count }
    }

    /// Number of rows of all ranks.
    pub(super) fn count(&self) -> usize {
        self.known.end
    }

    /// Places of the rows of a chunk among the rows of this rank.
    fn within(&self, chunk: &Range<usize>) -> Range<usize> {
        let place = |end: usize| self.keys.partition_point(|key| (*key as usize) < end);
        place(chunk.start)..place(chunk.end)
    }

    fn chunks(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let pieces = |rows: Range<usize>| {
            let end = rows.end;
            rows.step_by(CHUNK).map(move |start| start..(start + CHUNK).min(end))
        };
        pieces(0..self.known.start).chain(pieces(self.known.clone()))
    }

    /// Brings the rows of all ranks to rank 0, chunk by chunk.
    pub(super) fn give<T: Value>(&self, ranks: &Ranks, width: usize, own: &[T], mut to: impl FnMut(Vec<T>)) {
        for chunk in self.chunks() {
            let here = self.within(&chunk);
            let row = |place: &u32| own[*place as usize * width..(*place as usize + 1) * width].iter().copied();
            let values: Vec<T> = self.places[here.clone()].iter().flat_map(row).collect();
            if ranks.is_alone() || chunk.start >= self.known.start {
                to(values);
                continue;
            }
            let (keys, values) = (ranks.gather(&self.keys[here]), ranks.gather(&values));
            let mut rows = vec![T::zeroed(); if ranks.is_first() { chunk.len() * width } else { 0 }];
            for (keys, values) in keys.iter().zip(&values) {
                for (key, row) in keys.iter().zip(values.chunks_exact(width.max(1))) {
                    let place = (*key as usize - chunk.start) * width;
                    rows[place..place + width].copy_from_slice(row);
                }
            }
            if ranks.is_first() {
                to(rows);
            }
        }
    }

    /// Takes this rank's rows of what rank 0 reads, chunk by chunk.
    pub(super) fn take<T: Value>(
        &self,
        ranks: &Ranks,
        width: usize,
        mut read: impl FnMut(Range<usize>) -> Result<Vec<T>, SnapshotError>,
    ) -> Result<Vec<T>, SnapshotError> {
        let mut own = vec![T::zeroed(); self.keys.len() * width];
        for chunk in self.chunks() {
            let rows = read_and_broadcast(ranks, || read(chunk.clone()))?;
            for i in self.within(&chunk) {
                let from = (self.keys[i] as usize - chunk.start) * width;
                let to = self.places[i] as usize * width;
                own[to..to + width].copy_from_slice(&rows[from..from + width]);
            }
        }
        Ok(own)
    }

    /// The first row of all ranks of whose values one is wrong.
    pub(super) fn first_wrong(&self, ranks: &Ranks, is_wrong: impl Fn(usize) -> bool) -> Option<f64> {
        let wrong = self.keys.iter().zip(&self.places).find(|(_, place)| is_wrong(**place as usize));
        let first = -ranks.max(-wrong.map_or(f64::INFINITY, |(key, _)| f64::from(*key)));
        first.is_finite().then_some(first)
    }
}

/// Value that rank 0 reads, on every rank, or its error.
pub(super) fn read_and_broadcast<T: Codec>(
    ranks: &Ranks,
    read: impl FnOnce() -> Result<T, SnapshotError>,
) -> Result<T, SnapshotError> {
    ranks.broadcast_encoded("rows of a snapshot", ranks.is_first().then(read))
}

/// Number of a local vertex that no partition enters: the garment's own, those of the garments before it added.
fn own_number(parts: &Parts, local: usize) -> u32 {
    let (garment, number) = parts.own_vertex(local);
    parts.partition().garments()[garment].start as u32 + number
}

/// Numbers of nodes in the scene as numbers that no partition enters: garments' own, points of bodies after them. The same on
/// all ranks.
pub(super) fn own_order(parts: &Parts, numbers: &[u32]) -> Vec<u32> {
    let own = |number: u32| parts.local(number).filter(|local| parts.own().contains(local));
    let found = translated(parts, numbers, |number| own(number).map(|local| own_number(parts, local)));
    found.expect("what a snapshot names exists on the rank that owns it")
}

/// The inverse of [`own_order`]; `None` if a number is not that of a vertex.
pub(super) fn scene_order(parts: &Parts, own: &[u32]) -> Option<Vec<u32>> {
    let (rows, first) = (Rows::of_vertices(parts, 0), parts.own().start);
    translated(parts, own, |own| {
        let row = rows.keys.binary_search(&own).ok()?;
        Some(parts.number(first + rows.places[row] as usize))
    })
}

/// Numbers of cloth by what their owners know, points of bodies as they are; `None` if nobody knows one.
fn translated(parts: &Parts, numbers: &[u32], known: impl Fn(u32) -> Option<u32>) -> Option<Vec<u32>> {
    let cloth = parts.partition().vertex_count() as u32;
    let one = |number: &u32| if *number >= cloth { Some(*number) } else { known(*number) };
    let found = parts.ranks().max_each(numbers.iter().map(|number| one(number).map_or(-1.0, f64::from)).collect());
    found.into_iter().map(|number| (number >= 0.0).then_some(number as u32)).collect()
}

/// The elements of all ranks by the vertices' own numbers and in their order, so that it does not show who had them; on rank 0.
pub(super) fn sorted_elements(parts: &Parts, own: ElementRows) -> ElementRows {
    let own = renumbered(own, |number| parts.local(number).map(|local| own_number(parts, local)));
    elements_of(&parts.ranks().gather(&flat(&own)).concat())
}

/// The rows of those targets that are this rank's in `new`.
pub(super) fn moved_targets<T: Value>(new: &Parts, pinned: &[OwnTarget], width: usize, values: &[T]) -> Vec<T> {
    let ranks = new.ranks();
    let to = |rank: usize| {
        pinned.iter().zip(values.chunks_exact(width)).filter(move |(target, _)| new.owner(target.vertex) == rank)
    };
    let numbers = ranks
        .all_to_all_v((0..ranks.count()).map(|rank| to(rank).map(|(target, _)| target.number).collect()).collect());
    let rows = ranks
        .all_to_all_v((0..ranks.count()).map(|rank| to(rank).flat_map(|(_, row)| row).copied().collect()).collect());
    let (numbers, rows) = (numbers.concat(), rows.concat());
    let mut order: Vec<usize> = (0..numbers.len()).collect();
    order.sort_unstable_by_key(|i| numbers[*i]);
    order.into_iter().flat_map(|i| rows[i * width..(i + 1) * width].iter().copied()).collect()
}

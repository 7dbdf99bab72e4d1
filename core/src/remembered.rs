//! What time has changed, as the ranks have it: fields over own vertices, over own pin targets, and values that all ranks
//! know. It becomes a snapshot, in which nothing tells how many ranks there were, and it moves when vertices change their
//! rank.

use std::ops::Range;

use bytemuck::Pod;

use crate::Vec3;
use crate::parallel::parts::Parts;
use crate::parallel::ranks::Ranks;
use crate::parallel::wire::Wire;
use crate::snapshot::{SnapshotError, SnapshotSink, SnapshotSource, ValueKind, Values};

/// Rows of a field that travel together.
const CHUNK: usize = 1 << 16;

/// What one part of the solver remembers on this rank.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Remembered {
    /// Name of the section of a snapshot.
    pub(crate) name: &'static str,
    /// Version of its layout.
    pub(crate) version: u32,
    /// Its fields with their names, in a fixed order.
    pub(crate) fields: Vec<(&'static str, Field)>,
}

/// A field.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Field {
    /// A number that all ranks know.
    Number(f64),
    /// A count that all ranks know.
    Count(u64),
    /// So many numbers for each own vertex, ascending.
    Vertices(usize, Vec<f64>),
    /// A vector for each own vertex, ascending, and for each of so many points of bodies, which all ranks know; or none at all.
    Nodes(usize, Option<(Vec<Vec3>, Vec<Vec3>)>),
    /// Values for each own pin target, so many a row.
    Targets(usize, Values),
    /// Rows of so many nodes by their numbers in the scene, which all ranks know.
    Numbers(usize, Vec<u32>),
}

/// Which rows of a field a rank has: their keys, ascending, and the places of their values.
struct Rows {
    keys: Vec<u32>,
    places: Vec<u32>,
    /// Number of rows of all ranks.
    all: usize,
}

impl Rows {
    /// Own vertices by the order of the garments' own numbers.
    fn of_vertices(parts: &Parts) -> Self {
        let index = |local: usize| {
            let (garment, number) = parts.own_vertex(local);
            parts.partition().garments()[garment].start as u32 + number
        };
        let mut rows: Vec<(u32, u32)> = parts.own().map(index).zip(0..).collect();
        rows.sort_unstable();
        let (keys, places) = rows.into_iter().unzip();
        Self { keys, places, all: parts.partition().vertex_count() }
    }

    /// Own pin targets, given by their numbers, ascending.
    fn of_targets(numbers: &[u32], all: usize) -> Self {
        Self { keys: numbers.to_vec(), places: (0..numbers.len() as u32).collect(), all }
    }

    /// Places of the rows of a chunk among those of this rank.
    fn within(&self, chunk: &Range<usize>) -> Range<usize> {
        let place = |end: usize| self.keys.partition_point(|key| (*key as usize) < end);
        place(chunk.start)..place(chunk.end)
    }

    fn chunks(&self) -> impl Iterator<Item = Range<usize>> {
        let all = self.all;
        (0..all).step_by(CHUNK).map(move |start| start..(start + CHUNK).min(all))
    }

    /// Brings the rows of all ranks to rank 0, chunk by chunk.
    fn give<T: Pod>(&self, ranks: &Ranks, width: usize, own: &[T], mut to: impl FnMut(Vec<T>)) {
        for chunk in self.chunks() {
            let here = self.within(&chunk);
            let row = |place: &u32| own[*place as usize * width..(*place as usize + 1) * width].iter().copied();
            let values: Vec<T> = self.places[here.clone()].iter().flat_map(row).collect();
            if ranks.is_alone() {
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
    fn take<T: Pod>(
        &self,
        ranks: &Ranks,
        width: usize,
        mut read: impl FnMut(Range<usize>) -> Result<Vec<T>, SnapshotError>,
    ) -> Result<Vec<T>, SnapshotError> {
        let mut own = vec![T::zeroed(); self.keys.len() * width];
        for chunk in self.chunks() {
            let rows = share(ranks, || read(chunk.clone()))?;
            for i in self.within(&chunk) {
                let from = (self.keys[i] as usize - chunk.start) * width;
                let to = self.places[i] as usize * width;
                own[to..to + width].copy_from_slice(&rows[from..from + width]);
            }
        }
        Ok(own)
    }
}

/// What rank 0 reads, on every rank; or its error.
fn share<T: Pod>(ranks: &Ranks, read: impl FnOnce() -> Result<Vec<T>, SnapshotError>) -> Result<Vec<T>, SnapshotError> {
    if ranks.is_alone() {
        return read();
    }
    let mut bytes = Vec::new();
    if ranks.is_first() {
        match read() {
            Ok(values) => {
                bytes.push(1);
                bytes.extend_from_slice(bytemuck::cast_slice(&values));
            }
            Err(error) => {
                bytes.push(0);
                (error.section, error.what).put(&mut bytes);
            }
        }
    }
    ranks.broadcast(&mut bytes);
    match bytes.split_first() {
        Some((1, values)) => Ok(bytemuck::pod_collect_to_vec(values)),
        Some((_, mut error)) => {
            let (section, what) = <(String, String)>::take(&mut error).unwrap_or_default();
            Err(SnapshotError { section, what })
        }
        None => Err(SnapshotError { section: String::new(), what: "rank 0 has told nothing of it".into() }),
    }
}

/// Numbers of nodes in the scene as numbers that no partition enters: garments' own, points of bodies after them. The same on
/// all ranks.
pub(crate) fn own_order(parts: &Parts, numbers: &[u32]) -> Vec<u32> {
    translated(parts, numbers, |number| {
        let local = parts.local(number).filter(|local| parts.own().contains(local))?;
        let (garment, own) = parts.own_vertex(local);
        Some(parts.partition().garments()[garment].start as u32 + own)
    })
}

/// The inverse of [`own_order`].
fn scene_order(parts: &Parts, rows: &Rows, own: &[u32]) -> Vec<u32> {
    let first = parts.own().start;
    translated(parts, own, |own| {
        let place = rows.keys.binary_search(&own).ok()?;
        Some(parts.number(first + rows.places[place] as usize))
    })
}

fn translated(parts: &Parts, numbers: &[u32], known: impl Fn(u32) -> Option<u32>) -> Vec<u32> {
    let cloth = parts.partition().vertex_count() as u32;
    let one = |number: &u32| if *number >= cloth { Some(*number) } else { known(*number) };
    let here: Vec<f64> = numbers.iter().map(|number| one(number).map_or(-1.0, f64::from)).collect();
    parts.ranks().max_each(here).into_iter().map(|number| number.max(0.0) as u32).collect()
}

/// The rows of those targets that are this rank's in `new`.
fn moved_targets<T: Pod>(new: &Parts, pinned: &[[u32; 2]], width: usize, values: &[T]) -> Vec<T> {
    let ranks = new.ranks();
    let to = |rank: usize| {
        pinned.iter().zip(values.chunks_exact(width)).filter(move |([_, vertex], _)| new.owner(*vertex) == rank)
    };
    let numbers = ranks.send_lists((0..ranks.count()).map(|rank| to(rank).map(|(p, _)| p[0]).collect()).collect());
    let rows =
        ranks.send_lists((0..ranks.count()).map(|rank| to(rank).flat_map(|(_, row)| row).copied().collect()).collect());
    let (numbers, rows) = (numbers.concat(), rows.concat());
    let mut order: Vec<usize> = (0..numbers.len()).collect();
    order.sort_unstable_by_key(|i| numbers[*i]);
    order.into_iter().flat_map(|i| rows[i * width..(i + 1) * width].iter().copied()).collect()
}

impl Remembered {
    /// Nothing yet.
    pub(crate) fn new(name: &'static str, version: u32) -> Self {
        Self { name, version, fields: Vec::new() }
    }

    /// Adds a field.
    pub(crate) fn with(mut self, name: &'static str, field: Field) -> Self {
        self.fields.push((name, field));
        self
    }

    /// Writes the section. All ranks call it together; rank 0 has the sink.
    pub(crate) fn give(&self, parts: &Parts, targets: (&[u32], usize), mut sink: Option<&mut (dyn SnapshotSink + '_)>) {
        let ranks = parts.ranks();
        if let Some(sink) = &mut sink {
            sink.section(self.name, self.version);
        }
        for (name, field) in &self.fields {
            let mut begin = |shape: &[usize], kind| {
                if let Some(sink) = &mut sink {
                    sink.dataset(name, shape, kind);
                }
            };
            match field {
                Field::Number(_) => begin(&[1], ValueKind::F64),
                Field::Count(_) => begin(&[1], ValueKind::U64),
                Field::Vertices(1, _) => begin(&[parts.partition().vertex_count()], ValueKind::F64),
                Field::Vertices(width, _) => begin(&[parts.partition().vertex_count(), *width], ValueKind::F64),
                Field::Nodes(_, None) => begin(&[0, 3], ValueKind::F64),
                Field::Nodes(_, Some((_, bodies))) => {
                    begin(&[parts.partition().vertex_count() + bodies.len(), 3], ValueKind::F64);
                }
                Field::Targets(1, values) => begin(&[targets.1], values.kind()),
                Field::Targets(width, values) => begin(&[targets.1, *width], values.kind()),
                Field::Numbers(width, values) => begin(&[values.len() / width, *width], ValueKind::U32),
            }
            let mut rows = |values: Values| {
                if let Some(sink) = &mut sink {
                    sink.rows(values);
                }
            };
            let of_targets = || Rows::of_targets(targets.0, targets.1);
            match field {
                Field::Number(value) => rows(Values::F64(vec![*value])),
                Field::Count(value) => rows(Values::U64(vec![*value])),
                Field::Vertices(width, own) => {
                    Rows::of_vertices(parts).give(ranks, *width, own, |values| rows(Values::F64(values)));
                }
                Field::Nodes(_, None) => {}
                Field::Nodes(_, Some((own, bodies))) => {
                    let flat: &[f64] = bytemuck::cast_slice(own);
                    Rows::of_vertices(parts).give(ranks, 3, flat, |values| rows(Values::F64(values)));
                    rows(Values::F64(bytemuck::cast_slice(bodies).to_vec()));
                }
                Field::Targets(width, Values::F64(own)) => {
                    of_targets().give(ranks, *width, own, |v| rows(Values::F64(v)))
                }
                Field::Targets(width, Values::U32(own)) => {
                    of_targets().give(ranks, *width, own, |v| rows(Values::U32(v)))
                }
                Field::Targets(width, Values::U8(own)) => {
                    of_targets().give(ranks, *width, own, |v| rows(Values::U8(v)))
                }
                Field::Targets(..) => unreachable!("pins remember numbers, points and marks only"),
                Field::Numbers(_, values) => rows(Values::U32(own_order(parts, values))),
            }
        }
    }

    /// Reads into the fields, which say what is expected, and have the sizes that this rank needs. All ranks call it together;
    /// rank 0 has the source.
    ///
    /// # Errors
    /// The same on all ranks: the section is of another scene or version, or cannot be read.
    pub(crate) fn take(
        &mut self,
        parts: &Parts,
        (numbers, all_targets): (&[u32], usize),
        mut source: Option<&mut (dyn SnapshotSource + '_)>,
    ) -> Result<(), SnapshotError> {
        let (ranks, section) = (parts.ranks(), self.name);
        let error = |what: String| SnapshotError { section: section.to_owned(), what };
        let lost = || error("rank 0 has no source for it".into());
        let version = share(ranks, || {
            let source = source.as_deref().ok_or_else(lost)?;
            Ok(vec![u64::from(source.version(section).ok_or_else(|| error("it is missing".into()))?)])
        })?;
        if version != [u64::from(self.version)] {
            let (found, known) = (version.first().copied().unwrap_or(0), self.version);
            return Err(error(format!("it has version {found}, this program reads {known}")));
        }
        for (name, field) in &mut self.fields {
            let rows = share(ranks, || {
                let source = source.as_deref().ok_or_else(lost)?;
                source.rows_of(section, name).map(|rows| vec![rows as u64])
            })?;
            let rows = rows.first().map_or(0, |rows| *rows as usize);
            let fits = |expected: usize| match rows == expected {
                true => Ok(()),
                false => Err(error(format!("`{name}` has {rows} rows instead of {expected}"))),
            };
            let mut values = |range: Range<usize>| source.as_deref_mut().ok_or_else(lost)?.values(section, name, range);
            let other = || error(format!("`{name}` holds values of another type"));
            macro_rules! read {
                ($kind:ident, $rows:expr, $width:expr) => {
                    $rows.take(ranks, $width, |range| match values(range.clone())? {
                        Values::$kind(values) if values.len() == range.len() * $width => Ok(values),
                        _ => Err(other()),
                    })?
                };
            }
            // Known to all: one rank has every row.
            let alike = |count: usize| Rows {
                keys: (0..count as u32).collect(),
                places: (0..count as u32).collect(),
                all: count,
            };
            let of_targets = || Rows::of_targets(numbers, all_targets);
            let cloth = parts.partition().vertex_count();
            match field {
                Field::Number(value) => *value = read!(F64, alike(1), 1).first().copied().ok_or_else(other)?,
                Field::Count(value) => *value = read!(U64, alike(1), 1).first().copied().ok_or_else(other)?,
                Field::Vertices(width, own) => {
                    fits(cloth)?;
                    *own = read!(F64, Rows::of_vertices(parts), *width);
                }
                Field::Nodes(bodies, nodes) => {
                    if rows == 0 {
                        *nodes = None;
                        continue;
                    }
                    fits(cloth + *bodies)?;
                    let own: Vec<f64> = read!(F64, Rows::of_vertices(parts), 3);
                    let of_bodies = share(ranks, || match values(cloth..rows)? {
                        Values::F64(values) => Ok(values),
                        _ => Err(other()),
                    })?;
                    *nodes = Some((bytemuck::pod_collect_to_vec(&own), bytemuck::pod_collect_to_vec(&of_bodies)));
                }
                Field::Targets(width, of_rank) => {
                    fits(all_targets)?;
                    *of_rank = match of_rank.kind() {
                        ValueKind::F64 => Values::F64(read!(F64, of_targets(), *width)),
                        ValueKind::U32 => Values::U32(read!(U32, of_targets(), *width)),
                        ValueKind::U8 => Values::U8(read!(U8, of_targets(), *width)),
                        ValueKind::U64 | ValueKind::I64 => return Err(other()),
                    };
                }
                Field::Numbers(width, numbers) => {
                    let own: Vec<u32> = read!(U32, alike(rows), *width);
                    *numbers = scene_order(parts, &Rows::of_vertices(parts), &own);
                }
            }
        }
        Ok(())
    }

    /// Hands the rows of own vertices and targets to the ranks that own them in `new`; `pinned` are the own targets, each with its
    /// number and that of its vertex in the scene. All ranks call it together.
    pub(crate) fn move_to(&mut self, old: &Parts, new: &Parts, pinned: &[[u32; 2]]) {
        let ranks = old.ranks();
        let first = old.rank_starts()[ranks.rank()];
        let own = first..old.rank_starts()[ranks.rank() + 1];
        let run = |rank: usize| {
            let (start, end) = (new.rank_starts()[rank].max(own.start), new.rank_starts()[rank + 1].min(own.end));
            (start.min(end) - first.min(end)) as usize..(end - first.min(end)) as usize
        };
        for (_, field) in &mut self.fields {
            match field {
                Field::Vertices(width, values) => {
                    let rows = |rank| values[run(rank).start * *width..run(rank).end * *width].to_vec();
                    *values = ranks.send_lists((0..ranks.count()).map(rows).collect()).concat();
                }
                Field::Nodes(_, Some((values, _))) => {
                    let rows = |rank| values[run(rank)].to_vec();
                    *values = ranks.send_lists((0..ranks.count()).map(rows).collect()).concat();
                }
                Field::Targets(width, Values::F64(values)) => *values = moved_targets(new, pinned, *width, values),
                Field::Targets(width, Values::U32(values)) => *values = moved_targets(new, pinned, *width, values),
                Field::Targets(width, Values::U8(values)) => *values = moved_targets(new, pinned, *width, values),
                Field::Targets(..)
                | Field::Number(_)
                | Field::Count(_)
                | Field::Nodes(_, None)
                | Field::Numbers(..) => {}
            }
        }
    }

    /// A number of this name.
    pub(crate) fn number(&self, name: &str) -> f64 {
        match self.field(name) {
            Some(Field::Number(value)) => *value,
            _ => 0.0,
        }
    }

    /// A count of this name.
    pub(crate) fn count(&self, name: &str) -> u64 {
        match self.field(name) {
            Some(Field::Count(value)) => *value,
            _ => 0,
        }
    }

    /// The numbers of own vertices in the field of this name.
    pub(crate) fn vertices(&self, name: &str) -> &[f64] {
        match self.field(name) {
            Some(Field::Vertices(_, values)) => values,
            _ => &[],
        }
    }

    /// The values of own targets in the field of this name.
    pub(crate) fn targets(&self, name: &str) -> Option<&Values> {
        match self.field(name) {
            Some(Field::Targets(_, values)) => Some(values),
            _ => None,
        }
    }

    /// The rows of node numbers in the field of this name.
    pub(crate) fn numbers(&self, name: &str) -> &[u32] {
        match self.field(name) {
            Some(Field::Numbers(_, values)) => values,
            _ => &[],
        }
    }

    /// The positions of nodes in the field of this name.
    pub(crate) fn nodes(&self, name: &str) -> Option<&(Vec<Vec3>, Vec<Vec3>)> {
        match self.field(name) {
            Some(Field::Nodes(_, nodes)) => nodes.as_ref(),
            _ => None,
        }
    }

    fn field(&self, name: &str) -> Option<&Field> {
        self.fields.iter().find(|(known, _)| *known == name).map(|(_, field)| field)
    }
}

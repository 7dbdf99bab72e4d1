//! What time has changed, as the ranks have it: fields over own vertices, over own pin targets, and values that all ranks
//! know. It becomes a snapshot, in which nothing tells how many ranks there were, and it moves when vertices change their
//! rank.

use std::ops::Range;

use bytemuck::Pod;

use crate::Vec3;
use crate::parallel::message::{Codec, codec};
use crate::parallel::parts::Parts;
use crate::parallel::ranks::Ranks;
use crate::scene::{FARTHEST, is_possible};
use crate::snapshot::{SnapshotError, SnapshotSink, SnapshotSource, ValueKind, Values};

pub use crate::snapshot::element_rows::ElementRows;

/// A section of a snapshot, and hence of a checkpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SectionId {
    /// Its name; several effects may share one.
    pub name: &'static str,
    /// Version of its layout.
    pub version: u32,
}

/// Rows of a field that travel together.
const CHUNK: usize = 1 << 16;

/// What one part of the solver remembers on this rank.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SavedSection {
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
    /// A finite vector for each own vertex, ascending.
    Vectors(Vec<Vec3>),
    /// A vector for each own vertex, ascending, and for each of so many points of bodies, which all ranks know; or none at all.
    Nodes(usize, Option<(Vec<Vec3>, Vec<Vec3>)>),
    /// Values for each own pin target, so many a row.
    Targets(usize, Values),
    /// Rows of so many nodes by their numbers in the scene, which all ranks know.
    Numbers(usize, Vec<u32>),
    /// Rows of elements: those that count here when they are given, those of all ranks when they were taken or have moved.
    Elements(ElementRows),
}

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
    /// Those of this rank, ascending.
    pub(crate) own: &'a [u32],
    /// How many all ranks have.
    pub(crate) all: usize,
}

codec!(struct SnapshotError { section, what });

/// Which rows of a field a rank has: their keys, ascending, and the places of their values.
struct Rows {
    keys: Vec<u32>,
    places: Vec<u32>,
    /// Rows of all ranks.
    all: Range<usize>,
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
        Self { keys, places, all: 0..parts.partition().vertex_count() }
    }

    /// Own pin targets.
    fn of_targets(TargetNumbers { own, all }: TargetNumbers<'_>) -> Self {
        Self { keys: own.to_vec(), places: (0..own.len() as u32).collect(), all: 0..all }
    }

    /// Rows that all ranks have.
    fn alike(rows: Range<usize>) -> Self {
        let places = (0..rows.len() as u32).collect();
        Self { keys: rows.clone().map(|row| row as u32).collect(), places, all: rows }
    }

    /// Places of the rows of a chunk among those of this rank.
    fn within(&self, chunk: &Range<usize>) -> Range<usize> {
        let place = |end: usize| self.keys.partition_point(|key| (*key as usize) < end);
        place(chunk.start)..place(chunk.end)
    }

    fn chunks(&self) -> impl Iterator<Item = Range<usize>> {
        let all = self.all.clone();
        all.clone().step_by(CHUNK).map(move |start| start..(start + CHUNK).min(all.end))
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
    fn take<T: Pod + Codec>(
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
}

/// What rank 0 reads, on every rank; or its error.
fn read_and_broadcast<T: Codec>(
    ranks: &Ranks,
    read: impl FnOnce() -> Result<T, SnapshotError>,
) -> Result<T, SnapshotError> {
    ranks.broadcast_encoded("rows of a snapshot", ranks.is_first().then(read))
}

/// Numbers of nodes in the scene as numbers that no partition enters: garments' own, points of bodies after them. The same on
/// all ranks.
pub(crate) fn own_order(parts: &Parts, numbers: &[u32]) -> Vec<u32> {
    let found = translated(parts, numbers, |number| {
        let local = parts.local(number).filter(|local| parts.own().contains(local))?;
        let (garment, own) = parts.own_vertex(local);
        Some(parts.partition().garments()[garment].start as u32 + own)
    });
    let known = |number: f64| {
        assert!(number >= 0.0, "what a snapshot names exists on the rank that owns it");
        number as u32
    };
    found.into_iter().map(known).collect()
}

/// The inverse of [`own_order`]; `None` if a number is not that of a vertex.
fn scene_order(parts: &Parts, rows: &Rows, own: &[u32]) -> Option<Vec<u32>> {
    let first = parts.own().start;
    let found = translated(parts, own, |own| {
        let place = rows.keys.binary_search(&own).ok()?;
        Some(parts.number(first + rows.places[place] as usize))
    });
    found.into_iter().map(|number| (number >= 0.0).then_some(number as u32)).collect()
}

/// Numbers of cloth by what their owners know, points of bodies as they are; -1 where nobody knows one.
fn translated(parts: &Parts, numbers: &[u32], known: impl Fn(u32) -> Option<u32>) -> Vec<f64> {
    let cloth = parts.partition().vertex_count() as u32;
    let one = |number: &u32| if *number >= cloth { Some(*number) } else { known(*number) };
    parts.ranks().max_each(numbers.iter().map(|number| one(number).map_or(-1.0, f64::from)).collect())
}

/// The rows of those targets that are this rank's in `new`.
fn moved_targets<T: Pod>(new: &Parts, pinned: &[OwnTarget], width: usize, values: &[T]) -> Vec<T> {
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

/// Reads one field.
struct Reader<'a, 's> {
    parts: &'a Parts,
    section: &'static str,
    name: &'static str,
    /// On rank 0.
    source: Option<&'a mut (dyn SnapshotSource + 's)>,
    /// Rows that the array has.
    rows: usize,
}

impl Reader<'_, '_> {
    fn error(&self, what: String) -> SnapshotError {
        SnapshotError { section: self.section.to_owned(), what }
    }

    fn count_rows(&mut self) -> Result<(), SnapshotError> {
        let rows = read_and_broadcast(self.parts.ranks(), || {
            let source = self.source.as_deref().ok_or_else(|| self.error("nobody gives it".into()))?;
            source.rows_of(self.section, self.name)
        })?;
        self.rows = rows;
        Ok(())
    }

    /// Makes sure of the number of rows.
    fn expect(&self, rows: usize) -> Result<(), SnapshotError> {
        if self.rows == rows {
            return Ok(());
        }
        Err(self.error(format!("`{}` has {} rows, not {rows}", self.name, self.rows)))
    }

    /// The rows of this rank, of values that `of_kind` takes out.
    fn own<T: Pod + Codec>(
        &mut self,
        rows: &Rows,
        width: usize,
        of_kind: impl Fn(Values) -> Option<Vec<T>>,
    ) -> Result<Vec<T>, SnapshotError> {
        let (section, name, ranks) = (self.section, self.name, self.parts.ranks());
        let other =
            SnapshotError { section: section.to_owned(), what: format!("`{name}` is of another type or width") };
        rows.take(ranks, width, |range| {
            let source = self.source.as_deref_mut().ok_or_else(|| other.clone())?;
            let count = range.len() * width;
            let values = of_kind(source.values(section, name, range)?);
            values.filter(|values| values.len() == count).ok_or_else(|| other.clone())
        })
    }

    /// Positions or velocities of this rank's rows.
    fn vectors(&mut self, rows: &Rows) -> Result<Vec<Vec3>, SnapshotError> {
        let own = self.own(rows, 3, reals)?;
        let vectors: Vec<Vec3> = own.as_chunks::<3>().0.iter().map(|x| Vec3::from(*x)).collect();
        let broken = |i: &usize| !is_possible(&vectors[rows.places[*i] as usize]);
        let first = (0..rows.keys.len()).find(broken).map_or(f64::INFINITY, |i| f64::from(rows.keys[i]));
        let first = -self.parts.ranks().max(-first);
        match first.is_finite() {
            true => Err(self.error(format!("row {first} of `{}` is not finite, or beyond {FARTHEST:e}", self.name))),
            false => Ok(vectors),
        }
    }

    fn read(&mut self, field: &mut Field, targets: &Rows) -> Result<(), SnapshotError> {
        let (parts, cloth) = (self.parts, self.parts.partition().vertex_count());
        match field {
            Field::Number(value) => {
                self.expect(1)?;
                *value = self.own(&Rows::alike(0..1), 1, reals)?[0];
            }
            Field::Count(value) => {
                self.expect(1)?;
                let count = |values| if let Values::U64(values) = values { Some(values) } else { None };
                *value = self.own(&Rows::alike(0..1), 1, count)?[0];
            }
            Field::Vertices(width, own) => {
                self.expect(cloth)?;
                *own = self.own(&Rows::of_vertices(parts), *width, reals)?;
            }
            Field::Vectors(own) => {
                self.expect(cloth)?;
                *own = self.vectors(&Rows::of_vertices(parts))?;
            }
            Field::Nodes(_, nodes) if self.rows == 0 => *nodes = None,
            Field::Nodes(bodies, nodes) => {
                self.expect(cloth + *bodies)?;
                let own = self.vectors(&Rows::of_vertices(parts))?;
                *nodes = Some((own, self.vectors(&Rows::alike(cloth..cloth + *bodies))?));
            }
            Field::Targets(width, own) => {
                self.expect(targets.all.len())?;
                *own = match own.kind() {
                    ValueKind::U32 => Values::U32(self.own(targets, *width, indices)?),
                    ValueKind::U8 => {
                        let marks = |values| if let Values::U8(values) = values { Some(values) } else { None };
                        Values::U8(self.own(targets, *width, marks)?)
                    }
                    ValueKind::F64 | ValueKind::U64 | ValueKind::I64 => Values::F64(self.own(targets, *width, reals)?),
                };
            }
            Field::Numbers(width, numbers) => {
                let own: Vec<u32> = self.own(&Rows::alike(0..self.rows), *width, indices)?;
                let found = scene_order(parts, &Rows::of_vertices(parts), &own);
                *numbers =
                    found.ok_or_else(|| self.error(format!("`{}` names a vertex that does not exist", self.name)))?;
            }
            Field::Elements(rows) => {
                rows.set(self.own(&Rows::alike(0..self.rows), rows.width(), reals)?);
                let own: Vec<u32> = rows.iter().flat_map(|(nodes, _)| nodes).collect();
                let found = scene_order(parts, &Rows::of_vertices(parts), &own).filter(|_| rows.is_finite());
                let wrong = || self.error(format!("`{}` has a vertex that does not exist or is not finite", self.name));
                rows.set_nodes(&found.ok_or_else(wrong)?);
            }
        }
        Ok(())
    }
}

fn reals(values: Values) -> Option<Vec<f64>> {
    if let Values::F64(values) = values { Some(values) } else { None }
}

fn indices(values: Values) -> Option<Vec<u32>> {
    if let Values::U32(values) = values { Some(values) } else { None }
}

impl SavedSection {
    /// Nothing yet.
    pub(crate) fn new(section: SectionId) -> Self {
        Self { name: section.name, version: section.version, fields: Vec::new() }
    }

    /// Adds a field.
    pub(crate) fn with(mut self, name: &'static str, field: Field) -> Self {
        self.fields.push((name, field));
        self
    }

    /// Writes the section. All ranks call it together; rank 0 has the sink.
    pub(crate) fn write(
        &self,
        parts: &Parts,
        targets: TargetNumbers<'_>,
        mut sink: Option<&mut (dyn SnapshotSink + '_)>,
    ) {
        let ranks = parts.ranks();
        if let Some(sink) = &mut sink {
            sink.section(self.name, self.version);
        }
        for (name, field) in &self.fields {
            if let Field::Elements(own) = field {
                own.give(parts, name, sink.as_deref_mut());
                continue;
            }
            let mut begin = |shape: &[usize], kind| {
                if let Some(sink) = &mut sink {
                    sink.dataset(name, shape, kind);
                }
            };
            match field {
                Field::Number(_) => begin(&[1], ValueKind::F64),
                Field::Count(_) => begin(&[1], ValueKind::U64),
                Field::Vectors(_) => begin(&[parts.partition().vertex_count(), 3], ValueKind::F64),
                Field::Vertices(1, _) => begin(&[parts.partition().vertex_count()], ValueKind::F64),
                Field::Vertices(width, _) => begin(&[parts.partition().vertex_count(), *width], ValueKind::F64),
                Field::Nodes(_, None) => begin(&[0, 3], ValueKind::F64),
                Field::Nodes(_, Some((_, bodies))) => {
                    begin(&[parts.partition().vertex_count() + bodies.len(), 3], ValueKind::F64);
                }
                Field::Targets(1, values) => begin(&[targets.all], values.kind()),
                Field::Targets(width, values) => begin(&[targets.all, *width], values.kind()),
                Field::Numbers(width, values) => begin(&[values.len() / width, *width], ValueKind::U32),
                Field::Elements(_) => {}
            }
            let mut rows = |values: Values| {
                if let Some(sink) = &mut sink {
                    sink.rows(values);
                }
            };
            let of_targets = || Rows::of_targets(targets);
            match field {
                Field::Number(value) => rows(Values::F64(vec![*value])),
                Field::Count(value) => rows(Values::U64(vec![*value])),
                Field::Vertices(width, own) => {
                    Rows::of_vertices(parts).give(ranks, *width, own, |values| rows(Values::F64(values)));
                }
                Field::Vectors(own) => {
                    let flat: &[f64] = bytemuck::cast_slice(own);
                    Rows::of_vertices(parts).give(ranks, 3, flat, |values| rows(Values::F64(values)));
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
                Field::Elements(_) => {}
            }
        }
    }

    /// Reads into the fields, which say what is expected, and have the sizes that this rank needs. All ranks call it together;
    /// rank 0 has the source.
    ///
    /// # Errors
    /// The same on all ranks: the section is of another scene or version, or cannot be read.
    pub(crate) fn read(
        &mut self,
        parts: &Parts,
        targets: TargetNumbers<'_>,
        mut source: Option<&mut (dyn SnapshotSource + '_)>,
    ) -> Result<(), SnapshotError> {
        let (ranks, section) = (parts.ranks(), self.name);
        let error = |what: String| SnapshotError { section: section.to_owned(), what };
        let version = read_and_broadcast(ranks, || {
            let version = source.as_deref().and_then(|source| source.version(section));
            version.ok_or_else(|| error("it is missing".into()))
        })?;
        if version != self.version {
            return Err(error(format!("it has version {version}, this program reads {}", self.version)));
        }
        for (name, field) in &mut self.fields {
            let source = source.as_deref_mut();
            let mut reader = Reader { parts, section, name, source, rows: 0 };
            reader.count_rows()?;
            reader.read(field, &Rows::of_targets(targets))?;
        }
        Ok(())
    }

    /// Hands the rows of own vertices and targets to the ranks that own them in `new`; `pinned` are the own targets. All ranks call
    /// it together.
    pub(crate) fn migrate(&mut self, old: &Parts, new: &Parts, pinned: &[OwnTarget]) {
        let ranks = old.ranks();
        let first = old.rank_starts()[ranks.rank()];
        let own = first..old.rank_starts()[ranks.rank() + 1];
        let run = |rank: usize| {
            let (start, end) = (new.rank_starts()[rank].max(own.start), new.rank_starts()[rank + 1].min(own.end));
            (start.min(end) - first.min(end)) as usize..(end - first.min(end)) as usize
        };
        for (_, field) in &mut self.fields {
            match field {
                Field::Vectors(values) => {
                    let rows = |rank| values[run(rank)].to_vec();
                    *values = ranks.all_to_all_v((0..ranks.count()).map(rows).collect()).concat();
                }
                Field::Vertices(width, values) => {
                    let rows = |rank| values[run(rank).start * *width..run(rank).end * *width].to_vec();
                    *values = ranks.all_to_all_v((0..ranks.count()).map(rows).collect()).concat();
                }
                Field::Nodes(_, Some((values, _))) => {
                    let rows = |rank| values[run(rank)].to_vec();
                    *values = ranks.all_to_all_v((0..ranks.count()).map(rows).collect()).concat();
                }
                Field::Targets(width, Values::F64(values)) => *values = moved_targets(new, pinned, *width, values),
                Field::Targets(width, Values::U32(values)) => *values = moved_targets(new, pinned, *width, values),
                Field::Targets(width, Values::U8(values)) => *values = moved_targets(new, pinned, *width, values),
                Field::Elements(own) => own.set(ranks.all_gather_v(own.rows()).concat()),
                Field::Targets(..)
                | Field::Number(_)
                | Field::Count(_)
                | Field::Nodes(_, None)
                | Field::Numbers(..) => {}
            }
        }
    }

    /// A number of this name.
    ///
    /// # Panics
    /// The section has no such field, which is a fault of the program; so in the functions below that return no `Option`.
    pub(crate) fn number(&self, name: &str) -> f64 {
        match self.field(name) {
            Some(Field::Number(value)) => *value,
            _ => self.lacks(name),
        }
    }

    /// A count of this name.
    pub(crate) fn count(&self, name: &str) -> u64 {
        match self.field(name) {
            Some(Field::Count(value)) => *value,
            _ => self.lacks(name),
        }
    }

    /// The numbers of own vertices in the field of this name.
    pub(crate) fn vertices(&self, name: &str) -> &[f64] {
        match self.field(name) {
            Some(Field::Vertices(_, values)) => values,
            _ => self.lacks(name),
        }
    }

    /// The vectors of own vertices in the field of this name.
    pub(crate) fn vectors(&self, name: &str) -> &[Vec3] {
        match self.field(name) {
            Some(Field::Vectors(values)) => values,
            _ => self.lacks(name),
        }
    }

    /// The values of own targets in the field of this name.
    pub(crate) fn targets(&self, name: &str) -> &Values {
        match self.field(name) {
            Some(Field::Targets(_, values)) => values,
            _ => self.lacks(name),
        }
    }

    /// The rows of node numbers in the field of this name.
    pub(crate) fn numbers(&self, name: &str) -> &[u32] {
        match self.field(name) {
            Some(Field::Numbers(_, values)) => values,
            _ => self.lacks(name),
        }
    }

    /// The elements in the field of this name.
    pub(crate) fn elements(&self, name: &str) -> Option<&ElementRows> {
        match self.field(name) {
            Some(Field::Elements(rows)) => Some(rows),
            _ => None,
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

    fn lacks(&self, name: &str) -> ! {
        panic!("section `{}` was declared without a field `{name}` of this kind", self.name)
    }
}

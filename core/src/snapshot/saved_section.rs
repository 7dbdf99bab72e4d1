//! State that time has changed, as the ranks have it: arrays over own vertices, over own pin targets, and values that all ranks
//! know. It becomes a snapshot, in which nothing tells how many ranks there were, and it moves when vertices change their
//! rank.

use bytemuck::cast_slice;

use crate::Vec3;
use crate::parallel::parts::Parts;
use crate::scene::{FARTHEST, is_possible};
use crate::snapshot::elements::{ElementRows, elements_of, flat};
use crate::snapshot::rows::{
    OwnTarget, Rows, TargetNumbers, moved_targets, own_order, read_and_broadcast, scene_order, sorted_elements,
};
use crate::snapshot::{SnapshotError, SnapshotSink, SnapshotSource, Value, Values, of_any_kind};

/// A section of a snapshot, and hence of a checkpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SectionId {
    /// Its name; several effects may share one.
    pub name: &'static str,
    /// Version of its layout.
    pub version: u32,
}

/// State of one part of the solver on this rank.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SavedSection {
    /// The section of a snapshot.
    pub(crate) id: SectionId,
    /// Its fields with their names, in a fixed order.
    fields: Vec<(&'static str, Field)>,
}

/// An array of a section.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Field {
    layout: Layout,
    /// Values in a row.
    width: usize,
    /// Values of this rank, row after row.
    values: Values,
}

/// Rows of an array.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Layout {
    /// One, which all ranks know.
    Single,
    /// One for each own vertex, ascending.
    Vertices,
    /// The same, of vectors that are possible.
    Vectors,
    /// The same, and one for each of `points` points of bodies, which all ranks know; or none at all.
    Nodes { points: usize, given: bool },
    /// One for each own pin target.
    Targets,
    /// Any number, of nodes by their numbers in the scene; all ranks know them.
    Numbers,
    /// One for each element, its vertices by their numbers in the scene before its values: of elements that count here when they are
    /// written, of those of all ranks when they were read or have moved.
    Elements,
}

impl Layout {
    /// The rows of this rank, of an array that has `count` if any number is right.
    fn rows(self, parts: &Parts, targets: TargetNumbers<'_>, count: usize) -> Rows {
        match self {
            Self::Single => Rows::known(1),
            Self::Vertices | Self::Vectors => Rows::of_vertices(parts, 0),
            Self::Nodes { points, given: true } => Rows::of_vertices(parts, points),
            Self::Nodes { given: false, .. } => Rows::known(0),
            Self::Targets => Rows::of_targets(targets),
            Self::Numbers | Self::Elements => Rows::known(count),
        }
    }
}

impl Field {
    fn new<T: Value>(layout: Layout, width: usize, values: Vec<T>) -> Self {
        Self { layout, width, values: T::wrap(values) }
    }

    /// A number or a count that all ranks know.
    pub(crate) fn single<T: Value>(value: T) -> Self {
        Self::new(Layout::Single, 1, vec![value])
    }

    /// `width` numbers for each own vertex, ascending.
    pub(crate) fn vertices(width: usize, values: Vec<f64>) -> Self {
        Self::new(Layout::Vertices, width, values)
    }

    /// A finite vector for each own vertex, ascending.
    pub(crate) fn vectors(vectors: &[Vec3]) -> Self {
        Self::new(Layout::Vectors, 3, cast_slice::<_, f64>(vectors).to_vec())
    }

    /// A vector for each own vertex, ascending, and for each of `points` points of bodies, which all ranks know; or none at all.
    pub(crate) fn nodes(points: usize, vectors: Option<[&[Vec3]; 2]>) -> Self {
        let flat = vectors.map_or_else(Vec::new, |both| cast_slice(&both.concat()).to_vec());
        Self::new::<f64>(Layout::Nodes { points, given: vectors.is_some() }, 3, flat)
    }

    /// `width` values for each own pin target.
    pub(crate) fn targets<T: Value>(width: usize, values: Vec<T>) -> Self {
        Self::new(Layout::Targets, width, values)
    }

    /// Rows of `width` nodes by their numbers in the scene, which all ranks know.
    pub(crate) fn numbers(width: usize, numbers: Vec<u32>) -> Self {
        Self::new(Layout::Numbers, width, numbers)
    }

    /// Elements that count on this rank, by their vertices in the scene.
    pub(crate) fn elements(rows: &ElementRows) -> Self {
        Self::new(Layout::Elements, 6, flat(rows))
    }

    /// Values as a snapshot has them, without numbers that a partition enters; `None` if they are the same.
    fn written(&self, parts: &Parts) -> Option<Values> {
        match (self.layout, &self.values) {
            (Layout::Numbers, Values::U32(numbers)) => Some(Values::U32(own_order(parts, numbers))),
            (Layout::Elements, Values::F64(rows)) => {
                Some(Values::F64(flat(&sorted_elements(parts, elements_of(rows)))))
            }
            _ => None,
        }
    }

    fn write(
        &self,
        name: &str,
        parts: &Parts,
        targets: TargetNumbers<'_>,
        mut sink: Option<&mut (dyn SnapshotSink + '_)>,
    ) {
        let written = self.written(parts);
        let values = written.as_ref().unwrap_or(&self.values);
        let rows = self.layout.rows(parts, targets, values.len() / self.width);
        let is_flat = self.width == 1 && self.layout != Layout::Numbers;
        let shape = [rows.count(), self.width];
        if let Some(sink) = &mut sink {
            sink.dataset(name, if is_flat { &shape[..1] } else { &shape }, values.kind());
        }
        of_any_kind!(values, own => rows.give(parts.ranks(), self.width, own, |rows| {
            if let Some(sink) = &mut sink {
                sink.rows(Value::wrap(rows));
            }
        }));
    }

    /// Hands the rows of own vertices and targets to the ranks that own them in `new`.
    fn migrate(&mut self, old: &Parts, new: &Parts, pinned: &[OwnTarget]) {
        let (ranks, width, own) = (old.ranks(), self.width, old.own().len());
        let first = old.rank_starts()[ranks.rank()];
        let within = |vertex: u32| (vertex.clamp(first, first + own as u32) - first) as usize * width;
        let starts = new.rank_starts();
        of_any_kind!(&mut self.values, values => match self.layout {
            Layout::Vertices | Layout::Vectors | Layout::Nodes { given: true, .. } => {
                let known = values.split_off(own * width);
                let rows = |ends: &[u32]| values[within(ends[0])..within(ends[1])].to_vec();
                *values = ranks.all_to_all_v(starts.windows(2).map(rows).collect()).concat();
                values.extend(known);
            }
            Layout::Targets => *values = moved_targets(new, pinned, width, values),
            Layout::Elements => *values = ranks.all_gather_v(values).concat(),
            Layout::Single | Layout::Numbers | Layout::Nodes { given: false, .. } => {}
        });
    }
}

/// Reads the fields of a section.
struct Reader<'a, 's> {
    parts: &'a Parts,
    targets: TargetNumbers<'a>,
    section: &'static str,
    /// On rank 0.
    source: Option<&'a mut (dyn SnapshotSource + 's)>,
}

impl Reader<'_, '_> {
    fn error(&self, what: String) -> SnapshotError {
        SnapshotError { section: self.section.to_owned(), what }
    }

    fn read(&mut self, name: &str, field: &mut Field) -> Result<(), SnapshotError> {
        let ranks = self.parts.ranks();
        let found = read_and_broadcast(ranks, || {
            let source = self.source.as_deref().ok_or_else(|| self.error("it is missing".into()))?;
            source.rows_of(self.section, name)
        })?;
        if let Layout::Nodes { given, .. } = &mut field.layout {
            *given = found > 0;
        }
        let rows = field.layout.rows(self.parts, self.targets, found);
        if rows.count() != found {
            return Err(self.error(format!("`{name}` has {found} rows, not {}", rows.count())));
        }
        of_any_kind!(&mut field.values, values => *values = self.values(name, field.width, &rows)?);
        self.check(name, field, &rows)
    }

    /// The values of this rank's rows.
    fn values<T: Value>(&mut self, name: &str, width: usize, rows: &Rows) -> Result<Vec<T>, SnapshotError> {
        let (section, ranks) = (self.section, self.parts.ranks());
        let other = self.error(format!("`{name}` is of another type or width"));
        rows.take(ranks, width, |range| {
            let source = self.source.as_deref_mut().ok_or_else(|| other.clone())?;
            let count = range.len() * width;
            let values = source.values(section, name, range)?;
            T::of(&values).filter(|values| values.len() == count).map(<[T]>::to_vec).ok_or_else(|| other.clone())
        })
    }

    /// Makes sure of what was read, and brings it into the numbers of the scene.
    fn check(&self, name: &str, Field { layout, values, .. }: &mut Field, rows: &Rows) -> Result<(), SnapshotError> {
        match (*layout, values) {
            (Layout::Vectors | Layout::Nodes { given: true, .. }, Values::F64(values)) => {
                let vectors: &[Vec3] = cast_slice(values);
                let wrong = rows.first_wrong(self.parts.ranks(), |place| !is_possible(&vectors[place]));
                let error = |row| self.error(format!("row {row} of `{name}` is not finite, or beyond {FARTHEST:e}"));
                wrong.map_or(Ok(()), |row| Err(error(row)))
            }
            (Layout::Numbers, Values::U32(numbers)) => {
                let wrong = || self.error(format!("`{name}` names a vertex that does not exist"));
                *numbers = scene_order(self.parts, numbers).ok_or_else(wrong)?;
                Ok(())
            }
            (Layout::Elements, Values::F64(values)) => {
                let is_finite = values.iter().all(|value| value.is_finite());
                let (nodes, kept): (Vec<[u32; 4]>, Vec<[f64; 2]>) = elements_of(values).into_iter().unzip();
                let wrong = || self.error(format!("`{name}` has a vertex that does not exist or is not finite"));
                let found = scene_order(self.parts, nodes.as_flattened()).filter(|_| is_finite).ok_or_else(wrong)?;
                *values = flat(&found.as_chunks().0.iter().copied().zip(kept).collect());
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl SavedSection {
    /// Nothing yet.
    pub(crate) fn new(id: SectionId) -> Self {
        Self { id, fields: Vec::new() }
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
        if let Some(sink) = &mut sink {
            sink.section(self.id.name, self.id.version);
        }
        self.fields.iter().for_each(|(name, field)| field.write(name, parts, targets, sink.as_deref_mut()));
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
        source: Option<&mut (dyn SnapshotSource + '_)>,
    ) -> Result<(), SnapshotError> {
        let SectionId { name: section, version } = self.id;
        let mut reader = Reader { parts, targets, section, source };
        let found = read_and_broadcast(parts.ranks(), || {
            let found = reader.source.as_deref().and_then(|source| source.version(section));
            found.ok_or_else(|| reader.error("it is missing".into()))
        })?;
        if found != version {
            return Err(reader.error(format!("it has version {found}, this program reads {version}")));
        }
        self.fields.iter_mut().try_for_each(|(name, field)| reader.read(name, field))
    }

    /// Hands the rows of own vertices and targets to the ranks that own them in `new`; `pinned` are the own targets. All ranks call
    /// it together.
    pub(crate) fn migrate(&mut self, old: &Parts, new: &Parts, pinned: &[OwnTarget]) {
        self.fields.iter_mut().for_each(|(_, field)| field.migrate(old, new, pinned));
    }

    /// The values of this rank in the field of this name.
    ///
    /// # Panics
    /// The section has no such field, which is a fault of the program; so in the functions below.
    pub(crate) fn values<T: Value>(&self, name: &str) -> &[T] {
        T::of(&self.field(name).values).unwrap_or_else(|| self.lacks(name))
    }

    /// Whether there is a field of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.fields.iter().any(|(known, _)| *known == name)
    }

    /// The one value of the field of this name.
    pub(crate) fn single<T: Value>(&self, name: &str) -> T {
        self.values(name)[0]
    }

    /// The vectors of own vertices in the field of this name.
    pub(crate) fn vectors(&self, name: &str) -> &[Vec3] {
        cast_slice(self.values::<f64>(name))
    }

    /// The vectors of own vertices and of points of bodies in the field of this name, if there are any.
    pub(crate) fn nodes(&self, name: &str) -> Option<[&[Vec3]; 2]> {
        let Layout::Nodes { points, given } = self.field(name).layout else { self.lacks(name) };
        let vectors = self.vectors(name);
        given.then(|| vectors.split_at(vectors.len() - points).into())
    }

    /// The elements in the field of this name.
    pub(crate) fn elements(&self, name: &str) -> ElementRows {
        elements_of(self.values(name))
    }

    fn field(&self, name: &str) -> &Field {
        self.fields.iter().find(|(known, _)| *known == name).map_or_else(|| self.lacks(name), |(_, field)| field)
    }

    fn lacks(&self, name: &str) -> ! {
        panic!("section `{}` was declared without a field `{name}` of this kind", self.id.name)
    }
}

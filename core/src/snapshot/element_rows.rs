//! What time has changed in elements of cloth, such as hinges, keyed by the vertices that they join: it needs no numbering of the
//! elements, and every rank finds those that it has.

use crate::parallel::parts::Parts;
use crate::snapshot::{SnapshotSink, ValueKind, Values};

/// For each element the numbers of its vertices, and values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ElementRows {
    nodes: usize,
    width: usize,
    /// Vertices, then values; row after row.
    rows: Vec<f64>,
}

impl ElementRows {
    /// No rows yet, of elements with so many vertices and values.
    pub fn new(nodes: usize, values: usize) -> Self {
        Self { nodes, width: nodes + values, rows: Vec::new() }
    }

    /// Adds an element.
    ///
    /// # Panics
    /// It has another number of vertices or values.
    pub fn push(&mut self, nodes: &[u32], values: &[f64]) {
        assert_eq!((nodes.len(), nodes.len() + values.len()), (self.nodes, self.width), "rows are of one kind");
        self.rows.extend(nodes.iter().map(|n| f64::from(*n)).chain(values.iter().copied()));
    }

    /// All elements: their vertices, and values.
    pub fn iter(&self) -> impl Iterator<Item = (Vec<u32>, &[f64])> {
        self.rows.chunks_exact(self.width.max(1)).map(|row| {
            let (nodes, values) = row.split_at(self.nodes);
            (nodes.iter().map(|n| *n as u32).collect(), values)
        })
    }

    /// The same rows with other numbers of vertices, without those that have a vertex without a number.
    pub(crate) fn renumbered(&self, number: impl Fn(u32) -> Option<u32>) -> Self {
        let mut found = Self { rows: Vec::new(), ..*self };
        for (nodes, values) in self.iter() {
            if let Some(nodes) = nodes.into_iter().map(&number).collect::<Option<Vec<u32>>>() {
                found.push(&nodes, values);
            }
        }
        found
    }

    /// Vertices and values of a row.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// All values, row after row.
    pub(super) fn rows(&self) -> &[f64] {
        &self.rows
    }

    /// Puts these rows in the place of all.
    pub(super) fn set(&mut self, rows: Vec<f64>) {
        self.rows = rows;
    }

    /// Gives the rows these vertices.
    pub(super) fn set_nodes(&mut self, nodes: &[u32]) {
        for (row, nodes) in self.rows.chunks_exact_mut(self.width).zip(nodes.chunks_exact(self.nodes)) {
            row.iter_mut().zip(nodes).for_each(|(value, node)| *value = f64::from(*node));
        }
    }

    /// Whether every value is a number.
    pub(super) fn is_finite(&self) -> bool {
        self.rows.iter().all(|value| value.is_finite())
    }

    /// Writes the rows of all ranks in the order of their vertices' own numbers, so that it does not show who had them. All ranks
    /// call it together.
    pub(super) fn give(&self, parts: &Parts, name: &str, sink: Option<&mut (dyn SnapshotSink + '_)>) {
        let own_number = |number: u32| {
            let (garment, own) = parts.own_vertex(parts.local(number)?);
            Some(parts.partition().garments()[garment].start as u32 + own)
        };
        let own = self.renumbered(own_number);
        let gathered = parts.ranks().gather(&own.rows).concat();
        let mut all: Vec<&[f64]> = gathered.chunks_exact(self.width).collect();
        all.sort_unstable_by(|a, b| {
            a[..self.nodes].iter().map(|n| *n as u32).cmp(b[..self.nodes].iter().map(|n| *n as u32))
        });
        if let Some(sink) = sink {
            sink.dataset(name, &[all.len(), self.width], ValueKind::F64);
            sink.rows(Values::F64(all.concat()));
        }
    }
}

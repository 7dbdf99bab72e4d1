//! What time has changed in elements of cloth, such as hinges, keyed by the vertices that they join: it needs no numbering of the
//! elements, and every rank finds those that it has.

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

    /// Vertices of each element, vertices and values together, and all values row after row.
    pub(super) fn into_parts(self) -> (usize, usize, Vec<f64>) {
        (self.nodes, self.width, self.rows)
    }

    /// The inverse of [`ElementRows::into_parts`].
    pub(super) fn from_parts(nodes: usize, width: usize, rows: Vec<f64>) -> Self {
        Self { nodes, width, rows }
    }
}

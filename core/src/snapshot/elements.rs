//! Values of elements that time has changed, by the numbers of their vertices.

use std::collections::BTreeMap;

/// Two numbers for each element of four vertices, as hinges are, by its vertices. The elements need no numbering, and every rank finds
/// its own.
pub(crate) type ElementRows = BTreeMap<[u32; 4], [f64; 2]>;

/// The same elements with other numbers of vertices, without those that have a vertex without a number.
pub(crate) fn renumbered(rows: ElementRows, number: impl Fn(u32) -> Option<u32>) -> ElementRows {
    let one = |(nodes, values): ([u32; 4], _)| {
        let [a, b, c, d] = nodes.map(&number);
        Some(([a?, b?, c?, d?], values))
    };
    rows.into_iter().filter_map(one).collect()
}

/// Elements as rows of numbers.
pub(super) fn flat(elements: &ElementRows) -> Vec<f64> {
    elements.iter().flat_map(|(nodes, values)| nodes.map(f64::from).into_iter().chain(*values)).collect()
}

/// The inverse of [`flat`].
pub(super) fn elements_of(rows: &[f64]) -> ElementRows {
    let (rows, _) = rows.as_chunks::<6>();
    rows.iter().map(|[a, b, c, d, values @ ..]| ([*a, *b, *c, *d].map(|n| n as u32), *values)).collect()
}

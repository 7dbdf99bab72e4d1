//! Marks on some of the vertices, so that what concerns these alone need not look at all.

use std::ops::Range;

/// Vertices that share one set of marks, and that one task works on.
pub(super) const CHUNK: usize = u128::BITS as usize;

/// Marks on the vertices of one chunk: bit i is its vertex i.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Marks {
    /// A body is near.
    pub(super) near: u128,
    /// A contact constrains its velocity, or surfaces pinch it.
    pub(super) constrained: u128,
}

impl Marks {
    /// Whether no vertex is marked.
    pub(super) fn are_none(&self) -> bool {
        self.near | self.constrained == 0
    }
}

/// The place of a chunk's vertex in its marks.
pub(super) fn bit(i: usize) -> u128 {
    1 << i
}

/// The marked vertices of a chunk, ascending.
pub(super) fn marked(mut marks: u128) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let next = (marks != 0).then_some(marks.trailing_zeros() as usize)?;
        marks &= marks - 1;
        Some(next)
    })
}

/// The constrained ones among `vertices`, ascending.
pub(super) fn constrained(marks: &[Marks], vertices: Range<usize>) -> impl Iterator<Item = usize> + '_ {
    let chunks = vertices.start / CHUNK..vertices.end.div_ceil(CHUNK);
    chunks.flat_map(move |c| {
        let first = c * CHUNK;
        let from = u128::MAX << vertices.start.saturating_sub(first);
        let until = u128::MAX >> (CHUNK - (vertices.end - first).min(CHUNK));
        marked(marks[c].constrained & from & until).map(move |i| first + i)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_constrained_vertices_of_any_range_are_found() {
        let is_marked = |vertex: usize| vertex.is_multiple_of(3) || (120..140).contains(&vertex);
        let mut marks = vec![Marks::default(); 3];
        for vertex in (0..3 * CHUNK).filter(|v| is_marked(*v)) {
            marks[vertex / CHUNK].constrained |= bit(vertex % CHUNK);
        }
        for start in 0..=3 * CHUNK {
            for end in start..=3 * CHUNK {
                let found = constrained(&marks, start..end);
                assert!(found.eq((start..end).filter(|v| is_marked(*v))), "{start}..{end}");
            }
        }
    }
}

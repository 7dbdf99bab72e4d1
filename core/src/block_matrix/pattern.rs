//! Which pairs of vertices have a block in the rows of a part.

use std::ops::Range;

use super::Slot;

/// The pairs of a part: each vertex with the higher ones of the part and with all of other parts that an element joins it to,
/// ascending. Local numbers ascend as those of the scene do, so this order, which is that of every sum, depends on the scene
/// alone.
#[derive(Debug, Clone)]
pub(super) struct Pattern {
    /// The part's vertices, in local numbers.
    range: Range<usize>,
    /// First pair of each vertex, and the number of all at the end.
    starts: Vec<u32>,
    /// The other vertex of each pair, in local numbers.
    others: Vec<u32>,
}

/// A pair of vertices.
pub(super) struct Pair {
    /// The vertex whose row it is, counted from the part's first.
    pub(super) vertex: usize,
    /// The other one, in local numbers.
    pub(super) other: usize,
    /// The other one counted from the part's first, if it is of the part.
    pub(super) other_in_part: Option<usize>,
}

impl Pattern {
    /// The pairs of the part with these vertices, of which `elements` visits the elements.
    pub(super) fn new(range: Range<usize>, elements: impl FnOnce(&mut dyn FnMut(&[u32]))) -> Self {
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        elements(&mut |vertices| {
            for (i, a) in vertices.iter().enumerate() {
                pairs.extend(vertices[i + 1..].iter().filter_map(|b| Self::ordered(&range, *a, *b)));
            }
        });
        pairs.sort_unstable();
        pairs.dedup();
        let start = |vertex: usize| pairs.partition_point(|pair| (pair.0 as usize) < range.start + vertex) as u32;
        let starts = (0..=range.len()).map(start).collect();
        Self { starts, others: pairs.iter().map(|pair| pair.1).collect(), range }
    }

    /// The pair as it is stored: in the row of its vertex in the part, of the lower if both are. None if neither is.
    fn ordered(range: &Range<usize>, a: u32, b: u32) -> Option<(u32, u32)> {
        let (low, high) = (a.min(b), a.max(b));
        match [low, high].map(|vertex| range.contains(&(vertex as usize))) {
            _ if low == high => None,
            [true, _] => Some((low, high)),
            [false, true] => Some((high, low)),
            [false, false] => None,
        }
    }

    /// First vertex of the part, in local numbers.
    pub(super) fn first(&self) -> usize {
        self.range.start
    }

    pub(super) fn pair_count(&self) -> usize {
        self.others.len()
    }

    /// All pairs, in the order of their blocks.
    pub(super) fn pairs(&self) -> impl Iterator<Item = Pair> {
        let rows = self.starts.windows(2).enumerate();
        rows.flat_map(move |(vertex, ends)| {
            self.others[ends[0] as usize..ends[1] as usize].iter().map(move |other| {
                let other = *other as usize;
                let other_in_part = self.range.contains(&other).then(|| other - self.range.start);
                Pair { vertex, other, other_in_part }
            })
        })
    }

    /// The place of a pair of local vertices that an element joins.
    pub(super) fn slot(&self, a: u32, b: u32) -> Slot {
        let Some((vertex, other)) = Self::ordered(&self.range, a, b) else { return Slot::ELSEWHERE };
        let row = vertex as usize - self.range.start;
        let (start, end) = (self.starts[row] as usize, self.starts[row + 1] as usize);
        let place = self.others[start..end].binary_search(&other);
        let place = place.unwrap_or_else(|_| panic!("the matrix was made for elements that join {a} and {b}"));
        Slot::new(start + place, vertex == b)
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.starts) + size_of_val(&*self.others)
    }
}

//! Pairs of vertices that have a block in the rows of a part.

use std::ops::Range;

/// The pairs of a part, ascending: those inside the part, each in the row of its lower vertex, and then those with vertices of
/// other parts. Local numbers ascend as those of the scene do, so this order, which is that of every sum, depends on the scene
/// alone.
#[derive(Debug, Clone)]
pub(super) struct Pattern {
    /// The part's vertices, in local numbers.
    range: Range<usize>,
    /// First pair inside the part of each vertex, and the number of all at the end.
    starts: Vec<u32>,
    /// The other vertex of each pair inside the part, counted from the part's first.
    inside: Vec<u16>,
    /// Pairs that reach out: the vertex counted from the part's first, and the other one in local numbers.
    outside: Vec<(u32, u32)>,
}

impl Pattern {
    /// The pairs of the part with these vertices, of which `elements` visits the elements.
    pub(super) fn new(range: Range<usize>, elements: impl FnOnce(&mut dyn FnMut(&[u32]))) -> Self {
        let mut inside: Vec<(u32, u32)> = Vec::new();
        let mut outside: Vec<(u32, u32)> = Vec::new();
        elements(&mut |vertices| {
            for (i, a) in vertices.iter().enumerate() {
                for b in &vertices[i + 1..] {
                    match Self::place(&range, *a, *b) {
                        Place::Inside(low, high) => inside.push((low, high)),
                        Place::Outside(vertex, other) => outside.push((vertex, other)),
                        Place::Elsewhere => {}
                    }
                }
            }
        });
        [&mut inside, &mut outside].into_iter().for_each(|pairs| {
            pairs.sort_unstable();
            pairs.dedup();
        });
        let start = |vertex: usize| inside.partition_point(|pair| (pair.0 as usize) < vertex) as u32;
        let starts = (0..=range.len()).map(start).collect();
        // Parts are small enough for half a word.
        Self { range, starts, inside: inside.iter().map(|pair| pair.1 as u16).collect(), outside }
    }

    /// Returns the place of the block of a pair.
    fn place(range: &Range<usize>, a: u32, b: u32) -> Place {
        let (low, high) = (a.min(b), a.max(b));
        let in_part = |vertex: u32| vertex - range.start as u32;
        match [low, high].map(|vertex| range.contains(&(vertex as usize))) {
            _ if low == high => Place::Elsewhere,
            [true, true] => Place::Inside(in_part(low), in_part(high)),
            [true, false] => Place::Outside(in_part(low), high),
            [false, true] => Place::Outside(in_part(high), low),
            [false, false] => Place::Elsewhere,
        }
    }

    /// The part's vertices, in local numbers.
    pub(super) fn range(&self) -> Range<usize> {
        self.range.clone()
    }

    pub(super) fn pair_count(&self) -> usize {
        self.inside.len() + self.outside.len()
    }

    /// First pair inside the part of each vertex, and the number of all at the end.
    pub(super) fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// The other vertex of each pair inside the part, counted from the part's first.
    pub(super) fn inside(&self) -> &[u16] {
        &self.inside
    }

    /// Pairs that reach out: the vertex counted from the part's first, and the other one in local numbers.
    pub(super) fn outside(&self) -> &[(u32, u32)] {
        &self.outside
    }

    /// Pairs inside the part by vertices counted from its first, in the order of their blocks.
    pub(super) fn inside_pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        let rows = self.starts.windows(2).enumerate();
        rows.flat_map(move |(vertex, ends)| {
            self.inside[ends[0] as usize..ends[1] as usize].iter().map(move |other| (vertex, usize::from(*other)))
        })
    }

    /// The place of a pair of local vertices that an element joins.
    pub(super) fn slot(&self, a: u32, b: u32) -> Slot {
        let (vertex, place) = match Self::place(&self.range, a, b) {
            Place::Inside(low, high) => {
                let (start, end) = (self.starts[low as usize] as usize, self.starts[low as usize + 1] as usize);
                (low, self.inside[start..end].binary_search(&(high as u16)).map(|place| start + place))
            }
            Place::Outside(vertex, other) => {
                let place = self.outside.binary_search(&(vertex, other));
                (vertex, place.map(|place| self.inside.len() + place))
            }
            Place::Elsewhere => return Slot::ELSEWHERE,
        };
        let place = place.unwrap_or_else(|_| panic!("the matrix was made for elements that join {a} and {b}"));
        Slot::new(place, vertex as usize + self.range.start == b as usize)
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.starts) + size_of_val(&*self.inside) + size_of_val(&*self.outside)
    }
}

/// Place of the block of a pair; vertices of the part are counted from its first.
enum Place {
    /// In the row of the lower vertex, with the higher one.
    Inside(u32, u32),
    /// In the row of the vertex in the part, with a local vertex.
    Outside(u32, u32),
    /// With other parts.
    Elsewhere,
}

/// The place of a pair's block in the rows of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot(u32);

impl Slot {
    /// The place of pairs that the part does not have.
    pub(super) const ELSEWHERE: Self = Self(u32::MAX);

    fn new(place: usize, is_transposed: bool) -> Self {
        Self((place as u32) << 1 | u32::from(is_transposed))
    }

    /// Its number among the blocks.
    pub(super) fn place(self) -> usize {
        (self.0 >> 1) as usize
    }

    /// Whether what is stored is the transposed block.
    pub(super) fn is_transposed(self) -> bool {
        self.0 & 1 == 1
    }
}

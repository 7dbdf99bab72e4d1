//! Vertices of a part that a round of Newton's method works on.

use std::ops::{BitAnd, BitOr, BitOrAssign, Range};

use crate::parallel::parts::PART_SIZE;

/// Vertices that are worked on together: neighbours on the cloth, since bisection orders them.
pub const RUN: usize = PART_SIZE / u64::BITS as usize;

/// A set of vertices of a part, in runs of [`RUN`] vertices.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WorkingSet(u64);

impl WorkingSet {
    /// No vertex.
    pub const NONE: Self = Self(0);

    /// All vertices of the part.
    pub const ALL: Self = Self(u64::MAX);

    /// The run of a vertex, counted from the part's first.
    #[inline]
    pub fn of(vertex: usize) -> Self {
        Self(1 << (vertex / RUN))
    }

    /// Whether it has no vertex.
    #[inline]
    pub fn is_empty(self) -> bool {
        self == Self::NONE
    }

    /// Whether it has a vertex of another set of the part.
    #[inline]
    pub fn meets(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Whether it has a vertex, counted from the part's first.
    #[inline]
    pub fn contains(self, vertex: usize) -> bool {
        self.meets(Self::of(vertex))
    }

    /// Its vertices in a part of `count`, as ranges that do not touch each other, ascending.
    #[inline]
    pub fn ranges(self, count: usize) -> impl Iterator<Item = Range<usize>> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let first = left.trailing_zeros();
            let behind = first + (left >> first.min(u64::BITS - 1)).trailing_ones();
            let range = RUN * first as usize..(RUN * behind as usize).min(count);
            if range.is_empty() {
                return None;
            }
            left = if behind < u64::BITS { left >> behind << behind } else { 0 };
            Some(range)
        })
    }
}

impl BitOr for WorkingSet {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for WorkingSet {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl BitAnd for WorkingSet {
    type Output = Self;

    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_the_runs_of_the_vertices_that_were_put_in() {
        let set =
            |vertices: &[usize]| vertices.iter().fold(WorkingSet::NONE, |set, vertex| set | WorkingSet::of(*vertex));
        let ranges = |set: WorkingSet, count: usize| set.ranges(count).collect::<Vec<_>>();
        assert_eq!(RUN, 8);
        assert_eq!(ranges(WorkingSet::NONE, 512), []);
        assert_eq!(ranges(WorkingSet::ALL, 512), [0..512]);
        assert_eq!(ranges(WorkingSet::ALL, 45), [0..45]);
        assert_eq!(ranges(set(&[3, 9, 30, 511]), 512), [0..16, 24..32, 504..512]);
        assert_eq!(ranges(set(&[41]), 45), [40..45]);
        for vertex in 0..512 {
            assert!(set(&[vertex]).contains(vertex) && !set(&[vertex]).contains((vertex + 8) % 512));
        }
    }
}

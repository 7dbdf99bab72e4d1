//! Work on all own parts in parallel, each with exclusive access to its own slice of every array. Allocates nothing.

use crate::parallel::parts::Parts;

/// Arrays that can be cut at a part border.
pub trait Split: Sized + Send {
    /// Cuts after `vertices` vertices, `blocks` blocks of sums and `parts` parts.
    fn split(self, vertices: usize, blocks: usize, parts: usize) -> (Self, Self);
}

/// An array with one entry per vertex.
pub struct PerVertex<'a, T>(pub &'a mut [T]);

/// An array with one entry per block of sums.
pub(crate) struct PerBlock<'a, T>(pub &'a mut [T]);

/// An array with one entry per part.
pub struct PerPart<'a, T>(pub &'a mut [T]);

impl<T: Send> Split for PerVertex<'_, T> {
    fn split(self, vertices: usize, _: usize, _: usize) -> (Self, Self) {
        let (a, b) = self.0.split_at_mut(vertices);
        (Self(a), Self(b))
    }
}

impl<T: Send> Split for PerBlock<'_, T> {
    fn split(self, _: usize, blocks: usize, _: usize) -> (Self, Self) {
        let (a, b) = self.0.split_at_mut(blocks);
        (Self(a), Self(b))
    }
}

impl<T: Send> Split for PerPart<'_, T> {
    fn split(self, _: usize, _: usize, parts: usize) -> (Self, Self) {
        let (a, b) = self.0.split_at_mut(parts);
        (Self(a), Self(b))
    }
}

macro_rules! split_tuple {
    ($($name:ident $index:tt),+) => {
        impl<$($name: Split),+> Split for ($($name,)+) {
            fn split(self, vertices: usize, blocks: usize, parts: usize) -> (Self, Self) {
                let halves = ($(self.$index.split(vertices, blocks, parts),)+);
                (($(halves.$index.0,)+), ($(halves.$index.1,)+))
            }
        }
    };
}
split_tuple!(A 0, B 1);
split_tuple!(A 0, B 1, C 2);
split_tuple!(A 0, B 1, C 2, D 3);
split_tuple!(A 0, B 1, C 2, D 3, E 4);

impl Parts {
    /// Calls `work(part, slices of that part)` for every part, in parallel.
    pub fn for_each<S: Split>(&self, slices: S, work: &(impl Fn(usize, S) + Sync)) {
        if self.count() > 0 {
            self.recurse(0, self.count(), slices, work);
        }
    }

    fn recurse<S: Split>(&self, from: usize, to: usize, slices: S, work: &(impl Fn(usize, S) + Sync)) {
        if to - from == 1 {
            work(from, slices);
            return;
        }
        let middle = from.midpoint(to);
        let vertices = self.ranges()[middle].start - self.ranges()[from].start;
        let blocks = self.block_starts()[middle] - self.block_starts()[from];
        let (low, high) = slices.split(vertices, blocks, middle - from);
        rayon::join(|| self.recurse(from, middle, low, work), || self.recurse(middle, to, high, work));
    }
}

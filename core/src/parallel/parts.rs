//! The split of the vertices into parts by recursive bisection of the rest positions.
//!
//! Vertices are stored in part order; the same bisection goes on inside a part, so that neighbours on the cloth are
//! neighbours in memory.

use std::ops::Range;

use crate::Vec3;
use crate::parallel::sum::SUM_BLOCK;

/// Largest number of vertices of a part. Small enough for one part's vectors to stay in a core's cache, large enough for
/// the springs that cross a border (and are evaluated on both sides) to be few: 5 % of all at this size.
pub const PART_SIZE: usize = 2048;

/// Number of vertices at which the bisection stops ordering.
const LEAF_SIZE: usize = 8;

/// The parts, and the maps between the solver's order and the garments' own.
#[derive(Debug, Clone)]
pub struct Parts {
    ranges: Vec<Range<usize>>,
    block_starts: Vec<usize>,
    garments: Vec<Range<usize>>,
    /// Solver index of each vertex, garment after garment in the garments' own order.
    solver_index: Vec<u32>,
    /// The inverse: own index (counted over all garments) of each solver index.
    own_index: Vec<u32>,
}

impl Parts {
    /// Splits the garments with these rest positions; no part holds vertices of two garments.
    pub fn new(garments: &[&[Vec3]]) -> Self {
        let mut parts = Self {
            ranges: Vec::new(),
            block_starts: vec![0],
            garments: Vec::new(),
            solver_index: Vec::new(),
            own_index: Vec::new(),
        };
        for positions in garments {
            let first = parts.own_index.len();
            let mut order: Vec<u32> = (0..positions.len() as u32).collect();
            bisect(positions, &mut order, first, &mut parts.ranges);
            parts.own_index.extend(order.iter().map(|own| own + first as u32));
            parts.garments.push(first..parts.own_index.len());
        }
        parts.solver_index = vec![0; parts.own_index.len()];
        for (solver, own) in parts.own_index.iter().enumerate() {
            parts.solver_index[*own as usize] = solver as u32;
        }
        for range in &parts.ranges {
            let blocks = range.len().div_ceil(SUM_BLOCK);
            parts.block_starts.push(parts.block_starts[parts.block_starts.len() - 1] + blocks);
        }
        parts
    }

    /// Vertices of each part in solver order.
    pub fn ranges(&self) -> &[Range<usize>] {
        &self.ranges
    }

    /// Number of parts.
    pub fn count(&self) -> usize {
        self.ranges.len()
    }

    /// Number of vertices of all garments.
    pub fn vertex_count(&self) -> usize {
        self.own_index.len()
    }

    /// First block of sums of each part, and the number of all blocks at the end.
    pub fn block_starts(&self) -> &[usize] {
        &self.block_starts
    }

    /// Vertices of a garment in solver order.
    pub fn garment(&self, garment: usize) -> Range<usize> {
        self.garments[garment].clone()
    }

    /// Solver index of a garment's vertex.
    pub fn solver_index(&self, garment: usize, vertex: u32) -> usize {
        self.solver_index[self.garments[garment].start + vertex as usize] as usize
    }

    /// Garment and own vertex number of a solver index.
    pub fn own_vertex(&self, solver: usize) -> (usize, u32) {
        let garment = self.garments.partition_point(|range| range.end <= solver);
        (garment, self.own_index[solver] - self.garments[garment].start as u32)
    }

    /// Own index, counted over all garments, of a solver index.
    pub fn own_index(&self, solver: usize) -> usize {
        self.own_index[solver] as usize
    }

    /// Solver index of an own index counted over all garments.
    pub fn solver_of(&self, own: usize) -> usize {
        self.solver_index[own] as usize
    }

    /// Values in solver order, one after the other in the garments' own order.
    pub fn in_own_order<'a, T: Copy>(&'a self, values: &'a [T]) -> impl ExactSizeIterator<Item = T> + 'a {
        self.solver_index.iter().map(|solver| values[*solver as usize])
    }

    /// The inverse of [`Parts::in_own_order`].
    pub fn in_solver_order<'a, T: Copy>(&'a self, values: &'a [T]) -> impl ExactSizeIterator<Item = T> + 'a {
        self.own_index.iter().map(|own| values[*own as usize])
    }

    /// Part that holds a solver index.
    pub fn part_of(&self, solver: usize) -> usize {
        self.ranges.partition_point(|range| range.end <= solver)
    }
}

/// Orders `order` by recursive bisection along the longest side of the bounds; ties go by vertex number. Every piece of at
/// most [`PART_SIZE`] vertices that came from a larger one becomes a part.
fn bisect(positions: &[Vec3], order: &mut [u32], first: usize, ranges: &mut Vec<Range<usize>>) {
    if order.len() <= PART_SIZE {
        ranges.push(first..first + order.len());
        sort_leaves(positions, order);
        return;
    }
    let (low, high) = halve(positions, order);
    let middle = first + low.len();
    bisect(positions, low, first, ranges);
    bisect(positions, high, middle, ranges);
}

/// Goes on bisecting inside a part, for locality.
fn sort_leaves(positions: &[Vec3], order: &mut [u32]) {
    if order.len() <= LEAF_SIZE {
        order.sort_unstable();
        return;
    }
    let (low, high) = halve(positions, order);
    sort_leaves(positions, low);
    sort_leaves(positions, high);
}

/// Two halves of equal size along the longest side of the bounds.
fn halve<'a>(positions: &[Vec3], order: &'a mut [u32]) -> (&'a mut [u32], &'a mut [u32]) {
    let at = |i: &u32| positions[*i as usize];
    let (low, high) = order.iter().fold((at(&order[0]), at(&order[0])), |(l, h), i| (l.inf(&at(i)), h.sup(&at(i))));
    let axis = (high - low).imax();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |a, b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(b)));
    order.split_at_mut(middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_maps_are_inverse_and_parts_cover_every_vertex_once() {
        let sheet = |n: usize| -> Vec<Vec3> {
            (0..n * n).map(|k| Vec3::new((k % n) as f64, 0.1 * (k % 7) as f64, (k / n) as f64)).collect()
        };
        let (a, b) = (sheet(70), sheet(11));
        let parts = Parts::new(&[&a, &b]);
        assert_eq!(parts.vertex_count(), 4900 + 121);
        let mut next = 0;
        for range in parts.ranges() {
            assert_eq!(range.start, next);
            assert!(range.len() <= PART_SIZE);
            next = range.end;
        }
        assert_eq!(next, 5021);
        for (garment, count) in [(0, 4900), (1, 121)] {
            for vertex in 0..count {
                let solver = parts.solver_index(garment, vertex);
                assert_eq!(parts.own_vertex(solver), (garment, vertex));
                assert!(parts.ranges()[parts.part_of(solver)].contains(&solver));
            }
        }
    }
}

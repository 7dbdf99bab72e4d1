//! The symmetric matrix of an implicit step, in blocks of three by three, one for each pair of vertices that an element joins
//! (`docs/theory/linear_solver.md`).
//!
//! It is stored such that a rigid translation feels the diagonal alone, whatever is rounded elsewhere:
//!
//! ```text
//! (A s)_i = D_i s_i + sum_j B_ij (s_i - s_j)        B_ji = B_ijᵀ
//! ```
//!
//! D_i holds what does not depend on neighbours: mass, drag, springs to pins. B_ij holds elements between vertices and is
//! positive for a spring, k e eᵀ; the block of A at (i, j) is -B_ij, that at (i, i) is D_i + sum_j B_ij. A is positive
//! semidefinite where every element is. D is in double precision, B in single; sums and vectors are in double.
//!
//! Rows belong to the parts of the vertices ([`crate::parallel`]). A pair inside a part is stored once; one across a border is
//! stored by both parts, which compute the same block.

pub(crate) mod block;
mod pattern;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;

use nalgebra::Matrix3;

use crate::Vec3;
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::parallel::simd4::Simd4;
use block::{
    Coefficients, OuterFactor, add_symmetric, full_block, full_symmetric, subtract_outer_product, symmetric_product,
};
#[cfg(any(test, feature = "effects"))]
use block::{add, stored_symmetric};
use pattern::Pattern;
pub use pattern::Slot;

/// The rows of a rank's own vertices.
#[derive(Debug, Clone, Default)]
pub struct BlockMatrix {
    parts: Vec<PartBlocks>,
}

/// The rows of a part.
#[derive(Debug, Clone)]
pub struct PartBlocks {
    pattern: Pattern,
    /// D of each vertex, and a value that is read behind the last.
    diagonal: Vec<f64>,
    /// B of each pair, one that is read behind the last, one that nobody reads, to which what is added for pairs of other parts
    /// goes, and one behind that.
    blocks: Vec<[f32; 9]>,
}

/// Calls the second argument with the local vertices of each element that has a vertex in a part.
pub(crate) type VisitElements<'a> = dyn Fn(usize, &mut dyn FnMut(&[u32])) + 'a;

impl BlockMatrix {
    /// A matrix of zeros for the elements of a rank. `elements(part, visit)` gives `visit` the local vertices of each element
    /// that has a vertex in the part, in any order, as often as it likes; an element joins all of its vertices.
    pub fn new(parts: &Parts, elements: &VisitElements<'_>) -> Self {
        let of_part = |part: usize| {
            let pattern = Pattern::new(parts.ranges()[part].clone(), |visit| elements(part, visit));
            PartBlocks {
                diagonal: vec![0.0; 6 * parts.ranges()[part].len() + 1],
                blocks: vec![[0.0; 9]; pattern.pair_count() + 3],
                pattern,
            }
        };
        Self { parts: (0..parts.count()).map(of_part).collect() }
    }

    /// The rows of each own part.
    pub fn parts(&self) -> &[PartBlocks] {
        &self.parts
    }

    /// The rows of each own part, to be filled in.
    pub fn parts_mut(&mut self) -> &mut [PartBlocks] {
        &mut self.parts
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.parts.iter().map(PartBlocks::bytes).sum()
    }
}

impl PartBlocks {
    /// Sets all blocks to zero.
    pub fn clear(&mut self) {
        self.diagonal.fill(0.0);
        self.blocks.fill([0.0; 9]);
    }

    /// Adds a symmetric block to D of a vertex of the part, counted from its first. Units are those of A.
    #[cfg(any(test, feature = "effects"))]
    pub(crate) fn add_diagonal(&mut self, vertex: usize, block: &Matrix3<f64>) {
        let sums = &mut self.diagonal[6 * vertex..6 * vertex + 6];
        sums.iter_mut().zip(stored_symmetric(block)).for_each(|(sum, value)| *sum += value);
    }

    /// Adds a multiple of the identity, as a mass is, to D of a vertex of the part, counted from its first.
    pub fn add_scalar(&mut self, vertex: usize, value: f64) {
        self.diagonal[6 * vertex..6 * vertex + 3].iter_mut().for_each(|sum| *sum += value);
    }

    /// The place of the block of a pair of local vertices, which are of one element. What is added for a pair without a vertex
    /// in the part is not kept: its own parts have it.
    pub fn slot(&self, a: u32, b: u32) -> Slot {
        self.pattern.slot(a, b)
    }

    /// The places of the blocks of all pairs of an element: (0, 1), (0, 2), ... (1, 2), ...
    pub fn slots(&self, vertices: &[u32]) -> impl Iterator<Item = Slot> {
        let pairs = vertices.iter().enumerate().flat_map(|(n, a)| vertices[n + 1..].iter().map(|b| (*a, *b)));
        pairs.map(|(a, b)| self.slot(a, b))
    }

    /// Adds to B_ab, and thereby to B_ba. Once for each part that has the pair.
    #[cfg(any(test, feature = "effects"))]
    #[inline]
    pub(crate) fn add_coupling(&mut self, slot: Slot, block: &Matrix3<f64>) {
        let sums = self.block(slot);
        if slot.is_transposed() {
            add(sums, |row, column| block[(column, row)]);
        } else {
            add(sums, |row, column| block[(row, column)]);
        }
    }

    /// Adds what a spring along the unit vector `e` has: `along` e eᵀ + `across` (1 - e eᵀ). Once for each part that has the
    /// pair.
    #[inline]
    pub fn add_spring(&mut self, slot: Slot, e: &Vec3, along: f64, across: f64) {
        let (across_all, e) = (Simd4::new([across, across, across, 0.0]), Simd4::from(e));
        let along = e * (along - across);
        add_symmetric(self.block(slot), along.mul_add(e, across_all), along.component_mul(e.turned()));
    }

    /// Adds g gᵀ over the vertices of an element whose gradients g have the sum zero, as those of an angle or of a length
    /// have: B_ab gets -g_a g_bᵀ, of components in single precision. `slots` are those of [`PartBlocks::slots`].
    #[inline]
    pub fn add_outer<const VERTICES: usize, const PAIRS: usize>(
        &mut self,
        slots: &[Slot; PAIRS],
        gradients: &[Simd4; VERTICES],
    ) {
        const { assert!(PAIRS * 2 == VERTICES * (VERTICES - 1), "each pair has a slot") };
        let factors = gradients.map(OuterFactor::new);
        let pairs = (0..VERTICES).flat_map(|a| (a + 1..VERTICES).map(move |b| (a, b)));
        for (slot, (a, b)) in slots.iter().zip(pairs) {
            let (a, b) = if slot.is_transposed() { (b, a) } else { (a, b) };
            subtract_outer_product(self.block(*slot), &factors[a], &factors[b]);
        }
    }

    #[inline]
    fn block(&mut self, slot: Slot) -> &mut [f32; 9] {
        let unread = self.unread();
        &mut self.blocks[slot.place().min(unread)]
    }

    /// The block that pairs of other parts share, which no product reads.
    #[inline]
    fn unread(&self) -> usize {
        self.blocks.len() - 2
    }

    /// `q = A s` of the part's rows; `s` are those of all local vertices, `q` the part's own.
    pub fn multiply(&self, s: &[Vec3], q: &mut [Vec3]) {
        let (mut own, mut product) = ([Simd4::ZERO; PART_SIZE], [Simd4::ZERO; PART_SIZE]);
        let own = Simd4::copy(&s[self.pattern.range()], &mut own);
        self.product(own, |other| Simd4::from(&s[other]), &mut product[..own.len()]);
        q.iter_mut().zip(product).for_each(|(q, product)| *q = product.into());
    }

    /// The same with padded vectors.
    pub(crate) fn multiply_padded(&self, s: &[Simd4], q: &mut [Simd4]) {
        self.product(&s[self.pattern.range()], |other| s[other], q);
    }

    /// `q = A s`, `s` and `q` the part's own; `at` has s of any local vertex.
    #[inline(always)]
    fn product(&self, s: &[Simd4], at: impl Fn(usize) -> Simd4, q: &mut [Simd4]) {
        let q = &mut q[..s.len()];
        for ((q, s), block) in q.iter_mut().zip(s).zip(self.diagonal.windows(7).step_by(6)) {
            *q = symmetric_product(block, *s);
        }
        let (blocks, inside) = (self.blocks.as_flattened(), self.pattern.inside());
        for (vertex, ends) in self.pattern.starts().windows(2).enumerate() {
            let (start, end) = (ends[0] as usize, ends[1] as usize);
            let (own, mut sum) = (s[vertex], q[vertex]);
            let row = blocks[9 * start..9 * end + 9].windows(12).step_by(9);
            for (other, block) in inside[start..end].iter().zip(row) {
                let other = usize::from(*other);
                let u = own - s[other];
                let block = Coefficients::of(block);
                sum += block.times(u);
                q[other] -= block.transposed_times(u);
            }
            q[vertex] = sum;
        }
        let outside = blocks[9 * inside.len()..].windows(12).step_by(9);
        for ((vertex, other), block) in self.pattern.outside().iter().zip(outside) {
            let vertex = *vertex as usize;
            q[vertex] += Coefficients::of(block).times(s[vertex] - at(*other as usize));
        }
    }

    /// D of the part's vertices.
    pub(crate) fn own_diagonal(&self) -> impl Iterator<Item = Matrix3<f64>> {
        self.diagonal.chunks_exact(6).map(full_symmetric)
    }

    /// Pairs inside the part, by vertices counted from its first.
    pub(crate) fn inside_pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        self.pattern.inside_pairs()
    }

    /// B of the pairs inside the part.
    pub(crate) fn inside_blocks(&self) -> impl Iterator<Item = Matrix3<f64>> {
        self.blocks[..self.pattern.inside().len()].iter().map(full_block)
    }

    /// Pairs that reach out: the vertex counted from the part's first, and the other one in local numbers.
    pub(crate) fn outside_pairs(&self) -> &[(u32, u32)] {
        self.pattern.outside()
    }

    /// B of the pairs that reach out.
    pub(crate) fn outside_blocks(&self) -> impl Iterator<Item = Matrix3<f64>> {
        self.blocks[self.pattern.inside().len()..].iter().map(full_block)
    }

    /// The blocks of A on the diagonal of the part's vertices: D_i + sum_j B_ij.
    pub(crate) fn diagonal_blocks(&self) -> Vec<Matrix3<f64>> {
        let mut sums: Vec<Matrix3<f64>> = self.own_diagonal().collect();
        for ((vertex, other), block) in self.inside_pairs().zip(self.inside_blocks()) {
            sums[vertex] += block;
            sums[other] += block.transpose();
        }
        for ((vertex, _), block) in self.outside_pairs().iter().zip(self.outside_blocks()) {
            sums[*vertex as usize] += block;
        }
        sums
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.diagonal) + size_of_val(&*self.blocks) + self.pattern.bytes()
    }
}

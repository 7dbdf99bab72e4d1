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
//! semidefinite where every element is.
//!
//! Rows belong to the parts of the vertices ([`crate::parallel`]). A pair inside a part is stored once; one across a border is
//! stored by both parts, which compute the same block.

mod pattern;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;

use nalgebra::Matrix3;

use crate::Vec3;
use crate::parallel::parts::Parts;
use pattern::Pattern;

/// The rows of a rank's own vertices.
#[derive(Debug, Clone, Default)]
pub struct BlockMatrix {
    parts: Vec<PartBlocks>,
}

/// The rows of a part.
#[derive(Debug, Clone)]
pub struct PartBlocks {
    pattern: Pattern,
    /// D_i of each vertex: xx, yy, zz, yz, xz, xy.
    diagonal: Vec<[f64; 6]>,
    /// B of each pair, row by row, and one more that nobody reads: what is added for pairs of other parts.
    blocks: Vec<[f64; 9]>,
}

/// The place of a pair's block in the rows of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot(u32);

impl BlockMatrix {
    /// A matrix of zeros for the elements of a rank. `elements(part, visit)` gives `visit` the local vertices of each element
    /// that has a vertex in the part, in any order, as often as it likes; an element joins all of its vertices.
    pub fn new(parts: &Parts, elements: &dyn Fn(usize, &mut dyn FnMut(&[u32]))) -> Self {
        let of_part = |part: usize| {
            let pattern = Pattern::new(parts.ranges()[part].clone(), |visit| elements(part, visit));
            PartBlocks {
                diagonal: vec![[0.0; 6]; parts.ranges()[part].len()],
                blocks: vec![[0.0; 9]; pattern.pair_count() + 1],
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
        self.diagonal.fill([0.0; 6]);
        self.blocks.fill([0.0; 9]);
    }

    /// Adds a symmetric block to D of a vertex of the part, counted from its first. Units are those of A.
    pub fn add_diagonal(&mut self, vertex: usize, block: &Matrix3<f64>) {
        let values = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)].map(|place| block[place]);
        self.diagonal[vertex].iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
    }

    /// Adds a multiple of the identity, as a mass is, to D of a vertex of the part, counted from its first.
    pub fn add_scalar(&mut self, vertex: usize, value: f64) {
        self.diagonal[vertex][..3].iter_mut().for_each(|sum| *sum += value);
    }

    /// The place of the block of a pair of local vertices, which are of one element. What is added for a pair without a vertex
    /// in the part is not kept: its own parts have it.
    pub fn slot(&self, a: u32, b: u32) -> Slot {
        self.pattern.slot(a, b)
    }

    /// The places of the blocks of all pairs of an element: (0, 1), (0, 2), ... (1, 2), ...
    pub fn slots<const VERTICES: usize, const PAIRS: usize>(&self, vertices: &[u32; VERTICES]) -> [Slot; PAIRS] {
        const { assert!(PAIRS * 2 == VERTICES * (VERTICES - 1), "each pair has a slot") };
        let pairs = (0..VERTICES).flat_map(|a| (a + 1..VERTICES).map(move |b| (a, b)));
        let mut slots = [Slot::ELSEWHERE; PAIRS];
        slots.iter_mut().zip(pairs).for_each(|(slot, (a, b))| *slot = self.slot(vertices[a], vertices[b]));
        slots
    }

    /// Adds to B_ab, and thereby to B_ba. Once for each part that has the pair.
    #[inline]
    pub fn add_coupling(&mut self, slot: Slot, block: &Matrix3<f64>) {
        let sums = self.block(slot);
        for row in 0..3 {
            for column in 0..3 {
                let place = if slot.is_transposed() { 3 * column + row } else { 3 * row + column };
                sums[place] += block[(row, column)];
            }
        }
    }

    /// Adds what a spring along the unit vector `e` has: `along` e eᵀ + `across` (1 - e eᵀ). Once for each part that has the
    /// pair.
    #[inline]
    pub fn add_spring(&mut self, slot: Slot, e: &Vec3, along: f64, across: f64) {
        let sums = self.block(slot);
        for row in 0..3 {
            let scaled = e[row] * (along - across);
            for column in 0..3 {
                sums[3 * row + column] += scaled * e[column];
            }
            sums[4 * row] += across;
        }
    }

    /// Adds `scale` g gᵀ over the vertices of an element whose gradients g have the sum zero, as those of an angle or of a length
    /// have: B_ab gets -`scale` g_a g_bᵀ. `slots` are those of [`PartBlocks::slots`].
    #[inline]
    pub fn add_outer<const VERTICES: usize, const PAIRS: usize>(
        &mut self,
        slots: &[Slot; PAIRS],
        scale: f64,
        gradients: &[Vec3; VERTICES],
    ) {
        const { assert!(PAIRS * 2 == VERTICES * (VERTICES - 1), "each pair has a slot") };
        let mut slot = slots.iter();
        for (a, g_a) in gradients.iter().enumerate() {
            for g_b in &gradients[a + 1..] {
                let slot = *slot.next().expect("as many slots as pairs");
                let (rows, columns) = if slot.is_transposed() { (g_b, g_a) } else { (g_a, g_b) };
                let sums = self.block(slot);
                for row in 0..3 {
                    let scaled = -scale * rows[row];
                    for column in 0..3 {
                        sums[3 * row + column] += scaled * columns[column];
                    }
                }
            }
        }
    }

    #[inline]
    fn block(&mut self, slot: Slot) -> &mut [f64; 9] {
        // Pairs of other parts share the last block, which no product reads.
        let unread = self.blocks.len() - 1;
        &mut self.blocks[slot.place().min(unread)]
    }

    /// `q = A s` of the part's rows; `s` are those of all local vertices, `q` the part's own.
    pub fn multiply(&self, s: &[Vec3], q: &mut [Vec3]) {
        let first = self.pattern.first();
        for (vertex, (q, d)) in q.iter_mut().zip(&self.diagonal).enumerate() {
            let s = s[first + vertex];
            *q = Vec3::new(
                d[0] * s.x + d[5] * s.y + d[4] * s.z,
                d[5] * s.x + d[1] * s.y + d[3] * s.z,
                d[4] * s.x + d[3] * s.y + d[2] * s.z,
            );
        }
        for (pair, b) in self.pattern.pairs().zip(&self.blocks) {
            let u = s[first + pair.vertex] - s[pair.other];
            q[pair.vertex] += Vec3::new(
                b[0] * u.x + b[1] * u.y + b[2] * u.z,
                b[3] * u.x + b[4] * u.y + b[5] * u.z,
                b[6] * u.x + b[7] * u.y + b[8] * u.z,
            );
            if let Some(other) = pair.other_in_part {
                q[other] -= Vec3::new(
                    b[0] * u.x + b[3] * u.y + b[6] * u.z,
                    b[1] * u.x + b[4] * u.y + b[7] * u.z,
                    b[2] * u.x + b[5] * u.y + b[8] * u.z,
                );
            }
        }
    }

    /// Calls `visit` with the block of A on the diagonal of each vertex of the part: D_i + sum_j B_ij.
    pub fn diagonal_blocks(&self) -> Vec<Matrix3<f64>> {
        let full = |d: &[f64; 6]| Matrix3::new(d[0], d[5], d[4], d[5], d[1], d[3], d[4], d[3], d[2]);
        let mut sums: Vec<Matrix3<f64>> = self.diagonal.iter().map(full).collect();
        for (pair, b) in self.pattern.pairs().zip(&self.blocks) {
            let b = Matrix3::from_row_slice(b);
            sums[pair.vertex] += b;
            if let Some(other) = pair.other_in_part {
                sums[other] += b.transpose();
            }
        }
        sums
    }

    /// Whether some pair has a vertex outside of the rank's own range.
    pub fn reaches_beyond(&self, own: &std::ops::Range<usize>) -> bool {
        self.pattern.pairs().any(|pair| !own.contains(&pair.other))
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.diagonal) + size_of_val(&*self.blocks) + self.pattern.bytes()
    }
}

impl Slot {
    /// The place of pairs that the part does not have.
    const ELSEWHERE: Self = Self(u32::MAX);

    fn new(place: usize, is_transposed: bool) -> Self {
        Self((place as u32) << 1 | u32::from(is_transposed))
    }

    fn place(self) -> usize {
        (self.0 >> 1) as usize
    }

    fn is_transposed(self) -> bool {
        self.0 & 1 == 1
    }
}

//! Blocks of three by three as products want them.
//!
//! A block is stored by its diagonals d = (b00, b11, b22), e = (b01, b12, b20), f = (b02, b10, b21). With t(u) = (y, z, x) and
//! t⁻¹(u) = (z, x, y), component by component,
//!
//! ```text
//! B u = d u + e t(u) + f t⁻¹(u)        Bᵀ u = d u + t(f u) + t⁻¹(e u)
//! ```
//!
//! so whole vectors are multiplied, and both products use what was loaded once. Of a symmetric block f = t⁻¹(e) is not stored.

use nalgebra::Matrix3;

use crate::parallel::simd4::Simd4;

/// Row and column of each value that is stored: d, e, f.
const PLACES: [(usize, usize); 9] = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0), (0, 2), (1, 0), (2, 1)];

/// d, e and f of a block. The fourth lane of each is what stands behind it in memory: it meets that of a vector, which is zero.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coefficients {
    d: Simd4,
    e: Simd4,
    f: Simd4,
}

impl Coefficients {
    /// Reads the coefficients of a block, with three more values behind it.
    #[inline(always)]
    pub(crate) fn of(values: &[f32]) -> Self {
        let four = |at: usize| Simd4::widened(&[values[at], values[at + 1], values[at + 2], values[at + 3]]);
        Self { d: four(0), e: four(3), f: four(6) }
    }

    /// B u.
    #[inline(always)]
    pub(crate) fn times(&self, u: Simd4) -> Simd4 {
        self.f.mul_add(u.turned_back(), self.e.mul_add(u.turned(), self.d.component_mul(u)))
    }

    /// Bᵀ u.
    #[inline(always)]
    pub(crate) fn transposed_times(&self, u: Simd4) -> Simd4 {
        self.d.mul_add(u, self.f.component_mul(u).turned() + self.e.component_mul(u).turned_back())
    }
}

/// The product of a symmetric block, given by d, e and a value more, with a vector.
#[inline(always)]
pub(crate) fn symmetric_product(values: &[f64], u: Simd4) -> Simd4 {
    let four = |at: usize| Simd4::new([values[at], values[at + 1], values[at + 2], values[at + 3]]);
    let (d, e) = (four(0), four(3));
    e.mul_add(u.turned(), d.component_mul(u)) + e.component_mul(u).turned_back()
}

/// d and e of a symmetric block.
pub(crate) fn stored_symmetric(block: &Matrix3<f64>) -> [f64; 6] {
    std::array::from_fn(|place| block[PLACES[place]])
}

/// A symmetric block from d and e.
pub(crate) fn full_symmetric(values: &[f64]) -> Matrix3<f64> {
    let [xx, yy, zz, xy, yz, zx] = std::array::from_fn(|place| values[place]);
    Matrix3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz)
}

/// A block by d, e and f.
pub(crate) fn stored_block(block: &Matrix3<f64>) -> [f32; 9] {
    PLACES.map(|place| block[place] as f32)
}

/// A block from d, e and f.
pub(crate) fn full_block(values: &[f32; 9]) -> Matrix3<f64> {
    let mut full = Matrix3::zeros();
    PLACES.into_iter().zip(values).for_each(|(place, value)| full[place] = f64::from(*value));
    full
}

/// Adds the block with these values by row and column.
#[cfg(any(test, feature = "effects"))]
#[inline(always)]
pub(super) fn add(sums: &mut [f32; 9], value: impl Fn(usize, usize) -> f64) {
    for (sum, (row, column)) in sums.iter_mut().zip(PLACES) {
        *sum += value(row, column) as f32;
    }
}

/// A vector as a factor of outer products: what it brings to each of the first eight places of [`PLACES`], by rows and by columns.
/// The ninth takes the third row and the second column, which are among them.
#[derive(Debug, Clone, Copy)]
pub(super) struct OuterFactor {
    rows: [f32; 8],
    columns: [f32; 8],
}

impl OuterFactor {
    #[inline(always)]
    pub(super) fn new(vector: Simd4) -> Self {
        let [x, y, z, _] = vector.narrowed();
        Self { rows: [x, y, z, x, y, z, x, y], columns: [x, y, z, y, z, x, z, x] }
    }
}

/// Takes away `a` `b`ᵀ. The factors of each place change with `a` and `b`, but not their product: what a pair has at one part is
/// to the last bit the transposed of what it has at another.
#[inline(always)]
pub(super) fn subtract_outer_product(sums: &mut [f32; 9], a: &OuterFactor, b: &OuterFactor) {
    for (sum, (row, column)) in sums.iter_mut().zip(a.rows.iter().zip(&b.columns)) {
        *sum -= row * column;
    }
    sums[8] -= a.rows[2] * b.columns[1];
}

/// Adds the symmetric block with these values on the diagonal, and these at xy, yz, zx.
#[inline(always)]
pub(super) fn add_symmetric(sums: &mut [f32; 9], diagonal: Simd4, beside: Simd4) {
    let ([xx, yy, zz, _], [xy, yz, zx, _]) = (diagonal.narrowed(), beside.narrowed());
    sums.iter_mut().zip([xx, yy, zz, xy, yz, zx, zx, xy, yz]).for_each(|(sum, value)| *sum += value);
}

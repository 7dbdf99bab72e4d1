//! Sums whose bits do not depend on who computes them: blocks of fixed size inside a part are added in order, block sums
//! are joined by a fixed tree over block numbers.

use crate::Vec3;

/// Number of vertices of a block. A constant, never taken from the machine: it fixes the order of every sum.
pub const SUM_BLOCK: usize = 512;

/// Joins block sums by halves: the tree depends on their number alone.
pub fn join(blocks: &[f64]) -> f64 {
    match blocks {
        [] => 0.0,
        [one] => *one,
        _ => {
            let (low, high) = blocks.split_at(blocks.len() / 2);
            join(low) + join(high)
        }
    }
}

/// Largest of the block values; zero if there are none.
pub fn largest(blocks: &[f64]) -> f64 {
    blocks.iter().copied().fold(0.0, f64::max)
}

/// Sum of `m a·b` over a block, one running sum per axis.
pub fn weighted_dot(m: &[f64], a: &[Vec3], b: &[Vec3]) -> f64 {
    let mut sum = Vec3::zeros();
    for ((m, a), b) in m.iter().zip(a).zip(b) {
        sum += a.component_mul(b) * *m;
    }
    sum.x + sum.y + sum.z
}

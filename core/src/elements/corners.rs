//! Elements with several corners, such as triangles, as the parts of the cloth evaluate them.
//!
//! An element over a border is evaluated by every part that has one of its corners, from the same numbers in the same order;
//! each part keeps what concerns its own vertices.

#![cfg(feature = "effects")]

use std::ops::Range;

use crate::parallel::parts::Parts;
use crate::parallel::simd4::Simd4;

/// Returns the elements that each own part evaluates, given the corners of each element (local vertices): pairs of part and
/// number of the element, ascending.
pub(crate) fn by_part<const N: usize>(
    parts: &Parts,
    elements: impl ExactSizeIterator<Item = [usize; N]>,
) -> Vec<(usize, usize)> {
    let mut entries: Vec<(usize, usize)> = Vec::with_capacity(elements.len() * 9 / 8);
    for (number, corners) in elements.enumerate() {
        let own = corners.into_iter().filter(|corner| parts.own().contains(corner));
        entries.extend(own.map(|corner| (parts.part_of(corner), number)));
    }
    entries.sort_unstable();
    entries.dedup();
    entries
}

/// Corners that are not in a part, ascending.
pub(crate) fn outside<const N: usize>(part: &Range<usize>, elements: impl Iterator<Item = [u32; N]>) -> Vec<u32> {
    let mut found: Vec<u32> = elements.flatten().filter(|corner| !part.contains(&(*corner as usize))).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Values at the corners of an element: from the part's own, which begin at the vertex `start`, or from those of all vertices.
pub(crate) fn gather<const N: usize>(
    start: usize,
    corners: [u32; N],
    own: &[Simd4],
    all: &[crate::Vec3],
) -> [Simd4; N] {
    let at = |corner: u32| {
        let corner = corner as usize;
        own.get(corner.wrapping_sub(start)).copied().unwrap_or_else(|| Simd4::from(&all[corner]))
    };
    corners.map(at)
}

/// Adds to the corners of an element that are the part's own.
#[inline(always)]
pub(crate) fn add<const N: usize>(start: usize, corners: [u32; N], values: [Simd4; N], own: &mut [Simd4]) {
    for (corner, value) in corners.into_iter().zip(values) {
        if let Some(own) = own.get_mut((corner as usize).wrapping_sub(start)) {
            *own += value;
        }
    }
}

/// The share of an element's corners that are a part's own: what the part counts of its energy.
pub(crate) fn own_fraction<const N: usize>(part: &Range<usize>, corners: [u32; N]) -> f64 {
    corners.into_iter().filter(|corner| part.contains(&(*corner as usize))).count() as f64 / N as f64
}

//! Sewn vertices while a scene is handed out. A rank that owns one of a pair has the other among its ghosts.

use std::ops::Range;

/// A pair of sewn vertices, by their numbers in the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sewn {
    /// Number among the pairs of all seams.
    pub number: u32,
    /// Number of the seam.
    pub seam: usize,
    /// The two vertices.
    pub ends: [u32; 2],
    /// Distance between the two vertices at the start [m].
    pub gap: f64,
    /// The part of the seam's time in which a zip closes the pair: from and to, 0 to 1.
    pub share: [f64; 2],
}

/// The pairs with a vertex among `own`, which are numbers of the scene.
pub(crate) fn sewn_to(sewn: &[Sewn], own: &Range<usize>) -> Vec<Sewn> {
    sewn.iter().copied().filter(|pair| pair.ends.iter().any(|end| own.contains(&(*end as usize)))).collect()
}

/// The far ends of the pairs that have one end among `own`, as far as they are in `garment`.
pub(crate) fn partners(sewn: &[Sewn], own: &Range<usize>, garment: &Range<usize>) -> Vec<u32> {
    let holds = |range: &Range<usize>, end: u32| range.contains(&(end as usize));
    let far = sewn.iter().flat_map(|pair| {
        let [a, b] = pair.ends;
        [(a, b), (b, a)].into_iter().filter(|(near, _)| holds(own, *near)).map(|(_, far)| far)
    });
    far.filter(|far| holds(garment, *far)).collect()
}

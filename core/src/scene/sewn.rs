//! Sewn vertices while a scene is handed out. A rank that owns one of a pair has the other among its ghosts.

use std::ops::Range;

use crate::parallel::parts::Partition;
use crate::scene::SceneDescription;

/// A pair of sewn vertices, by their numbers in the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sewn {
    /// Number among the pairs of all seams.
    pub number: u32,
    /// Number of the seam.
    pub seam: usize,
    /// The two vertices.
    pub ends: [u32; 2],
    /// How far apart they start [m].
    pub gap: f64,
}

/// Every sewn pair of a description; `orders` are the vertices of each garment in the order of the scene.
pub(super) fn sewn_pairs(description: &SceneDescription, partition: &Partition, orders: &[Vec<u32>]) -> Vec<Sewn> {
    let mut places: Vec<Vec<u32>> = vec![Vec::new(); orders.len()];
    for garment in description.seams.iter().flat_map(|seam| seam.garments) {
        if places[garment].is_empty() {
            let first = partition.garments()[garment].start as u32;
            let mut of_garment = vec![0; orders[garment].len()];
            orders[garment].iter().zip(first..).for_each(|(vertex, number)| of_garment[*vertex as usize] = number);
            places[garment] = of_garment;
        }
    }
    let start = |garment: usize, vertex: u32| {
        let garment = &description.garments[garment];
        garment.start.as_ref().unwrap_or(&garment.mesh.points)[vertex as usize]
    };
    let mut all = Vec::new();
    for (number, seam) in description.seams.iter().enumerate() {
        let [a, b] = seam.garments;
        for [p, q] in &seam.pairs {
            let gap = (start(a, *p) - start(b, *q)).norm();
            let ends = [places[a][*p as usize], places[b][*q as usize]];
            all.push(Sewn { number: all.len() as u32, seam: number, ends, gap });
        }
    }
    all
}

/// The pairs with a vertex among `own`, which are numbers of the scene.
pub(super) fn sewn_to(sewn: &[Sewn], own: &Range<usize>) -> Vec<Sewn> {
    sewn.iter().copied().filter(|pair| pair.ends.iter().any(|end| own.contains(&(*end as usize)))).collect()
}

/// The far ends of the pairs that have one end among `own`, as far as they are in `garment`.
pub(super) fn partners(sewn: &[Sewn], own: &Range<usize>, garment: &Range<usize>) -> Vec<u32> {
    let holds = |range: &Range<usize>, end: u32| range.contains(&(end as usize));
    let far = sewn.iter().flat_map(|pair| {
        let [a, b] = pair.ends;
        [(a, b), (b, a)].into_iter().filter(|(near, _)| holds(own, *near)).map(|(_, far)| far)
    });
    far.filter(|far| holds(garment, *far)).collect()
}

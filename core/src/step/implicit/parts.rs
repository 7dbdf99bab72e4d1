//! Parts of the cloth that a round of Newton's method works on (`docs/theory/tr_bdf2.md#newtons-method-in-contact`).
//!
//! Regions that are hard for it, a fold that snaps or a hem that lands, are small, and the rest of the cloth is where
//! it belongs after one or two rounds. So each part is done by itself when its velocities do not change any more.

use crate::Vec3;
use crate::block_matrix::BlockMatrix;
use crate::contact::bodies::active_set::ActiveSet;
use crate::contact::repulsion::pair_forces::PairForce;
use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::parts::Parts;
use crate::parallel::simd4::Simd4;

/// Cloth that touches cloth, as parts see it.
pub(super) struct PairsInTouch<'a> {
    pub(super) pairs: &'a [PairForce],
    pub(super) nodes: &'a ContactNodes,
    /// Changes of velocity of nodes of cloth by a solve with these pairs [m/s], ghosts included; `None` if ghosts have yet to be told.
    pub(super) solution: Option<&'a [Simd4]>,
}

impl PairsInTouch<'_> {
    /// Own parts with a vertex in a pair of which some node is marked, of those of cloth.
    fn parts_with(&self, parts: &Parts, marked: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut found = vec![false; parts.count()];
        let own = self.nodes.own();
        for pair in self.pairs.iter().filter(|pair| pair.nodes.iter().any(|node| marked(*node as usize))) {
            for node in pair.nodes.iter().map(|node| *node as usize).filter(|node| own.contains(node)) {
                found[parts.part_of(node - own.start + parts.own().start)] = true;
            }
        }
        found
    }
}

/// Parts of which a vertex has changed by more than `far` [m/s], and those with a vertex that an element or a pair joins to
/// such a one. `change` is that of the local vertices [m/s]. All ranks call it together.
pub(super) fn parts_moved(
    parts: &Parts,
    matrix: &BlockMatrix,
    touch: Option<&PairsInTouch<'_>>,
    (change, far): (&[Vec3], f64),
) -> Vec<bool> {
    let is_more = |change: &Vec3| change.norm_squared() > far * far;
    let is_far = |vertex: usize| is_more(&change[vertex]);
    let with_elements = parts.ranges().iter().zip(matrix.parts()).map(|(range, rows)| {
        range.clone().any(is_far) || rows.outside_pairs().iter().any(|(_, other)| is_far(*other as usize))
    });
    let mut moved: Vec<bool> = with_elements.collect();
    let Some(touch) = touch else { return moved };
    let mut far_nodes = vec![0_u8; touch.nodes.cloth()];
    for (node, vertex) in touch.nodes.own().zip(parts.own()) {
        far_nodes[node] = u8::from(is_far(vertex));
    }
    match touch.solution {
        Some(solution) => {
            for ghost in touch.nodes.ghost_places() {
                far_nodes[ghost] = u8::from(solution.get(ghost).is_some_and(|change| is_more(&Vec3::from(*change))));
            }
        }
        None => touch.nodes.update(&mut far_nodes),
    }
    let with_pairs = touch.parts_with(parts, |node| far_nodes.get(node) == Some(&1));
    moved.iter_mut().zip(with_pairs).for_each(|(moved, other)| *moved |= other);
    moved
}

/// Parts in which cloth touches cloth.
pub(super) fn parts_in_layers(parts: &Parts, touch: Option<&PairsInTouch<'_>>) -> Vec<bool> {
    touch.map_or_else(|| vec![false; parts.count()], |touch| touch.parts_with(parts, |_| true))
}

/// Parts with a contact: with bodies, or with cloth.
pub(super) fn parts_touched(parts: &Parts, active: &ActiveSet, touch: Option<&PairsInTouch<'_>>) -> Vec<bool> {
    parts_in_layers(parts, touch)
        .into_iter()
        .enumerate()
        .map(|(part, cloth)| cloth || !active.of_part(part).is_empty())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block_matrix::testing::Sheet;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;

    const FAR: f64 = 0.05;

    /// Numbers of the scene of the first vertices of the parts that have moved, if these have.
    fn moved(sheet: &Sheet, ranks: &Ranks, vertices: &[u32]) -> Vec<u32> {
        let parts = sheet.parts(ranks);
        let speed = |local: usize| if vertices.contains(&parts.number(local)) { 2.0 * FAR } else { 0.5 * FAR };
        let change: Vec<Vec3> = (0..parts.local_count()).map(|local| Vec3::x() * speed(local)).collect();
        let moved = parts_moved(&parts, &sheet.matrix(&parts), None, (&change, FAR));
        let first = parts.ranges().iter().map(|range| parts.number(range.start));
        first.zip(moved).filter_map(|(first, moved)| moved.then_some(first)).collect()
    }

    #[test]
    fn a_part_goes_on_where_a_vertex_of_it_moved_or_one_that_its_elements_reach() {
        let sheet = Sheet::new(20, 10.0, 9);
        let parts = sheet.parts(&Ranks::default());
        let matrix = sheet.matrix(&parts);
        assert_eq!(moved(&sheet, &Ranks::default(), &[]), []);
        for vertex in [0, 45, 210, 399] {
            let reaches = |part: &usize| {
                let outside = matrix.parts()[*part].outside_pairs();
                parts.ranges()[*part].contains(&(vertex as usize)) || outside.iter().any(|(_, other)| *other == vertex)
            };
            let expected: Vec<u32> =
                (0..parts.count()).filter(reaches).map(|part| parts.ranges()[part].start as u32).collect();
            assert!((1..5).contains(&expected.len()));
            assert_eq!(moved(&sheet, &Ranks::default(), &[vertex]), expected);
            let shares = LocalRanks::run(3, 1, |communicator| moved(&sheet, &Ranks::new(communicator), &[vertex]));
            assert_eq!(shares.expect("no rank ends early").concat(), expected);
        }
    }
}

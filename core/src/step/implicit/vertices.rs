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
use crate::parallel::working_set::WorkingSet;

/// Cloth that touches cloth, as parts see it.
pub(super) struct PairsInTouch<'a> {
    pub(super) pairs: &'a [PairForce],
    pub(super) nodes: &'a ContactNodes,
    /// Changes of velocity of nodes of cloth by a solve with these pairs [m/s], ghosts included; `None` if ghosts have yet to be told.
    pub(super) solution: Option<&'a [Simd4]>,
}

impl PairsInTouch<'_> {
    /// Own vertices in a pair of which some node is marked, of those of cloth.
    fn add_with(&self, parts: &Parts, marked: impl Fn(usize) -> bool, found: &mut [WorkingSet]) {
        let own = self.nodes.own();
        for pair in self.pairs.iter().filter(|pair| pair.nodes.iter().any(|node| marked(*node as usize))) {
            for node in pair.nodes.iter().map(|node| *node as usize).filter(|node| own.contains(node)) {
                add(parts, node - own.start + parts.own().start, found);
            }
        }
    }
}

/// Adds a local vertex, an own one, to the sets of the parts.
fn add(parts: &Parts, vertex: usize, sets: &mut [WorkingSet]) {
    let part = parts.part_of(vertex);
    sets[part] |= WorkingSet::of(vertex - parts.ranges()[part].start);
}

/// Own vertices that have changed by more than `far` [m/s], and those that an element or a pair joins to such a one, by parts. `change` is
/// the change of the local vertices [m/s]. All ranks call it together.
pub(super) fn vertices_moved(
    parts: &Parts,
    matrix: &BlockMatrix,
    touch: Option<&PairsInTouch<'_>>,
    (change, far): (&[Vec3], f64),
) -> Vec<WorkingSet> {
    let is_more = |change: &Vec3| change.norm_squared() > far * far;
    let is_far = |vertex: usize| is_more(&change[vertex]);
    let with_elements = parts.ranges().iter().zip(matrix.parts()).map(|(range, rows)| {
        let are_far: Vec<bool> = range.clone().map(is_far).collect();
        let mut moved = WorkingSet::NONE;
        if are_far.contains(&true) {
            let own = are_far.iter().enumerate().filter(|(_, is_far)| **is_far);
            own.for_each(|(vertex, _)| moved |= WorkingSet::of(vertex));
            for (one, other) in rows.inside_pairs().filter(|(one, other)| are_far[*one] != are_far[*other]) {
                moved |= WorkingSet::of(one) | WorkingSet::of(other);
            }
        }
        for (vertex, _) in rows.outside_pairs().iter().filter(|(_, other)| is_far(*other as usize)) {
            moved |= WorkingSet::of(*vertex as usize);
        }
        moved
    });
    let mut moved: Vec<WorkingSet> = with_elements.collect();
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
    touch.add_with(parts, |node| far_nodes.get(node) == Some(&1), &mut moved);
    moved
}

/// Own vertices in a pair in touch, by parts.
pub(super) fn vertices_in_layers(parts: &Parts, touch: Option<&PairsInTouch<'_>>) -> Vec<WorkingSet> {
    let mut found = vec![WorkingSet::NONE; parts.count()];
    touch.into_iter().for_each(|touch| touch.add_with(parts, |_| true, &mut found));
    found
}

/// Own vertices with a contact, with bodies or with cloth, by parts.
pub(super) fn vertices_touched(parts: &Parts, active: &ActiveSet, touch: Option<&PairsInTouch<'_>>) -> Vec<WorkingSet> {
    let mut touched = vertices_in_layers(parts, touch);
    touched.iter_mut().enumerate().for_each(|(part, touched)| *touched |= active.vertices_of(parts, part));
    touched
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block_matrix::testing::Sheet;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;

    const FAR: f64 = 0.05;

    /// Numbers of the scene of the vertices that a round works on, if these have moved.
    fn moved(sheet: &Sheet, ranks: &Ranks, vertices: &[u32]) -> Vec<u32> {
        let parts = sheet.parts(ranks);
        let speed = |local: usize| if vertices.contains(&parts.number(local)) { 2.0 * FAR } else { 0.5 * FAR };
        let change: Vec<Vec3> = (0..parts.local_count()).map(|local| Vec3::x() * speed(local)).collect();
        let moved = vertices_moved(&parts, &sheet.matrix(&parts), None, (&change, FAR));
        let of_parts = parts.ranges().iter().zip(moved);
        let locals = of_parts.flat_map(|(range, set)| set.ranges(range.len()).flatten().map(move |v| range.start + v));
        locals.map(|local| parts.number(local)).collect()
    }

    #[test]
    fn a_vertex_goes_on_where_one_of_its_run_moved_or_one_that_an_element_joins_to_one_of_them() {
        let sheet = Sheet::new(20, 10.0, 9);
        let parts = sheet.parts(&Ranks::default());
        let matrix = sheet.matrix(&parts);
        assert_eq!(moved(&sheet, &Ranks::default(), &[]), []);
        for vertex in [0, 45, 210, 399] {
            let mut expected: Vec<u32> = Vec::new();
            for (range, rows) in parts.ranges().iter().zip(matrix.parts()) {
                let first = range.start as u32;
                let inside = rows.inside_pairs().map(|(a, b)| [first + a as u32, first + b as u32]);
                let outside = rows.outside_pairs().iter().map(|(a, b)| [first + a, *b]);
                let joined = inside.chain(outside).filter(|pair| pair.contains(&vertex)).flatten();
                let reached = joined.chain([vertex]).filter(|v| range.contains(&(*v as usize)));
                let set = reached.fold(WorkingSet::NONE, |set, v| set | WorkingSet::of(v as usize - range.start));
                expected.extend(set.ranges(range.len()).flatten().map(|v| first + v as u32));
            }
            assert!((8..150).contains(&expected.len()), "{}", expected.len());
            assert_eq!(moved(&sheet, &Ranks::default(), &[vertex]), expected);
            let shares = LocalRanks::run(3, 1, |communicator| moved(&sheet, &Ranks::new(communicator), &[vertex]));
            assert_eq!(shares.expect("no rank ends early").concat(), expected);
        }
    }
}

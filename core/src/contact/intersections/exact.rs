//! Current crossings: edges of cloth that pass through triangles of cloth or of bodies, and edges of bodies through
//! cloth.
//!
//! Each crossing is found on one rank and sent to all, so every rank has the same list, in numbers of the scene. It is nearly
//! always empty.

use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::broad_phase::bvh_search::PairSearch;
use crate::contact::broad_phase::ghost_triangles::{GhostTriangles, exchange_ghosts_with_positions};
use crate::contact::topology::faces::Faces;
use crate::contact::topology::pair::{Pair, PairKind};
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::bvh::Bvh;
use crate::geometry::crossings::{self, Crossing, Surface};

/// All crossings of objects that do not ignore each other, with the nodes at `x` [m], which are inside the boxes that were given to the
/// search last; of those of cloth with cloth the ones with a node in `moved` (one entry for each node), if given. Ascending, in numbers
/// of the scene. All ranks call it together.
pub(crate) fn crossings(
    surface: &ContactSurface,
    search: &PairSearch,
    x: &[Vec3],
    moved: Option<&[u8]>,
) -> Vec<Crossing> {
    let [cloth_tree, body_tree] = search.trees();
    let cloth = placed(surface.cloth(), cloth_tree, x);
    let bodies = placed(surface.bodies(), body_tree, x);
    let mut found = match moved {
        Some(moved) => crossings::find_moved(&cloth, |node| moved[node as usize] != 0),
        None => crossings::find(&cloth),
    };
    if !bodies.triangles.is_empty() {
        found.extend(crossings::find_between(&cloth, &bodies));
        found.extend(crossings::find_between(&bodies, &cloth));
    }
    found.retain(|crossing| !surface.is_ignored(&crossing.edge, &crossing.triangle));
    let nodes = surface.nodes();
    if nodes.ranks().is_alone() {
        found.sort_unstable();
        return found;
    }
    let number = |node: u32| nodes.number(node);
    let mut all: Vec<Crossing> = found.iter().map(|c| numbered(c, number, number)).collect();
    all.extend(with_ghost_triangles(surface, search, &cloth, moved));
    let mut all = nodes.ranks().all_gather_v(&all).concat();
    all.sort_unstable();
    all.dedup();
    all
}

/// Triangles with their nodes at `x` [m], inside the boxes of a tree over them.
fn placed<'a>(faces: &'a Faces, tree: &'a Bvh, x: &'a [Vec3]) -> Surface<'a> {
    Surface { triangles: faces.triangles(), owners: faces.owners(), positions: x, tree }
}

/// Crossings of the triangles of this rank with those of higher ranks.
fn with_ghost_triangles(
    surface: &ContactSurface,
    search: &PairSearch,
    cloth: &Surface<'_>,
    moved: Option<&[u8]>,
) -> Vec<Crossing> {
    let nodes = surface.nodes();
    let rows = exchange_ghosts_with_positions(surface, cloth.tree, search.cloth_boxes(), cloth.positions, moved);
    let GhostTriangles { faces, numbers, x, moved: theirs, objects, tree } = GhostTriangles::new(&rows);
    let ghosts = placed(&faces, &tree, &x);
    let number = |node: u32| nodes.number(node);
    let ghost_number = |node: u32| numbers[node as usize];
    let has_moved = |node: u32| moved.is_none_or(|moved| moved[node as usize] != 0);
    let they_have = |node: u32| theirs[node as usize];
    let ignores = |own: &[u32], ghost: &[u32]| {
        let ghost = surface.common_object(ghost.iter().map(|node| objects[*node as usize]));
        surface.ignores(surface.object_of(own), ghost)
    };
    let asked = |edge: &[u32; 2], triangle: &[u32; 3]| {
        let apart = !edge.iter().any(|e| triangle.iter().any(|t| number(*e) == ghost_number(*t)));
        let is_asked = edge.iter().any(|e| has_moved(*e)) || triangle.iter().any(|t| they_have(*t));
        apart && is_asked && !ignores(edge, triangle)
    };
    let asked_back = |edge: &[u32; 2], triangle: &[u32; 3]| {
        let apart = !edge.iter().any(|e| triangle.iter().any(|t| ghost_number(*e) == number(*t)));
        let is_asked = edge.iter().any(|e| they_have(*e)) || triangle.iter().any(|t| has_moved(*t));
        apart && is_asked && !ignores(triangle, edge)
    };
    let ours = crossings::find_between_where(cloth, &ghosts, asked);
    let back = crossings::find_between_where(&ghosts, cloth, asked_back);
    let ours = ours.iter().map(|c| numbered(c, number, ghost_number));
    ours.chain(back.iter().map(|c| numbered(c, ghost_number, number))).collect()
}

/// A crossing in other numbers.
fn numbered(crossing: &Crossing, of_edge: impl Fn(u32) -> u32, of_triangle: impl Fn(u32) -> u32) -> Crossing {
    let [a, b] = crossing.edge.map(of_edge);
    Crossing { edge: [a.min(b), a.max(b)], triangle: crossing.triangle.map(of_triangle) }
}

/// The pairs of points, triangles and edges that may pass through each other because an edge crosses a triangle: its ends
/// with the triangle, and the edge with the triangle's edges (`docs/theory/self_contact.md#existing-intersections`).
/// Ascending.
pub(crate) fn ignored_pairs(crossings: &[Crossing]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for Crossing { edge, triangle: [a, b, c] } in crossings {
        for p in edge {
            pairs.push(Pair { kind: PairKind::PointTriangle, nodes: [*p, *a, *b, *c] });
        }
        for [p, q] in [[a, b], [b, c], [c, a]] {
            let other = [*p.min(q), *p.max(q)];
            let [first, second] = if *edge < other { [*edge, other] } else { [other, *edge] };
            let nodes = [first[0], first[1], second[0], second[1]];
            pairs.push(Pair { kind: PairKind::EdgeEdge, nodes });
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The vertices of cloth in crossings of cloth with bodies where these may cross themselves, ascending.
pub(crate) fn pinched_vertices(surface: &ContactSurface, crossings: &[Crossing], bodies: &Bodies) -> Vec<u32> {
    let pinched = crossings.iter().filter(|crossing| surface.is_pinched(crossing, bodies));
    let numbers = pinched.flat_map(|c| c.edge.into_iter().chain(c.triangle));
    let mut vertices: Vec<u32> = numbers.filter(|&number| number < surface.nodes().global_cloth_count()).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

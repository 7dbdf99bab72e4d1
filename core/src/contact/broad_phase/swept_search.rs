//! The search along paths, and its renewal where nodes have left their paths.
//!
//! A node stops anywhere on its path, or a little beside it: collisions shorten paths. Pairs that cannot meet wherever their nodes stop are
//! left out. While collisions are resolved, a few nodes at a time leave their paths. Only what these may meet is searched again.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::broad_phase::bvh_search::{PairSearch, Side, TASKS};
use crate::contact::broad_phase::proximity_list::ProximityList;
use crate::contact::tolerances::BEYOND_GAP;
use crate::contact::topology::nodes::{ContactNodes, IndexMap, NodePaths};
use crate::contact::topology::pair::Pair;
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::{Bvh, PairTask};
use crate::geometry::distance::closest_on_segment;

/// Distance from the path of a node within which it may meet something: so far [m], and this share of its edges.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inflation {
    /// For all nodes alike [m].
    pub gap: f64,
    /// As a share of the edges of each.
    pub margin: f64,
}

/// Pairs that were found along paths.
pub(crate) struct SweptPairs<'a> {
    /// Marks of the own nodes that have left their paths since, over local nodes.
    pub left: &'a mut Vec<u8>,
    /// The pairs, in pieces.
    pub found: &'a mut Vec<Vec<Pair>>,
}

impl Inflation {
    /// The box of a node.
    fn swept(&self, surface: &ContactSurface, paths: &NodePaths, shift: &Vec3, node: usize) -> Aabb {
        let reach = self.gap + self.margin * surface.edge_length()[node];
        Aabb::around_path([&paths.start[node], &paths.end[node]], shift, reach)
    }
}

/// The paths searched last.
struct SearchedPaths<'a> {
    surface: &'a ContactSurface,
    start: &'a [Vec3],
    /// Ends, less the common displacement [m].
    ends: &'a [Vec3],
    inflation: Inflation,
}

impl SearchedPaths<'_> {
    /// Whether a pair may meet with each node anywhere on its path.
    fn may_meet(&self, pair: &Pair) -> bool {
        let [a, b] = pair.fold(self.surface.edge_length(), f64::max);
        let limit = BEYOND_GAP * self.inflation.gap + self.inflation.margin * (a + b);
        !pair.is_beyond_between([&pair.positions(self.start), &pair.positions(self.ends)], limit)
    }
}

impl PairSearch {
    /// Finds the pairs of this rank that may come within `inflation` on their paths. All ranks call it together. Ghosts may come
    /// to the ones there are: then the paths and the proximity list are laid out anew, and what nodes are called now is
    /// returned.
    pub(crate) fn swept_pairs(
        &mut self,
        surface: &mut ContactSurface,
        proximity: &mut ProximityList,
        paths: &mut NodePaths,
        inflation: Inflation,
        found: &mut Vec<Vec<Pair>>,
    ) -> Option<IndexMap> {
        let renumber = self.fit_to_paths(surface, proximity, paths, inflation);
        // Those found before are not in memory beside them.
        found.clear();
        let searched = self.searched_paths(surface, paths, inflation);
        let keep = |pair: Pair, out: &mut Vec<Pair>| {
            if searched.may_meet(&pair) {
                out.push(pair);
            }
        };
        *found = self.pieces_of_pairs(surface, keep, &Vec::shrink_to_fit);
        renumber
    }

    /// Adds to `found` the pairs of this rank that may come within `inflation` on their paths and have a marked node, and takes out those
    /// that it had. All ranks call it together, and everything is as with [`PairSearch::swept_pairs`].
    pub(crate) fn swept_pairs_of_marked(
        &mut self,
        surface: &mut ContactSurface,
        proximity: &mut ProximityList,
        paths: &mut NodePaths,
        inflation: Inflation,
        SweptPairs { left, found }: SweptPairs<'_>,
    ) -> Option<IndexMap> {
        let renumber = self.fit_to_paths(surface, proximity, paths, inflation);
        if let Some(renumber) = &renumber {
            renumber.apply(left, 0);
            renumber.renumber(found.iter_mut().flatten().flat_map(|pair| &mut pair.nodes));
        }
        surface.nodes().update(left);
        let searched = self.searched_paths(surface, paths, inflation);
        self.replace_pairs_of_marked(&searched, left, found);
        renumber
    }

    /// Fits all boxes and trees to the paths, those of ghosts too. Returns the new numbers of the nodes, unless nothing has changed.
    fn fit_to_paths(
        &mut self,
        surface: &mut ContactSurface,
        proximity: &mut ProximityList,
        paths: &mut NodePaths,
        inflation: Inflation,
    ) -> Option<IndexMap> {
        // What all do alike brings no two of them closer.
        let shift = proximity.common_shift();
        self.shift = shift;
        self.refit(surface, |i| inflation.swept(surface, paths, &shift, i));
        let renumber = self.import_ghosts(surface);
        if let Some(renumber) = &renumber {
            lay_out(renumber, surface, proximity, paths);
        }
        self.refit_ghosts(surface, |i| inflation.swept(surface, paths, &shift, i));
        self.path_ends.clear();
        self.path_ends.extend(paths.end.iter().map(|end| end - shift));
        renumber
    }

    /// Returns the paths searched last.
    fn searched_paths<'a>(
        &'a self,
        surface: &'a ContactSurface,
        paths: &'a NodePaths,
        inflation: Inflation,
    ) -> SearchedPaths<'a> {
        SearchedPaths { surface, start: &paths.start, ends: &self.path_ends, inflation }
    }

    /// Brings the pairs found last along paths to those with the present ends of the nodes that left their paths. All ranks call
    /// it together, and everything is as with [`PairSearch::swept_pairs`].
    pub(crate) fn update_swept_pairs(
        &mut self,
        surface: &mut ContactSurface,
        proximity: &mut ProximityList,
        paths: &mut NodePaths,
        inflation: Inflation,
        SweptPairs { left, found }: SweptPairs<'_>,
    ) -> Option<IndexMap> {
        for node in surface.nodes().own().filter(|node| left[*node] != 0) {
            self.node_boxes[node] = inflation.swept(surface, paths, &self.shift, node);
            self.path_ends[node] = paths.end[node] - self.shift;
        }
        // The path of a ghost is its owner's, who judges whether it is left.
        self.exchange(surface.nodes(), left);
        self.cloth.refit(surface.cloth(), &self.node_boxes, surface.groups());
        let renumber = self.import_ghosts(surface);
        if let Some(renumber) = &renumber {
            lay_out(renumber, surface, proximity, paths);
            renumber.apply(left, 0);
            renumber.apply(&mut self.path_ends, Vec3::zeros());
            renumber.renumber(found.iter_mut().flatten().flat_map(|pair| &mut pair.nodes));
            self.exchange(surface.nodes(), left);
        }
        if !surface.ranks().is_alone() {
            self.ghost_bvh.refit(&self.ghosts, &self.node_boxes, surface.groups());
        }
        let searched = self.searched_paths(surface, paths, inflation);
        self.replace_pairs_of_marked(&searched, left, found);
        renumber
    }

    /// Replaces the pairs with a marked node by those that may meet.
    fn replace_pairs_of_marked(&self, searched: &SearchedPaths<'_>, marks: &[u8], found: &mut Vec<Vec<Pair>>) {
        let concerned = |pair: &Pair| pair.nodes.iter().any(|node| marks[*node as usize] != 0);
        found.iter_mut().for_each(|piece| piece.retain(|pair| !concerned(pair)));
        let keep = |pair: Pair, out: &mut Vec<Pair>| {
            if concerned(&pair) && searched.may_meet(&pair) {
                out.push(pair);
            }
        };
        self.pairs_with(searched.surface, marks, keep, found);
    }

    /// Whether the pairs found last along paths hold for a node that goes from `start` to `end` instead, up to `margin` [m] beside its path.
    pub(crate) fn covers(&self, node: u32, [start, end]: [&Vec3; 2], margin: f64) -> bool {
        let (end, path_end) = (end - self.shift, &self.path_ends[node as usize]);
        let nearest = start + (path_end - start) * closest_on_segment(&end, start, path_end);
        (end - nearest).norm_squared() <= margin * margin
    }

    /// Brings the ghosts' boxes, paths and marks to those of their owners.
    fn exchange(&mut self, nodes: &ContactNodes, mut marks: &mut [u8]) {
        nodes.update_all(&mut [&mut self.node_boxes, &mut self.path_ends, &mut marks]);
    }

    /// Adds what `keep` makes of every pair of this rank whose boxes overlap and of which one triangle has a marked node.
    fn pairs_with(
        &self,
        surface: &ContactSurface,
        marks: &[u8],
        keep: impl Fn(Pair, &mut Vec<Pair>) + Sync,
        found: &mut Vec<Vec<Pair>>,
    ) {
        let [cloth, bodies, ghosts] = self.sides(surface);
        let [marked, marked_bodies, marked_ghosts] = [cloth, bodies, ghosts].map(|side| side.marked(marks));
        // Two marked triangles of cloth meet once; those of ghosts meet marked ones as the others do.
        let searches = [
            (&marked.tree, cloth, &cloth.fitted.tree),
            (&marked.tree, bodies, &bodies.fitted.tree),
            (&marked.tree, ghosts, &ghosts.fitted.tree),
            (&cloth.fitted.tree, ghosts, &marked_ghosts.tree),
            (&cloth.fitted.tree, bodies, &marked_bodies.tree),
        ];
        let work = |search: usize, task: &PairTask| {
            let (tree, other, others) = searches[search];
            let triangles = |s: u32, t: u32| match search {
                0..=2 => (marked.triangles[s as usize], t),
                3 => (s, marked_ghosts.triangles[t as usize]),
                _ => (s, marked_bodies.triangles[t as usize]),
            };
            let is_new = |s: u32, t: u32| match search {
                0 => s < t || !cloth.has(t, marks),
                1 | 2 => true,
                _ => !cloth.has(s, marks),
            };
            let mut out = Vec::new();
            tree.pairs_of(task, others, None, &mut |s, t| {
                let (s, t) = triangles(s, t);
                if is_new(s, t)
                    && cloth.overlaps(s, other, t)
                    && !surface.is_ignored(cloth.corners(s), other.corners(t))
                {
                    self.test_triangles((cloth, s), (other, t), &keep, &mut out);
                }
            });
            out
        };
        let mut tasks: Vec<(usize, PairTask)> = Vec::new();
        for (search, (tree, _, others)) in searches.iter().enumerate() {
            if !tree.is_empty() && !others.is_empty() {
                tasks.extend(tree.tasks_with(others, TASKS).into_iter().map(|task| (search, task)));
            }
        }
        found.par_extend(tasks.par_iter().map(|(search, task)| work(*search, task)).filter(|piece| !piece.is_empty()));
    }
}

impl Side<'_> {
    /// Whether a triangle has a marked node.
    fn has(&self, triangle: u32, marks: &[u8]) -> bool {
        self.faces.triangles()[triangle as usize].iter().any(|node| marks[*node as usize] != 0)
    }

    /// The triangles with a marked node.
    fn marked(&self, marks: &[u8]) -> MarkedTriangles {
        let all = 0..self.faces.triangles().len() as u32;
        let triangles: Vec<u32> = all.filter(|triangle| self.has(*triangle, marks)).collect();
        let boxes: Vec<Aabb> = triangles.iter().map(|t| self.fitted.triangle_boxes[*t as usize]).collect();
        MarkedTriangles { triangles, tree: Bvh::build(&boxes) }
    }
}

/// Some triangles of a side.
struct MarkedTriangles {
    /// Their places in the side.
    triangles: Vec<u32>,
    /// A tree over them alone.
    tree: Bvh,
}

/// Lays the paths and the proximity list out for other ghosts.
fn lay_out(renumber: &IndexMap, surface: &ContactSurface, proximity: &mut ProximityList, paths: &mut NodePaths) {
    paths.renumber(renumber);
    paths.refresh(surface.nodes());
    proximity.renumber(renumber, surface);
}

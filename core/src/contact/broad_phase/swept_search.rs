//! The search along paths, and its renewal where nodes have left what was searched.
//!
//! While collisions are resolved, a few nodes at a time come to leave their boxes. Only what these may meet is searched again.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::broad_phase::bvh_search::{PairSearch, Side, TASKS};
use crate::contact::broad_phase::proximity_list::ProximityList;
use crate::contact::topology::nodes::NodePaths;
use crate::contact::topology::nodes::{ContactNodes, IndexMap};
use crate::contact::topology::pair::Pair;
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::{Bvh, PairTask};

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
    /// Marks of the own nodes that have left their boxes since, over local nodes.
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
        *found = self.pieces_of_pairs(surface, |pair, out: &mut Vec<Pair>| out.push(pair), &Vec::shrink_to_fit);
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
        self.replace_pairs_of_marked(surface, left, found);
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
        renumber
    }

    /// Brings the pairs found last along paths to those with the present ends of the nodes that left their boxes. All ranks call
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
        }
        // The box of a ghost is that of its owner, who judges whether it is left.
        self.exchange(surface.nodes(), left);
        self.cloth.refit(surface.cloth(), &self.node_boxes, surface.groups());
        let renumber = self.import_ghosts(surface);
        if let Some(renumber) = &renumber {
            lay_out(renumber, surface, proximity, paths);
            renumber.apply(left, 0);
            renumber.renumber(found.iter_mut().flatten().flat_map(|pair| &mut pair.nodes));
            self.exchange(surface.nodes(), left);
        }
        if !surface.ranks().is_alone() {
            self.ghost_bvh.refit(&self.ghosts, &self.node_boxes, surface.groups());
        }
        self.replace_pairs_of_marked(surface, left, found);
        renumber
    }

    /// Replaces the pairs with a marked node by those whose boxes overlap.
    fn replace_pairs_of_marked(&self, surface: &ContactSurface, marks: &[u8], found: &mut Vec<Vec<Pair>>) {
        let concerned = |pair: &Pair| pair.nodes.iter().any(|node| marks[*node as usize] != 0);
        found.iter_mut().for_each(|piece| piece.retain(|pair| !concerned(pair)));
        let keep = |pair: Pair, out: &mut Vec<Pair>| out.extend(Some(pair).filter(concerned));
        self.pairs_with(surface, marks, keep, found);
    }

    /// Whether the pairs found last along paths hold for a node with this end.
    pub(crate) fn covers(&self, node: u32, end: &Vec3) -> bool {
        let (bounds, end) = (&self.node_boxes[node as usize], end - self.shift);
        (0..3).all(|k| f64::from(bounds.min[k]) <= end[k] && end[k] <= f64::from(bounds.max[k]))
    }

    /// Brings the ghosts' boxes and marks to those of their owners.
    fn exchange(&mut self, nodes: &ContactNodes, mut marks: &mut [u8]) {
        nodes.update_all(&mut [&mut self.node_boxes, &mut marks]);
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
        let [marked, marked_bodies, marked_ghosts] = [cloth, bodies, ghosts].map(|side| side.tree_where(marks));
        // Two marked triangles of cloth meet once; those of ghosts meet marked ones as the others do.
        let searches = [
            (&marked, cloth, &cloth.fitted.tree),
            (&marked, bodies, &bodies.fitted.tree),
            (&marked, ghosts, &ghosts.fitted.tree),
            (&cloth.fitted.tree, ghosts, &marked_ghosts),
            (&cloth.fitted.tree, bodies, &marked_bodies),
        ];
        let work = |search: usize, task: &PairTask| {
            let (tree, other, others) = searches[search];
            // Leaves of the trees of marked triangles hold others too.
            let is_new = |s: u32, t: u32| match search {
                0 => cloth.has(s, marks) && (s < t || !cloth.has(t, marks)),
                1 | 2 => cloth.has(s, marks),
                3 => ghosts.has(t, marks) && !cloth.has(s, marks),
                _ => bodies.has(t, marks) && !cloth.has(s, marks),
            };
            let mut out = Vec::new();
            tree.pairs_of(task, others, None, &mut |s, t| {
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

    /// The tree in which only triangles with a marked node are anywhere.
    fn tree_where(&self, marks: &[u8]) -> Bvh {
        let mut tree = self.fitted.tree.clone();
        let boxes = &self.fitted.triangle_boxes;
        tree.refit(|t| if self.has(t, marks) { boxes[t as usize] } else { Aabb::EMPTY });
        tree
    }
}

/// Lays the paths and the proximity list out for other ghosts.
fn lay_out(renumber: &IndexMap, surface: &ContactSurface, proximity: &mut ProximityList, paths: &mut NodePaths) {
    paths.renumber(renumber);
    paths.refresh(surface.nodes());
    proximity.renumber(renumber, surface);
}

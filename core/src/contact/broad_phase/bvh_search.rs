//! The search for pairs: trees over the triangles of cloth and of bodies.
//!
//! The caller gives every node a box; a pair is met when the boxes of its primitives, which join those of their nodes,
//! overlap. With boxes around points this finds what is close; with boxes around paths, what may have met.
//!
//! Every pair is found on one rank, that of its smallest node. On many ranks a search has three steps: `refit`, after which
//! `import_ghosts` lets the triangles of other ranks in, whose nodes are ghosts then, and `refit_ghosts` when these have their values.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::broad_phase::ghost_triangles;
use crate::contact::broad_phase::ghost_triangles::GhostTriangle;
use crate::contact::topology::faces::Faces;
use crate::contact::topology::nodes::IndexMap;
use crate::contact::topology::pair::{Pair, PairKind};
use crate::contact::topology::surface::{ContactSurface, ObjectGroups};
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::{Bvh, GroupFilter, GroupMasks, PairTask};
use crate::geometry::tolerances::REBUILD_COST;

/// Pieces of a search: enough for many threads, few enough for their overhead not to show.
pub(super) const TASKS: usize = 256;

/// Nodes and triangles whose boxes one task makes.
const CHUNK: usize = 4096;

/// Trees over the surfaces of a scene.
#[derive(Debug)]
pub(crate) struct PairSearch {
    pub(super) node_boxes: Vec<Aabb>,
    pub(super) cloth: RefittedBvh,
    pub(super) bodies: RefittedBvh,
    /// Triangles of higher ranks, for one search.
    pub(super) ghosts: Faces,
    pub(super) ghost_bvh: RefittedBvh,
    /// Displacement common to all nodes on the paths searched last, taken out before the search [m].
    pub(super) shift: Vec3,
    /// Ends of the paths searched last, less that displacement [m].
    pub(super) path_ends: Vec<Vec3>,
}

/// Boxes of triangles and of the edges that hang on them, and a tree over the triangles.
#[derive(Debug)]
pub(super) struct RefittedBvh {
    pub(super) triangle_boxes: Vec<Aabb>,
    pub(super) edge_boxes: Vec<Aabb>,
    pub(super) tree: Bvh,
    built_cost: f64,
    /// Groups of objects below each node of the tree; `None` if nothing ignores anything.
    masks: Option<GroupMasks>,
}

/// Triangles with their boxes.
#[derive(Clone, Copy)]
pub(super) struct Side<'a> {
    pub(super) faces: &'a Faces,
    pub(super) fitted: &'a RefittedBvh,
}

impl RefittedBvh {
    /// Boxes of nothing.
    fn empty() -> Self {
        let (triangle_boxes, edge_boxes) = (Vec::new(), Vec::new());
        Self { triangle_boxes, edge_boxes, tree: Bvh::build(&[]), built_cost: 0.0, masks: None }
    }

    /// Makes the boxes from those of the nodes and fits the tree to them; builds it anew where motion has spoiled it.
    pub(super) fn refit(&mut self, faces: &Faces, nodes: &[Aabb], groups: Option<ObjectGroups<'_>>) {
        self.triangle_boxes.resize(faces.triangles().len(), Aabb::EMPTY);
        self.edge_boxes.resize(faces.edges().len(), Aabb::EMPTY);
        let chunks = self.triangle_boxes.par_chunks_mut(CHUNK).zip(faces.triangles().par_chunks(CHUNK));
        chunks.for_each(|(boxes, triangles)| {
            for (b, [i, j, k]) in boxes.iter_mut().zip(triangles) {
                *b = nodes[*i as usize].union(&nodes[*j as usize]).union(&nodes[*k as usize]);
            }
        });
        let chunks = self.edge_boxes.par_chunks_mut(CHUNK).zip(faces.edges().par_chunks(CHUNK));
        chunks.for_each(|(boxes, edges)| {
            for (b, [i, j]) in boxes.iter_mut().zip(edges) {
                *b = nodes[*i as usize].union(&nodes[*j as usize]);
            }
        });
        let boxes = &self.triangle_boxes;
        if self.tree.len() == boxes.len() {
            self.tree.refit(|t| boxes[t as usize]);
            if self.tree.cost() <= REBUILD_COST * self.built_cost {
                return;
            }
        }
        self.tree = Bvh::build(boxes);
        self.built_cost = self.tree.cost();
        self.masks = groups
            .map(|groups| self.tree.group_masks(|triangle| groups.of_element(&faces.triangles()[triangle as usize])));
    }

    /// Filter of a search between this tree and another one.
    pub(super) fn filter<'a>(
        &'a self,
        other: &'a Self,
        may_meet: Option<&'a (dyn Fn(u64, u64) -> bool + Sync)>,
    ) -> Option<GroupFilter<'a>> {
        let masks = [self.masks.as_ref()?, other.masks.as_ref()?];
        Some(GroupFilter { masks, may_meet: may_meet? })
    }

    fn bytes(&self) -> usize {
        let masks = self.masks.as_ref().map_or(0, GroupMasks::bytes);
        (self.edge_boxes.len() + 4 * self.triangle_boxes.len()) * size_of::<Aabb>() + masks
    }
}

impl PairSearch {
    /// A search without boxes yet.
    pub(crate) fn new() -> Self {
        let [cloth, bodies, ghost_bvh] = [(); 3].map(|()| RefittedBvh::empty());
        let (ghosts, shift) = (Faces::default(), Vec3::zeros());
        Self { node_boxes: Vec::new(), cloth, bodies, ghosts, ghost_bvh, shift, path_ends: Vec::new() }
    }

    /// Memory held [bytes], trees estimated at two nodes a triangle.
    pub(crate) fn bytes(&self) -> usize {
        let boxes = self.node_boxes.len() * size_of::<Aabb>() + size_of_val(self.path_ends.as_slice());
        boxes + self.cloth.bytes() + self.bodies.bytes() + self.ghost_bvh.bytes() + self.ghosts.bytes()
    }

    /// Gives every node its box and fits the trees.
    pub(crate) fn refit(&mut self, surface: &ContactSurface, box_of: impl Fn(usize) -> Aabb + Sync) {
        self.node_boxes.resize(surface.nodes().count(), Aabb::EMPTY);
        let chunks = self.node_boxes.par_chunks_mut(CHUNK).enumerate();
        chunks.for_each(|(c, boxes)| boxes.iter_mut().enumerate().for_each(|(i, b)| *b = box_of(c * CHUNK + i)));
        self.cloth.refit(surface.cloth(), &self.node_boxes, surface.groups());
        self.bodies.refit(surface.bodies(), &self.node_boxes, surface.groups());
        if !self.ghosts.triangles().is_empty() {
            (self.ghosts, self.ghost_bvh) = (Faces::default(), RefittedBvh::empty());
        }
    }

    /// Imports the triangles of higher ranks that may meet those of this rank: their nodes become ghosts, besides those there
    /// are. All ranks call it together after `refit`. Returns the new numbers of the nodes, unless nothing has changed.
    pub(crate) fn import_ghosts(&mut self, surface: &mut ContactSurface) -> Option<IndexMap> {
        if surface.ranks().is_alone() {
            return None;
        }
        let RefittedBvh { tree, triangle_boxes, .. } = &self.cloth;
        let imported: Vec<GhostTriangle> =
            ghost_triangles::exchange_ghosts(surface.nodes(), surface.cloth(), tree, triangle_boxes);
        let numbers = imported.iter().flat_map(|ghost| ghost.corners);
        let mut ghosts: Vec<u32> = numbers.filter(|number| !surface.nodes().owns(*number)).collect();
        ghosts.extend_from_slice(surface.nodes().ghosts());
        ghosts.sort_unstable();
        ghosts.dedup();
        let renumber = surface.set_ghosts(ghosts);
        let local =
            |number: u32| surface.nodes().local(number).expect("the nodes of ghost triangles are own or ghosts");
        let triangles = imported.iter().map(|ghost| ghost.corners.map(local)).collect();
        let owned: Vec<u32> = imported.iter().map(|ghost| ghost.owned_features).collect();
        self.ghosts = Faces::from_bits(triangles, &owned);
        if let Some(renumber) = &renumber {
            renumber.apply(&mut self.node_boxes, Aabb::EMPTY);
        }
        renumber
    }

    /// Gives the ghosts their boxes, and refits the tree of the ghost triangles.
    pub(crate) fn refit_ghosts(&mut self, surface: &ContactSurface, box_of: impl Fn(usize) -> Aabb) {
        let nodes = surface.nodes();
        if nodes.ranks().is_alone() {
            return;
        }
        nodes.ghost_places().for_each(|i| self.node_boxes[i] = box_of(i));
        self.ghost_bvh.refit(&self.ghosts, &self.node_boxes, surface.groups());
    }

    /// A tree over the triangles of cloth, and one over those of the bodies, with the boxes given last.
    pub(crate) fn trees(&self) -> [&Bvh; 2] {
        [&self.cloth.tree, &self.bodies.tree]
    }

    /// Boxes of the triangles of cloth.
    pub(crate) fn cloth_boxes(&self) -> &[Aabb] {
        &self.cloth.triangle_boxes
    }

    /// Meets every pair of this rank whose boxes overlap, once, and keeps what `keep` makes of it. Primitives that share a node
    /// are no pair. The order depends on the trees: sort what order matters for. There is a piece for each task, since all may be too long
    /// to be in memory twice; `finish` ends each.
    pub(super) fn pieces_of_pairs<P: Default + Send>(
        &self,
        surface: &ContactSurface,
        keep: impl Fn(Pair, &mut P) + Sync,
        finish: &(impl Fn(&mut P) + Sync),
    ) -> Vec<P> {
        let [cloth, bodies, ghosts] = self.sides(surface);
        let tree = &self.cloth.tree;
        let groups = surface.groups().map(|groups| groups.groups());
        let may_meet = groups.map(|groups| move |these, those| groups.may_touch(these, those));
        let may_meet = may_meet.as_ref().map(|may_meet| may_meet as &(dyn Fn(u64, u64) -> bool + Sync));
        let work = |other: Side<'_>, task: &PairTask| {
            let mut out = P::default();
            let mut meet = |s, t| {
                if cloth.overlaps(s, other, t) && !surface.is_ignored(cloth.corners(s), other.corners(t)) {
                    self.test_triangles((cloth, s), (other, t), &keep, &mut out);
                }
            };
            let filter = self.cloth.filter(other.fitted, may_meet);
            tree.pairs_of(task, &other.fitted.tree, filter.as_ref(), &mut meet);
            finish(&mut out);
            out
        };
        let mut tasks: Vec<(Side<'_>, PairTask)> = tree.self_tasks(TASKS).into_iter().map(|t| (cloth, t)).collect();
        for other in [bodies, ghosts].into_iter().filter(|other| !other.fitted.tree.is_empty()) {
            tasks.extend(tree.tasks_with(&other.fitted.tree, TASKS).into_iter().map(|task| (other, task)));
        }
        tasks.par_iter().map(|(other, task)| work(*other, task)).collect()
    }

    /// Cloth, bodies and ghosts.
    pub(super) fn sides<'a>(&'a self, surface: &'a ContactSurface) -> [Side<'a>; 3] {
        [(surface.cloth(), &self.cloth), (surface.bodies(), &self.bodies), (&self.ghosts, &self.ghost_bvh)]
            .map(|(faces, fitted)| Side { faces, fitted })
    }

    /// The pairs of points, triangles and edges that belong to two triangles.
    #[inline]
    pub(super) fn test_triangles<P>(
        &self,
        one: (Side<'_>, u32),
        other: (Side<'_>, u32),
        keep: &impl Fn(Pair, &mut P),
        out: &mut P,
    ) {
        let (s, t) = (one.1, other.1);
        let [own_boxes, boxes] = [one.0.fitted, other.0.fitted];
        let triangle_box = &boxes.triangle_boxes[t as usize];
        self.points_against(one, other, keep, out);
        self.points_against(other, one, keep, out);
        let others = other.0.faces.edges_of(t);
        for e in one.0.faces.edges_of(s) {
            let own = &own_boxes.edge_boxes[e];
            if !own.overlaps(triangle_box) {
                continue;
            }
            let [a, b] = one.0.faces.edges()[e];
            let edges = &other.0.faces.edges()[others.clone()];
            for (&[c, d], bounds) in edges.iter().zip(&boxes.edge_boxes[others.clone()]) {
                let apart = (a != c) & (a != d) & (b != c) & (b != d);
                if apart & own.overlaps(bounds) {
                    let nodes = if [a, b] < [c, d] { [a, b, c, d] } else { [c, d, a, b] };
                    keep(Pair { kind: PairKind::EdgeEdge, nodes }, out);
                }
            }
        }
    }

    /// The points that hang on one triangle against another.
    #[inline]
    fn points_against<P>(
        &self,
        (one, s): (Side<'_>, u32),
        (other, t): (Side<'_>, u32),
        keep: &impl Fn(Pair, &mut P),
        out: &mut P,
    ) {
        if !other.faces.is_face(t) {
            return;
        }
        let corners = other.faces.triangles()[t as usize];
        let triangle_box = &other.fitted.triangle_boxes[t as usize];
        for &p in one.faces.points(s) {
            if !corners.contains(&p) && self.node_boxes[p as usize].overlaps(triangle_box) {
                keep(Pair { kind: PairKind::PointTriangle, nodes: [p, corners[0], corners[1], corners[2]] }, out);
            }
        }
    }
}

impl Side<'_> {
    /// Whether the boxes of a triangle and one of another side overlap.
    #[inline]
    pub(super) fn overlaps(&self, triangle: u32, other: Self, its: u32) -> bool {
        self.fitted.triangle_boxes[triangle as usize].overlaps(&other.fitted.triangle_boxes[its as usize])
    }

    /// The nodes of a triangle.
    #[inline]
    pub(super) fn corners(&self, triangle: u32) -> &[u32; 3] {
        &self.faces.triangles()[triangle as usize]
    }
}

impl Default for PairSearch {
    fn default() -> Self {
        Self::new()
    }
}

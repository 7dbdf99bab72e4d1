//! The search for pairs: trees over the triangles of cloth and of deforming bodies.
//!
//! The caller gives every node a box; a pair is met when the boxes of its primitives, which join those of their nodes,
//! overlap. With boxes around points this finds what is close; with boxes around paths, what may have met.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::pair::{Pair, PairKind};
use crate::contact::surface::ContactSurface;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;
use crate::geometry::crossings::{self, Crossing, Surface};
use crate::geometry::tolerances::REBUILD_COST;

/// Pieces of a search: enough for many threads, few enough for their overhead not to show.
const TASKS: usize = 256;

/// Nodes and triangles whose boxes one task makes.
const CHUNK: usize = 4096;

/// Trees over the surfaces of a scene.
#[derive(Debug)]
pub struct PairSearch {
    node_boxes: Vec<Aabb>,
    triangle_boxes: Vec<Aabb>,
    edge_boxes: Vec<Aabb>,
    cloth: Tree,
    bodies: Tree,
}

#[derive(Debug)]
struct Tree {
    bvh: Bvh,
    built_cost: f64,
}

impl Tree {
    /// A tree without triangles.
    fn empty() -> Self {
        Self { bvh: Bvh::build(&[]), built_cost: 0.0 }
    }

    /// Fits the tree to the boxes; builds it anew where motion has spoiled it.
    fn fit(&mut self, boxes: &[Aabb]) {
        if self.bvh.len() == boxes.len() {
            self.bvh.refit(|t| boxes[t as usize]);
            if self.bvh.cost() <= REBUILD_COST * self.built_cost {
                return;
            }
        }
        self.bvh = Bvh::build(boxes);
        self.built_cost = self.bvh.cost();
    }
}

impl PairSearch {
    /// A search over a surface, without boxes yet.
    pub fn new(surface: &ContactSurface) -> Self {
        Self {
            node_boxes: vec![Aabb::EMPTY; surface.node_count()],
            triangle_boxes: vec![Aabb::EMPTY; surface.triangles().len()],
            edge_boxes: vec![Aabb::EMPTY; surface.edges().len()],
            cloth: Tree::empty(),
            bodies: Tree::empty(),
        }
    }

    /// Memory held [bytes], trees estimated at two nodes a triangle.
    pub fn bytes(&self) -> usize {
        (self.node_boxes.len() + self.edge_boxes.len() + 4 * self.triangle_boxes.len()) * size_of::<Aabb>()
    }

    /// Gives every node its box and fits the trees.
    pub fn fit(&mut self, surface: &ContactSurface, box_of: impl Fn(usize) -> Aabb + Sync) {
        let chunks = self.node_boxes.par_chunks_mut(CHUNK).enumerate();
        chunks.for_each(|(c, boxes)| boxes.iter_mut().enumerate().for_each(|(i, b)| *b = box_of(c * CHUNK + i)));
        let nodes = &self.node_boxes;
        let chunks = self.triangle_boxes.par_chunks_mut(CHUNK).zip(surface.triangles().par_chunks(CHUNK));
        chunks.for_each(|(boxes, triangles)| {
            for (b, [i, j, k]) in boxes.iter_mut().zip(triangles) {
                *b = nodes[*i as usize].union(&nodes[*j as usize]).union(&nodes[*k as usize]);
            }
        });
        let chunks = self.edge_boxes.par_chunks_mut(CHUNK).zip(surface.edges().par_chunks(CHUNK));
        chunks.for_each(|(boxes, edges)| {
            for (b, [i, j]) in boxes.iter_mut().zip(edges) {
                *b = nodes[*i as usize].union(&nodes[*j as usize]);
            }
        });
        let (cloth, bodies) = self.triangle_boxes.split_at(surface.cloth_triangles());
        self.cloth.fit(cloth);
        self.bodies.fit(bodies);
    }

    /// Whether the box of a node contains a point, so that pairs found for the box hold for it.
    pub fn covers(&self, node: u32, point: &Vec3) -> bool {
        let bounds = &self.node_boxes[node as usize];
        (0..3).all(|k| f64::from(bounds.min[k]) <= point[k] && point[k] <= f64::from(bounds.max[k]))
    }

    /// Meets every pair with a cloth node whose boxes overlap, once, and keeps what `keep` makes of it. Primitives that
    /// share a node are no pair. The order depends on the trees: sort what order matters for.
    pub fn pairs<T: Send>(
        &self,
        surface: &ContactSurface,
        keep: impl Fn(Pair, &mut Vec<T>) + Sync,
        found: &mut Vec<T>,
    ) {
        let own = self.cloth.bvh.self_tasks(TASKS);
        let inside = own.par_iter().map(|task| {
            let mut out = Vec::new();
            let mut meet = |s, t| self.meet(surface, s, t, &keep, &mut out);
            self.cloth.bvh.pairs_of(task, &self.cloth.bvh, &mut meet);
            out
        });
        let first = surface.cloth_triangles() as u32;
        let mixed = self.cloth.bvh.tasks_with(&self.bodies.bvh, TASKS);
        let between = mixed.par_iter().map(|task| {
            let mut out = Vec::new();
            let mut meet = |s, t| self.meet(surface, s, t + first, &keep, &mut out);
            self.cloth.bvh.pairs_of(task, &self.bodies.bvh, &mut meet);
            out
        });
        let pieces: Vec<Vec<T>> = inside.chain(between).collect();
        found.clear();
        found.extend(pieces.into_iter().flatten());
    }

    /// Edges of cloth that pass through triangles, of cloth or of bodies, and edges of bodies through cloth, with the nodes at
    /// `x` [m] inside the boxes given last; only around the nodes in `only` (ascending) if given.
    pub fn crossings(&self, surface: &ContactSurface, x: &[Vec3], only: Option<&[u32]>) -> Vec<Crossing> {
        let (cloth, bodies) = surface.triangles().split_at(surface.cloth_triangles());
        let [cloth_owners, body_owners] = surface.edge_owners();
        let cloth = Surface { triangles: cloth, owners: cloth_owners, positions: x, tree: &self.cloth.bvh };
        let bodies = Surface { triangles: bodies, owners: body_owners, positions: x, tree: &self.bodies.bvh };
        let mut found = match only {
            Some(only) => crossings::find_moved(&cloth, |node| only.binary_search(&node).is_ok()),
            None => crossings::find(&cloth),
        };
        if !bodies.triangles.is_empty() {
            found.extend(crossings::find_between(&cloth, &bodies));
            found.extend(crossings::find_between(&bodies, &cloth));
            found.sort_unstable();
        }
        found
    }

    /// The pairs of points, triangles and edges that belong to two triangles.
    #[inline]
    fn meet<T>(&self, surface: &ContactSurface, s: u32, t: u32, keep: &impl Fn(Pair, &mut Vec<T>), out: &mut Vec<T>) {
        let boxes = [&self.triangle_boxes[s as usize], &self.triangle_boxes[t as usize]];
        if !boxes[0].overlaps(boxes[1]) {
            return;
        }
        self.points_against(surface, s, t, keep, out);
        self.points_against(surface, t, s, keep, out);
        let others = surface.owned_edges(t);
        for e in surface.owned_edges(s) {
            let own = &self.edge_boxes[e];
            if !own.overlaps(boxes[1]) {
                continue;
            }
            let [a, b] = surface.edges()[e];
            for (&[c, d], other) in surface.edges()[others.clone()].iter().zip(&self.edge_boxes[others.clone()]) {
                let apart = (a != c) & (a != d) & (b != c) & (b != d);
                if apart & own.overlaps(other) {
                    let nodes = if [a, b] < [c, d] { [a, b, c, d] } else { [c, d, a, b] };
                    keep(Pair { kind: PairKind::EdgeEdge, nodes }, out);
                }
            }
        }
    }

    /// The points that `s` owns against the triangle `t`.
    #[inline]
    fn points_against<T>(
        &self,
        surface: &ContactSurface,
        s: u32,
        t: u32,
        keep: &impl Fn(Pair, &mut Vec<T>),
        out: &mut Vec<T>,
    ) {
        let corners = surface.triangles()[t as usize];
        let triangle_box = &self.triangle_boxes[t as usize];
        for &p in surface.owned_nodes(s) {
            if !corners.contains(&p) && self.node_boxes[p as usize].overlaps(triangle_box) {
                keep(Pair { kind: PairKind::PointTriangle, nodes: [p, corners[0], corners[1], corners[2]] }, out);
            }
        }
    }
}

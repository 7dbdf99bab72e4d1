//! The list of pairs that are close: made by a search now and then, and used by many steps.
//!
//! Each node has a *reach*. As long as no node is farther than its reach from where it was when the list was made, every
//! pair within touching distance is in the list, and for each pair of it the distance then, less what its nodes have moved,
//! bounds the distance now. Most pairs are dismissed by that bound alone (method section 8, displacement bounds). Motion
//! that all nodes have in common does not count.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::common_motion::RigidFit;
use crate::contact::ordering::Order;
use crate::contact::pair::{Pair, PairKind};
use crate::contact::search::PairSearch;
use crate::contact::surface::ContactSurface;
use crate::contact::tolerances::USABLE_REACH;
use crate::geometry::aabb::Aabb;

/// Repulsions act on pairs closer than this times their thickness (method 3.11, detection multiplier).
pub const ACTIVE: f64 = 1.1;

/// Pairs of one garment that are closer at rest than this times the distance at which repulsions act are left out for good
/// (method 3.4, proximity turn-off).
const CLOSE_AT_REST: f64 = 1.5;

/// Nodes that one task moves.
const CHUNK: usize = 4096;

/// A pair of the list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// The pair.
    pub pair: Pair,
    /// Not more than its distance when the list was made [m].
    pub distance: f32,
    /// Thickness of the pair [m]; zero where repulsions do not act.
    pub thickness: f32,
}

/// The list.
#[derive(Debug)]
pub struct Neighbours {
    /// Points and triangles; then edges; each in the order of its colours if repulsions need one.
    lists: [Vec<Neighbour>; 2],
    orders: [Order; 2],
    /// Positions of the nodes when the list was made [m]; empty before.
    reference: Vec<Vec3>,
    /// Mean rest length of the edges of each node [m]: the measure of its reach.
    edge_length: Vec<f64>,
    /// Reach of the present list, as a share of those lengths.
    reach: f64,
    thickness: Vec<f64>,
    /// What every node has moved since the list was made, at most, besides the common motion [m].
    way: Vec<f64>,
    /// The common motion since the list was made, at both ends of the paths noted last.
    common: [RigidFit; 2],
    /// What the paths between those two leave of every distance at least.
    shortening: f64,
    coloured: bool,
}

impl Neighbours {
    /// An empty list over a surface. With `coloured` the pairs get colours.
    pub fn new(surface: &ContactSurface, coloured: bool) -> Self {
        let (edge_length, reach) = (surface.edge_length().to_vec(), 0.0);
        let mut thickness = surface.thickness().to_vec();
        thickness.resize(surface.node_count(), 0.0);
        let way = vec![0.0; surface.node_count()];
        let (lists, orders) = Default::default();
        let common = [RigidFit::new(&[], &[]); 2];
        let (reference, shortening) = (Vec::new(), 1.0);
        Self { lists, orders, reference, edge_length, reach, thickness, way, common, shortening, coloured }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        let pairs = self.lists.iter().map(Vec::capacity).sum::<usize>();
        pairs * size_of::<Neighbour>() + self.way.len() * (3 * size_of::<f64>() + size_of::<Vec3>())
    }

    /// Pairs of a kind, in the order of their colours.
    pub fn list(&self, kind: PairKind) -> &[Neighbour] {
        &self.lists[kind as usize]
    }

    /// Colours of the pairs of a kind.
    pub fn order(&self, kind: PairKind) -> &Order {
        &self.orders[kind as usize]
    }

    /// What nodes may move until the list lacks pairs, as a share of their edges.
    pub fn reach(&self) -> f64 {
        USABLE_REACH * self.reach
    }

    /// The reach that the list was made with, as a share of the nodes' edges.
    pub fn full_reach(&self) -> f64 {
        self.reach
    }

    /// Positions of the nodes when the list was made [m]; none before.
    pub fn reference(&self) -> &[Vec3] {
        &self.reference
    }

    /// Makes the list anew around `x`, the positions of all nodes [m], with a reach given as a share of the nodes' edges,
    /// and the gap that collisions keep [m].
    pub fn rebuild(&mut self, surface: &ContactSurface, search: &mut PairSearch, x: &[Vec3], reach: f64, gap: f64) {
        self.reach = reach;
        let (edges, thickness) = (&self.edge_length, &self.thickness);
        search.fit(surface, |i| Aabb::of_point(&x[i]).enlarged(ACTIVE * thickness[i] + reach * edges[i] + gap));
        let mut found: Vec<Neighbour> = Vec::new();
        let keep = |pair: Pair, out: &mut Vec<Neighbour>| {
            let [a, b] = pair.fold(edges, f64::max);
            let thick = pair_thickness(&pair, thickness);
            let limit = ACTIVE * thick + reach * (a + b) + gap;
            let distance_squared = pair.closest(&pair.positions(x)).apart.norm_squared();
            if distance_squared <= limit * limit {
                let distance = below(distance_squared.sqrt());
                let repels = surface.repels(&pair) && !is_close_at_rest(surface, &pair, thick);
                out.push(Neighbour { pair, distance, thickness: if repels { thick as f32 } else { 0.0 } });
            }
        };
        search.pairs(surface, keep, &mut found);
        let split = |kind| {
            let mut list: Vec<Neighbour> = found.iter().filter(|n| n.pair.kind == kind).copied().collect();
            if self.coloured {
                list.par_sort_unstable_by_key(|n| n.pair.nodes);
                let order = Order::of(&mut list, surface.nodes(), |n| n.pair.nodes);
                return (list, order);
            }
            (list, Order::default())
        };
        // One after the other: ranks agree on colours.
        let (points, edges) = (split(PairKind::PointTriangle), split(PairKind::EdgeEdge));
        self.lists = [points.0, edges.0];
        self.orders = [points.1, edges.1];
        self.reference.clear();
        self.reference.extend_from_slice(x);
    }

    /// Notes the way of every node on the straight path from `start` to `end` [m]. Returns the longest as a share of the
    /// node's edges: above the reach the list may lack pairs. Infinite before the list is made.
    pub fn note_ways(&mut self, start: &[Vec3], end: &[Vec3]) -> f64 {
        if self.reference.len() != self.way.len() {
            return f64::INFINITY;
        }
        self.common = [start, end].map(|now| RigidFit::new(&self.reference, now));
        self.shortening = self.common[0].shortening_to(&self.common[1]);
        let chunks = self.way.par_chunks_mut(CHUNK).enumerate();
        let largest = chunks.map(|(c, ways)| {
            let mut largest = 0.0_f64;
            for (i, way) in ways.iter_mut().enumerate() {
                let node = c * CHUNK + i;
                let from = &self.reference[node];
                let [a, b] =
                    [(start, 0), (end, 1)].map(|(x, at)| (x[node] - self.common[at].apply(from)).norm_squared());
                *way = a.max(b).sqrt();
                largest = largest.max(*way / self.edge_length[node]);
            }
            largest
        });
        // A path between two rotations shortens distances.
        largest.reduce(|| 0.0, f64::max) / self.shortening
    }

    /// Whether a node with a new end has moved no farther than noted, up to a share of its edges.
    pub fn covers(&self, node: usize, end: &Vec3, margin: f64) -> bool {
        self.way_to(node, end) <= self.way[node] + margin * self.edge_length[node]
    }

    /// Notes the way of one node again, after its end has changed. Returns it as a share of the node's edges.
    pub fn note_way(&mut self, node: usize, end: &Vec3) -> f64 {
        if self.reference.len() != self.way.len() {
            return f64::INFINITY;
        }
        self.way[node] = self.way[node].max(self.way_to(node, end));
        self.way[node] / (self.edge_length[node] * self.shortening)
    }

    fn way_to(&self, node: usize, end: &Vec3) -> f64 {
        (end - self.common[1].apply(&self.reference[node])).norm()
    }

    /// The pairs that may come within `gap` [m] on the paths noted last, also if all nodes move a share `margin` of their edges
    /// farther.
    pub fn close_pairs(&self, gap: f64, margin: f64, out: &mut Vec<Pair>) {
        out.clear();
        let may_meet = |n: &&Neighbour| {
            let [a, b] = n.pair.fold(&self.edge_length, f64::max);
            self.distance_bound(n) - margin * (a + b) <= gap
        };
        let chunks = self.lists[0].par_chunks(CHUNK).chain(self.lists[1].par_chunks(CHUNK));
        out.par_extend(chunks.flat_map_iter(|chunk| chunk.iter().filter(may_meet).map(|n| n.pair)));
    }

    /// A bound from below on the distance of a pair anywhere on the paths noted last [m].
    #[inline]
    pub fn distance_bound(&self, neighbour: &Neighbour) -> f64 {
        let [a, b] = neighbour.pair.fold(&self.way, f64::max);
        f64::from(neighbour.distance) * self.shortening - a - b
    }
}

/// `f32` not above a positive `x`.
fn below(x: f64) -> f32 {
    x as f32 * (1.0 - f32::EPSILON)
}

/// Thickness of a pair (method 3.2).
fn pair_thickness(pair: &Pair, thickness: &[f64]) -> f64 {
    let [a, b] = pair.fold(thickness, f64::min);
    a.max(b)
}

/// Whether the two belong to one garment and lie this close by construction.
fn is_close_at_rest(surface: &ContactSurface, pair: &Pair, thickness: f64) -> bool {
    let limit = CLOSE_AT_REST * ACTIVE * thickness;
    surface.is_one_garment(pair) && pair.closest(&pair.positions(surface.rest())).apart.norm_squared() <= limit * limit
}

#[cfg(test)]
mod tests;

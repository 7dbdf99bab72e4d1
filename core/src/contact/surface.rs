//! The triangles, edges and vertices that can touch: all garments, then all deforming bodies, in one numbering.
//!
//! *Nodes* are the cloth's vertices in solver order, followed by the points of the deforming bodies. Every node and every
//! edge is *owned* by the first triangle that has it. A search over pairs of triangles then meets each pair of a point and
//! a triangle, and each pair of edges, exactly once: in the pair of triangles of which one owns the point and the other is
//! the triangle, or which own the two edges.

use crate::Vec3;
use crate::bodies::Bodies;
use crate::contact::pair::Pair;
use crate::geometry::crossings::{Crossing, EdgeOwners};
use crate::scene::{BodyShape, Scene};

/// The surfaces of a scene that can touch.
#[derive(Debug)]
pub struct ContactSurface {
    triangles: Vec<[u32; 3]>,
    cloth_triangles: usize,
    cloth_nodes: usize,
    nodes: usize,
    /// Nodes and edges (the smaller node first) in the order of the triangles that own them.
    owned_nodes: Owned<u32>,
    owned_edges: Owned<[u32; 2]>,
    /// Which triangle of cloth, and of the bodies, speaks for which edge in exact checks.
    edge_owners: [EdgeOwners; 2],
    /// Deforming bodies and their first nodes, in the order of their nodes.
    bodies: Vec<(usize, u32)>,
    /// Thickness that repulsions keep around each cloth vertex [m].
    thickness: Vec<f64>,
    /// Cloth vertices at rest, in solver order [m].
    rest: Vec<Vec3>,
    /// Garment of each cloth vertex.
    garment: Vec<u32>,
    /// Mean rest length of the edges of each node [m]; of all cloth for bodies.
    edge_length: Vec<f64>,
    /// Every edge with each triangle that has it, ascending.
    edge_triangles: Vec<([u32; 2], u32)>,
}

impl ContactSurface {
    /// The surfaces of a scene; `clamp` is the largest thickness of a vertex as a fraction of its shortest rest edge.
    pub fn new(scene: &Scene, clamp: f64) -> Self {
        let parts = scene.parts();
        let mut triangles = Vec::new();
        for (g, mesh) in scene.meshes().iter().enumerate() {
            let solver = |v: u32| parts.garment(g).start as u32 + v;
            triangles.extend(mesh.triangles().iter().map(|t| t.map(solver)));
        }
        // Neighbours on the cloth become neighbours in memory, as the vertices are.
        triangles.sort_by_key(|t| t.iter().copied().min());
        let (cloth_triangles, cloth_nodes) = (triangles.len(), parts.local_count());
        let mut nodes = cloth_nodes;
        let mut bodies = Vec::new();
        for (body, description) in scene.description().bodies.iter().enumerate() {
            if let BodyShape::Surface { triangles: own, point_count } = &description.shape {
                triangles.extend(own.iter().map(|t| t.map(|v| v + nodes as u32)));
                bodies.push((body, nodes as u32));
                nodes += point_count;
            }
        }
        let owned_nodes = Owned::new(&triangles, |corners| *corners);
        let owned_edges = Owned::new(&triangles, edges_of);
        let sides = triangles.iter().zip(0..).flat_map(|(corners, t)| edges_of(corners).map(|edge| (edge, t)));
        let mut edge_triangles: Vec<_> = sides.collect();
        edge_triangles.sort_unstable();
        let (cloth, of_bodies) = triangles.split_at(cloth_triangles);
        let edge_owners = [cloth, of_bodies].map(EdgeOwners::new);
        let (mut rest, mut garment) = (vec![Vec3::zeros(); cloth_nodes], vec![0; cloth_nodes]);
        for solver in 0..cloth_nodes {
            let g = parts.garment_of(solver);
            rest[solver] = scene.meshes()[g].rest_positions()[solver - parts.garment(g).start];
            garment[solver] = g as u32;
        }
        let thickness = thicknesses(scene, clamp);
        let edge_length = edge_lengths(scene, nodes);
        Self {
            triangles,
            cloth_triangles,
            cloth_nodes,
            nodes,
            owned_nodes,
            owned_edges,
            edge_owners,
            bodies,
            thickness,
            rest,
            garment,
            edge_length,
            edge_triangles,
        }
    }

    /// Triangles: the cloth's, then the bodies'.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Triangles of cloth.
    pub fn cloth_triangles(&self) -> usize {
        self.cloth_triangles
    }

    /// Number of cloth vertices.
    pub fn cloth_nodes(&self) -> usize {
        self.cloth_nodes
    }

    /// Number of nodes, bodies included.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Thickness of each cloth vertex [m].
    pub fn thickness(&self) -> &[f64] {
        &self.thickness
    }

    /// Cloth vertices at rest, in solver order [m].
    pub fn rest(&self) -> &[Vec3] {
        &self.rest
    }

    /// Mean rest length of the edges of each node [m]; of all cloth for bodies.
    pub fn edge_length(&self) -> &[f64] {
        &self.edge_length
    }

    /// Longest entry of `edge_length` [m].
    pub fn longest_edge(&self) -> f64 {
        self.edge_length.iter().copied().fold(0.0, f64::max)
    }

    /// Which triangle of cloth, and of the bodies, speaks for which edge.
    pub fn edge_owners(&self) -> &[EdgeOwners; 2] {
        &self.edge_owners
    }

    /// Positions of all nodes [m]: cloth at `x`, bodies where they stand at the end of their step.
    pub fn gather(&self, x: &[Vec3], bodies: &Bodies, nodes: &mut Vec<Vec3>) {
        nodes.clear();
        nodes.extend_from_slice(x);
        self.bodies.iter().for_each(|(body, _)| nodes.extend_from_slice(bodies.surface_positions(*body)));
    }

    /// Whether all nodes of a pair are of one garment.
    pub fn is_one_garment(&self, pair: &Pair) -> bool {
        let [a, b, c, d] = pair.nodes.map(|node| self.garment[node as usize]);
        a == b && b == c && c == d
    }

    /// Whether repulsions act on a pair: between cloth and cloth; bodies have their own contact.
    pub fn repels(&self, pair: &Pair) -> bool {
        !pair.nodes.iter().any(|&node| self.is_body(node))
    }

    /// Whether an edge of cloth crosses a triangle of cloth, and no body has part in it.
    pub fn is_cloth(&self, crossing: &Crossing) -> bool {
        !crossing.edge.iter().chain(&crossing.triangle).any(|&node| self.is_body(node))
    }

    /// Whether cloth crosses a body where that body crosses itself.
    pub fn is_pinched(&self, crossing: &Crossing, bodies: &Bodies) -> bool {
        crossing.edge.iter().chain(&crossing.triangle).filter(|&&node| self.is_body(node)).any(|&node| {
            let last = self.bodies.partition_point(|(_, first)| *first <= node) - 1;
            let (body, first) = self.bodies[last];
            bodies.crosses_itself_at(body, node - first)
        })
    }

    /// Marks the corners of all triangles of cloth that have a marked corner.
    pub fn grow(&self, marked: &mut [bool]) {
        let touched: Vec<u32> = self.triangles[..self.cloth_triangles]
            .iter()
            .filter(|corners| corners.iter().any(|&node| marked[node as usize]))
            .flatten()
            .copied()
            .collect();
        touched.iter().for_each(|&node| marked[node as usize] = true);
    }

    /// Whether a node belongs to a body.
    pub fn is_body(&self, node: u32) -> bool {
        node as usize >= self.cloth_nodes
    }

    /// Nodes that a triangle owns.
    #[inline]
    pub fn owned_nodes(&self, triangle: u32) -> &[u32] {
        &self.owned_nodes.items[self.owned_nodes.range(triangle)]
    }

    /// All edges, the smaller node of each first, in the order of the triangles that own them.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.owned_edges.items
    }

    /// Places in `edges` of those that a triangle owns.
    #[inline]
    pub fn owned_edges(&self, triangle: u32) -> std::ops::Range<usize> {
        self.owned_edges.range(triangle)
    }

    /// The triangles that have an edge, given with its smaller node first.
    pub fn triangles_of_edge(&self, edge: [u32; 2]) -> impl Iterator<Item = [u32; 3]> + '_ {
        let first = self.edge_triangles.partition_point(|(e, _)| *e < edge);
        let same = self.edge_triangles[first..].iter().take_while(move |(e, _)| *e == edge);
        same.map(|(_, triangle)| self.triangles[*triangle as usize])
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.triangles.len() * (5 * size_of::<[u32; 3]>() + 2 * size_of::<u64>())
            + self.thickness.len() * size_of::<f64>()
    }
}

/// Edges of a triangle, the smaller node of each first.
fn edges_of(&[a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

/// Things that triangles own, in the order of the triangles.
#[derive(Debug)]
struct Owned<T> {
    items: Vec<T>,
    /// First item of each triangle, and their number at the end.
    starts: Vec<u32>,
}

impl<T: Ord + Copy> Owned<T> {
    /// Gives each of the things that triangles have to the first triangle that has it.
    fn new(triangles: &[[u32; 3]], things: impl Fn(&[u32; 3]) -> [T; 3]) -> Self {
        let mut all: Vec<(T, u32)> =
            triangles.iter().zip(0..).flat_map(|(triangle, t)| things(triangle).map(|thing| (thing, t))).collect();
        all.sort_unstable();
        all.dedup_by_key(|(thing, _)| *thing);
        all.sort_unstable_by_key(|(thing, t)| (*t, *thing));
        let starts =
            (0..=triangles.len() as u32).map(|t| all.partition_point(|(_, owner)| *owner < t) as u32).collect();
        Self { items: all.into_iter().map(|(thing, _)| thing).collect(), starts }
    }

    #[inline]
    fn range(&self, triangle: u32) -> std::ops::Range<usize> {
        self.starts[triangle as usize] as usize..self.starts[triangle as usize + 1] as usize
    }
}

/// Thickness per vertex in solver order: the garment's, at most `clamp` times each rest edge of the vertex (method 3.2).
fn thicknesses(scene: &Scene, clamp: f64) -> Vec<f64> {
    let parts = scene.parts();
    let mut thickness = vec![0.0; parts.local_count()];
    for (g, (mesh, garment)) in scene.meshes().iter().zip(&scene.description().garments).enumerate() {
        parts.garment(g).for_each(|solver| thickness[solver] = garment.thickness);
        for edge in mesh.edges() {
            let [a, b] = edge.vertices.map(|v| mesh.rest_positions()[v as usize]);
            let longest: f64 = clamp * (a - b).norm();
            for v in edge.vertices {
                let own: &mut f64 = &mut thickness[parts.garment(g).start + v as usize];
                *own = own.min(longest);
            }
        }
    }
    thickness
}

/// Positions of all nodes at both ends of a collision step.
#[derive(Debug, Default)]
pub struct NodePaths {
    /// Where the nodes are at the collision-free state [m].
    pub start: Vec<Vec3>,
    /// Where they are now [m].
    pub end: Vec<Vec3>,
}

/// Mean rest length of the edges of each node [m]; of all cloth for the points of bodies, and for vertices without edges.
fn edge_lengths(scene: &Scene, nodes: usize) -> Vec<f64> {
    let parts = scene.parts();
    let (mut sums, mut counts) = (vec![0.0; nodes], vec![0u32; nodes]);
    for (g, mesh) in scene.meshes().iter().enumerate() {
        for edge in mesh.edges() {
            let [a, b] = edge.vertices.map(|v| mesh.rest_positions()[v as usize]);
            for v in edge.vertices {
                sums[parts.garment(g).start + v as usize] += (a - b).norm();
                counts[parts.garment(g).start + v as usize] += 1;
            }
        }
    }
    let mean = |(sum, count): (&f64, &u32)| if *count > 0 { sum / f64::from(*count) } else { scene.mean_edge() };
    sums.iter().zip(&counts).map(mean).collect()
}

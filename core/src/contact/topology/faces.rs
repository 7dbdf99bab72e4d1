//! Triangles with the points and edges that hang on them.
//!
//! Every point and every edge hangs on the first triangle that has it. A search over pairs of triangles then meets each
//! pair of a point and a triangle, and each pair of edges, exactly once: in the pair of triangles of which one carries the
//! point and the other is the triangle, or which carry the two edges.
//!
//! Among ranks, the *canonical rank* of a triangle, an edge or a point owns its smallest vertex. Only there it hangs on
//! a triangle, or takes part as a triangle.

use std::ops::Range;

use crate::contact::topology::nodes::IndexMap;
use crate::geometry::crossings::{EdgeOwners, FACE};

/// Bits of the points that a triangle carries, in [`Faces::owned_features`].
const POINTS: u32 = 4;

/// Triangles and what hangs on them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Faces {
    triangles: Vec<[u32; 3]>,
    /// Edges that each triangle carries, and whether it takes part as a triangle.
    owners: EdgeOwners,
    points: Carried<u32>,
    /// The smaller node first.
    edges: Carried<[u32; 2]>,
}

/// Every edge, the smaller node first, with each triangle that has it, ascending.
pub(crate) type Sides = Vec<([u32; 2], u32)>;

impl Faces {
    /// Triangles in an order that decides what hangs where; `is_canonical` tells whether pairs with this smallest
    /// node are found on this rank.
    pub(crate) fn new(triangles: Vec<[u32; 3]>, is_canonical: impl Fn(u32) -> bool) -> (Self, Sides) {
        let each = || triangles.iter().zip(0u32..);
        let mut points: Vec<(u32, u32)> = each().flat_map(|(corners, t)| corners.map(|node| (node, t))).collect();
        points.retain(|(node, _)| is_canonical(*node));
        let mut sides: Sides = each().flat_map(|(corners, t)| edges_of(corners).map(|edge| (edge, t))).collect();
        sides.sort_unstable();
        points.sort_unstable();
        points.dedup_by_key(|(node, _)| *node);
        let mut edges: Sides = sides.iter().filter(|([node, _], _)| is_canonical(*node)).copied().collect();
        edges.dedup_by_key(|(edge, _)| *edge);
        let smallest = |corners: &[u32; 3]| corners[0].min(corners[1]).min(corners[2]);
        let mut bits: Vec<u8> = triangles.iter().map(|c| if is_canonical(smallest(c)) { FACE } else { 0 }).collect();
        for (edge, t) in &edges {
            let place = edges_of(&triangles[*t as usize]).iter().position(|own| own == edge);
            bits[*t as usize] |= 1 << place.expect("an edge hangs on a triangle that has it");
        }
        let count = triangles.len();
        let (points, edges) = (Carried::new(points, count), Carried::new(edges, count));
        (Self { triangles, owners: EdgeOwners::of_bits(bits), points, edges }, sides)
    }

    /// Triangles whose features another rank has assigned with [`Faces::owned_features`].
    pub(crate) fn from_bits(triangles: Vec<[u32; 3]>, carried: &[u32]) -> Self {
        let (mut points, mut edges) = (Vec::new(), Vec::new());
        for ((corners, bits), t) in triangles.iter().zip(carried).zip(0u32..) {
            let has = |bit: usize| bits >> bit & 1 == 1;
            points.extend((0..3).filter(|k| has(POINTS as usize + k)).map(|k| (corners[k], t)));
            edges.extend((0..3).filter(|k| has(*k)).map(|k| (edges_of(corners)[k], t)));
        }
        let owners = EdgeOwners::of_bits(carried.iter().map(|bits| *bits as u8).collect());
        let count = triangles.len();
        Self { triangles, owners, points: Carried::new(points, count), edges: Carried::new(edges, count) }
    }

    /// Returns the features that a triangle carries: bits 0 to 2 for its edges, 3 if it takes part as a triangle, 4
    /// to 6 for its points.
    pub(crate) fn owned_features(&self, triangle: u32) -> u32 {
        let corners = &self.triangles[triangle as usize];
        let points = self.points(triangle);
        let of_points = (0..3).filter(|k| points.contains(&corners[*k])).map(|k| 1 << (POINTS + k as u32));
        u32::from(self.owners.bits(triangle)) | of_points.sum::<u32>()
    }

    /// Corners of the triangles.
    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether a triangle takes part as such.
    #[inline]
    pub(crate) fn is_face(&self, triangle: u32) -> bool {
        self.owners.bits(triangle) & FACE != 0
    }

    /// Returns the triangle that owns each edge in exact checks.
    pub(crate) fn owners(&self) -> &EdgeOwners {
        &self.owners
    }

    /// Points that a triangle carries.
    #[inline]
    pub(crate) fn points(&self, triangle: u32) -> &[u32] {
        &self.points.items[self.points.range(triangle)]
    }

    /// All edges, the smaller node of each first, in the order of the triangles that carry them.
    pub(crate) fn edges(&self) -> &[[u32; 2]] {
        &self.edges.items
    }

    /// Places in `edges` of those that a triangle carries.
    #[inline]
    pub(crate) fn edges_of(&self, triangle: u32) -> Range<usize> {
        self.edges.range(triangle)
    }

    /// New numbers for all nodes.
    pub(crate) fn renumber(&mut self, renumber: &IndexMap) {
        renumber.renumber(self.triangles.iter_mut().flatten());
        renumber.renumber(self.points.items.iter_mut());
        renumber.renumber(self.edges.items.iter_mut().flatten());
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        let (points, edges) = (self.points.items.len() * size_of::<u32>(), self.edges.items.len() * size_of::<u64>());
        self.triangles.len() * (size_of::<[u32; 3]>() + 1 + 2 * size_of::<u32>()) + points + edges
    }
}

/// Edges of a triangle, the smaller node of each first.
fn edges_of(&[a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

/// Things that hang on triangles, in the order of the triangles.
#[derive(Debug, Clone, Default)]
struct Carried<T> {
    items: Vec<T>,
    /// First item of each triangle, and their number at the end.
    starts: Vec<u32>,
}

impl<T: Ord + Copy> Carried<T> {
    /// Things, each with its triangle.
    fn new(mut all: Vec<(T, u32)>, triangles: usize) -> Self {
        all.sort_unstable_by_key(|(thing, t)| (*t, *thing));
        let mut starts = vec![0; triangles + 1];
        all.iter().for_each(|(_, t)| starts[*t as usize + 1] += 1);
        (0..triangles).for_each(|t| starts[t + 1] += starts[t]);
        let mut items: Vec<T> = all.into_iter().map(|(thing, _)| thing).collect();
        // They are collected in the memory of `all`.
        items.shrink_to_fit();
        Self { items, starts }
    }

    #[inline]
    fn range(&self, triangle: u32) -> Range<usize> {
        self.starts[triangle as usize] as usize..self.starts[triangle as usize + 1] as usize
    }
}

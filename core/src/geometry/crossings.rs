//! Crossings of edges of triangle meshes with triangles, decided without rounding.
//!
//! This is the judge of self-collision handling: a cache with one crossing has to be cleaned by hand. Two
//! triangle surfaces meet exactly when an edge of one meets a triangle of the other, so edges against triangles is all
//! that is looked at. Touching counts as meeting; lying in one plane without overlap does not. An edge is never tested
//! against a triangle that has one of its vertices: two triangles with a common vertex are caught by the edge opposite.
//!
//! Boxes choose the candidates, [`segment_meets_triangle`] decides them. Results ascend and do not depend on threads.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use crate::Vec3;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;

mod exact;
mod search;

pub(crate) use exact::segment_meets_triangle;
pub(crate) use search::CrossingSearch;

/// Pieces of a search: enough for many threads, few enough for their overhead not to show.
const TASKS: usize = 256;

/// Triangles that one task looks at where there is no pair search.
const CHUNK: usize = 1024;

/// An edge that passes through or touches a triangle with which it shares no vertex.
///
/// ```
/// use drapery_core::{Crossing, Vec3, self_intersections};
/// let needle = [Vec3::new(0.2, -1.0, 0.2), Vec3::new(0.2, 1.0, 0.2), Vec3::new(9.0, 0.0, 9.0)];
/// let positions = [vec![Vec3::zeros(), Vec3::x(), Vec3::z()], needle.to_vec()].concat();
/// let found = self_intersections(&[[0, 1, 2], [3, 4, 5]], &positions);
/// assert!(found.contains(&Crossing { edge: [3, 4], triangle: [0, 1, 2] }));
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
pub struct Crossing {
    /// Vertices of the edge, ascending.
    pub edge: [u32; 2],
    /// Vertices of the triangle, as the mesh has them.
    pub triangle: [u32; 3],
}

/// Assignment of edges to owner triangles, so that an edge of several triangles is tested once.
#[derive(Clone, Debug, Default)]
pub(crate) struct EdgeOwners {
    /// For each triangle a bit for each of its edges [0, 1], [1, 2], [2, 0], and [`FACE`].
    owned: Vec<u8>,
}

/// Bit of a triangle that edges are tested against; others are there for their edges alone.
pub(crate) const FACE: u8 = 1 << 3;

impl EdgeOwners {
    /// Every edge goes to the first triangle that has it.
    pub(crate) fn new(triangles: &[[u32; 3]]) -> Self {
        let mut edges: Vec<([u32; 2], u32, u8)> = Vec::with_capacity(3 * triangles.len());
        for (t, triangle) in triangles.iter().enumerate() {
            edges.extend((0..3).map(|k| (edge(triangle, k), t as u32, k as u8)));
        }
        edges.sort_unstable();
        edges.dedup_by_key(|(edge, ..)| *edge);
        let mut owned = vec![FACE; triangles.len()];
        for (_, t, k) in edges {
            owned[t as usize] |= 1 << k;
        }
        Self { owned }
    }

    /// Owners by their bits: 0 to 2 for the edges [0, 1], [1, 2], [2, 0] of each triangle, and [`FACE`].
    pub(crate) fn of_bits(owned: Vec<u8>) -> Self {
        Self { owned }
    }

    /// The bits of a triangle.
    #[inline]
    pub(crate) fn bits(&self, triangle: u32) -> u8 {
        self.owned[triangle as usize]
    }
}

/// Triangles at their places, and a tree over them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface<'a> {
    /// Vertices of the triangles.
    pub triangles: &'a [[u32; 3]],
    /// Made from these triangles.
    pub owners: &'a EdgeOwners,
    /// Positions \[m\], finite.
    pub positions: &'a [Vec3],
    /// Tree whose primitive i contains triangle i at these positions; it may contain more, such as a whole motion.
    pub tree: &'a Bvh,
}

/// Finds all intersections of a mesh with itself, ascending, without rounding. `triangles` are numbers of `positions` [m], which
/// are finite. The answer does not depend on threads.
///
/// # Panics
/// A triangle names a position that is not there.
///
/// ```
/// use drapery_core::{Vec3, self_intersections};
/// // Parallel sheets, a millimetre apart.
/// let corners = |height: f64| [Vec3::new(0.0, height, 0.0), Vec3::new(1.0, height, 0.0), Vec3::new(0.0, height, 1.0)];
/// let apart = [corners(0.0), corners(0.001)].concat();
/// assert!(self_intersections(&[[0, 1, 2], [3, 4, 5]], &apart).is_empty());
/// ```
pub fn self_intersections(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<Crossing> {
    let (tree, owners) = (Bvh::build(&boxes(triangles, positions)), EdgeOwners::new(triangles));
    find(&Surface { triangles, owners: &owners, positions, tree: &tree })
}

/// All crossings of a surface with itself, ascending.
pub(crate) fn find(surface: &Surface<'_>) -> Vec<Crossing> {
    let boxes = boxes(surface.triangles, surface.positions);
    let tasks = surface.tree.self_tasks(TASKS);
    let pieces = tasks.par_iter().map(|task| {
        let mut found = Vec::new();
        surface.tree.pairs_of(task, surface.tree, None, &mut |s, t| {
            let (s, t) = (s as usize, t as usize);
            if boxes[s].overlaps(&boxes[t]) {
                let (one, other) = (surface.placed(s, boxes[s]), surface.placed(t, boxes[t]));
                one.judge_edges_against(&other, shares_no_vertex, &mut found);
                other.judge_edges_against(&one, shares_no_vertex, &mut found);
            }
        });
        found
    });
    in_order(pieces.flatten_iter().collect())
}

/// Finds the crossings of a surface with itself that have a vertex for which `is_moved` holds, ascending. Looks
/// around the triangles that have one only.
pub(crate) fn find_moved(surface: &Surface<'_>, is_moved: impl Fn(u32) -> bool + Sync) -> Vec<Crossing> {
    let moved = |vertices: &[u32; 3]| vertices.iter().any(|&v| is_moved(v));
    let is_asked = |edge: &[u32; 2], triangle: &[u32; 3]| {
        shares_no_vertex(edge, triangle) && edge.iter().chain(triangle).any(|&v| is_moved(v))
    };
    let look_around = |t: usize| {
        let mut found = Vec::new();
        if !moved(&surface.triangles[t]) {
            return found;
        }
        let own = surface.placed(t, surface.bounds(t));
        surface.tree.for_each_overlap(&own.bounds, |t| {
            let other = surface.placed(t as usize, surface.bounds(t as usize));
            if own.bounds.overlaps(&other.bounds) {
                own.judge_edges_against(&other, is_asked, &mut found);
                // A triangle that moved speaks for its own edges when its turn comes.
                if !moved(&other.vertices) {
                    other.judge_edges_against(&own, is_asked, &mut found);
                }
            }
        });
        found
    };
    let triangles = (0..surface.triangles.len()).into_par_iter().with_min_len(CHUNK);
    in_order(triangles.flat_map_iter(look_around).collect())
}

/// Crossings of edges of the first surface with triangles of the second, ascending; each has its own vertex numbers.
///
/// The surfaces meet where this finds something one way or the other way round.
pub(crate) fn find_between(edges_of: &Surface<'_>, triangles_of: &Surface<'_>) -> Vec<Crossing> {
    find_between_where(edges_of, triangles_of, |_, _| true)
}

/// The same, of those pairs of an edge and a triangle for which `is_asked` holds.
pub(crate) fn find_between_where(
    edges_of: &Surface<'_>,
    triangles_of: &Surface<'_>,
    is_asked: impl Fn(&[u32; 2], &[u32; 3]) -> bool + Sync,
) -> Vec<Crossing> {
    let ours = boxes(edges_of.triangles, edges_of.positions);
    let theirs = boxes(triangles_of.triangles, triangles_of.positions);
    let tasks = edges_of.tree.tasks_with(triangles_of.tree, TASKS);
    let pieces = tasks.par_iter().map(|task| {
        let mut found = Vec::new();
        edges_of.tree.pairs_of(task, triangles_of.tree, None, &mut |s, t| {
            let (s, t) = (s as usize, t as usize);
            if ours[s].overlaps(&theirs[t]) {
                let other = triangles_of.placed(t, theirs[t]);
                edges_of.placed(s, ours[s]).judge_edges_against(&other, &is_asked, &mut found);
            }
        });
        found
    });
    in_order(pieces.flatten_iter().collect())
}

fn shares_no_vertex(edge: &[u32; 2], triangle: &[u32; 3]) -> bool {
    !edge.iter().any(|v| triangle.contains(v))
}

/// The order of the search depends on the tree. Triangles with the same vertices in the same order are found once.
fn in_order(mut crossings: Vec<Crossing>) -> Vec<Crossing> {
    crossings.sort_unstable();
    crossings.dedup();
    crossings
}

/// A triangle at its place.
struct Positioned<'a> {
    vertices: [u32; 3],
    positions: &'a [Vec3],
    bounds: Aabb,
    /// Bits of the edges it owns.
    owned: u8,
}

impl Surface<'_> {
    #[inline]
    fn placed(&self, t: usize, bounds: Aabb) -> Positioned<'_> {
        Positioned { vertices: self.triangles[t], positions: self.positions, bounds, owned: self.owners.owned[t] }
    }

    fn bounds(&self, t: usize) -> Aabb {
        bounds(&self.triangles[t], self.positions)
    }
}

#[inline]
fn bounds(triangle: &[u32; 3], positions: &[Vec3]) -> Aabb {
    let [a, b, c] = triangle.map(|v| Aabb::of_point(&positions[v as usize]));
    a.union(&b).union(&c)
}

/// Boxes of triangles.
fn boxes(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<Aabb> {
    triangles.par_iter().with_min_len(CHUNK).map(|t| bounds(t, positions)).collect()
}

impl Positioned<'_> {
    /// Finds which of the edges that this triangle owns meet the other; `is_asked` says which are looked at.
    #[inline]
    fn judge_edges_against(
        &self,
        other: &Positioned<'_>,
        is_asked: impl Fn(&[u32; 2], &[u32; 3]) -> bool,
        found: &mut Vec<Crossing>,
    ) {
        if other.owned & FACE == 0 {
            return;
        }
        for k in (0..3).filter(|k| self.owned >> k & 1 == 1) {
            let (edge, triangle) = (edge(&self.vertices, k), other.vertices);
            if !is_asked(&edge, &triangle) {
                continue;
            }
            let segment = edge.map(|v| self.positions[v as usize]);
            if !is_beside(&segment, &other.bounds)
                && segment_meets_triangle(&segment, &triangle.map(|v| other.positions[v as usize]))
            {
                found.push(Crossing { edge, triangle });
            }
        }
    }
}

/// Whether both ends lie beyond the same side of a box.
#[inline]
fn is_beside([p, q]: &[Vec3; 2], bounds: &Aabb) -> bool {
    (0..3).any(|k| {
        let (low, high) = (f64::from(bounds.min[k]), f64::from(bounds.max[k]));
        (p[k] < low && q[k] < low) || (p[k] > high && q[k] > high)
    })
}

/// Edge `k` of a triangle, its vertices ascending.
fn edge(triangle: &[u32; 3], k: usize) -> [u32; 2] {
    let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
    [a.min(b), a.max(b)]
}

#[cfg(test)]
mod tests;

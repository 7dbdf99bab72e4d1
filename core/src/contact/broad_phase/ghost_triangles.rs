//! Ghost triangles: copies of other ranks' triangles, against which a rank tests its own.
//!
//! A pair is found by its canonical rank, that of its smallest node, so triangles are exported to lower ranks only: each rank
//! sends all others some boxes of its tree, and imports the triangles of higher ranks that overlap them.

use bytemuck::{Pod, Zeroable};

use crate::Vec3;
use crate::contact::topology::faces::Faces;
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;
use crate::parallel::ranks::Ranks;

/// Boxes that bound the cloth of a rank for the others.
const SHOWN: usize = 64;

/// A ghost triangle as it is sent.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct GhostTriangle {
    /// Numbers of its corners in the scene.
    pub corners: [u32; 3],
    /// Features that it carries ([`Faces::owned_features`]).
    pub owned_features: u32,
}

/// A ghost triangle with the places of its corners, as it is sent.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct PlacedGhostTriangle {
    triangle: GhostTriangle,
    /// A bit for each corner that has moved.
    moved: u32,
    /// Objects of its corners.
    objects: [u32; 3],
    /// Positions of its corners [m].
    x: [Vec3; 3],
}

impl GhostTriangle {
    /// A triangle of this rank.
    fn of(nodes: &ContactNodes, faces: &Faces, triangle: u32) -> Self {
        let corners = faces.triangles()[triangle as usize].map(|node| nodes.number(node));
        Self { corners, owned_features: faces.owned_features(triangle) }
    }
}

/// The triangles that have something to meet on each other rank; these `boxes` hold them, and the tree is over those.
fn triangles_to_export(ranks: &Ranks, faces: &Faces, tree: &Bvh, boxes: &[Aabb]) -> Vec<Vec<u32>> {
    let regions = ranks.all_gather_v(&tree.cover(SHOWN));
    let lists = regions.into_iter().enumerate().map(|(rank, regions)| {
        let mut list = Vec::new();
        if rank >= ranks.rank() {
            return list;
        }
        for region in regions {
            tree.for_each_overlap(&region, |t| {
                if boxes[t as usize].overlaps(&region) && faces.owned_features(t) != 0 {
                    list.push(t);
                }
            });
        }
        list.sort_unstable();
        list.dedup();
        list
    });
    lists.collect()
}

/// Sends this rank's triangles where they have something to meet; returns those that come. All ranks call it together.
pub(crate) fn exchange_ghosts(nodes: &ContactNodes, faces: &Faces, tree: &Bvh, boxes: &[Aabb]) -> Vec<GhostTriangle> {
    let lists = triangles_to_export(nodes.ranks(), faces, tree, boxes);
    let row = |t: &u32| GhostTriangle::of(nodes, faces, *t);
    let visits = lists.iter().map(|list| list.iter().map(row).collect()).collect();
    nodes.ranks().all_to_all_v(visits).into_iter().flatten().collect()
}

/// The same with the places `x` of the nodes [m], and which of them have moved.
pub(crate) fn exchange_ghosts_with_positions(
    surface: &ContactSurface,
    tree: &Bvh,
    boxes: &[Aabb],
    x: &[Vec3],
    moved: Option<&[u8]>,
) -> Vec<PlacedGhostTriangle> {
    let (nodes, faces) = (surface.nodes(), surface.cloth());
    let lists = triangles_to_export(nodes.ranks(), faces, tree, boxes);
    let row = |t: &u32| {
        let corners = faces.triangles()[*t as usize].map(|node| node as usize);
        let has_moved = |k: usize| moved.is_none_or(|moved| moved[corners[k]] != 0);
        PlacedGhostTriangle {
            triangle: GhostTriangle::of(nodes, faces, *t),
            moved: (0..3).map(|k| u32::from(has_moved(k)) << k).sum(),
            objects: corners.map(|corner| surface.object(corner as u32)),
            x: corners.map(|corner| x[corner]),
        }
    };
    let visits = lists.iter().map(|list| list.iter().map(row).collect()).collect();
    nodes.ranks().all_to_all_v(visits).into_iter().flatten().collect()
}

/// Ghost triangles with the positions of their nodes, in a numbering of their own: three nodes for each.
#[derive(Debug)]
pub(crate) struct GhostTriangles {
    /// Their corners, and what they carry.
    pub faces: Faces,
    /// Number of each node in the scene.
    pub numbers: Vec<u32>,
    /// Position of each node [m].
    pub x: Vec<Vec3>,
    /// Whether it has moved.
    pub moved: Vec<bool>,
    /// Object of each node.
    pub objects: Vec<u32>,
    /// A tree over them.
    pub tree: Bvh,
}

impl GhostTriangles {
    /// The ghosts that were sent.
    pub(crate) fn new(ghosts: &[PlacedGhostTriangle]) -> Self {
        let triangles: Vec<[u32; 3]> = (0..ghosts.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let carried: Vec<u32> = ghosts.iter().map(|ghost| ghost.triangle.owned_features).collect();
        let numbers = ghosts.iter().flat_map(|ghost| ghost.triangle.corners).collect();
        let x: Vec<Vec3> = ghosts.iter().flat_map(|ghost| ghost.x).collect();
        let moved = ghosts.iter().flat_map(|ghost| [0, 1, 2].map(|k| ghost.moved >> k & 1 == 1)).collect();
        let objects = ghosts.iter().flat_map(|ghost| ghost.objects).collect();
        let bounds = |x: &[Vec3]| x.iter().fold(Aabb::EMPTY, |bounds, x| bounds.union(&Aabb::of_point(x)));
        let boxes: Vec<Aabb> = x.chunks(3).map(bounds).collect();
        Self { faces: Faces::from_bits(triangles, &carried), numbers, x, moved, objects, tree: Bvh::build(&boxes) }
    }
}

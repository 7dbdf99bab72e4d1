//! Ghost triangles: copies of other ranks' triangles, against which a rank tests its own.
//!
//! A pair is found by its canonical rank, that of its smallest node, so triangles are exported to lower ranks only: each rank
//! sends all others some boxes of its tree, and imports the triangles of higher ranks that overlap them.

use crate::Vec3;
use crate::contact::topology::faces::Faces;
use crate::contact::topology::nodes::ContactNodes;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;
use crate::parallel::message::{vector_of, words_of};
use crate::parallel::ranks::Ranks;

/// Boxes that bound the cloth of a rank for the others.
const SHOWN: usize = 64;

/// A ghost triangle by its corners' numbers in the scene, with what it carries ([`Faces::owned_features`]).
pub(crate) type GhostTriangle = [u32; 4];

/// Where a ghost triangle is: its [`GhostTriangle`], a bit for each corner that has moved, and nine coordinates [m].
pub(crate) type GhostTriangleWithPositions = [u64; 14];

/// The triangles that have something to meet on each other rank; these `boxes` hold them, and the tree is over those.
fn triangles_to_export(ranks: &Ranks, faces: &Faces, tree: &Bvh, boxes: &[Aabb]) -> Vec<Vec<u32>> {
    let shown: Vec<[[f32; 3]; 2]> = tree.cover(SHOWN).iter().map(|b| [b.min, b.max]).collect();
    let regions = ranks.all_gather_v(&shown);
    let lists = regions.into_iter().enumerate().map(|(rank, regions)| {
        let mut list = Vec::new();
        if rank >= ranks.rank() {
            return list;
        }
        for [min, max] in regions {
            let region = Aabb { min, max };
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
    let tell = |t: &u32| {
        let [a, b, c] = faces.triangles()[*t as usize].map(|node| nodes.number(node));
        [a, b, c, faces.owned_features(*t)]
    };
    let visits = lists.iter().map(|list| list.iter().map(tell).collect()).collect();
    nodes.ranks().all_to_all_v(visits).into_iter().flatten().collect()
}

/// The same with the places `x` of the nodes [m], and which of them have moved.
pub(crate) fn exchange_ghosts_with_positions(
    nodes: &ContactNodes,
    faces: &Faces,
    tree: &Bvh,
    boxes: &[Aabb],
    x: &[Vec3],
    moved: Option<&[u8]>,
) -> Vec<GhostTriangleWithPositions> {
    let lists = triangles_to_export(nodes.ranks(), faces, tree, boxes);
    let tell = |t: &u32| {
        let corners = faces.triangles()[*t as usize];
        let mut row = [0; 14];
        for (k, node) in corners.into_iter().enumerate() {
            row[k] = u64::from(nodes.number(node));
            let has_moved = moved.is_none_or(|moved| moved[node as usize] != 0);
            row[4] |= u64::from(has_moved) << k;
            row[5 + 3 * k..8 + 3 * k].copy_from_slice(&words_of(&x[node as usize]));
        }
        row[3] = u64::from(faces.owned_features(*t));
        row
    };
    let visits = lists.iter().map(|list| list.iter().map(tell).collect()).collect();
    nodes.ranks().all_to_all_v(visits).into_iter().flatten().collect()
}

/// Visitors at their places, numbered by themselves: three nodes for each.
#[derive(Debug)]
pub(crate) struct GhostTriangles {
    /// Their corners, and what they carry.
    pub faces: Faces,
    /// Number of each node in the scene.
    pub numbers: Vec<u32>,
    /// Where it is [m].
    pub x: Vec<Vec3>,
    /// Whether it has moved.
    pub moved: Vec<bool>,
    /// A tree over them.
    pub tree: Bvh,
}

impl GhostTriangles {
    /// The ghosts that were sent.
    pub(crate) fn new(ghosts: &[GhostTriangleWithPositions]) -> Self {
        let triangles: Vec<[u32; 3]> = (0..ghosts.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let carried: Vec<u32> = ghosts.iter().map(|row| row[3] as u32).collect();
        let corner = |row: &GhostTriangleWithPositions, k: usize| {
            let place = vector_of([0, 1, 2].map(|axis| row[5 + 3 * k + axis]));
            (row[k] as u32, place, row[4] >> k & 1 == 1)
        };
        let (mut numbers, mut x, mut moved) = (Vec::new(), Vec::new(), Vec::new());
        for (number, place, has_moved) in ghosts.iter().flat_map(|row| [0, 1, 2].map(|k| corner(row, k))) {
            numbers.push(number);
            x.push(place);
            moved.push(has_moved);
        }
        let bounds = |x: &[Vec3]| x.iter().fold(Aabb::EMPTY, |bounds, x| bounds.union(&Aabb::of_point(x)));
        let boxes: Vec<Aabb> = x.chunks(3).map(bounds).collect();
        Self { faces: Faces::from_bits(triangles, &carried), numbers, x, moved, tree: Bvh::build(&boxes) }
    }
}

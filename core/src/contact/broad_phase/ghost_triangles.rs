//! Triangles that visit another rank to meet the triangles there.
//!
//! A pair is found by the rank that has its smallest node, so triangles visit lower ranks only: each rank shows all others
//! where its cloth is, by some boxes of its tree, and gets what lies there.

use crate::Vec3;
use crate::contact::topology::faces::Faces;
use crate::contact::topology::nodes::ContactNodes;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;
use crate::parallel::message::{vector_of, words_of};
use crate::parallel::ranks::Ranks;

/// Boxes by which a rank shows where its cloth is.
const SHOWN: usize = 64;

/// A visiting triangle by its corners' numbers in the scene, with what it carries ([`Faces::carried`]).
pub(crate) type Visitor = [u32; 4];

/// Where a visiting triangle is: its [`Visitor`], a bit for each corner that has moved, and nine coordinates [m].
pub(crate) type PlacedVisitor = [u64; 14];

/// The triangles that have something to meet on each other rank; these `boxes` hold them, and the tree is over those.
fn travellers(ranks: &Ranks, faces: &Faces, tree: &Bvh, boxes: &[Aabb]) -> Vec<Vec<u32>> {
    let shown: Vec<[[f32; 3]; 2]> = tree.cover(SHOWN).iter().map(|b| [b.min, b.max]).collect();
    let regions = ranks.all_gather_each(&shown);
    let lists = regions.into_iter().enumerate().map(|(rank, regions)| {
        let mut list = Vec::new();
        if rank >= ranks.rank() {
            return list;
        }
        for [min, max] in regions {
            let region = Aabb { min, max };
            tree.for_each_overlap(&region, |t| {
                if boxes[t as usize].overlaps(&region) && faces.carried(t) != 0 {
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
pub(crate) fn visit(nodes: &ContactNodes, faces: &Faces, tree: &Bvh, boxes: &[Aabb]) -> Vec<Visitor> {
    let lists = travellers(nodes.ranks(), faces, tree, boxes);
    let tell = |t: &u32| {
        let [a, b, c] = faces.triangles()[*t as usize].map(|node| nodes.number(node));
        [a, b, c, faces.carried(*t)]
    };
    let visits = lists.iter().map(|list| list.iter().map(tell).collect()).collect();
    nodes.ranks().send_lists(visits).into_iter().flatten().collect()
}

/// The same with the places `x` of the nodes [m], and which of them have moved.
pub(crate) fn visit_placed(
    nodes: &ContactNodes,
    faces: &Faces,
    tree: &Bvh,
    boxes: &[Aabb],
    x: &[Vec3],
    moved: Option<&[u8]>,
) -> Vec<PlacedVisitor> {
    let lists = travellers(nodes.ranks(), faces, tree, boxes);
    let tell = |t: &u32| {
        let corners = faces.triangles()[*t as usize];
        let mut told = [0; 14];
        for (k, node) in corners.into_iter().enumerate() {
            told[k] = u64::from(nodes.number(node));
            let has_moved = moved.is_none_or(|moved| moved[node as usize] != 0);
            told[4] |= u64::from(has_moved) << k;
            told[5 + 3 * k..8 + 3 * k].copy_from_slice(&words_of(&x[node as usize]));
        }
        told[3] = u64::from(faces.carried(*t));
        told
    };
    let visits = lists.iter().map(|list| list.iter().map(tell).collect()).collect();
    nodes.ranks().send_lists(visits).into_iter().flatten().collect()
}

/// Visitors at their places, numbered by themselves: three nodes for each.
#[derive(Debug)]
pub(crate) struct Placed {
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

impl Placed {
    /// The visitors that were sent.
    pub(crate) fn new(visitors: &[PlacedVisitor]) -> Self {
        let triangles: Vec<[u32; 3]> = (0..visitors.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let carried: Vec<u32> = visitors.iter().map(|told| told[3] as u32).collect();
        let corner = |told: &PlacedVisitor, k: usize| {
            let place = vector_of([0, 1, 2].map(|axis| told[5 + 3 * k + axis]));
            (told[k] as u32, place, told[4] >> k & 1 == 1)
        };
        let (mut numbers, mut x, mut moved) = (Vec::new(), Vec::new(), Vec::new());
        for (number, place, has_moved) in visitors.iter().flat_map(|told| [0, 1, 2].map(|k| corner(told, k))) {
            numbers.push(number);
            x.push(place);
            moved.push(has_moved);
        }
        let bounds = |x: &[Vec3]| x.iter().fold(Aabb::EMPTY, |bounds, x| bounds.union(&Aabb::of_point(x)));
        let boxes: Vec<Aabb> = x.chunks(3).map(bounds).collect();
        Self { faces: Faces::told(triangles, &carried), numbers, x, moved, tree: Bvh::build(&boxes) }
    }
}

//! The nodes that the contacts of a rank know of: cloth [ghosts below | own | ghosts above], then the points of the
//! bodies, which every rank has. Local numbers ascend as those of the scene do, so whatever is sorted by the
//! one is sorted by the other.
//!
//! The *canonical rank* of a pair is the owner of its smallest node: there it is found, judged and counted. It is *held* by all ranks
//! that own one of its nodes.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Pod;

use crate::Vec3;
use crate::contact::topology::pair::Pair;
use crate::parallel::ghosted_index::LocalVertices;
use crate::parallel::halo::{GhostedArray, Halo};
use crate::parallel::ranks::Ranks;

/// The numbering of a rank's nodes of contact, and the messages that keep its ghosts.
#[derive(Debug, Clone)]
pub(crate) struct ContactNodes {
    vertices: LocalVertices,
    /// First vertex of every logical part in the scene's numbering, and the number of all at the end; empty where each vertex
    /// counts as a part.
    part_starts: Arc<[u32]>,
    /// Points of the bodies.
    body_nodes: usize,
}

impl ContactNodes {
    /// The nodes of a rank with these ghosts (by their numbers in the scene, ascending). All ranks call it together.
    pub(crate) fn new(ranks: &Ranks, rank_starts: &[u32], ghosts: Vec<u32>, body_nodes: usize) -> Self {
        let vertices = LocalVertices::new(ranks.clone(), rank_starts.to_vec(), ghosts);
        Self { vertices, part_starts: Arc::default(), body_nodes }
    }

    /// The same nodes, with the first vertices of the logical parts, and the number of all at the end.
    pub(crate) fn with_parts(self, starts: impl Iterator<Item = u32>) -> Self {
        Self { part_starts: starts.collect(), ..self }
    }

    /// Whether nodes, by their numbers in the scene, are all of one logical part.
    pub(crate) fn is_in_one_part(&self, numbers: &[u32; 4]) -> bool {
        let next = self.part_starts.partition_point(|start| *start <= numbers[0]);
        let Some(end) = self.part_starts.get(next) else { return false };
        let part = self.part_starts[next - 1]..*end;
        numbers.iter().all(|number| part.contains(number))
    }

    /// The nodes of this rank with other ghosts. All ranks call it together.
    pub(crate) fn with_ghosts(&self, ghosts: Vec<u32>) -> Self {
        let vertices = self.vertices.with_ghosts(ghosts);
        Self { vertices, part_starts: Arc::clone(&self.part_starts), body_nodes: self.body_nodes }
    }

    /// This rank and the others.
    pub(crate) fn ranks(&self) -> &Ranks {
        self.vertices.ranks()
    }

    /// The ghosts' messages.
    pub(crate) fn halo(&self) -> &Halo {
        self.vertices.halo()
    }

    /// Numbers of the ghosts in the scene, ascending.
    pub(crate) fn ghosts(&self) -> &[u32] {
        self.vertices.ghosts()
    }

    /// Number of nodes of cloth here, ghosts included; nodes of bodies follow.
    pub(crate) fn cloth(&self) -> usize {
        self.vertices.count()
    }

    /// Number of all nodes here.
    pub(crate) fn count(&self) -> usize {
        self.cloth() + self.body_nodes
    }

    /// Own nodes of cloth, in local numbers.
    pub(crate) fn own(&self) -> Range<usize> {
        self.vertices.own()
    }

    /// Ghosts, in local numbers.
    pub(crate) fn ghost_places(&self) -> impl Iterator<Item = usize> + use<> {
        self.vertices.ghost_places()
    }

    /// Whether this rank owns a local node of cloth.
    #[inline]
    pub(crate) fn is_own(&self, node: u32) -> bool {
        self.vertices.own().contains(&(node as usize))
    }

    /// Whether this rank owns a cloth vertex of the scene.
    pub(crate) fn owns(&self, number: u32) -> bool {
        self.vertices.owned().contains(&number)
    }

    /// The cloth vertices of the scene that this rank owns.
    pub(crate) fn owned(&self) -> Range<u32> {
        self.vertices.owned()
    }

    /// Whether a local node is a point of a body.
    #[inline]
    pub(crate) fn is_body(&self, node: u32) -> bool {
        node as usize >= self.cloth()
    }

    /// Number in the scene of a local node; points of bodies come after all cloth.
    pub(crate) fn number(&self, node: u32) -> u32 {
        let (node, cloth) = (node as usize, self.cloth());
        if node >= cloth { self.global_cloth_count() + (node - cloth) as u32 } else { self.vertices.number(node) }
    }

    /// The local number of a node of the scene, if it is own, a ghost, or of a body.
    pub(crate) fn local(&self, number: u32) -> Option<u32> {
        if number >= self.global_cloth_count() {
            return Some(number - self.global_cloth_count() + self.cloth() as u32);
        }
        self.vertices.local(number).map(|local| local as u32)
    }

    /// The rank that owns a cloth vertex of the scene.
    pub(crate) fn owner(&self, number: u32) -> usize {
        self.vertices.owner(number)
    }

    /// Whether this is the canonical rank of a pair of local nodes: whether this rank owns the smallest of them.
    #[inline]
    pub(crate) fn is_canonical_rank(&self, nodes: &[u32; 4]) -> bool {
        self.is_own(nodes.iter().copied().min().unwrap_or(0))
    }

    /// A pair by the numbers that its nodes have in the scene.
    pub(crate) fn numbered(&self, pair: &Pair) -> Pair {
        Pair { kind: pair.kind, nodes: pair.nodes.map(|node| self.number(node)) }
    }

    /// Number of cloth vertices of the scene.
    pub(crate) fn global_cloth_count(&self) -> u32 {
        self.vertices.all()
    }

    /// Whether ghosts, and what other ranks know of this one, are the same.
    pub(crate) fn is_laid_out_as(&self, other: &Self) -> bool {
        self.ghosts() == other.ghosts() && self.halo() == other.halo()
    }

    /// Brings the ghosts' values, in an array over local nodes, to those of their owners.
    pub(crate) fn update<T: Pod>(&self, values: &mut [T]) {
        self.halo().update(self.ranks(), values);
    }

    /// The same in several arrays, with one message for each rank.
    pub(crate) fn update_all(&self, arrays: &mut [&mut dyn GhostedArray]) {
        self.halo().update_all(self.ranks(), arrays);
    }
}

/// New local numbers for old ones, after the ghosts have changed. Ascending, so whatever is sorted by nodes stays so.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct IndexMap {
    /// New number of each old node; `DROPPED` where it is no ghost any more.
    to: Vec<u32>,
    /// Nodes of cloth before and now.
    cloth: [usize; 2],
    /// Number of all nodes now.
    count: usize,
}

/// Marker in place of the number of a node that is not known any more.
const DROPPED: u32 = u32::MAX;

impl IndexMap {
    /// From one numbering of a rank's nodes to another.
    pub(crate) fn between(old: &ContactNodes, new: &ContactNodes) -> Self {
        let to = (0..old.count() as u32).map(|node| new.local(old.number(node)).unwrap_or(DROPPED)).collect();
        Self { to, cloth: [old.cloth(), new.cloth()], count: new.count() }
    }

    /// The new number of a node that is still known.
    #[inline]
    pub(crate) fn node(&self, old: u32) -> u32 {
        self.to[old as usize]
    }

    /// Lays an array over all nodes, or over the nodes of cloth, out anew; what is new gets `fill`.
    pub(crate) fn apply<T: Clone>(&self, values: &mut Vec<T>, fill: T) {
        let count = if values.len() == self.cloth[0] { self.cloth[1] } else { self.count };
        let old = std::mem::replace(values, vec![fill; count]);
        for (value, to) in old.into_iter().zip(&self.to) {
            if *to != DROPPED {
                values[*to as usize] = value;
            }
        }
    }

    /// Renumbers nodes in place; all are still known.
    pub(crate) fn renumber<'a>(&self, nodes: impl Iterator<Item = &'a mut u32>) {
        nodes.for_each(|node| *node = self.node(*node));
    }
}

/// Positions of all nodes at both ends of a collision step.
#[derive(Debug, Default)]
pub(crate) struct NodePaths {
    /// Positions of the nodes at the collision-free state [m].
    pub start: Vec<Vec3>,
    /// Current positions of the nodes [m].
    pub end: Vec<Vec3>,
}

impl NodePaths {
    /// Lays the paths out for other ghosts. Those that are new have none yet.
    pub(crate) fn renumber(&mut self, renumber: &IndexMap) {
        renumber.apply(&mut self.start, Vec3::zeros());
        renumber.apply(&mut self.end, Vec3::zeros());
    }

    /// Brings the ghosts' paths to those of their owners. All ranks call it together.
    pub(crate) fn refresh(&mut self, nodes: &ContactNodes) {
        nodes.update_all(&mut [&mut self.start, &mut self.end]);
    }
}

//! A surface whose crossings are asked for again and again while it moves.

use crate::Vec3;
use crate::geometry::bvh::Bvh;
use crate::geometry::crossings::{EdgeOwners, Surface, boxes};
use crate::geometry::tolerances::REBUILD_COST;

/// Triangles with everything that a search for crossings needs, at their latest places.
#[derive(Clone, Debug)]
pub(crate) struct CrossingSearch {
    triangles: Vec<[u32; 3]>,
    owners: EdgeOwners,
    positions: Vec<Vec3>,
    tree: Bvh,
    built_cost: f64,
}

impl CrossingSearch {
    /// Takes triangles, whose vertices are in range, at their first places \[m\].
    pub(crate) fn new(triangles: Vec<[u32; 3]>, positions: Vec<Vec3>) -> Self {
        let owners = EdgeOwners::new(&triangles);
        let tree = Bvh::build(&boxes(&triangles, &positions));
        let built_cost = tree.cost();
        Self { triangles, owners, positions, tree, built_cost }
    }

    /// Moves the vertices; as many as before.
    pub(crate) fn place(&mut self, positions: impl IntoIterator<Item = Vec3>) {
        let count = self.positions.len();
        self.positions.clear();
        self.positions.extend(positions);
        assert_eq!(self.positions.len(), count, "a surface keeps its number of vertices");
        let boxes = boxes(&self.triangles, &self.positions);
        self.tree.refit(|t| boxes[t as usize]);
        if self.tree.cost() > REBUILD_COST * self.built_cost {
            self.tree = Bvh::build(&boxes);
            self.built_cost = self.tree.cost();
        }
    }

    /// The surface at its latest places.
    pub(crate) fn surface(&self) -> Surface<'_> {
        let Self { triangles, owners, positions, tree, .. } = self;
        Surface { triangles, owners, positions, tree }
    }
}

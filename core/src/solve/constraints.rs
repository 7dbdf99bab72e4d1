//! The constraints of a solve, vertex by vertex.

use nalgebra::Matrix3;

use crate::Vec3;
use crate::parallel::for_each_part::PerPart;
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::parallel::simd4::Simd4;
use crate::solve::block_system::{BlockSystem, Projection};

/// The projections of the vertices that are constrained.
#[derive(Debug)]
pub(super) struct Constraints {
    parts: Vec<Vec<Constrained>>,
}

/// A constrained vertex.
#[derive(Debug, Clone, Copy)]
struct Constrained {
    /// Counted from the part's first.
    vertex: usize,
    /// Projections of the unit vectors.
    columns: [Vec3; 3],
}

/// Projections of the unit vectors at a free vertex.
pub(super) const FREE: [Vec3; 3] = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1.0)];

/// The projections of a rank's local vertices.
#[derive(Debug)]
pub(super) struct LocalProjections {
    /// One more than the place of each vertex' projection; zero of a free one.
    places: Vec<u32>,
    blocks: Vec<Matrix3<f64>>,
}

impl LocalProjections {
    fn insert(&mut self, vertex: usize, columns: &[Vec3; 3]) {
        self.blocks.push(Matrix3::from_columns(columns));
        self.places[vertex] = self.blocks.len() as u32;
    }

    /// The projection of a local vertex that is constrained.
    #[inline]
    pub(super) fn of(&self, vertex: usize) -> Option<&Matrix3<f64>> {
        self.blocks.get((self.places[vertex] as usize).wrapping_sub(1))
    }
}

/// The projection of a vector, by those of the unit vectors.
#[inline(always)]
pub(super) fn projected(columns: &[Vec3; 3], r: Simd4) -> Simd4 {
    let r = Vec3::from(r);
    Simd4::from(&(columns[0] * r.x + columns[1] * r.y + columns[2] * r.z))
}

impl Constraints {
    /// No constraint in any part.
    pub(super) fn none(parts: &Parts) -> Self {
        Self { parts: vec![Vec::new(); parts.count()] }
    }

    /// Takes over what constrains the parts that are solved, and holds what has no mass: nothing says how it moves.
    pub(super) fn update(&mut self, system: &BlockSystem<'_, impl Projection>) {
        let BlockSystem { parts, masses, worked_on, constraints, .. } = *system;
        parts.for_each(PerPart(&mut self.parts), &|part, list| {
            if !worked_on[part] {
                return;
            }
            let list = &mut list.0[0];
            list.clear();
            let masses = &masses[parts.ranges()[part].clone()];
            let count = masses.len();
            let mut columns = [[Vec3::zeros(); PART_SIZE]; 3];
            for (axis, column) in columns.iter_mut().enumerate() {
                column[..count].fill(Vec3::ith(axis, 1.0));
                constraints.project(part, &mut column[..count]);
            }
            for (vertex, mass) in masses.iter().enumerate() {
                let columns = match *mass {
                    0.0 => [Vec3::zeros(); 3],
                    _ => [0, 1, 2].map(|axis| columns[axis][vertex]),
                };
                if columns != FREE {
                    list.push(Constrained { vertex, columns });
                }
            }
        });
    }

    /// The projections of all local vertices; `ghosts` are those of ghosts, by unit vectors.
    pub(super) fn of_local_vertices(
        &self,
        parts: &Parts,
        ghosts: impl Iterator<Item = (usize, [Vec3; 3])>,
    ) -> LocalProjections {
        let mut all = LocalProjections { places: vec![0; parts.local_count()], blocks: Vec::new() };
        for (range, list) in parts.ranges().iter().zip(&self.parts) {
            list.iter().for_each(|constrained| all.insert(range.start + constrained.vertex, &constrained.columns));
        }
        ghosts.filter(|(_, columns)| *columns != FREE).for_each(|(ghost, columns)| all.insert(ghost, &columns));
        all
    }

    /// Removes the constrained directions of one part.
    pub(super) fn project(&self, part: usize, r: &mut [Simd4]) {
        self.parts[part].iter().for_each(|Constrained { vertex, columns }| r[*vertex] = projected(columns, r[*vertex]));
    }

    /// Projections of the unit vectors at a vertex of a part, counted from the part's first.
    pub(super) fn columns(&self, part: usize, vertex: usize) -> [Vec3; 3] {
        let list = &self.parts[part];
        list.binary_search_by_key(&vertex, |constrained| constrained.vertex).map_or(FREE, |place| list[place].columns)
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        self.parts.iter().map(|list| list.capacity() * size_of::<Constrained>()).sum()
    }
}

//! System that an implicit step solves.

use crate::Vec3;
use crate::block_matrix::BlockMatrix;
use crate::parallel::parts::Parts;

/// Constraints of a solve: an orthogonal projection of each vertex' vector.
pub trait Projection: Sync {
    /// Removes the constrained directions of one part from `r`, the part's own slice.
    fn project(&self, part: usize, r: &mut [Vec3]);
}

/// A system to be solved.
#[derive(Debug)]
pub struct BlockSystem<'a, C> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg]; one without mass is held.
    pub masses: &'a [f64],
    /// Parts whose vertices are unknowns; those of the others stay as they are.
    pub worked_on: &'a [bool],
    /// A [kg], but for the pairs.
    pub matrix: &'a BlockMatrix,
    /// P.
    pub constraints: &'a C,
}

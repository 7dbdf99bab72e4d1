//! Actions on cloth in a step: forces on the parts, and changes of velocities between the solves.

use std::ops::Range;

use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::metrics::Metrics;
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::parallel::simd4::{PartSimd4, Simd4};
use crate::pins::PinTargets;
use crate::snapshot::elements::ElementRows;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// A force, and the part of the cloth that it acts on.
pub type PartForce = (usize, Box<dyn Force>);

/// Inputs of forces beside the positions of the cloth.
#[derive(Clone, Copy)]
pub struct ForceContext<'a> {
    /// Solver time of the positions [s].
    pub time: f64,
    /// Prescribed positions of pinned vertices during the step.
    pub targets: &'a PinTargets,
    /// Velocities of all vertices that are known before the solve [m/s], for the factors of drag that are not linear: at the
    /// start of the step in B.1, foreseen for its middle in B.5, and at the stage in long steps. Empty in B.5 if no effect asks for them.
    pub v: &'a [Vec3],
    /// The wind of a file.
    pub wind: &'a WindGrid,
    /// Volumes that garments enclose in these positions.
    pub volumes: &'a Volumes,
}

/// One part of the cloth as a force sees it.
#[derive(Clone, Copy)]
pub struct PartView<'a> {
    /// First vertex of the part in solver order.
    pub start: usize,
    /// Masses of the part's vertices [kg].
    pub masses: &'a [f64],
    /// Positions of all vertices [m].
    pub x: &'a [Vec3],
    /// Fraction of the step at which the force is evaluated: 0 at its start, ½ at its middle; γ and 1 at the stages of long steps.
    pub fraction: f64,
    /// Everything else.
    pub context: ForceContext<'a>,
}

impl PartView<'_> {
    /// Updates all forces of the part and returns their sums [N] in `f`, which is zero before.
    pub fn update<'a>(&self, forces: &mut [Box<dyn Force>], f: &'a mut PartSimd4) -> &'a [Simd4] {
        let mut own_x = [Simd4::ZERO; PART_SIZE];
        let own_x = Simd4::copy(&self.x[self.start..self.start + self.masses.len()], &mut own_x);
        let f = &mut f[..own_x.len()];
        forces.iter_mut().for_each(|force| force.update(self, own_x, f));
        f
    }
}

/// Positions and velocities of one part and of its neighbours, as damping sees them.
#[derive(Clone, Copy)]
pub struct PartMotion<'a> {
    /// Positions of all vertices [m].
    pub x: &'a [Vec3],
    /// Velocities of all vertices [m/s].
    pub v: &'a [Vec3],
    /// Positions of the part's vertices [m].
    pub own_x: &'a [Simd4],
    /// Velocities of the part's vertices [m/s].
    pub own_v: &'a [Simd4],
}

impl<'a> PartMotion<'a> {
    /// Calls `work` with the motion of a part that holds these vertices.
    pub(crate) fn with<R>(
        part: Range<usize>,
        x: &'a [Vec3],
        v: &'a [Vec3],
        work: impl FnOnce(&PartMotion<'_>) -> R,
    ) -> R {
        let (mut own_x, mut own_v) = ([Simd4::ZERO; PART_SIZE], [Simd4::ZERO; PART_SIZE]);
        let own_x = Simd4::copy(&x[part.clone()], &mut own_x);
        let own_v = Simd4::copy(&v[part], &mut own_v);
        work(&PartMotion { x, v, own_x, own_v })
    }
}

/// Factors of the derivatives of forces in the matrix of an implicit step, `M + damping · D + stiffness · K`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockFactors {
    /// Factor of the derivative by velocity, D [s].
    pub damping: f64,
    /// Factor of the derivative by position, K [s²].
    pub stiffness: f64,
}

/// A force on the vertices of one part. In the semi-implicit step elastic parts are explicit and damping parts implicit; in the
/// implicit one both are, by the blocks that the force gives.
///
/// An element that crosses a border is evaluated by both parts, with the same operands.
pub trait Force: Send + Sync {
    /// Remembers what damping products at these positions need, and adds the forces that do not depend on velocity to
    /// `f` [N]; `own_x` and `f` are the part's own vertices.
    fn update(&mut self, view: &PartView<'_>, own_x: &[Simd4], f: &mut [Simd4]);

    /// Adds the damping force to `f`, the part's own slice [N]. Linear in the velocities, symmetric, never adding energy;
    /// the positions are those of the last `update`.
    fn add_damping(&self, _motion: &PartMotion<'_>, _f: &mut [Simd4]) {}

    /// Coefficients c of a drag −c v on each vertex of the part alone [kg/s], none negative; empty if the force has no drag. It is implicit
    /// in every step.
    fn vertex_drag(&self) -> &[f64] {
        &[]
    }

    /// Adds to each vertex the sum of the stiffnesses of its springs [N/m], for the choice of the time step where it is explicit.
    fn add_stiffness(&self, _sums: &mut [f64]) {}

    /// Vertices of other parts that the force looks at: a part without such on other ranks need not wait for them.
    fn neighbours(&self) -> &[u32] {
        &[]
    }

    /// Potential energy [J]; an element that crosses a border counts with half its energy in each part.
    fn energy(&self, _view: &PartView<'_>) -> f64 {
        0.0
    }

    /// Hands out what was counted since it was asked last, under names of the effect's `counts`; each event at one part only.
    fn take_counts(&mut self, _count: &mut dyn FnMut(&'static str, u64)) {}

    /// The force as one with derivatives; `None` if it is explicit in every step.
    fn linearised(&self) -> Option<&dyn Linearised> {
        None
    }

    /// Whether it is implicit without being in the matrix: a stage of a long step repeats its solve until the force has converged.
    fn is_iterated(&self) -> bool {
        false
    }

    /// The force as one of gas that the garment encloses; `None` if it is not.
    fn enclosing(&self) -> Option<&dyn Enclosing> {
        None
    }

    /// The force as one whose elements are strained; `None` if they have no length.
    fn strained(&self) -> Option<&dyn Strained> {
        None
    }

    /// The force as one whose elements can yield; `None` if all of them spring back.
    fn plastic(&self) -> Option<&dyn Plastic> {
        None
    }

    /// The same, to be changed.
    fn plastic_mut(&mut self) -> Option<&mut dyn Plastic> {
        None
    }

    /// The force as one whose elements can break; `None` if all of them hold whatever pulls.
    fn breakable(&self) -> Option<&dyn Breakable> {
        None
    }

    /// The same, to be changed.
    fn breakable_mut(&mut self) -> Option<&mut dyn Breakable> {
        None
    }
}

/// A force that the implicit step takes into its matrix, with all of it that limits the time step.
pub trait Linearised {
    /// Calls `visit` with the local vertices of each element that couples its vertices; always in the same order.
    fn visit_elements(&self, _visit: &mut dyn FnMut(&[u32])) {}

    /// Adds `damping · D + stiffness · K` to the rows of the part, for the positions of the last [`Force::update`], which came
    /// just before with the same view: D and K are minus the derivatives of the force by velocity and by position, made
    /// positive semidefinite. `slots` are those of the visited elements, of each in the order of [`PartBlocks::slots`].
    fn add_blocks(&self, view: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks);
}

/// A force by which enclosed gas pushes its garment: its pressure, which depends on the volume, times the volume's gradient.
pub trait Enclosing {
    /// Adds the derivative of the volume by the positions of the part's own vertices, at the positions `x` [m] of all, to
    /// `gradient` [m²].
    fn add_volume_gradient(&self, x: &[Vec3], gradient: &mut [Simd4]);
}

/// A force between vertices that keep a distance.
pub trait Strained {
    /// A rate of relative change of length [1/s] that no element of the part exceeds, from the velocities `v` [m/s] of all
    /// vertices; `part` are the part's own.
    fn strain_rate_bound(&self, part: Range<usize>, v: &[Vec3]) -> f64;

    /// Largest rate of relative change of length [1/s].
    fn strain_rate(&self, motion: &PartMotion<'_>) -> f64;

    /// The most stretched edge of the cloth: strain and vertices in solver order; `None` if the elements are no edges of it.
    fn largest_strain(&self, x: &[Vec3]) -> Option<(f64, [usize; 2])>;
}

/// A force whose elements can yield: the state of those that have is in checkpoints.
pub trait Plastic {
    /// Takes over from the positions `x` [m] of all vertices, at a state free of collisions, what stays for good.
    fn update_plasticity(&mut self, x: &[Vec3]);

    /// Adds what [`Plastic::update_plasticity`] has changed, by the vertices of the elements in solver order. Every part adds all of its
    /// elements: what is built anew on a rank finds those that count elsewhere, too.
    fn save_elements(&self, rows: &mut ElementRows);

    /// Takes what was remembered of all elements whose vertices are on this rank.
    fn restore_elements(&mut self, rows: &ElementRows);
}

/// A force whose elements can break: those that have are in checkpoints.
pub trait Breakable {
    /// Lets go what is pulled too hard in the positions `x` [m] of all vertices, at a state free of collisions at the time `time`
    /// [s]; returns how many elements that count at this part.
    fn break_overloaded(&mut self, x: &[Vec3], time: f64) -> u64;

    /// Calls `visit` for each broken element, at every part that has it.
    fn visit_broken(&self, visit: &mut dyn FnMut(BrokenElement));

    /// Takes what was remembered of all elements whose vertices are on this rank: the time at which they broke.
    fn restore_broken(&mut self, rows: &ElementRows);
}

/// An element that has broken.
#[derive(Debug, Clone, Copy)]
pub struct BrokenElement {
    /// Its vertices in solver order.
    pub vertices: [u32; 4],
    /// Time at which it broke [s].
    pub time: f64,
    /// Number of the seam that it belongs to.
    pub owner: usize,
    /// Whether it counts at this part, of all that have it.
    pub counts: bool,
}

/// Purpose of a velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// v½ in B.2: it takes the positions to the end of the step.
    Positions,
    /// v' in B.8: the velocity at the end of the step.
    Motion,
}

/// The step as a change of velocities sees it.
#[derive(Clone, Copy)]
#[cfg_attr(not(feature = "effects"), expect(dead_code, reason = "the effects that look at it have this feature"))]
pub(crate) struct FilterStep<'a> {
    /// The split of the vertices.
    pub(crate) parts: &'a Parts,
    /// Inverse masses of the local vertices by axis, zero where held [1/kg]; ghosts are those of their owners.
    pub(crate) mobility: &'a [Vec3],
    /// Positions of the local vertices [m], likewise.
    pub(crate) x: &'a [Vec3],
    /// Length of the step [s].
    pub(crate) dt: f64,
    /// Purpose of the velocities.
    pub(crate) purpose: Purpose,
}

/// A change of velocities after self-repulsion, in B.2 and B.8.
pub(crate) trait VelocityFilter: Send + Sync {
    /// Names of its stages in B.2 and in B.8.
    fn stages(&self) -> [&'static str; 2];

    /// Changes the velocities `v` of the local vertices [m/s]; ghosts of these need not be those of their owners, before or
    /// after.
    fn apply(&mut self, step: &FilterStep<'_>, v: &mut [Vec3], metrics: &mut Metrics);
}

//! All forces at given positions and velocities, and their derivatives as the matrix of an implicit step.

use crate::Vec3;
use crate::block_matrix::{BlockMatrix, PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, ForceContext, PartMotion, PartView};
use crate::parallel::for_each_part::{PerPart, PerVertex};
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::parallel::simd4::Simd4;
use crate::solve::implicit_velocity::PartForces;

/// Slots of the blocks of elements in the matrix: for each part and each of its forces the slots of all elements that the force
/// visits.
#[derive(Debug)]
pub struct ElementSlots(Vec<Vec<Vec<Slot>>>);

impl ElementSlots {
    /// Slots of each force of a part.
    pub fn of_part(&self, part: usize) -> &[Vec<Slot>] {
        &self.0[part]
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        self.0.iter().flatten().map(|slots| size_of_val(slots.as_slice())).sum()
    }
}

/// A matrix of zeros for the elements of these forces, and where their blocks are in it.
pub fn matrix_of(parts: &Parts, forces: &PartForces) -> (BlockMatrix, ElementSlots) {
    let visit = |force: &dyn Force, visit: &mut dyn FnMut(&[u32])| {
        force.linearised().into_iter().for_each(|force| force.visit_elements(visit));
    };
    let matrix = BlockMatrix::new(parts, &|part, each| forces[part].iter().for_each(|force| visit(&**force, each)));
    let slots_of_force = |force: &dyn Force, rows: &PartBlocks| {
        let mut slots = Vec::new();
        visit(force, &mut |vertices| slots.extend(rows.slots(vertices)));
        slots.shrink_to_fit();
        slots
    };
    let of_part = |(forces, rows): (&Vec<Box<dyn Force>>, &PartBlocks)| {
        forces.iter().map(|force| slots_of_force(&**force, rows)).collect()
    };
    let slots = forces.iter().zip(matrix.parts()).map(of_part).collect();
    (matrix, ElementSlots(slots))
}

/// Rows of a part with the slots of its forces, and the factors of their derivatives.
struct Assembly<'a> {
    factors: BlockFactors,
    /// Slots of each force.
    slots: &'a [Vec<Slot>],
    rows: &'a mut PartBlocks,
}

/// Inputs of a force evaluation.
#[derive(Clone, Copy)]
pub(crate) struct ForceEvaluation<'a> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// Parts that are worked on; forces on the others and their rows of the matrix stay what they were.
    pub worked_on: &'a [bool],
    /// Positions of the local vertices [m], ghosts like those of their owners.
    pub x: &'a [Vec3],
    /// Velocities, likewise [m/s].
    pub v: &'a [Vec3],
    /// Fraction of the step that they belong to.
    pub fraction: f64,
    /// Inputs of the forces in addition to positions and velocities.
    pub context: ForceContext<'a>,
}

impl ForceEvaluation<'_> {
    /// The forces on own vertices [N]: those that depend on positions and those that depend on velocities.
    pub(crate) fn forces(&self, forces: &mut PartForces, f: &mut [Vec3]) {
        self.parts.for_each((PerVertex(f), PerPart(forces)), &|part, (f, forces)| {
            if self.worked_on[part] {
                self.of_part(part, &mut forces.0[0], f.0, None);
            }
        });
    }

    /// The same, and the matrix `M + damping · D + stiffness · K` there; `matrix` and `slots` are those of [`matrix_of`].
    pub(crate) fn linearise(
        &self,
        forces: &mut PartForces,
        f: &mut [Vec3],
        factors: BlockFactors,
        matrix: &mut BlockMatrix,
        slots: &ElementSlots,
    ) {
        let slices = (PerVertex(f), PerPart(forces), PerPart(matrix.parts_mut()));
        self.parts.for_each(slices, &|part, (f, forces, rows)| {
            if self.worked_on[part] {
                let assembly = Assembly { factors, slots: slots.of_part(part), rows: &mut rows.0[0] };
                self.of_part(part, &mut forces.0[0], f.0, Some(assembly));
            }
        });
    }

    fn of_part(&self, part: usize, forces: &mut [Box<dyn Force>], out: &mut [Vec3], assembly: Option<Assembly<'_>>) {
        let range = self.parts.ranges()[part].clone();
        let masses = &self.masses[range.clone()];
        let Self { x, fraction, context, .. } = *self;
        let view = PartView { start: range.start, masses, x, fraction, context };
        let mut f = [Simd4::ZERO; PART_SIZE];
        view.update(forces, &mut f);
        let f = &mut f[..range.len()];
        PartMotion::with(range, x, self.v, |motion| {
            for force in forces.iter() {
                force.add_damping(motion, f);
                let drag = force.vertex_drag().iter().zip(motion.own_v);
                f.iter_mut().zip(drag).for_each(|(f, (drag, v))| *f -= *v * *drag);
            }
        });
        out.iter_mut().zip(&*f).for_each(|(out, f)| *out = Vec3::from(*f));
        let Some(Assembly { factors, slots, rows }) = assembly else { return };
        rows.clear();
        masses.iter().enumerate().for_each(|(vertex, mass)| rows.add_scalar(vertex, *mass));
        for (force, slots) in forces.iter().zip(slots) {
            let drag = force.vertex_drag().iter().enumerate();
            drag.for_each(|(vertex, drag)| rows.add_scalar(vertex, factors.damping * drag));
            if let Some(force) = force.linearised() {
                force.add_blocks(&view, factors, slots, rows);
            }
        }
    }
}

#[cfg(test)]
mod tests;

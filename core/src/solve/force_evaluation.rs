//! All forces at given positions and velocities, and their derivatives as the matrix of an implicit step.

use crate::Vec3;
use crate::block_matrix::{BlockMatrix, PartBlocks};
use crate::effects::force::{BlockFactors, ForceContext, PartMotion, PartView};
use crate::parallel::for_each_part::{PerPart, PerVertex};
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::parallel::simd4::Simd4;
use crate::solve::implicit_velocity::PartForces;

/// Where forces are evaluated.
#[derive(Clone, Copy)]
pub(crate) struct ForceEvaluation<'a> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// Parts that are worked on; forces on the others and their rows of the matrix stay what they were.
    pub solved: &'a [bool],
    /// Positions of the local vertices [m], ghosts like those of their owners.
    pub x: &'a [Vec3],
    /// Velocities, likewise [m/s].
    pub v: &'a [Vec3],
    /// Fraction of the step that they belong to.
    pub fraction: f64,
    /// What forces see beside them.
    pub around: ForceContext<'a>,
}

impl ForceEvaluation<'_> {
    /// The forces on own vertices [N]: those that depend on positions and those that depend on velocities.
    pub(crate) fn forces(&self, forces: &mut PartForces, f: &mut [Vec3]) {
        self.parts.for_each((PerVertex(f), PerPart(forces)), &|part, (f, forces)| {
            if self.solved[part] {
                self.of_part(part, &mut forces.0[0], f.0, None);
            }
        });
    }

    /// The same, and the matrix `M + damping · D + stiffness · K` there.
    pub(crate) fn linearise(
        &self,
        forces: &mut PartForces,
        f: &mut [Vec3],
        factors: BlockFactors,
        matrix: &mut BlockMatrix,
    ) {
        let slices = (PerVertex(f), PerPart(forces), PerPart(matrix.parts_mut()));
        self.parts.for_each(slices, &|part, (f, forces, rows)| {
            if self.solved[part] {
                self.of_part(part, &mut forces.0[0], f.0, Some((factors, &mut rows.0[0])));
            }
        });
    }

    fn of_part(
        &self,
        part: usize,
        forces: &mut [Box<dyn crate::effects::force::Force>],
        out: &mut [Vec3],
        assembly: Option<(BlockFactors, &mut PartBlocks)>,
    ) {
        let range = self.parts.ranges()[part].clone();
        let masses = &self.masses[range.clone()];
        let Self { x, fraction, around, .. } = *self;
        let view = PartView { start: range.start, masses, x, fraction, around };
        let mut f = [Simd4::ZERO; PART_SIZE];
        view.update(forces, &mut f);
        let f = &mut f[..range.len()];
        PartMotion::with(range, x, self.v, |motion| forces.iter().for_each(|force| force.add_damping(motion, f)));
        out.iter_mut().zip(&*f).for_each(|(out, f)| *out = Vec3::from(*f));
        let Some((factors, rows)) = assembly else { return };
        rows.clear();
        masses.iter().enumerate().for_each(|(vertex, mass)| rows.add_scalar(vertex, *mass));
        forces.iter().for_each(|force| force.add_blocks(&view, factors, rows));
    }
}

#[cfg(test)]
mod tests;

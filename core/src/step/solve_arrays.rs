//! Arrays of the two solves of a semi-implicit step.

use rayon::prelude::*;

use crate::Vec3;
use crate::parallel::CHUNK;
use crate::parallel::parts::Parts;
use crate::scene::Scene;
use crate::solve::conjugate_gradient::ConjugateGradient;
use crate::solve::implicit_velocity::{EffectiveMasses, PartForces};

/// Arrays of the two solves; made once.
#[derive(Debug)]
pub(super) struct SolveArrays {
    /// (x + x')/2 [m].
    pub(super) x_middle: Vec<Vec3>,
    /// The explicit part of a solve, v + dt/2 · M⁻¹F [m/s].
    pub(super) explicit: Vec<Vec3>,
    /// Masses of the solves where a force has a drag on each vertex.
    pub(super) effective_masses: EffectiveMasses,
    /// Velocities that forces see in B.5 [m/s]; empty if none looks.
    pub(super) v_seen: Vec<Vec3>,
    pub(super) cg: ConjugateGradient,
}

impl SolveArrays {
    /// Arrays for the local vertices; `sees_velocities` if forces look at velocities.
    pub(super) fn new(scene: &Scene, forces: &PartForces, sees_velocities: bool) -> Self {
        let vertices = vec![Vec3::zeros(); scene.parts().local_count()];
        Self {
            v_seen: if sees_velocities { vertices.clone() } else { Vec::new() },
            x_middle: vertices.clone(),
            explicit: vertices,
            effective_masses: EffectiveMasses::new(forces, scene.masses()),
            cg: ConjugateGradient::new(scene.parts()),
        }
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        (2 * self.x_middle.len() + self.v_seen.len()) * size_of::<Vec3>()
            + self.effective_masses.bytes()
            + self.cg.bytes()
    }

    /// The positions of B.5: (x + x')/2.
    pub(super) fn set_middle(&mut self, x: &[Vec3], x_new: &[Vec3]) {
        let chunks = self.x_middle.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK));
        chunks.zip(x_new.par_chunks(CHUNK)).for_each(|((middle, x), x_new)| {
            for ((middle, x), x_new) in middle.iter_mut().zip(x).zip(x_new) {
                *middle = (x + x_new) * 0.5;
            }
        });
    }

    /// The velocity at the middle as B.1 to B.4 predict it, for forces that look at velocities: v½, and what bodies changed at
    /// the start.
    pub(super) fn predict_velocity(&mut self, parts: &Parts, v_half: &[Vec3], v_star: &[Vec3], v: &[Vec3]) {
        if !self.v_seen.is_empty() {
            self.v_seen.copy_from_slice(v_half);
            self.v_seen.iter_mut().zip(v_star.iter().zip(v)).for_each(|(seen, (v_star, v))| *seen += v_star - v);
            parts.halo().update(parts.ranks(), &mut self.v_seen);
        }
    }
}

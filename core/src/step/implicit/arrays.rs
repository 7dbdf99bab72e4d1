//! Working memory of an implicit step: its matrix, and an array for each quantity of a stage.

use crate::Vec3;
use crate::block_matrix::BlockMatrix;
use crate::contact::repulsion::pair_forces::PairForce;
use crate::long_steps::SETTLED_PAIR;
use crate::parallel::parts::Parts;
use crate::solve::force_evaluation::{ElementSlots, matrix_of};
use crate::solve::implicit_velocity::PartForces;
use crate::solve::preconditioned_cg::PreconditionedCg;
use crate::step::StepReport;

/// Arrays of implicit steps; made once.
#[derive(Debug)]
pub(crate) struct StageArrays {
    pub(super) matrix: BlockMatrix,
    pub(super) slots: ElementSlots,
    pub(super) cg: PreconditionedCg,
    /// Velocities that the step starts with, contacts that rest in the motion of their bodies [m/s].
    pub(in crate::step) v_start: Vec<Vec3>,
    /// Positions and velocities of the stage that is worked on, and velocities of the first [m], [m/s].
    pub(in crate::step) x: Vec<Vec3>,
    pub(in crate::step) v: Vec<Vec3>,
    pub(in crate::step) v_first: Vec<Vec3>,
    /// Velocities of own vertices at the end of the stage if there were no forces [m/s].
    pub(in crate::step) v_inertial: Vec<Vec3>,
    /// Forces on own vertices at the start, and at the stage [N].
    pub(super) f_start: Vec<Vec3>,
    pub(super) f: Vec<Vec3>,
    /// Impulse that a solve is to balance [N s].
    pub(super) residual: Vec<Vec3>,
    /// The same with the forces of pairs that the solve before has found [N s].
    pub(super) solved_residual: Vec<Vec3>,
    /// Change of the velocities by a solve [m/s].
    pub(in crate::step) change: Vec<Vec3>,
    /// Pairs of cloth in touch at the stage.
    pub(super) pairs: Vec<PairForce>,
    /// Whether some rank has a force that is implicit by rounds alone.
    pub(super) has_iterated: bool,
    /// Own parts that the solves work on.
    pub(in crate::step) worked_on: Vec<bool>,
    /// Own vertices of pairs that stages have left unsettled in too large a share of a part, by their numbers in the scene; some on all ranks
    /// where any has such a part.
    pub(in crate::step) unsettled_vertices: Option<Vec<u32>>,
    /// Whether a stage of the step has left a pair unsettled on some rank.
    pub(in crate::step) has_unsettled_pair: bool,
}

impl StageArrays {
    /// Pairs whose distance the last solve has changed so much, in a step of `dt` [s], that the stage is not settled.
    pub(super) fn unsettled(&self, dt: f64) -> impl Iterator<Item = &PairForce> {
        self.pairs.iter().filter(move |pair| pair.last_change * dt > SETTLED_PAIR)
    }

    /// Hands on whether stages since the last report have left parts unsettled, and the vertices.
    pub(super) fn report_unsettled(&mut self, report: &mut StepReport) {
        if let Some(vertices) = self.unsettled_vertices.take() {
            report.unsettled = true;
            report.concerned.extend(vertices);
        }
    }

    /// Arrays for the local vertices, and the matrix of these forces. All ranks call it together.
    pub(crate) fn new(parts: &Parts, forces: &PartForces) -> Self {
        let (matrix, slots) = matrix_of(parts, forces);
        let cg = PreconditionedCg::new(parts, &matrix);
        let has_iterated = parts.ranks().any(forces.iter().flatten().any(|force| force.is_iterated()));
        let (local, own) = (vec![Vec3::zeros(); parts.local_count()], vec![Vec3::zeros(); parts.own().len()]);
        Self {
            matrix,
            slots,
            cg,
            v_start: local.clone(),
            x: local.clone(),
            v: local.clone(),
            v_first: local.clone(),
            v_inertial: own.clone(),
            f_start: own.clone(),
            f: own.clone(),
            residual: own.clone(),
            solved_residual: own,
            change: local,
            pairs: Vec::new(),
            has_iterated,
            worked_on: vec![true; parts.count()],
            unsettled_vertices: None,
            has_unsettled_pair: false,
        }
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        let vectors = 5 * self.x.len() + 5 * self.f.len();
        vectors * size_of::<Vec3>()
            + self.pairs.capacity() * size_of::<PairForce>()
            + self.slots.bytes()
            + self.matrix.bytes()
            + self.cg.bytes()
    }
}

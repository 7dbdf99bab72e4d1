//! The lines of the implicit step that are its own: TR-BDF2, linearised at a prediction (`docs/theory/tr_bdf2.md`).
//!
//! ```text
//! B.1  v₁ = v + α dt (a(x, v) + a(x₁, v₁)),   x₁ = x + α dt (v + v₁)        trapezoid to t + γ dt, γ = 2 − √2, α = γ/2
//!      v₂ = w v₁ − u v + α dt a(x₂, v₂),      x₂ = w x₁ − u x + α dt v₂     BDF2 over the step, w = 1/(γ(2−γ)), u = w − 1
//!      v½ = (x₂ − x)/dt
//! B.5  v₂ once more, with the positions and contacts that B.2 to B.4 have found
//! B.6  v' = v₂
//! ```
//!
//! Each stage is solved by Newton's method ([`crate::step::implicit`]) from a prediction of second order: of v₁ with the last acceleration, of
//! v₂ with the acceleration of the first stage. Pairs of cloth repel each other in the solves, so that B.2 and B.8 limit strain alone.

mod stages;

use super::{Line, Step};
use crate::clock::Watch;
use crate::state::State;

/// γ, the end of the first stage as a fraction of the step: the value for which both stages have the same matrix.
const GAMMA: f64 = 2.0 - std::f64::consts::SQRT_2;
/// α, what the forces of each stage weigh in it.
const ALPHA: f64 = 0.5 * GAMMA;
/// w and u, what the first stage and the start weigh in the second one.
const W: f64 = 1.0 / (GAMMA * (2.0 - GAMMA));
const U: f64 = W - 1.0;

impl<'a> Step<'a> {
    /// The implicit step, TR-BDF2: B.1 has both of its stages, and B.5 the second one again.
    pub(crate) const TR_BDF2_LISTING: [Line<'a>; 10] = [
        ("B.1", Self::implicit_half_velocity),
        ("B.2", Self::limit_half_strain),
        ("B.3", Self::positions),
        ("B.4", Self::collide_with_bodies),
        ("B.5", Self::implicit_end_velocity),
        ("B.6", Self::take_end),
        ("B.7", Self::rub_on_bodies),
        ("B.8", Self::limit_final_strain),
        ("end", Self::keep_acceleration),
        ("end", Self::end),
    ];

    /// B.1: both stages. v½ is the mean velocity of the step that they lead to.
    pub(super) fn implicit_half_velocity(&mut self) {
        let watch = Watch::start();
        let resting = self.find_resting();
        let (parts, dt, retries) = (self.parts, self.settings.dt, self.settings.retries);
        let mut solver = self.stage_solver();
        solver.active.set(parts, resting);
        solver.arrays.has_unsettled_pair = false;
        let first = stages::first_stage(&mut solver);
        let is_taken_back = retries && (first.worse || solver.arrays.unsettled_vertices.is_some());
        self.report_stage(first, "B.1");
        if !is_taken_back {
            let second = stages::second_stage(&mut self.stage_solver());
            self.report_stage(second, "B.1");
        }
        let Self { cloth, metrics, .. } = self;
        let (x, scratch) = (&cloth.state.x, &mut cloth.scratch);
        let ends = scratch.stages.iter().flat_map(|arrays| &arrays.x);
        for ((v_half, end), x) in scratch.v_half.iter_mut().zip(ends).zip(x) {
            *v_half = (end - x) / dt;
        }
        metrics.add_time("B.1 velocity".into(), watch.seconds(), 1);
    }

    /// B.5: v₂ once more where B.2 to B.4 may have changed positions, velocities or contacts.
    pub(super) fn implicit_end_velocity(&mut self) {
        if self.contacts.bodies.is_none() && self.contacts.cloth.is_none() && self.dynamics.filters.is_empty() {
            return;
        }
        let watch = Watch::start();
        let (parts, own, dt) = (self.parts, self.parts.own(), self.settings.dt);
        let met = self
            .contacts
            .bodies
            .as_ref()
            .map_or_else(Vec::new, |collision| collision.met(&self.cloth.scratch.v_star[own], dt));
        let [x_new, v_star] = [&mut self.cloth.scratch.x_new, &mut self.cloth.scratch.v_star].map(std::mem::take);
        let outcome = stages::second_stage_again(&mut self.stage_solver(), &x_new, &v_star, met);
        (self.cloth.scratch.x_new, self.cloth.scratch.v_star) = (x_new, v_star);
        self.report_stage(outcome, "B.5");
        if self.contacts.bodies.is_some() {
            let is_wrong = self.cloth.scratch.active.is_wrong();
            self.metrics.count_once(parts.ranks(), "friction_unsettled", u64::from(is_wrong));
        }
        if let Some(contact) = self.contacts.cloth.as_ref().filter(|contact| contact.repels()) {
            contact.count_pair_forces(self.metrics);
            let is_unsettled = self.cloth.scratch.stages.as_ref().is_some_and(|arrays| arrays.has_unsettled_pair);
            let is_kept = is_unsettled && !self.report.unsettled;
            self.metrics.count_once(parts.ranks(), "layers_unsettled", u64::from(is_kept));
        }
        self.metrics.add_time("B.5 velocity".into(), watch.seconds(), 1);
    }

    /// B.6: the state is at its end.
    pub(super) fn take_end(&mut self) {
        let State { x, v, .. } = &mut self.cloth.state;
        std::mem::swap(x, &mut self.cloth.scratch.x_new);
        if let Some(arrays) = &self.cloth.scratch.stages {
            v.copy_from_slice(&arrays.v);
        }
    }

    /// Stores the acceleration between the stages, (v₂ − v₁)/((1 − γ) dt), from which the next step predicts.
    pub(super) fn keep_acceleration(&mut self) {
        let a = &mut self.cloth.state.a;
        let over = 1.0 / ((1.0 - GAMMA) * self.settings.dt);
        if let Some(arrays) = &self.cloth.scratch.stages {
            let stages = arrays.v.iter().zip(&arrays.v_first);
            a.iter_mut().zip(stages).for_each(|(a, (end, first))| *a = (end - first) * over);
            // A vertex that B.4 has caught has fallen freely in the first stage. Its change between the stages is an impact.
            self.cloth.scratch.active.prescribe_accelerations(a, self.settings.dt);
        }
        self.parts.halo().update(self.parts.ranks(), a);
    }
}

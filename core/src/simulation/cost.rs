//! Cost of a frame, by effect.

use super::{FrameSummary, Simulation};
use crate::clock::Watch;
use crate::effects::cost::FrameCost;
use crate::effects::force::{PartForce, PartMotion, PartView};
use crate::effects::registry::build_all;
use crate::effects::spec::Effect;
use crate::effects::spec::NANOSECONDS;
use crate::error::Problems;
use crate::parallel::parts::PART_SIZE;
use crate::parallel::simd4::Simd4;

/// Times that each force is evaluated to see how long it takes.
const REPEATS: u32 = 8;

/// Updates of every force in a time step: B.1 and B.5.
const UPDATES: f64 = 2.0;

/// Damping products in a time step besides those of the iterations: the first residual of each solve.
const RESIDUALS: f64 = 2.0;

/// The time steps of a frame as they are planned.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSteps {
    /// Their number.
    pub steps: f64,
    /// Longest step that the elastic forces and the scene allow [s].
    pub longest: f64,
    /// Cause of the limit on the length of a step, in words.
    pub because: String,
}

impl PlannedSteps {
    /// The cause where the scene itself limits the step.
    pub const MAX_DT: &str = "solver.max_dt";
    /// The cause where long steps are as long as they may be.
    pub const STEPS_PER_FRAME: &str = "solver.steps_per_frame";
}

impl Simulation {
    /// Time steps of a frame, if every step is as long as the elastic forces and the scene allow, and what asks for them.
    pub fn planned_steps(&self) -> PlannedSteps {
        let description = self.scene.description();
        let max_dt = description.solver.max_dt.unwrap_or(f64::INFINITY);
        let longest = self.limit.longest(&description.solver, 1.0);
        let is_implicit = description.solver.integrator.spec().is_implicit;
        let stiffest = self.plan.iter().min_by(|a, b| a.longest_step.total_cmp(&b.longest_step));
        let because = match stiffest {
            _ if max_dt <= longest => PlannedSteps::MAX_DT.to_owned(),
            Some(effect) if is_implicit && effect.longest_step > longest => PlannedSteps::STEPS_PER_FRAME.to_owned(),
            Some(effect) => {
                let of = effect.garment.as_ref().map_or(String::new(), |garment| format!(" of garment \"{garment}\""));
                format!("the stiffness of `{}`{of}", effect.name)
            }
            None => "the frame rate".to_owned(),
        };
        PlannedSteps { steps: self.limit.planned_steps(&description.solver), longest, because }
    }

    /// Returns the cost of the frame of `summary`, which ran just now. Forces are timed by themselves, on one thread
    /// and where the cloth is now; all others by their stages.
    ///
    /// # Errors
    /// Never, unless the effects cannot be built a second time.
    pub fn measured_cost(&self, summary: &FrameSummary) -> Result<FrameCost, Problems> {
        let (steps, iterations) = (summary.steps as f64, summary.cg_iterations as f64);
        let seconds = |(_, effect): &mut (_, Effect)| {
            let [update, product] = self.time_forces(&mut effect.forces);
            steps * UPDATES * update + (iterations + steps * RESIDUALS) * product
        };
        let forces: Vec<f64> = build_all(&self.scene)?.iter_mut().map(seconds).collect();
        Ok(FrameCost::measured(&self.plan, &summary.metrics, summary.steps, summary.cg_iterations, &forces))
    }

    /// Seconds of one update and of one damping product of these forces.
    fn time_forces(&self, forces: &mut [PartForce]) -> [f64; 2] {
        let (parts, masses) = (self.scene.parts(), self.scene.masses());
        let context = self.force_context();
        let mut nanoseconds = [0; 2];
        for (part, force) in forces.iter_mut() {
            let range = parts.ranges()[*part].clone();
            let x = &self.cloth.state.x[..];
            let view = PartView { start: range.start, masses: &masses[range.clone()], x, fraction: 0.0, context };
            let (mut own_x, mut f) = ([Simd4::ZERO; PART_SIZE], [Simd4::ZERO; PART_SIZE]);
            let (own_x, f) = (Simd4::copy(&x[range.clone()], &mut own_x), &mut f[..range.len()]);
            // The fastest of them: what else the machine does is not to count.
            let mut fastest = [u64::MAX; 2];
            for _ in 0..REPEATS {
                let watch = Watch::start();
                force.update(&view, own_x, f);
                fastest[0] = fastest[0].min(watch.nanoseconds());
                PartMotion::with(range.clone(), x, &self.cloth.state.v, |motion| {
                    let watch = Watch::start();
                    force.add_damping(motion, f);
                    fastest[1] = fastest[1].min(watch.nanoseconds());
                });
            }
            nanoseconds = [0, 1].map(|i| nanoseconds[i] + fastest[i]);
        }
        nanoseconds.map(|all| all as f64 / NANOSECONDS)
    }
}

//! Cost of effects, measured in a frame that ran. Nothing is predicted of a frame that did not run: the iterations of
//! the solves and the contacts of a frame follow from its motion, and decide its time.

use crate::effects::REGISTRY;
use crate::effects::registry::PlannedEffect;
use crate::metrics::Metrics;

/// Effects that a stage of a step may belong to, those that have it as their own first; none if it is one of time
/// integration. The proximity list serves both halves of self-contact; its time goes to the first that is there.
pub fn owners(stage: &str) -> impl Iterator<Item = &'static str> {
    let own = REGISTRY.iter().filter(move |spec| spec.report.stages.contains(&stage));
    own.chain(REGISTRY.iter().filter(move |spec| spec.report.shared_stages.contains(&stage))).map(|spec| spec.name)
}

/// Seconds of a frame, by effect.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameCost {
    /// Time steps.
    pub steps: f64,
    /// Iterations of all solves.
    pub iterations: f64,
    /// Duration of each effect of the plan, in the plan's order [s].
    pub effects: Vec<f64>,
    /// Duration of time integration [s].
    pub method: f64,
}

impl FrameCost {
    /// Returns the total duration [s].
    pub fn total(&self) -> f64 {
        self.method + self.effects.iter().sum::<f64>()
    }

    /// Takes the mean over `frames` frames that were counted together.
    pub fn divide(&mut self, frames: f64) {
        self.effects.iter_mut().for_each(|seconds| *seconds /= frames);
        (self.steps, self.iterations, self.method) =
            (self.steps / frames, self.iterations / frames, self.method / frames);
    }

    /// Measured in a frame: `forces` are the seconds that each effect's forces took in it, the
    /// stages say the rest.
    pub(crate) fn measured(
        plan: &[PlannedEffect],
        metrics: &Metrics,
        steps: u64,
        iterations: u64,
        forces: &[f64],
    ) -> Self {
        let mut effects = forces.to_vec();
        let mut method: f64 =
            metrics.stages().iter().map(|stage| stage.seconds).sum::<f64>() - forces.iter().sum::<f64>();
        for stage in metrics.stages() {
            let place = owners(&stage.name).find_map(|owner| plan.iter().position(|effect| effect.name == owner));
            if let Some(place) = place {
                effects[place] += stage.seconds;
                method -= stage.seconds;
            }
        }
        Self { steps: steps as f64, iterations: iterations as f64, effects, method: method.max(0.0) }
    }
}

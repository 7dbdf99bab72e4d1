//! Frames of very many steps: said before a run begins where settings alone cause them, said while one lasts, and given up
//! where the cloth takes far more steps than that.

use std::time::{Duration, Instant};

use drapery_core::error::{Problem, StepError};
use drapery_core::simulation::{PlannedSteps, Simulation};

/// Steps of a frame from which on it is said before a run: twenty times those of shirts with edges of 5 mm.
const MANY: f64 = 1e4;

/// Steps of a frame that are refused: even of a single triangle it would take minutes, of a garment days.
const MOST: f64 = 1e7;

/// Factor over the planned steps that a frame may take. Steps are shortened up to 512 times where collisions are
/// hard, and that seldom for a whole frame.
const EXCESS: f64 = 1e3;

/// Steps that every frame may take: where cloth sets no limit, one is planned.
const LEAST: f64 = 1e5;

/// Time for which a run is silent within a frame.
const SILENCE: Duration = Duration::from_secs(10);

/// Frames that the scene's settings make long: a warning, or a problem where no machine would finish one.
pub(super) fn judge(planned: &PlannedSteps, min_dt: f64, warnings: &mut Vec<String>) -> Option<Problem> {
    let PlannedSteps { steps, longest, because } = planned;
    let what =
        format!("a frame takes about {steps:.0} time steps, none longer than {longest:.2e} s, limited by {because}");
    if *longest < min_dt {
        let what = format!(
            "time steps can be no longer than {longest:.2e} s, limited by {because}, and no shorter than {min_dt:e} s"
        );
        return Some(Problem::scene("solver.min_dt", what, advice(because)));
    }
    if *steps > MOST {
        return Some(Problem::scene("solver", what, advice(because)));
    }
    if *steps > MANY {
        warnings.push(format!("{what}: {}", advice(because)));
    }
    None
}

fn advice(because: &str) -> String {
    if because == PlannedSteps::MAX_DT {
        return "raise it, or leave it out".to_owned();
    }
    if because == PlannedSteps::STEPS_PER_FRAME {
        return "lower it".to_owned();
    }
    "lower that stiffness, make the cloth heavier or its edges longer, or check for a number in the wrong unit"
        .to_owned()
}

/// Watches a frame that is being computed.
#[derive(Debug)]
pub(super) struct Watch {
    /// Collision-free states after which it is given up.
    allowed: u64,
    last_report: Instant,
}

impl Watch {
    /// Starts to watch the frame to which the simulation goes next; `states` counts the states that it already has on
    /// the way there.
    pub(super) fn start(simulation: &Simulation, states: u64) -> Self {
        let most = (EXCESS * simulation.planned_steps().steps).max(LEAST);
        // Below 10^10, by what is refused before.
        Self { allowed: states.saturating_add(most as u64), last_report: Instant::now() }
    }

    /// Whether there is something to say or to decide after this number of states.
    pub(super) fn is_due(&self, states: u64) -> bool {
        states >= self.allowed || self.last_report.elapsed() > SILENCE
    }

    /// Whether the time has come to say how far the frame is; it then has been said.
    pub(super) fn tells(&mut self) -> bool {
        let due = self.last_report.elapsed() > SILENCE;
        if due {
            self.last_report = Instant::now();
        }
        due
    }

    /// Gives up a frame that has taken too many states.
    pub(super) fn check(&self, simulation: &Simulation, states: u64) -> Result<(), StepError> {
        if states < self.allowed {
            return Ok(());
        }
        let (frame, time) = (simulation.frame() + 1, simulation.state().time);
        let planned = simulation.planned_steps().steps;
        Err(StepError::TooManySteps { frame, time, steps: states, planned })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the message, and whether the frame is refused.
    fn judged(steps: f64, longest: f64, because: &str) -> (String, bool) {
        let planned = PlannedSteps { steps, longest, because: because.to_owned() };
        let mut warnings = Vec::new();
        match judge(&planned, 1e-9, &mut warnings) {
            Some(problem) => (problem.to_string(), true),
            None => (warnings.concat(), false),
        }
    }

    #[test]
    fn frames_of_many_steps_are_said_with_their_cause_and_endless_ones_refused() {
        assert_eq!(judged(480.0, 8.7e-5, "the stiffness of `stretch`"), (String::new(), false));
        let (said, refused) = judged(4e4, 1e-6, PlannedSteps::MAX_DT);
        assert!(
            said.contains("about 40000 time steps") && said.contains("solver.max_dt: raise it") && !refused,
            "{said}"
        );
        let (said, refused) = judged(4e4, 1e-6, PlannedSteps::STEPS_PER_FRAME);
        assert!(said.contains("solver.steps_per_frame: lower it") && !refused, "{said}");
        let (said, refused) = judged(4e8, 1e-7, "the stiffness of `membrane`");
        assert!(said.contains("`membrane`") && said.contains("help: lower that stiffness") && refused, "{said}");
        let (said, refused) = judged(100.0, 1e-12, "the stiffness of `membrane`");
        assert!(said.contains("solver.min_dt: time steps can be no longer than 1.00e-12 s") && refused, "{said}");
    }
}

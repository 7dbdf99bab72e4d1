//! Running cases one after the other.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

use crate::bench::{Bench, Conditions};
use crate::case::{Case, Figure};
use crate::combine;
use crate::tangles;

/// Outcome of a case.
#[derive(Debug, Clone)]
pub struct Verdict {
    /// Number of the case, or the seed of a combination of cases.
    pub id: String,
    /// Difficulty of the case.
    pub title: String,
    /// Required outcome.
    pub must: String,
    /// Its figures; none if it could not be finished.
    pub figures: Vec<Figure>,
    /// Why it could not be finished, or what broke a rule of every case.
    pub trouble: Option<String>,
    /// Counts of what was not as it should be.
    pub degradations: Vec<(String, u64)>,
    /// Elapsed time [s].
    pub seconds: f64,
}

impl Verdict {
    /// Whether everything is as it must be.
    pub fn passed(&self) -> bool {
        self.trouble.is_none() && !self.figures.is_empty() && self.figures.iter().all(Figure::holds)
    }
}

/// Runs a case.
pub fn judge(case: &Case, conditions: Conditions<'_>) -> Verdict {
    measured([case.id, case.title, case.must], conditions, case.judge)
}

/// Runs the combination of three cases of a seed.
pub fn judge_combination(seed: u64, conditions: Conditions<'_>) -> Verdict {
    let (id, title) = (format!("seed {seed}"), combine::title(seed));
    let must = "what holds for every case holds for the three together";
    measured([&id, &title, must], conditions, |bench| combine::judge(bench, seed))
}

/// Runs the tangle of a seed.
pub fn judge_tangle(seed: u64, conditions: Conditions<'_>) -> Verdict {
    let id = format!("tangle {seed}");
    let must = "it comes free, with garments in the order of their layers";
    measured([&id, tangles::title(seed), must], conditions, |bench| tangles::judge(bench, seed))
}

/// Runs what judges. A panic is one of the ways to fail.
fn measured(
    [id, title, must]: [&str; 3],
    conditions: Conditions<'_>,
    judge: impl FnOnce(&mut Bench<'_>) -> Result<Vec<Figure>, String>,
) -> Verdict {
    let clock = Instant::now();
    let (outcome, degradations) = match Bench::new(conditions) {
        Err(trouble) => (Err(trouble), Vec::new()),
        Ok(mut bench) => {
            let outcome = catch_unwind(AssertUnwindSafe(|| judge(&mut bench)));
            (outcome.unwrap_or_else(|panic| Err(format!("panic: {}", words(&*panic)))), bench.into_degradations())
        }
    };
    let (figures, trouble) = match outcome {
        Ok(figures) => (figures, None),
        Err(trouble) => (Vec::new(), Some(trouble)),
    };
    let [id, title, must] = [id, title, must].map(str::to_owned);
    Verdict { id, title, must, figures, trouble, degradations, seconds: clock.elapsed().as_secs_f64() }
}

/// Returns the message of a panic.
fn words(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without words".to_owned())
}

/// Returns the number of cases that passed, the cases that failed, and the total time [s], as a text.
pub fn summary(verdicts: &[Verdict]) -> String {
    let failed: Vec<&str> = verdicts.iter().filter(|v| !v.passed()).map(|v| v.id.as_str()).collect();
    let seconds: f64 = verdicts.iter().map(|v| v.seconds).sum();
    let passed = verdicts.len() - failed.len();
    let which = if failed.is_empty() { String::new() } else { format!("; failed: {}", failed.join(", ")) };
    format!("{passed} of {} cases passed in {seconds:.0} s{which}", verdicts.len())
}

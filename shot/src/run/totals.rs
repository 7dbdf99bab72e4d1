//! Time and counts of a run so far, in all its attempts: kept beside every checkpoint, so that the table at the end
//! covers the whole shot.

use drapery_core::metrics::Metrics;
use drapery_core::simulation::FrameSummary;
use serde_json::{Value, json};

use crate::run_record::reader::FrameRow;

/// Sums over the frames that are done, and what was done since the last one.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Totals {
    /// Stages and counts of all frames.
    pub(super) metrics: Metrics,
    /// Seconds of all frames.
    pub(super) seconds: f64,
    /// The frame that is being computed.
    pub(super) partial: Partial,
}

/// Work since the last frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Partial {
    /// Summary of the work of the solver; `None` right after a frame.
    pub(super) summary: Option<FrameSummary>,
    /// Time spent on reading, simulating and writing.
    pub(super) spent: Metrics,
    /// States free of collisions.
    pub(super) sub_step: u64,
}

impl Totals {
    /// As JSON.
    pub(super) fn to_json(&self) -> Value {
        let summary = self.partial.summary.as_ref().map(|summary| {
            json!({
                "steps": summary.steps,
                "dt_min": summary.dt_min,
                "dt_max": summary.dt_max,
                "cg_iterations": summary.cg_iterations,
                "metrics": metrics_json(&summary.metrics),
            })
        });
        json!({
            "seconds": self.seconds,
            "metrics": metrics_json(&self.metrics),
            "partial": {"summary": summary, "spent": metrics_json(&self.partial.spent)},
        })
    }

    /// From JSON, on the way to frame `next`; what is missing counts as nothing.
    pub(super) fn from_json(value: &Value, next: i64, sub_step: u64) -> Self {
        let partial = &value["partial"];
        let summary = partial["summary"].as_object().map(|_| {
            let summary = &partial["summary"];
            FrameSummary {
                steps: summary["steps"].as_u64().unwrap_or(0),
                dt_min: summary["dt_min"].as_f64().unwrap_or(f64::INFINITY),
                dt_max: summary["dt_max"].as_f64().unwrap_or(0.0),
                cg_iterations: summary["cg_iterations"].as_u64().unwrap_or(0),
                metrics: metrics_from(&summary["metrics"]),
                ..FrameSummary::empty(next)
            }
        });
        Self {
            metrics: metrics_from(&value["metrics"]),
            seconds: value["seconds"].as_f64().unwrap_or(0.0),
            partial: Partial { summary, spent: metrics_from(&partial["spent"]), sub_step },
        }
    }
}

/// Adds up time and counts of the frames of a record: the known part where the account beside a checkpoint is lost.
pub(super) fn of_rows<'a>(rows: impl Iterator<Item = &'a FrameRow>, sub_step: u64) -> Totals {
    let mut totals = Totals { partial: Partial { sub_step, ..Partial::default() }, ..Totals::default() };
    for row in rows {
        totals.seconds += row.seconds;
        for stage in &row.stages {
            totals.metrics.add_time(stage.stage.clone().into(), stage.seconds, stage.calls);
        }
        for (name, amount) in &row.counts {
            totals.metrics.add_count(name.clone().into(), *amount);
        }
    }
    totals
}

/// Lists: an object would not keep the order in which the table at the end shows them.
fn metrics_json(metrics: &Metrics) -> Value {
    let stages = metrics.stages().iter().map(|stage| match stage.spread {
        None => json!([stage.name, stage.seconds, stage.calls]),
        Some([least, most]) => json!([stage.name, stage.seconds, stage.calls, least, most]),
    });
    let counts = metrics.counts().iter().map(|(name, amount)| json!([name, amount]));
    json!({"stages": stages.collect::<Vec<_>>(), "counts": counts.collect::<Vec<_>>()})
}

/// The inverse; what is not of that form is left out.
fn metrics_from(value: &Value) -> Metrics {
    let mut metrics = Metrics::default();
    for stage in value["stages"].as_array().into_iter().flatten() {
        if let (Some(name), Some(seconds), Some(calls)) = (stage[0].as_str(), stage[1].as_f64(), stage[2].as_u64()) {
            metrics.add_time(name.to_owned().into(), seconds, calls);
            if let (Some(least), Some(most)) = (stage[3].as_f64(), stage[4].as_f64()) {
                metrics.add_spread(name, [least, most]);
            }
        }
    }
    for count in value["counts"].as_array().into_iter().flatten() {
        if let (Some(name), Some(amount)) = (count[0].as_str(), count[1].as_u64()) {
            metrics.add_count(name.to_owned().into(), amount);
        }
    }
    metrics
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_come_back_as_they_were() {
        let mut totals = Totals { seconds: 12.25, ..Totals::default() };
        totals.metrics.count("crossings", 3);
        totals.metrics.count("body_contacts", 7);
        totals.metrics.add_time("simulate".into(), 1.5, 4);
        totals.metrics.add_time("A neighbours".into(), 1.0, 4);
        totals.metrics.add_spread("A neighbours", [0.5, 1.25]);
        let mut summary =
            FrameSummary { steps: 3, dt_min: 0.1, dt_max: 0.3, cg_iterations: 9, ..FrameSummary::empty(5) };
        summary.metrics.count("repulsions", 2);
        totals.partial = Partial { summary: Some(summary), spent: Metrics::default(), sub_step: 2 };
        totals.partial.spent.add_time("read inputs".into(), 0.5, 1);
        assert_eq!(Totals::from_json(&totals.to_json(), 5, 2), totals);
        assert_eq!(Totals::from_json(&Value::Null, 5, 0), Totals::default());
    }
}

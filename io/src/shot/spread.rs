//! How the work of a frame was spread over the ranks.

use drapery_core::metrics::Metrics;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// What one rank tells.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct OfRank {
    /// Names and seconds of its stages.
    pub(super) stages: Vec<(String, f64)>,
    /// Messages, bytes and collective operations.
    pub(super) sent: [u64; 3],
}

/// Counts of what ranks send each other, all ranks together; only in runs on many.
const SENT: [&str; 3] = ["messages", "bytes_sent", "collectives"];

/// What stages took on the ranks, and what these sent.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Spread {
    stages: Vec<StageSpread>,
    sent: [u64; 3],
}

/// Seconds of a stage on the ranks.
#[derive(Debug, Clone, PartialEq)]
pub struct StageSpread {
    /// Its name.
    pub name: String,
    /// On the rank that took the least.
    pub min: f64,
    /// Mean of all ranks.
    pub mean: f64,
    /// On the rank that took the most.
    pub max: f64,
}

impl Spread {
    /// Of what all ranks tell; a rank without a stage took no time in it.
    pub(super) fn of(all: &[OfRank]) -> Self {
        let mut spread = Self::default();
        let mut names: Vec<&String> = Vec::new();
        for (name, _) in all.iter().flat_map(|rank| &rank.stages) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        for name in names {
            let of_rank =
                |rank: &OfRank| rank.stages.iter().find(|(n, _)| n == name).map_or(0.0, |(_, seconds)| *seconds);
            let seconds: Vec<f64> = all.iter().map(of_rank).collect();
            spread.stages.push(StageSpread {
                name: name.clone(),
                min: seconds.iter().copied().fold(f64::INFINITY, f64::min),
                mean: seconds.iter().sum::<f64>() / seconds.len() as f64,
                max: seconds.iter().copied().fold(0.0, f64::max),
            });
        }
        spread.sent = std::array::from_fn(|n| all.iter().map(|rank| rank.sent[n]).sum());
        spread
    }

    /// Adds what was sent to the counts of a frame.
    pub(super) fn count(&self, counts: &mut Metrics) {
        SENT.into_iter().zip(self.sent).for_each(|(name, amount)| counts.count(name, amount));
    }

    /// Adds the stages of another frame.
    pub(super) fn add(&mut self, other: &Self) {
        for stage in &other.stages {
            match self.stages.iter_mut().find(|known| known.name == stage.name) {
                Some(known) => {
                    known.min += stage.min;
                    known.mean += stage.mean;
                    known.max += stage.max;
                }
                None => self.stages.push(stage.clone()),
            }
        }
    }

    /// Seconds of a stage on the ranks, if they have it.
    pub fn of_stage(&self, name: &str) -> Option<&StageSpread> {
        self.stages.iter().find(|stage| stage.name == name)
    }

    /// As JSON: what [`Spread::from_json`] reads.
    pub(super) fn to_json(&self) -> Value {
        let stage = |stage: &StageSpread| json!([stage.name, stage.min, stage.mean, stage.max]);
        self.stages.iter().map(stage).collect()
    }

    /// The stages in JSON; what is not of that form is left out.
    pub(super) fn from_json(value: &Value) -> Self {
        let stage = |stage: &Value| {
            let (min, mean, max) = (stage[1].as_f64()?, stage[2].as_f64()?, stage[3].as_f64()?);
            Some(StageSpread { name: stage[0].as_str()?.to_owned(), min, mean, max })
        };
        Self { stages: value.as_array().into_iter().flatten().filter_map(stage).collect(), sent: [0; 3] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_that_a_rank_does_not_have_took_no_time_there() {
        let rank = |stages: &[(&str, f64)], sent| OfRank {
            stages: stages.iter().map(|(name, seconds)| ((*name).to_owned(), *seconds)).collect(),
            sent,
        };
        let spread = Spread::of(&[rank(&[("dt", 1.0)], [1, 10, 2]), rank(&[("dt", 3.0), ("B.1", 4.0)], [2, 5, 2])]);
        let figures = |name: &str| spread.of_stage(name).map(|stage| (stage.min, stage.mean, stage.max));
        assert_eq!(figures("dt"), Some((1.0, 2.0, 3.0)));
        assert_eq!(figures("B.1"), Some((0.0, 2.0, 4.0)));
        assert_eq!(figures("C"), None);
        let mut counts = Metrics::default();
        spread.count(&mut counts);
        assert_eq!(["messages", "bytes_sent", "collectives"].map(|name| counts.counted(name)), [3, 15, 4]);
        let mut twice = spread.clone();
        twice.add(&spread);
        assert_eq!(twice.of_stage("dt").map(|stage| stage.max), Some(6.0));
        assert_eq!(Spread::from_json(&twice.to_json()).of_stage("B.1"), twice.of_stage("B.1"));
    }
}

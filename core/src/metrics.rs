//! Seconds and counts of a run. A value passed by reference, never a global.

use std::borrow::Cow;

use crate::clock::Watch;
use crate::parallel::message::codec;
use crate::parallel::ranks::Ranks;

/// Seconds and calls of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Label, for example `B.1 velocity`.
    pub name: Cow<'static, str>,
    /// Seconds spent in it.
    pub seconds: f64,
    /// Number of times it ran.
    pub calls: u64,
    /// Shortest and longest time of a rank [s], where there are several; `seconds` is then their mean.
    pub spread: Option<[f64; 2]>,
}

/// Stages in the order of their first call, and counts.
///
/// ```
/// use drapery_core::Metrics;
/// let (mut of_frame, mut of_run) = (Metrics::default(), Metrics::default());
/// of_frame.count("crossings", 2);
/// for _ in 0..3 {
///     of_run.add(&of_frame);
/// }
/// assert_eq!((of_run.counted("crossings"), of_run.counted("never counted")), (6, 0));
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metrics {
    stages: Vec<Stage>,
    counts: Vec<(Cow<'static, str>, u64)>,
    /// Seconds of all stages when the record was taken out last.
    last_seconds: f64,
}

/// Stages and counts of a rank, as it sends them.
struct RankRecord {
    stages: Vec<RankStage>,
    counts: Vec<(String, u64)>,
}

/// Seconds and calls of one stage of a rank.
struct RankStage {
    name: String,
    seconds: f64,
    calls: u64,
}

codec!(struct RankRecord { stages, counts });
codec!(struct RankStage { name, seconds, calls });

impl Metrics {
    /// Runs `work` as the stage `name`.
    pub fn stage<T>(&mut self, name: &'static str, work: impl FnOnce(&mut Self) -> T) -> T {
        let watch = Watch::start();
        let result = work(self);
        self.add_time(Cow::Borrowed(name), watch.seconds(), 1);
        result
    }

    /// Adds to a count.
    pub fn count(&mut self, name: &'static str, amount: u64) {
        self.add_count(Cow::Borrowed(name), amount);
    }

    /// Adds to a count of what all ranks do alike and together: it is counted on one of them.
    pub fn count_once(&mut self, ranks: &Ranks, name: &'static str, amount: u64) {
        self.count(name, if ranks.is_first() { amount } else { 0 });
    }

    /// Adds to a count of any name, such as one that was read.
    pub fn add_count(&mut self, name: Cow<'static, str>, amount: u64) {
        match self.counts.iter_mut().find(|(n, _)| *n == name) {
            Some((_, total)) => *total += amount,
            None => self.counts.push((name, amount)),
        }
    }

    /// Stages in the order of their first call.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Counts in the order of their first use.
    pub fn counts(&self) -> &[(Cow<'static, str>, u64)] {
        &self.counts
    }

    /// Seconds of all stages when the record was taken out last.
    pub(crate) fn last_seconds(&self) -> f64 {
        self.last_seconds
    }

    /// One count; zero if it was never used.
    pub fn counted(&self, name: &str) -> u64 {
        self.counts.iter().find(|(n, _)| *n == name).map_or(0, |(_, total)| *total)
    }

    /// Adds another record to this one.
    pub fn add(&mut self, other: &Self) {
        for stage in &other.stages {
            self.add_time(stage.name.clone(), stage.seconds, stage.calls);
            if let Some([least, most]) = stage.spread {
                self.add_spread(&stage.name, [least, most]);
            }
        }
        for (name, amount) in &other.counts {
            self.add_count(name.clone(), *amount);
        }
    }

    /// Takes the record out and leaves an empty one that keeps the names, so that later use allocates nothing.
    pub fn take(&mut self) -> Self {
        let taken = self.clone();
        self.last_seconds = self.stages.iter().map(|stage| stage.seconds).sum();
        for stage in &mut self.stages {
            (stage.seconds, stage.calls, stage.spread) = (0.0, 0, None);
        }
        for (_, total) in &mut self.counts {
            *total = 0;
        }
        taken
    }

    /// Adds to a stage of any name.
    pub fn add_time(&mut self, name: Cow<'static, str>, seconds: f64, calls: u64) {
        match self.stages.iter_mut().find(|s| s.name == name) {
            Some(stage) => (stage.seconds, stage.calls) = (stage.seconds + seconds, stage.calls + calls),
            None => self.stages.push(Stage { name, seconds, calls, spread: None }),
        }
    }

    /// Adds to the shortest and the longest time of a rank in a stage.
    pub fn add_spread(&mut self, name: &str, [least, most]: [f64; 2]) {
        if let Some(stage) = self.stages.iter_mut().find(|s| s.name == name) {
            let [a, b] = stage.spread.unwrap_or_default();
            stage.spread = Some([a + least, b + most]);
        }
    }

    /// The records of all ranks as one, on rank 0: counts added, seconds as their mean and spread. The others keep their own.
    /// All ranks call it together.
    pub fn over_ranks(self, ranks: &Ranks) -> Self {
        if ranks.is_alone() {
            return self;
        }
        let stage = |s: &Stage| RankStage { name: s.name.to_string(), seconds: s.seconds, calls: s.calls };
        let stages = self.stages.iter().map(stage).collect();
        let counts = self.counts.iter().map(|(name, amount)| (name.to_string(), *amount)).collect();
        let records = ranks.gather_encoded("stages and counts of a rank", &RankRecord { stages, counts });
        if !ranks.is_first() {
            return self;
        }
        let mut together = Self::default();
        for RankStage { name, calls, .. } in records.iter().flat_map(|record| &record.stages) {
            if together.stages.iter().any(|stage| stage.name == *name) {
                continue;
            }
            let of_rank =
                |record: &RankRecord| record.stages.iter().find(|s| s.name == *name).map_or(0.0, |s| s.seconds);
            let seconds: Vec<f64> = records.iter().map(of_rank).collect();
            let mean = seconds.iter().sum::<f64>() / seconds.len() as f64;
            together.add_time(Cow::Owned(name.clone()), mean, *calls);
            let least = seconds.iter().copied().fold(f64::INFINITY, f64::min);
            together.add_spread(name, [least, seconds.iter().copied().fold(0.0, f64::max)]);
        }
        for (name, amount) in records.into_iter().flat_map(|record| record.counts) {
            together.add_count(Cow::Owned(name), amount);
        }
        together
    }
}

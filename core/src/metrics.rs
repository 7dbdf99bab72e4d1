//! Seconds and counts of a run: the only place with a clock. A value passed by reference, never a global.

use std::borrow::Cow;
use std::time::Instant;

/// Seconds and calls of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Label, for example `B.1/forces`.
    pub name: Cow<'static, str>,
    /// Seconds spent in it.
    pub seconds: f64,
    /// How often it ran.
    pub calls: u64,
}

/// Stages in the order of their first call, and counts.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metrics {
    stages: Vec<Stage>,
    counts: Vec<(Cow<'static, str>, u64)>,
}

impl Metrics {
    /// Runs `work` as the stage `name`.
    pub fn stage<T>(&mut self, name: &'static str, work: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let result = work(self);
        self.add_time(Cow::Borrowed(name), start.elapsed().as_secs_f64(), 1);
        result
    }

    /// Adds to a count.
    pub fn count(&mut self, name: &'static str, amount: u64) {
        self.add_count(Cow::Borrowed(name), amount);
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

    /// One count; zero if it was never used.
    pub fn counted(&self, name: &str) -> u64 {
        self.counts.iter().find(|(n, _)| *n == name).map_or(0, |(_, total)| *total)
    }

    /// Adds another record to this one.
    pub fn add(&mut self, other: &Self) {
        for stage in &other.stages {
            self.add_time(stage.name.clone(), stage.seconds, stage.calls);
        }
        for (name, amount) in &other.counts {
            self.add_count(name.clone(), *amount);
        }
    }

    /// Takes the record out and leaves an empty one that keeps the names, so that later use allocates nothing.
    pub fn take(&mut self) -> Self {
        let taken = self.clone();
        for stage in &mut self.stages {
            (stage.seconds, stage.calls) = (0.0, 0);
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
            None => self.stages.push(Stage { name, seconds, calls }),
        }
    }
}

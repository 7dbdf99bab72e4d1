//! Sample index to time in seconds, and back.

use crate::error::AlembicError;

/// Stored as time per cycle to say "acyclic".
const ACYCLIC: f64 = f64::MAX / 32.0;

/// Largest distance before a sample at which a time still counts as that sample, in mean sample steps. Frame times
/// such as 1001/24 are rounded differently by every program.
const INDEX_TOLERANCE: f64 = 1e-5;

/// Times of samples, shared by any number of properties.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeSampling {
    time_per_cycle: f64,
    times: Vec<f64>,
}

/// The three forms of a [`TimeSampling`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SamplingKind {
    /// One sample every fixed step.
    Uniform,
    /// A pattern of times repeated every cycle, such as shutter open and close of every frame.
    Cyclic,
    /// One stored time for every sample.
    Acyclic,
}

impl TimeSampling {
    /// One sample a second from 0 s: sampling 0 of every archive, used by static properties.
    pub fn identity() -> Self {
        Self { time_per_cycle: 1.0, times: vec![0.0] }
    }

    /// Sample i at `start + i * step` (s).
    pub fn uniform(start: f64, step: f64) -> Result<Self, AlembicError> {
        if step.is_nan() || step <= 0.0 {
            return Err(refuse(format!("the step is {step} s; it has to be positive")));
        }
        Self::checked(step, vec![start])
    }

    /// One sample a frame: the first at `first_frame / frames_per_second` (s).
    pub fn frames(first_frame: f64, frames_per_second: f64) -> Result<Self, AlembicError> {
        if frames_per_second.is_nan() || frames_per_second <= 0.0 {
            return Err(refuse(format!("{frames_per_second} frames per second; it has to be positive")));
        }
        Self::uniform(first_frame / frames_per_second, 1.0 / frames_per_second)
    }

    /// `times` (s) repeated every `time_per_cycle` (s); strictly increasing and within one cycle.
    pub fn cyclic(time_per_cycle: f64, times: Vec<f64>) -> Result<Self, AlembicError> {
        if times.len() < 2 {
            return Err(refuse("a cycle needs at least two times; use a uniform sampling".into()));
        }
        Self::checked(time_per_cycle, times)
    }

    /// Sample i at `times[i]` (s); strictly increasing. No property may have more samples than there are times.
    pub fn acyclic(times: Vec<f64>) -> Result<Self, AlembicError> {
        Self::checked(ACYCLIC, times)
    }

    /// A sampling from its stored form.
    pub(crate) fn checked(time_per_cycle: f64, times: Vec<f64>) -> Result<Self, AlembicError> {
        let Some((&first, &last)) = times.first().zip(times.last()) else {
            return Err(refuse("at least one time is needed".into()));
        };
        if !time_per_cycle.is_finite() || time_per_cycle < 0.0 || times.iter().any(|time| !time.is_finite()) {
            return Err(refuse("all times have to be finite and the cycle not negative".into()));
        }
        if times.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(refuse("times have to increase strictly".into()));
        }
        // Exporters round both sides differently: half a permille of a cycle is no error.
        if times.len() > 1 && last - first > time_per_cycle * 1.0005 {
            return Err(refuse(format!(
                "the times span {} s, more than the cycle of {time_per_cycle} s",
                last - first
            )));
        }
        Ok(Self { time_per_cycle, times })
    }

    /// Returns the form of this sampling, one of the three.
    pub fn kind(&self) -> SamplingKind {
        if self.time_per_cycle == ACYCLIC {
            SamplingKind::Acyclic
        } else if self.times.len() > 1 {
            SamplingKind::Cyclic
        } else {
            SamplingKind::Uniform
        }
    }

    /// Length of a cycle (s): the sample step of a uniform sampling. Meaningless for an acyclic one.
    pub fn time_per_cycle(&self) -> f64 {
        self.time_per_cycle
    }

    /// The stored times (s).
    pub fn stored_times(&self) -> &[f64] {
        &self.times
    }

    /// Time of sample `index` (s); past the end of an acyclic sampling, its last time.
    pub fn time(&self, index: usize) -> f64 {
        if self.kind() == SamplingKind::Acyclic {
            return self.times[index.min(self.times.len() - 1)]; // never empty: `checked`
        }
        let cycle = index / self.times.len();
        self.times[index % self.times.len()] + cycle as f64 * self.time_per_cycle
    }

    /// Largest index of `0..count` whose time is not after `time` (s); 0 when all are.
    pub fn floor_index(&self, time: f64, count: usize) -> usize {
        self.not_after(time, count).saturating_sub(1)
    }

    /// Smallest index of `0..count` whose time is not before `time` (s); the last when all are.
    pub fn ceil_index(&self, time: f64, count: usize) -> usize {
        let below = self.floor_index(time, count);
        if (self.time(below) - time).abs() <= self.tolerance(count) || time < self.time(below) {
            return below;
        }
        (below + 1).min(count.saturating_sub(1))
    }

    /// Index of `0..count` whose time is closest to `time` (s); the earlier of two equally close ones.
    pub fn near_index(&self, time: f64, count: usize) -> usize {
        let (below, above) = (self.floor_index(time, count), self.ceil_index(time, count));
        if time - self.time(below) <= self.time(above) - time { below } else { above }
    }

    /// The two samples around `time` (s) and the share of the second, 0..1. Both are equal on a sample (within the
    /// tolerance) and outside the sampled range.
    pub fn bracket(&self, time: f64, count: usize) -> (usize, usize, f64) {
        let (below, above) = (self.floor_index(time, count), self.ceil_index(time, count));
        if below == above {
            return (below, above, 0.0);
        }
        let (t0, t1) = (self.time(below), self.time(above));
        (below, above, ((time - t0) / (t1 - t0)).clamp(0.0, 1.0))
    }

    /// True when both name the same times, so that one stored copy is enough.
    pub(crate) fn matches(&self, other: &Self) -> bool {
        self.kind() == other.kind()
            && (self.time_per_cycle - other.time_per_cycle).abs() < 1e-9
            && self.times == other.times
    }

    /// Most samples that a property with this sampling may have.
    pub(crate) fn most_samples(&self) -> usize {
        if self.kind() == SamplingKind::Acyclic { self.times.len() } else { usize::MAX }
    }

    fn tolerance(&self, count: usize) -> f64 {
        let steps = count.saturating_sub(1).max(1);
        INDEX_TOLERANCE * (self.time(steps) - self.time(0)) / steps as f64
    }

    /// Number of samples of `0..count` at or before `time`. Times increase, so a binary search is enough.
    fn not_after(&self, time: f64, count: usize) -> usize {
        let limit = time + self.tolerance(count);
        let (mut low, mut high) = (0, count);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.time(middle) <= limit {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        low
    }
}

fn refuse(reason: String) -> AlembicError {
    AlembicError::TimeSampling { reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_sampling_finds_every_frame_from_its_rounded_time() {
        let sampling = TimeSampling::frames(1001.0, 24.0).unwrap();
        for index in 0..500 {
            let time = (1001.0 + index as f64) / 24.0;
            assert_eq!(sampling.floor_index(time, 500), index);
            assert_eq!(sampling.ceil_index(time, 500), index);
            assert_eq!(sampling.near_index(time + 0.4 / 24.0, 500), index);
            assert_eq!(sampling.bracket(time, 500), (index, index, 0.0));
        }
    }

    #[test]
    fn times_outside_are_clamped() {
        let sampling = TimeSampling::frames(1.0, 24.0).unwrap();
        assert_eq!(sampling.bracket(-5.0, 10), (0, 0, 0.0));
        assert_eq!(sampling.bracket(99.0, 10), (9, 9, 0.0));
        assert_eq!(sampling.floor_index(0.0, 0), 0);
    }

    #[test]
    fn a_cyclic_sampling_repeats_its_times() {
        let sampling = TimeSampling::cyclic(1.0, vec![0.0, 0.25]).unwrap();
        assert_eq!([0, 1, 2, 3].map(|i| sampling.time(i)), [0.0, 0.25, 1.0, 1.25]);
        assert_eq!(sampling.floor_index(1.1, 8), 2);
        let (below, above, share) = sampling.bracket(0.625, 8);
        assert_eq!((below, above), (1, 2));
        assert!((share - 0.5).abs() < 1e-12);
    }

    #[test]
    fn an_acyclic_sampling_returns_its_own_times() {
        let sampling = TimeSampling::acyclic(vec![0.0, 0.1, 0.7]).unwrap();
        assert_eq!(sampling.time(2), 0.7);
        assert_eq!(sampling.bracket(0.4, 3).0, 1);
        assert_eq!(sampling.near_index(0.39, 3), 1);
        assert_eq!(sampling.near_index(0.41, 3), 2);
    }

    #[test]
    fn impossible_times_are_refused() {
        assert!(TimeSampling::frames(1.0, 0.0).is_err());
        assert!(TimeSampling::acyclic(vec![]).is_err());
        assert!(TimeSampling::acyclic(vec![0.0, 0.0]).is_err());
        assert!(TimeSampling::cyclic(0.1, vec![0.0, 0.5]).is_err());
        assert!(TimeSampling::uniform(f64::NAN, 1.0).is_err());
    }
}

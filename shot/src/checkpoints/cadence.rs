//! When to write a checkpoint: often enough that little is lost, seldom enough that it costs little.
//!
//! Checkpoints may take [`LARGEST_SHARE`] of the time of a run, beside [`ALLOWANCE`]: whatever was asked for, one is
//! put off until that holds. What the next one will cost is taken from the last ones. The clock is the caller's, so
//! that the rules can be tested.

use std::collections::VecDeque;

use drapery_io::checkpoint::Every;

/// Largest part of the time of a run that checkpoints take.
pub(super) const LARGEST_SHARE: f64 = 0.05;

/// Time that checkpoints may take beyond that share [s]: short shots get every checkpoint that is asked for.
pub(super) const ALLOWANCE: f64 = 5.0;

/// Shortest and longest time between two checkpoints when nothing is asked for [s].
pub(super) const AUTO: [f64; 2] = [60.0, 600.0];

/// At a frame, one is written after this part of the time that may pass: a frame is the better place to go on from, and
/// half the steps of a long frame need not be repeated for it.
const EARLY_AT_FRAMES: f64 = 0.75;

/// The next checkpoint is taken to cost as much as the most expensive of this many.
const REMEMBERED: usize = 3;

/// Decides when a checkpoint is due. All times are those of one clock that never goes back [s].
#[derive(Debug, Clone)]
pub(crate) struct Cadence {
    every: Every,
    start: f64,
    last: f64,
    frames: u64,
    spent: f64,
    costs: VecDeque<f64>,
}

impl Cadence {
    /// Starts at the time `now`, at which the state is as good as saved: it is the beginning, or was just read.
    pub(crate) fn new(every: Every, now: f64) -> Self {
        Self { every, start: now, last: now, frames: 0, spent: 0.0, costs: VecDeque::new() }
    }

    /// Tells that a frame was reached.
    pub(crate) fn frame_done(&mut self) {
        self.frames += 1;
    }

    /// Whether a checkpoint should be written at the time `now`; `at_frame` when no step was taken since a frame.
    ///
    /// Frames that are pinned, the end of a run and a stop are the caller's to know: they need no leave.
    pub(crate) fn due(&self, now: f64, at_frame: bool) -> bool {
        let early = if at_frame { EARLY_AT_FRAMES } else { 1.0 };
        let wanted = match self.every {
            Every::Auto => {
                let [shortest, longest] = AUTO;
                now - self.last >= early * (self.cost() / LARGEST_SHARE).clamp(shortest, longest)
            }
            Every::Frames(frames) => at_frame && self.frames >= frames,
            Every::Seconds(seconds) => now - self.last >= early * seconds,
        };
        wanted && self.spent + self.cost() <= LARGEST_SHARE * (now - self.start) + ALLOWANCE
    }

    /// Tells that a checkpoint was written, which took `seconds` and ended at the time `now`.
    pub(crate) fn saved(&mut self, now: f64, seconds: f64) {
        self.last = now;
        self.frames = 0;
        self.spent += seconds;
        self.costs.push_back(seconds);
        if self.costs.len() > REMEMBERED {
            self.costs.pop_front();
        }
    }

    /// Returns the time that the next checkpoint is expected to take [s]; nothing is known before the first.
    pub(crate) fn cost(&self) -> f64 {
        self.costs.iter().copied().fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs frames of `frame` seconds in `steps` steps each, checkpoints of `cost` seconds, for `length` seconds;
    /// returns the times at which checkpoints began and the time at which the run ended.
    fn simulate(every: Every, frame: f64, steps: u32, cost: f64, length: f64) -> (Vec<f64>, f64) {
        let (mut now, mut step, mut begun) = (0.0, 0, Vec::new());
        let mut cadence = Cadence::new(every, now);
        while now < length {
            now += frame / f64::from(steps);
            step += 1;
            let at_frame = step % steps == 0;
            if at_frame {
                cadence.frame_done();
            }
            if cadence.due(now, at_frame) {
                begun.push(now);
                now += cost;
                cadence.saved(now, cost);
            }
        }
        (begun, now)
    }

    #[test]
    fn words_become_frames_or_times() {
        let cases = [
            ("auto", Every::Auto),
            ("1f", Every::Frames(1)),
            ("250f", Every::Frames(250)),
            ("90s", Every::Seconds(90.0)),
            ("15m", Every::Seconds(900.0)),
            ("1.5h", Every::Seconds(5400.0)),
            ("1h30m", Every::Seconds(5400.0)),
        ];
        for (text, expected) in cases {
            assert_eq!(text.parse::<Every>(), Ok(expected), "{text}");
        }
    }

    #[test]
    fn what_is_no_cadence_is_refused_with_the_forms_that_are() {
        for text in [
            "", "10", "f", "-3f", "1.5f", "0f", "0s", "-1m", "infs", "nans", "10 f", "5min", "é", "ten", "1e300h",
            "9999d",
        ] {
            let error = text.parse::<Every>().unwrap_err();
            assert!(error.contains("15m") || error.contains("1f"), "{text}: {error}");
        }
    }

    #[test]
    fn a_cadence_in_frames_is_kept_when_checkpoints_are_cheap() {
        let (begun, _) = simulate(Every::Frames(10), 1.0, 4, 0.01, 101.0);
        assert_eq!(begun.len(), 10);
    }

    #[test]
    fn a_long_run_spends_at_most_a_twentieth_on_checkpoints_whatever_was_asked_for() {
        for every in [Every::Auto, Every::Frames(1), Every::Seconds(1.0), Every::Seconds(600.0)] {
            for (frame, cost) in [(0.1, 0.02), (1.0, 1.0), (10.0, 3.0), (5000.0, 40.0), (60.0, 200.0)] {
                let (begun, end) = simulate(every, frame, 10, cost, 1e5);
                let spent = begun.len() as f64 * cost;
                assert!(spent <= LARGEST_SHARE * end + ALLOWANCE, "{every:?} {frame} {cost}: {spent} of {end} s");
                assert!(!begun.is_empty(), "{every:?} {frame} {cost}: no checkpoint");
            }
        }
    }

    #[test]
    fn nothing_asked_for_means_at_least_every_ten_minutes_plus_a_step() {
        for (frame, cost) in [(0.1, 0.02), (45.0, 5.0), (7200.0, 1.0)] {
            let steps = 100;
            let (begun, end) = simulate(Every::Auto, frame, steps, cost, 5e4);
            let longest = begun.windows(2).map(|pair| pair[1] - pair[0]).fold(begun[0], f64::max);
            assert!(longest.max(end - begun[begun.len() - 1]) <= 600.0 + cost + frame / f64::from(steps) + 1e-6);
        }
    }

    #[test]
    fn a_time_that_was_asked_for_is_not_exceeded_and_ends_at_a_frame_if_one_is_near() {
        let (begun, _) = simulate(Every::Seconds(100.0), 7.0, 7, 0.5, 1000.0);
        let mut last = 0.0;
        for time in begun {
            assert!(time - last <= 100.5 + 1.0, "{time}");
            assert!(time - last >= 75.0, "{time}");
            last = time;
        }
    }

    #[test]
    fn frames_are_counted_only_at_frames() {
        let mut cadence = Cadence::new(Every::Frames(1), 0.0);
        cadence.frame_done();
        assert!(!cadence.due(1.0, false));
        assert!(cadence.due(1.0, true));
    }
}

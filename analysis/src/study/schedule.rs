//! One run after the other, the most useful first, never beyond the limit of time.
//!
//! The scene as it is runs first, for a share of the time: how far it comes is how many frames are studied, unless somebody
//! says. The share is such that all runs fit; where that would leave very few frames, such that those fit without which a
//! study says little. What another run will take is foretold from those that are done; one that would not fit is left out,
//! and one that takes much longer than was foretold is given up.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use drapery_io::error::IoError;

use crate::study::compare::Comparison;
use crate::study::error::StudyError;
use crate::study::record::{Omission, Role, Sample, Setting, Study};
use crate::study::sample::{self, Bench, Ended, Pace};
use crate::study::space::{self, RunRequest};

/// Folder of the states inside that of the study.
const STATES: &str = "states";

/// Share of the time that is kept for the pages, and the least of it [s].
const RESERVE: (f64, f64) = (0.03, 0.5);

/// Seconds that comparing a vertex of a frame with others takes, roughly: the last run must not come too late for that.
const COMPARE: f64 = 5e-7;

/// Frames that are compared at most, and at least where states are large.
const COMPARED: (usize, usize) = (24, 6);

/// Bytes of the states of a run at most, if that leaves enough frames.
const STATES_BYTES: usize = 64 << 20;

/// Start of the reason why a run was left out, where the reason is the time.
pub(crate) const NO_TIME: &str = "no time";

/// Frames that a study should have, if the runs without which it says nothing still fit.
const WANTED: usize = 12;

/// Share of the wanted runs, without repeats, that should fit into the time.
const FITTING: f64 = 0.9;

/// Times the base that have to be left besides a reference of each fineness.
const BESIDES: [f64; 3] = [10.0, 10.0, 5.0];

/// Factor on its predicted time that a run may take before it is given up, and seconds beyond that prediction that it
/// may take in any case.
const PATIENCE: (f64, f64) = (3.0, 3.0);

/// Observer of a study while it goes on.
pub trait Observer {
    /// Receives a note for the user of the study.
    fn note(&mut self, text: &str);

    /// A run begins; it is the `number`th of `all` and will take about `seconds`, if anything is known of that.
    fn begins(&mut self, wish: &RunRequest, number: usize, all: usize, seconds: Option<f64>);
}

/// The runs of one attempt at a study.
#[derive(Debug)]
pub(crate) struct Schedule<'a> {
    /// Context that all runs have in common.
    pub bench: &'a Bench<'a>,
    /// Folder of the study.
    pub folder: &'a Path,
    /// When the attempt began.
    pub begun: Instant,
    /// Time that it may take.
    pub limit: Duration,
    /// Seconds of earlier attempts.
    pub before: f64,
    /// Time of all runs, and of those without which a study says little, by that of the scene as it is.
    pub times: [f64; 2],
}

impl Schedule<'_> {
    /// Runs the scene as it is, the first of the wishes, and decides how fine the reference can be.
    ///
    /// # Errors
    /// It does not come to a single frame to compare; files cannot be read or written.
    pub(crate) fn run_base(
        &self,
        wishes: &[RunRequest],
        study: &mut Study,
        observer: &mut dyn Observer,
    ) -> Result<(), StudyError> {
        let folder = self.folder.join(STATES);
        std::fs::create_dir_all(&folder).map_err(|error| IoError::creating(&folder, error))?;
        let mut comparison = Comparison::of(study, self.folder)?;
        self.run_wish(0, wishes, (study, &mut comparison), observer)?;
        if study.fineness == 0 && !self.is_cancelled() {
            let base = study.base().map_or(0.0, |base| base.cost.with_overhead);
            let left = self.left(study);
            let times = |fineness: u32| space::reference_times(f64::from(fineness)).iter().sum::<f64>();
            let fits = |(fineness, besides): &(u32, f64)| left > (times(*fineness) + besides) * base;
            let found = space::FINENESS.into_iter().zip(BESIDES).find(fits).map(|(fineness, _)| fineness);
            study.fineness = found.unwrap_or(space::FINENESS[3]);
        }
        Ok(())
    }

    /// Runs all wishes that are not in the record and fit into the time; the record is written after each.
    ///
    /// # Errors
    /// Files cannot be read or written.
    pub(crate) fn run_all(
        &self,
        wishes: &[RunRequest],
        study: &mut Study,
        observer: &mut dyn Observer,
    ) -> Result<(), StudyError> {
        study.omitted.clear();
        let mut comparison = Comparison::of(study, self.folder)?;
        let mut repeats = (0, 0.0);
        for (number, wish) in wishes.iter().enumerate() {
            let Some(why) = self.run_wish(number, wishes, (study, &mut comparison), observer)? else { continue };
            let seconds = foretell(wish, wishes, study).unwrap_or(0.0);
            if wish.repeat > 0 {
                repeats = (repeats.0 + 1, repeats.1 + seconds);
            } else {
                study.omitted.push(Omission { label: wish.label(), why, seconds, are_repeats: false });
            }
        }
        if repeats.0 > 0 {
            let (label, why) = (format!("{} repeats that measure the spread of times", repeats.0), NO_TIME.to_owned());
            study.omitted.push(Omission { label, why, seconds: repeats.1, are_repeats: true });
        }
        Ok(())
    }

    /// Runs a wish if it is not in the record; returns why it is left out, if it is.
    fn run_wish(
        &self,
        number: usize,
        wishes: &[RunRequest],
        (study, comparison): (&mut Study, &mut Comparison<'_>),
        observer: &mut dyn Observer,
    ) -> Result<Option<String>, StudyError> {
        let wish = &wishes[number];
        if study.samples.iter().any(|sample| is_of(sample, wish)) {
            return Ok(None);
        }
        let foretold = foretell(wish, wishes, study);
        let left = self.left(study);
        if study.base().is_some_and(|base| !base.is_whole()) {
            return Ok(Some("the scene as it is failed".to_owned()));
        }
        if foretold.is_some_and(|seconds| seconds > left) || left <= 0.0 {
            let needs = foretold.map_or(String::new(), |seconds| format!("about {seconds:.0} s were needed, "));
            return Ok(Some(format!("{NO_TIME}: {needs}{:.0} s were left", left.max(0.0))));
        }
        observer.begins(wish, number + 1, wishes.len(), foretold);
        match self.run_one(wish, study, (left, foretold))? {
            Ended::OutOfTime(frame) if wish.role == Role::Base && wish.is_first() => {
                return Err(StudyError::Asked(format!(
                    "the time limit is too short for a study: after {:.0} s the scene as it is had reached frame {frame}\n  \
                     help: raise --max-wall, or study fewer frames with --frames",
                    self.begun.elapsed().as_secs_f64()
                )));
            }
            Ended::OutOfTime(frame) => {
                return Ok(Some(format!("cancelled after frame {frame}: it took longer than estimated")));
            }
            Ended::Sample(ended) => {
                let (sample, compared) = *ended;
                if study.compared.is_empty() {
                    study.compared = compared;
                }
                study.samples.push(sample);
                comparison.latest(study)?;
            }
        }
        study.seconds = self.before + self.begun.elapsed().as_secs_f64();
        study.write(self.folder)?;
        Ok(None)
    }

    fn is_cancelled(&self) -> bool {
        self.bench.cancelled.load(Ordering::Relaxed)
    }

    /// Seconds that are left for runs.
    fn left(&self, study: &Study) -> f64 {
        if self.is_cancelled() {
            return 0.0;
        }
        let limit = self.limit.as_secs_f64();
        let compare = COMPARE * (study.scene.points as usize * study.compared.len()) as f64;
        let reserve = (RESERVE.0 * limit).max(RESERVE.1) + compare.min(limit / 4.0);
        limit - reserve - self.begun.elapsed().as_secs_f64()
    }

    fn run_one(
        &self,
        wish: &RunRequest,
        study: &Study,
        (left, foretold): (f64, Option<f64>),
    ) -> Result<Ended, StudyError> {
        let now = Instant::now();
        let patience = foretold.map_or(left, |seconds| (PATIENCE.0 * seconds).max(seconds + PATIENCE.1).min(left));
        let deadline = now + Duration::from_secs_f64(patience);
        // Copies are compared with the base at once; repeats are not compared.
        let name = format!("{STATES}/{}.states", study.samples.len());
        let states = (wish.repeat == 0).then(|| self.folder.join(&name));
        let run = |pace: &Pace<'_>| sample::run(self.bench, wish, pace, (states.as_deref(), deadline));
        let last = study.scene.frames[1];
        let mut ended = match (study.compared.as_slice(), study.asked.frames) {
            ([], None) => {
                let [until, longest] =
                    self.times.map(|times| now + Duration::from_secs_f64(left / (FITTING * times.max(1.0))));
                run(&Pace::Trial { until, longest, wanted: WANTED, last, most: compared_at_most(study) })?
            }
            ([], Some([_, asked])) => {
                let last = asked.min(last);
                run(&Pace::Fixed(&spread(study.scene.start, last, compared_at_most(study))))?
            }
            (compared, _) => run(&Pace::Fixed(compared))?,
        };
        if let Ended::Sample(ended) = &mut ended
            && ended.0.is_whole()
            && wish.repeat == 0
        {
            ended.0.states = name;
        }
        Ok(ended)
    }
}

impl RunRequest {
    fn is_first(&self) -> bool {
        self.copy == 0 && self.repeat == 0
    }
}

/// Whether a sample is what a wish asks for.
fn is_of(sample: &Sample, wish: &RunRequest) -> bool {
    // The role may have turned out to be another one: a parameter that changes the mesh.
    is_same(&sample.setting, &wish.setting)
        && (sample.copy, sample.repeat) == (wish.copy, wish.repeat)
        && is_reference(sample.role) == is_reference(wish.role)
}

fn is_same(a: &Setting, b: &Setting) -> bool {
    (&a.settings, a.threads, a.ranks, a.body_frames) == (&b.settings, b.threads, b.ranks, b.body_frames)
}

fn is_reference(role: Role) -> bool {
    matches!(role, Role::Reference | Role::ReferenceCheck | Role::ReferenceCoarse)
}

/// Seconds that a wish will take; `None` before anything has run. Known from a run of the same settings, else from the base
/// and the rough factor of the wish, corrected by what the latest run of the same kind took.
fn foretell(wish: &RunRequest, wishes: &[RunRequest], study: &Study) -> Option<f64> {
    let whole = |sample: &&Sample| sample.is_whole();
    let same = study.samples.iter().filter(whole).rfind(|sample| is_same(&sample.setting, &wish.setting));
    if let Some(same) = same {
        return Some(same.cost.with_overhead);
    }
    let base = study.base()?.cost.with_overhead;
    let rough = |sample: &Sample| wishes.iter().find(|wish| is_of(sample, wish)).map(|wish| wish.times);
    let kind = |role: Role| if is_reference(role) { Role::Reference } else { role };
    let alike = study
        .samples
        .iter()
        .filter(whole)
        .rfind(|sample| kind(sample.role) == kind(wish.role) && sample.role != Role::Base && sample.is_own());
    let correction = alike.and_then(|sample| Some(sample.cost.with_overhead / (base * rough(sample)?)));
    Some(base * wish.times * correction.unwrap_or(1.0))
}

fn compared_at_most(study: &Study) -> usize {
    let frame = study.scene.points as usize * 2 * 3 * size_of::<f64>();
    (STATES_BYTES / frame.max(1)).clamp(COMPARED.1, COMPARED.0)
}

/// At most `most` frames from `start`, which is not one of them, to `last`, evenly spread.
fn spread(start: i64, last: i64, most: usize) -> Vec<i64> {
    let stride = (last - start).unsigned_abs().div_ceil(most as u64).max(1);
    let mut frames: Vec<i64> = (start + 1..=last).rev().step_by(stride as usize).collect();
    frames.reverse();
    frames
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::record::Cost;

    fn wish(role: Role, label: &str, times: f64) -> RunRequest {
        let settings = vec![("key".to_owned(), label.to_owned())];
        RunRequest { role, setting: Setting { settings, ..Setting::default() }, times, ..RunRequest::default() }
    }

    fn sample(wish: &RunRequest, seconds: f64) -> Sample {
        let cost = Cost { with_overhead: seconds, ..Cost::default() };
        Sample { role: wish.role, setting: wish.setting.clone(), cost, ..Sample::default() }
    }

    #[test]
    fn what_a_run_will_take_is_learnt_from_those_that_are_done() {
        let wishes = [
            wish(Role::Base, "base", 1.0),
            wish(Role::Accuracy, "half", 2.0),
            wish(Role::Accuracy, "quarter", 4.0),
            wish(Role::ReferenceCheck, "check", 8.0),
        ];
        let mut study = Study::default();
        assert_eq!(foretell(&wishes[0], &wishes, &study), None);
        study.samples.push(sample(&wishes[0], 3.0));
        assert_eq!(foretell(&wishes[1], &wishes, &study), Some(6.0));
        // It took half as long as was thought: so will the next one of its kind.
        study.samples.push(sample(&wishes[1], 3.0));
        assert_eq!(foretell(&wishes[2], &wishes, &study), Some(6.0));
        assert_eq!(foretell(&wishes[3], &wishes, &study), Some(24.0));
        let repeat = RunRequest { repeat: 1, ..wishes[1].clone() };
        assert_eq!(foretell(&repeat, &wishes, &study), Some(3.0));
    }

    #[test]
    fn compared_frames_end_with_the_last_one() {
        assert_eq!(spread(1000, 1004, 24), [1001, 1002, 1003, 1004]);
        let frames = spread(0, 100, 24);
        assert!(frames.len() <= 24 && frames.last() == Some(&100) && frames[0] > 0, "{frames:?}");
        assert!(frames.windows(2).all(|pair| pair[1] - pair[0] == 5));
    }
}

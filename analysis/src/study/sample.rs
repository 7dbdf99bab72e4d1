//! One run of a study: the scene with its changes, simulated to the last frame, with its costs and its states.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use drapery_core::metrics::Metrics;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::simulation::FrameSummary;
use drapery_io::scene_file::SceneFile;
use drapery_io::shot_description::ShotDescription;
use drapery_io::{memory, platform};
use drapery_shot::ShotError;
use drapery_shot::scene_source::SceneSource;
use drapery_shot::steps::{SteppedFrame, SteppedShot};
use sha2::{Digest, Sha256};

use crate::local_run::on_local_ranks;
use crate::study::cloth::{Cloth, FrameState};
use crate::study::error::StudyError;
use crate::study::random::Random;
use crate::study::record::{Cost, Failure, Figures, Sample, Setting, StageCost};
use crate::study::space::RunRequest;
use crate::study::states::StatesWriter;

/// Bytes of a digest of states: enough that no two runs share them by accident.
const DIGEST: usize = 8;

/// Largest shift of the positions of shifted copies, as a share of the size of the cloth.
pub(super) const SHIFT: f64 = 1e-10;

/// Frame of a run that has not started.
const NOWHERE: i64 = i64::MIN;

/// Context that all runs of a study have in common.
#[derive(Debug)]
pub(crate) struct Bench<'a> {
    /// The scene, with what is set in it for all runs.
    pub scene: &'a SceneSource,
    /// Whether the study is to end.
    pub cancelled: &'a AtomicBool,
    /// Size of the cloth at the start [m].
    pub size: f64,
    /// Thickness of the thinnest garment [m].
    pub thickness: f64,
    /// Threads of the study.
    pub threads: usize,
}

/// Frames that a run simulates and compares.
#[derive(Debug)]
pub(super) enum Pace<'a> {
    /// These, ascending; the last one is the end.
    Fixed(&'a [i64]),
    /// As many as there is time for, and no more than up to `last`; at most `most` of them are compared.
    Trial {
        /// When it is enough, if there are as many frames as wanted.
        until: Instant,
        /// When it is enough in any case.
        longest: Instant,
        /// Frames that are wanted.
        wanted: usize,
        /// Last frame.
        last: i64,
        /// Compared frames at most.
        most: usize,
    },
}

/// Outcome of a run.
#[derive(Debug)]
pub(super) enum Ended {
    /// It came to its last frame or the solver gave up; with the compared frames of a trial.
    Sample(Box<(Sample, Vec<i64>)>),
    /// Its time was up after this frame.
    OutOfTime(i64),
}

/// The scene file with the settings of a run.
///
/// # Errors
/// The scene does not take them.
pub(super) fn load(bench: &Bench<'_>, wish: &RunRequest) -> Result<SceneFile, StudyError> {
    let mut scene = bench.scene.clone();
    scene.settings.extend(wish.setting.settings.iter().cloned());
    scene.read().map_err(|error| StudyError::Scene(vec![error]))
}

/// The scene with the changes of a run.
///
/// # Errors
/// The scene does not take them.
fn describe(bench: &Bench<'_>, wish: &RunRequest) -> Result<ShotDescription, StudyError> {
    let mut description = load(bench, wish)?.resolve().map_err(StudyError::Scene)?;
    let scene = &mut description.scene;
    if wish.copy > 0 {
        let mut random = Random::new(u64::from(wish.copy));
        for garment in &mut scene.garments {
            let rest = garment.rest_positions().map_err(StudyError::Asked)?;
            garment.start.get_or_insert(rest).iter_mut().for_each(|x| *x += random.vector() * (SHIFT * bench.size));
        }
    }
    Ok(description)
}

/// Does something on rank 0 of as many ranks as a setting says, which are threads here and processes elsewhere; `threads` is
/// the number of threads of the study, which ranks share unless the setting says how many each has.
fn on_ranks<T: Send>(
    setting: &Setting,
    threads: usize,
    work: impl FnOnce(&Ranks) -> Result<T, ShotError> + Send,
) -> Result<T, ShotError> {
    let ranks = setting.ranks.max(1) as usize;
    let each = match setting.threads as usize {
        0 if ranks == 1 => return work(&Ranks::default()),
        0 => (threads / ranks).max(1),
        each => each,
    };
    // A rank that panics is something that the caller is prepared for.
    on_local_ranks(ranks, each, work)
}

/// Runs a wish. States of the compared frames are written to `states`, if it is given. At `deadline` the run is given up.
///
/// # Errors
/// The scene cannot be read or started, a file breaks. A solver that gives up is a failure in the sample.
pub(super) fn run(
    bench: &Bench<'_>,
    wish: &RunRequest,
    pace: &Pace<'_>,
    (states, deadline): (Option<&Path>, Instant),
) -> Result<Ended, StudyError> {
    let begun = Instant::now();
    let description = describe(bench, wish)?;
    // Of many ranks none has the cloth as a whole, which is what is measured.
    let whole = (wish.setting.ranks > 1).then(|| describe(bench, wish)).transpose()?;
    memory::forget_peak();
    let sample = Sample { role: wish.role, setting: wish.setting.clone(), ..Sample::default() };
    let sample = Sample { copy: wish.copy, repeat: wish.repeat, ..sample };
    let failed = |frame, what| {
        let failure = Some(Failure { frame, what });
        Ok(Ended::Sample(Box::new((Sample { failure, ..sample.clone() }, Vec::new()))))
    };
    // A panic is a fault of the program: the study lists it and goes on.
    let reached = AtomicI64::new(NOWHERE);
    let simulate = |ranks: &Ranks| {
        let of = |shot: &SteppedShot| Cloth::of(shot.simulation(), bench.size, bench.thickness);
        let whole = whole.map(|whole| SteppedShot::start(&Ranks::default(), whole, 1).map(|shot| of(&shot)));
        let mut shot = SteppedShot::start(ranks, description, wish.setting.body_frames)?;
        let cloth = whole.transpose()?.unwrap_or_else(|| of(&shot));
        let mut course = Course::new(cloth, pace);
        course.run(&mut shot, (deadline, bench.cancelled), &reached).map(|stop| (course, stop))
    };
    let guarded = catch_unwind(AssertUnwindSafe(|| on_ranks(&wish.setting, bench.threads, simulate)));
    let reached = reached.load(Relaxed);
    let next = (reached != NOWHERE).then_some(reached + 1);
    let (mut course, stop) = match guarded {
        Err(_) => return failed(next, "a fault of the program, which printed it".to_owned()),
        Ok(Err(ShotError::Problems(problems))) => return failed(None, problems.to_string()),
        Ok(Err(ShotError::Step(error))) => return failed(next, error.to_string()),
        Ok(Err(other)) => return Err(other.into()),
        Ok(Ok(done)) => done,
    };
    if stop == Stop::OutOfTime {
        return Ok(Ended::OutOfTime(next.unwrap_or_default() - 1));
    }
    if let Some(path) = states {
        let mut writer = StatesWriter::create(path, &course.cloth)?;
        course.kept.iter().try_for_each(|kept| writer.frame(&kept.state))?;
        writer.finish()?;
    }
    let mut sample = sample;
    course.fill(&mut sample);
    sample.cost.peak_bytes = memory::peak_bytes();
    sample.cost.with_overhead = begun.elapsed().as_secs_f64();
    Ok(Ended::Sample(Box::new((sample, course.kept.iter().map(|kept| kept.frame).collect()))))
}

/// Why a course is over.
#[derive(Debug, PartialEq, Eq)]
enum Stop {
    Whole,
    OutOfTime,
}

/// A frame that is compared.
struct Kept {
    frame: i64,
    state: FrameState,
    figures: Figures,
}

/// Cost of one frame.
struct Spent {
    frame: i64,
    seconds: f64,
    processor_seconds: f64,
    summary: FrameSummary,
}

/// A run from its start to its end.
struct Course<'a> {
    cloth: Cloth,
    pace: &'a Pace<'a>,
    /// Interval of the frames that a trial keeps, doubled whenever there are too many.
    stride: i64,
    spent: Vec<Spent>,
    kept: Vec<Kept>,
}

impl<'a> Course<'a> {
    fn new(cloth: Cloth, pace: &'a Pace<'a>) -> Self {
        Self { cloth, pace, stride: 1, spent: Vec::new(), kept: Vec::new() }
    }

    /// Simulates to the end of the pace.
    fn run(
        &mut self,
        shot: &mut SteppedShot,
        (deadline, cancelled): (Instant, &AtomicBool),
        reached: &AtomicI64,
    ) -> Result<Stop, ShotError> {
        let start = shot.timeline().start;
        reached.store(start, Relaxed);
        let last = match self.pace {
            Pace::Fixed(frames) => frames.last().copied().unwrap_or(start),
            Pace::Trial { last, .. } => *last,
        };
        while shot.simulation().frame() < last {
            let until = self.until().map_or(deadline, |until| until.min(deadline));
            // A frame that would end long after it is not begun.
            if self.until().is_some_and(|until| Instant::now() + self.half_a_frame() > until) {
                return Ok(Stop::Whole);
            }
            let before = platform::processor_seconds();
            let over = &mut || cancelled.load(Relaxed) || Instant::now() >= until;
            let Some(SteppedFrame { summary, seconds }) = shot.next_frame(over)? else {
                let is_trial = matches!(self.pace, Pace::Trial { .. });
                let enough = is_trial && !self.kept.is_empty() && !cancelled.load(Relaxed);
                return Ok(if enough { Stop::Whole } else { Stop::OutOfTime });
            };
            let processor_seconds = platform::processor_seconds() - before;
            let frame = summary.frame;
            reached.store(frame, Relaxed);
            if self.is_compared(frame, start) {
                let [positions, velocities] = shot.state();
                let state = FrameState { positions, velocities };
                let figures = self.cloth.measure(shot.simulation(), &state, &summary);
                self.kept.push(Kept { frame, state, figures });
            }
            self.spent.push(Spent { frame, seconds, processor_seconds, summary });
        }
        Ok(Stop::Whole)
    }

    /// When a trial is enough, as things stand; it needs something to compare first.
    fn until(&self) -> Option<Instant> {
        let Pace::Trial { until, longest, wanted, .. } = self.pace else { return None };
        let enough = if self.spent.len() >= *wanted { until } else { longest };
        (!self.kept.is_empty()).then_some(*enough)
    }

    fn half_a_frame(&self) -> Duration {
        Duration::from_secs_f64(self.spent.last().map_or(0.0, |spent| spent.seconds / 2.0))
    }

    fn is_compared(&mut self, frame: i64, start: i64) -> bool {
        match self.pace {
            Pace::Fixed(frames) => frames.binary_search(&frame).is_ok(),
            Pace::Trial { most, .. } => {
                if self.kept.len() >= *most {
                    self.stride *= 2;
                    let stride = self.stride;
                    self.kept.retain(|kept| (kept.frame - start) % stride == 0);
                }
                (frame - start) % self.stride == 0
            }
        }
    }

    /// Puts what was measured up to the last compared frame into the sample.
    fn fill(&mut self, sample: &mut Sample) {
        let last = self.kept.last().map_or(i64::MAX, |kept| kept.frame);
        self.spent.retain(|spent| spent.frame <= last);
        let mut cost = Cost { frames: self.spent.len() as u64, dt: [f64::INFINITY, 0.0], ..Cost::default() };
        let mut metrics = Metrics::default();
        for Spent { seconds, processor_seconds, summary, .. } in &self.spent {
            cost.seconds += seconds;
            cost.processor_seconds += processor_seconds;
            cost.steps += summary.steps;
            cost.cg_iterations += summary.cg_iterations;
            cost.dt = [cost.dt[0].min(summary.dt_min), cost.dt[1].max(summary.dt_max)];
            metrics.add(&summary.metrics);
        }
        if !cost.dt[0].is_finite() {
            cost.dt[0] = 0.0;
        }
        sample.cost = cost;
        let stage =
            |stage: &drapery_core::metrics::Stage| StageCost { stage: stage.name.to_string(), seconds: stage.seconds };
        sample.stages = metrics.stages().iter().map(stage).collect();
        sample.counts =
            metrics.counts().iter().map(|(name, count)| (name.to_string(), *count)).collect::<BTreeMap<_, _>>();
        sample.figures = self.kept.iter().map(|kept| kept.figures).collect();
        let mut digest = Sha256::new();
        for kept in &self.kept {
            let vectors = kept.state.positions.iter().chain(&kept.state.velocities);
            vectors.flat_map(|v| [v.x, v.y, v.z]).for_each(|number| digest.update(number.to_le_bytes()));
        }
        sample.bits = digest.finalize().iter().take(DIGEST).map(|byte| format!("{byte:02x}")).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of several logical parts that falls on a ball.
    const FALLING: &str = r#"drapery = 1
[shot]
frames = "1-2"
[gravity]
[self_repulsion]
[self_collision]
[[body]]
name = "ball"
shape = { sphere = { radius = 0.2 } }
position = [0, 0.795, 0]
[[garment]]
name = "sheet"
panel = { resolution = 60, side = 1.0, center = [0, 1, 0] }
density = "0.15 kg/m²"
[garment.stretch]
stiffness = "100 N/m"
"#;

    #[test]
    fn ranks_change_no_bit_and_no_figure_and_a_panic_of_one_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, cancelled) = (SceneSource::text(FALLING, "scene.toml", folder.path()), AtomicBool::new(false));
        let bench = Bench { scene: &scene, cancelled: &cancelled, size: 1.4, thickness: 0.001, threads: 2 };
        let sample = |ranks: u32, threads: u32| {
            let wish =
                RunRequest { setting: Setting { ranks, threads, ..Setting::default() }, ..RunRequest::default() };
            let far = Instant::now() + Duration::from_secs(600);
            match run(&bench, &wish, &Pace::Fixed(&[2]), (None, far)).unwrap() {
                Ended::Sample(ended) => ended.0,
                Ended::OutOfTime(frame) => panic!("out of time after frame {frame}"),
            }
        };
        let one = sample(0, 0);
        assert_eq!((one.failure.as_ref(), one.figures.len()), (None, 1));
        assert!(one.counts["body_contacts"] > 0 && !one.counts.contains_key("messages"), "{:?}", one.counts);
        for (ranks, threads) in [(2, 0), (3, 1)] {
            let many = sample(ranks, threads);
            assert_eq!((&many.bits, &many.figures), (&one.bits, &one.figures), "{ranks} ranks");
            assert_eq!(many.cost.steps, one.cost.steps);
            assert!(many.counts["messages"] > 0);
        }
        // The others do not wait for ever for a first one that has failed.
        let setting = Setting { ranks: 2, ..Setting::default() };
        let fails = || on_ranks(&setting, 1, |_| -> Result<(), ShotError> { panic!("lost") });
        assert!(catch_unwind(AssertUnwindSafe(fails)).is_err());
    }
}

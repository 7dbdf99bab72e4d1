//! Conclusions from the record of a study: how far errors can be told, orders of convergence, the front of settings
//! that no other one beats, and the recommended setting.

use std::collections::BTreeMap;

use drapery_shot::quality::LIMITS;

use crate::study::fit::{self, Order};
use crate::study::record::{Distance, Role, Sample, Study};
use crate::study::vary::{CFL, MAX_DT, STEPS_PER_FRAME};

/// The noise floor may be this share of the smallest error where errors are still given.
const FLOOR_SHARE: f64 = 0.1;

/// The noise floor may be this share of the thickness where errors are still given.
const FLOOR_THICKNESS: f64 = 0.25;

/// Own error of the reference, by the smallest error that it can tell.
pub(crate) const REFERENCE_SHARE: f64 = 0.1;

/// Spread of repeated times by their mean from which the machine counts as noisy.
pub(crate) const NOISY: f64 = 0.05;

/// An order below this is none: errors hardly depend on the steps.
const LEAST_ORDER: f64 = 0.5;

/// A straight line that explains less of the errors than this share says nothing.
const LEAST_FIT: f64 = 0.9;

/// Counts that forbid a recommendation when they are not zero.
const FORBIDDEN: [&str; 3] = ["crossings", "cg_short", "zone_fallbacks"];

/// A setting: one line of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row<'a> {
    /// Its run.
    pub sample: &'a Sample,
    /// Times a frame of all runs of these settings [s].
    pub times: Vec<f64>,
    /// Their median [s].
    pub seconds: f64,
    /// Median of their distances from the median [s].
    pub spread: f64,
    /// Time by that of the scene as it is.
    pub times_base: f64,
    /// Error inside the window; `None` without a reference, and for the reference.
    pub error: Option<Error>,
    /// Order of convergence from the next coarser setting to this one.
    pub order: Option<f64>,
    /// Whether no other setting is both faster and closer to the reference.
    pub on_front: bool,
    /// Whether its counts let it be recommended.
    pub is_sound: bool,
}

/// Distance of a run from the states that it is compared with, over the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Error {
    /// Root of the mean over frames of the squared area-weighted RMS distance [m].
    pub rms: f64,
    /// Largest over frames of the 99th percentile [m].
    pub p99: f64,
    /// Largest distance of all [m].
    pub max: f64,
    /// As `rms`, of velocities [m/s].
    pub velocity_rms: f64,
    /// As `rms`, of the angles between normals [rad].
    pub normal_rms: f64,
    /// Largest distance of the surfaces, where meshes differ [m].
    pub surface: Option<f64>,
    /// Validity of the error.
    pub validity: Validity,
}

/// Validity of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Validity {
    /// It is what it says.
    Yes,
    /// It is not above what a shift of 1e-10 grows to.
    BelowFloor,
    /// The reference is not converged far enough to give it.
    NotConverged,
    /// Nothing is known of the reference's own error.
    Unchecked,
}

/// A straight line through errors of settings that differ in their steps alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Ladder {
    /// Changes that the settings have in common; empty where they have only the scene in common.
    pub common: String,
    /// Mean step [s] and error [m], the coarsest first.
    pub points: Vec<(f64, f64)>,
    /// The line.
    pub fit: Order,
}

/// Everything that follows.
#[derive(Debug, Clone, PartialEq)]
pub struct Analysis<'a> {
    /// Settings: the scene as it is, accuracy, then meshes.
    pub rows: Vec<Row<'a>>,
    /// Noise floor at the compared frames [m]; empty without copies.
    pub floor: Vec<f64>,
    /// Number of compared frames up to which trajectories can be compared.
    pub predictable: usize,
    /// Whether that is less than all of them.
    pub has_horizon: bool,
    /// Own error of the reference at the compared frames [m]; empty where it was not checked.
    pub own_error: Vec<f64>,
    /// Number of compared frames that errors are taken over.
    pub window: usize,
    /// Own error of the reference over the window [m].
    pub own: Option<f64>,
    /// Rows that differ in their steps alone, group by group.
    pub groups: Vec<Vec<usize>>,
    /// Orders of convergence of those whose errors fall with their steps.
    pub ladders: Vec<Ladder>,
    /// Row with the knee of the front.
    pub knee: Option<usize>,
    /// Spread of repeated times by their mean, the largest of all settings.
    pub noise: Option<f64>,
}

/// Works out everything.
pub fn analyse(study: &Study) -> Analysis<'_> {
    let frames = study.compared.len();
    let floor = floor(study);
    let own_error = study.own_error.clone();
    let predictable = horizon(study, &floor).unwrap_or(frames);
    let window = window(study, (&own_error, &floor), predictable);
    let own = (!own_error.is_empty()).then(|| over(&own_error[..window.min(own_error.len())]));
    let floor_over = floor.get(..window).map(over);
    let mut rows: Vec<Row<'_>> = Vec::new();
    let listed = [Role::Base, Role::Accuracy, Role::Mesh, Role::ReferenceCoarse, Role::ReferenceCheck, Role::Reference];
    for role in listed {
        let of_role = |sample: &&Sample| sample.role == role && sample.is_own() && sample.is_whole();
        for sample in study.samples.iter().filter(of_role) {
            // A change to what the scene says anyway is the scene as it is.
            if role != Role::Base && study.base().is_some_and(|base| is_same_run(base, sample)) {
                continue;
            }
            rows.push(row(study, sample, (window, own, floor_over)));
        }
    }
    if let Some(base) = rows.first().map(|row| row.seconds).filter(|seconds| *seconds > 0.0) {
        rows.iter_mut().for_each(|row| row.times_base = row.seconds / base);
    }
    let (groups, ladders) = ladders(study, &mut rows);
    let knee = mark_front(&mut rows);
    let cv = |row: &Row<'_>| {
        let (mean, deviation) = fit::mean_and_deviation(&row.times);
        Some(deviation? / mean).filter(|_| row.times.len() > 2)
    };
    let noise = rows.iter().filter_map(cv).max_by(f64::total_cmp);
    let has_horizon = predictable < frames;
    Analysis { rows, floor, predictable, has_horizon, own_error, window, own, groups, ladders, knee, noise }
}

/// Root of the mean of squares.
fn over(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

fn is_same_run(a: &Sample, b: &Sample) -> bool {
    a.cost.steps == b.cost.steps
        && a.cost.cg_iterations == b.cost.cg_iterations
        && !b.from_base.is_empty()
        && b.from_base.iter().all(|distance| distance.max == 0.0)
}

/// Largest distance that a shifted copy has come from the scene as it is, at every compared frame [m].
fn floor(study: &Study) -> Vec<f64> {
    let copies: Vec<&Sample> =
        study.samples.iter().filter(|sample| sample.copy > 0 && !sample.from_base.is_empty()).collect();
    if copies.is_empty() {
        return Vec::new();
    }
    let at = |frame: usize| copies.iter().filter_map(move |copy| copy.from_base.get(frame)).map(|d| d.rms);
    (0..study.compared.len()).map(|frame| at(frame).fold(0.0, f64::max)).collect()
}

/// Runs whose errors are given.
fn compared(study: &Study) -> impl Iterator<Item = &Sample> {
    let is_compared = |sample: &&Sample| matches!(sample.role, Role::Base | Role::Accuracy);
    study.samples.iter().filter(is_compared).filter(|sample| sample.is_own() && !sample.from_reference.is_empty())
}

/// Number of compared frames before the first at which the floor is above a tenth of the smallest error or a quarter of the
/// thickness; `None` if it never is.
fn horizon(study: &Study, floor: &[f64]) -> Option<usize> {
    let smallest = |frame: usize| {
        let errors = compared(study).filter_map(|sample| sample.from_reference.get(frame)).map(|d| d.rms);
        errors.filter(|error| *error > 0.0).fold(f64::INFINITY, f64::min)
    };
    let limit = |frame: usize| {
        let error = smallest(frame);
        let share = if error.is_finite() { FLOOR_SHARE * error } else { 0.0 };
        share.max(FLOOR_THICKNESS * study.scene.thickness)
    };
    floor.iter().enumerate().position(|(frame, floor)| *floor > limit(frame))
}

/// Number of compared frames over which errors are taken: inside the horizon, and as long as the own error of the reference
/// stays below a tenth of the error of the scene as it is; if it does so only for less than half of them, all inside the
/// horizon: the first frames, in which little has happened, do not stand for the others.
fn window(study: &Study, (own_error, floor): (&[f64], &[f64]), predictable: usize) -> usize {
    let Some(base) = study.base().filter(|base| !base.from_reference.is_empty()) else { return predictable };
    let errors: Vec<f64> = base.from_reference.iter().map(|distance| distance.rms).collect();
    let tells = |frames: &usize| {
        let error = over(&errors[..*frames]);
        let is_above_floor = floor.get(..*frames).is_none_or(|floor| error > over(floor));
        is_above_floor && own_error.get(..*frames).is_some_and(|own| over(own) <= REFERENCE_SHARE * error)
    };
    (predictable.div_ceil(2).max(1)..=predictable).rev().find(tells).unwrap_or(predictable)
}

/// Returns the error of a run over the first frames.
pub(crate) fn error_over(distances: &[Distance], window: usize) -> Option<Error> {
    let inside = distances.get(..window).filter(|inside| !inside.is_empty())?;
    let all = |of: fn(&Distance) -> f64| -> Vec<f64> { inside.iter().map(of).collect() };
    let largest = |of: fn(&Distance) -> f64| all(of).into_iter().fold(0.0, f64::max);
    let surfaces: Vec<f64> = inside.iter().filter_map(|distance| distance.surface).collect();
    Some(Error {
        rms: over(&all(|distance| distance.rms)),
        p99: largest(|distance| distance.p99),
        max: largest(|distance| distance.max),
        velocity_rms: over(&all(|distance| distance.velocity_rms)),
        normal_rms: over(&all(|distance| distance.normal_rms)),
        surface: surfaces.into_iter().max_by(f64::total_cmp),
        validity: Validity::Yes,
    })
}

fn row<'a>(study: &Study, sample: &'a Sample, (window, own, floor): (usize, Option<f64>, Option<f64>)) -> Row<'a> {
    let times = times(study, sample);
    let seconds = fit::median(&times).unwrap_or(0.0);
    let error = error_over(&sample.from_reference, window).map(|error| {
        let validity = match (own, floor) {
            (_, Some(floor)) if error.rms <= floor => Validity::BelowFloor,
            (None, _) => Validity::Unchecked,
            (Some(own), _) if own > REFERENCE_SHARE * error.rms => Validity::NotConverged,
            _ => Validity::Yes,
        };
        Error { validity, ..error }
    });
    Row {
        sample,
        seconds,
        spread: fit::median_deviation(&times).unwrap_or(0.0),
        times,
        times_base: 1.0,
        error,
        order: None,
        on_front: false,
        is_sound: faults(sample).is_empty(),
    }
}

/// Times a frame of all runs of these settings [s]; shifted copies do the same work. The very first run of a study warms
/// everything up: it counts only if there is no other.
pub fn times(study: &Study, of: &Sample) -> Vec<f64> {
    let same = |sample: &&Sample| sample.setting == of.setting && sample.role == of.role && sample.is_whole();
    let all: Vec<&Sample> = study.samples.iter().filter(same).collect();
    let is_warming = |sample: &Sample| sample.role == Role::Base && sample.is_own() && all.len() > 1;
    all.iter().filter(|sample| !is_warming(sample)).map(|sample| sample.seconds_a_frame()).collect()
}

/// Returns the faults that speak against taking a setting: counts that should be zero and are not, with their values.
pub fn faults(sample: &Sample) -> Vec<(&'static str, u64)> {
    let counted = |name: &'static str| (name, sample.counts.get(name).copied().unwrap_or(0));
    FORBIDDEN.into_iter().map(counted).filter(|(_, count)| *count > 0).collect()
}

/// Counts that should be zero and are not, of any kind.
pub fn degradations(sample: &Sample) -> Vec<(&'static str, u64)> {
    let counted = |name: &'static str| (name, sample.counts.get(name).copied().unwrap_or(0));
    LIMITS.iter().map(|(name, _)| counted(name)).filter(|(_, count)| *count > 0).collect()
}

/// Mean time step of a run [s].
pub(crate) fn mean_step(study: &Study, sample: &Sample) -> f64 {
    sample.cost.frames as f64 * study.scene.frame_seconds / sample.cost.steps.max(1) as f64
}

/// Fits orders through settings that differ in their steps alone, and tells every row its own. Where errors do not fall with
/// the steps, something else decides them, and no order is given.
fn ladders(study: &Study, rows: &mut [Row<'_>]) -> (Vec<Vec<usize>>, Vec<Ladder>) {
    let mut groups: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (index, row) in rows.iter().enumerate() {
        if !matches!(row.sample.role, Role::Base | Role::Accuracy) || row.error.is_none() {
            continue;
        }
        let is_step = |name: &str| [CFL, MAX_DT, STEPS_PER_FRAME].contains(&name);
        let others = row.sample.setting.changes.iter().filter(|(name, _)| !is_step(name));
        let common: Vec<String> = others.map(|(name, value)| format!("{name} {value}")).collect();
        groups.entry(common.join(", ")).or_default().push(index);
    }
    let mut ladders = Vec::new();
    for (common, indices) in &groups {
        let mut indices = indices.clone();
        let step = |index: &usize| mean_step(study, rows[*index].sample);
        indices.sort_by(|a, b| step(b).total_cmp(&step(a)));
        let of_rows: Vec<(usize, f64, f64, Validity)> = indices
            .iter()
            .filter_map(|i| rows[*i].error.map(|error| (*i, step(i), error.rms, error.validity)))
            .filter(|(_, _, error, _)| *error > 0.0)
            .collect();
        let points: Vec<(f64, f64)> = of_rows
            .iter()
            .filter(|(.., validity)| *validity == Validity::Yes)
            .map(|(_, dt, error, _)| (*dt, *error))
            .collect();
        let fit = fit::order(&points).filter(|fit| fit.order >= LEAST_ORDER && fit.r_squared >= LEAST_FIT);
        let Some(fit) = fit else { continue };
        for pair in of_rows.windows(2) {
            let ((_, coarse, large, _), (index, fine, small, validity)) = (pair[0], pair[1]);
            let is_valid = validity == Validity::Yes && coarse > fine * (1.0 + f64::EPSILON);
            rows[index].order = is_valid.then(|| (large / small).ln() / (coarse / fine).ln());
        }
        ladders.push(Ladder { common: common.clone(), points, fit });
    }
    (groups.into_values().collect(), ladders)
}

/// Marks the rows that no other one beats; returns the knee.
fn mark_front(rows: &mut [Row<'_>]) -> Option<usize> {
    // How often bodies are shown is a matter of the study, not a setting of the scene.
    let may = |row: &Row<'_>| {
        matches!(row.sample.role, Role::Base | Role::Accuracy | Role::Mesh) && row.sample.setting.body_frames <= 1
    };
    let candidates: Vec<(usize, (f64, f64))> = rows
        .iter()
        .enumerate()
        .filter(|(_, row)| may(row))
        .filter_map(|(index, row)| Some((index, (row.seconds, row.error?.rms))))
        .collect();
    let points: Vec<(f64, f64)> = candidates.iter().map(|(_, point)| *point).collect();
    let mut front = Vec::new();
    for ((index, point), on_front) in candidates.iter().zip(fit::front(&points)) {
        rows[*index].on_front = on_front;
        if on_front {
            front.push((*index, *point));
        }
    }
    let points: Vec<(f64, f64)> = front.iter().map(|(_, point)| *point).collect();
    fit::knee(&points).map(|at| front[at].0)
}

impl Analysis<'_> {
    /// The row to take: the smallest error among sound ones on the front that take no more than `budget` [s a frame], the
    /// fastest of those that are nearer than the reference can tell; or
    /// without a budget the knee, or the scene as it is where there is none.
    pub fn recommended(&self, budget: Option<f64>) -> Option<usize> {
        let fits = |row: &Row<'_>| row.on_front && row.is_sound && budget.is_none_or(|budget| row.seconds <= budget);
        // What is nearer than the reference can tell is equally near.
        let least = self.own.unwrap_or(0.0);
        let error = |row: &Row<'_>| row.error.map_or(f64::INFINITY, |error| error.rms.max(least));
        let better = |a: &Row<'_>, b: &Row<'_>| error(a).total_cmp(&error(b)).then(a.seconds.total_cmp(&b.seconds));
        match budget {
            Some(_) => (0..self.rows.len())
                .filter(|i| fits(&self.rows[*i]))
                .min_by(|i, j| better(&self.rows[*i], &self.rows[*j])),
            None => self.knee.filter(|knee| self.rows[*knee].is_sound),
        }
    }

    /// Frames of the window, and whether it is shorter than the compared frames.
    pub(crate) fn window_end(&self, study: &Study) -> Option<i64> {
        study.compared.get(self.window.checked_sub(1)?).copied()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::study::record::{Cost, SceneFacts, Setting};

    /// A run of 10 frames that takes `steps` steps and `seconds` a frame, and is off by `error` [m] at every frame.
    fn sample(role: Role, cfl: &str, (steps, seconds): (u64, f64), error: f64) -> Sample {
        let change = ("cfl".to_owned(), cfl.to_owned());
        let setting = if role == Role::Base {
            Setting { label: "as the scene".into(), ..Setting::default() }
        } else {
            let settings = vec![("solver.cfl".to_owned(), cfl.to_owned())];
            Setting { label: format!("cfl {cfl}"), changes: vec![change], settings, ..Setting::default() }
        };
        let cost = Cost { frames: 10, seconds: 10.0 * seconds, steps, ..Cost::default() };
        let distance = Distance { rms: error, p99: 2.0 * error, max: 3.0 * error, ..Distance::default() };
        let from_base = if role == Role::Base { Vec::new() } else { vec![distance; 10] };
        Sample { role, setting, cost, from_reference: vec![distance; 10], from_base, ..Sample::default() }
    }

    /// A study of a method of first order: error 1 mm at 40 steps, half of it for twice the steps and the time.
    pub(crate) fn convergent() -> Study {
        let scene = SceneFacts { frame_seconds: 0.04, thickness: 0.001, frames: [0, 100], ..SceneFacts::default() };
        let samples = vec![
            sample(Role::Base, "4", (40, 1.0), 1e-3),
            sample(Role::Accuracy, "2", (80, 2.0), 5e-4),
            sample(Role::Accuracy, "1", (160, 4.0), 2.5e-4),
            sample(Role::Reference, "0.25", (640, 16.0), 6.25e-5),
        ];
        let compared: Vec<i64> = (1..=10).collect();
        Study { scene, samples, compared, own_error: vec![1e-6; 10], ..Study::default() }
    }

    fn copy(rms: impl Fn(usize) -> f64) -> Sample {
        let from_base = (0..10).map(|frame| Distance { rms: rms(frame), ..Distance::default() }).collect();
        Sample { copy: 1, from_base, ..Sample::default() }
    }

    #[test]
    fn the_order_of_a_first_order_method_is_found_and_told_by_row() {
        let study = convergent();
        let analysis = analyse(&study);
        assert!((analysis.ladders[0].fit.order - 1.0).abs() < 1e-12, "{:?}", analysis.ladders);
        let orders: Vec<Option<f64>> = analysis.rows.iter().map(|row| row.order).collect();
        assert!(orders[0].is_none() && (orders[2].unwrap() - 1.0).abs() < 1e-12, "{orders:?}");
        assert_eq!((analysis.window, analysis.has_horizon), (10, false));
    }

    #[test]
    fn the_recommendation_is_the_smallest_error_within_the_budget_that_is_sound() {
        let mut study = convergent();
        let label = |study: &Study, budget| {
            let analysis = analyse(study);
            analysis.recommended(budget).map(|index| analysis.rows[index].sample.setting.label.clone())
        };
        assert_eq!(label(&study, Some(10.0)).as_deref(), Some("cfl 1"));
        assert_eq!(label(&study, Some(2.5)).as_deref(), Some("cfl 2"));
        assert_eq!(label(&study, Some(0.5)), None);
        // The reference is no setting to work with.
        assert_eq!(label(&study, Some(100.0)).as_deref(), Some("cfl 1"));
        study.samples[2].counts.insert("crossings".into(), 1);
        assert_eq!(label(&study, Some(10.0)).as_deref(), Some("cfl 2"));
        study.samples[1].counts.insert("cg_short".into(), 1);
        assert_eq!(label(&study, Some(10.0)).as_deref(), Some("as the scene"));
        // On a straight front there is no knee; where more time buys hardly anything, there is one.
        assert_eq!(label(&convergent(), None), None);
        let mut bent = convergent();
        bent.samples[2].from_reference.iter_mut().for_each(|distance| distance.rms = 4.5e-4);
        assert_eq!(label(&bent, None).as_deref(), Some("cfl 2"));
    }

    #[test]
    fn errors_are_not_told_beyond_the_horizon_nor_below_the_floor() {
        let mut study = convergent();
        // A quarter of the thickness is 0.25 mm: the copies pass it at the sixth compared frame.
        study.samples.push(copy(|frame| if frame < 5 { 1e-9 } else { 1e-2 }));
        let analysis = analyse(&study);
        assert_eq!((analysis.predictable, analysis.window, analysis.has_horizon), (5, 5, true));
        let mut noisy = convergent();
        noisy.scene.thickness = 1.0;
        noisy.samples.push(copy(|_| 3e-4));
        let analysis = analyse(&noisy);
        let validity: Vec<Validity> =
            analysis.rows.iter().filter_map(|row| row.error).map(|error| error.validity).collect();
        assert_eq!(validity, [Validity::Yes, Validity::Yes, Validity::BelowFloor, Validity::BelowFloor]);
    }

    #[test]
    fn where_the_reference_is_not_converged_no_number_is_told() {
        let mut study = convergent();
        study.own_error = vec![4e-5; 10];
        let validity = |study: &Study| -> Vec<Validity> {
            analyse(study).rows.iter().filter_map(|row| row.error).map(|error| error.validity).collect()
        };
        // A tenth of 1 mm and of 0.5 mm is more than 0.04 mm, a tenth of 0.25 mm is not.
        assert_eq!(validity(&study)[..3], [Validity::Yes, Validity::Yes, Validity::NotConverged]);
        // Late frames that are not converged are left out of the window.
        study.own_error = (0..10).map(|frame| if frame < 6 { 1e-6 } else { 1e-2 }).collect();
        assert_eq!(analyse(&study).window, 6);
        // The first two of ten do not stand for all of them.
        study.own_error = (0..10).map(|frame| if frame < 2 { 1e-6 } else { 1e-2 }).collect();
        assert_eq!(analyse(&study).window, 10);
        study.own_error = Vec::new();
        assert_eq!(validity(&study)[0], Validity::Unchecked);
    }

    #[test]
    fn times_are_medians_without_the_run_that_warms_up_and_spread_is_noticed() {
        let mut study = convergent();
        for (repeat, seconds) in [(1, 1.1), (2, 1.3), (3, 1.2)] {
            let mut again = sample(Role::Base, "4", (40, seconds), 0.0);
            again.repeat = repeat;
            study.samples.push(again);
        }
        study.samples[0].cost.seconds = 90.0;
        let analysis = analyse(&study);
        assert!((analysis.rows[0].seconds - 1.2).abs() < 1e-12);
        assert!((analysis.noise.unwrap() - 0.1 / 1.2).abs() < 1e-12, "{:?}", analysis.noise);
    }
}

//! Runs that make a study, and their order.

use drapery_core::effects::{body_collision, self_repulsion};
use drapery_core::scene::{PRESET, PRESETS, SolverPreset};

use crate::study::random::Random;
use crate::study::record::{Asked, Role, Setting};
use crate::study::vary::{
    BODY_FRAMES, BaseSettings, CFL, Change, FRICTION, INTEGRATOR, LONG_STEPS, MAX_DT, RANKS, RESOLUTION, SHORT_STEPS,
    STEPS_PER_FRAME, THICKNESS, THREADS, WITHOUT, as_is, changed, combinations, role_of, rough_times,
};

/// Factors by which the reference may be finer in time than the scene; the finest that there is time for is taken.
pub(crate) const FINENESS: [u32; 4] = [16, 8, 4, 2];

/// The same where a study has to do with few frames; the last of [`FINENESS`] is for those that hardly have time for one.
const CORE_FINENESS: u32 = 4;

/// Time of a run with the tolerance of the reference by that of the scene as it is, measured on the sample scenes. It grows
/// with the square root of the number of steps: the shorter a step, the fewer iterations it needs.
const TIGHTEST: f64 = 3.0;

/// Tolerance of the velocity solves of the reference [m/s].
const REFERENCE_TOLERANCE: &str = "1e-9";

/// Iterations that the velocity solves of the reference may take.
const REFERENCE_ITERATIONS: &str = "5000";

/// Tighter tolerance of the velocity solves that is tried [m/s].
const TIGHT: &str = "1e-5";

/// Factor on the tolerance of the scene that is tried as well: a setting cheaper than the scene.
const LOOSE: f64 = 10.0;

/// The same where the solver chooses: the largest that it ever does [m/s].
const LARGEST: f64 = 0.01;

/// Times the base up to which a run is made before dearer ones.
const NEAR: f64 = 2.0;

/// A run that is wanted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunRequest {
    /// Purpose of the run.
    pub role: Role,
    /// Changes that it makes to the scene.
    pub setting: Setting,
    /// Number of the copy with shifted positions; 0 for none.
    pub copy: u32,
    /// Number of the repeat; 0 for the first run.
    pub repeat: u32,
    /// Its time by that of the base, as far as one can say before trying.
    pub times: f64,
    /// Whether the study says little without it.
    pub is_core: bool,
}

impl RunRequest {
    fn new(role: Role, setting: Setting, times: f64) -> Self {
        Self { role, setting, copy: 0, repeat: 0, times, is_core: false }
    }

    /// As it is called in messages.
    pub fn label(&self) -> String {
        let mut label = match self.role {
            Role::Reference => format!("reference ({})", self.setting.label),
            Role::ReferenceCheck | Role::ReferenceCoarse => format!("check of the reference ({})", self.setting.label),
            _ => self.setting.label.clone(),
        };
        if self.copy > 0 {
            label += &format!(", shifted copy {}", self.copy);
        }
        if self.repeat > 0 {
            label += &format!(", repeat {}", self.repeat);
        }
        label
    }
}

/// All runs of a study, the most useful first: when time runs out, the last are missing. The reference is at least `fineness`
/// times as fine as the scene.
pub(crate) fn wishes(asked: &Asked, ground: &BaseSettings, fineness: u32) -> Vec<RunRequest> {
    let mut all = vec![RunRequest::new(Role::Base, as_is(), 1.0)];
    let copy = |number: u32| RunRequest { copy: number, ..all[0].clone() };
    let copies: Vec<RunRequest> = (1..=asked.copies).map(copy).collect();
    let repeats = |of: &RunRequest| -> Vec<RunRequest> {
        (1..asked.repeats).map(|repeat| RunRequest { repeat, ..of.clone() }).collect()
    };
    let base_repeats = repeats(&all[0]);
    let varied = if asked.vary.is_empty() { default_space(ground) } else { asked_space(asked, ground) };
    let (accuracy, other): (Vec<RunRequest>, Vec<RunRequest>) =
        varied.into_iter().partition(|wish| wish.role == Role::Accuracy);
    let repeated: Vec<RunRequest> = accuracy.iter().flat_map(&repeats).collect();
    // What costs about as much as the scene tells more for its time than what costs many times that.
    let (near, far): (Vec<RunRequest>, Vec<RunRequest>) = accuracy.into_iter().partition(|wish| wish.times <= NEAR);
    let mut copies = copies.into_iter();
    // Without something to compare with, nothing is known.
    all.extend(references(asked, ground, fineness));
    all.extend(copies.next());
    all.extend(near);
    all.iter_mut().for_each(|wish| wish.is_core = true);
    let (cheap, dear): (Vec<RunRequest>, Vec<RunRequest>) = other.into_iter().partition(|wish| wish.times <= NEAR);
    all.extend(cheap);
    all.extend(copies.next());
    all.extend(far);
    all.extend(dear);
    all.extend(copies);
    all.extend(base_repeats);
    all.extend(repeated);
    all
}

/// Time of all runs by that of the base, as far as one can say before trying: of all but repeats, and of those without which
/// a study says nothing, with the coarsest reference.
pub(crate) fn whole_times(asked: &Asked, ground: &BaseSettings) -> [f64; 2] {
    let sum = |fineness: u32, counts: &dyn Fn(&RunRequest) -> bool| -> f64 {
        wishes(asked, ground, fineness).iter().filter(|wish| counts(wish)).map(|wish| wish.times).sum()
    };
    [sum(FINENESS[0], &|wish| wish.repeat == 0), sum(CORE_FINENESS, &|wish| wish.is_core)]
}

/// The reference and the runs that tell how far it has converged, the coarsest first.
fn references(asked: &Asked, ground: &BaseSettings, fineness: u32) -> Vec<RunRequest> {
    let fineness = f64::from(fineness);
    let asked_for =
        |name: &'static str| asked.vary.iter().filter(move |(varied, _)| varied == name).flat_map(|(_, values)| values);
    let numbers =
        |name: &'static str| asked_for(name).filter_map(|value| value.parse::<f64>().ok()).filter(|v| *v > 0.0);
    let finest = |name: &'static str, from: f64| numbers(name).fold(from, f64::min);
    // At least twice as fine as anything that is compared with it.
    let cfl = (ground.cfl / fineness).min(finest(CFL, ground.cfl) / 2.0);
    let longest = ground.max_dt.or_else(|| {
        let asked = finest(MAX_DT, f64::INFINITY);
        asked.is_finite().then_some(asked * fineness / 2.0)
    });
    let of_presets =
        asked_for(PRESET.name).filter_map(|word| SolverPreset::find(word)).map(|p| p.steps_per_frame as f64);
    let most = numbers(STEPS_PER_FRAME).chain(of_presets).fold(ground.steps_per_frame as f64, f64::max);
    let steps = (ground.steps_per_frame as f64 * fineness).max(2.0 * most);
    let finer = |coarser: f64| {
        let setting = as_is();
        let mut setting = if ground.is_implicit {
            changed(&setting, STEPS_PER_FRAME, &(steps / coarser).ceil().to_string(), ground)
        } else {
            changed(&setting, CFL, &(cfl * coarser).to_string(), ground)
        };
        if let Some(dt) = longest {
            let dt = (dt / fineness).min(finest(MAX_DT, f64::INFINITY) / 2.0) * coarser;
            setting = changed(&setting, MAX_DT, &dt.to_string(), ground);
        }
        setting = changed(&setting, "cg_tolerance", REFERENCE_TOLERANCE, ground);
        setting.settings.push(("solver.cg_max_iterations".to_owned(), REFERENCE_ITERATIONS.to_owned()));
        setting
    };
    let [fine, middle, coarse] = reference_times(match ground.is_implicit {
        true => steps / ground.steps_per_frame.max(1) as f64,
        false => ground.cfl / cfl,
    });
    let mut all = vec![
        RunRequest::new(Role::ReferenceCoarse, finer(4.0), coarse),
        RunRequest::new(Role::ReferenceCheck, finer(2.0), middle),
        RunRequest::new(Role::Reference, finer(1.0), fine),
    ];
    // Steps longer than those of the scene tell nothing of it, and may not even be stable.
    all.retain(|wish| wish.role != Role::ReferenceCoarse || fineness >= f64::from(CORE_FINENESS));
    all
}

/// Times of a reference `fineness` times as fine as the scene, and of the two runs that check it, by that of the base.
pub(crate) fn reference_times(fineness: f64) -> [f64; 3] {
    [1.0, 2.0, 4.0].map(|coarser| TIGHTEST * (fineness / coarser).sqrt())
}

/// Returns the default variations: steps and solves, then one at a time everything else that costs time or changes
/// the picture.
fn default_space(ground: &BaseSettings) -> Vec<RunRequest> {
    let mut space = Vec::new();
    let all_of = |changes: &[Change<'_>]| {
        let none = RunRequest::new(Role::Accuracy, as_is(), 1.0);
        changes.iter().fold(none, |wish, (name, value)| with(&wish, name, value, ground))
    };
    let one = |name: &str, value: &str| all_of(&[(name, value)]);
    // Steps that are `times` times as short.
    let shorter = |times: usize| match ground.is_implicit {
        true => (STEPS_PER_FRAME, (times * ground.steps_per_frame).to_string()),
        false => (CFL, (ground.cfl / times as f64).to_string()),
    };
    space.push(one("cg_tolerance", &scientific(ground.cg_tolerance.map_or(LARGEST, |tolerance| LOOSE * tolerance))));
    space.push(one("cg_tolerance", TIGHT));
    if ground.is_implicit && ground.steps_per_frame > 1 {
        space.push(one(STEPS_PER_FRAME, &(ground.steps_per_frame / 2).to_string()));
    }
    let finer = [2, 4].map(shorter);
    space.extend(finer.iter().map(|(name, value)| one(name, value)));
    space.extend(finer.iter().map(|(name, value)| all_of(&[(name, value), ("cg_tolerance", TIGHT)])));
    // The other integrator, as it would be used.
    if ground.is_implicit {
        space.push(one(INTEGRATOR, SHORT_STEPS));
        space.push(all_of(&[(INTEGRATOR, SHORT_STEPS), (CFL, &(ground.cfl / 2.0).to_string())]));
    } else {
        let steps = PRESETS.map(|preset| preset.steps_per_frame.to_string());
        space.extend(steps.iter().map(|steps| all_of(&[(INTEGRATOR, LONG_STEPS), (STEPS_PER_FRAME, steps)])));
    }
    if ground.takes("max_steps") {
        space.push(one("max_steps", "1"));
    }
    space.extend(ground.effects.iter().filter(|name| can_go(name)).map(|name| one(WITHOUT, name)));
    if ground.has(body_collision::SPEC.name) || ground.takes("friction") {
        space.push(one(FRICTION, "0"));
    }
    if ground.has(self_repulsion::SPEC.name) {
        space.push(one(THICKNESS, "x0.5"));
    }
    if let Some(cells) = ground.resolution.filter(|cells| *cells >= 8.0) {
        space.push(one(RESOLUTION, &(cells / 2.0).round().to_string()));
    }
    if ground.has_surfaces {
        space.push(one(BODY_FRAMES, "2"));
    }
    // They cost time and change no bit, which every study sees for itself.
    space.push(one(THREADS, if ground.threads > 1 { "1" } else { "2" }));
    space.push(one(RANKS, "2"));
    space
}

/// A number as `1e-4`.
fn scientific(number: f64) -> String {
    let text = format!("{number:.2e}");
    match text.split_once('e') {
        Some((digits, power)) => format!("{}e{power}", digits.trim_end_matches('0').trim_end_matches('.')),
        None => text,
    }
}

/// Whether a shot without this effect still is one to look at.
fn can_go(effect: &str) -> bool {
    drapery_core::effects::find(effect).is_none_or(|spec| !spec.study.is_essential)
}

/// A wish with one more change.
fn with(wish: &RunRequest, name: &str, value: &str, ground: &BaseSettings) -> RunRequest {
    let role = match (wish.role, role_of(name)) {
        (Role::Accuracy, role) | (role, Role::Accuracy) => role,
        (Role::Threads, Role::Threads) => Role::Threads,
        _ => Role::Model,
    };
    let times = wish.times * rough_times(name, value, ground);
    RunRequest::new(role, changed(&wish.setting, name, value, ground), times)
}

/// Returns the runs that were asked for: all combinations, some of them, or one change at a time; each once.
fn asked_space(asked: &Asked, ground: &BaseSettings) -> Vec<RunRequest> {
    let mut all: Vec<RunRequest> = Vec::new();
    for row in rows(asked) {
        let none = RunRequest::new(Role::Accuracy, as_is(), 1.0);
        let wish = ground.meant(row).iter().fold(none, |all, (name, value)| with(&all, name, value, ground));
        let is_known = |other: &RunRequest| other.setting == wish.setting;
        if !wish.setting.changes.is_empty() && !all.iter().any(is_known) {
            all.push(wish);
        }
    }
    all
}

/// The changes that are made together: every value alone, all combinations, or some of them.
fn rows(asked: &Asked) -> Vec<Vec<Change<'_>>> {
    if asked.latin > 0 {
        return latin(asked);
    }
    if !asked.grid {
        return asked
            .vary
            .iter()
            .flat_map(|(name, values)| values.iter().map(|value| vec![(&**name, &**value)]))
            .collect();
    }
    combinations(&asked.vary)
}

/// Combinations in which every value of every name occurs as often as any other of that name, or once more (Latin
/// hypercube); the same ones every time, and none twice.
fn latin(asked: &Asked) -> Vec<Vec<Change<'_>>> {
    let count = asked.latin as usize;
    let columns: Vec<Vec<(&str, &str)>> = asked
        .vary
        .iter()
        .enumerate()
        .map(|(column, (name, values))| {
            let order = Random::new(column as u64).order(count);
            let value = |place: usize| (name.as_str(), values[place * values.len() / count].as_str());
            order.into_iter().map(value).collect()
        })
        .collect();
    let mut rows: Vec<Vec<(&str, &str)>> = Vec::new();
    for number in 0..count {
        let row: Vec<(&str, &str)> = columns.iter().map(|column| column[number]).collect();
        if !rows.contains(&row) {
            rows.push(row);
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::vary::{parse_vary, tests::ground};

    fn asked(vary: &[&str], grid: bool) -> Asked {
        let vary = vary.iter().map(|text| parse_vary(text).unwrap()).collect();
        Asked { vary, grid, copies: 4, repeats: 3, ..Asked::default() }
    }

    #[test]
    fn one_at_a_time_and_grid_hold_what_they_say() {
        let labels = |asked: &Asked| -> Vec<String> {
            asked_space(asked, &ground()).iter().map(|wish| wish.setting.label.clone()).collect()
        };
        let vary = ["cfl=4,2", "cg_tolerance=1e-2,1e-4"];
        assert_eq!(labels(&asked(&vary, false)), ["cfl 4", "cfl 2", "cg_tolerance 1e-2", "cg_tolerance 1e-4"]);
        assert_eq!(labels(&asked(&vary, true)).len(), 4);
        assert_eq!(labels(&asked(&vary, true))[1], "cfl 4, cg_tolerance 1e-4");
    }

    #[test]
    fn the_reference_is_finer_than_all_that_is_compared_with_it() {
        let cfl = |asked: &Asked| {
            let wish = references(asked, &ground(), FINENESS[0]).pop().unwrap();
            wish.setting.settings[0].1.parse::<f64>().unwrap()
        };
        assert_eq!(cfl(&asked(&[], false)), 0.25);
        assert_eq!(cfl(&asked(&["cfl=4,0.25"], false)), 0.125);
        // No run of the reference has longer steps than the scene.
        for fineness in FINENESS {
            for wish in references(&asked(&[], false), &ground(), fineness) {
                assert!(wish.setting.settings[0].1.parse::<f64>().unwrap() <= ground().cfl, "{}", wish.label());
            }
        }
    }

    #[test]
    fn base_copy_and_references_come_before_what_only_measures_time_again() {
        let all = wishes(&asked(&[], false), &ground(), FINENESS[0]);
        let at = |found: &dyn Fn(&RunRequest) -> bool| all.iter().position(found).unwrap();
        assert_eq!(at(&|wish| wish.role == Role::Base), 0);
        // Where there is time for little, what everything is compared with goes before what tells the noise.
        assert_eq!(at(&|wish| wish.role == Role::Reference), 3);
        assert_eq!(at(&|wish| wish.copy == 1), 4);
        assert!(at(&|wish| wish.role == Role::Reference) < at(&|wish| wish.role == Role::Without));
        assert!(at(&|wish| wish.role == Role::Without) < at(&|wish| wish.repeat > 0));
    }

    #[test]
    fn settings_of_both_integrators_are_compared_and_the_reference_keeps_that_of_the_scene() {
        let long = BaseSettings { is_implicit: true, ..ground() };
        let none = asked(&[], false);
        for (ground, own, other) in [
            (ground(), "cfl 2", "integrator tr_bdf2, steps_per_frame"),
            (long, "steps_per_frame 16", "integrator semi_implicit"),
        ] {
            let accuracy: Vec<String> = wishes(&none, &ground, FINENESS[0])
                .into_iter()
                .filter(|wish| wish.role == Role::Accuracy)
                .map(|wish| wish.setting.label)
                .collect();
            let with = |start: &str| accuracy.iter().filter(|label| label.starts_with(start)).count();
            assert!(with(own) >= 2 && with(other) >= 2 && with("cg_tolerance") >= 2, "{accuracy:?}");
            let references = references(&none, &ground, FINENESS[0]);
            assert!(references.iter().all(|wish| !wish.setting.label.contains("integrator")), "{references:?}");
        }
        // A sixteenth of the step, or half of the shortest that is asked for.
        let long = BaseSettings { is_implicit: true, ..super::super::vary::tests::ground() };
        let finest = |asked: &Asked| references(asked, &long, FINENESS[0]).pop().unwrap().setting.changes[0].clone();
        let steps = |count: &str| ("steps_per_frame".to_owned(), count.to_owned());
        assert_eq!(finest(&none), steps("128"));
        assert_eq!(finest(&asked(&["steps_per_frame=4,100"], false)), steps("200"));
    }

    #[test]
    fn combinations_that_differ_in_nothing_that_counts_are_run_once() {
        let asked = asked(&["integrator=semi_implicit,tr_bdf2", "steps_per_frame=4,8", "cfl=4,2"], true);
        let labels: Vec<String> = asked_space(&asked, &ground()).into_iter().map(|wish| wish.setting.label).collect();
        let expected = [
            "integrator semi_implicit, cfl 4",
            "integrator semi_implicit, cfl 2",
            "integrator tr_bdf2, steps_per_frame 4",
            "integrator tr_bdf2, steps_per_frame 8",
        ];
        assert_eq!(labels, expected);
        assert!(asked_space(&asked, &ground()).iter().all(|wish| wish.role == Role::Accuracy));
    }

    #[test]
    fn a_latin_hypercube_tries_every_value_equally_often() {
        let asked =
            Asked { latin: 6, ..asked(&["cfl=4,2,1", "cg_tolerance=1e-2,1e-4", "max_steps=1,2,3,4,5,6"], false) };
        let rows = latin(&asked);
        assert_eq!(rows.len(), 6);
        for (column, (name, values)) in asked.vary.iter().enumerate() {
            for value in values {
                let times = rows.iter().filter(|row| row[column] == (name.as_str(), value.as_str())).count();
                assert_eq!(times, 6 / values.len(), "{name} {value}: {rows:?}");
            }
        }
        assert_eq!(rows, latin(&asked));
        let labels: Vec<String> = asked_space(&asked, &ground()).into_iter().map(|wish| wish.setting.label).collect();
        assert!(labels.iter().all(|label| label.matches(", ").count() == 2), "{labels:?}");
    }

    #[test]
    fn what_a_study_cannot_do_without_costs_a_fraction_of_everything() {
        let [all, core] = whole_times(&asked(&[], false), &ground());
        assert!(core > 10.0 && core < 0.5 * all, "{core} of {all}");
    }
}

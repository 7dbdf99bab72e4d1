//! The same bits on ranks where cloth is struck, stacked, pinched and slides: scenes whose parts are on many ranks, with
//! collisions across their borders. `drapery selftest --bits SCENE` compares the same.

use std::path::Path;

use drapery_analysis::bits::{BitsCheck, Layout};
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{Scene, SceneDescription};
use drapery_core::simulation::{Advance, FrameInput, Simulation};
use drapery_core::snapshot::Snapshot;
use drapery_shot::scene_source::SceneSource;

/// A scene of `tests/scenes/bits` with these settings.
fn scene(name: &str, settings: &[(&str, &str)]) -> SceneSource {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/bits").join(name);
    let mut source = SceneSource::file(file);
    source.settings = settings.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    source
}

/// A scene has the same bits on these ranks, up to a frame; `meets` are counts that it has to have by then.
fn has_the_same_bits(source: &SceneSource, last: Option<i64>, layouts: &[[usize; 2]], meets: &[&str]) {
    let check = BitsCheck::new(source, last).unwrap_or_else(|fault| panic!("{fault}"));
    for name in meets {
        assert!(check.counted(name) > 0, "there are no {name}");
    }
    for &[ranks, threads] in layouts {
        let layout = Layout { ranks, threads };
        let difference = check.compare(layout).unwrap_or_else(|fault| panic!("{layout}: {fault}"));
        assert!(difference.is_none(), "{layout}: {}", difference.map_or_else(String::new, |found| found.to_string()));
    }
}

#[test]
fn a_sheet_of_ten_thousand_vertices_that_is_struck_has_the_same_bits_on_ranks() {
    let source = scene("struck.toml", &[("solver.preset", "preview")]);
    has_the_same_bits(&source, Some(3), &[[2, 1], [3, 1]], &["body_contacts", "repulsions", "retried_shorter"]);
}

#[test]
fn rules_of_contact_have_the_same_bits_on_ranks() {
    for integrator in ["semi_implicit", "tr_bdf2"] {
        let source = scene("rules.toml", &[("solver.integrator", integrator)]);
        has_the_same_bits(&source, None, &[[2, 1], [3, 1]], &["body_contacts", "repulsions"]);
    }
}

/// A scene with a setting of the solver has the same bits on many ranks and threads.
fn has_the_same_bits_on_many_ranks(name: &str, setting: (&str, &str), meets: &[&str]) {
    has_the_same_bits(&scene(name, &[setting]), None, &[[2, 1], [3, 1], [4, 1], [7, 1], [2, 2]], meets);
}

/// A test of a scene with a setting of the solver, which takes 5 to 40 minutes.
macro_rules! same_bits {
    ($solver:ident, $setting:expr, $scene:literal, $meets:expr) => {
        #[test]
        #[ignore = "long: part of make test-full"]
        fn $solver() {
            super::has_the_same_bits_on_many_ranks($scene, $setting, &$meets);
        }
    };
}

/// Tests of each scene, one for each integrator and preset.
macro_rules! same_bits_with_every_solver {
    ($($kind:ident: $scene:literal meets $meets:expr;)*) => {$(
        mod $kind {
            same_bits!(semi_implicit, ("solver.integrator", "semi_implicit"), $scene, $meets);
            same_bits!(preview, ("solver.preset", "preview"), $scene, $meets);
            same_bits!(production, ("solver.preset", "production"), $scene, $meets);
            same_bits!(hero, ("solver.preset", "hero"), $scene, $meets);
        }
    )*};
}

same_bits_with_every_solver! {
    struck: "struck.toml" meets ["body_contacts", "repulsions", "collision_hits"];
    stacked: "stacked.toml" meets ["body_contacts", "repulsions"];
    pinched: "pinched.toml" meets ["body_contacts", "body_pinched", "repulsions"];
    sliding: "sliding.toml" meets ["body_contacts", "repulsions"];
}

/// The state of a scene at a frame. A run that `stops` does so at the first state after an attempt with shorter steps, which other
/// ranks continue from.
fn run_to_frame(description: &SceneDescription, last: i64, [ranks, others]: [usize; 2], stops: bool) -> Snapshot {
    let simulate = |ranks: usize, from: Option<&(Snapshot, i64)>, stops: bool| {
        let work = |communicator| {
            let ranks = Ranks::new(communicator);
            let scene =
                Scene::distribute(&ranks, ranks.is_first().then(|| description.clone())).expect("a valid scene");
            let start = from.map_or(description.timeline.start, |(_, frame)| *frame);
            let input = FrameInput::to_frame(start);
            let mut simulation = match from {
                None => Simulation::new(scene, &input).expect("a start"),
                Some((snapshot, _)) => {
                    let mut snapshot = snapshot.clone();
                    let source = ranks.is_first().then_some(&mut snapshot as _);
                    Simulation::restore_from(scene, &input, source).expect("a snapshot")
                }
            };
            while simulation.frame() < last {
                let input = FrameInput::to_frame(simulation.frame() + 1);
                let advance = simulation.advance_or_pause(&input, &mut |_| stops);
                if let Advance::Paused(summary) = advance.expect("a frame") {
                    // Counts are on one rank; all have to stop at the same state.
                    if ranks.any(summary.metrics.counted("retried_shorter") > 0) {
                        return ((simulation.snapshot(), simulation.frame()), true);
                    }
                }
            }
            ((simulation.snapshot(), simulation.frame()), false)
        };
        let all = LocalRanks::run(ranks, 1, work).unwrap_or_else(|error| panic!("{ranks} ranks: {error}"));
        all.into_iter().next().expect("there is a first rank")
    };
    let (snapshot, stopped) = simulate(ranks, None, stops);
    assert_eq!(stopped, stops, "no step was tried again");
    if stops { simulate(others, Some(&snapshot), false).0.0 } else { snapshot.0 }
}

#[test]
#[ignore = "long: part of make test-full"]
fn a_run_stopped_after_a_retried_step_continues_with_the_same_bits_on_other_ranks() {
    let source = scene("struck.toml", &[("solver.preset", "preview")]);
    let file = source.read().unwrap_or_else(|error| panic!("{error}"));
    let description = file.resolve().unwrap_or_else(|errors| panic!("{errors:?}")).scene;
    let whole = run_to_frame(&description, 3, [1, 1], false);
    let parts = run_to_frame(&description, 3, [2, 3], true);
    for (a, b) in parts.sections.iter().zip(&whole.sections) {
        for (x, y) in a.datasets.iter().zip(&b.datasets) {
            assert!(x == y, "{}/{} differs", a.name, x.name);
        }
    }
}

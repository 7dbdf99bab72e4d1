//! Layers of silk in long steps: on a ball, where stages do not settle with few steps a frame and nothing crosses, and in a fold that comes to
//! rest.

use std::path::Path;

use drapery_core::metrics::Metrics;
use drapery_core::parallel::ranks::Ranks;
use drapery_shot::scene_source::SceneSource;
use drapery_shot::steps::SteppedShot;
use drapery_tests::positions;

use crate::self_contact::crossings_as_stored;

/// A scene of `tests/scenes` with settings.
fn shot(scene: &str, settings: &[(&str, &str)]) -> SteppedShot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(scene);
    let mut source = SceneSource::file(file);
    source.settings = settings.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    let description = source.read().unwrap_or_else(|e| panic!("{e}")).resolve().unwrap_or_else(|e| panic!("{e:?}"));
    SteppedShot::start(&Ranks::default(), description, 1).unwrap_or_else(|e| panic!("{e}"))
}

/// Simulates up to a frame; nothing may cross in any frame. Returns what was counted.
fn is_free_of_crossings(settings: &[(&str, &str)], last: i64) -> Metrics {
    let mut shot = shot("layers_on_a_ball.toml", settings);
    let mut all = Metrics::default();
    for frame in 1..=last {
        let done = shot.next_frame(&mut || false).unwrap_or_else(|e| panic!("{e}")).expect("no request to stop");
        all.add(&done.summary.metrics);
        let found = crossings_as_stored(shot.simulation(), |x| x);
        assert_eq!(found, 0, "{settings:?}, frame {frame}");
    }
    all
}

#[test]
fn layers_with_one_step_a_frame_never_cross() {
    let counted = is_free_of_crossings(&[("solver.steps_per_frame", "1")], 9);
    assert!(counted.counted("retried_shorter") > 0, "no stage was unsettled");
    let [searches, steps] = ["pair_searches", "collision_steps"].map(|name| counted.counted(name));
    assert!(
        searches < steps,
        "a step that is tried again keeps its list of pairs: {searches} searches in {steps} steps"
    );
}

#[test]
fn folded_silk_comes_to_rest_on_a_floor() {
    // With the tolerances of two presets.
    for setting in [("solver.steps_per_frame", "8"), ("solver.preset", "production")] {
        let mut shot = shot("folded_silk.toml", &[setting]);
        for frame in 1..=48 {
            let before = positions(shot.simulation());
            let done = shot.next_frame(&mut || false).unwrap_or_else(|e| panic!("{e}")).expect("no request to stop");
            if frame <= 36 {
                continue;
            }
            let after = positions(shot.simulation());
            let farthest = after.iter().zip(&before).map(|(x, before)| (x - before).norm()).fold(0.0, f64::max);
            let energy = done.summary.kinetic_energy;
            assert_eq!(done.summary.steps, 8, "{setting:?}, frame {frame}: steps were taken back");
            assert!(farthest < 1e-4, "{setting:?}, frame {frame}: a vertex moves by {farthest} m");
            assert!(energy < 1e-6, "{setting:?}, frame {frame}: {energy} J");
        }
    }
}

#[test]
fn layers_at_rest_take_the_steps_asked_for() {
    for height in ["1.2", "1.2003", "1.2004"] {
        let center = format!("[0, {height}, 0]");
        let settings =
            [("shot.frames", "0-48"), ("solver.preset", "production"), ("garment.f.panel.center", center.as_str())];
        let mut shot = shot("layers_on_a_ball.toml", &settings);
        for frame in 1..=48 {
            let done = shot.next_frame(&mut || false).unwrap_or_else(|e| panic!("{e}")).expect("no request to stop");
            let (steps, energy) = (done.summary.steps, done.summary.kinetic_energy);
            assert!(frame <= 30 || (steps == 8 && energy < 1e-7), "{height}, frame {frame}: {steps} steps, {energy} J");
        }
    }
}

#[test]
#[ignore = "long: part of make test-full"]
fn layers_never_cross_at_any_step() {
    for steps in ["24", "8", "2", "1"] {
        is_free_of_crossings(&[("solver.steps_per_frame", steps)], 36);
    }
    for steps in ["4", "1"] {
        is_free_of_crossings(&[("shot.fps", "1"), ("solver.steps_per_frame", steps)], 4);
    }
}

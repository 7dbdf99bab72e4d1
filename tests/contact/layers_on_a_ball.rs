//! Layers that fall on a ball with few steps a frame, or with a frame a second: their stages do not settle, and nothing crosses.

use std::path::Path;

use drapery_core::metrics::Metrics;
use drapery_core::parallel::ranks::Ranks;
use drapery_shot::scene_source::SceneSource;
use drapery_shot::steps::SteppedShot;

use crate::self_contact::crossings_as_stored;

/// Simulates up to a frame; nothing may cross in any frame. Returns what was counted.
fn is_free_of_crossings(settings: &[(&str, &str)], last: i64) -> Metrics {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/layers_on_a_ball.toml");
    let mut source = SceneSource::file(file);
    source.settings = settings.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    let description = source.read().unwrap_or_else(|e| panic!("{e}")).resolve().unwrap_or_else(|e| panic!("{e:?}"));
    let mut shot = SteppedShot::start(&Ranks::default(), description, 1).unwrap_or_else(|e| panic!("{e}"));
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
#[ignore = "long: part of make test-full"]
fn layers_never_cross_at_any_step() {
    for steps in ["24", "8", "2", "1"] {
        is_free_of_crossings(&[("solver.steps_per_frame", steps)], 36);
    }
    for steps in ["4", "1"] {
        is_free_of_crossings(&[("shot.fps", "1"), ("solver.steps_per_frame", steps)], 4);
    }
}

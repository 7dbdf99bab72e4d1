//! Layers that fall on a ball with few steps a frame, or with a frame a second: their stages do not settle, and nothing crosses.

use std::path::Path;

use drapery_core::parallel::ranks::Ranks;
use drapery_shot::scene_source::SceneSource;
use drapery_shot::steps::SteppedShot;

use crate::self_contact::crossings_as_stored;

/// Simulates up to a frame; nothing may cross in any frame. Returns the attempts with shorter steps.
fn is_free_of_crossings(settings: &[(&str, &str)], last: i64) -> u64 {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/layers_on_a_ball.toml");
    let mut source = SceneSource::file(file);
    source.settings = settings.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    let description = source.read().unwrap_or_else(|e| panic!("{e}")).resolve().unwrap_or_else(|e| panic!("{e:?}"));
    let mut shot = SteppedShot::start(&Ranks::default(), description, 1).unwrap_or_else(|e| panic!("{e}"));
    let mut retried = 0;
    for frame in 1..=last {
        let done = shot.next_frame(&mut || false).unwrap_or_else(|e| panic!("{e}")).expect("no request to stop");
        retried += done.summary.metrics.counted("retried_shorter");
        let found = crossings_as_stored(shot.simulation(), |x| x);
        assert_eq!(found, 0, "{settings:?}, frame {frame}");
    }
    retried
}

#[test]
fn layers_with_one_step_a_frame_never_cross() {
    assert!(is_free_of_crossings(&[("solver.steps_per_frame", "1")], 9) > 0, "no stage was unsettled");
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

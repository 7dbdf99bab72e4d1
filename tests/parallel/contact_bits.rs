//! The same bits on ranks where cloth is struck, stacked, pinched and slides: scenes whose parts are on many ranks, with
//! collisions across their borders. `drapery selftest --bits SCENE` compares the same.

use std::path::Path;

use drapery_analysis::bits::{BitsCheck, Layout};
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

/// Integrators and presets.
const SOLVERS: [(&str, &str); 4] = [
    ("solver.integrator", "semi_implicit"),
    ("solver.preset", "preview"),
    ("solver.preset", "production"),
    ("solver.preset", "hero"),
];

/// A scene, with all integrators and presets, on many ranks and threads.
fn has_the_same_bits_with_every_solver(name: &str, meets: &[&str]) {
    for setting in SOLVERS {
        let source = scene(name, &[setting]);
        has_the_same_bits(&source, None, &[[2, 1], [3, 1], [4, 1], [7, 1], [2, 2]], meets);
    }
}

#[test]
#[ignore = "long: part of make test-full"]
fn struck_cloth_has_the_same_bits_with_every_solver() {
    has_the_same_bits_with_every_solver("struck.toml", &["body_contacts", "repulsions", "collision_hits"]);
}

#[test]
#[ignore = "long: part of make test-full"]
fn stacked_cloth_has_the_same_bits_with_every_solver() {
    has_the_same_bits_with_every_solver("stacked.toml", &["body_contacts", "repulsions"]);
}

#[test]
#[ignore = "long: part of make test-full"]
fn pinched_cloth_has_the_same_bits_with_every_solver() {
    has_the_same_bits_with_every_solver("pinched.toml", &["body_contacts", "repulsions"]);
}

#[test]
#[ignore = "long: part of make test-full"]
fn sliding_cloth_has_the_same_bits_with_every_solver() {
    has_the_same_bits_with_every_solver("sliding.toml", &["body_contacts", "repulsions"]);
}

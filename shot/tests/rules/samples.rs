//! Rules about the samples of files.

use std::path::Path;

use super::{HERO, STANDING, hero_with, rule, with};

#[test]
fn samples_several_frames_apart_are_told_and_those_of_every_frame_are_not() {
    let scene = with(HERO).replace("2-3", "2-8");
    let at = |fps: f64, samples: usize| move |folder: &Path| hero_with(folder, STANDING, (fps, false), samples);
    let words = [
        "body \"hero\": ",
        "hero.abc: its samples are 2 frames apart, and frames between are interpolated on straight lines",
        "export a sample for every frame, or silence this rule",
    ];
    // Frames 2, 4, 6 and 8; in frames 2 to 4 there is one step alone.
    rule("sparse_samples", at(12.0, 4), &[(&scene, &words)], &[&scene.replace("2-8", "2-4")]);
    rule(
        "sparse_samples",
        at(8.0, 4),
        &[(&scene.replace("2-8", "3-12"), &["3 frames apart"])],
        &[&scene.replace("2-8", "3-6")],
    );
    for (fps, samples) in [(24.0, 8), (48.0, 16), (96.0, 32)] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        at(fps, samples)(folder.path());
        assert_eq!(super::warnings(folder.path(), &scene), [], "{fps}");
    }
}

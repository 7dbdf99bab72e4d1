//! A run that gives up leaves what is needed to see it happen again.

use crate::{SHEET, drapery, folder_with};

#[test]
fn a_run_that_gives_up_leaves_a_bundle_that_gives_up_again() {
    // No step that is allowed is short enough for such velocities.
    let solver = "[solver]\nmin_dt = 1e-6\n[[garment]]";
    let scene = SHEET
        .replace("[garment.stretch]", "[garment.random_velocity]\nseed = 1\nspeed = 1e6\n[garment.stretch]")
        .replacen("[[garment]]", solver, 1);
    let folder = folder_with(&scene);
    let run = drapery(folder.path(), &["run", "scene.toml", "--out", "out"]);
    assert_eq!(run.code, Some(80), "{}", run.stderr);
    let debug = folder.path().join("out/debug");
    let stem = "frame_01001.step_000000";
    for ending in ["json", "toml", "h5", "abc"] {
        assert!(debug.join(format!("{stem}.{ending}")).is_file(), "{ending}\n{}", run.stderr);
    }
    let bundle = format!("out/debug/{stem}.json");
    assert!(run.stderr.contains(&format!("drapery run --replay {bundle}")), "{}", run.stderr);
    let again = drapery(folder.path(), &["run", "--replay", &bundle]);
    assert_eq!(again.code, Some(80), "{}", again.stderr);
    let reason = |text: &str| text.lines().find(|line| line.contains("the time step fell to")).map(str::to_owned);
    let why = reason(&run.stderr);
    assert!(why.is_some() && reason(&again.stderr) == why, "{}\n{}", run.stderr, again.stderr);
    assert!(!folder.path().join("out/debug/out").exists());
    let nothing = drapery(folder.path(), &["run", "--replay", "scene.toml"]);
    assert_eq!(nothing.code, Some(65), "{}", nothing.stderr);
}

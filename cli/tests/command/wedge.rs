//! Wedges: what no run of them can have is named before anything runs.

use crate::{SHEET, drapery, folder_with};

#[test]
fn a_key_that_the_integrator_of_one_run_does_not_have_is_named_before_anything_runs() {
    let folder = folder_with(SHEET);
    for (key, integrators, refused) in [
        ("solver.steps_per_frame=16", "tr_bdf2,semi_implicit", "integrator=semi_implicit"),
        ("solver.cfl=2", "semi_implicit,tr_bdf2", "integrator=tr_bdf2"),
    ] {
        let vary = format!("solver.integrator={integrators}");
        let wedge = drapery(folder.path(), &["wedge", "scene.toml", "--out", "w", "--vary", &vary, "--set", key]);
        assert_eq!(wedge.code, Some(78), "{}{}", wedge.stdout, wedge.stderr);
        let name = key.split(['.', '=']).nth(1).unwrap();
        assert!(wedge.stderr.contains(&format!("run {refused}")) && wedge.stderr.contains(name), "{}", wedge.stderr);
        assert!(!folder.path().join("w").exists());
    }
}

#[test]
fn a_key_that_is_both_varied_and_set_is_named() {
    let folder = folder_with(SHEET);
    let vary = ["wedge", "scene.toml", "--vary", "resolution=4,5", "--set", "resolution=6", "--list"];
    let refused = drapery(folder.path(), &vary);
    assert_eq!(refused.code, Some(2), "{}", refused.stdout);
    assert!(refused.stderr.contains("resolution: set with --set and varied with --vary"), "{}", refused.stderr);
}

#[test]
fn a_run_that_was_refused_has_all_columns() {
    let folder = folder_with(SHEET);
    let refused = folder.path().join("w/resolution=5");
    std::fs::create_dir_all(&refused).unwrap();
    std::fs::write(refused.join("sheet.abc"), "mine").unwrap();
    let wedge = drapery(folder.path(), &["wedge", "scene.toml", "--vary", "resolution=4,5", "--out", "w"]);
    assert_eq!(wedge.code, Some(1), "{}", wedge.stderr);
    let columns = |line: &str| line.split("  ").filter(|cell| !cell.trim().is_empty()).count();
    let line = |start: &str| wedge.stdout.lines().find(|line| line.starts_with(start)).unwrap();
    assert_eq!(
        [line("resolution=4"), line("resolution=5")].map(columns),
        [columns(line("run   ")); 2],
        "{}",
        wedge.stdout
    );
    assert!(line("resolution=5").contains("0 of 0"), "{}", wedge.stdout);
    let csv = std::fs::read_to_string(folder.path().join("w/comparison.csv")).unwrap();
    assert!(csv.contains("log,0,0,0,,"), "{csv}");
}

//! `drapery stop`: who is asked, and what is refused.

use crate::{SHEET, drapery, folder_with};

#[test]
fn a_folder_without_a_run_cannot_be_stopped() {
    let folder = folder_with(SHEET);
    let stop = drapery(folder.path(), &["stop", "."]);
    assert_eq!(stop.code, Some(66));
    assert!(stop.stderr.contains("holds no run"), "{}", stop.stderr);
    assert!(!folder.path().join("control").exists());
}

#[test]
fn a_run_that_has_ended_is_left_alone() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "-q"]).code, Some(0));
    let stop = drapery(folder.path(), &["stop", "out/sheet"]);
    assert_eq!(stop.code, Some(0), "{}", stop.stderr);
    assert!(stop.stdout.contains("no run is in progress"), "{}", stop.stdout);
    assert!(!folder.path().join("out/sheet/control/stop").exists());
}

#[test]
fn the_run_that_holds_a_folder_is_asked_by_a_file() {
    let folder = folder_with(SHEET);
    // A run elsewhere, heard of just now.
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs();
    let lock = format!(
        r#"{{"host": "render042", "pid": 4711, "started": 5, "boot": "b", "namespace": "n", "heartbeat": {now}}}"#
    );
    std::fs::write(folder.path().join("lock.json"), lock).unwrap();
    let stop = drapery(folder.path(), &["stop", "."]);
    assert_eq!(stop.code, Some(0), "{}", stop.stderr);
    assert!(stop.stdout.contains("render042:4711 is asked to stop"), "{}", stop.stdout);
    assert!(folder.path().join("control/stop").exists());
}

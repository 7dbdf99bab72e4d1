//! `drapery stop`: who is asked, and what is refused.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::{SHEET, command, drapery, folder_with};

/// No run takes this long to see a signal, however slow the machine is.
const PATIENCE: Duration = Duration::from_secs(20 * 60);

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
    assert!(stop.stdout.contains("asked render042:4711 to stop"), "{}", stop.stdout);
    assert!(folder.path().join("control/stop").exists());
}

/// A disc of one face.
const DISC: &str = r#"
drapery = 1
[shot]
name = "disc"
fps = "24"
frames = "1-4"
[units]
length = "m"
[gravity]
[self_repulsion]
[self_collision]
[[garment]]
name = "disc"
rest = "disc.obj"
density = 0.2
"#;

#[test]
fn a_run_whose_first_step_takes_for_ever_obeys_a_signal() {
    // Each of these triangles is as near to each other as they can be: the pairs fill any machine.
    const CORNERS: usize = 5000;
    let mut disc = String::new();
    for corner in 0..CORNERS {
        let (sin, cos) = (std::f64::consts::TAU * corner as f64 / CORNERS as f64).sin_cos();
        writeln!(disc, "v {cos} 1 {sin}").expect("a string has room");
    }
    let corners: Vec<String> = (1..=CORNERS).rev().map(|corner| corner.to_string()).collect();
    writeln!(disc, "f {}", corners.join(" ")).expect("a string has room");
    let folder = folder_with(DISC);
    std::fs::write(folder.path().join("disc.obj"), disc).expect("the folder can be written to");
    // The run asks for requests once at the start; a later signal comes within the first step.
    for pause in [0.2, 1.0, 5.0, 25.0, 125.0] {
        let (code, said) = stopped_after(folder.path(), Duration::from_secs_f64(pause));
        assert_eq!(code, Some(75), "{said}");
        if said.contains("stopped (signal TERM) before the first step was complete") {
            assert!(said.contains("continue with: drapery run scene.toml"), "{said}");
            return;
        }
    }
    panic!("the signal never came within the first step");
}

/// Exit code and complaints of a run that gets SIGTERM so long after its first frame was recorded.
fn stopped_after(folder: &Path, pause: Duration) -> (Option<i32>, String) {
    let arguments = ["run", "scene.toml", "--threads", "1", "--overwrite", "-q"];
    let mut run = command(folder, &arguments).stderr(Stdio::piped()).spawn().expect("it can be started");
    let record = folder.join("out/disc/run.jsonl");
    while !record.exists() && run.try_wait().expect("it can be asked").is_none() {
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(pause);
    let kill = Command::new("kill").args(["-TERM", &run.id().to_string()]).status();
    assert!(kill.expect("kill is there").success(), "the run has ended by itself");
    let asked = Instant::now();
    while run.try_wait().expect("it can be asked").is_none() {
        assert!(asked.elapsed() < PATIENCE, "it does not end");
        std::thread::sleep(Duration::from_millis(20));
    }
    let ended = run.wait_with_output().expect("it has ended");
    // The next attempt waits for a record of its own.
    std::fs::remove_file(record).expect("there is a record");
    (ended.status.code(), String::from_utf8_lossy(&ended.stderr).into_owned())
}

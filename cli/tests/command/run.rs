//! Runs of a tiny scene: what is printed, what is written, what is refused.

use std::io::Read;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use crate::{SHEET, command, crossing, drapery, folder_with};

#[test]
fn a_run_prints_a_line_a_frame_and_its_files_and_writes_a_cache_that_verifies() {
    let folder = folder_with(SHEET);
    let run = drapery(folder.path(), &["run", "scene.toml", "--threads", "2"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.starts_with("frame 1001/1004 steps 0 cg 0 wall"), "{}", run.stdout);
    assert_eq!(run.stdout.lines().filter(|line| line.starts_with("frame 100")).count(), 4);
    for word in ["\ncg_short", "4 frames in", "wrote out/sheet/sheet.abc"] {
        assert!(run.stdout.contains(word), "{}", run.stdout);
    }
    assert!(run.stderr.is_empty(), "{}", run.stderr);
    let verify = drapery(folder.path(), &["verify", "out/sheet/sheet.abc"]);
    assert_eq!(verify.code, Some(0), "{}", verify.stderr);
    assert!(verify.stdout.contains("4 samples, 41.708333 s = frame 1001.000"), "{}", verify.stdout);
    let info = drapery(folder.path(), &["info", "out/sheet/sheet.abc"]);
    for word in ["/sheet/sheetShape: mesh", "velocities: yes", "frames 1001.000 to 1004.000 at 24 fps", "upAxis: Y"] {
        assert!(info.stdout.contains(word), "{}", info.stdout);
    }
}

#[test]
fn a_second_run_into_the_same_folder_needs_overwrite() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "-q"]).code, Some(0));
    let before = std::fs::read(folder.path().join("out/sheet/sheet.abc")).unwrap();
    let second = drapery(folder.path(), &["run", "scene.toml", "--set", "resolution=4"]);
    assert_eq!(second.code, Some(73));
    assert!(second.stderr.contains("--overwrite"), "{}", second.stderr);
    assert!(std::fs::read(folder.path().join("out/sheet/sheet.abc")).unwrap() == before);
    assert_eq!(
        drapery(folder.path(), &["run", "scene.toml", "--set", "resolution=4", "--overwrite", "-q"]).code,
        Some(0)
    );
    assert!(std::fs::read(folder.path().join("out/sheet/sheet.abc")).unwrap() != before);
}

#[test]
fn the_resolved_scene_runs_again_to_the_same_bytes_on_any_number_of_threads() {
    let folder = folder_with(SHEET);
    let run = |scene: &str, out: &str, threads: &str| {
        let outcome = drapery(folder.path(), &["run", scene, "--out", out, "--threads", threads, "-q"]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        std::fs::read(folder.path().join(out).join("sheet.abc")).unwrap()
    };
    let first = run("scene.toml", "a", "1");
    assert!(first == run("a/resolved.toml", "b", "3"));
}

#[test]
fn json_progress_is_one_object_a_line_with_the_exit_code_at_the_end() {
    let folder = folder_with(SHEET);
    let run = drapery(folder.path(), &["run", "scene.toml", "--progress", "json"]);
    let records: Vec<Value> =
        run.stdout.lines().map(|line| serde_json::from_str(line).expect("one object a line")).collect();
    let frames: Vec<i64> = records.iter().filter_map(|record| record["frame"].as_i64()).collect();
    assert_eq!(frames, [1001, 1002, 1003, 1004]);
    assert!(records[3]["steps"].as_u64() > Some(0));
    assert_eq!(records[4]["exit_code"], 0);
    // A run that is refused says so in the same place.
    let refused = drapery(folder.path(), &["run", "scene.toml", "--progress", "json", "--resume", "never"]);
    let end: Value = serde_json::from_str(refused.stdout.lines().last().unwrap()).unwrap();
    assert_eq!((refused.code, end["exit_code"].as_i64()), (Some(73), Some(73)));
}

#[test]
fn farm_progress_stays_below_100_until_the_end() {
    for (style, prefix, full) in [
        ("alf", "ALF_PROGRESS ", "ALF_PROGRESS 100%"),
        ("tr", "TR_PROGRESS ", "TR_PROGRESS 100"),
        ("openjd", "openjd_progress: ", "openjd_progress: 100"),
        ("deadline", "Progress: ", "Progress: 100%"),
    ] {
        let folder = folder_with(SHEET);
        let run = drapery(folder.path(), &["run", "scene.toml", "--progress", style]);
        let lines: Vec<&str> = run.stdout.lines().filter(|line| line.starts_with(prefix)).collect();
        assert_eq!(lines.iter().filter(|line| line.contains("100")).count(), 1, "{}", run.stdout);
        assert_eq!(run.stdout.lines().last(), Some(full));
        assert!(lines.len() > 2);
    }
}

#[test]
fn a_reader_that_leaves_does_not_stop_the_run() {
    let folder = folder_with(SHEET);
    let mut child = command(folder.path(), &["run", "scene.toml"]).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let manifest = std::fs::read_to_string(folder.path().join("out/sheet/manifest.json")).unwrap();
    assert!(manifest.contains("\"state\": \"done\""), "{manifest}");
}

#[test]
fn a_killed_run_leaves_every_committed_frame() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1900").replace("resolution = 6", "resolution = 20"));
    let mut child =
        command(folder.path(), &["run", "scene.toml", "--threads", "1"]).stdout(Stdio::piped()).spawn().unwrap();
    let manifest = folder.path().join("out/sheet/manifest.json");
    let last_frame = || {
        let text = std::fs::read_to_string(&manifest).ok()?;
        serde_json::from_str::<Value>(&text).expect("the manifest is whole at every moment")["last_complete_frame"]
            .as_i64()
    };
    while last_frame() < Some(1005) {
        assert!(child.try_wait().unwrap().is_none(), "the run ended before its fifth frame");
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    // Whatever was printed until then; only so that the pipe is drained.
    let _ = child.stdout.take().unwrap().read_to_end(&mut Vec::new());
    let promised = last_frame().unwrap();
    assert!(promised < 1900, "the run was over before it could be killed");
    let verify = drapery(folder.path(), &["verify", "out/sheet/sheet.abc"]);
    assert_eq!(verify.code, Some(0), "{}", verify.stderr);
    let of_samples = |line: &str| line.split_once(" samples, ")?.0.rsplit(' ').next()?.parse().ok();
    let samples: i64 = verify.stdout.lines().find_map(of_samples).expect("the samples of the mesh");
    // The manifest follows the cache: the frame after may be in already.
    assert!(samples == promised - 1000 || samples == promised - 999, "{samples} samples, promised up to {promised}");
}

#[test]
fn parameters_are_overridden() {
    let folder = folder_with(SHEET);
    let run = drapery(
        folder.path(),
        &["run", "scene.toml", "--frames", "1001-1002", "--set", "resolution=4", "--set", "solver.cfl=0.5"],
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let resolved = std::fs::read_to_string(folder.path().join("out/sheet/resolved.toml")).unwrap();
    assert!(resolved.contains("cfl = 0.5"), "{resolved}");
}

#[test]
fn the_plan_says_what_runs_and_why() {
    let folder = folder_with(SHEET);
    let text = drapery(folder.path(), &["plan", "scene.toml", "--threads", "3"]).stdout;
    for part in
        ["frames 1001-1004 at 24 fps", "threads: 3 (--threads)", "gravity:", "stretch of sheet:", "body_collision:"]
    {
        assert!(text.contains(part), "`{part}` is missing in\n{text}");
    }
    assert!(!text.contains("bending"), "an effect that is not asked for must not appear\n{text}");
    let outcome =
        command(folder.path(), &["plan", "scene.toml", "--json"]).env("OMP_NUM_THREADS", "2").output().unwrap();
    let plan: Value = serde_json::from_slice(&outcome.stdout).unwrap();
    assert_eq!(plan["threads"]["from"], "OMP_NUM_THREADS");
    assert_eq!(plan["effects"][0]["settings"]["acceleration"]["from"], "default");
    assert_eq!(plan["effects"][1]["settings"]["stiffness"]["from"], "scene");
    assert!(!folder.path().join("out").exists());
}

#[test]
fn a_broken_cache_fails_verification() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "-q"]).code, Some(0));
    let cache = folder.path().join("out/sheet/sheet.abc");
    let bytes = std::fs::read(&cache).unwrap();
    std::fs::write(&cache, &bytes[..bytes.len() - 100]).unwrap();
    assert_eq!(drapery(folder.path(), &["verify", "out/sheet/sheet.abc"]).code, Some(82));
    assert_eq!(drapery(folder.path(), &["verify", "nothing.abc"]).code, Some(66));
}

#[test]
fn strict_runs_end_with_81_when_cloth_crosses_cloth_and_verify_with_82() {
    let folder = folder_with(&crossing());
    let strict = drapery(folder.path(), &["run", "scene.toml", "--strict"]);
    assert_eq!(strict.code, Some(81), "{}", strict.stderr);
    for word in ["crossings_written", "first in frame 1001", "all frames are written"] {
        assert!(strict.stderr.contains(word), "{word}: {}", strict.stderr);
    }
    assert!(strict.stdout.contains("frame 1004/1004") && strict.stdout.contains("\ncrossings "), "{}", strict.stdout);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--overwrite", "-q"]).code, Some(0));
    let verify = drapery(folder.path(), &["verify", "out/sheet/sheet.abc", "out/sheet/second.abc"]);
    assert_eq!(verify.code, Some(82));
    assert!(verify.stderr.contains("intersect in 4 of 4 frames"), "{}", verify.stderr);
    assert_eq!(drapery(folder.path(), &["verify", "out/sheet/second.abc"]).code, Some(0));
}

#[test]
fn a_strict_run_without_losses_is_done() {
    let folder = folder_with(&SHEET.replace("[output]", "[self_collision]\n[output]"));
    let run = drapery(folder.path(), &["run", "scene.toml", "--strict"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    // That nothing was found is said.
    let limits = run.stdout.lines().find(|line| line.starts_with("crossings, crossings_written, "));
    assert!(limits.is_some_and(|line| line.ends_with(" 0")), "{}", run.stdout);
    assert!(!run.stdout.contains("stage "), "{}", run.stdout);
    let long = drapery(folder.path(), &["run", "scene.toml", "--overwrite", "-v"]);
    for part in ["\ncrossings_written                     0\n", "\nB.1 velocity", "\ncg_solves "] {
        assert!(long.stdout.contains(part), "{part}: {}", long.stdout);
    }
}

#[test]
fn help_holds_the_exit_codes_and_the_log_can_be_json() {
    let folder = folder_with(SHEET);
    let help = drapery(folder.path(), &["--help"]);
    assert_eq!(help.code, Some(0));
    for code in [0, 2, 65, 66, 70, 71, 73, 74, 75, 78, 80, 81, 82] {
        assert!(help.stdout.contains(&format!("{code:>4}  ")), "{code}\n{}", help.stdout);
    }
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "-q", "--log-json", "log.jsonl"]).code, Some(0));
    let log = std::fs::read_to_string(folder.path().join("log.jsonl")).unwrap();
    assert!(log.lines().count() >= 4);
    assert!(log.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "{log}");
}

#[test]
fn a_dump_of_frames_that_are_done_says_how_to_get_it() {
    let folder = folder_with(SHEET);
    let run = |arguments: &[&str]| {
        drapery(folder.path(), &[&["run", "scene.toml", "--out", "out", "--keep", "9"], arguments].concat())
    };
    assert_eq!(run(&["--frames", "1001-1003", "-q", "--checkpoint-every", "1f"]).code, Some(0));
    let dump = folder.path().join("out/dump");
    for arguments in [&["--frames", "1001-1003"][..], &["--frames", "1001-1004"]] {
        let outcome = run(&[arguments, &["--dump", "B.4@1002.1"]].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        for part in ["WARN --dump B.4@1002.1: nothing is written, because frames up to 1003 are done", "--resume FRAME"]
        {
            assert!(outcome.stderr.contains(part), "{part}\n{}", outcome.stderr);
        }
        assert!(!dump.exists() || std::fs::read_dir(&dump).unwrap().next().is_none());
    }
    assert_eq!(run(&["--resume", "1001", "--dump", "B.4@1002.1"]).code, Some(0));
    assert!(dump.join("frame_01002.step_000001.B.4.h5").is_file());
}

#[test]
fn schema_and_materials_are_printed() {
    let folder = folder_with(SHEET);
    let schema: Value = serde_json::from_str(&drapery(folder.path(), &["schema"]).stdout).unwrap();
    assert!(schema["properties"]["garment"].is_object());
    assert!(drapery(folder.path(), &["materials"]).stdout.contains("cotton_shirting"));
}

#[cfg(not(feature = "mpi"))]
#[test]
fn without_mpi_one_of_many_processes_is_refused_and_only_the_first_says_so() {
    let folder = folder_with(SHEET);
    for (launcher, rank) in [("OMPI_COMM_WORLD", "0"), ("OMPI_COMM_WORLD", "2"), ("PMI", "0"), ("PMI", "1")] {
        let [size, number] = ["SIZE", "RANK"].map(|name| format!("{launcher}_{name}"));
        let process = |count: &str| -> crate::Outcome {
            let mut command = command(folder.path(), &["run", "scene.toml", "--frames", "1001-1001", "-q"]);
            command.env(&size, count).env(&number, rank).output().unwrap().into()
        };
        let refused = process("3");
        assert_eq!(refused.code, Some(2), "{}", refused.stderr);
        assert_eq!(
            refused.stderr.contains("one of 3 processes") && refused.stderr.contains("--features mpi"),
            rank == "0"
        );
        assert_eq!(refused.stderr.is_empty(), rank != "0", "{}", refused.stderr);
        assert!(!folder.path().join("out").exists());
        // One process that mpirun has started is like any other.
        if rank == "0" {
            assert_eq!(process("1").code, Some(0));
            std::fs::remove_dir_all(folder.path().join("out")).unwrap();
        }
    }
}

#[test]
fn a_failed_run_says_its_cause_in_its_log_and_in_the_last_record() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1008"));
    let run = ["run", "scene.toml", "--progress", "json", "--checkpoint-every", "1f", "--keep", "20"];
    assert_eq!(drapery(folder.path(), &run).code, Some(0));
    let out = folder.path().join("out/sheet");
    std::fs::write(out.join("sheet.abc"), "short").unwrap();
    let failed = drapery(folder.path(), &[&run[..], &["--resume", "1004"]].concat());
    assert_eq!(failed.code, Some(65), "{}", failed.stderr);
    let end: Value = serde_json::from_str(failed.stdout.lines().last().unwrap()).unwrap();
    let text = end["error"].as_str().unwrap_or_default();
    assert!(end["record"] == "end" && end["exit_code"] == 65 && text.contains("sheet.abc: "), "{end}");
    let log = std::fs::read_to_string(out.join("logs/002.log")).unwrap();
    assert!(log.lines().any(|line| line.contains("ERROR") && line.contains("sheet.abc: ")), "{log}");
    let last = log.lines().last().unwrap();
    assert!(last.contains("sheet.abc: ") && last.contains("continue with: drapery run scene.toml"), "{last}");
    // Standard error has it once.
    assert_eq!(failed.stderr.matches("sheet.abc: ").count(), 1, "{}", failed.stderr);
}

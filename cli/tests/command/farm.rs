//! The same command again, as a farm gives it: verdicts, numbers of warnings, and what is left of attempts that were killed.

use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use serde_json::Value;

use drapery_selftest::files::{BODY, FROM_FILES, SKIRT};

use crate::{Outcome, SHEET, command, crossing, drapery, folder_with};

/// Lines of counts that should stay zero in the message of a strict run.
fn limits(outcome: &Outcome) -> Vec<&str> {
    outcome.stderr.lines().filter(|line| line.starts_with("  crossings")).collect()
}

/// The number of warnings that the last line of a text names.
fn named(text: &str) -> usize {
    let line = text.lines().rev().find(|line| line.contains("warning")).expect("a line that counts warnings");
    let words: Vec<&str> = line.split(' ').collect();
    let at = words.iter().position(|word| word.starts_with("warning")).unwrap();
    if words[at - 1] == "no" { 0 } else { words[at - 1].parse().unwrap() }
}

fn shown(text: &str) -> usize {
    text.lines().filter(|line| line.contains("WARN ")).count()
}

#[test]
fn a_strict_run_gives_the_same_verdict_again_whatever_came_between() {
    let folder = folder_with(&crossing());
    let run = |more: &[&str]| drapery(folder.path(), &[&["run", "scene.toml", "--strict"], more].concat());
    let first = run(&[]);
    assert_eq!((first.code, limits(&first).len()), (Some(81), 2), "{}", first.stderr);
    let again = run(&[]);
    assert_eq!((again.code, limits(&again)), (Some(81), limits(&first)), "{}", again.stderr);
    assert!(again.stdout.contains("exist already; 3 warnings"), "{}", again.stdout);
    // Of fewer frames, those that are asked for count.
    let fewer = run(&["--frames", "1001-1001"]);
    assert!(fewer.code == Some(81) && limits(&fewer).len() == 1, "{}", fewer.stderr);
    // The same frames in two attempts, the account of the first of them lost.
    let parts = ["--out", "parts"];
    assert_eq!(run(&[&["--frames", "1001-1002"], &parts[..]].concat()).code, Some(81));
    std::fs::remove_file(folder.path().join("parts/checkpoints/frame_01002.json")).unwrap();
    let second = run(&parts);
    assert_eq!((second.code, limits(&second)), (Some(81), limits(&first)), "{}", second.stderr);
    assert!(second.stderr.contains("this file of times and counts is missing"), "{}", second.stderr);
}

#[test]
fn a_strict_run_does_not_pass_frames_that_nobody_has_counted() {
    let folder = folder_with(&SHEET.replace("[output]", "[self_collision]\n[output]"));
    let run = || drapery(folder.path(), &["run", "scene.toml", "--strict"]);
    assert_eq!((run().code, run().code), (Some(0), Some(0)));
    let record = folder.path().join("out/sheet/run.jsonl");
    let text = std::fs::read_to_string(&record).unwrap();
    let without: Vec<&str> = text.lines().filter(|line| !line.contains("\"frame\":1003,")).collect();
    std::fs::write(&record, without.join("\n") + "\n").unwrap();
    let again = run();
    assert_eq!(again.code, Some(81), "{}", again.stderr);
    assert!(again.stderr.contains("frame 1003: counts unknown"), "{}", again.stderr);
    let status = drapery(folder.path(), &["status", "out/sheet"]);
    assert!(status.stdout.contains("frame 1003: counts unknown"), "{}", status.stdout);
}

#[test]
fn the_last_line_names_as_many_warnings_as_were_given() {
    let folder = folder_with(&crossing());
    for _ in 0..2 {
        let run = drapery(folder.path(), &["run", "scene.toml"]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert_eq!((shown(&run.stderr), named(&run.stdout)), (3, 3), "{}{}", run.stderr, run.stdout);
    }
    let log = std::fs::read_to_string(folder.path().join("out/sheet/logs/001.log")).unwrap();
    assert_eq!((shown(&log), named(&log)), (3, 3), "{log}");
    // A variable that makes no sense is one more.
    let mut odd = command(folder.path(), &["run", "scene.toml", "--progress", "alf"]);
    let odd: Outcome = odd.env("OMP_NUM_THREADS", "many").output().unwrap().into();
    assert_eq!((shown(&odd.stderr), named(&odd.stdout)), (4, 4), "{}{}", odd.stderr, odd.stdout);
}

#[test]
fn a_changed_frame_is_found_by_the_record() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "-q"]).code, Some(0));
    let verify = || drapery(folder.path(), &["verify", "--record", "out/sheet"]);
    let sound = verify();
    assert_eq!(sound.code, Some(0), "{}", sound.stderr);
    assert!(sound.stdout.contains("sheet.abc: 4 of 4 frames match the record"), "{}", sound.stdout);
    let record = folder.path().join("out/sheet/run.jsonl");
    let lines = std::fs::read_to_string(&record).unwrap();
    let changed: String = lines
        .lines()
        .map(|line| match line.contains("\"frame\":1003,") {
            true => line.replacen("\"positions\":\"", "\"positions\":\"0", 1) + "\n",
            false => line.to_owned() + "\n",
        })
        .collect();
    std::fs::write(&record, changed).unwrap();
    let found = verify();
    assert_eq!(found.code, Some(82), "{}", found.stderr);
    assert!(found.stderr.contains("sheet.abc: frame 1003: the positions"), "{}", found.stderr);
    // A frame of which the record says nothing is not verified, and that is no success.
    let silent: String =
        lines.lines().filter(|line| !line.contains("\"frame\":1003,")).map(|line| line.to_owned() + "\n").collect();
    std::fs::write(&record, silent).unwrap();
    let partly = verify();
    assert_eq!(partly.code, Some(82), "{}{}", partly.stdout, partly.stderr);
    assert!(partly.stderr.contains("sheet.abc: frame 1003 cannot be verified"), "{}", partly.stderr);
    assert_eq!(drapery(folder.path(), &["verify"]).code, Some(2));
    assert_eq!(drapery(folder.path(), &["verify", "--record", "."]).code, Some(66));
}

/// Starts a run and kills it when its manifest names a frame.
fn kill_at(folder: &Path, arguments: &[&str], frame: i64) {
    let mut child: Child = command(folder, arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let manifest = folder.join("out/sheet/manifest.json");
    let done = || {
        let text = std::fs::read_to_string(&manifest).unwrap_or_default();
        let manifest: Value = serde_json::from_str(&text).unwrap_or_default();
        let own = manifest["attempts"].as_array().and_then(|all| all.last()?["pid"].as_u64());
        own == Some(child.id().into()) && manifest["last_complete_frame"].as_i64() >= Some(frame)
    };
    while !done() {
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn ten_kills_before_the_first_checkpoint_leave_three_copies_and_status_tells() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-9000"));
    let arguments = ["run", "scene.toml", "--threads", "1", "--checkpoint-every", "100000f"];
    for attempt in 1..=10 {
        kill_at(folder.path(), &arguments, if attempt == 4 { 1012 } else { 1002 });
    }
    let out = folder.path().join("out/sheet");
    let names = || {
        let mut names: Vec<String> = std::fs::read_dir(out.join("stale"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort_unstable();
        names
    };
    let last_frame = |name: &str| {
        let text = std::fs::read_to_string(out.join("stale").join(name).join("manifest.json")).unwrap();
        serde_json::from_str::<Value>(&text).unwrap()["last_complete_frame"].as_i64().unwrap()
    };
    assert!(names().len() <= 3, "{:?}", names());
    assert!(names().iter().map(|name| last_frame(name)).max() >= Some(1012), "the longest copy stays");
    assert!(names().contains(&"attempt_010".to_owned()) && names().contains(&"attempt_009".to_owned()));
    let status = drapery(folder.path(), &["status", "out/sheet"]);
    assert!(status.stdout.contains("  stale        3 attempts, "), "{}", status.stdout);
    assert!(status.stdout.contains("delete out/sheet/stale"), "{}", status.stdout);
    let json: Value = serde_json::from_str(&drapery(folder.path(), &["status", "out/sheet", "--json"]).stdout).unwrap();
    assert!(json["stale"]["attempts"] == 3 && json["stale"]["bytes"].as_u64() > Some(10_000), "{json}");
    // The log says what was removed.
    let logs: String =
        (1..=10).map(|n| std::fs::read_to_string(out.join(format!("logs/{n:03}.log"))).unwrap()).collect();
    assert!(logs.contains("a copy that is kept has the same frames"), "{logs}");
}

#[test]
fn the_cache_of_a_belt_is_verified_compared_and_written_again_as_those_of_garments() {
    let belt =
        "[[body]]\nname = \"belt\"\nbelt = { around = \"hero\", at = [0.1, 0.5, 0.1], gap = \"10 mm\" }\n[[garment]]";
    let folder = folder_with(&FROM_FILES.replace("[[garment]]", belt));
    std::fs::write(folder.path().join("body.obj"), BODY).unwrap();
    std::fs::write(folder.path().join("skirt.obj"), SKIRT).unwrap();
    let run = |out: &str| {
        let run = drapery(folder.path(), &["run", "scene.toml", "-q", "--out", out]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    };
    run("a");
    run("b");
    let manifest = std::fs::read_to_string(folder.path().join("a/manifest.json")).unwrap();
    let manifest: Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["bodies"][0]["files"][0], "belt.abc", "{manifest}");
    let verify = || drapery(folder.path(), &["verify", "--record", "a"]);
    let sound = verify();
    assert_eq!(sound.code, Some(0), "{}", sound.stderr);
    assert!(sound.stdout.contains("belt.abc: 3 of 3 frames match the record"), "{}", sound.stdout);
    let same = drapery(folder.path(), &["diff", "a", "b"]);
    assert!(same.code == Some(0) && same.stdout.contains("belt.abc"), "{}{}", same.stdout, same.stderr);
    // A belt in cloth is reported as any body is, and not judged.
    let crossings = drapery(folder.path(), &["verify", "a/skirt.abc", "a/belt.abc"]);
    assert_eq!(crossings.code, Some(0), "{}", crossings.stderr);
    // The belt of another pose is noticed, and one that is gone is written again.
    let moved = std::fs::read(folder.path().join("a/skirt.abc")).unwrap();
    std::fs::write(folder.path().join("a/belt.abc"), moved).unwrap();
    let found = verify();
    assert_eq!(found.code, Some(82), "{}", found.stdout);
    assert!(found.stderr.contains("belt.abc: frame 1: the positions"), "{}", found.stderr);
    assert_eq!(drapery(folder.path(), &["diff", "a", "b"]).code, Some(1));
    std::fs::remove_file(folder.path().join("a/belt.abc")).unwrap();
    run("a");
    assert_eq!(verify().code, Some(0));
}

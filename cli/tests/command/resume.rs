//! Runs that go on: what is refused touches nothing.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::{SHEET, drapery, folder_with};

/// Files of a run with their content, but for logs and requests.
fn files(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut found, mut waiting) = (BTreeMap::new(), vec![out.to_owned()]);
    while let Some(folder) = waiting.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            match path.is_dir() {
                true if path.ends_with("logs") => {}
                true => waiting.push(path),
                false => drop(found.insert(path.clone(), std::fs::read(&path).unwrap())),
            }
        }
    }
    found
}

/// A run of eight frames in two formats, or three, with a checkpoint of each; what `spoil` does to it; then it is refused to go on
/// with these options, and all is as it was.
fn refused(spoil: &dyn Fn(&Path), options: &[&str], expected: &str) {
    let formats = if cfg!(feature = "usd") { "[\"abc\", \"h5\", \"usd\"]" } else { "[\"abc\", \"h5\"]" };
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1008").replace("[\"abc\"]", formats));
    let run = ["run", "scene.toml", "-q", "--checkpoint-every", "1f", "--keep", "20"];
    assert_eq!(drapery(folder.path(), &run).code, Some(0));
    let out = folder.path().join("out/sheet");
    spoil(&out);
    let before = files(&out);
    let again = drapery(folder.path(), &[&run[..], options].concat());
    assert!(matches!(again.code, Some(65 | 66)), "{options:?}: {:?}: {}", again.code, again.stderr);
    assert!(again.stderr.contains(expected), "{options:?}: {}", again.stderr);
    let after = files(&out);
    assert_eq!(after.keys().collect::<Vec<_>>(), before.keys().collect::<Vec<_>>(), "{options:?}");
    let changed: Vec<&PathBuf> = before.keys().filter(|path| before[*path] != after[*path]).collect();
    assert!(changed.is_empty(), "{options:?}: {changed:?}");
    let status = drapery(folder.path(), &["status", "out/sheet"]);
    assert!(status.stdout.starts_with("sheet: done"), "{}", status.stdout);
}

#[test]
fn a_resume_that_is_refused_touches_nothing() {
    let remove = |out: &Path| {
        for name in ["sheet.abc", "sheet.h5", "sheet.usd"] {
            drop(std::fs::remove_file(out.join(name)));
        }
    };
    refused(&remove, &["--resume", "1004"], "sheet.abc: frame 1004: the cache is missing");
    let cut = |out: &Path| std::fs::write(out.join("sheet.h5"), "short").unwrap();
    refused(&cut, &["--resume", "1004"], "sheet.h5");
    for (checkpoint, frames) in [("1007", "1001-1004"), ("1004", "1001-1006")] {
        refused(&|_| {}, &["--resume", checkpoint, "--frames", frames], "let the run end with frame 100");
    }
}

#[test]
fn a_resume_in_another_form_that_is_refused_touches_nothing() {
    let remove = |out: &Path| {
        for name in ["sheet.abc", "sheet.h5", "sheet.usd"] {
            drop(std::fs::remove_file(out.join(name)));
        }
    };
    let options = ["--resume", "1004", "--set", "output.velocities=false"];
    refused(&remove, &options, "sheet.abc");
}

#[test]
fn status_gives_a_command_that_resumes_the_run_from_any_folder() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1060").replace("resolution = 6", "resolution = 20"));
    let here = folder.path().join("a folder");
    std::fs::create_dir(&here).unwrap();
    std::fs::rename(folder.path().join("scene.toml"), here.join("scene.toml")).unwrap();
    let run = ["run", "scene.toml", "--max-wall", "0.001s", "--out", "o"];
    let stopped = drapery(&here, &run);
    assert_eq!(stopped.code, Some(75), "{}", stopped.stderr);
    let status = drapery(folder.path(), &["status", "a folder/o", "--json"]);
    let status: Value = serde_json::from_str(&status.stdout).unwrap();
    let command = status["command"].as_str().unwrap().replace("--max-wall 0.001s", "");
    assert!(command.starts_with("cd '/") && command.contains("/a folder' && drapery run scene.toml"), "{command}");
    let mut path = Path::new(env!("CARGO_BIN_EXE_drapery")).parent().unwrap().as_os_str().to_owned();
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap_or_default());
    let shell = Command::new("bash").args(["-c", &command]).env("PATH", path).current_dir("/").output();
    let Ok(shell) = shell else {
        println!("skipped: no bash");
        return;
    };
    assert!(shell.status.success(), "{}", String::from_utf8_lossy(&shell.stderr));
    let done = drapery(folder.path(), &["status", "a folder/o"]);
    assert!(done.stdout.starts_with("sheet: done"), "{}", done.stdout);
}

#[test]
fn caches_in_a_format_that_the_scene_has_no_more_go_with_the_run_that_is_replaced() {
    let folder = folder_with(SHEET);
    let run = |formats: &str, more: &[&str]| {
        let formats = format!("output.format=[{formats}]");
        let run = drapery(folder.path(), &[&["run", "scene.toml", "-q", "--set", &formats], more].concat());
        assert_eq!(run.code, Some(0), "{formats}: {}", run.stderr);
    };
    let out = folder.path().join("out/sheet");
    let caches = || {
        let names = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.filter(|name| name.ends_with("abc") || name.ends_with("h5")).collect();
        names.sort_unstable();
        names
    };
    run("\"abc\", \"h5\"", &["--frames", "1001-1002"]);
    run("\"abc\"", &["--overwrite", "--frames", "1001-1002"]);
    assert_eq!(caches(), ["sheet.abc"]);
    // A run that goes on in fewer formats leaves the frames so far, and it is still known whose they are two attempts later.
    run("\"abc\", \"h5\"", &["--overwrite", "--frames", "1001-1002"]);
    std::fs::write(out.join("other.h5"), "of somebody else").unwrap();
    run("\"abc\"", &["--frames", "1001-1003"]);
    run("\"abc\"", &[]);
    assert_eq!(caches(), ["other.h5", "sheet.abc", "sheet.h5"]);
    run("\"abc\"", &["--overwrite"]);
    assert_eq!(caches(), ["other.h5", "sheet.abc"]);
}

#[test]
fn a_lost_cache_is_written_again_from_one_of_another_format() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1008").replace("[\"abc\"]", "[\"abc\", \"h5\"]"));
    let run = ["run", "scene.toml", "-q", "--checkpoint-every", "2f"];
    let out = folder.path().join("out/sheet");
    for lost in ["sheet.abc", "sheet.h5"] {
        assert_eq!(
            drapery(folder.path(), &[&run[..], &["--overwrite", "--frames", "1001-1006"]].concat()).code,
            Some(0)
        );
        std::fs::remove_file(out.join(lost)).unwrap();
        let again = drapery(folder.path(), &run[..2]);
        assert_eq!(again.code, Some(0), "{lost}: {}", again.stderr);
        assert!(again.stderr.contains(&format!("{lost} is missing")), "{}", again.stderr);
        let found = drapery(folder.path(), &["verify", "--record", "out/sheet"]);
        assert_eq!(found.code, Some(0), "{lost}: {}", found.stderr);
        assert!(found.stdout.contains(&format!("{lost}: 8 of 8 frames match the record")), "{}", found.stdout);
    }
}

#[test]
fn a_lost_cache_without_another_format_leads_to_commands_that_work() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1008"));
    let run = ["run", "scene.toml", "-q", "--checkpoint-every", "2f"];
    assert_eq!(drapery(folder.path(), &[&run[..], &["--frames", "1001-1006"]].concat()).code, Some(0));
    std::fs::remove_file(folder.path().join("out/sheet/sheet.abc")).unwrap();
    let again = drapery(folder.path(), &run);
    assert_eq!(again.code, Some(65), "{}", again.stderr);
    assert!(again.stderr.contains("put the file back") && !again.stderr.contains("--resume"), "{}", again.stderr);
    assert_eq!(drapery(folder.path(), &[&run[..], &["--overwrite"]].concat()).code, Some(0));
}

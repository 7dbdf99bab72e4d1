//! Runs whose disk is full: they say so.

use std::path::Path;
use std::process::Command;

use crate::{Outcome, SHEET, drapery, folder_with};

/// Runs a script with a disk of this number of bytes in the folder `disk`; `None` where that is not allowed.
fn with_disk(folder: &Path, bytes: u64, script: &str) -> Option<Outcome> {
    let probe = Command::new("unshare").args(["-r", "-m", "mount", "-t", "tmpfs", "none", "/tmp"]).output();
    if !probe.is_ok_and(|output| output.status.success()) {
        println!("skipped: no right to mount a small disk");
        return None;
    }
    let mount = format!("mkdir -p disk && mount -t tmpfs -o size={bytes} none disk || exit 99\n{script}");
    let mut command = Command::new("unshare");
    command.args(["-r", "-m", "bash", "-c", &mount, env!("CARGO_BIN_EXE_drapery")]).current_dir(folder);
    Some(command.output().expect("a shell").into())
}

#[test]
fn a_run_whose_disk_is_full_has_failed_with_the_reason_and_goes_on_when_there_is_room() {
    let scene = SHEET.replace("1001-1004", "1001-1060").replace("resolution = 6", "resolution = 20");
    let formats = if cfg!(feature = "usd") { &["abc", "h5", "usd"][..] } else { &["abc", "h5"] };
    for format in formats {
        let folder = folder_with(&scene.replace("[\"abc\"]", &format!("[\"{format}\"]")));
        let run = "\"$0\" run scene.toml --out disk/out -q --threads 1 --checkpoint-every 1000f";
        let script = format!(
            "{run}; echo \"exit code $?\"; \"$0\" status disk/out; tail -n 1 disk/out/run.jsonl\n\
             mount -o remount,size=50m disk && {run}; echo \"then $?\"; \"$0\" status disk/out"
        );
        let Some(said) = with_disk(folder.path(), 700_000, &script) else { return };
        for words in [
            "exit code 74",
            "sheet: failed",
            "No space left on device",
            "\"state\":\"failed\"}",
            "then 0",
            "sheet: done",
        ] {
            assert!(said.stdout.contains(words), "{format}: {words}: {}{}", said.stdout, said.stderr);
        }
        // Whichever of the files that grow finds the disk full.
        let is_named = |file: &str| said.stdout.contains(&format!("  error        disk/out/{file}"));
        assert!(["sheet", "manifest.json"].into_iter().any(is_named), "{format}: {}", said.stdout);
        assert!(!said.stdout.contains("killed"), "{format}: {}", said.stdout);
    }
}

#[test]
fn a_run_without_room_for_its_first_files_does_not_count_as_killed() {
    let folder = folder_with(&SHEET.replace("resolution = 6", "resolution = 40").replace("[\"abc\"]", "[\"h5\"]"));
    for bytes in [60_000, 100_000, 120_000, 160_000, 250_000] {
        let script =
            "\"$0\" run scene.toml --out disk/out -q --threads 1; echo \"exit code $?\"; \"$0\" status disk/out";
        let Some(said) = with_disk(folder.path(), bytes, script) else { return };
        let is_failed = said.stdout.contains("sheet: failed") || !said.stdout.contains("sheet: ");
        assert!(said.stdout.contains("exit code 7") && is_failed, "{bytes}: {}{}", said.stdout, said.stderr);
    }
}

#[test]
fn a_conversion_without_room_leaves_nothing_behind_and_says_it_in_plain_words() {
    let folder = folder_with(&SHEET.replace("resolution = 6", "resolution = 40"));
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "-q"]).code, Some(0));
    for (bytes, name) in [(20_000, "c.h5"), (60_000, "c.h5"), (8_000, "c.abc"), (40_000, "c.abc")] {
        let script = format!("\"$0\" convert out/sheet/sheet.abc disk/{name}; echo \"exit code $?\"; ls -A disk");
        let Some(said) = with_disk(folder.path(), bytes, &script) else { return };
        assert!(said.stdout.trim_end().ends_with("exit code 74"), "{bytes}: {}{}", said.stdout, said.stderr);
        assert!(said.stderr.contains("No space left on device"), "{bytes}: {}", said.stderr);
        assert!(!said.stderr.contains("H5"), "{bytes}: {}", said.stderr);
    }
}

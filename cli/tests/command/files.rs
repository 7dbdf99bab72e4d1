//! Command line, names and files as strangers have them: not UTF-8, no files at all, devices that are full.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::Stdio;

use crate::bad_input::{refused, with_files};
use crate::{Outcome, SHEET, command, drapery, folder_with};
use drapery_selftest::files::{BODY, SKIRT};

/// `drapery` in a folder with an argument more, which need not be UTF-8.
fn with_bytes(folder: &Path, arguments: &[&str], last: &[u8]) -> Outcome {
    command(folder, arguments).arg(OsStr::from_bytes(last)).output().expect("the command can be started").into()
}

#[test]
fn a_scene_whose_name_is_not_utf8_runs_and_the_command_that_continues_it_is_one_for_a_shell() {
    let folder = folder_with(SHEET);
    std::fs::copy(folder.path().join("scene.toml"), folder.path().join(OsStr::from_bytes(b"caf\xe9.toml"))).unwrap();
    let run = with_bytes(folder.path(), &["run", "-q", "--out", "my out"], b"caf\xe9.toml");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let manifest = std::fs::read_to_string(folder.path().join("my out/manifest.json")).unwrap();
    assert!(manifest.contains(r"drapery run -q --out 'my out' $'caf\\351.toml'"), "{manifest}");
}

#[test]
fn other_arguments_that_are_not_utf8_work_or_are_refused_by_name() {
    let folder = folder_with(SHEET);
    let out = with_bytes(folder.path(), &["run", "scene.toml", "--out"], b"o\xff");
    assert_eq!(out.code, Some(73), "{}", out.stderr);
    assert!(out.stderr.contains(r"o\xFF") && out.stderr.contains("--out"), "{}", out.stderr);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
    let setting = with_bytes(folder.path(), &["run", "scene.toml", "--set"], b"resolution=\xff");
    assert_eq!(setting.code, Some(2), "{}", setting.stderr);
    assert!(setting.stderr.contains(r"$'resolution=\377'"), "{}", setting.stderr);
    let plan = with_bytes(folder.path(), &["plan", "scene.toml", "--out"], b"o\xff");
    assert!(plan.stderr.contains("WARN a run would be refused") && plan.stderr.contains("--out"), "{}", plan.stderr);
    for arguments in [&["plan", "scene.toml", "--out"][..], &["check", "scene.toml", "--materials"][..]] {
        assert_eq!(with_bytes(folder.path(), arguments, b"o\xff").code, Some(0), "{arguments:?}");
    }
    for arguments in [&["status"][..], &["report"], &["info"], &["check"], &["check", "scene.toml", "--preset"]] {
        assert_eq!(with_bytes(folder.path(), arguments, b"o\xff").code, Some(66), "{arguments:?}");
    }
}

#[test]
fn names_that_are_no_names_of_files_are_refused() {
    let [long, longest, control] = ["n".repeat(256), "n".repeat(236), "a\\nb".to_owned()];
    for name in ["", ".", "..", "../../../evil", "/evil", r"..\\evil", &control, &long, "CON", "a:b", " ", "\u{202e}"] {
        let scene = SHEET.replacen("name = \"sheet\"", &format!("name = \"{name}\""), 1);
        refused(folder_with(&scene).path(), 78, &["scene.toml:5:", "cannot be the name of a shot"]);
    }
    for name in ["..", "a/b", &control, &longest, "CON", "a:b", " ", "\u{202e}"] {
        let scene = SHEET.replace("name = \"sheet\"\npanel", &format!("name = \"{name}\"\npanel"));
        refused(folder_with(&scene).path(), 78, &["garment", "for files and objects"]);
    }
    // One letter less, and all of its files can be written, those of a run that goes on in another form, too.
    let garment = &longest[1..];
    let scene = SHEET.replace("name = \"sheet\"\npanel", &format!("name = \"{garment}\"\npanel"));
    let folder = folder_with(&scene);
    let arguments = ["run", "scene.toml", "--out", "out", "-q"];
    assert_eq!(drapery(folder.path(), &[&arguments[..], &["--frames", "1001-1002"]].concat()).code, Some(0));
    std::fs::write(folder.path().join("scene.toml"), scene.replace("[\"abc\"]", "[\"abc\", \"h5\"]")).unwrap();
    let run = drapery(folder.path(), &[&arguments[..], &["--resume-with-changes"]].concat());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
}

#[test]
fn garments_whose_caches_are_one_file_on_some_disks_are_a_warning() {
    let second = "[[garment]]\nname = \"Sheet\"\npanel = { resolution = 2, center = [0, 3, 0] }\ndensity = 0.1\n";
    let folder = folder_with(&SHEET.replace("[output]", &format!("{second}[output]")));
    let check = drapery(folder.path(), &["check", "scene.toml"]);
    assert!(check.stderr.contains("garments \"sheet\" and \"Sheet\""), "{}", check.stderr);
}

#[test]
fn a_garment_without_points_is_refused_before_anything_is_written() {
    for skirt in ["", "# nothing but words\nvt 0 0\n"] {
        for format in ["[\"abc\"]", "[\"h5\"]"] {
            let folder = with_files(BODY, skirt);
            let scene = std::fs::read_to_string(folder.path().join("scene.toml")).unwrap();
            std::fs::write(folder.path().join("scene.toml"), scene.replace("[\"abc\"]", format)).unwrap();
            refused(folder.path(), 65, &["garment \"skirt\"", "no points"]);
        }
    }
}

#[test]
fn caches_of_another_run_that_a_shot_reads_do_not_give_way_to_its_own() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--out", "shared", "-q"]).code, Some(0));
    let cache = folder.path().join("shared/sheet.abc");
    let before = std::fs::read(&cache).unwrap();
    let scene = SHEET.replace(
        "name = \"sheet\"\npanel = { resolution = \"$resolution\" }",
        "name = \"copy\"\nrest = \"shared/sheet.abc\"",
    );
    std::fs::write(folder.path().join("copy.toml"), scene.replace("[gravity]", "[units]\nlength = \"m\"\n[gravity]"))
        .unwrap();
    let run = drapery(folder.path(), &["run", "copy.toml", "--out", "shared", "--overwrite"]);
    assert_eq!(run.code, Some(73), "{}", run.stderr);
    assert!(run.stderr.contains("shared/sheet.abc: this file is an input of the shot"), "{}", run.stderr);
    assert!(std::fs::read(&cache).unwrap() == before);
}

#[test]
fn what_is_no_file_is_refused_wherever_a_file_is_read() {
    let folder = with_files(BODY, SKIRT);
    let at = |name: &str| folder.path().join(name);
    for name in ["socket.abc", "socket.h5", "socket.toml", "socket.obj", "socket.json"] {
        // The system refuses to open it, with the words for another fault.
        drop(UnixListener::bind(at(name)).unwrap());
    }
    let text = std::fs::read_to_string(at("scene.toml")).unwrap();
    let scene = |name: &str, old: &str, new: &str| std::fs::write(at(name), text.replace(old, new)).unwrap();
    scene("mesh.toml", "body.obj", "socket.abc");
    scene("obj.toml", "body.obj", "socket.obj");
    scene("wind.toml", "[output]", "[wind]\nfile = \"socket.h5\"\n[output]");
    scene("map.toml", "density =", "maps = { thickness = \"file:socket.json\" }\ndensity =");
    scene("pin.toml", "[output]", "[[garment.pin]]\nfile = \"socket.json\"\nto = \"body:hero\"\n[output]");
    for arguments in [
        &["check", "socket.toml"][..],
        &["check", "mesh.toml"],
        &["check", "obj.toml"],
        &["check", "wind.toml"],
        &["check", "map.toml"],
        &["check", "pin.toml"],
        &["check", "scene.toml", "--preset", "socket.toml"],
        &["check", "scene.toml", "--config", "socket.toml"],
        &["run", "--replay", "socket.json"],
        &["study", "--from", "socket.json"],
        &["info", "socket.abc"],
        &["info", "socket.obj"],
        &["info", "socket.h5"],
        &["verify", "socket.abc"],
        &["diff", "socket.abc", "socket.h5"],
    ] {
        let outcome = drapery(folder.path(), arguments);
        assert_eq!(outcome.code, Some(65), "{arguments:?}\n{}", outcome.stderr);
        assert!(outcome.stderr.contains("this is a socket, not a file"), "{arguments:?}\n{}", outcome.stderr);
    }
}

#[test]
fn texts_of_another_encoding_are_refused_with_file_and_line() {
    let folder = folder_with(SHEET);
    let latin = |name: &str, text: &str| {
        let bytes = [text.as_bytes(), b"\n# caf\xe9\n"].concat();
        std::fs::write(folder.path().join(name), bytes).unwrap();
    };
    latin("latin.toml", SHEET);
    let material = SHEET.replace("density = \"0.15 kg/m²\"", "material = \"velvet\"");
    std::fs::write(folder.path().join("material.toml"), material).unwrap();
    latin("site.toml", "");
    latin("preset.toml", "drapery_preset = 1");
    latin("velvet.toml", "summary = \"velvet\"");
    std::fs::create_dir(folder.path().join("run")).unwrap();
    latin("run/manifest.json", "{}");
    for (arguments, place) in [
        (&["check", "latin.toml"][..], "latin.toml: line 22"),
        (&["check", "scene.toml", "--config", "site.toml"], "site.toml: line 2"),
        (&["check", "scene.toml", "--preset", "preset.toml"], "preset.toml: line 2"),
        (&["check", "material.toml", "--materials", "."], "velvet.toml: line 2"),
        (&["status", "run"], "manifest.json: line 2"),
    ] {
        let outcome = drapery(folder.path(), arguments);
        assert_eq!(outcome.code, Some(65), "{arguments:?}\n{}", outcome.stderr);
        assert!(outcome.stderr.contains(place) && outcome.stderr.contains("0xE9"), "{arguments:?}\n{}", outcome.stderr);
    }
}

#[test]
fn names_with_ends_of_lines_stay_inside_the_comments_of_the_resolved_scene() {
    let scene = SHEET.replace("resolution = 6", "resolution = 6\n\"a\\nb = 3\" = 1");
    let folder = folder_with(&scene.replace("density = \"0.15 kg/m²\"", "material = \"cloth\""));
    let materials = folder.path().join("ma\nx = 1");
    std::fs::create_dir(&materials).unwrap();
    let material =
        "density = 0.1\nthickness = 0.001\nstretch_stiffness = 100\nbending_rigidity = 1e-6\ndamping_ratio = 1\n";
    std::fs::write(materials.join("cloth.toml"), format!("{material}friction = 0.3\n")).unwrap();
    let run = drapery(folder.path(), &["run", "scene.toml", "--materials", "ma\nx = 1", "--out", "out", "-q"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(drapery(folder.path(), &["check", "out/resolved.toml"]).code, Some(0));
}

#[test]
fn what_a_terminal_would_obey_is_not_printed_and_lines_without_an_end_are_not_shown() {
    let folder = folder_with("drapery = 1\n\u{1b}[2Jx = 1\n");
    std::fs::write(
        folder.path().join("mesh.obj"),
        "o \u{1b}[31mred\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n\
        g \u{9b}5m\nf 1 2 3\n",
    )
    .unwrap();
    std::fs::write(folder.path().join("long.toml"), "a".repeat(1 << 20)).unwrap();
    for arguments in [["check", "scene.toml"], ["info", "mesh.obj"], ["check", "long.toml"]] {
        let Outcome { stdout, stderr, .. } = drapery(folder.path(), &arguments);
        let printed = stdout + &stderr;
        assert!(!printed.contains(['\u{1b}', '\u{9b}']), "{arguments:?}\n{printed}");
        assert!(printed.len() < 2000, "{arguments:?}: {} bytes", printed.len());
    }
}

#[test]
fn a_log_and_a_preset_replace_their_like_and_nothing_else() {
    let folder = folder_with(SHEET);
    for arguments in [
        &["check", "scene.toml", "--log-json", "scene.toml"][..],
        &["study", "scene.toml", "--write-preset", "scene.toml"],
    ] {
        let outcome = drapery(folder.path(), arguments);
        assert_eq!(outcome.code, Some(73), "{arguments:?}\n{}", outcome.stderr);
        assert!(outcome.stderr.contains("scene.toml: this file exists and is not a"), "{}", outcome.stderr);
        assert_eq!(std::fs::read_to_string(folder.path().join("scene.toml")).unwrap(), SHEET);
    }
    for _ in 0..2 {
        let run = drapery(folder.path(), &["run", "scene.toml", "-q", "--log-json", "log.jsonl"]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert!(std::fs::metadata(folder.path().join("log.jsonl")).unwrap().len() > 0);
    }
}

#[test]
fn a_log_goes_to_a_pipe_only_where_a_program_reads_it() {
    let folder = folder_with(SHEET);
    let pipe = folder.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let arguments = ["check", "scene.toml", "--log-json", "pipe"];
    let outcome = drapery(folder.path(), &arguments);
    assert_eq!(outcome.code, Some(73), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("pipe: no program reads from this pipe"), "{}", outcome.stderr);
    let reader = std::process::Command::new("cat").arg(&pipe).stdout(std::process::Stdio::null()).spawn().unwrap();
    // `cat` waits in its opening of the pipe until somebody writes.
    let codes = (0..200).map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(50));
        drapery(folder.path(), &arguments).code
    });
    assert!(codes.into_iter().any(|code| code == Some(0)));
    drop(reader.wait_with_output());
}

#[test]
fn a_run_does_not_wait_for_a_pipe_in_the_place_of_one_of_its_files() {
    let folder = folder_with(&SHEET.replace("[\"abc\"]", "[\"abc\", \"h5\"]"));
    let arguments = ["run", "scene.toml", "--out", "out", "-q"];
    assert_eq!(drapery(folder.path(), &[&arguments[..], &["--frames", "1001-1002"]].concat()).code, Some(0));
    for name in ["manifest.json", "run.jsonl", "sheet.abc", "sheet.h5"] {
        let file = folder.path().join("out").join(name);
        let kept = std::fs::read(&file).unwrap();
        std::fs::remove_file(&file).unwrap();
        drop(UnixListener::bind(&file).unwrap());
        let run = drapery(folder.path(), &arguments);
        assert_eq!(run.code, Some(65), "{name}\n{}", run.stderr);
        assert!(run.stderr.contains(name) && run.stderr.contains("this is a socket"), "{name}\n{}", run.stderr);
        std::fs::remove_file(&file).unwrap();
        std::fs::write(&file, kept).unwrap();
    }
    assert_eq!(drapery(folder.path(), &arguments).code, Some(0));
}

/// Runs a command while nothing can be written on standard output.
fn on_full_device(folder: &Path, arguments: &[&str]) -> Outcome {
    let full = File::options().write(true).open("/dev/full").unwrap();
    command(folder, arguments).stdout(full).output().expect("the command can be started").into()
}

#[test]
fn a_command_that_cannot_print_does_not_end_as_if_it_had() {
    if !Path::new("/dev/full").exists() {
        println!("skipped: no /dev/full");
        return;
    }
    let folder = folder_with(SHEET);
    let run = on_full_device(folder.path(), &["run", "scene.toml", "--out", "out"]);
    assert_eq!(run.code, Some(74), "{}", run.stderr);
    assert_eq!(run.stderr.matches("the command continues").count(), 1, "{}", run.stderr);
    // The simulation is not lost.
    assert_eq!(drapery(folder.path(), &["verify", "out/sheet.abc"]).code, Some(0));
    let cache = "out/sheet.abc";
    for arguments in [
        &["--help"][..],
        &["--version"],
        &["run", "scene.toml", "--out", "out", "--progress", "json"],
        &["check", "scene.toml"],
        &["plan", "scene.toml"],
        &["plan", "scene.toml", "--json"],
        &["info", cache],
        &["verify", cache],
        &["status", "out"],
        &["stop", "out"],
        &["diff", cache, cache],
        &["report", "out"],
        &["schema"],
        &["materials"],
    ] {
        let outcome = on_full_device(folder.path(), arguments);
        assert_eq!(outcome.code, Some(74), "{arguments:?}\n{}", outcome.stderr);
        assert_eq!(outcome.stderr.matches("standard output could not be written").count(), 1, "{}", outcome.stderr);
    }
    // A run that stopped has to go on, whatever was said of it; what is wrong is still wrong.
    let stopped = on_full_device(folder.path(), &["run", "scene.toml", "--out", "b", "--max-wall", "0.0001s"]);
    assert_eq!(stopped.code, Some(75), "{}", stopped.stderr);
    assert_eq!(on_full_device(folder.path(), &["info", "missing.abc"]).code, Some(66));
}

#[test]
fn a_reader_that_has_gone_away_is_no_reason_to_fail() {
    let folder = folder_with(SHEET);
    for arguments in [&["run", "scene.toml"][..], &["schema"], &["--help"]] {
        let mut child =
            command(folder.path(), arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(0), "{arguments:?}\n{said}");
        assert!(said.is_empty(), "{arguments:?}\n{said}");
    }
}

#[test]
fn a_log_on_a_full_disk_is_missed_when_all_is_done() {
    let folder = folder_with(SHEET);
    let run = drapery(folder.path(), &["run", "scene.toml", "-q", "--log-json", "/dev/full"]);
    assert_eq!(run.code, Some(74), "{}", run.stderr);
    assert!(run.stderr.contains("/dev/full could not be written"), "{}", run.stderr);
    assert!(folder.path().join("out/sheet/sheet.abc").is_file());
}

/// A run of 900 frames into `out` that does something as soon as its cache is there, and how the run ends.
fn disturbed(folder: &Path, disturb: impl FnOnce()) -> Outcome {
    let run = command(folder, &["run", "scene.toml", "--out", "out", "-q"]).stderr(Stdio::piped()).spawn().unwrap();
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
    while !folder.join("out/sheet.abc").exists() && std::time::Instant::now() < deadline {
        std::thread::yield_now();
    }
    disturb();
    run.wait_with_output().unwrap().into()
}

#[test]
fn a_folder_that_is_renamed_while_a_run_writes_into_it_is_named_and_the_run_goes_on_there() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1900"));
    let at = |name: &str| folder.path().join(name);
    let ended = disturbed(folder.path(), || std::fs::rename(at("out"), at("moved")).unwrap());
    assert_eq!(ended.code, Some(74), "{}", ended.stderr);
    let words = "out: another program has removed or renamed this folder";
    assert!(ended.stderr.contains(words) && ended.stderr.contains("--out"), "{}", ended.stderr);
    assert!(!ended.stderr.contains("taken") && !at("out").exists(), "{}", ended.stderr);
    let again = drapery(folder.path(), &["run", "scene.toml", "--out", "moved", "-q"]);
    assert_eq!(again.code, Some(0), "{}", again.stderr);
}

#[test]
fn a_cache_that_is_removed_while_a_run_writes_it_ends_the_run_with_its_name() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-1900"));
    let cache = folder.path().join("out/sheet.abc");
    let ended = disturbed(folder.path(), || std::fs::remove_file(&cache).unwrap());
    assert_eq!(ended.code, Some(74), "{}", ended.stderr);
    let words = "out/sheet.abc: another program has removed this file";
    assert!(ended.stderr.contains(words) && ended.stderr.contains("--overwrite"), "{}", ended.stderr);
    let manifest = std::fs::read_to_string(folder.path().join("out/manifest.json")).unwrap();
    assert!(manifest.contains("\"state\": \"failed\"") && manifest.contains("has removed this file"), "{manifest}");
}

/// A command under limits that a shell sets, as in `ulimit -n 8`.
fn limited(folder: &Path, limit: &str, arguments: &[&str]) -> Outcome {
    let program = env!("CARGO_BIN_EXE_drapery");
    let mut shell = std::process::Command::new("bash");
    shell.current_dir(folder).args(["-c", &format!("{limit}; exec \"$@\""), "bash", program]).args(arguments);
    for name in drapery_selftest::bench::VARIABLES {
        shell.env_remove(name);
    }
    shell.stdin(Stdio::null()).output().expect("a shell").into()
}

#[test]
fn limits_of_the_system_are_errors_that_another_attempt_may_not_have() {
    let folder = folder_with(SHEET);
    let run = ["run", "scene.toml", "--out", "out", "-q", "--threads", "1"];
    // Each number is the first that some other opening does not get.
    for files in 3..14 {
        let refused = limited(folder.path(), &format!("ulimit -n {files}"), &run);
        // Below the first few, the system does not even load the program.
        if ![Some(0), Some(127)].contains(&refused.code) {
            assert_eq!(refused.code, Some(74), "{files}: {}", refused.stderr);
            let words = ["Too many open files", "ulimit -n"];
            assert!(words.iter().all(|word| refused.stderr.contains(word)), "{files}: {}", refused.stderr);
        }
    }
    let grown = limited(folder.path(), "ulimit -f 4", &[&run[..], &["--overwrite"]].concat());
    assert_eq!(grown.code, Some(74), "{}", grown.stderr);
    // A stack that is larger than any memory is that of a thread that does not start.
    let threads =
        limited(folder.path(), "export RUST_MIN_STACK=99999999999999", &[&run[..], &["--overwrite"]].concat());
    assert_eq!(threads.code, Some(71), "{}", threads.stderr);
    assert!(threads.stderr.contains("ulimit -u") && threads.stderr.contains("--threads"), "{}", threads.stderr);
    let free = drapery(folder.path(), &[&run[..], &["--overwrite"]].concat());
    assert_eq!(free.code, Some(0), "{}", free.stderr);
}

#[test]
fn names_of_any_length_are_shown_without_their_middle() {
    let long = "z".repeat(300_000);
    for (old, new) in [
        ("friction = 0.4", format!("{long} = 0.4")),
        ("density = \"0.15 kg/m²\"", format!("material = \"{long}\"")),
        ("name = \"ball\"", format!("name = \"{long}\"")),
        ("1001-1004", long.clone()),
    ] {
        let check = drapery(folder_with(&SHEET.replace(old, &new)).path(), &["check", "scene.toml"]);
        assert_eq!(check.code, Some(78), "{old}");
        assert!(check.stderr.contains("zzz") && check.stderr.len() < 20_000, "{old}: {} bytes", check.stderr.len());
        assert!(check.stderr.contains("bytes …]"), "{old}: {}", check.stderr);
    }
}

#[test]
fn a_new_cache_without_an_ending_is_told_as_that() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q"]).code, Some(0));
    let convert = drapery(folder.path(), &["convert", "out/sheet.abc", "copy"]);
    assert_eq!(convert.code, Some(65), "{}", convert.stderr);
    assert!(
        convert.stderr.contains("copy: the file name needs an extension") && convert.stderr.contains(".abc"),
        "{}",
        convert.stderr
    );
}

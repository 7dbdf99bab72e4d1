//! Environment and site file: what wins, what is refused, and where files are found.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use crate::{SHEET, command, drapery, folder_with};

/// A garment from a file that lies where only a path map finds it, of a material that only a folder holds.
const ELSEWHERE: &str = r#"drapery = 1
[shot]
name = "patch"
frames = "1-2"
[units]
length = "m"
up = "Y"
[gravity]
[[garment]]
name = "patch"
rest = "X:/lib/patch.obj"
material = "velvet"
[output]
format = ["abc"]
"#;

const PATCH: &str = "v 0 0 0\nv 0.5 0 0\nv 0 0 0.5\nv 0.5 0 0.5\nf 1 3 2\nf 2 3 4\n";

const VELVET: &str = "summary = \"velvet for curtains\"\ndensity = \"420 g/m²\"\nthickness = \"1.2 mm\"\n\
                      stretch_stiffness = \"300 N/m\"\nbending_rigidity = \"40 µN·m\"\ndamping_ratio = 2\n\
                      friction = 0.45\n";

fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("it is in a folder")).expect("it can be written to");
    std::fs::write(path, text).expect("it can be written to");
}

/// Site file that maps `X:/` to a folder beside it.
fn site(folder: &Path, name: &str, to: &str) {
    let text = format!("materials = [\"cloth\"]\n[paths]\n\"X:/\" = \"{}\"\n", folder.join(to).display());
    write(folder, name, &text);
}

/// A scene with two copies of its mesh, in two places with a site file each.
fn elsewhere() -> tempfile::TempDir {
    let folder = folder_with(ELSEWHERE);
    for place in ["a", "b"] {
        write(folder.path(), &format!("{place}/lib/patch.obj"), PATCH);
        site(folder.path(), &format!("{place}.toml"), place);
    }
    write(folder.path(), "cloth/velvet.toml", VELVET);
    folder
}

fn plan(folder: &Path, arguments: &[&str], variables: &[(&str, &str)]) -> Value {
    let arguments = [&["plan", "scene.toml", "--json"], arguments].concat();
    let output = command(folder, &arguments).envs(variables.iter().copied()).output().expect("it can be started");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn the_plan_says_where_everything_comes_from_and_the_flag_wins() {
    let folder = folder_with(SHEET);
    write(
        folder.path(),
        "site.toml",
        "threads = 3\nprogress = \"alf\"\nresumable_exit_code = 99\ncheckpoint_every = \"10f\"\nkeep = 7\n\
         max_wall = \"2h\"\non_term = \"signal\"\n",
    );
    let from = |plan: &Value, key: &str| (plan["run"][key]["value"].clone(), plan["run"][key]["from"].clone());
    let bare = plan(folder.path(), &[], &[]);
    for (key, value) in [("progress", "auto"), ("on_term", "exit"), ("checkpoint_every", "auto"), ("out", "out/sheet")]
    {
        assert_eq!(from(&bare, key), (value.into(), "default".into()), "{key}");
    }
    assert_eq!(from(&bare, "config"), (Value::Null, "default".into()));
    assert_eq!(from(&bare, "resumable_exit_code"), (75.into(), "default".into()));

    let site = plan(folder.path(), &[], &[("DRAPERY_CONFIG", "site.toml"), ("DRAPERY_STOP_AT", "9999999999")]);
    assert_eq!(from(&site, "config"), ("site.toml".into(), "DRAPERY_CONFIG".into()));
    for (key, value) in [
        ("threads", Value::from(3)),
        ("progress", "alf".into()),
        ("resumable_exit_code", 99.into()),
        ("on_term", "signal".into()),
        ("checkpoint_every", "10f".into()),
        ("keep", 7.into()),
        ("max_wall", 7200.0.into()),
    ] {
        assert_eq!(from(&site, key), (value, "site file".into()), "{key}");
    }
    assert_eq!(from(&site, "stop_at"), (9_999_999_999.0.into(), "DRAPERY_STOP_AT".into()));

    let flags = ["--config", "site.toml", "--keep", "2", "--out", "elsewhere", "--max-wall", "1h"];
    let variables = [("DRAPERY_CONFIG", "missing.toml"), ("DRAPERY_THREADS", "2"), ("DRAPERY_PROGRESS", "tr")];
    let mixed = plan(folder.path(), &flags, &variables);
    for (key, value, source) in [
        ("config", Value::from("site.toml"), "--config"),
        ("threads", 2.into(), "DRAPERY_THREADS"),
        ("progress", "tr".into(), "DRAPERY_PROGRESS"),
        ("keep", 2.into(), "--keep"),
        ("out", "elsewhere".into(), "--out"),
        ("max_wall", 3600.0.into(), "--max-wall"),
        ("resumable_exit_code", 99.into(), "site file"),
    ] {
        assert_eq!(from(&mixed, key), (value, source.into()), "{key}");
    }
    let text = drapery(folder.path(), &["plan", "scene.toml", "--config", "site.toml"]).stdout;
    assert!(text.contains("\nsource of each value\n"), "{text}");
    let line = text.lines().find(|line| line.trim_start().starts_with("keep")).expect("a line for each");
    assert_eq!(line.split_whitespace().collect::<Vec<_>>(), ["keep", "7", "site", "file"]);
}

#[test]
fn a_run_obeys_the_site_file() {
    let folder = folder_with(SHEET);
    write(folder.path(), "site.toml", "progress = \"alf\"\nresumable_exit_code = 99\nkeep = 1\n");
    let run = command(folder.path(), &["run", "scene.toml", "--checkpoint-every", "1f", "--max-wall", "1h"])
        .env("DRAPERY_CONFIG", "site.toml")
        .output()
        .expect("it can be started");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(String::from_utf8_lossy(&run.stdout).contains("ALF_PROGRESS 100%"));
    let checkpoints = std::fs::read_dir(folder.path().join("out/sheet/checkpoints")).expect("there are some");
    let kept = checkpoints.flatten().filter(|entry| entry.path().extension().is_some_and(|e| e == "h5")).count();
    assert_eq!(kept, 1);
    let log = std::fs::read_to_string(folder.path().join("out/sheet/logs/001.log")).expect("a log");
    for words in ["a stop needs about 10 s (estimated), 35", "s (measured), 35"] {
        assert_eq!(log.matches(words).count(), 1, "`{words}` in\n{log}");
    }
    // Already over: the run stops at the first frame, with the code of the site.
    let late = command(folder.path(), &["run", "scene.toml", "--config", "site.toml", "--out", "late"])
        .env("DRAPERY_STOP_AT", "1000000001")
        .output()
        .expect("it can be started");
    assert_eq!(late.status.code(), Some(99), "{}", String::from_utf8_lossy(&late.stderr));
    let log = std::fs::read_to_string(folder.path().join("late/logs/001.log")).expect("a log");
    assert!(log.contains("needs about") && log.contains("0 s are left"), "{log}");
}

#[test]
fn a_site_file_that_is_not_understood_ends_commands_that_need_it_and_no_others() {
    let folder = folder_with(SHEET);
    write(folder.path(), "site.toml", "treads = 3\n");
    write(folder.path(), "word.toml", "progress = \"alff\"\n");
    for (arguments, code, words) in [
        (["run", "scene.toml", "--config", "site.toml"], 78, "site.toml:1:1: unknown key `treads`"),
        (["plan", "scene.toml", "--config", "site.toml"], 78, "did you mean `threads`?"),
        (["check", "scene.toml", "--config", "missing.toml"], 66, "missing.toml"),
        (["run", "scene.toml", "--config", "word.toml"], 78, "word.toml: `progress`: unknown value `alff`"),
    ] {
        let outcome = drapery(folder.path(), &arguments);
        assert_eq!(outcome.code, Some(code), "{arguments:?} {}", outcome.stderr);
        assert!(outcome.stderr.contains(words), "{}", outcome.stderr);
    }
    assert!(!folder.path().join("out").exists());
    assert_eq!(drapery(folder.path(), &["schema", "--config", "site.toml"]).code, Some(0));
    let run = command(folder.path(), &["run", "scene.toml"]).env("DRAPERY_PROGRESS", "alff").output();
    let run = run.expect("it can be started");
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("DRAPERY_PROGRESS=alff"));
}

#[test]
fn a_run_goes_on_where_other_maps_find_the_same_files_and_notices_other_ones() {
    let folder = elsewhere();
    let run = |config: &str, arguments: &[&str]| {
        drapery(folder.path(), &[&["run", "scene.toml", "-q", "--out", "out", "--config", config], arguments].concat())
    };
    let missing = drapery(folder.path(), &["run", "scene.toml", "--materials", "cloth"]);
    assert_eq!(missing.code, Some(66), "{}", missing.stderr);
    let first = run("a.toml", &["--frames", "1-1"]);
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    // The first place is gone, as it would be on another machine.
    std::fs::remove_dir_all(folder.path().join("a")).expect("it can be removed");
    let second = drapery(folder.path(), &["run", "scene.toml", "--out", "out", "--config", "b.toml", "-v"]);
    assert_eq!(second.code, Some(0), "{}", second.stderr);
    assert!(second.stdout.contains("resuming after frame 1"), "{}", second.stdout);
    assert!(second.stderr.contains("patch.obj\" (the same content)"), "{}", second.stderr);
    // All at once gives the same bytes.
    let once = drapery(folder.path(), &["run", "scene.toml", "-q", "--out", "once", "--config", "b.toml"]);
    assert_eq!(once.code, Some(0), "{}", once.stderr);
    let cache = |out: &str| std::fs::read(folder.path().join(out).join("patch.abc")).expect("a cache");
    assert!(cache("out") == cache("once"));
    // Other content in the same place is another shot; so is another material of the same name.
    write(folder.path(), "b/lib/patch.obj", &PATCH.replace("v 0.5 0 0\n", "v 0.6 0 0\n"));
    let other = run("b.toml", &[]);
    assert_eq!(other.code, Some(73), "{}", other.stderr);
    assert!(other.stderr.contains("patch.obj has changed"), "{}", other.stderr);
    write(folder.path(), "b/lib/patch.obj", PATCH);
    write(folder.path(), "cloth/velvet.toml", &VELVET.replace("420", "430"));
    let other = run("b.toml", &[]);
    assert_eq!(other.code, Some(73), "{}", other.stderr);
    assert!(other.stderr.contains("garment[0].density 0.42 -> 0.43"), "{}", other.stderr);
}

#[test]
fn materials_in_files_are_found_listed_and_written_out() {
    let folder = folder_with(&SHEET.replace("density = \"0.15 kg/m²\"", "material = \"velvet\""));
    write(folder.path(), "cloth/velvet.toml", VELVET);
    write(folder.path(), "more/velvet.toml", VELVET);
    write(folder.path(), "more/paper.toml", VELVET);
    let unknown = drapery(folder.path(), &["run", "scene.toml"]);
    assert_eq!(unknown.code, Some(78), "{}", unknown.stderr);
    assert!(unknown.stderr.contains("there is no material `velvet`"), "{}", unknown.stderr);
    let run = command(folder.path(), &["run", "scene.toml", "-q"]).env("DRAPERY_MATERIALS", "cloth:more").output();
    assert!(run.expect("it can be started").status.success());
    // The scene as it was run needs no folder of materials.
    let again = drapery(folder.path(), &["run", "out/sheet/resolved.toml", "-q", "--out", "again"]);
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    let cache = |out: &str| std::fs::read(folder.path().join(out).join("sheet.abc")).expect("a cache");
    assert!(cache("out/sheet") == cache("again"));

    let list = drapery(folder.path(), &["materials", "--materials", "cloth:more"]).stdout;
    for words in [
        "cotton_shirting: woven cotton for shirts",
        "from: preset",
        "velvet: velvet for curtains",
        "density 0.42 kg/m²",
        "from: cloth/velvet.toml\n",
        "from: more/velvet.toml; not used: an earlier folder has a material of this name",
        "from: more/paper.toml; not used: a preset of this name takes precedence",
    ] {
        assert!(list.contains(words), "`{words}` in\n{list}");
    }
}

#[test]
fn a_run_that_sigterm_stops_ends_by_it_only_if_that_is_asked_for() {
    let folder = folder_with(&SHEET.replace("1001-1004", "1001-9000"));
    for (on_term, out) in [("exit", "a"), ("signal", "b")] {
        let arguments = ["run", "scene.toml", "--out", out, "--on-term", on_term, "--progress", "json"];
        let mut run = command(folder.path(), &arguments).stdout(Stdio::null()).spawn().expect("it can be started");
        let manifest = folder.path().join(out).join("manifest.json");
        while !manifest.exists() && run.try_wait().expect("it can be asked").is_none() {
            std::thread::sleep(Duration::from_millis(10));
        }
        let kill = std::process::Command::new("kill").args(["-TERM", &run.id().to_string()]).status();
        assert!(kill.expect("kill is there").success());
        let status = run.wait().expect("it ends");
        let expected = if on_term == "exit" { (Some(75), None) } else { (None, Some(15)) };
        assert_eq!((status.code(), status.signal()), expected, "{on_term}");
        let manifest: Value = serde_json::from_slice(&std::fs::read(manifest).expect("a manifest")).expect("JSON");
        assert_eq!(manifest["state"], "stopped");
        assert!(manifest["last_checkpoint"].is_object() || manifest["checkpoint"].is_object(), "{manifest}");
        assert!(!folder.path().join(out).join("lock.json").exists(), "the folder was given back");
    }
}

#[test]
fn a_broken_material_file_is_named_behind_the_list_of_the_others() {
    let folder = folder_with(SHEET);
    write(folder.path(), "fabrics/a_broken.toml", "density = \n");
    write(folder.path(), "fabrics/b_sound.toml", VELVET);
    write(folder.path(), "fabrics/c_broken.toml", "densty = 1.0\n");
    let list = |more: &[&str]| drapery(folder.path(), &[&["materials", "--materials", "fabrics"], more].concat());
    let all = list(&[]);
    assert!(all.stdout.contains("b_sound") && all.stdout.contains("silk_light"), "{}{}", all.stdout, all.stderr);
    assert!(all.stderr.contains("a_broken.toml") && all.stderr.contains("c_broken.toml"), "{}", all.stderr);
    assert_eq!(all.code, Some(78));
    let one = list(&["b_sound"]);
    assert_eq!((one.code, one.stderr.as_str()), (Some(0), ""));
    assert!(list(&["c_broken"]).stderr.contains("c_broken.toml"));
}

#[test]
fn a_path_map_finds_painted_maps_too() {
    let folder = elsewhere();
    write(folder.path(), "a/lib/thick.txt", "1 1 1 0.5\n");
    write(folder.path(), "a/lib/pins.txt", "1 0 0 0\n");
    let painted = "material = \"velvet\"\n\
                   maps = { thickness = \"file:X:/lib/thick.txt\" }\n[[garment.pin]]\nmap = \"file:X:/lib/pins.txt\"";
    let scene = ELSEWHERE.replace("material = \"velvet\"", painted).replace("[gravity]", "[gravity]\n[self_repulsion]");
    write(folder.path(), "scene.toml", &scene);
    let check = drapery(folder.path(), &["check", "scene.toml", "--config", "a.toml"]);
    assert_eq!(check.code, Some(0), "{}", check.stderr);
}

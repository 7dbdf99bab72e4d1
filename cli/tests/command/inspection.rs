//! `status`, `diff` and `report` on a tiny run: text, exit codes, JSON.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

use serde_json::Value;

use crate::{SHEET, drapery, folder_with};

/// A scene that was run into the folders named.
fn run_into(folders: &[&str]) -> tempfile::TempDir {
    let folder = folder_with(SHEET);
    for out in folders {
        let run = drapery(folder.path(), &["run", "scene.toml", "--out", out, "-q"]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    }
    folder
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

/// A text of a manifest, changed as a run would while it goes on.
fn change_manifest(folder: &Path, changes: &[(&str, Value)]) {
    let path = folder.join("manifest.json");
    let mut manifest = json(&std::fs::read_to_string(&path).unwrap());
    for (key, value) in changes {
        manifest[*key] = value.clone();
    }
    std::fs::write(path, manifest.to_string()).unwrap();
}

/// Moves a vertex in a frame of an Alembic cache: the first place where its position is stored.
fn move_vertex(path: &Path, position: [f32; 3], moved: [f32; 3]) {
    let mut bytes = std::fs::read(path).unwrap();
    let bytes_of = |p: [f32; 3]| p.map(f32::to_le_bytes).concat();
    let at = bytes.windows(12).position(|window| window == bytes_of(position)).expect("the position is stored");
    bytes[at..at + 12].copy_from_slice(&bytes_of(moved));
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn status_tells_how_far_a_run_is_and_how_long_it_will_take() {
    let folder = run_into(&["out"]);
    let done = drapery(folder.path(), &["status", "out"]);
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    for words in ["sheet: done", "4 of 4 (100 %), last complete 1004, range 1001-1004", "degradations none"] {
        assert!(done.stdout.contains(words), "{}", done.stdout);
    }
    assert!(!done.stdout.contains("time left"), "{}", done.stdout);
    // The same run as it was two frames earlier, with half a line at the end of its record.
    let out = folder.path().join("out");
    change_manifest(
        &out,
        &[
            ("state", "stopped".into()),
            ("last_complete_frame", 1002.into()),
            ("command", "drapery run scene.toml".into()),
        ],
    );
    let record = std::fs::read_to_string(out.join("run.jsonl")).unwrap();
    let lines: Vec<&str> = record.lines().take(3).collect();
    std::fs::write(out.join("run.jsonl"), format!("{}\n{{\"record\":\"fra", lines.join("\n"))).unwrap();
    let before: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    let status = json(&drapery(folder.path(), &["status", "out", "--json"]).stdout);
    assert_eq!((status["frames_done"].as_i64(), status["frames_total"].as_i64()), (Some(2), Some(4)));
    let (rate, left) = (status["seconds_per_frame"].as_f64().unwrap(), status["seconds_left"].as_f64().unwrap());
    assert!(rate > 0.0 && (left / rate - 2.0).abs() < 1e-12, "{rate} {left}");
    let text = drapery(folder.path(), &["status", "out"]).stdout;
    assert!(text.contains("time left") && text.contains("continue     drapery run scene.toml"), "{text}");
    let after: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(before, after, "status only reads");
}

#[test]
fn status_of_a_folder_without_a_run_says_what_to_give_instead() {
    let folder = folder_with(SHEET);
    for command in ["status", "report"] {
        let outcome = drapery(folder.path(), &[command, "."]);
        assert_eq!(outcome.code, Some(66), "{}", outcome.stderr);
        assert!(outcome.stderr.contains("no manifest.json") && outcome.stderr.contains("--out"), "{}", outcome.stderr);
    }
}

#[test]
fn equal_runs_are_byte_equal_and_a_planted_difference_is_found_at_its_frame_and_vertex() {
    let folder = run_into(&["a", "b"]);
    let same = drapery(folder.path(), &["diff", "a", "b"]);
    assert_eq!((same.code, same.stdout.contains("byte-equal")), (Some(0), true), "{}", same.stdout);
    // The free corner of the sheet in the third frame.
    let position = drapery_io::cache_frames::CacheFrames::open(&folder.path().join("a/sheet.abc")).unwrap();
    let p = position.positions(0, 2).unwrap()[5];
    let stored = [p.x as f32, p.y as f32, p.z as f32];
    move_vertex(&folder.path().join("b/sheet.abc"), stored, [stored[0], stored[1], stored[2] + 0.25]);
    let found = drapery(folder.path(), &["diff", "a/sheet.abc", "b/sheet.abc"]);
    assert_eq!(found.code, Some(1), "{}", found.stdout);
    assert!(
        found.stdout.contains("largest difference: vertex 5 of /sheet/sheetShape in frame 1003, 2.500e-1 m"),
        "{}",
        found.stdout
    );
    assert!(found.stdout.contains("1 of 4 frames differ, first 1003"), "{}", found.stdout);
    let folders = json(&drapery(folder.path(), &["diff", "a", "b", "--json"]).stdout);
    assert_eq!(folders["verdict"], "differs");
    let frames = folders["parts"][0]["frames"].as_array().unwrap();
    assert_eq!((frames.len(), frames[2]["vertex"].as_i64(), frames[2]["frame"].as_i64()), (4, Some(5), Some(1003)));
    // 0.25 m at one of the points: the mean square is 0.25² over their number.
    let points =
        drapery_io::cache_frames::CacheFrames::open(&folder.path().join("a/sheet.abc")).unwrap().meshes[0].points;
    let rms = frames[2]["rms"].as_f64().unwrap();
    assert!((rms * (points as f64).sqrt() / 0.25 - 1.0).abs() < 1e-6, "{rms}");
    let tolerant = drapery(folder.path(), &["diff", "a", "b", "--tolerance", "0.3"]);
    assert_eq!((tolerant.code, tolerant.stdout.contains("within tolerance")), (Some(0), true), "{}", tolerant.stdout);
}

#[test]
fn caches_of_other_formats_and_units_are_compared_in_metres() {
    let folder = folder_with(&SHEET.replace("[\"abc\"]", "[\"abc\", \"h5\"]"));
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--out", "a", "-q"]).code, Some(0));
    let mixed = drapery(folder.path(), &["diff", "a/sheet.abc", "a/sheet.h5"]);
    assert_eq!((mixed.code, mixed.stdout.contains(": equal")), (Some(0), true), "{}", mixed.stdout);
    // A shorter range is reported, not passed over.
    let shorter = drapery(folder.path(), &["run", "scene.toml", "--out", "b", "--frames", "1001-1002", "-q"]);
    assert_eq!(shorter.code, Some(0), "{}", shorter.stderr);
    let found = drapery(folder.path(), &["diff", "a/sheet.abc", "b/sheet.h5"]);
    assert_eq!(found.code, Some(1));
    assert!(found.stdout.contains("only the first has frame 1003, 1004"), "{}", found.stdout);
    // Another resolution is another mesh.
    let finer = drapery(folder.path(), &["run", "scene.toml", "--out", "c", "--set", "resolution=7", "-q"]);
    assert_eq!(finer.code, Some(0), "{}", finer.stderr);
    let found = drapery(folder.path(), &["diff", "a/sheet.abc", "c/sheet.abc"]);
    assert_eq!((found.code, found.stdout.contains("not the same mesh")), (Some(1), true), "{}", found.stdout);
}

#[test]
fn things_that_cannot_be_compared_are_refused_with_advice() {
    let folder = run_into(&["a"]);
    for (arguments, code, words) in [
        (["diff", "a", "a/sheet.abc"], 65, "two files or two run folders"),
        (["diff", "a/sheet.abc", "missing.abc"], 66, "file not found"),
        (["diff", "a/sheet.abc", "scene.toml"], 65, ".abc, .h5"),
    ] {
        let outcome = drapery(folder.path(), &arguments);
        assert_eq!(outcome.code, Some(code), "{}", outcome.stderr);
        assert!(outcome.stderr.contains(words), "{}", outcome.stderr);
    }
    let outcome = drapery(folder.path(), &["diff", "a", "a", "--tolerance", "-1"]);
    assert_eq!((outcome.code, outcome.stderr.contains("distance in metres")), (Some(2), true), "{}", outcome.stderr);
}

#[test]
fn the_report_is_one_page_with_charts_and_pictures_and_the_same_bytes_each_time() {
    let folder = run_into(&["out"]);
    let out = folder.path().join("out");
    let mut record = OpenOptions::new().append(true).open(out.join("run.jsonl")).unwrap();
    writeln!(record, "{{\"record\":\"checkpoint\",\"frame\":1003,\"seconds\":0.25,\"bytes\":2048}}").unwrap();
    let report = drapery(folder.path(), &["report", "out"]);
    assert_eq!((report.code, report.stdout.trim()), (Some(0), "wrote out/report.html"), "{}", report.stderr);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    for word in ["http", "<script", "src=\"/", "href="] {
        assert!(!page.contains(word), "{word}");
    }
    for words in ["Seconds per frame, by stage", "B.5 velocity", "Largest strain", "no limit exceeded", "4 of 4"] {
        assert!(page.contains(words), "{words}");
    }
    for frame in 1002..=1004 {
        assert!(page.contains(&format!("<title>frame {frame}")), "frame {frame} has a tooltip");
    }
    assert!(page.contains("checkpoint at frame 1003: 2 KiB in 250 ms"));
    assert_eq!(page.matches("data:image/png;base64,").count(), 4, "a picture of each of the four frames");
    assert_eq!(drapery(folder.path(), &["report", "out"]).code, Some(0));
    assert!(page == std::fs::read_to_string(out.join("report.html")).unwrap());
}

#[test]
fn one_material_is_shown_by_its_name_and_all_for_programs() {
    let folder = folder_with(SHEET);
    let one = drapery(folder.path(), &["materials", "silk_light"]);
    assert!(one.stdout.starts_with("silk_light: ") && !one.stdout.contains("cotton_shirting"), "{}", one.stdout);
    let wrong = drapery(folder.path(), &["materials", "silk_lihgt"]);
    assert_eq!(wrong.code, Some(2));
    assert!(wrong.stderr.contains("did you mean `silk_light`?"), "{}", wrong.stderr);
    let all: Value = serde_json::from_str(&drapery(folder.path(), &["materials", "--json"]).stdout).unwrap();
    let silk = all.as_array().unwrap().iter().find(|material| material["name"] == "silk_light").unwrap();
    assert!(silk["density"].as_f64().is_some_and(|density| density > 0.0) && silk["from"] == "preset", "{silk}");
}

#[test]
fn the_folder_of_a_run_is_known_where_a_file_is_asked_for() {
    let folder = run_into(&["out"]);
    let info = drapery(folder.path(), &["info", "out"]);
    assert_eq!(info.code, Some(65));
    assert!(
        info.stderr.contains("this is a run folder") && info.stderr.contains("drapery status out"),
        "{}",
        info.stderr
    );
}

#[test]
fn a_comparison_replaces_only_pages_and_tables_of_its_own() {
    let folder = run_into(&["a", "b"]);
    let compare = |name: &str| drapery(folder.path(), &["report", "a", "b", "--out", name]);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    for (name, beside) in [("notes.html", "notes.csv"), ("page.html", "page.csv")] {
        let foreign = if name == "notes.html" { name } else { beside };
        std::fs::write(folder.path().join(foreign), "<!DOCTYPE html>\nmine\n").unwrap();
        let refused = compare(name);
        assert_eq!(refused.code, Some(73), "{}", refused.stderr);
        let words = format!("{foreign}: this file exists already and is no ");
        assert!(refused.stderr.contains(&words), "{}", refused.stderr);
        assert!(read(foreign).contains("mine"));
    }
    // The name of a table names the table, and the page is beside it; both may be replaced.
    for _ in 0..2 {
        let done = compare("t.csv");
        assert_eq!(done.code, Some(0), "{}", done.stderr);
        assert!(done.stdout.contains("wrote t.html") && done.stdout.contains("wrote t.csv"), "{}", done.stdout);
        assert!(read("t.csv").starts_with("run,state,") && read("t.html").starts_with("<!DOCTYPE html>"));
    }
}

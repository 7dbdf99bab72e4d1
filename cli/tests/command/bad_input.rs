//! Bad input: `check` names the place and says what to do, with the exit code of the table; `run` refuses the same
//! way and leaves nothing behind.

use std::path::Path;

use drapery_selftest::files::{BODY, SKIRT};

use crate::{SHEET, drapery, folder_with};

/// A garment from an OBJ file over a body from an OBJ file.
const FROM_FILES: &str = r#"drapery = 1
[shot]
name = "files"
frames = "1-3"
[units]
length = "m"
[gravity]
[[body]]
name = "hero"
file = "body.obj"
[[garment]]
name = "skirt"
rest = "skirt.obj"
density = "0.15 kg/m²"
[output]
format = ["abc"]
"#;

/// Runs `check` and `run`; both have to end with `code` and say all `parts`, and no output may appear.
pub(crate) fn refused(folder: &Path, code: i32, parts: &[&str]) {
    for arguments in [&["check", "scene.toml"][..], &["run", "scene.toml", "--out", "out"][..]] {
        let outcome = drapery(folder, arguments);
        assert_eq!(outcome.code, Some(code), "{arguments:?}\n{}", outcome.stderr);
        for part in parts {
            assert!(outcome.stderr.contains(part), "{arguments:?}: `{part}` is missing in\n{}", outcome.stderr);
        }
        assert_eq!(outcome.stderr.matches("Error:").count(), 1, "{}", outcome.stderr);
        assert!(!folder.join("out").exists(), "{arguments:?} left output behind");
    }
}

/// The scene of files with these texts in place of the body and the garment.
pub(crate) fn with_files(body: &str, skirt: &str) -> tempfile::TempDir {
    let folder = folder_with(FROM_FILES);
    std::fs::write(folder.path().join("body.obj"), body).unwrap();
    std::fs::write(folder.path().join("skirt.obj"), skirt).unwrap();
    folder
}

#[test]
fn sound_files_are_accepted() {
    let folder = with_files(BODY, SKIRT);
    let outcome = drapery(folder.path(), &["check", "scene.toml"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(outcome.stdout.contains("frames 1-3 can be simulated"), "{}", outcome.stdout);
}

#[test]
fn missing_files() {
    let folder = folder_with(FROM_FILES);
    refused(folder.path(), 66, &["body.obj", "skirt.obj", "file not found", "scene.toml:10:8", "help:"]);
    let nothing = drapery(folder.path(), &["check", "no_scene.toml"]);
    assert_eq!(nothing.code, Some(66));
}

#[test]
fn a_misspelt_key_is_shown_with_the_nearest_word() {
    let folder = folder_with(&SHEET.replace("friction", "fricton"));
    refused(folder.path(), 78, &["scene.toml:12:1", "fricton", "friction"]);
}

#[test]
fn a_thickness_that_is_no_length() {
    let with = |thickness: &str| {
        let scene = SHEET.replace("[output]", "[self_repulsion]\n[self_collision]\n[output]");
        folder_with(&scene.replace("density", &format!("thickness = {thickness}\ndensity")))
    };
    for thickness in ["0.0", "\"-1 mm\"", "nan", "inf", "\"2 kg\""] {
        println!("{thickness}");
        refused(with(thickness).path(), 78, &["scene.toml:", "thickness"]);
    }
    // Thicker than the edges are long: repulsions take what the edges allow.
    assert_eq!(drapery(with("\"5 m\"").path(), &["check", "scene.toml"]).code, Some(0));
}

#[test]
fn meshes_that_cannot_be_simulated() {
    let cases: [(&str, &str, &[&str]); 2] = [
        ("not a number", &SKIRT.replace("v 3 1 1", "v 3 nan 1"), &["garment \"skirt\"", "vertices 2", "not finite"]),
        ("cut off", &SKIRT.replace("f 1 4 3 2", "f 1 4 3 7"), &["skirt.obj", "line 5", "point 7 does not exist"]),
    ];
    for (name, skirt, parts) in cases {
        println!("{name}");
        refused(with_files(BODY, skirt).path(), 65, parts);
    }
}

#[test]
fn elements_that_take_no_part_are_warnings_of_check_and_of_run() {
    let cases: [(&str, &str, &str); 4] = [
        ("zero area", &format!("{SKIRT}v 4 1 0\nf 1 2 5\n"), "faces 1 have no area"),
        ("duplicate", &format!("{SKIRT}f 1 4 3 2\n"), "faces 1 duplicate other faces"),
        ("isolated", &format!("v 9 9 9\n{}", SKIRT.replace("f 1 4 3 2", "f 2 5 4 3")), "vertices 0 belong to no face"),
        ("corner twice", &SKIRT.replace("f 1 4 3 2", "f 1 4 4 2"), "faces 0 have no area"),
    ];
    for (name, skirt, says) in cases {
        let folder = with_files(BODY, skirt);
        for arguments in [&["check", "scene.toml"][..], &["run", "scene.toml", "--out", "out"][..]] {
            let outcome = drapery(folder.path(), arguments);
            assert_eq!(outcome.code, Some(0), "{name}, {arguments:?}\n{}", outcome.stderr);
            let said = outcome.stderr.lines().any(|line| line.contains("garment \"skirt\"") && line.contains(says));
            assert!(said, "{name}, {arguments:?}: `{says}` is missing in\n{}", outcome.stderr);
        }
    }
}

#[test]
fn bodies_without_a_clear_outside() {
    let flat =
        BODY.lines().map(|line| if line.starts_with("v 0 1.7") { "v 0.2 0 0.2\n".into() } else { format!("{line}\n") });
    let flat: String = flat.filter(|line| !line.starts_with('f')).chain(["f 1 2 2\n".to_owned()]).collect();
    let cases: [(&str, String, &[&str]); 4] = [
        ("no area at all", flat, &["frame 1", "0-1-1 have no area"]),
        ("no faces", BODY.lines().filter(|line| line.starts_with('v')).collect::<Vec<_>>().join("\n"), &["no faces"]),
        ("duplicate", format!("{BODY}f 3 1 2\n"), &["frame 1", "2-0-1 are duplicates"]),
        ("not a number", BODY.replace("1.7", "nan"), &["frame 1", "vertex 3", "finite"]),
    ];
    for (name, body, parts) in cases {
        println!("{name}");
        refused(with_files(&body, SKIRT).path(), 65, &[&["body \"hero\""], parts].concat());
    }
}

#[test]
fn a_body_in_centimetres_read_as_metres() {
    let large = BODY.replace("0.5", "50").replace("1.7", "170");
    refused(with_files(&large, SKIRT).path(), 78, &["body \"hero\"", "170.000 m high", "units.length = \"cm\""]);
}

#[test]
fn a_garment_that_starts_inside_the_body() {
    let inside = SKIRT
        .replace("v 2 1 0", "v 0.1 0.3 0.1")
        .replace("v 2 1 1", "v 0.1 0.3 0.12")
        .replace("v 3 1 0", "v 0.1 0.4 0.1");
    let parts = ["garment \"skirt\", vertex 0", "inside body \"hero\"", "deepest", "mm", "help:"];
    refused(with_files(BODY, &inside).path(), 65, &parts);
}

#[test]
fn a_pin_to_a_vertex_that_does_not_exist() {
    let folder = folder_with(&SHEET.replace("[output]", "[[garment.pin]]\nvertices = [0, 99999]\n[output]"));
    refused(folder.path(), 78, &["99999", "vertices"]);
}

#[test]
fn a_cut_off_archive_and_frames_outside_an_archive() {
    // A cache of our own makes the moving body.
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--out", "first", "-q"]).code, Some(0));
    let cache = std::fs::read(folder.path().join("first/sheet.abc")).unwrap();
    std::fs::write(folder.path().join("body.abc"), &cache).unwrap();
    let scene = FROM_FILES.replace("body.obj", "body.abc").replace("skirt.obj", "high.obj");
    std::fs::write(folder.path().join("high.obj"), "v 2 5 0\nv 3 5 0\nv 3 5 1\nv 2 5 1\nf 1 4 3 2\n").unwrap();
    std::fs::write(folder.path().join("scene.toml"), scene.replace("1-3", "1001-1010")).unwrap();
    refused(folder.path(), 65, &["body \"hero\"", "frames 1001 to 1004", "frames 1001 to 1010", "help:"]);
    std::fs::write(folder.path().join("body.abc"), &cache[..cache.len() / 2]).unwrap();
    refused(folder.path(), 65, &["body.abc", "truncated or corrupt"]);
}

#[test]
fn a_body_that_changes_its_topology() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data/foreign_caches/abc/blender_changing_topology.abc");
    if !file.exists() {
        println!("skipped: no shared data");
        return;
    }
    let scene = FROM_FILES.replace("body.obj", "body.abc").replace("1-3", "2-6");
    let folder = folder_with(&scene);
    std::fs::copy(file, folder.path().join("body.abc")).unwrap();
    std::fs::write(folder.path().join("skirt.obj"), SKIRT).unwrap();
    refused(folder.path(), 65, &["body \"hero\"", "/cloth/cloth", "frame 3", "topology"]);
}

#[test]
fn frames_that_skip_or_start_late() {
    let folder = folder_with(SHEET);
    let late = drapery(folder.path(), &["run", "scene.toml", "--frames", "1003-1004"]);
    assert_eq!(late.code, Some(2));
    assert!(late.stderr.contains("a run starts at frame 1001"), "{}", late.stderr);
    let skipping = drapery(folder.path(), &["run", "scene.toml", "--frames", "1001-1004x2"]);
    assert_eq!(skipping.code, Some(2));
    assert!(skipping.stderr.contains("cannot skip frames"), "{}", skipping.stderr);
}

#[test]
fn a_mesh_that_no_machine_has_room_for_is_refused_before_it_is_made() {
    // Hundreds of millions of points.
    let folder = folder_with(&SHEET.replace("resolution = 6", "resolution = 20000"));
    for command in ["check", "plan", "run"] {
        let refused = drapery(folder.path(), &[command, "scene.toml"]);
        assert_eq!(refused.code, Some(71), "{command}: {}", refused.stderr);
        for part in ["scene.toml", "not enough memory", "GiB are free"] {
            assert!(refused.stderr.contains(part), "{part}: {}", refused.stderr);
        }
        assert!(!refused.stderr.contains("backtrace") && !folder.path().join("out").exists(), "{}", refused.stderr);
    }
}

#[test]
fn frames_that_the_shot_does_not_have_are_refused() {
    let folder = folder_with(SHEET);
    for command in ["check", "plan", "run"] {
        let outcome = drapery(folder.path(), &[command, "scene.toml", "--frames", "1001-1200"]);
        assert_eq!(outcome.code, Some(2), "{command}: {}", outcome.stderr);
        assert!(outcome.stderr.contains("the shot ends at frame 1004"), "{command}: {}", outcome.stderr);
    }
    assert!(!folder.path().join("out").exists());
}

#[test]
fn a_word_of_the_solver_in_the_place_of_a_file_of_settings_is_told_apart() {
    let folder = folder_with(SHEET);
    let outcome = drapery(folder.path(), &["check", "scene.toml", "--preset", "production"]);
    assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("--set solver.preset=production"), "{}", outcome.stderr);
}

#[test]
fn very_many_problems_are_counted_and_the_first_are_shown() {
    let garments: String = (0..5000).map(|index| format!("[[garment]]\nname = \"g{index}\"\ndensity = 1\n")).collect();
    let scene = SHEET.replace("[output]", &format!("{garments}[output]"));
    let start = std::time::Instant::now();
    let outcome = drapery(folder_with(&scene).path(), &["check", "scene.toml"]);
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
    assert_eq!(outcome.code, Some(78));
    assert!(
        outcome.stderr.contains("5000 problems") && outcome.stderr.contains("4960 more will be shown"),
        "{}",
        outcome.stderr.len()
    );
}

#[test]
fn a_damaged_manifest_is_named_and_no_other_run() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q"]).code, Some(0));
    std::fs::write(folder.path().join("out/manifest.json"), "{\"shot\": \"she").unwrap();
    let again = drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q"]);
    assert_eq!(again.code, Some(65), "{}", again.stderr);
    for part in ["manifest.json: line 1", "it is damaged", "--overwrite"] {
        assert!(again.stderr.contains(part), "{part}: {}", again.stderr);
    }
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q", "--overwrite"]).code, Some(0));
}

#[test]
fn a_lost_fingerprint_is_named_and_no_other_run() {
    let folder = folder_with(SHEET);
    let run = |arguments: &[&str]| {
        drapery(folder.path(), &[&["run", "scene.toml", "--out", "out", "-q"], arguments].concat())
    };
    assert_eq!(run(&["--frames", "1001-1002"]).code, Some(0));
    std::fs::write(folder.path().join("out/fingerprint.json"), "{").unwrap();
    let again = run(&[]);
    assert_eq!(again.code, Some(73), "{}", again.stderr);
    for part in ["fingerprint.json: this file is missing or damaged", "--resume-with-changes", "--overwrite"] {
        assert!(again.stderr.contains(part), "{part}: {}", again.stderr);
    }
    assert_eq!(run(&["--resume-with-changes"]).code, Some(0));
}

#[test]
fn checkpoints_of_frames_that_the_shot_does_not_have_are_refused() {
    let folder = folder_with(SHEET);
    let run = |frames: &str| {
        let pin = ["--pin-checkpoint", frames, "--frames", "1001-1002"];
        drapery(folder.path(), &[&["run", "scene.toml", "--out", "out", "-q"], &pin[..]].concat())
    };
    for frames in ["9999", "1002,1005", "-3"] {
        let refused = run(frames);
        assert_eq!(refused.code, Some(2), "{frames}: {}", refused.stderr);
        assert!(refused.stderr.contains("its frames are 1001-1004"), "{frames}: {}", refused.stderr);
    }
    assert!(!folder.path().join("out").exists());
    // A frame to which a later attempt comes is right.
    assert_eq!(run("1004").code, Some(0));
}

#[test]
fn another_mesh_cannot_go_on_from_a_checkpoint_and_is_another_run() {
    let folder = folder_with(SHEET);
    let run = |arguments: &[&str]| {
        drapery(folder.path(), &[&["run", "scene.toml", "--out", "out", "-q"], arguments].concat())
    };
    assert_eq!(run(&["--frames", "1001-1002"]).code, Some(0));
    let other = run(&["--resume-with-changes", "--set", "garment.0.panel.resolution=5"]);
    assert_eq!(other.code, Some(73), "{}", other.stderr);
    assert!(
        other.stderr.contains("belongs to a different shot") && other.stderr.contains("--overwrite"),
        "{}",
        other.stderr
    );
}

#[test]
fn all_unknown_keys_of_a_scene_are_named_in_one_go() {
    let misspelt = [
        ("[gravity]", "[gravty]", "`gravty` at the top level"),
        ("friction", "frction", "`frction` in `body.0`"),
        ("density", "densty", "`densty` in `garment.0`"),
        ("stiffness = \"100 N/m\"", "stifness = 1\nthickness = 2", "`stifness` in `garment.0.stretch`"),
        ("[output]", "[solver]\nclf = 1\n[output]", "`clf` in `solver`"),
        ("format", "name = \"sheet\"\nformat", "`name` in `output`"),
    ];
    let scene = misspelt.iter().fold(SHEET.to_owned(), |scene, (right, wrong, _)| scene.replacen(right, wrong, 1));
    let check = drapery(folder_with(&scene).path(), &["check", "scene.toml"]);
    assert_eq!(check.code, Some(78), "{}", check.stderr);
    // In the order of the file, and nothing that follows from them.
    let named: Vec<&str> = check.stderr.lines().filter_map(|line| Some(line.split_once("unknown key ")?.1)).collect();
    let mut expected: Vec<&str> = misspelt.iter().map(|(_, _, words)| *words).collect();
    expected.insert(4, "`thickness` in `garment.0.stretch`");
    assert_eq!(named, expected, "{}", check.stderr);
    assert_eq!(check.stderr.matches("did you mean").count(), 6, "{}", check.stderr);
}

#[test]
fn a_garment_without_faces_is_refused_as_a_body_is() {
    let points: String = SKIRT.lines().filter(|line| line.starts_with('v')).map(|line| format!("{line}\n")).collect();
    refused(with_files(BODY, &points).path(), 65, &["scene.toml:", "garment \"skirt\" has no faces", "polygons"]);
}

#[test]
fn a_loose_point_far_away_is_named_with_its_number() {
    let far = SKIRT.replace("f 1 4 3 2", "v 5000000 0 0\nf 1 4 3 2");
    refused(with_files(BODY, &far).path(), 65, &["garment \"skirt\", vertex 4: it belongs to no face", "delete loose"]);
}

#[test]
fn a_pin_that_would_end_after_the_shot_is_told() {
    let pin = "[[garment.pin]]\nvertices = [0]\nuntil = 9.0\n[output]";
    let folder = folder_with(&SHEET.replace("[output]", pin));
    let check = drapery(folder.path(), &["check", "scene.toml"]);
    assert_eq!(check.code, Some(0), "{}", check.stderr);
    assert!(check.stderr.contains("`until` is at 9 s, after the last frame"), "{}{}", check.stdout, check.stderr);
}

#[test]
fn an_error_is_an_object_where_json_is_asked_for() {
    let folder = folder_with(&SHEET.replace("friction", "fricton"));
    for (arguments, code) in [
        (&["check", "scene.toml", "--json"][..], 78),
        (&["plan", "scene.toml", "--json"], 78),
        (&["diff", "a.abc", "b.abc", "--json"], 66),
    ] {
        let outcome = drapery(folder.path(), arguments);
        assert_eq!(outcome.code, Some(code), "{arguments:?}: {}", outcome.stderr);
        let object: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap_or_default();
        assert_eq!(object["exit_code"], code, "{arguments:?}: {}", outcome.stdout);
        let text = object["error"].as_str().unwrap_or_default();
        assert!(text.contains(if code == 66 { "a.abc" } else { "fricton" }), "{text}");
    }
}

#[test]
fn a_face_of_a_body_without_area_is_named_and_passed_over() {
    let body = format!("{BODY}v 0.25 0 0\nf 1 2 5\n");
    // Falls onto the body, over the face without area.
    let skirt = "v -0.1 1.9 -0.1\nv 0.3 1.9 -0.1\nv 0.3 1.9 0.3\nv -0.1 1.9 0.3\nf 1 4 3 2\n";
    let folder = with_files(&body, skirt);
    for arguments in [&["check", "scene.toml"][..], &["run", "scene.toml", "--frames", "1-20", "--out", "out"]] {
        let scene = std::fs::read_to_string(folder.path().join("scene.toml")).unwrap();
        std::fs::write(folder.path().join("scene.toml"), scene.replace("1-3", "1-20")).unwrap();
        let outcome = drapery(folder.path(), arguments);
        assert_eq!(outcome.code, Some(0), "{arguments:?}\n{}", outcome.stderr);
        let words = "frame 1: faces between the points 0-1-4 have no area";
        assert!(outcome.stderr.contains(words), "{arguments:?}: {}", outcome.stderr);
    }
}

#[test]
fn a_start_pose_in_another_unit_is_refused() {
    let folder = with_files(BODY, SKIRT);
    let posed = SKIRT.replace("v 2 1 0", "v 200 100 0").replace("v 3 1 0", "v 300 100 0");
    let posed = posed.replace("v 3 1 1", "v 300 100 100").replace("v 2 1 1", "v 200 100 100");
    std::fs::write(folder.path().join("posed.obj"), posed).unwrap();
    let scene = FROM_FILES.replace("rest = \"skirt.obj\"", "rest = \"skirt.obj\"\nstart = \"posed.obj\"");
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    refused(folder.path(), 65, &["scene.toml:", "100 times as large as at rest", "another unit"]);
}

#[test]
fn a_parameter_that_the_scene_does_not_declare_is_refused_by_either_name() {
    let folder = folder_with(SHEET);
    for key in ["resolutoin", "parameters.resolutoin"] {
        let refused = drapery(folder.path(), &["check", "scene.toml", "--set", &format!("{key}=4")]);
        assert_eq!(refused.code, Some(78), "{key}: {}", refused.stderr);
        let words = ["the scene has no parameter `resolutoin`", "did you mean `resolution`?"];
        assert!(words.iter().all(|words| refused.stderr.contains(words)), "{}", refused.stderr);
    }
    let set = drapery(folder.path(), &["check", "scene.toml", "--set", "parameters.resolution=4"]);
    assert_eq!(set.code, Some(0), "{}", set.stderr);
}

#[test]
fn a_foreign_file_in_the_way_of_a_run_is_not_called_a_run() {
    let folder = folder_with(SHEET);
    std::fs::create_dir(folder.path().join("mine")).unwrap();
    std::fs::write(folder.path().join("mine/sheet.abc"), "mine").unwrap();
    let run = drapery(folder.path(), &["run", "scene.toml", "--out", "mine"]);
    assert_eq!(run.code, Some(73), "{}", run.stderr);
    assert!(run.stderr.contains("mine/sheet.abc: this file exists already"), "{}", run.stderr);
    assert!(!run.stderr.contains("holds a run") && run.stderr.contains("--out"), "{}", run.stderr);
}

#[test]
fn a_missing_file_of_the_command_line_is_looked_for_in_the_present_folder() {
    let folder = folder_with(SHEET);
    let missing = drapery(folder.path(), &["info", "a.abc"]);
    assert_eq!(missing.code, Some(66));
    assert!(missing.stderr.contains("on the command line at the present folder"), "{}", missing.stderr);
    std::fs::write(folder.path().join("noext"), "x").unwrap();
    let unknown = drapery(folder.path(), &["info", "noext"]);
    assert!(unknown.stderr.contains("files without an extension cannot be inspected"), "{}", unknown.stderr);
}

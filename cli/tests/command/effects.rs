//! `--without`, `--only`, `[effects]`, and what `plan` says of the effects.

use std::path::Path;

use serde_json::Value;

use crate::{SHEET, drapery, folder_with};

/// The caches of a run of a scene.
fn cache(folder: &Path, scene: &str, out: &str, flags: &[&str]) -> Vec<u8> {
    std::fs::write(folder.join(format!("{out}.toml")), scene).unwrap();
    let name = format!("{out}.toml");
    let arguments = [&["run", &name, "--out", out, "-q"][..], flags].concat();
    let outcome = drapery(folder, &arguments);
    assert_eq!(outcome.code, Some(0), "{arguments:?}\n{}", outcome.stderr);
    std::fs::read(folder.join(out).join("sheet.abc")).unwrap()
}

/// The scene with more that can be left out.
fn with_contact() -> String {
    format!("{SHEET}[self_repulsion]\n[self_collision]\n")
}

#[test]
fn what_is_left_out_gives_the_bytes_of_a_scene_that_never_asked_for_it() {
    let folder = folder_with(SHEET);
    let without_gravity = SHEET.replace("[gravity]\n", "");
    let ball = SHEET.find("[[body]]").unwrap()..SHEET.find("[[garment]]").unwrap();
    let without_ball = SHEET.replace(&SHEET[ball], "");
    let both = with_contact();
    let only = format!("{both}[effects]\nonly = [\"gravity\", \"stretch\", \"body_collision\"]\n");
    let cases: [(&str, &str, &str, &[&str]); 5] = [
        ("gravity", SHEET, &without_gravity, &["--without", "gravity"]),
        ("ball", SHEET, &without_ball, &["--without", "body_collision"]),
        ("contact", &both, SHEET, &["--without", "self_repulsion,self_collision"]),
        ("only", &both, &without_gravity, &["--only", "stretch,body_collision"]),
        ("table", &only, SHEET, &[]),
    ];
    let whole = cache(folder.path(), SHEET, "whole", &[]);
    for (name, scene, absent, flags) in cases {
        let left_out = cache(folder.path(), scene, name, flags);
        assert!(left_out == cache(folder.path(), absent, &format!("{name}_absent"), &[]), "{name}");
        // Within four frames the sheet does not come to the ball.
        assert_eq!(left_out == whole, name == "ball" || absent == SHEET, "{name}: as the whole scene");
        let resolved = std::fs::read_to_string(folder.path().join(name).join("resolved.toml")).unwrap();
        assert!(resolved.contains("[effects]"), "{name}: {resolved}");
        let again = cache(folder.path(), &resolved, &format!("{name}_again"), &[]);
        assert!(again == left_out, "{name}: its resolved scene does without, too");
    }
}

#[test]
fn a_run_is_not_continued_with_other_effects_unasked() {
    let folder = folder_with(SHEET);
    assert_eq!(drapery(folder.path(), &["run", "scene.toml", "--frames", "1001-1002", "-q"]).code, Some(0));
    let other = drapery(folder.path(), &["run", "scene.toml", "--without", "gravity", "-q"]);
    assert_ne!(other.code, Some(0));
    assert!(other.stderr.contains("effects.without"), "{}", other.stderr);
}

#[test]
fn a_contradiction_is_an_error_that_names_what_contradicts() {
    let folder = folder_with(SHEET);
    let cases: [(&[&str], &[&str]); 6] = [
        (&["--without", "self_colision"], &["there is no effect `self_colision`", "did you mean `self_collision`?"]),
        (&["--without", "self_collision"], &["does not ask for `self_collision`", "gravity, stretch, body_collision"]),
        (&["--only", "gravity,pins"], &["does not ask for `pins`"]),
        (&["--without", "friction"], &["friction is not an effect of its own", "body_collision"]),
        (&["--without", "gravity", "--only", "stretch"], &["--without", "--only"]),
        (
            &["--set", "effects.without=[\"gravity\"]", "--set", "effects.only=[\"stretch\"]"],
            &["`without` and `only` exclude each other"],
        ),
    ];
    for (flags, parts) in cases {
        for command in ["check", "plan", "run"] {
            let outcome = drapery(folder.path(), &[&[command, "scene.toml"][..], flags].concat());
            assert_ne!(outcome.code, Some(0), "{command} {flags:?}\n{}", outcome.stdout);
            for part in parts {
                assert!(outcome.stderr.contains(part), "{command} {flags:?}: no `{part}` in\n{}", outcome.stderr);
            }
        }
    }
}

#[test]
fn the_plan_says_why_every_effect_is_there_what_it_holds_and_what_it_takes() {
    let folder = folder_with(&with_contact());
    let text = drapery(folder.path(), &["plan", "scene.toml", "--without", "self_collision"]).stdout;
    for part in [
        "stretch of sheet: the scene has a table [garment.0.stretch]",
        " springs, ",
        "body_collision: the scene has 1 body",
        "friction: on, because body ball has friction 0.4",
        "friction: on, because cloth on cloth has friction 0.4",
        "without self_collision: left out of this run",
        "list of close pairs: for self_repulsion",
        " effects; ",
        " resident; ",
        " more where layers lie on each other",
        "per frame: at least ",
        " time steps, required by the stiffness of `stretch` of garment \"sheet\"; --measure simulates",
    ] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    let unmeasured = drapery(folder.path(), &["plan", "scene.toml", "--json"]).stdout;
    let unmeasured: Value = serde_json::from_str(&unmeasured).unwrap();
    let claims = [&unmeasured["frame"]["seconds"], &unmeasured["effects"][0]["share"]];
    assert!(claims.iter().all(|claim| claim.is_null()) && !text.contains('%'), "nothing is claimed: {unmeasured:#}");
    let bytes = |of: &Value, what: &str| of["bytes"][what].as_u64().unwrap();
    let [state, effects, resident, pairs] = ["state", "effects", "resident", "pairs"].map(|of| bytes(&unmeasured, of));
    assert!(resident > state + effects && pairs == 40 * 24 * vertices(&unmeasured), "{unmeasured:#}");
    let alone = ["plan", "scene.toml", "--json", "--without", "self_collision", "--without", "self_repulsion"];
    let alone: Value = serde_json::from_str(&drapery(folder.path(), &alone).stdout).unwrap();
    assert_eq!(bytes(&alone, "pairs"), 0);
    let outcome = drapery(folder.path(), &["plan", "scene.toml", "--json", "--measure=2"]);
    let plan: Value = serde_json::from_str(&outcome.stdout).unwrap_or_else(|e| panic!("{e}\n{}", outcome.stderr));
    let effects = plan["effects"].as_array().unwrap();
    let shares: Vec<f64> = effects.iter().map(|effect| effect["share"].as_f64().unwrap()).collect();
    let all = shares.iter().sum::<f64>() + plan["frame"]["method_share"].as_f64().unwrap();
    assert!((all - 1.0).abs() < 1e-9 && shares.iter().all(|share| (0.0..1.0).contains(share)), "{plan:#}");
    assert!(plan["frame"]["from"].as_str().unwrap().starts_with("measured in 2"), "{plan:#}");
    let names: Vec<&str> = effects.iter().map(|effect| effect["effect"].as_str().unwrap()).collect();
    assert_eq!(names, ["gravity", "stretch", "body_collision", "self_repulsion", "self_collision"]);
    assert_eq!(effects[1]["elements"]["kind"], "springs");
    assert!(!folder.path().join("out").exists(), "plan writes nothing");
    assert_eq!(drapery(folder.path(), &["plan", "scene.toml", "--measure=9"]).code, Some(2));
    for spaced in [["plan", "scene.toml", "--measure", "2"], ["plan", "--measure", "2", "scene.toml"]] {
        let refused = drapery(folder.path(), &spaced);
        assert_eq!(refused.code, Some(2), "{}", refused.stderr);
        assert!(refused.stderr.contains("write --measure=2"), "{}", refused.stderr);
    }
}

/// Vertices of all garments of a plan.
fn vertices(plan: &Value) -> u64 {
    plan["garments"].as_array().unwrap().iter().map(|garment| garment["points"].as_u64().unwrap()).sum()
}

#[test]
fn the_plan_names_the_source_of_every_setting() {
    let scene = SHEET
        .replace("density = \"0.15 kg/m²\"", "material = \"cotton_shirting\"")
        .replace("stiffness = \"100 N/m\"", "damping_ratio = 3")
        .replace("[gravity]\n", "[gravity]\n[solver]\npreset = \"hero\"\n");
    let folder = folder_with(&scene);
    let arguments = ["plan", "scene.toml", "--set", "gravity.acceleration=[0, -1.62, 0]"];
    let text = drapery(folder.path(), &arguments).stdout;
    for line in [
        "    stiffness = 261 N/m (material cotton_shirting)",
        "    damping_ratio = 3 (scene)",
        "    acceleration = [0.0, -1.62, 0.0] m/s² (--set)",
    ] {
        assert!(text.lines().any(|printed| printed == line), "no `{line}` in\n{text}");
    }
    let resolved = |key: &str| text.lines().find(|line| line.starts_with(key)).unwrap_or_default().to_owned();
    assert!(
        resolved("steps_per_frame = 16").ends_with("# preset hero") && resolved("min_dt = ").ends_with("# default"),
        "{text}"
    );
    let json = drapery(folder.path(), &[&arguments[..], &["--json"]].concat()).stdout;
    let plan: Value = serde_json::from_str(&json).unwrap();
    let settings = &plan["effects"][1]["settings"];
    let sources = ["stiffness", "damping_ratio"].map(|key| settings[key]["from"].as_str());
    assert_eq!(sources, [Some("material cotton_shirting"), Some("scene")], "{settings:#}");
}

#[test]
fn warnings_of_rules_are_told_by_name_counted_and_silenced() {
    let folder = folder_with(&SHEET.replace("[gravity]\n", ""));
    for command in ["check", "plan"] {
        let outcome = drapery(folder.path(), &[command, "scene.toml"]);
        assert!(
            outcome.stderr.contains("WARN no_gravity: ") && outcome.stderr.contains("write [gravity]"),
            "{}",
            outcome.stderr
        );
        let json = drapery(folder.path(), &[command, "scene.toml", "--json"]).stdout;
        let warnings = &serde_json::from_str::<Value>(&json).unwrap()["warnings"];
        let said = ["rule", "line"].map(|key| warnings[0][key].as_str());
        assert_eq!(said, [Some("no_gravity"), Some("[gravity]")], "{json}");
    }
    let run = drapery(folder.path(), &["run", "scene.toml", "--out", "out", "--strict"]);
    assert_eq!((run.code, run.stdout.contains("1 warning")), (Some(0), true), "{}{}", run.stdout, run.stderr);
    let silent =
        drapery(folder.path(), &["run", "scene.toml", "--out", "out", "--set", "check.silence=[\"no_gravity\"]"]);
    assert_eq!(
        (silent.code, silent.stderr.as_str()),
        (Some(0), ""),
        "the same shot, without a word: {}",
        silent.stdout
    );
    let unknown = drapery(folder.path(), &["check", "scene.toml", "--set", "check.silence=[\"no_gravty\"]"]);
    assert_eq!(unknown.code, Some(78), "{}", unknown.stderr);
    for words in ["there is no rule `no_gravty`", "did you mean `no_gravity`?"] {
        assert!(unknown.stderr.contains(words), "{}", unknown.stderr);
    }
}

#[test]
fn the_long_version_lists_the_features_of_the_build() {
    let folder = folder_with(SHEET);
    let long = drapery(folder.path(), &["--version"]).stdout;
    assert!(long.lines().any(|line| line.starts_with("features: effects")), "{long}");
    let short = drapery(folder.path(), &["-V"]).stdout;
    assert_eq!(short.lines().count(), 1, "{short}");
}

/// A sheet that hangs by two corners, and one that lies on a ball.
fn planned_scenes() -> [String; 2] {
    let hung = r#"drapery = 1
[shot]
frames = "0-12"
[gravity]
[self_repulsion]
[self_collision]
[[garment]]
name = "sheet"
panel = { resolution = 20, side = 1.0, aspect = 1.0, center = [0, 0.52, 0] }
density = 0.2
[garment.stretch]
stiffness = "1000 N/m"
[garment.dihedral_bending]
stiffness = "10 µN·m"
"#;
    let pins = "[[garment.pin]]\ncorners = [\"i0j0\", \"inj0\"]\n";
    let ball = r#"[[body]]
name = "ground"
shape = { half_space = {} }
[[body]]
name = "ball"
shape = { sphere = { radius = 0.25 } }
position = [0, 0.25, 0]
friction = 0.3
"#;
    [format!("{hung}{pins}"), hung.replace("[[garment]]", &format!("{ball}[[garment]]"))]
}

#[test]
fn a_plan_expects_what_runs_count_within_a_factor_of_three_or_the_least_of_it() {
    for (scene, touches) in planned_scenes().iter().zip([false, true]) {
        for integrator in ["tr_bdf2", "semi_implicit"] {
            let folder = folder_with(scene);
            let setting = format!("solver.integrator=\"{integrator}\"");
            let plan = drapery(folder.path(), &["plan", "scene.toml", "--json", "--set", &setting]);
            let plan: Value = serde_json::from_str(&plan.stdout).unwrap_or_else(|e| panic!("{e}\n{}", plan.stderr));
            let expected = &plan["frame"]["estimate"];
            let parts = expected["parts"].as_object().unwrap();
            let sum: f64 = parts.values().map(|seconds| seconds.as_f64().unwrap()).sum();
            assert!((sum / expected["seconds"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{expected:#}");
            assert_eq!(expected["in_contact"], touches, "{expected:#}");
            // Contact makes long steps again, as often as nobody knows before.
            let is_least = touches && integrator == "tr_bdf2";
            assert_eq!(expected["is_least"], is_least, "{expected:#}");
            let text = drapery(folder.path(), &["plan", "scene.toml", "--set", &setting]).stdout;
            assert_eq!(text.contains("in contact, on one core: at least "), is_least, "{text}");
            assert_eq!(text.contains("within a factor of two"), !is_least, "{text}");
            let cause = plan["frame"]["from"].as_str().unwrap();
            assert_eq!(cause.contains("solver.steps_per_frame"), integrator == "tr_bdf2", "{cause}");
            assert_eq!(parts.contains_key("bodies"), touches, "{expected:#}");

            let run = drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q", "--set", &setting]);
            assert_eq!(run.code, Some(0), "{}", run.stderr);
            let record = std::fs::read_to_string(folder.path().join("out/run.jsonl")).unwrap();
            let lines: Vec<Value> = record.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
            let frames: Vec<&Value> = lines.iter().filter(|line| line["record"] == "frame").collect();
            let mean = |of: &dyn Fn(&Value) -> &Value| {
                frames.iter().map(|frame| of(frame).as_f64().unwrap()).sum::<f64>() / frames.len() as f64
            };
            // A part of a frame that is expected to be the longest takes most of it: solves do, by far.
            let longest = parts.iter().max_by(|a, b| a.1.as_f64().unwrap().total_cmp(&b.1.as_f64().unwrap())).unwrap();
            assert_eq!(longest.0, "solves", "{expected:#}");
            let found = [
                ("steps", mean(&|frame| &frame["steps"])),
                ("solves", mean(&|frame| &frame["counts"]["cg_solves"])),
                ("iterations", mean(&|frame| &frame["cg_iterations"])),
                ("collision_steps", mean(&|frame| &frame["counts"]["collision_steps"])),
            ];
            for (name, found) in found {
                let factor = expected[name].as_f64().unwrap() / found;
                let bar = if is_least { 0.0..=1.5 } else { 1.0 / 3.0..=3.0 };
                assert!(bar.contains(&factor), "{integrator}, {touches}, {name}: {factor} of {found}");
            }
        }
    }
}

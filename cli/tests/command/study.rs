//! Studies of a tiny scene: what is found, what is written, what is not done twice, and that time limits hold.

use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::{command, drapery, folder_with};

/// A sheet that hangs by two corners and swings down.
const HANGING: &str = r#"drapery = 1
[parameters]
resolution = 8
[shot]
name = "hanging"
frames = "1001-1012"
[gravity]
[[garment]]
name = "sheet"
panel = { resolution = "$resolution", side = 1.0, center = [0, 1.5, 0] }
density = "0.15 kg/m²"
[garment.stretch]
stiffness = "100 N/m"
[[garment.pin]]
corners = ["i0j0", "inj0"]
"#;

const STUDY: [&str; 9] = ["study", "scene.toml", "--frames", "1001-1008", "--out", "s", "--threads", "1", "--copies=1"];

fn record(folder: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("s/study.json")).unwrap()).unwrap()
}

/// Everything of the samples that does not depend on the clock: what they are, and how far they are from others.
fn errors(record: &Value) -> Vec<Value> {
    let samples = record["samples"].as_array().unwrap();
    let of = |sample: &Value| {
        let own =
            ["setting", "copy", "figures", "from_reference", "from_base", "counts"].map(|key| sample[key].clone());
        Value::Array(own.into())
    };
    samples.iter().filter(|sample| sample["repeat"] == 0).map(of).collect()
}

#[test]
fn errors_of_a_smooth_scene_fall_with_the_step_and_come_out_the_same_again() {
    let folder = folder_with(HANGING);
    // Solves to the end: with the scene's own tolerance it is that which decides.
    let vary = ["--vary", "cfl=2,1,0.5", "--repeats=1", "--set", "solver.cg_tolerance=1e-9"];
    let study = drapery(folder.path(), &[&STUDY[..], &vary].concat());
    assert_eq!(study.code, Some(0), "{}", study.stderr);
    for word in ["setting", "cfl 0.5", "order of convergence", "wrote s/study.csv", "wrote s/report.html"] {
        assert!(study.stdout.contains(word), "{}", study.stdout);
    }
    let first = record(folder.path());
    let last = |label: &str| {
        let samples = first["samples"].as_array().unwrap();
        let sample = samples.iter().find(|sample| sample["setting"]["label"] == label).unwrap();
        sample["from_reference"].as_array().unwrap().last().unwrap()["rms"].as_f64().unwrap()
    };
    let errors_of: Vec<f64> = ["as the scene", "cfl 2", "cfl 1", "cfl 0.5"].map(last).into();
    // Of second order: a quarter of the error for half the step, here at least less than half.
    assert!(errors_of.windows(2).all(|pair| pair[1] < 0.5 * pair[0]), "{errors_of:?}");
    // The own error of the reference is given, and is a small part of them.
    let own = first["own_error"].as_array().unwrap().last().unwrap().as_f64().unwrap();
    assert!(own < 0.1 * errors_of[1], "{own} {errors_of:?}");
    let again = drapery(folder.path(), &[&STUDY[..], &vary, &["--overwrite", "-q"]].concat());
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    assert!(errors(&first) == errors(&record(folder.path())), "another run has other errors");
}

#[test]
fn settings_of_both_integrators_converge_to_one_motion_and_stand_on_one_front() {
    let folder = folder_with(HANGING);
    let tight = ["--repeats=1", "--set", "solver.cg_tolerance=1e-9"];
    let vary = ["--vary", "steps_per_frame=4,8,16,32", "--budget=1000s/frame", "--write-preset", "p.toml"];
    let study = drapery(folder.path(), &[&STUDY[..], &vary, &tight].concat());
    assert_eq!(study.code, Some(0), "{}", study.stderr);
    // The reference has short steps, as the scene has.
    let found = record(folder.path());
    let samples = found["samples"].as_array().unwrap();
    let of = |label: &str| samples.iter().find(|sample| sample["setting"]["label"] == label).unwrap();
    let last = |label: &str| of(label)["from_reference"].as_array().unwrap().last().unwrap()["rms"].as_f64().unwrap();
    let long = ["4", "8", "16", "32"].map(|steps| format!("integrator tr_bdf2, steps_per_frame {steps}"));
    let errors_of = long.each_ref().map(|label| last(label));
    // Of second order: a quarter of the error for half the step, here at least less than half.
    assert!(errors_of.windows(2).all(|pair| pair[1] < 0.5 * pair[0]), "{errors_of:?}");
    assert!(long.iter().all(|label| of(label)["role"] == "accuracy"), "{found:#}");
    // With all the time of the world the nearest to the reference is recommended, whatever its integrator.
    let all = errors_of.iter().copied().chain([last("as the scene")]);
    let nearest = all.fold(f64::INFINITY, f64::min);
    let preset = std::fs::read_to_string(folder.path().join("p.toml")).unwrap();
    let is_long = preset.contains("\"solver.steps_per_frame\" = \"32\"");
    assert_eq!(is_long, errors_of[3] == nearest, "{errors_of:?}\n{preset}");
    // A scene with long steps is compared with more of them.
    let vary = ["--vary", "integrator=semi_implicit", "--set", "solver.preset=production", "--overwrite"];
    let study = drapery(folder.path(), &[&STUDY[..], &vary, &tight].concat());
    assert_eq!(study.code, Some(0), "{}", study.stderr);
    let found = record(folder.path());
    let samples = found["samples"].as_array().unwrap();
    let reference = samples.iter().find(|sample| sample["role"] == "reference").unwrap();
    assert_eq!(reference["setting"]["changes"][0], serde_json::json!(["steps_per_frame", "128"]));
    assert!(samples.iter().any(|sample| sample["setting"]["label"] == "integrator semi_implicit"), "{found:#}");
}

#[test]
fn pages_are_written_again_to_the_same_bytes_from_the_record_alone() {
    let folder = folder_with(HANGING);
    let study =
        drapery(folder.path(), &[&STUDY[..], &["--vary", "cfl=2", "--repeats=1", "--budget=1s/frame"]].concat());
    assert_eq!(study.code, Some(0), "{}", study.stderr);
    let pages = || ["s/report.html", "s/study.csv"].map(|name| std::fs::read(folder.path().join(name)).unwrap());
    let before = pages();
    for name in ["scene.toml", "s/report.html", "s/study.csv"] {
        std::fs::remove_file(folder.path().join(name)).unwrap();
    }
    let again = drapery(folder.path(), &["study", "--from", "s/study.json"]);
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    assert!(pages() == before);
    // What is printed is the same, too, but for the runs.
    let table = study.stdout.split_once("\nstudy hanging").unwrap().1;
    assert!(again.stdout.ends_with(table), "{}", again.stdout);
}

#[test]
fn a_study_that_is_run_again_goes_on_and_does_nothing_twice() {
    let folder = folder_with(HANGING);
    let arguments = [&STUDY[..], &["--vary", "cfl=2", "--repeats=2"]].concat();
    assert_eq!(drapery(folder.path(), &arguments).code, Some(0));
    let whole = record(folder.path());
    // As if it had been stopped before the last three runs.
    let mut shorter = whole.clone();
    let all = shorter["samples"].as_array().unwrap().len();
    shorter["samples"].as_array_mut().unwrap().truncate(all - 3);
    std::fs::write(folder.path().join("s/study.json"), shorter.to_string()).unwrap();
    let rest = drapery(folder.path(), &arguments);
    assert_eq!(rest.code, Some(0), "{}", rest.stderr);
    assert_eq!(rest.stdout.lines().filter(|line| line.starts_with("run ")).count(), 3, "{}", rest.stdout);
    assert!(errors(&whole) == errors(&record(folder.path())), "what was there has changed");
    let nothing = drapery(folder.path(), &arguments);
    assert!(!nothing.stdout.contains("run 1 of"), "{}", nothing.stdout);
    // Another question is another study.
    let other = drapery(folder.path(), &[&STUDY[..], &["--vary", "cfl=1", "--repeats=2"]].concat());
    assert_eq!(other.code, Some(73), "{}", other.stderr);
    assert!(other.stderr.contains("--overwrite"), "{}", other.stderr);
}

#[test]
fn a_study_takes_no_longer_than_its_limit_and_says_what_is_missing() {
    // Where the machine is so loaded that a second passes between two lines of the program, only a longer limit can be kept.
    let kept = [3, 12, 48, 192].into_iter().find_map(|limit| {
        let folder = folder_with(HANGING);
        let watch = Instant::now();
        let limit_text = format!("{limit}s");
        // Far more than fits: thousands of times the steps.
        let vary = ["--vary", "cfl=2,0.0004,0.0002", "--max-wall", &limit_text];
        let study =
            command(folder.path(), &[&["study", "scene.toml", "--out", "s"], &vary[..]].concat()).output().unwrap();
        assert_eq!(study.status.code(), Some(0), "{}", String::from_utf8_lossy(&study.stderr));
        // The start of the program is not part of the study.
        (watch.elapsed() < Duration::from_secs(limit + 1)).then_some((folder, study))
    });
    let (folder, study) = kept.expect("a limit that is kept");
    let text = String::from_utf8_lossy(&study.stdout).into_owned();
    assert!(text.contains("skipped because of the time limit: ") && text.contains("wrote s/report.html"), "{text}");
    assert!(record(folder.path())["samples"].as_array().is_some_and(|samples| !samples.is_empty()));
}

#[test]
fn threads_and_repeats_are_found_to_change_no_bit_and_combinations_are_drawn() {
    let folder = folder_with(HANGING);
    let vary = ["--vary", "threads=2", "cfl=2,1", "without=gravity", "--repeats=2"];
    let study = drapery(folder.path(), &[&STUDY[..], &vary].concat());
    assert_eq!(study.code, Some(0), "{}", study.stderr);
    assert!(study.stdout.contains("threads 2: time x") && study.stdout.contains("the same bits"), "{}", study.stdout);
    let page = std::fs::read_to_string(folder.path().join("s/report.html")).unwrap();
    assert!(page.contains("3 repeats, 1 with a different number of threads"));
    let samples = record(folder.path())["samples"].as_array().unwrap().clone();
    let bits = |label: &str| -> Vec<String> {
        let of = samples.iter().filter(|sample| sample["setting"]["label"] == label && sample["copy"] == 0);
        of.map(|sample| sample["bits"].as_str().unwrap().to_owned()).collect()
    };
    let base = bits("as the scene");
    assert!(base.len() == 2 && base[0] == base[1] && base[0].len() == 16, "{base:?}");
    assert_eq!(bits("threads 2")[0], base[0]);
    // Without its weight the sheet does not move: it is left out as `--without` leaves it out.
    assert!(bits("without gravity")[0] != base[0]);
    let vary = ["--vary", "cfl=2,1", "solver.strain_per_step=0.1,0.05", "--latin=4", "--repeats=1", "--overwrite"];
    let latin = drapery(folder.path(), &[&STUDY[..], &vary].concat());
    assert_eq!(latin.code, Some(0), "{}", latin.stderr);
    let both = |line: &&str| line.contains("cfl ") && line.contains("strain_per_step ") && !line.starts_with("run ");
    assert!(latin.stdout.lines().filter(both).count() >= 2, "{}", latin.stdout);
}

#[test]
fn the_error_of_a_recommended_setting_holds_in_another_scene_within_a_factor_of_two() {
    let folder = folder_with(HANGING);
    let vary = ["--vary", "cfl=2,1,0.5", "--repeats=1", "--budget=1s/frame", "--set", "solver.cg_tolerance=1e-9"];
    let preset = ["--write-preset", "preset.toml"];
    let study = drapery(folder.path(), &[&STUDY[..], &vary, &preset].concat());
    assert_eq!(study.code, Some(0), "{}", study.stderr);
    let label = study.stdout.split_once("recommended within").unwrap().1.split('"').nth(1).unwrap().to_owned();
    let rms = |record: &Value| {
        let samples = record["samples"].as_array().unwrap();
        let sample = samples.iter().find(|sample| sample["setting"]["label"] == label.as_str()).unwrap();
        let squares: Vec<f64> =
            sample["from_reference"].as_array().unwrap().iter().map(|d| d["rms"].as_f64().unwrap().powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let claimed = rms(&record(folder.path()));
    // Another sheet: larger, heavier, softer in proportion, hung up at the same corners.
    let other = HANGING.replace("side = 1.0", "side = 1.2").replace("0.15 kg/m²", "0.2 kg/m²");
    std::fs::write(folder.path().join("scene.toml"), other).unwrap();
    let held_out = drapery(folder.path(), &[&STUDY[..], &vary, &["--overwrite"]].concat());
    assert_eq!(held_out.code, Some(0), "{}", held_out.stderr);
    let found = rms(&record(folder.path()));
    assert!(found < 2.0 * claimed && claimed < 2.0 * found, "claimed {claimed}, found {found} with {label}");
}

#[test]
fn what_cannot_be_studied_is_said() {
    let folder = folder_with(HANGING);
    let without = drapery(folder.path(), &[&STUDY[..], &["--vary", "without=wind", "--repeats=1"]].concat());
    assert_eq!(without.code, Some(78), "{}", without.stderr);
    assert!(without.stderr.contains("does not ask for `wind`"), "{}", without.stderr);
    let key = drapery(folder.path(), &["study", "scene.toml", "--out", "t", "--vary", "solver.clf=1"]);
    assert_eq!(key.code, Some(78), "{}", key.stderr);
    assert_eq!(drapery(folder.path(), &["study", "scene.toml", "--vary", "cfl"]).code, Some(2));
    assert_eq!(drapery(folder.path(), &["study"]).code, Some(2));
    let nothing = drapery(folder.path(), &["study", "--from", "nothing.json"]);
    assert_eq!(nothing.code, Some(66), "{}", nothing.stderr);
}

#[test]
fn a_study_without_a_recommendation_prints_its_table_and_says_why_no_preset_is_written() {
    let folder = folder_with(HANGING);
    let vary = ["--vary", "cfl=2,1", "--repeats=1", "--budget=0.000001s/frame", "--write-preset", "preset.toml"];
    let study = drapery(folder.path(), &[&STUDY[..], &vary].concat());
    assert_eq!(study.code, Some(2), "{}", study.stderr);
    for word in ["setting", "cfl 2", "no recommendation: ", "wrote s/study.csv"] {
        assert!(study.stdout.contains(word), "{word}: {}", study.stdout);
    }
    for word in ["preset.toml: no setting is recommended", "no recommendation: no measured setting", "--budget"] {
        assert!(study.stderr.contains(word), "{word}: {}", study.stderr);
    }
    assert!(!folder.path().join("preset.toml").exists());
}

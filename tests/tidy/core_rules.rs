//! Bans on files, environment, prints, clocks, orders of hash maps and stray small numbers in the solver.

use crate::tree::{SourceFile, report, rust_files};
use drapery_tests::source_text::{code_only, small_numbers, without_tests};

/// Names that may not appear in the solver, each with the reason.
const FORBIDDEN: [(&str, &str); 9] = [
    ("std::fs", "the solver reads and writes no files"),
    ("std::env", "the environment may not change a result"),
    ("std::net", "the solver talks to nobody"),
    ("println!", "libraries never print"),
    ("print!", "libraries never print"),
    ("Instant", "only clock.rs has a clock"),
    ("SystemTime", "only clock.rs has a clock"),
    ("HashMap", "its order is not fixed"),
    ("HashSet", "its order is not fixed"),
];

/// The only file with a clock.
const CLOCK: &str = "core/src/clock.rs";

/// Functions of the system's mathematical library, which takes others on another processor; sums, products and square roots are the
/// same everywhere.
const OF_THE_SYSTEM: [&str; 27] = [
    ".sin(",
    ".cos(",
    ".tan(",
    ".sin_cos(",
    ".asin(",
    ".acos(",
    ".atan(",
    ".atan2(",
    ".sinh(",
    ".cosh(",
    ".tanh(",
    ".asinh(",
    ".exp(",
    ".exp2(",
    ".exp_m1(",
    ".ln(",
    ".ln_1p(",
    ".log(",
    ".log2(",
    ".log10(",
    ".powf(",
    ".cbrt(",
    ".hypot(",
    ".slerp(",
    "from_scaled_axis",
    "from_axis_angle",
    "Quaternion::rotation_between",
];

/// The only file in which bytes of messages become values, or end the run: `pod_collect_to_vec` fills up a broken one.
const DECODING: (&str, &str) = ("core/src/parallel/message.rs", "pod_collect_to_vec");

/// The only files with small numbers.
const TOLERANCES: [&str; 4] = [
    "core/src/tolerances.rs",
    "core/src/long_steps.rs",
    "core/src/contact/tolerances.rs",
    "core/src/geometry/tolerances.rs",
];

/// Small numbers elsewhere: file, number, and why it is no tolerance.
const EXCEPTIONS: [(&str, &str, &str); 7] = [
    ("core/src/settings/dimension.rs", "1e-6", "a micronewton metre"),
    (
        "core/src/settings/dimension.rs",
        "9.80665e-5",
        "a gram-force square centimetre over a centimetre in newton metres",
    ),
    ("core/src/settings/dimension.rs", "1e-2", "a centimetre"),
    ("core/src/settings/dimension.rs", "1e-3", "a millimetre, a gram, a millisecond"),
    ("core/src/settings/dimension.rs", "9.80665e-3", "a gram-force in newtons"),
    ("core/src/settings.rs", "1e-3", "numbers below are shown with an exponent"),
    ("core/src/simulation/collision_step.rs", "1e-2", "cap of the automatic setting solver.cg_tolerance"),
];

/// Parts of the row of a setting, whose range and default a scene chooses by.
const FIELD: [&str; 2] = ["range: (", " range ("];

fn solver_files() -> Vec<SourceFile> {
    let is_test = |name: &str| name.ends_with("/tests.rs") || name.ends_with("/testing.rs") || name.contains("/tests/");
    rust_files().into_iter().filter(|f| f.name.starts_with("core/src/") && !is_test(&f.name)).collect()
}

#[test]
fn the_solver_reads_no_files_prints_nothing_and_has_one_clock() {
    let mut complaints = Vec::new();
    for file in solver_files() {
        let code = code_only(&file.text);
        let code = without_tests(&code);
        for (word, why) in FORBIDDEN {
            let is_clock = file.name == CLOCK && word == "Instant";
            if code.contains(word) && !is_clock {
                complaints.push(format!("{}: {word}: {why}", file.name));
            }
        }
    }
    report(&complaints);
}

#[test]
fn results_depend_on_no_function_of_the_mathematical_library() {
    let readers = rust_files().into_iter().filter(|f| f.name.starts_with("io/src/") && !f.name.ends_with("tests.rs"));
    let mut complaints = Vec::new();
    for file in solver_files().into_iter().chain(readers) {
        let code = code_only(&file.text);
        let code = without_tests(&code);
        let found = OF_THE_SYSTEM.iter().filter(|name| code.contains(**name));
        complaints.extend(found.map(|name| format!("{}: {name}: use libm or geometry::rotation", file.name)));
    }
    report(&complaints);
}

#[test]
fn messages_are_decoded_where_broken_ones_end_the_run() {
    let (place, word) = DECODING;
    let strays = solver_files().into_iter().filter(|f| f.name != place);
    let strays = strays.filter(|f| without_tests(&code_only(&f.text)).contains(word));
    report(&strays.map(|f| format!("{}: {word}: use parallel::message::values", f.name)).collect::<Vec<_>>());
}

#[test]
fn small_numbers_stand_in_the_tables_of_tolerances() {
    let mut complaints = Vec::new();
    let mut used = [false; EXCEPTIONS.len()];
    for file in solver_files().iter().filter(|f| !TOLERANCES.contains(&f.name.as_str())) {
        let code = code_only(&file.text);
        let is_of_field =
            |line: usize| code.lines().nth(line - 1).is_some_and(|text| FIELD.iter().any(|part| text.contains(part)));
        for (line, number) in small_numbers(without_tests(&code)).into_iter().filter(|(line, _)| !is_of_field(*line)) {
            match EXCEPTIONS.iter().position(|(name, allowed, _)| *name == file.name && *allowed == number) {
                Some(exception) => used[exception] = true,
                None => complaints.push(format!("{}:{line}: {number} belongs into tolerances.rs", file.name)),
            }
        }
    }
    let idle = EXCEPTIONS.iter().zip(used).filter(|(_, used)| !used);
    complaints
        .extend(idle.map(|((file, number, _), _)| format!("{file} no longer has {number}: remove the exception")));
    report(&complaints);
}

#[test]
fn every_tolerance_says_which_test_guards_it() {
    let all: String = rust_files().into_iter().map(|f| f.text).collect();
    let mut complaints = Vec::new();
    for file in rust_files().iter().filter(|f| TOLERANCES.contains(&f.name.as_str())) {
        let comments: String = file.text.lines().filter_map(|line| line.strip_prefix("///")).collect();
        for name in comments.split('`').skip(1).step_by(2).filter(|name| name.matches('_').count() >= 3) {
            if !all.contains(&format!("fn {name}(")) {
                complaints.push(format!("{}: no test is called {name}", file.name));
            }
        }
    }
    report(&complaints);
}

/// Files that name an integrator, with the number of times and the reason; all others read its row.
const NAME_AN_INTEGRATOR: [(&str, usize, &str); 4] = [
    ("core/src/scene/solver.rs", 3, "the presets"),
    ("core/src/step/mod.rs", 2, "the listings"),
    ("core/src/simulation/estimate.rs", 1, "the step that elastic forces would allow if they were explicit"),
    ("analysis/src/study/vary.rs", 2, "the two words that a study compares"),
];

/// The rows of the integrators.
const INTEGRATORS: &str = "core/src/scene/integrator.rs";

#[test]
fn what_an_integrator_asks_of_others_is_in_its_row() {
    let mut complaints = Vec::new();
    let is_test = |name: &str| name.contains("/tests") || name.starts_with("tests/") || name.contains("/benches/");
    for file in rust_files().iter().filter(|file| file.name != INTEGRATORS && !is_test(&file.name)) {
        let code = code_only(&file.text);
        let code = without_tests(&code);
        let found = ["Integrator::SemiImplicit", "Integrator::TrBdf2"].map(|word| code.matches(word).count());
        let allowed = NAME_AN_INTEGRATOR.iter().find(|(name, ..)| *name == file.name).map_or(0, |(_, count, _)| *count);
        if found[0] + found[1] > allowed {
            let what = "names an integrator more often than is allowed: read `Integrator::spec` instead";
            complaints.push(format!("{}: {what}", file.name));
        }
    }
    report(&complaints);
}

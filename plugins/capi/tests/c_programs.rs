//! Programs in C and C++ are built against the header and the libraries and run under AddressSanitizer; the header is the one
//! that the source makes, and nothing of an earlier one is gone.
//!
//! Compilers are those that `CC` and `CXX` name, else `cc` and `c++`; without one the tests of programs say so and end.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_io::checkpoint::Checkpoint;
use drapery_io::input_file;
use drapery_shot::run::{FrameReport, RunOptions};
use drapery_shot::scene_source::SceneSource;
use drapery_shot::session::Session;

const HEADER: &str = "include/drapery.h";

/// File of the declarations of version 1 of the interface, one a line. Members of structures are part of it.
const ABI_1: &str = "tests/abi_1.txt";

/// A cloth over a table that the program moves.
const SCENE: &str = "drapery = 1\n[parameters]\nresolution = 4\n[shot]\nname = \"table\"\nframes = \"1001-1004\"\n\
                     preroll = { settle = 1, blend = 0 }\n[gravity]\n[self_repulsion]\n[self_collision]\n\
                     [[body]]\nname = \"table\"\nfile = \"memory:table\"\n\
                     [[garment]]\nname = \"cloth\"\nmaterial = \"cotton_shirting\"\n\
                     panel = { resolution = \"$resolution\", side = 0.8, aspect = 1, center = [0, 0.01, 0] }\n";

fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    input_file::text(&folder().join(path)).unwrap_or_else(|e| panic!("{e}"))
}

/// Compares a file with what it should be; with `DRAPERY_BLESS=1` writes it.
fn fresh(path: &str, expected: &str) {
    if std::env::var_os("DRAPERY_BLESS").is_some() {
        std::fs::write(folder().join(path), expected).expect("it can be written");
    }
    assert!(
        read(path) == expected,
        "{path} is not that of the source: DRAPERY_BLESS=1 with the same command writes it"
    );
}

/// The header that the source makes.
fn generated() -> String {
    let config = cbindgen::Config::from_file(folder().join("cbindgen.toml")).expect("a configuration");
    // The modules that it lists are read with it.
    let builder = cbindgen::Builder::new().with_config(config).with_src(folder().join("src/lib.rs"));
    let mut text = Vec::new();
    builder.generate().expect("the source can be read").write(&mut text);
    let text = String::from_utf8(text).expect("C is text");
    text.replace("# Safety\n", "What the caller promises:\n")
}

/// Returns the declarations of a header, each on a line with single blanks: codes, structures with their members, types and
/// functions.
fn declarations(header: &str) -> BTreeSet<String> {
    let mut code = String::new();
    for (number, piece) in header.split("/*").enumerate() {
        code += if number == 0 { piece } else { piece.split_once("*/").map_or("", |(_, rest)| rest) };
    }
    let (directives, lines): (Vec<&str>, Vec<&str>) = code.lines().partition(|line| line.starts_with('#'));
    let mut found: BTreeSet<String> = directives
        .into_iter()
        .filter(|line| line.starts_with("#define DRAPERY_") && line.contains(' '))
        .map(str::to_owned)
        .collect();
    let (mut depth, mut declaration) = (0, String::new());
    for c in lines.join(" ").replace("extern \"C\" {", "").chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ';' && depth == 0 {
            let words = declaration.split_whitespace().collect::<Vec<_>>().join(" ").replace("( ", "(");
            assert!(!found.contains(&words), "declared twice: {words}");
            found.insert(words);
            declaration.clear();
        } else {
            declaration.push(c);
        }
    }
    found.retain(|line| line != "#define DRAPERY_H" && line.contains("drapery_") | line.starts_with('#'));
    found
}

#[test]
fn the_header_is_that_of_the_source() {
    fresh(HEADER, &generated());
}

#[test]
fn nothing_that_an_earlier_header_of_the_same_version_promises_is_gone() {
    let now = declarations(&generated());
    assert!(now.len() > 30, "{now:?}");
    let earlier: BTreeSet<String> = read(ABI_1).lines().map(str::to_owned).collect();
    let gone: Vec<&String> = earlier.difference(&now).collect();
    assert!(gone.is_empty(), "gone or changed, which needs another version of the interface: {gone:#?}");
    // New ones are written down, so that they stay, too.
    fresh(ABI_1, &now.iter().map(|line| format!("{line}\n")).collect::<String>());
}

/// A compiler, if there is one.
fn compiler(variable: &str, default: &str) -> Option<String> {
    let name = std::env::var(variable).unwrap_or_else(|_| default.to_owned());
    let works = Command::new(&name).arg("--version").output().is_ok_and(|output| output.status.success());
    if !works {
        println!("skipped: no {name}");
    }
    works.then_some(name)
}

/// Folder of the libraries, beside this test's own executable.
fn libraries() -> PathBuf {
    let own = std::env::current_exe().expect("this program has a path");
    own.parent().expect("it lies in a folder").to_owned()
}

/// Returns the options that link the system libraries needed with the static library.
fn system_libraries() -> Vec<String> {
    let found = Command::new("pkg-config").args(["--libs", "hdf5"]).output();
    let hdf5 = found.ok().filter(|output| output.status.success());
    let hdf5 = hdf5.map_or("-lhdf5".to_owned(), |output| String::from_utf8_lossy(&output.stdout).into_owned());
    hdf5.split_whitespace().chain(["-lm", "-lpthread", "-ldl"]).map(str::to_owned).collect()
}

/// Builds a program with all warnings as errors, under AddressSanitizer.
fn build(compiler: &str, flags: &[&str], source: &Path, program: &Path) {
    let mut command = Command::new(compiler);
    command.args(flags).args(["-Wall", "-Wextra", "-Werror", "-g", "-fsanitize=address,undefined"]);
    command.arg("-I").arg(folder().join("include")).arg(source).arg("-o").arg(program);
    command.arg(libraries().join("libdrapery_c.a")).args(system_libraries());
    ends_well(&mut command);
}

/// Runs a command; returns what it prints.
fn ends_well(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let [out, err] = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{command:?}: {}\n{out}{err}", output.status);
    out
}

/// Returns the points of the programs' table at a frame [m].
fn table(frame: i64) -> Vec<Vec3> {
    let y = -0.02 + 0.01 * (frame - 1001) as f64;
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
    let mut points: Vec<Vec3> = corners.iter().map(|[x, z]| Vec3::new(0.3 * x, y, 0.3 * z)).collect();
    points.push(Vec3::new(0.0, -0.5, 0.0));
    points
}

/// The scene of the programs.
fn source() -> SceneSource {
    let corners = vec![0, 1, 2, 3, 1, 0, 4, 2, 1, 4, 3, 2, 4, 0, 3, 4];
    let mesh = PolygonMesh { points: table(1001), face_counts: vec![4, 3, 3, 3, 3], face_indices: corners };
    let mut source = SceneSource::text(SCENE, "table.toml", "");
    source.settings.push(("resolution".into(), "9".into()));
    source.meshes.insert("table", mesh).expect("a mesh");
    source
}

#[test]
fn a_program_in_c_has_the_bits_of_a_run_and_survives_its_own_mistakes() {
    let Some(cc) = compiler("CC", "cc") else { return };
    let place = tempfile::tempdir().expect("a folder");
    let (program, scene) = (place.path().join("steps"), place.path().join("table.toml"));
    std::fs::write(&scene, SCENE).expect("it can be written");
    build(&cc, &["-std=c11"], &folder().join("tests/programs/steps.c"), &program);
    let said = ends_well(Command::new(&program).arg(place.path()).arg(&scene));
    assert!(said.contains("all is well"), "{said}");
    let checkpoint = |path: &Path| Checkpoint::read(path).unwrap_or_else(|e| panic!("{e}"));
    // What it has stepped, against a session that never paused; what it has run, against a run.
    let mut session = Session::new(source().prepare(None).expect("a scene"));
    for frame in 1001..=1004 {
        session.move_body(0, &table(frame)).expect("a body");
        session.next_frame(&mut || false).expect("a frame");
    }
    let own = place.path().join("own.h5");
    session.save_file(&own).expect("it can be written");
    assert!(checkpoint(&own).snapshot == checkpoint(&place.path().join("state.h5")).snapshot);
    let options = RunOptions::new(place.path().join("own_run"));
    source().prepare(None).expect("a scene").run(&options, &mut |_: &FrameReport<'_>| {}).expect("a run");
    let [run, own] =
        ["run", "own_run"].map(|name| checkpoint(&place.path().join(name).join("checkpoints/frame_01004.h5")));
    assert!(run.snapshot == own.snapshot);
    let [run, own] = ["run", "own_run"].map(|name| std::fs::read(place.path().join(name).join("cloth.abc")));
    assert!(run.expect("a cache") == own.expect("a cache"));
}

#[test]
fn the_node_in_cpp_feeds_a_body_live() {
    let Some(cxx) = compiler("CXX", "c++") else { return };
    let place = tempfile::tempdir().expect("a folder");
    let program = place.path().join("node");
    build(&cxx, &["-std=c++17"], &folder().join("examples/live_node.cpp"), &program);
    let said = ends_well(&mut Command::new(&program));
    // Cloth of 0.5 kg/m² on a plate that rises by 1 cm a frame for ten frames lies on it at the end.
    let lowest: Vec<f64> = said.lines().filter_map(|line| line.rsplit(' ').nth(1)?.parse().ok()).collect();
    assert!(lowest.len() == 24 && (0.1..0.11).contains(&lowest[23]), "{said}");
    assert!(said.contains("frame 12 again: the same bits"), "{said}");
}

#[test]
fn the_shared_library_has_every_symbol_of_version_1_and_pkg_config_finds_it() {
    let Some(cc) = compiler("CC", "cc") else { return };
    let place = tempfile::tempdir().expect("a folder");
    let mut install = Command::new(folder().join("install.sh"));
    ends_well(install.arg(libraries()).arg(place.path()));
    let names: Vec<String> = read(ABI_1).lines().filter_map(name_of).collect();
    let declared: String = names.iter().map(|name| format!("extern void {name}(void);\n")).collect();
    let used: String = names.iter().map(|name| format!("    n += (void *){name} != 0;\n")).collect();
    let code = format!("{declared}int main(void)\n{{\n    int n = 0;\n{used}    return n != {};\n}}\n", names.len());
    let (source, program) = (place.path().join("symbols.c"), place.path().join("symbols"));
    std::fs::write(&source, code).expect("it can be written");
    let mut flags = Command::new("pkg-config");
    flags.args(["--cflags", "--libs", "drapery_c"]).env("PKG_CONFIG_PATH", place.path().join("lib/pkgconfig"));
    let flags = ends_well(&mut flags);
    let mut link = Command::new(&cc);
    link.arg("-Wno-address").arg(&source).arg("-o").arg(&program).args(flags.split_whitespace());
    ends_well(&mut link);
    ends_well(Command::new(&program).env("LD_LIBRARY_PATH", place.path().join("lib")));
}

/// The function that a declaration declares, if it is one.
fn name_of(declaration: &str) -> Option<String> {
    if declaration.starts_with(['#', 't']) {
        return None;
    }
    let name = declaration.split('(').next()?.rsplit([' ', '*']).next()?;
    Some(name.to_owned())
}

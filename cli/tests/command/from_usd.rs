//! Messages of the command about scenes with files of USD.

use std::fs;
use std::path::Path;

use crate::{drapery, folder_with};

/// A box that stands along Z in a file that says Y up, with samples of the frames 1 to 4 at 25 a second; its shape is in a file of
/// another folder.
const SHAPE: &str = r#"#usda 1.0
(
    defaultPrim = "hero"
    metersPerUnit = 0.01
    upAxis = "Y"
    timeCodesPerSecond = 25
)
def Mesh "hero"
{
    point3f[] points.timeSamples = {
        1: [(-80, -15, 0), (80, -15, 0), (80, 15, 0), (-80, 15, 0), (-80, -15, 170), (80, -15, 170), (80, 15, 170), (-80, 15, 170)],
        4: [(-80, -15, 0), (80, -15, 0), (80, 15, 0), (-80, 15, 0), (-80, -15, 170), (80, -15, 170), (80, 15, 170), (-80, 15, 170)],
    }
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]
    uniform token subdivisionScheme = "none"
}
"#;

const BODY: &str = "#usda 1.0\n(\n    defaultPrim = \"hero\"\n    metersPerUnit = 0.01\n    upAxis = \"Y\"\n    timeCodesPerSecond = 25\n    \
                    subLayers = [@../../base.usda@]\n)\n";

const SCENE: &str = "drapery = 1\n[shot]\nfps = \"25\"\nframes = \"1-3\"\n[gravity]\n[self_repulsion]\n[self_collision]\n\
                     [[garment]]\nname = \"sheet\"\npanel = { resolution = 4, center = [5, 1, 0] }\n\
                     material = \"cotton_shirting\"\n[[body]]\nname = \"hero\"\nfile = \"shots/010/hero.usda\"\n";

fn written(scene: &str) -> tempfile::TempDir {
    let folder = folder_with(scene);
    fs::write(folder.path().join("base.usda"), SHAPE).unwrap();
    fs::create_dir_all(folder.path().join("shots/010")).unwrap();
    fs::write(folder.path().join("shots/010/hero.usda"), BODY).unwrap();
    folder
}

fn base(folder: &Path) -> String {
    folder.canonicalize().unwrap().join("base.usda").display().to_string()
}

#[test]
fn the_line_for_a_wrong_up_axis_of_a_file_that_states_it_ends_the_warning() {
    let folder = written(SCENE);
    let seen = drapery(folder.path(), &["check", "scene.toml"]);
    assert_eq!(seen.code, Some(0), "{}", seen.stderr);
    let line = "units = { length = \"cm\", up = \"Z\" }";
    assert!(seen.stderr.contains("up_axis: body \"hero\": "), "{}", seen.stderr);
    assert!(seen.stderr.contains(&format!("help: write {line} at this body")), "{}", seen.stderr);
    let mended = written(&format!("{SCENE}{line}\n"));
    let seen = drapery(mended.path(), &["check", "scene.toml"]);
    assert!(seen.code == Some(0) && !seen.stderr.contains("up_axis"), "{}", seen.stderr);
}

#[test]
fn layers_of_other_folders_are_shown() {
    let folder = written(SCENE);
    let base = base(folder.path());
    let seen = drapery(folder.path(), &["check", "-v", "scene.toml"]);
    assert!(seen.stderr.contains(&base), "{}", seen.stderr);
    let seen = drapery(folder.path(), &["plan", "scene.toml"]);
    assert!(seen.stdout.contains(&format!("reads {base}, referenced by a file of the scene")), "{}", seen.stdout);
    let seen = drapery(folder.path(), &["info", "shots/010/hero.usda"]);
    assert!(seen.stdout.contains(&format!("layer outside of its folder: {base}")), "{}", seen.stdout);
    let seen = drapery(folder.path(), &["info", "base.usda"]);
    assert!(!seen.stdout.contains("outside of its folder"), "{}", seen.stdout);
}

#[test]
fn samples_that_do_not_reach_are_told_with_the_rate_of_the_file() {
    let folder = written(&SCENE.replace("\"25\"", "\"24\"").replace("1-3", "1-4"));
    let seen = drapery(folder.path(), &["check", "scene.toml"]);
    assert_eq!(seen.code, Some(65), "{}", seen.stderr);
    assert!(seen.stderr.contains("the file states 25 frames per second"), "{}", seen.stderr);
    assert!(seen.stderr.contains("write fps = \"25\" in [shot]"), "{}", seen.stderr);
}

#[test]
fn a_body_of_an_unlikely_size_whose_file_states_its_unit_is_told_to_write_units_of_its_own() {
    // 2 cm across by its file, whatever [units] says.
    let folder = written(&SCENE.replace("[[body]]", "[units]\nlength = \"m\"\n[[body]]"));
    fs::write(
        folder.path().join("shots/010/hero.usda"),
        BODY.replace("metersPerUnit = 0.01", "metersPerUnit = 0.0001"),
    )
    .unwrap();
    let seen = drapery(folder.path(), &["check", "scene.toml"]);
    assert_eq!(seen.code, Some(78), "{}", seen.stderr);
    assert!(!seen.stderr.contains("set units.length"), "{}", seen.stderr);
    for words in ["body \"hero\"", "write units = { length = ", "} at this body", "overrides [units]"] {
        assert!(seen.stderr.contains(words), "{words}: {}", seen.stderr);
    }
}

#[test]
fn a_render_mesh_in_another_unit_or_without_a_place_is_told_as_such() {
    let scene = "drapery = 1\n[shot]\nframes = \"1-2\"\n[units]\nlength = \"m\"\nup = \"Y\"\n[gravity]\n[self_repulsion]\n[self_collision]\n\
                 [[garment]]\nname = \"sheet\"\npanel = { resolution = 4, side = 1.0, aspect = 1.0, center = [0, 1, 0] }\n\
                 material = \"cotton_shirting\"\n[garment.render_mesh]\nfile = \"fine.obj\"\n";
    let folder = folder_with(scene);
    let square = |y: &str| format!("v -50 {y} -50\nv 50 100 -50\nv 50 100 50\nv -50 100 50\nf 1 4 3 2\n");
    fs::write(folder.path().join("fine.obj"), square("100")).unwrap();
    let seen = drapery(folder.path(), &["check", "scene.toml"]);
    let words = [
        "render_mesh_distance",
        "in centimetres it would have the size",
        "write units = { length = \"cm\", up = \"Y\" } in",
    ];
    assert!(seen.code == Some(0) && words.iter().all(|word| seen.stderr.contains(word)), "{}", seen.stderr);
    fs::write(folder.path().join("fine.obj"), square("nan")).unwrap();
    let seen = drapery(folder.path(), &["check", "scene.toml"]);
    assert_eq!(seen.code, Some(65), "{}", seen.stderr);
    assert!(
        seen.stderr.contains("render mesh: the position of point 0") && !seen.stderr.contains(": : "),
        "{}",
        seen.stderr
    );
}

#[test]
fn one_frame_is_one_time_code_and_verify_says_what_that_means() {
    let folder = written(&SCENE.replace("1-3", "2-2").replace("[[body]]", "[output]\nformat = [\"usd\"]\n[[body]]"));
    let run = drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let layer = fs::read_to_string(folder.path().join("out/sheet.usd")).unwrap();
    assert!(layer.contains("startTimeCode = 2\n") && layer.contains("endTimeCode = 2\n"), "{layer}");
    let seen = drapery(folder.path(), &["verify", "out/sheet.usd"]);
    assert!(seen.code == Some(0) && seen.stdout.contains("a single time code"), "{}{}", seen.stdout, seen.stderr);
}

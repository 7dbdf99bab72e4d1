//! Wind, pressure, seams, maps and breaking pins, from text to the solver's description; and the sample scenes.

use drapery_core::scene::{PinHold, SceneDescription};
use drapery_core::settings::SettingValue;

use super::*;

const SEWN: &str = r#"
drapery = 1
[shot]
frames = "1001-1024"
preroll = { settle = 12 }
[wind]
keys = [[0, [0, 0, 0]], [2, [6.0, 0, 1]]]
density = "1.2 kg/m³"
[self_repulsion]
[[garment]]
name = "left"
panel = { resolution = 4, aspect = 1.0, center = [-0.6, 1, 0] }
material = "cotton_shirting"
maps = { thickness = "file:thick.txt", wind = "file:thick.txt" }
absolute_maps = ["thickness"]
[[garment.pin]]
corners = ["i0j0"]
mode = "spring"
stiffness = "200 N/m"
break_force = "60 N"
[[garment]]
name = "right"
panel = { resolution = 4, aspect = 1.0, center = [0.6, 1, 0] }
material = "cotton_shirting"
[[seam]]
from = { garment = "left", where = { box = { min = [-0.2, 0, -1], max = [0, 2, 1] } } }
to = { garment = "right", vertices = [0, 5, 10, 15, 20] }
strength = "800 N/m"
"#;

fn resolve_in(folder: &FilePath, text: &str) -> Result<ShotDescription, String> {
    let scene = parse(text, "sewn.toml", folder, &[]).map_err(|error| error.to_string())?;
    scene.resolve().map_err(|errors| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
}

/// A folder with a map of 25 values.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let values: Vec<String> = (0..25).map(|v| format!("{}", 0.001 + 0.0001 * f64::from(v))).collect();
    std::fs::write(folder.path().join("thick.txt"), values.join("\n")).expect("a map");
    folder
}

#[test]
fn what_moves_and_joins_cloth_is_read_as_it_is_written() {
    let folder = folder();
    let shot = resolve_in(folder.path(), SEWN).unwrap_or_else(|e| panic!("{e}"));
    let scene = &shot.scene;
    let wind = scene.effects.iter().find(|e| e.effect == "wind").expect("wind");
    assert_eq!(wind.settings["keys"], SettingValue::Keys(vec![(0.0, [0.0; 3]), (2.0, [6.0, 0.0, 1.0])]));
    assert_eq!(scene.pins[0].hold, PinHold::Spring { stiffness: 200.0, damping_ratio: 1.0, break_force: Some(60.0) });
    let seam = &scene.seams[0];
    assert_eq!(seam.pairs, [[4, 0], [9, 5], [14, 10], [19, 15], [24, 20]], "each with the nearest");
    assert_eq!((seam.garments, seam.stiffness, seam.rest_gap), ([0, 1], 800.0, None));
    assert_eq!((seam.from, seam.until), (-0.5, 0.0), "over the pre-roll");
    let thickness = &scene.garments[0].maps["thickness"];
    assert_eq!((thickness.absolute, thickness.values.len()), (true, 25));
    assert!((thickness.values[24] - 0.0034).abs() < 1e-15);
    assert!(!scene.garments[0].maps["wind"].absolute);
    assert!(shot.input_files.iter().any(|file| file.ends_with("thick.txt")));
    let names: Vec<_> = scene.effects.iter().filter(|e| e.garment.is_none()).map(|e| e.effect.as_str()).collect();
    assert_eq!(names, ["wind", "seams", "attachments", "self_repulsion"]);
    // What is written out reads to the same.
    let again = resolve_in(folder.path(), &shot.resolved).unwrap_or_else(|e| panic!("{e}\n{}", shot.resolved));
    let named =
        |scene: &SceneDescription| -> Vec<_> { scene.effects.iter().map(|e| (e.effect.clone(), e.garment)).collect() };
    assert_eq!(named(&again.scene), named(&shot.scene));
    // Defaults are written out, and it is the scene now that asks for what a material asked for.
    let without_effects = |scene: &SceneDescription| SceneDescription { effects: Vec::new(), ..scene.clone() };
    assert_eq!(format!("{:?}", without_effects(&again.scene)), format!("{:?}", without_effects(&shot.scene)));
}

#[test]
fn a_seam_that_starts_at_a_time_with_a_unit_is_written_out_as_it_is_read() {
    let folder = folder();
    let text = format!("{SEWN}start = \"-250 ms\"\nclosed = \"0.5 s\"\n");
    let shot = resolve_in(folder.path(), &text).unwrap_or_else(|e| panic!("{e}"));
    let again = resolve_in(folder.path(), &shot.resolved).unwrap_or_else(|e| panic!("{e}\n{}", shot.resolved));
    assert_eq!((shot.scene.seams[0].from, shot.scene.seams[0].until), (-0.25, 0.5));
    assert_eq!(again.scene.seams, shot.scene.seams);
}

#[test]
fn slips_in_these_tables_name_the_line_and_what_to_write() {
    let folder = folder();
    for (from, to, words) in [
        ("name = \"right\"", "name = \"rigt\"", "no garment \"right\""),
        ("[0, 5, 10, 15, 20]", "[0, 5, 10, 15, 25]", "25 does not exist"),
        ("[0, 5, 10, 15, 20] }", "[0] }\npairing = \"order\"", "one side of this seam has 5"),
        ("file:thick.txt\", wind", "thickMap\", wind", "no attribute `thickMap`"),
        ("[\"thickness\"]", "[\"thicknes\"]", "no map of `thicknes`"),
        ("keys = [[0, [0, 0, 0]], [2, [6.0, 0, 1]]]", "keys = [[0, [0, 0]]]", "`keys` has to be"),
        ("keys = [[0, [0, 0, 0]], [2, [6.0, 0, 1]]]", "keys = [[2, [0, 0, 0]], [1, [6, 0, 1]]]", "increase"),
        ("density = \"1.2 kg/m³\"", "file = \"gusts.h5\"\ndensity = 1.2", "file not found"),
        ("strength = \"800 N/m\"", "strenght = 800", "did you mean `strength`?"),
        ("strength = \"800 N/m\"", "", "in `seam.0`: `strength` is missing: stiffness of each pair"),
        ("strength = \"800 N/m\"", "strength = 800\nclosed = 1e10", "`closed` = 1e10 s is outside -1e9 to 1e9 s"),
        ("mode = \"spring\"\nstiffness = \"200 N/m\"\n", "", "a hard pin has no stiffness"),
    ] {
        let text = SEWN.replace(from, to);
        assert_ne!(text, SEWN, "{from}");
        let found = resolve_in(folder.path(), &text).expect_err(to);
        assert!(found.contains(words), "{to}: {found}");
    }
}

#[test]
fn the_sample_scenes_of_these_effects_are_valid() {
    let samples = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("../sample_assets/scenes");
    for (name, effect) in [("flag", "wind"), ("falling_wind", "wind"), ("cushion", "pressure"), ("sewn_tube", "seams")]
    {
        let text = std::fs::read_to_string(samples.join(format!("{name}.toml"))).expect("a sample scene");
        let shot = resolve_in(&samples, &text).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(shot.scene.effects.iter().any(|e| e.effect == effect), "{name}");
        let scene = drapery_core::scene::Scene::validate(shot.scene).unwrap_or_else(|p| panic!("{name}: {p}"));
        let seams = &scene.description().seams;
        assert!(seams.len() == 2 * usize::from(name == "sewn_tube"), "{name}");
        assert!(seams.is_empty() || scene.sewn().iter().all(|pair| (pair.gap - 0.3).abs() < 1e-9), "{name}");
    }
}

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyShape, EffectRequest, Mass, PinHold, PinTarget};
use drapery_core::settings::{SettingValue, Settings};
use tempfile::TempDir;

use super::*;

const SHEET: &str = r#"
drapery = 1
[parameters]
resolution = 4
height = 1.5
[shot]
frames = "1001-1100"
preroll = { settle = 5 }
[gravity]
[[garment]]
name = "sheet"
panel = { resolution = "$resolution", center = [0, "$height", 0] }
material = "cotton_shirting"
[[garment.pin]]
corners = ["i0j0", "i0jn"]
"#;

fn read(text: &str) -> Result<SceneFile, SceneFileError> {
    parse(text, "scenes/sheet.toml", FilePath::new("scenes"), &[])
}

fn read_with(text: &str, overrides: &[(&str, &str)]) -> Result<SceneFile, SceneFileError> {
    let overrides: Vec<_> = overrides.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    parse(text, "scenes/sheet.toml", FilePath::new("scenes"), &overrides)
}

fn resolve(text: &str) -> ShotDescription {
    let scene = read(text).unwrap_or_else(|error| panic!("{error}"));
    scene.resolve().unwrap_or_else(|errors| panic!("{}", errors[0]))
}

fn message(text: &str) -> String {
    match read(text) {
        Err(error) => error.to_string(),
        Ok(scene) => scene.resolve().expect_err("this scene is wrong")[0].to_string(),
    }
}

#[test]
fn a_sheet_needs_no_files_and_becomes_si() {
    let scene = resolve(SHEET);
    let description = &scene.scene;
    assert_eq!(description.name, "sheet");
    assert_eq!((scene.frames, description.timeline.origin, description.timeline.start), ([1001, 1100], 1001, 996));
    let garment = &description.garments[0];
    assert_eq!(garment.point_count(), 7 * 5);
    assert_eq!(garment.mass, Mass::Density(0.15));
    assert!((garment.rest_positions().expect("a panel")[0] - Vec3::new(-0.85, 1.5, -0.5)).norm() < 1e-15);
    let PinTarget::Path { vertices, .. } = &description.pins[0].target else { panic!("a path") };
    assert_eq!((vertices.as_slice(), description.pins[0].hold), ([0, 28].as_slice(), PinHold::Hard));
    let names: Vec<_> = description.effects.iter().map(|e| (e.effect.as_str(), e.garment)).collect();
    assert_eq!(names, [("gravity", None), ("stretch", Some(0)), ("dihedral_bending", Some(0)), ("pins", None)]);
    assert_eq!(description.effects[1].settings["stiffness"], SettingValue::Number(261.0));
    assert_eq!(description.effects[3].because, "garment \"sheet\" has 2 pinned vertices");
    let data = scene.garments[0].read().expect("a panel");
    let uvs = data.uvs.expect("a panel has texture coordinates");
    assert_eq!((uvs.values.len(), &uvs.indices), (35, &data.mesh.face_indices));
}

#[test]
fn without_a_table_there_is_no_effect() {
    let text = SHEET.replace("[gravity]", "").replace("material = \"cotton_shirting\"", "total_mass = 1.7");
    let scene = resolve(&text);
    assert_eq!(scene.scene.effects.len(), 1, "only the pins");
    assert_eq!(scene.scene.garments[0].mass, Mass::UniformTotal(1.7));
}

#[test]
fn an_unknown_key_shows_its_line_and_the_nearest_word() {
    let text = format!("{SHEET}[solver]\nclf = 2\n");
    assert_eq!(
        message(&text),
        "scenes/sheet.toml:17:1: unknown key `clf` in `solver`\n   |\n17 | clf = 2\n   | ^^^\n  \
         help: did you mean `cfl`?"
    );
}

#[test]
fn an_unknown_table_and_an_unknown_effect_key_are_reported_alike() {
    assert_eq!(
        message(&SHEET.replace("[gravity]", "[gravty]")),
        "scenes/sheet.toml:9:2: unknown key `gravty` at the top level\n  |\n9 | [gravty]\n  |  ^^^^^^\n  \
         help: did you mean `gravity`?"
    );
    let text = SHEET.replace("[[garment.pin]]", "[garment.stretch]\nstifness = 100\n[[garment.pin]]");
    assert_eq!(
        message(&text),
        "scenes/sheet.toml:15:1: unknown key `stifness` in `garment.0.stretch`\n   |\n15 | stifness = 100\n\
         \x20  | ^^^^^^^^\n\
         \x20 help: did you mean `stiffness`?"
    );
    let text = SHEET.replace("[[garment.pin]]", "[garment.strech]\n[[garment.pin]]");
    assert!(message(&text).contains("did you mean `stretch`"), "{}", message(&text));
}

#[test]
fn wrong_types_units_and_ranges_show_the_value() {
    let stretch = |value: &str| {
        let table = format!("[garment.stretch]\nstiffness = {value}\n[[garment.pin]]");
        message(&SHEET.replace("[[garment.pin]]", &table))
    };
    let text = stretch("\"2 kg\"");
    assert!(text.starts_with("scenes/sheet.toml:15:13: `stiffness`: unit `kg` does not fit here"), "{text}");
    assert!(text.contains("15 | stiffness = \"2 kg\"\n   |             ^^^^^^"), "{text}");
    assert!(stretch("-1").contains("is outside"), "{}", stretch("-1"));
    assert!(stretch("true").contains("has to be a number, or text with a unit"), "{}", stretch("true"));

    let panel = |value: &str| message(&SHEET.replace("\"$resolution\"", value));
    assert!(panel("-3").contains("expected a whole number, zero or more, found -3"), "{}", panel("-3"));
    assert!(
        panel("\"fine\"").contains("`garment.0.panel.resolution`: expected a whole number"),
        "{}",
        panel("\"fine\"")
    );
    assert!(
        panel("0").contains(
            "sheet.toml:12:24: `garment.0.panel.resolution`: 0 is out of range; expected a number from 1 to 20000"
        ),
        "{}",
        panel("0")
    );
    let three = message(&SHEET.replace("[0, \"$height\", 0]", "[0, 1]"));
    assert!(three.contains("expected three numbers, found a list of 2"), "{three}");
    let four = message(&SHEET.replace("[0, \"$height\", 0]", "[0, 1, 2, 3]"));
    assert!(four.contains("found a list of 4"), "{four}");
}

#[test]
fn text_that_is_not_toml_and_another_version_are_refused() {
    let text = message("drapery = 1\n[shot\n");
    assert!(text.starts_with("scenes/sheet.toml:2:"), "{text}");
    let text = message(&SHEET.replace("drapery = 1", "drapery = 7"));
    assert!(text.contains("version 7") && text.contains("sheet.toml:2:11"), "{text}");
    let text = message("[shot]\nframes = \"1-2\"\n");
    assert!(text.contains("`drapery` is missing"), "{text}");
}

#[test]
fn words_that_are_not_known_get_the_nearest_one() {
    let text = message(&SHEET.replace("cotton_shirting", "coton_shirting"));
    assert!(text.contains("there is no material `coton_shirting`") && text.contains("`cotton_shirting`?"), "{text}");
    let text = message(&format!("{SHEET}[[body]]\nname = \"b\"\nshape = {{ sphear = {{ radius = 1 }} }}\n"));
    assert!(text.contains("unknown word `sphear`") && text.contains("did you mean `sphere`"), "{text}");
    assert!(text.contains("| shape = { sphear = { radius = 1 } }\n   |           ^^^^^^"), "{text}");
    let text = message(&format!("{SHEET}[solver]\npreset = \"prodution\"\n"));
    assert!(text.contains("did you mean `production`"), "{text}");
}

#[test]
fn values_with_rows_say_at_their_place_what_they_take_and_what_they_do() {
    let pin = |line: &str| message(&SHEET.replace("[[garment.pin]]", &format!("[[garment.pin]]\n{line}")));
    let body = |line: &str| message(&format!("{SHEET}[[body]]\nname = \"b\"\n{line}\n"));
    let solver = |line: &str| message(&format!("{SHEET}[solver]\n{line}\n"));
    for (text, words) in [
        (
            solver("max_dt = \"2 mm\""),
            "sheet.toml:17:10: `max_dt`: unit `mm` does not fit here; expected a number with one of",
        ),
        (solver("max_dt = \"never\""), "`max_dt`: `never` is not a number"),
        (solver("cfl = true"), "sheet.toml:17:7: `cfl` has to be a number, or text with a unit: CFL number of"),
        (solver("cg_max_iterations = 0"), "`cg_max_iterations` = 0 is outside 1 to 1e6: largest number of iterations"),
        (solver("cg_max_iterations = 1.5"), "`cg_max_iterations` has to be a whole number"),
        (
            solver("integrator = \"semi_implizit\""),
            "`integrator` cannot be `semi_implizit`; did you mean `semi_implicit`?",
        ),
        (solver("integrator = \"euler\""), "use one of semi_implicit, tr_bdf2"),
        (solver("integrator = \"implicit\""), "sheet.toml:17:14: `integrator` cannot be `implicit`; write `tr_bdf2`"),
        (
            body("max_push_speed = 0"),
            "sheet.toml:18:18: `max_push_speed` = 0 m/s has to be above 0: maximum depenetration speed",
        ),
        (body("frction = 0.1"), "unknown key `frction` in `body.0`"),
        (body("frction = 0.1"), "did you mean `friction`?"),
        (pin("mode = \"sprng\""), "sheet.toml:15:8: `mode` cannot be `sprng`; did you mean `spring`?"),
        (pin("break_force = \"60 N\""), "a hard pin has no stiffness"),
        (pin("util = 3"), "did you mean `until`?"),
    ] {
        assert!(text.contains(words), "{words}\n{text}");
    }
}

#[test]
fn what_is_no_table_is_told_what_the_table_looks_like() {
    let body = |line: &str| message(&format!("{SHEET}[[body]]\nname = \"b\"\n{line}\n"));
    for (line, words) in [
        ("shape = \"sphere\"", "write for example shape = { sphere = { radius = 0.15 } }"),
        ("shape = \"box\"", "write for example shape = { box = { half_extents = [0.15, 0.15, 0.15] } }"),
        ("shape = 0.3", "`body.0.shape` has to be a table of one shape and its sizes"),
        ("shape = { capsule = 0.3 }", "write for example shape = { capsule = { radius = 0.15, half_length = 0.15 } }"),
        ("shape = {}", "expected exactly one of half_space, sphere, capsule, cylinder, box"),
        ("shape = { sphere = {} }", "in `body.0.shape.sphere`: `radius` is missing: radius"),
        ("shape = { sphere = { radius = 0 } }", "sheet.toml:18:31: `radius` = 0 m is outside 1e-9 to 1e9 m"),
        ("shape = { sphere = { radus = 1 } }", "did you mean `radius`?"),
        (
            "shape = { half_space = {} }\nrotation = 90",
            "expected a table such as { axis = [0, 1, 0], degrees = 90 }, found 90",
        ),
        ("shape = { half_space = {} }\nspin = 3", "expected a table such as { angular_velocity = [0, 1, 0] }"),
    ] {
        assert!(body(line).contains(words), "{}", body(line));
    }
    let region = message(&SHEET.replace("corners = [\"i0j0\", \"i0jn\"]", "where = \"box\""));
    assert!(
        region.contains("a table such as { box = { min = [-1, 0, -1], max = [1, 2, 1] } }, found a word"),
        "{region}"
    );
}

#[test]
fn any_value_with_a_row_may_carry_its_unit() {
    let body = "[[body]]\nname = \"b\"\nshape = { sphere = { radius = \"15 cm\" } }\nmax_push_speed = \"20 cm/s\"\n";
    let pin = "[[garment.pin]]\nfrom = \"500 ms\"\nuntil = 2\nmode = \"spring\"\nstiffness = \"2 N/cm\"";
    let shot = resolve(&format!("{}{body}", SHEET.replace("[[garment.pin]]", pin)));
    let (body, pin) = (&shot.scene.bodies[0], &shot.scene.pins[0]);
    assert!(matches!(body.shape, BodyShape::Rigid(Shape::Sphere { radius: 0.15 })), "{:?}", body.shape);
    assert_eq!((body.max_push_speed, pin.from, pin.until), (0.2, 0.5, 2.0));
    assert_eq!(pin.hold, PinHold::Spring { stiffness: 200.0, damping_ratio: 1.0, break_force: None });
}

#[test]
fn parameters_are_numbers_texts_and_simple_products() {
    let text = SHEET
        .replace("resolution = 4\n", "resolution = 4\nword = \"_low\"\n")
        .replace("\"$resolution\"", "\"$resolution * 2\"")
        .replace("name = \"sheet\"", "name = \"sheet${word}_$resolution$$\"");
    let scene = resolve(&text);
    assert_eq!(scene.scene.garments[0].name, "sheet_low_4$");
    assert_eq!(scene.scene.garments[0].point_count(), 14 * 9);
    let text = message(&SHEET.replace("\"$resolution\"", "\"$resolutoin\""));
    assert!(
        text.contains("there is no parameter `resolutoin`") && text.contains("did you mean `resolution`"),
        "{text}"
    );
    let text = message(&SHEET.replace("\"$resolution\"", "\"$resolution / 3\""));
    assert!(text.contains("expected a whole number"), "{text}");
}

#[test]
fn a_key_of_very_many_parts_is_refused() {
    let key = vec!["a"; 20_000].join(".");
    let error = read_with(SHEET, &[(&key, "1")]).unwrap_err().to_string();
    assert!(error.contains("this key has 20000 parts"), "{}", &error[..200.min(error.len())]);
    // In a file the parser has a limit of its own.
    assert!(read(&format!("{SHEET}\n[{key}]\n")).is_err() && read(&format!("{key} = 1\n{SHEET}")).is_err());
    // A value that no parser takes is a text.
    let nested = format!("{}1{}", "[".repeat(20_000), "]".repeat(20_000));
    assert!(read_with(SHEET, &[("shot.name", &nested)]).is_ok());
}

#[test]
fn words_of_other_programs_and_words_cut_short_are_hinted_at() {
    let hint = |key: &str, value: &str| read_with(SHEET, &[(key, value)]).unwrap_err().to_string();
    assert!(hint("solver.substeps", "4").contains("did you mean `steps_per_frame`?"));
    assert!(hint("solver.preset", "prod").contains("did you mean `production`?"));
    assert!(hint("solver.preset", "tuned.toml").contains("--preset FILE"));
    assert!(hint("preset", "production").contains("did you mean `solver.preset`?"));
    assert!(hint("frames", "1-4").contains("did you mean `shot.frames`?"));
    assert!(hint("resolutoin", "4").contains("did you mean `resolution`?"));
}

#[test]
fn set_overrides_parameters_and_any_dotted_key() {
    let scene = read_with(
        SHEET,
        &[
            ("resolution", "6"),
            ("solver.cfl", "2.5"),
            ("garment.sheet.stretch.stiffness", "900 N/m"),
            ("garment.0.pin.0.axes", "xy"),
        ],
    )
    .unwrap_or_else(|error| panic!("{error}"));
    let scene = scene.resolve().expect("a valid scene");
    assert_eq!(scene.scene.garments[0].point_count(), 11 * 7);
    assert_eq!(scene.scene.solver.cfl, 2.5);
    assert_eq!(scene.scene.effects[1].settings["stiffness"], SettingValue::Text("900 N/m".to_owned()));
    assert_eq!(scene.scene.pins[0].axes, [true, true, false]);
    let toml = &scene.resolved;
    for line in ["cfl = 2.5", "axes = \"xy\"", "stiffness = \"900 N/m\""] {
        let line = toml.lines().find(|l| l.starts_with(line)).expect("every value is there");
        assert!(line.ends_with("# --set"), "{line}");
    }
    assert!(toml.lines().any(|l| l.starts_with("resolution = 6") && l.ends_with("# --set resolution")), "{toml}");
}

#[test]
fn a_wrong_set_shows_the_argument() {
    let text = |key: &str, value: &str| read_with(SHEET, &[(key, value)]).expect_err("wrong").to_string();
    assert_eq!(
        text("resolutoin", "6"),
        "--set:1:1: the scene has no parameter `resolutoin`\n  |\n1 | resolutoin=6\n  | ^^^^^^^^^^\n\
         \x20 help: did you mean `resolution`?"
    );
    assert!(text("solver.clf", "2").contains("did you mean `cfl`"), "{}", text("solver.clf", "2"));
    assert!(text("garment.shirt.density", "2").contains("there is no `shirt`"));
    assert!(text("resolution", "fine").contains("is a number in the scene"));
    let fast = text("solver.cfl", "fast");
    assert!(fast.contains("--set:1:12: `cfl`: `fast` is not a number; expected a number"), "{fast}");
}

const DRESSED: &str = r#"
drapery = 1
[shot]
fps = "23.976"
frames = "0-10"
[units]
length = "cm"
up = "Z"
[[body]]
name = "hero"
file = "hero.obj"
[[garment]]
name = "skirt"
rest = "skirt.obj"
units = { length = "m" }
material = "denim_11oz"
[[garment.pin]]
where = { box = { min = [-1, -1, -1], max = [0.1, 0.1, 0.1] } }
to = "body:hero"
mode = "spring"
stiffness = "2 N/cm"
[[garment.pin]]
file = "skirt_pins.json"
to = "body:hero"
[output]
format = ["abc"]
velocities = false
"#;

/// A folder with a body in centimetres, Z up, and a garment in metres, Y up.
fn wardrobe() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("a file");
    write("hero.obj", "v 0 0 0\nv 150 0 0\nv 0 0 150\nf 1 2 3\n");
    write("skirt.obj", "v 0 0 0.1\nv 0.5 0 0.1\nv 0 0.5 0.1\nf 1 2 3\n");
    write(
        "skirt_pins.json",
        r#"{"body": "hero.obj", "pins": [{"vertex": 2, "body_vertices": [2, 0, 1], "weights": [0.25, 0.5, 0.2500002],
            "offset_tangent_bitangent_normal": [0, 1, 2]}]}"#,
    );
    folder
}

fn resolve_in(folder: &TempDir, text: &str) -> Result<ShotDescription, Vec<SceneFileError>> {
    parse(text, "dressed.toml", folder.path(), &[]).unwrap_or_else(|e| panic!("{e}")).resolve()
}

#[test]
fn a_body_from_a_file_without_a_thickness_has_what_coarse_faces_need() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // A tube of flat strips, of 0.2 m radius.
    let mut text = String::new();
    let (around, rows) = (32, 10);
    for k in 0..around * rows {
        let angle = std::f64::consts::TAU * f64::from(k % around) / f64::from(around);
        text += &format!("v {} {} {}\n", 0.2 * angle.sin(), 0.04 * f64::from(k / around), 0.2 * angle.cos());
    }
    for k in 0..around * (rows - 1) {
        let (row, next) = (k / around * around, (k + 1) % around);
        let [a, b] = [row + k % around + 1, row + next + 1];
        text += &format!("f {a} {b} {} {}\n", b + around, a + around);
    }
    std::fs::write(folder.path().join("tube.obj"), text).expect("a file");
    let scene = |thickness: &str, resolution: u32| {
        format!(
            "drapery = 1\n[shot]\nframes = \"1-2\"\n[units]\nlength = \"m\"\n[gravity]\n[[body]]\nname = \"tube\"\nfile = \"tube.obj\"\n\
             {thickness}\n[[garment]]\nname = \"sheet\"\npanel = {{ resolution = {resolution} }}\nmaterial = \"denim_11oz\"\n"
        )
    };
    let shot = |text: &str| resolve_in(&folder, text).unwrap_or_else(|e| panic!("{}", e[0]));
    let of = |text: &str| (shot(text).scene.bodies[0].thickness, shot(text).body_thickness[0].expect("a mesh"));
    let (thickness, found) = of(&scene("", 25));
    assert_eq!((thickness, found.is_written), (found.needed, false));
    // The panel has right triangles with cells of 4 cm; the strips of the tube are 39 mm wide and 40 mm high.
    let (cloth, strip) = (2.0 * 0.04_f64.powi(2), 0.039_f64.powi(2) + 0.04_f64.powi(2));
    let expected = (cloth + strip) / (8.0 * 0.2);
    assert!((thickness / expected - 1.0).abs() < 0.03, "{thickness}, about {expected} was expected");
    let resolved = shot(&scene("", 25)).resolved;
    let line =
        resolved.lines().find(|line| line.contains("from the faces of the body and the garments")).expect("a line");
    assert!(line.starts_with(&format!("thickness = {thickness:?}")), "{line}");
    // What is written out is the same scene.
    let again = parse(&resolved, "again.toml", folder.path(), &[]).expect("it is read").resolve().expect("it is sound");
    assert_eq!(again.scene.bodies[0].thickness, thickness);
    let (written, found) = of(&scene("thickness = \"0.1 mm\"", 25));
    assert_eq!((written, found.needed, found.is_written), (1e-4, thickness, true));
    // Never below the fabric's.
    let (fine, found) = of(&scene("", 250));
    assert!(fine == 0.66e-3 || fine == found.needed, "{fine}");
    assert!(fine < thickness);
}

#[test]
fn a_body_and_a_garment_from_files_keep_their_units() {
    let folder = wardrobe();
    let shot = resolve_in(&folder, DRESSED).unwrap_or_else(|e| panic!("{}", e[0]));
    assert_eq!(shot.output.units.length, crate::units::LengthUnit::Centimetre);
    assert_eq!((shot.scene.timeline.fps_numerator, shot.scene.timeline.fps_denominator), (24_000, 1001));
    assert_eq!(shot.garments[0].read().expect("the skirt").mesh.points[1], Vec3::new(0.5, 0.0, 0.1));
    let hero = shot.bodies[0].as_ref().expect("a file");
    assert_eq!(hero.source.mesh_at(0.0).expect("a mesh").mesh.points[2], Vec3::new(0.0, 1.5, 0.0));
    let body = &shot.scene.bodies[0];
    assert_eq!((body.friction, body.thickness), (0.5, 0.66e-3), "those of denim");
    let pins = &shot.scene.pins;
    assert!(matches!(&pins[0].target, PinTarget::BodyNearest { body: 0, vertices } if vertices == &[0]));
    assert_eq!(pins[0].hold, PinHold::Spring { stiffness: 200.0, damping_ratio: 1.0, break_force: None });
    let PinTarget::Body { attachments, .. } = &pins[1].target else { panic!("the pins of the file") };
    assert_eq!((attachments[0].vertex, attachments[0].body_points), (2, [2, 0, 1]));
    assert!((attachments[0].weights.iter().sum::<f64>() - 1.0).abs() < 1e-15, "rounded weights are completed");
    assert_eq!(attachments[0].offset, Vec3::new(0.0, 0.01, 0.02), "in the unit of the body");
    let names: Vec<_> = shot.scene.effects.iter().map(|e| e.effect.as_str()).collect();
    assert_eq!(names, ["stretch", "dihedral_bending", "attachments", "pins", "body_collision"]);
    assert_eq!((shot.output.formats.as_slice(), shot.output.velocities), (["abc".to_owned()].as_slice(), false));
    assert_eq!(shot.input_files.len(), 3);
}

#[test]
fn pins_of_another_body_are_bound_to_the_nearest_point() {
    let folder = wardrobe();
    let pins = folder.path().join("skirt_pins.json");
    let text = std::fs::read_to_string(&pins).expect("pins").replace("hero.obj", "hero_low.obj");
    std::fs::write(&pins, text).expect("pins");
    let shot = resolve_in(&folder, DRESSED).unwrap_or_else(|e| panic!("{}", e[0]));
    assert!(matches!(&shot.scene.pins[1].target, PinTarget::BodyNearest { vertices, .. } if vertices == &[2]));
    let forced = DRESSED.replace("file = \"skirt_pins.json\"", "file = \"skirt_pins.json\"\nbind = \"file\"");
    let shot = resolve_in(&folder, &forced).unwrap_or_else(|e| panic!("{}", e[0]));
    assert!(matches!(&shot.scene.pins[1].target, PinTarget::Body { .. }));
}

#[test]
fn every_problem_of_files_is_reported_at_once() {
    let empty = tempfile::tempdir().expect("a temporary folder");
    let errors = resolve_in(&empty, DRESSED).expect_err("nothing is there");
    assert_eq!(errors.iter().filter(|e| e.kind == SceneErrorKind::Missing).count(), 2);
    let text = errors[0].to_string();
    assert!(text.starts_with("dressed.toml:11:8: ") && text.contains("hero.obj: file not found"), "{text}");

    let text = DRESSED.replace("[units]\nlength = \"cm\"\nup = \"Z\"\n", "");
    let errors = resolve_in(&wardrobe(), &text).expect_err("no units");
    assert!(errors[0].message.contains("units of this file are unknown"), "{}", errors[0]);

    let folder = wardrobe();
    std::fs::write(folder.path().join("skirt_pins.json"), "{\"pins\": [{\"vertex\": 1}]}").expect("a file");
    let errors = resolve_in(&folder, DRESSED).expect_err("half a pin file");
    assert_eq!(errors[0].kind, SceneErrorKind::Data);
    assert!(errors[0].message.contains("line 1, column"), "{}", errors[0]);
}

#[test]
fn pins_that_hold_nothing_real_are_refused() {
    let pin = |lines: &str| message(&SHEET.replace("corners = [\"i0j0\", \"i0jn\"]", lines));
    assert!(pin("vertices = [35]").contains("vertex 35 does not exist: the garment has 35 vertices"));
    assert!(pin("").contains("exactly one of"));
    assert!(pin("vertices = [0]\nto = \"body:hreo\"").contains("there is no body \"hreo\""));
    assert!(pin("vertices = [0]\nmode = \"spring\"").contains("requires `stiffness`"));
    assert!(pin("vertices = [0]\naxes = \"xw\"").contains("not a set of the axes"));
    let nowhere = "where = { box = { min = [9, 9, 9], max = [10, 10, 10] } }";
    assert!(pin(nowhere).contains("holds no vertex") && !pin(nowhere).contains("in metres"));
    let help = |lines: &str| {
        let scene = read(&SHEET.replace("corners = [\"i0j0\", \"i0jn\"]", lines)).expect("a scene");
        scene.resolve().expect_err("an empty box")[0].help.clone().expect("a help")
    };
    let bounds = "the garment starts from [-0.850, 1.500, -0.500] to [0.850, 1.500, 0.500] m";
    let nearest = format!("{bounds}; its vertex nearest to the box is 34 at [0.850, 1.500, 0.500], 13.961 m away");
    assert_eq!(help(nowhere), nearest);
    let inverted = "where = { box = { min = [0, 1, 0], max = [1, 0, 1] } }";
    assert_eq!(help(inverted), "exchange `min` and `max` along y: 1 is above 0");
    let in_centimetres = pin(&format!("{nowhere}\n[units]\nlength = \"cm\""));
    assert!(in_centimetres.contains("holds no vertex; its box is in metres with Y up"), "{in_centimetres}");
    assert!(pin("file = \"none.json\"").contains("file not found"));
}

/// Settings of an effect in SI units, with its defaults.
#[test]
fn times_words_and_lists_that_contradict_themselves_are_told_at_their_place() {
    let pin = |keys: &str| format!("{SHEET}{keys}\n");
    let seam = |keys: &str| {
        let sides = "from = { garment = \"sheet\", vertices = [1] }\nto = { garment = \"sheet\", vertices = [2] }";
        format!("{SHEET}[[seam]]\n{sides}\nstrength = 800\n{keys}\n")
    };
    let without_preroll = |text: String| text.replace("preroll = { settle = 5 }\n", "");
    for (text, words) in [
        (
            pin("path = [[0.0, [0, 0, 0]], [2.0, [0, 1, 0]], [1.0, [0, 2, 0]]]"),
            "scenes/sheet.toml:16:8: the times of a path have to increase",
        ),
        (pin("path = [[1.0, [0, 0, 0]], [1.0, [0, 1, 0]]]"), "the times of a path have to increase"),
        (pin("axes = \"xyzzy\""), "scenes/sheet.toml:16:8: \"xyzzy\" is not a set of the axes x, y and z"),
        (pin("axes = \"xy\"\nmode = \"spring\"\nstiffness = 20"), "a spring pulls along all axes"),
        (pin("track = \"track.abc\""), "`track` applies only with `to = \"track\"`, but this pin has `to = \"start\"`"),
        (pin("bind = \"nearest\""), "`bind` applies only with `to = \"body:…\"`"),
        (seam("start = 2\nclosed = 1"), "this seam is closed at 1 s, before it starts to close at 2 s"),
        (
            without_preroll(seam("start = 2")),
            "this seam is closed at 1 s, as `closed` is left out, before it starts to close at 2 s",
        ),
        (seam("start = 2"), "this seam is closed at 0 s, as `closed` is left out"),
        (format!("{SHEET}[output]\nformat = [\"abc\", \"h5\", \"abc\"]\n"), "the format \"abc\" is listed twice"),
    ] {
        assert!(message(&text).contains(words), "{words}\n{}", message(&text));
    }
    for text in [
        pin("path = [[0.0, [0, 0, 0]], [2.0, [0, 1, 0]]]\naxes = \"zx\""),
        seam("start = 2\nclosed = 2"),
        without_preroll(seam("start = 0.5")),
        format!("{SHEET}[output]\nformat = [\"h5\", \"abc\"]\nsamples = 3\n"),
        format!("{SHEET}[effects]\nwithout = []\n"),
    ] {
        resolve(&text);
    }
}

fn values_in_use(request: &EffectRequest) -> Vec<(&'static str, SettingValue)> {
    let fields = drapery_core::effects::find(&request.effect).expect("a known effect").fields;
    let settings = Settings::check(fields, &request.settings).expect("checked settings");
    settings.iter().map(|(name, value, _)| (name, value.clone())).collect()
}

#[test]
fn the_resolved_file_is_read_to_the_same_description() {
    let folder = wardrobe();
    let solver = "[solver]\npreset = \"hero\"\nmax_dt = \"1 ms\"\n";
    for text in [SHEET.to_owned(), DRESSED.to_owned(), format!("{SHEET}{solver}")] {
        let first = resolve_in(&folder, &text).unwrap_or_else(|e| panic!("{}", e[0]));
        let elsewhere = tempfile::tempdir().expect("a temporary folder");
        let again = resolve_in(&elsewhere, &first.resolved).unwrap_or_else(|e| panic!("{}\n{}", e[0], first.resolved));
        // Reasons and origins differ when a preset's values are written out; nothing else may.
        let bare = |shot: &ShotDescription| {
            let mut scene = shot.scene.clone();
            let effects = std::mem::take(&mut scene.effects);
            let effects: Vec<_> = effects.iter().map(|e| (e.effect.clone(), e.garment, values_in_use(e))).collect();
            format!("{scene:?} {effects:?}")
        };
        assert_eq!(bare(&first), bare(&again));
        assert_eq!((first.frames, &first.output, first.preroll), (again.frames, &again.output, again.preroll));
        let values = |toml: &str| -> Vec<String> {
            let value = |l: &str| l.rsplit_once(" # ").map_or(l, |(value, _)| value).trim_end().to_owned();
            toml.lines().filter(|l| !l.starts_with('#')).map(value).collect()
        };
        assert_eq!(values(&first.resolved), values(&again.resolved));
    }
}

#[test]
fn the_resolved_file_says_where_every_value_came_from() {
    let text = format!("{SHEET}[solver]\npreset = \"hero\"\n");
    let toml = resolve(&text).resolved;
    let line =
        |start: &str| toml.lines().find(|l| l.starts_with(start)).unwrap_or_else(|| panic!("{start} in\n{toml}"));
    for (start, origin) in [
        ("frames", "# scene"),
        ("fps = \"24\"", "# default"),
        ("name = \"sheet\"", "# default"),
        ("resolution = 4", "# scene, parameter resolution"),
        ("center = [0, 1.5, 0]", "# scene, parameter height"),
        ("integrator = \"tr_bdf2\"", "# preset hero"),
        ("steps_per_frame = 16", "# preset hero"),
        ("cfl = 4.0", "# default"),
        ("max_dt = \"auto\"", "# default"),
        ("density = 0.15", "# material cotton_shirting"),
        ("stiffness = 261.0", "# material cotton_shirting"),
        ("acceleration = [0.0, -9.81, 0.0]", "# default"),
        ("format = [\"abc\", \"h5\"]", "# default"),
    ] {
        assert!(line(start).ends_with(origin), "{}", line(start));
    }
    assert!(toml.contains("# parameter resolution = 4 (scene)"));
    assert!(toml.lines().filter(|l| l.contains(" = ")).all(|l| l.contains('#')), "{toml}");
}

#[test]
fn the_schema_is_json_and_knows_the_tables_of_effects() {
    let schema: serde_json::Value = serde_json::from_str(&schema()).expect("JSON");
    assert_eq!(schema["properties"]["gravity"]["properties"]["acceleration"]["anyOf"][0]["minItems"], 3);
    let garment = &schema["$defs"]["Garment"]["properties"];
    for effect in ["stretch", "bending"] {
        assert!(garment[effect]["properties"]["damping_ratio"]["default"].is_number(), "{effect}");
        assert_eq!(garment[effect]["additionalProperties"], false);
    }
    assert!(schema["properties"].get("pins").is_none(), "pins have no table of their own");
    assert_eq!(schema["additionalProperties"], false);
    // Any number may be a parameter.
    assert_eq!(schema["$defs"]["Panel"]["properties"]["resolution"]["type"], serde_json::json!(["integer", "string"]));
}

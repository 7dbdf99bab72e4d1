//! The rules of a scene that is right the first time: each finds what it is for and nothing else, and is silent when told.

use std::path::Path;

use drapery_alembic::{
    ArchiveOptions, ArchiveWriter, Durability, PolyMeshSample, PolyMeshWriter, TimeSampling, Topology, XformWriter,
};
use drapery_io::rules::RULES;
use drapery_io::scene_file;
use drapery_shot::Shot;
use drapery_shot::rules::Warning;

mod samples;
mod seams;
mod start;
mod units;

/// A sheet that no rule has anything to say about.
const SHEET: &str = r#"drapery = 1
[shot]
frames = "2-3"
[gravity]
[self_repulsion]
[self_collision]
[[garment]]
name = "sheet"
panel = { resolution = 12, center = [5, 1, 0] }
material = "cotton_shirting"
"#;

/// A body from a file.
const HERO: &str = "[units]\nlength = \"m\"\nup = \"Y\"\n[[body]]\nname = \"hero\"\nfile = \"hero.abc\"\n";

/// A ball below the sheet.
const BALL: &str = "[[body]]\nname = \"ball\"\nshape = { sphere = { radius = 0.25 } }\n";

/// The scene with more tables.
fn with(tables: &str) -> String {
    format!("{SHEET}{tables}")
}

/// The scene with a seam between two corners of the sheet.
fn seam(keys: &str) -> String {
    with(&format!(
        "[[seam]]\nfrom = {{ garment = \"sheet\", corners = [\"i0j0\"] }}\n\
         to = {{ garment = \"sheet\", corners = [\"inj0\"] }}\nstrength = 1\n{keys}\n"
    ))
}

/// A box between two corners that hardly moves in frames 1 to 4, at a number of frames per second; `says` whether the file says so.
fn hero(folder: &Path, corners: [[f32; 3]; 2], fps: f64, says: bool) {
    hero_with(folder, corners, (fps, says), (4.0 * fps / 24.0) as usize);
}

/// The same with a number of samples, from frame 1 on.
fn hero_with(folder: &Path, [low, high]: [[f32; 3]; 2], (fps, says): (f64, bool), samples: usize) {
    let options = ArchiveOptions { frames_per_second: says.then_some(fps), ..ArchiveOptions::default() };
    let mut archive = ArchiveWriter::create(folder.join("hero.abc"), &options).expect("a file");
    let sampling = TimeSampling::frames(1.0, fps).expect("a rate");
    let sampling = archive.add_time_sampling(sampling).expect("a sampling");
    let root = archive.root();
    let xform = XformWriter::still(&mut archive, root, "hero", None).expect("a transform");
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "heroShape", sampling).expect("a mesh");
    let corner = |i: usize| [0, 1, 2].map(|axis| if (i >> axis) & 1 == 1 { high[axis] } else { low[axis] });
    let points: Vec<[f32; 3]> = (0..8).map(corner).collect();
    // Clockwise seen from outside: Alembic's way round.
    let face_indices = [[2, 6, 4, 0], [5, 7, 3, 1], [4, 5, 1, 0], [3, 7, 6, 2], [1, 3, 2, 0], [6, 7, 5, 4]].concat();
    let topology = Topology { face_counts: &[4; 6], face_indices: &face_indices };
    for sample in 0..samples {
        let points = points.iter().map(|[x, y, z]| [x + 1e-3 * sample as f32, *y, *z]).collect::<Vec<_>>();
        let sample = PolyMeshSample { topology: Some(topology), ..PolyMeshSample::of(&points) };
        mesh.write(&mut archive, &sample).expect("a sample");
    }
    archive.finish(Durability::Flushed).expect("a file");
}

/// A standing figure in a file with Y up: 1.7 m high, 0.3 m deep.
const STANDING: [[f32; 3]; 2] = [[-0.8, 0.0, -0.15], [0.8, 1.7, 0.15]];

/// The warnings of rules about a scene beside `hero.abc`.
fn warnings(folder: &Path, scene: &str) -> Vec<Warning> {
    let parsed = scene_file::parse(scene, "scene.toml", folder, &[]).unwrap_or_else(|error| panic!("{error}\n{scene}"));
    let shot = parsed.resolve().unwrap_or_else(|errors| panic!("{errors:?}\n{scene}"));
    let shot = Shot::prepare(shot, None).unwrap_or_else(|error| panic!("{error}\n{scene}"));
    shot.warnings().iter().filter(|warning| warning.rule.is_some()).cloned().collect()
}

/// Each of the first scenes breaks the rule and no other, with these words in its warning; silenced, it says nothing. None of the
/// second ones breaks any.
fn rule(name: &str, file: impl Fn(&Path), breaks: &[(&str, &[&str])], keeps: &[&str]) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    file(folder.path());
    for (scene, words) in breaks {
        let found = warnings(folder.path(), scene);
        let text: String = found.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        assert!(!found.is_empty() && found.iter().all(|warning| warning.rule == Some(name)), "{name}: {text}\n{scene}");
        for word in *words {
            assert!(text.contains(word), "{name}: no `{word}` in\n{text}\n{scene}");
        }
        let silenced = warnings(folder.path(), &format!("{scene}[check]\nsilence = [\"{name}\"]\n"));
        assert_eq!(silenced, [], "{scene}");
    }
    for scene in keeps {
        assert_eq!(warnings(folder.path(), scene), [], "{name}\n{scene}");
    }
    assert!(RULES.iter().any(|rule| rule.name == name) && !breaks.is_empty() && !keeps.is_empty());
}

fn without_file(_: &Path) {}

#[test]
fn a_scene_without_gravity_is_told_unless_it_decided_so() {
    rule(
        "no_gravity",
        without_file,
        &[(&SHEET.replace("[gravity]\n", ""), &["no_gravity: the scene has no gravity", "help: write [gravity]"])],
        &[
            SHEET,
            &SHEET.replace("[gravity]\n", "[gravity]\nacceleration = [0, 0, 0]\n"),
            &with("[effects]\nwithout = [\"gravity\"]\n"),
        ],
    );
}

/// A ball of quads in the place of the figure.
fn round_hero(folder: &Path) {
    let (around, rows) = (24_u32, 12_u32);
    let mut text = String::from("v 0 -0.8 0\nv 0 0.8 0\n");
    for k in 0..(rows - 1) * around {
        let high = std::f64::consts::PI * f64::from(k / around + 1) / f64::from(rows);
        let along = std::f64::consts::TAU * f64::from(k % around) / f64::from(around);
        let [x, y, z] = [high.sin() * along.sin(), -high.cos(), high.sin() * along.cos()].map(|c| 0.8 * c);
        text += &format!("v {x} {y} {z}\n");
    }
    for k in 0..around {
        let at = |row: u32, k: u32| 3 + row * around + k % around;
        text += &format!("f 1 {} {}\nf 2 {} {}\n", at(0, k + 1), at(0, k), at(rows - 2, k), at(rows - 2, k + 1));
        for row in 0..rows - 2 {
            text += &format!("f {} {} {} {}\n", at(row, k), at(row, k + 1), at(row + 1, k + 1), at(row + 1, k));
        }
    }
    std::fs::write(folder.join("hero.obj"), text).expect("a file");
}

#[test]
fn a_body_that_is_too_thin_for_coarse_cloth_is_told_unless_the_scene_leaves_it_out() {
    let hero = |thickness: &str| with(&HERO.replace("hero.abc\"\n", &format!("hero.obj\"\n{thickness}\n")));
    let words = ["body \"hero\": its thickness is 2.00 mm", "help: write thickness = \"", "or leave it out"];
    rule(
        "thin_body",
        round_hero,
        &[(&hero("thickness = \"2 mm\""), &words)],
        &[&hero(""), &hero("thickness = \"40 mm\"")],
    );
}

#[test]
fn faces_that_meet_a_body_along_the_diagonal_that_is_not_simulated_are_told_at_the_start() {
    // The simulated diagonal is in a valley at 1 m, the other one on a ridge at 1.4 m, and the tip of the body at 1.2 m.
    let files = |folder: &Path| {
        let quad = "v -0.9 1 0\nv 0 1.4 -1\nv 0.9 1 0\nv 0 1.4 1\nf 1 2 3 4\n";
        let body = "v 0.01 1.2 0.02\nv -0.5 3 -0.5\nv 0.5 3 -0.5\nv 0 3 0.5\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n";
        std::fs::write(folder.join("quad.obj"), quad).expect("a file");
        std::fs::write(folder.join("hero.obj"), body).expect("a file");
    };
    let scene = with(HERO).replace("hero.abc", "hero.obj");
    let scene = scene.replace("panel = { resolution = 12, center = [5, 1, 0] }", "rest = \"quad.obj\"");
    let words = [
        "garment \"sheet\" intersects body \"hero\"",
        "cut along the other diagonal",
        "(face 0) of sheet",
        "at the start",
        "help: write a larger `thickness` at the body",
    ];
    let triangles = format!("{scene}[output]\nfaces = \"triangles\"\n");
    rule("other_diagonal", files, &[(&scene, &words)], &[&triangles]);
}

#[test]
fn a_wind_faster_than_any_storm_is_warned_of() {
    let wind = |velocity: &str| with(&format!("[wind]\ndensity = 1\n{velocity}\n"));
    rule(
        "wind_speed",
        without_file,
        &[
            (&wind("velocity = [0, -600, 0]"), &["wind: `velocity` reaches 600 m/s", "help: write `velocity` in m/s"]),
            (&wind("keys = [[0, [0, 0, 0]], [2, [300, 400, 0]]]"), &["wind: `keys` reaches 500 m/s"]),
        ],
        &[
            &wind("velocity = [6, 0, 0]"),
            &wind("velocity = [0, 0, 112]"),
            &wind("keys = [[0, [0, 0, 0]], [2, [60, 0, 60]]]"),
        ],
    );
}

#[test]
fn cloth_that_may_pass_through_itself_is_told_unless_it_cannot_fold() {
    let alone = SHEET.replace("[self_repulsion]\n[self_collision]\n", "");
    let small = alone.replace("resolution = 12", "resolution = 4");
    let second = small.replace("center = [5, 1, 0]", "center = [8, 1, 0]").replace("\"sheet\"", "\"scarf\"");
    let two = format!("{small}{}", &second[second.find("[[garment]]").expect("a garment")..]);
    rule(
        "no_self_collision",
        without_file,
        &[
            (&alone, &["garment \"sheet\": it can fold", "write [self_repulsion] and [self_collision]"]),
            (&SHEET.replace("[self_collision]\n", ""), &["help: write [self_collision]"]),
            (&two, &["garments \"sheet\", \"scarf\": nothing keeps them"]),
        ],
        &[SHEET, &small, &with("[effects]\nwithout = [\"self_collision\"]\n")],
    );
}

#[test]
fn an_up_axis_that_a_standing_body_or_gravity_contradicts_is_told_and_a_lying_body_is_not() {
    let z_up = with(HERO).replace("up = \"Y\"", "up = \"Z\"");
    let own =
        with(&HERO.replace("[units]\nlength = \"m\"\nup = \"Y\"\n", "")) + "units = { length = \"m\", up = \"Z\" }\n";
    let pull =
        |acceleration: &str| SHEET.replace("[gravity]\n", &format!("[gravity]\nacceleration = {acceleration}\n"));
    let standing = |folder: &Path| hero(folder, STANDING, 24.0, true);
    rule(
        "up_axis",
        standing,
        &[
            (
                &z_up,
                &[
                    "body \"hero\": ",
                    "with Z up it lies on its back: it is 1.70 m high along Y",
                    "write up = \"Y\" in [units]",
                ],
            ),
            (&own, &["write up = \"Y\" in `units` of this body"]),
            (&pull("[0, 0, -9.81]"), &["does not pull down", "write acceleration = [0, -9.81, 0]"]),
            (&pull("[0, 9.81, 0]"), &["does not pull down"]),
        ],
        &[&with(HERO), &pull("[6, -7, 0]")],
    );
    // The same figure in a file with Z up.
    let upright = |folder: &Path| hero(folder, [[-0.8, -0.15, 0.0], [0.8, 0.15, 1.7]], 24.0, true);
    rule("up_axis", upright, &[(&with(HERO), &["with Y up it lies on its back", "up = \"Z\" in [units]"])], &[&z_up]);
    let lying = [[-0.8, 0.0, 0.0], [0.8, 0.3, 1.7]];
    let crouching = [[-0.4, 0.0, -0.5], [0.4, 0.7, 0.5]];
    let lying_afar = [[-0.8, -0.15, 2.0], [0.8, 0.15, 3.7]];
    // Ground with bumps, to one side of the origin, and a wide one.
    let (floor, wide) = ([[-2.0, -0.05, 0.0], [2.0, 0.05, 4.0]], [[-5.0, -0.4, 0.0], [5.0, 0.4, 4.0]]);
    for pose in [lying, crouching, lying_afar, floor, wide] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        hero(folder.path(), pose, 24.0, true);
        assert_eq!(warnings(folder.path(), &with(HERO)), [], "{pose:?}");
    }
}

#[test]
fn a_frame_rate_other_than_that_of_the_file_is_told() {
    let at = |fps: &str| with(HERO).replace("frames = ", &format!("fps = \"{fps}\"\nframes = "));
    let (pal, ntsc) = (at("25"), at("23.976"));
    let words = ["body \"hero\": ", "24 frames per second, but the shot has 25:", "write fps = \"24\" in [shot]"];
    let states = |folder: &Path| hero(folder, STANDING, 24.0, true);
    rule("frame_rate", states, &[(&pal, &words), (&ntsc, &["the file states 24", "24000/1001"])], &[&with(HERO)]);
    let is_silent_about_it = |folder: &Path| hero(folder, STANDING, 24.0, false);
    rule("frame_rate", is_silent_about_it, &[(&pal, &["the samples of the file are at 24"])], &[&with(HERO)]);
    // Four samples to a frame, none of which the file calls frames.
    let folder = tempfile::tempdir().expect("a temporary folder");
    hero(folder.path(), STANDING, 96.0, false);
    assert_eq!(warnings(folder.path(), &with(HERO).replace("2-3", "1-3")), []);
}

#[test]
fn a_thickness_that_short_edges_lower_is_told_with_what_is_left() {
    // Edges of 1/12 m hold at most 0.4 of that: 33.333 mm.
    let thick = with("thickness = \"60 mm\"\n");
    let by_rule = |thickness: &str| {
        with(&format!("[[contact]]\nbetween = [\"sheet\", \"sheet\"]\nthickness = \"{thickness}\"\n"))
    };
    let painted =
        |name: &str| with(&format!("maps = {{ thickness = \"file:{name}.txt\" }}\nabsolute_maps = [\"thickness\"]\n"));
    let maps = |folder: &Path| {
        for thickness in ["0.06", "0.033"] {
            let file = folder.join(format!("{thickness}.txt"));
            std::fs::write(file, format!("{thickness}\n").repeat(21 * 13)).expect("a file");
        }
    };
    rule(
        "thickness_lowered",
        maps,
        &[
            (
                &thick,
                &[
                    "garment \"sheet\": ",
                    " vertices keep less than the thickness of 60.000 mm, ",
                    "down to 33.333 mm",
                    "write thickness = \"33.333 mm\"",
                ],
            ),
            (
                &by_rule("2 m"),
                &[
                    "garment \"sheet\": ",
                    "less than the thickness of 2000.000 mm from garment \"sheet\", down to 33.333 mm",
                    "write thickness = \"33.333 mm\" in its [[contact]]",
                ],
            ),
            (
                &painted("0.06"),
                &[
                    " vertices keep less than the thickness in their map, down to 33.333 mm",
                    "smaller values in the map are kept everywhere",
                    "write values of at most 0.033333 into its map of `thickness`, which is in metres",
                ],
            ),
        ],
        &[
            SHEET,
            &painted("0.033"),
            &by_rule("33.3 mm"),
            &thick.replace("60 mm", "33.3 mm"),
            &thick.replace("[self_repulsion]\n", "[self_repulsion]\nthickness_clamp = 0.4\n"),
        ],
    );
}

#[test]
fn friction_of_a_body_in_the_place_of_the_fabrics_is_told() {
    let own = |friction: &str| with(&format!("{BALL}friction = {friction}\n"));
    let plain = own("0.8").replace("material = \"cotton_shirting\"", "density = 0.15\nstretch = { stiffness = 100 }");
    rule(
        "body_friction",
        without_file,
        &[(
            &own("0.8"),
            &[
                "body \"ball\": its friction 0.8 overrides the friction of the fabrics, 0.35 of cotton_shirting",
                "friction = 0.35",
            ],
        )],
        &[&with(BALL), &own("0.35"), &plain],
    );
}

#[test]
fn numbers_of_shapes_and_pins_in_the_units_of_the_files_are_told() {
    let units = |tables: &str| with(&format!("{tables}[units]\nlength = \"cm\"\n"));
    let ball = |radius: &str| BALL.replace("0.25", radius) + "position = [0, -30, 0]\n";
    let near = |radius: &str| BALL.replace("0.25", radius);
    let pin = "[[garment.pin]]\ncorners = [\"i0j0\"]\npath = [[0.0, [0, 0, 0]], [10.0, [0, 50, 0]]]\n";
    let floor =
        "[[body]]\nname = \"floor\"\nshape = { box = { half_extents = [20, 0.1, 20] } }\nposition = [0, -1, 0]\n";
    let wall = "[[body]]\nname = \"ground\"\nshape = { half_space = {} }\nposition = [0, 0, -5]\n\
                rotation = { axis = [1, 0, 0], degrees = 90 }\n";
    let z_up = |tables: &str| units(tables) + "up = \"Z\"\n";
    let pull =
        |acceleration: &str| SHEET.replace("[gravity]\n", &format!("[gravity]\nacceleration = {acceleration}\n"));
    rule(
        "shape_units",
        without_file,
        &[
            (&units(&ball("25")), &["body \"ball\": its radius is 25 m", "write radius = \"25 cm\", which is 0.25 m"]),
            (&units(&ball("0.25")), &["body \"ball\": its position reaches 30 m", "write position = [0, -0.3, 0]"]),
            (&units(pin), &["garment \"sheet\", pin 0: its path reaches 50 m", "up to 0.5"]),
            (
                &units("").replace("center = [5, 1, 0]", "side = 100, center = [5, 1, 0]"),
                &["garment \"sheet\": it is 170 m"],
            ),
            (&z_up(wall), &["body \"ground\": it is a wall", "without a rotation"]),
            (&pull("[0, -981, 0]"), &["gravity: 981 m/s² looks like cm/s²", "acceleration = [0, -9.81, 0]"]),
        ],
        &[
            &units(&near("0.25")),
            &units(&near("\"25 cm\"")),
            &units(&pin.replace("50", "0.5")),
            &units(floor),
            &with(&ball("25")),
            &units(wall),
            &z_up(&wall.replace("degrees = 90", "degrees = 20")),
            &pull("[0, -1.62, 0]"),
        ],
    );
}

#[test]
fn caches_that_no_application_opens_are_told() {
    rule(
        "unopened_format",
        without_file,
        &[
            (
                &with("[output]\nformat = [\"h5\"]\n"),
                &["only as \"h5\", which no application opens", "format = [\"abc\", \"h5\"]"],
            ),
            (&with("[output]\nformat = []\n"), &["output: no caches are written", "help: write format = [\"abc\"]"]),
        ],
        &[SHEET, &with("[output]\nformat = [\"abc\", \"h5\"]\n")],
    );
}

#[test]
fn a_garment_that_starts_faster_than_anything_it_could_survive_is_told() {
    let starts = |keys: &str| with(&format!("{keys}\n"));
    let random = |speed: &str| starts(&format!("random_velocity = {{ speed = {speed}, seed = 3 }}"));
    rule(
        "start_speed",
        without_file,
        &[
            (
                &starts("velocity = [0, -1e6, 0]"),
                &["garment \"sheet\": it starts at 1000000 m/s", "in m/s: a hundredth"],
            ),
            (&starts("velocity = [80, 0, 80]"), &["it starts at 113 m/s"]),
            (&random("\"120 m/s\""), &["garment \"sheet\": vertex ", "starts at 120 m/s"]),
        ],
        &[&starts("velocity = [0, -99, 0]"), &random("99")],
    );
}

#[test]
fn a_garment_that_weighs_what_no_fabric_weighs_is_told() {
    let weighs = |density: &str| {
        SHEET
            .replace("material = \"cotton_shirting\"", &format!("density = {density}\nstretch = {{ stiffness = 100 }}"))
    };
    rule(
        "density",
        without_file,
        &[
            (&weighs("150"), &["garment \"sheet\": its density is 150 kg/m²", "help: write density = \"150 g/m²\""]),
            (&weighs("1e-4"), &["its density is 0.0001 kg/m²", "\"150 g/m²\" for a shirt"]),
        ],
        &[&weighs("0.15"), &weighs("\"15 g/m²\""), &weighs("10.0")],
    );
}

#[test]
fn numbers_that_change_nothing_are_told_with_what_they_need() {
    let ball = |keys: &str| {
        SHEET.replace("panel = { resolution = 12, center = [5, 1, 0] }", "sphere = { resolution = 6, radius = 0.5 }")
            + &format!("[garment.pressure]\noverpressure = 100\n{keys}\n")
    };
    let held = with(HERO) + "rest = \"hero.abc@1\"\n";
    let standing = |folder: &Path| hero(folder, STANDING, 24.0, true);
    let halves = |second: &str| {
        with(&format!(
            "{BALL}[[garment.part]]\nname = \"left\"\nwhere = {{ box = {{ min = [-9, -9, -9], max = [9, 9, 0] }} }}\n\
             [[garment.part]]\nname = \"right\"\nwhere = {{ box = {{ min = [-9, -9, {second}], max = [9, 9, 9] }} }}\n\
             [[contact]]\nbetween = [\"sheet.left\", \"ball\"]\nfriction = 0.1\n\
             [[contact]]\nbetween = [\"ball\", \"sheet.right\"]\nfriction = 0.2\n\
             [[contact]]\nbetween = [\"sheet\", \"ball\"]\nfriction = 0.3\n"
        ))
    };
    rule(
        "idle_setting",
        standing,
        &[
            (&seam("keep_gap = true\nrest_gap = 0.1"), &["seam 0: `rest_gap` changes nothing here", "keep_gap"]),
            (&seam("keep_gap = true\nzip = true"), &["seam 0: `zip` changes nothing here", "keep_gap"]),
            (&halves("1e-6"), &["contact 2: it changes nothing here", "smaller parts"]),
            (&ball("ambient = 90000"), &["garment \"sheet\", pressure: `ambient` changes nothing here", "gas = true"]),
            (&held, &["body \"hero\": `rest` changes nothing here", "preroll"]),
        ],
        &[
            &halves("0.2"),
            &seam("keep_gap = true\nzip = true\nstart = 0\nclosed = 0\nopens = 0.02"),
            &seam("rest_gap = 0.1\nzip = true"),
            &ball("ambient = 90000\ngas = true"),
            &held.replace("frames = \"2-3\"", "frames = \"2-3\"\npreroll = { settle = 2 }"),
        ],
    );
}

#[test]
fn times_outside_the_shot_are_told_in_seconds() {
    // Frames 2 and 3 are at 0 and 0.0417 s.
    let pin = |keys: &str| with(&format!("[[garment.pin]]\ncorners = [\"i0j0\", \"inj0\"]\n{keys}\n"));
    let ball = |keys: &str| with(&format!("{BALL}{keys}\n"));
    let wind = |keys: &str| with(&format!("[wind]\ndensity = 1\nkeys = {keys}\n"));
    rule(
        "outside_shot",
        without_file,
        &[
            (&pin("from = 1.5"), &["pin 0: it never holds: `from` is at 1.5 s, after the last frame", "0.0417 s"]),
            (&pin("until = 0"), &["it never holds: `until` is at 0 s, before"]),
            (&pin("until = 7"), &["it is never released: `until` is at 7 s, after the last frame"]),
            (&pin("from = 3"), &["write 0.0417 in `from` for frame 3"]),
            (&pin("path = [[2, [0, 0, 0]], [3, [0, 1, 0]]]"), &["nothing moves in the shot: `path` is at 2 s"]),
            (&pin("path = [[-2, [0, 0, 0]], [-1, [0, 0, 0]]]"), &["`path` is at -1 s, before"]),
            (&seam("start = 1\nclosed = 2"), &["seam 0: it never closes: `start` is at 1 s"]),
            (&seam("start = -2\nclosed = -1"), &["it is closed at once: `closed` is at -1 s"]),
            (&seam("start = -2\nclosed = -2\nopens = -2\nopened = -1"), &["it is open from the start", "`opened`"]),
            (&seam("start = 0\nclosed = 0\nopens = 7"), &["it never opens: `opens` is at 7 s"]),
            (&seam("keep_gap = true\nopens = 7"), &["it never opens: `opens` is at 7 s"]),
            (&ball("path = [[2, [0, 0, 0]], [3, [0, 1, 0]]]"), &["body \"ball\": nothing moves", "for frame 2"]),
            (&ball("spin = { from = 9, angular_velocity = [0, 1, 0] }"), &["it never turns: `spin.from` is at 9 s"]),
            (&wind("[[1, [0, 0, 1]], [2, [0, 0, 2]]]"), &["wind: nothing moves in the shot: `keys` is at 1 s"]),
        ],
        &[
            &pin("from = 0\nuntil = 0.04"),
            &pin("path = [[9, [0, 0, 0]]]"),
            &pin("until = -0.2").replace("frames = \"2-3\"", "frames = \"2-3\"\npreroll = { settle = 24 }"),
            &seam("start = 0\nclosed = 0\nopens = 0.02"),
            &seam("closed = 5"),
            &seam("keep_gap = true"),
            &ball("path = [[0, [0, 0, 0]], [9, [0, 1, 0]]]"),
            &ball("spin = { from = 0.01, angular_velocity = [0, 1, 0] }"),
            &wind("[[0, [0, 0, 1]], [2, [0, 0, 2]]]"),
        ],
    );
}

#[test]
fn problems_of_what_has_a_number_and_no_name_begin_with_its_line() {
    let seam = "[[seam]]\nfrom = { garment = \"sheet\", corners = [\"i0j0\"] }\n\
                to = { garment = \"sheet\", corners = [\"inj0\"] }\nstrength = 1\n";
    let contact = "[[contact]]\nbetween = [\"sheet\", \"ball\"]\nfriction = 0.3\n";
    for (scene, words) in [
        (
            with(&format!("{seam}opened = 2\n")),
            "scene.toml:11: garment \"sheet\" and garment \"sheet\", seam 0: it has an `opened`",
        ),
        (
            with(&format!("{BALL}{contact}{contact}")),
            "scene.toml:17: contact 1, garment \"sheet\" and body \"ball\": there is another",
        ),
        (
            with("[[garment.elastic]]\nvertices = [0, 143]\nstiffness = 1\n"),
            "scene.toml:11: garment \"sheet\", elastic 0: no edge",
        ),
    ] {
        let parsed =
            scene_file::parse(&scene, "scene.toml", Path::new(""), &[]).unwrap_or_else(|error| panic!("{error}"));
        let shot = parsed.resolve().unwrap_or_else(|errors| panic!("{errors:?}\n{scene}"));
        let error = Shot::prepare(shot, None).map(|_| ()).expect_err("the scene contradicts itself").to_string();
        assert!(error.contains(words), "{error}\n{scene}");
    }
}

/// Sheets of n × n points, 1 m wide, at these heights [m], as OBJ; the faces of those that are turned look down.
fn sheets(n: usize, sheets: &[(f64, bool)]) -> String {
    let mut text = String::new();
    for (height, _) in sheets {
        for i in 0..n * n {
            let [x, z] = [i % n, i / n].map(|step| step as f64 / (n - 1) as f64);
            text += &format!("v {x} {height} {z}\n");
        }
    }
    for (sheet, (_, turned)) in sheets.iter().enumerate() {
        for i in (0..n * (n - 1)).filter(|i| i % n + 1 < n) {
            let mut corners = [i, i + n, i + n + 1, i + 1].map(|corner| sheet * n * n + corner + 1);
            if *turned {
                corners.reverse();
            }
            let [a, b, c, d] = corners;
            text += &format!("f {a} {b} {c} {d}\n");
        }
    }
    text
}

#[test]
fn render_meshes_that_are_bound_badly_are_told_rule_by_rule() {
    let garments = |folder: &Path| {
        let write = |name: &str, text: String| std::fs::write(folder.join(name), text).expect("a file");
        write("cloth.obj", sheets(5, &[(1.0, false), (1.03, true)]));
        let fine = sheets(9, &[(1.005, false)]);
        // The points of one corner, 25 cm above the upper sheet, and of another, just below it.
        write("far.obj", fine.replace("v 0 1.005 0\n", "v 0 1.28 0\n"));
        write("layers.obj", fine.replace("v 1 1.005 1\n", "v 1 1.028 1\n"));
        write("flipped.obj", sheets(9, &[(1.005, true)]));
        write("fine.obj", fine);
    };
    let scene = |file: &str, more: &str| {
        format!(
            "drapery = 1\n[shot]\nframes = \"2-3\"\n[units]\nlength = \"m\"\nup = \"Y\"\n[gravity]\n[[garment]]\nname = \"coat\"\n\
             rest = \"cloth.obj\"\nmaterial = \"cotton_shirting\"\n[garment.render_mesh]\nfile = \"{file}\"\n{more}"
        )
    };
    let object = "garment \"coat\", render mesh (";
    let (fine, loose) = (scene("fine.obj", ""), scene("far.obj", "max_distance = \"26 cm\"\n"));
    rule(
        "render_mesh_distance",
        garments,
        &[(
            &scene("far.obj", ""),
            &[
                object,
                "far.obj): 1 of 81 points are farther than 20.0 mm",
                "point 0, 250.0 mm away",
                "help: write max_distance = \"25",
            ],
        )],
        &[&fine],
    );
    let torn: &[&str] = &[object, "edges join points that are bound to different layers of the cloth"];
    rule("render_mesh_layers", garments, &[(&scene("layers.obj", ""), torn), (&loose, torn)], &[&fine]);
    rule("render_mesh_flipped", garments, &[(&scene("flipped.obj", ""), &[object, "it is flipped"])], &[&fine]);
}

//! No number of a scene makes the program busy for hours without a word: every key is set to what no artist means, and is then
//! either refused with its place, or what is planned stays within bounds. Judged by the work that is planned, never by a clock.

use std::collections::BTreeSet;
use std::path::Path;

use drapery_io::scene_file;
use drapery_shot::Shot;
use serde_json::Value as Json;

/// Steps of a frame that are accepted at most.
const MOST_STEPS: f64 = 1e7;

/// Points beyond which a scene is resolved only: whether they have room is decided before any of them is kept.
const MOST_POINTS: usize = 20_000;

const EXTREMES: [&str; 12] = [
    "0",
    "-1",
    "1e-300",
    "1e-9",
    "1e9",
    "1e300",
    "nan",
    "inf",
    "-inf",
    "4294967295",
    "1000000000",
    "9223372036854775807",
];

const HEAD: &str = "drapery = 1\n[shot]\nname = \"s\"\nfps = 24.0\nframes = \"1-2\"\norigin = [0.0, 0.0, 0.0]\n\
    preroll = { settle = 1, blend = 1 }\n[gravity]\nacceleration = [0.0, -9.81, 0.0]\n";

/// The numbers of the solver, of contact and of the air, of a body that spins on its way, and of springs.
const CONTACT: &str = r#"
[solver]
cfl = 4.0
max_dt = 1e-3
min_dt = 1e-9
strain_per_step = 0.1
cg_tolerance = 1e-3
cg_max_iterations = 200
steps_per_frame = 8
[self_repulsion]
friction = 0.3
thickness_clamp = 0.9
stiffness = 30.0
limit = 0.1
edge_attraction = 0.0
[self_collision]
max_steps = 16.0
[ether_drag]
rate = 0.1
velocity = [0.0, 0.0, 0.0]
[wind]
velocity = [1.0, 0.0, 0.0]
density = 1.2
tangential = 0.1
normal = 0.1
[[body]]
name = "b"
shape = { sphere = { radius = 0.2 } }
path = [[0.0, [0.0, 0.0, 0.0]], [1.0, [0.0, 0.1, 0.0]]]
rotation = { axis = [0.0, 1.0, 0.0], degrees = 10.0 }
spin = { angular_velocity = [0.0, 1.0, 0.0], from = 0.0 }
friction = 0.3
thickness = 0.001
max_push_speed = 1.0
[[garment]]
name = "g"
panel = { resolution = 4, side = 1.0, aspect = 1.0, center = [0.0, 1.0, 0.0], rotation = { axis = [1.0, 0.0, 0.0], degrees = 5.0 } }
density = 0.15
thickness = 0.001
layer = 1
velocity = [0.0, 0.0, 0.0]
[garment.stretch]
stiffness = 100.0
damping_ratio = 1.0
short_edges = 0.1
[garment.shear]
stiffness = 10.0
damping_ratio = 1.0
compressed_by = 0.5
[garment.bending]
stiffness = 1.0
damping_ratio = 1.0
[garment.strain_limit]
limit = 0.1
compression = 0.1
sweeps = 5.0
[garment.render_mesh]
file = "RENDER_MESH"
max_distance = 0.02
[[garment.elastic]]
where = { box = { min = [-9.0, -9.0, -9.0], max = [9.0, 9.0, 9.0] } }
stiffness = 10.0
rest_scale = 0.9
damping_ratio = 1.0
[[garment.pin]]
vertices = [0]
mode = "spring"
from = -1.0
until = 5.0
path = [[0.0, [0.0, 0.0, 0.0]], [1.0, [0.0, 0.1, 0.0]]]
stiffness = 100.0
damping_ratio = 1.0
break_force = 100.0
[[garment.pin]]
nodes = [[1.0, 0.5]]
[[garment.pin]]
where = { box = { min = [-1.0, 0.9, 0.3], max = [1.0, 2.0, 1.0] } }
from = 1.0
[output]
samples = 3
shutter = [-0.25, 0.25]
[[seam]]
from = { garment = "g", vertices = [5] }
to = { garment = "g", vertices = [9] }
strength = 100.0
damping_ratio = 1.0
rest_gap = 0.0
start = 0.0
closed = 1.0
opens = 2.0
opened = 3.0
break_force = 100.0
[[body]]
name = "column"
file = "BODY_MESH"
units = { length = "m", up = "Y" }
[[body]]
name = "belt"
belt = { around = "column", at = [5.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0], width = 0.04, depth = 0.004, gap = 0.006, resolution = 16 }
"#;

/// Membranes that stiffen, angles and folds, in long steps.
const MEMBRANE: &str = r#"
[solver]
integrator = "tr_bdf2"
[[body]]
name = "capsule"
shape = { capsule = { radius = 0.1, half_length = 0.1 } }
position = [0.0, -1.0, 0.0]
[[body]]
name = "cylinder"
shape = { cylinder = { radius = 0.1, half_length = 0.1 } }
position = [1.0, -1.0, 0.0]
[[body]]
name = "box"
shape = { box = { half_extents = [0.1, 0.1, 0.1] } }
position = [2.0, -1.0, 0.0]
[[garment]]
name = "folded"
panel = { resolution = 2, side = 0.2, aspect = 6.0, center = [0.0, 1.0, 0.0] }
folds = { layers = 3, gap = 0.02 }
jitter = { axis = "y", amplitude = 0.001, seed = 3 }
random_velocity = { speed = 1.0, seed = 2 }
total_mass = 0.1
[garment.membrane]
warp = 100.0
weft = 100.0
shear = 30.0
poisson = 0.3
damping_ratio = 1.0
grain = [1.0, 0.0, 0.0]
grain_angle = 0.1
thin_triangles = 0.1
extension = 0.05
load = 98.0
linearity = 0.6
[garment.dihedral_bending]
stiffness = 1e-5
damping_ratio = 1.0
[garment.plastic_wrinkles]
yield_radius = 0.01
hardening = 0.1
largest_angle = 1.0
"#;

/// The other shapes, and springs of a given stiffness each.
const SHAPES: &str = r#"
[[garment]]
name = "disc"
disc = { resolution = 2, radius = 0.5, center = [0.0, 1.0, 0.0] }
density = 0.15
[garment.stretch]
spring_stiffness = 100.0
[[garment]]
name = "ball"
sphere = { resolution = 2, radius = 0.5, center = [2.0, 1.0, 0.0] }
density = 0.15
[garment.pressure]
overpressure = 10.0
[[garment]]
name = "gas"
sphere = { resolution = 2, radius = 0.5, center = [4.0, 1.0, 0.0] }
density = 0.15
[garment.pressure]
gas = true
ambient = 101325.0
[[garment]]
name = "tube"
tube = { resolution = 6, radius = 0.5, length = 0.5, center = [6.0, 1.0, 0.0] }
density = 0.15
[[garment]]
name = "leaves"
leaves = { count = [1, 2, 1], resolution = 1, side = 0.1, aspect = 1.0, base_height = 1.0, seed = 1, max_angle = 30.0 }
density = 0.15
"#;

/// A column of four sides around x = 5.
const COLUMN: &str = "v 5.1 -1 0\nv 5 -1 0.1\nv 4.9 -1 0\nv 5 -1 -0.1\nv 5.1 1 0\nv 5 1 0.1\nv 4.9 1 0\nv 5 1 -0.1\n\
    f 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";

/// All of them; the files of the render mesh and of a body are written.
fn scenes() -> [String; 3] {
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("render_mesh_of_extreme_numbers.obj");
    std::fs::write(&file, "v 0 1 0\nv 0.1 1 0\nv 0 1 0.1\nf 1 2 3\n").expect("a file beside the tests");
    let body = file.with_file_name("body_of_extreme_numbers.obj");
    std::fs::write(&body, COLUMN).expect("a file beside the tests");
    let [file, body] = [&file, &body].map(|file| file.to_str().expect("a path of text").to_owned());
    let with_files = |text: String| text.replace("RENDER_MESH", &file).replace("BODY_MESH", &body);
    [CONTACT, MEMBRANE, SHAPES].map(|rest| with_files(format!("{HEAD}{rest}")))
}

/// Dotted keys of all numbers.
fn numbers(value: &toml::Value, path: &str, found: &mut Vec<String>) {
    let inside = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match value {
        toml::Value::Integer(_) | toml::Value::Float(_) => found.push(path.to_owned()),
        toml::Value::Array(items) => {
            items.iter().enumerate().for_each(|(index, item)| numbers(item, &inside(&index.to_string()), found));
        }
        toml::Value::Table(table) => table.iter().for_each(|(key, value)| numbers(value, &inside(key), found)),
        _ => {}
    }
}

fn keys_of(scene: &str) -> Vec<String> {
    let mut found = Vec::new();
    numbers(&toml::from_str(scene).expect("the scene is TOML"), "", &mut found);
    found
}

/// Returns the fault in the handling of a key with this value; `None` if it was refused with its place, or is within bounds.
fn wrong(scene: &str, key: &str, value: &str) -> Option<String> {
    let place = format!("{key}={value}");
    // A number in a list is named by the key of the list.
    let list =
        key.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('.').rsplit('.').next().unwrap_or(key);
    let names = [place.clone(), format!("`{list}` = ")];
    let missing_place = |message: &str| {
        let is_named = names.iter().any(|name| message.contains(name));
        (!is_named).then(|| format!("{place}: its place is missing in {message}"))
    };
    let set = [(key.to_owned(), value.to_owned())];
    let description = match scene_file::parse(scene, "scene.toml", Path::new(""), &set) {
        Err(error) => return missing_place(&error.to_string()),
        Ok(file) => match file.resolve() {
            // Two that depend on each other are reported at the table of both.
            Err(errors) => return errors[0].location.is_none().then(|| format!("{place}: {}", errors[0])),
            Ok(description) => description,
        },
    };
    let points: usize = description.scene.garments.iter().map(|garment| garment.point_count()).sum();
    if points > MOST_POINTS {
        return None;
    }
    match Shot::prepare(description, None) {
        Err(error) => (!error.to_string().contains("help:")).then(|| format!("{place}: no help in {error}")),
        Ok(shot) => {
            let steps = shot.simulation().planned_steps().steps;
            (steps > MOST_STEPS || steps.is_nan()).then(|| format!("{place}: {steps:e} steps a frame are planned"))
        }
    }
}

#[test]
fn every_number_of_a_scene_at_its_extremes_is_refused_with_its_place_or_planned_within_bounds() {
    for scene in scenes() {
        assert_eq!(wrong(&scene, "shot.name", "\"as_it_is\""), None);
        for key in keys_of(&scene) {
            let found: Vec<String> = EXTREMES.iter().filter_map(|value| wrong(&scene, &key, value)).collect();
            assert!(found.is_empty(), "{}", found.join("\n"));
        }
    }
}

/// Keys of numbers in the schema that have no range; every value of these is possible, or is compared with what it counts.
const WITHOUT_RANGE: [&str; 8] = ["drapery", "seed", "vertices", "min", "max", "from", "until", "max_push_speed"];

/// Goes through a schema, by the key that leads to each part of it.
fn look(schema: &Json, key: &str, found: &mut dyn FnMut(&str, &Json)) {
    found(key, schema);
    for (inner, value) in schema["properties"].as_object().into_iter().flatten() {
        look(value, inner, found);
    }
    let parts = ["items", "prefixItems", "anyOf", "oneOf"].into_iter().filter_map(|part| schema.get(part));
    for part in parts {
        part.as_array()
            .map_or(std::slice::from_ref(part), Vec::as_slice)
            .iter()
            .for_each(|part| look(part, key, found));
    }
}

#[test]
fn every_number_of_the_schema_has_a_smallest_and_a_largest_value_and_is_tried() {
    let schema: Json = serde_json::from_str(&scene_file::schema()).expect("the schema is JSON");
    let tried: BTreeSet<String> = scenes()
        .iter()
        .flat_map(|scene| keys_of(scene))
        .flat_map(|key| key.split('.').map(str::to_owned).collect::<Vec<_>>())
        .collect();
    let mut missing = BTreeSet::new();
    let mut each = |key: &str, part: &Json| {
        let is = |kind: &str| {
            part["type"] == kind || part["type"].as_array().is_some_and(|kinds| kinds.iter().any(|k| k == kind))
        };
        if !(is("number") || is("integer")) || key == "parameters" || key == "keys" {
            return;
        }
        let ranged = part["minimum"].is_number() && part["maximum"].is_number();
        if !(ranged || WITHOUT_RANGE.contains(&key)) {
            missing.insert(format!("{key} has no range"));
        }
        if !tried.contains(key) {
            missing.insert(format!("{key} is not tried"));
        }
    };
    look(&schema, "", &mut each);
    for part in schema["$defs"].as_object().into_iter().flatten() {
        look(part.1, "", &mut each);
    }
    assert!(missing.is_empty(), "{missing:?}");
}

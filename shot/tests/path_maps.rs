//! A scene whose inputs are found elsewhere by a path map is the same shot, as long as they hold the same.

use std::path::Path;

use drapery_io::scene_file::{PathMaps, SearchPaths, load_with};
use drapery_io::shot_description::ShotDescription;
use drapery_shot::farm::digest::{Fingerprint, Versions, compare};
use tempfile::TempDir;

const DRESSED: &str = r#"
drapery = 1
[shot]
frames = "0-10"
[units]
length = "m"
[[body]]
name = "hero"
file = 'X:\lib\hero.obj'
[[garment]]
name = "skirt"
rest = 'X:\lib\skirt.obj'
material = "denim_11oz"
[[garment.pin]]
file = 'X:\lib\skirt_pins.json'
to = "body:hero"
"#;

/// A folder with the files of the scene.
fn wardrobe() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("a file");
    write("hero.obj", "v 0 0 0\nv 1.5 0 0\nv 0 0 1.5\nf 1 2 3\n");
    write("skirt.obj", "v 0 0 0.1\nv 0.5 0 0.1\nv 0 0.5 0.1\nf 1 2 3\n");
    write(
        "skirt_pins.json",
        r#"{"body": "hero.obj", "pins": [{"vertex": 2, "body_vertices": [2, 0, 1], "weights": [0.25, 0.5, 0.25],
            "offset_tangent_bitangent_normal": [0, 0.01, 0.02]}]}"#,
    );
    folder
}

#[test]
fn path_maps_find_inputs_elsewhere_and_leave_the_shot_the_same() {
    let versions = Versions { solver: 1, integrator: "tr_bdf2", format: 1, application: "Drapery" };
    let (a, b, scenes) = (wardrobe(), wardrobe(), tempfile::tempdir().expect("a temporary folder"));
    let path = scenes.path().join("dressed.toml");
    std::fs::write(&path, DRESSED).expect("a file");
    let shot_in = |lib: &Path| {
        let maps = PathMaps::new([("X:/lib/".to_owned(), lib.to_string_lossy().into_owned())]).expect("a map");
        let scene = load_with(&path, &[], &SearchPaths { maps, ..SearchPaths::default() });
        scene.unwrap_or_else(|error| panic!("{error}")).resolve().unwrap_or_else(|errors| panic!("{}", errors[0]))
    };
    let print = |shot: &ShotDescription| {
        Fingerprint::of(&shot.resolved, &path, &shot.input_files, versions).expect("inputs can be read")
    };
    let (first, second) = (shot_in(a.path()), shot_in(b.path()));
    assert!(first.resolved.contains("# scene, path map"), "{}", first.resolved);
    assert_eq!(format!("{:?}", first.scene), format!("{:?}", second.scene));
    let changes = compare(&print(&first), &print(&second));
    assert_eq!(changes.forbidden, Vec::<String>::new());
    assert!(!changes.allowed.is_empty(), "the other place is named");
    // Other content at the place of the other map is another shot.
    let skirt = b.path().join("skirt.obj");
    let mesh = std::fs::read_to_string(&skirt).expect("a mesh");
    std::fs::write(&skirt, format!("# another\n{mesh}")).expect("a mesh");
    assert!(!compare(&print(&first), &print(&shot_in(b.path()))).forbidden.is_empty());
}

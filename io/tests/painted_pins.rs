//! Hard pins that are painted: attributes of the rest shape, and lists of numbers.

use std::fs;
use std::path::Path;

use drapery_core::scene::{PinHold, PinTarget};
use drapery_io::scene_file;

const SQUARE: &str = "v 0 1 0\nv 1 1 0\nv 1 1 1\nv 0 1 1\nf 1 4 3 2\n";

/// A square with one pin that is said by this line.
fn pinned(folder: &Path, rest: &str, line: &str) -> Result<(Vec<u32>, String), String> {
    let text = format!(
        "drapery = 1\n[shot]\nname = \"square\"\nframes = \"1-2\"\n[units]\nlength = \"m\"\nup = \"Y\"\n[gravity]\n[[garment]]\n\
         name = \"square\"\nrest = \"{rest}\"\nmaterial = \"cotton_shirting\"\n[[garment.pin]]\n{line}\n"
    );
    let scene = scene_file::parse(&text, "scene.toml", folder, &[]).map_err(|error| error.to_string())?;
    let shot =
        scene.resolve().map_err(|errors| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))?;
    let pin = &shot.scene.pins[0];
    assert_eq!(pin.hold, PinHold::Hard);
    let PinTarget::Path { vertices, .. } = &pin.target else { panic!("{pin:?}") };
    Ok((vertices.clone(), shot.resolved))
}

#[test]
fn vertices_are_held_where_a_map_is_above_one_half() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("square.obj"), SQUARE).unwrap();
    fs::write(folder.path().join("hold.txt"), "1 0.5 0.51, 0\n").unwrap();
    let (vertices, resolved) = pinned(folder.path(), "square.obj", "map = \"file:hold.txt\"").unwrap();
    assert_eq!(vertices, [0, 2]);
    // The scene as it was run finds the file from anywhere.
    let line = resolved.lines().find(|line| line.starts_with("map = ")).unwrap();
    assert!(line.contains("hold.txt") && line.contains(&*folder.path().to_string_lossy()), "{line}");
}

#[cfg(feature = "usd")]
#[test]
fn a_primvar_of_the_rest_shape_holds_a_hard_pin() {
    let folder = tempfile::tempdir().unwrap();
    let text = "#usda 1.0\n(\n    defaultPrim = \"square\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\ndef Mesh \"square\"\n{\n    \
                point3f[] points = [(0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)]\n    int[] faceVertexCounts = [4]\n    \
                int[] faceVertexIndices = [0, 3, 2, 1]\n    \
                float[] primvars:pin = [0, 1, 0.2, 1] (\n        interpolation = \"vertex\"\n    )\n}\n";
    fs::write(folder.path().join("square.usda"), text).unwrap();
    assert_eq!(pinned(folder.path(), "square.usda", "map = \"pin\"").unwrap().0, [1, 3]);
    let error = pinned(folder.path(), "square.usda", "map = \"pins\"").unwrap_err();
    assert!(error.contains("no attribute `pins`") && error.contains("pin"), "{error}");
}

#[test]
fn maps_that_hold_nothing_real_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("square.obj"), SQUARE).unwrap();
    for (values, words) in [
        ("0 0.25 0 0", ["nowhere above 0.5", "largest value is 0.25"]),
        ("1 1 1", ["this map has 3 values", "the garment has 4"]),
        ("1 nan 0 0", ["`nan` is not a number", "vertex 1"]),
    ] {
        fs::write(folder.path().join("hold.txt"), values).unwrap();
        let error = pinned(folder.path(), "square.obj", "map = \"file:hold.txt\"").unwrap_err();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    fs::write(folder.path().join("hold.txt"), "1 0 0 0").unwrap();
    let error = pinned(folder.path(), "square.obj", "map = \"file:hold.txt\"\nvertices = [0]").unwrap_err();
    assert!(error.contains("exactly one of"), "{error}");
}

//! Stages that are incomplete, contradict themselves or are damaged: each has an error that names the place, and none does harm.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use drapery_usd::read::{Stage, UsdError, UsdErrorKind};

/// A triangle under the name of its prim.
fn triangle(name: &str, more: &str) -> String {
    format!(
        "def Mesh \"{name}\" {{\n point3f[] points = [(0,0,0), (1,0,0), (0,1,0)]\n int[] faceVertexCounts = [3]\n \
         int[] faceVertexIndices = [0, 1, 2]\n {more}\n}}\n"
    )
}

fn usda(body: &str) -> String {
    format!("#usda 1.0\n( metersPerUnit = 1\n upAxis = \"Y\" )\n{body}")
}

/// The first error of a stage: of opening it, of its composition, of a mesh.
fn first_error(path: &Path) -> Result<(), UsdError> {
    let stage = Stage::open(path)?;
    if let Some((_, flaw)) = stage.about().flaws.first() {
        return Err(flaw.clone());
    }
    for mesh in 0..stage.about().meshes.len() {
        let chosen = stage.choose(&[mesh])?;
        for code in chosen.codes.iter().copied().chain([0.0]) {
            stage.mesh(0, code)?;
        }
    }
    Ok(())
}

#[track_caller]
fn error_of(text: &str) -> UsdError {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.usda");
    fs::write(&path, usda(text)).unwrap();
    first_error(&path).expect_err(text)
}

#[test]
fn missing_layers_are_named_as_missing_with_the_prim_that_needs_them() {
    for arc in ["references", "payload", "references = [@./there.usda@]\n prepend references"] {
        let error = error_of(&format!("def \"hero\" ( prepend {arc} = @./nowhere.usda@ ) {{}}"));
        if arc.contains("there") {
            continue;
        }
        assert_eq!(error.kind, UsdErrorKind::Missing, "{error}");
        assert!(error.place == "/hero" && error.what.contains("nowhere.usda"), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.usda");
    fs::write(&path, "#usda 1.0\n( subLayers = [@./nowhere.usda@] )\n").unwrap();
    let error = first_error(&path).unwrap_err();
    assert!(error.kind == UsdErrorKind::Missing && error.what.contains("nowhere.usda"), "{error}");
}

#[test]
fn references_in_a_circle_end_and_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a.usda", "b.usda"].map(|name| folder.path().join(name));
    fs::write(&a, "#usda 1.0\ndef \"x\" ( references = @./b.usda@</x> ) {}").unwrap();
    fs::write(&b, "#usda 1.0\ndef \"x\" ( references = @./a.usda@</x> ) {}").unwrap();
    let error = first_error(&a).unwrap_err();
    assert!(error.what.contains("cycle") && error.kind == UsdErrorKind::BadInput, "{error}");
    fs::write(&a, "#usda 1.0\n( subLayers = [@./a.usda@] )\n").unwrap();
    let error = first_error(&a).unwrap_err();
    assert!(error.what.contains("cycle") || error.what.contains("sublayer"), "{error}");
}

#[test]
fn meshes_that_contradict_themselves_are_named_with_the_element() {
    let mesh = |points: &str, counts: &str, indices: &str| {
        format!(
            "def Mesh \"m\" {{ point3f[] points = {points}\n int[] faceVertexCounts = {counts}\n int[] faceVertexIndices = \
             {indices} }}"
        )
    };
    let three = "[(0,0,0), (1,0,0), (0,1,0)]";
    for (text, expected) in [
        (mesh(three, "[3]", "[0, 1, 3]"), "corner 2 is point 3, but the mesh has 3 points"),
        (mesh(three, "[3]", "[0, -1, 2]"), "corner 1 is point -1"),
        (mesh(three, "[4]", "[0, 1, 2]"), "its faces have 4 corners, but faceVertexIndices has 3 values"),
        (mesh(three, "[2, 3]", "[0, 1, 0, 1, 2]"), "face 0 has 2 corners"),
        (mesh(three, "[-3]", "[0, 1, 2]"), "face 0 has -3 corners"),
        ("def Mesh \"m\" { int[] faceVertexCounts = [3] }".to_owned(), "it has no points"),
        ("def Mesh \"m\" { int[] points = [1, 2, 3] }".to_owned(), "not a list of points"),
        (triangle("m", "token[] xformOpOrder = [\"xformOp:shear\"]"), "`xformOp:shear` is not a known operation"),
        (
            triangle("m", "float xformOp:translate = 2\n token[] xformOpOrder = [\"xformOp:translate\"]"),
            "does not match its name",
        ),
        (
            triangle("m", "float3 xformOp:scale = (0, 1, 1)\n token[] xformOpOrder = [\"!invert!xformOp:scale\"]"),
            "has no inverse",
        ),
        (triangle("m", "def GeomSubset \"s\" { int[] indices = [1] }"), "it holds face 1, but the mesh has 1 faces"),
        (
            triangle(
                "m",
                "float[] primvars:w = [1] ( interpolation = \"vertex\" )\n int[] primvars:w:indices = [0, 1, 0]",
            ),
            "it refers to value 1, and has 1 values",
        ),
    ] {
        let error = error_of(&text);
        assert_eq!(error.kind, UsdErrorKind::BadInput);
        assert!(error.what.contains(expected) && error.place.contains("/m"), "{text}: {error}");
    }
}

#[test]
fn points_that_change_their_number_are_refused_between_samples() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.usda");
    let points =
        "point3f[] points.timeSamples = { 1: [(0,0,0), (1,0,0), (0,1,0)], 2: [(0,0,0), (1,0,0), (0,1,0), (1,1,1)] }";
    let text =
        format!("def Mesh \"m\" {{ {points}\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0,1,2] }}");
    fs::write(&path, usda(&text)).unwrap();
    let stage = Stage::open(&path).unwrap();
    assert_eq!(stage.choose(&[0]).unwrap().codes, [1.0, 2.0]);
    assert_eq!([1.0, 2.0, 99.0].map(|code| stage.points(0, code).unwrap().len()), [3, 4, 4]);
    let error = stage.points(0, 1.5).unwrap_err();
    assert!(error.what.contains("3 points at time code 1 and 4 at 2"), "{error}");
}

/// A character of one triangle and two joints, with a few things replaced.
fn character(replaced: &[(&str, &str)]) -> String {
    let eye = "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))";
    let mut text = format!(
        "def SkelRoot \"r\" {{\n def Skeleton \"s\" {{ uniform token[] joints = [\"a\", \"a/b\"]\n \
         uniform matrix4d[] bindTransforms = [{eye}, {eye}]\n uniform matrix4d[] restTransforms = [{eye}, {eye}] }}\n {} }}",
        triangle(
            "m",
            "prepend apiSchemas = []\n rel skel:skeleton = </r/s>\n int[] primvars:skel:jointIndices = [0,1, 0,1, 0,1] ( \
             elementSize = 2\n interpolation = \"vertex\" )\n float[] primvars:skel:jointWeights = [1,0, 0.5,0.5, 0,1] ( \
             elementSize = 2\n interpolation = \"vertex\" )"
        )
    );
    text = text
        .replace("prepend apiSchemas = []\n ", "")
        .replace("def Mesh \"m\" {", "def Mesh \"m\" ( prepend apiSchemas = [\"SkelBindingAPI\"] ) {");
    for (a, b) in replaced {
        assert!(text.contains(a), "{a} in {text}");
        text = text.replace(a, b);
    }
    text
}

#[test]
fn skeletons_that_do_not_fit_are_named() {
    let eye = "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))";
    let two = format!("[{eye}, {eye}]");
    let bind = format!("uniform matrix4d[] bindTransforms = {two}");
    let rest = format!("uniform matrix4d[] restTransforms = {two}");
    for (a, b, expected) in [
        (bind.as_str(), "", "no bindTransforms"),
        (rest.as_str(), "", "neither restTransforms nor an animation"),
        (
            "bindTransforms = [",
            "bindTransforms = [((0,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ",
            "2 joints and 3 bindTransforms",
        ),
        ("[\"a\", \"a/b\"]", "[\"a/b\", \"a\"]", "stands before its parent"),
        ("[0,1, 0,1, 0,1]", "[0,1, 0,2, 0,1]", "point 1 follows joint 2, but there are 2 joints"),
        ("[0,1, 0,1, 0,1]", "[0,1, 0,1]", "4 joint indices, 6 weights"),
        ("0.5,0.5", "nan,0.5", "a weight of point 1 is NaN"),
        ("rel skel:skeleton = </r/s>", "rel skel:skeleton = </r/nowhere>", "which is not a skeleton"),
        (
            "rel skel:skeleton",
            "uniform token primvars:skel:skinningMethod = \"cubic\"\n rel skel:skeleton",
            "skinningMethod is cubic",
        ),
        (
            "rel skel:skeleton",
            "uniform token[] skel:joints = [\"a\", \"c\"]\n rel skel:skeleton",
            "its joint c does not exist",
        ),
        ("rel skel:skeleton", "uniform token[] skel:blendShapes = [\"smile\"]\n rel skel:skeleton", ""),
    ] {
        let text = character(&[(a, b)]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stage.usda");
        fs::write(&path, usda(&text)).unwrap();
        match first_error(&path) {
            Err(error) => assert!(!expected.is_empty() && error.what.contains(expected), "{text}: {error}"),
            // Blend shapes that nothing weighs move nothing.
            Ok(()) => assert!(expected.is_empty(), "{text}"),
        }
    }
}

#[test]
fn weights_that_do_not_sum_to_one_are_used_as_they_are_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.usda");
    fs::write(&path, usda(&character(&[("0.5,0.5", "0.5,0.25")]))).unwrap();
    let stage = Stage::open(&path).unwrap();
    let notes = stage.choose(&[0]).unwrap().notes;
    assert!(
        notes.iter().any(|note| note.contains("weights of 1 points do not sum to one, by up to 0.250")),
        "{notes:?}"
    );
    assert_eq!(stage.points(0, 0.0).unwrap()[1], [0.75, 0.0, 0.0]);
}

#[test]
fn meshes_that_are_not_rendered_are_told_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.usda");
    let text = [
        triangle("a", ""),
        triangle("b", "uniform token purpose = \"guide\""),
        format!("def Xform \"c\" {{ token visibility = \"invisible\"\n {} }}", triangle("d", "")),
        format!("def Scope \"e\" {{ uniform token purpose = \"proxy\"\n {} }}", triangle("f", "")),
        format!("def PointInstancer \"g\" {{ {} }}", triangle("h", "")),
        triangle("i", "token visibility.timeSamples = { 1: \"invisible\", 2: \"inherited\" }"),
        "class \"j\" { def Mesh \"k\" {} }\n over \"l\" { def Mesh \"m\" {} }\n def Mesh \"n\" ( active = false ) {}"
            .into(),
    ];
    fs::write(&path, usda(&text.concat())).unwrap();
    let stage = Stage::open(&path).unwrap();
    let messages: Vec<(&str, Option<String>)> =
        stage.about().meshes.iter().map(|entry| (entry.path.as_str(), entry.skipped())).collect();
    let expected = [
        ("/a", None),
        ("/b", Some("its purpose is guide")),
        ("/c/d", Some("it is invisible")),
        ("/e/f", Some("its purpose is proxy")),
        ("/g/h", Some("it is below a PointInstancer, but not one of its prototypes")),
        ("/i", None),
    ];
    assert_eq!(messages, expected.map(|(path, why)| (path, why.map(str::to_owned))));
}

#[test]
fn stages_that_grow_without_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.usda");
    let nested = |depth: usize| "def \"x\" { ".repeat(depth) + &"}".repeat(depth);
    fs::write(&path, usda(&nested(200))).unwrap();
    first_error(&path).unwrap();
    fs::write(&path, usda(&nested(100_000))).unwrap();
    let error = first_error(&path).unwrap_err();
    assert!(error.what.contains("nested more than 256 deep"), "{error}");
    // References that double at every level come to the same, from a few lines.
    let wide: String = (0..100_001).map(|number| format!("def \"x{number}\" {{}}\n")).collect();
    fs::write(&path, usda(&wide)).unwrap();
    let error = first_error(&path).unwrap_err();
    assert!(error.what.contains("more than 100000 prims"), "{error}");
}

#[test]
fn what_is_no_stage_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    for (name, bytes) in [
        ("empty.usda", &b""[..]),
        ("text.usda", b"not USD"),
        ("text.usdc", b"not USD"),
        ("cut.usdc", b"PXR-USDC"),
        ("zip.usdz", b"PK\x03\x04"),
        ("other.usd", b"\x00\x01\x02"),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let error = first_error(&path).err();
        // A text layer without a line is taken by Pixar's library neither.
        assert!(error.is_some_and(|error| error.kind == UsdErrorKind::BadInput), "{name}");
    }
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn names_with_spaces_and_letters_of_any_language_and_paths_out_of_the_folder_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let [inner, outer] = ["Frau Müller 女", "außen [1]"].map(|name| folder.path().join(name));
    for folder in [&inner, &outer] {
        fs::create_dir(folder).unwrap();
    }
    fs::write(
        outer.join("körper v2.usda"),
        usda(&triangle("körper", "")).replace("( metersPerUnit", "( defaultPrim = \"körper\"\n metersPerUnit"),
    )
    .unwrap();
    let path = inner.join("szene 1.usda");
    fs::write(&path, usda("def \"held\" ( references = @../außen [1]/körper v2.usda@ ) {}")).unwrap();
    let stage = Stage::open(&path).unwrap();
    assert!(stage.about().flaws.is_empty(), "{:?}", stage.about().flaws);
    assert_eq!(stage.about().meshes[0].path, "/held");
    assert_eq!(stage.about().layers.len(), 2);
}

#[test]
fn a_number_that_begins_with_its_point_is_an_error_that_says_what_to_write() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("layer.usda");
    fs::write(&path, usda(&triangle("a", "float primvars:wet = .3"))).unwrap();
    let stage = folder.path().join("stage.usda");
    fs::write(&stage, "#usda 1.0\n(\n    subLayers = [@./layer.usda@]\n)\n").unwrap();
    let alone = Stage::open(&path).map(|_| ()).unwrap_err();
    let below = Stage::open(&stage).unwrap().about().flaws[0].1.clone();
    for error in [alone, below] {
        assert!(error.advice.contains("(.3) is right in USD") && error.advice.contains("write 0.3"), "{error}");
        assert!(error.what.contains("layer.usda:"), "{error}");
    }
}

//! Stages of other programs as caches: read in whole frames, converted, refused by name.
#![cfg(feature = "usd")]

use std::fs;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_io::cache_frames::CacheFrames;
use drapery_io::convert::{Conversion, Converted, convert};
use drapery_io::error::IoError;
use drapery_io::units::{LengthUnit, UpAxis};

/// A quad at a radius of 100 cm that its parent turns about Z by 10 degrees a frame, from frame 1 to 5, and that does not move by
/// itself but says so.
const TURNING: &str = r#"#usda 1.0
(
    defaultPrim = "set"
    metersPerUnit = 0.01
    upAxis = "Z"
    startTimeCode = 1
    endTimeCode = 5
)
def Xform "set"
{
    float xformOp:rotateZ.timeSamples = { 1: 0, 5: 40 }
    uniform token[] xformOpOrder = ["xformOp:rotateZ"]
    def Mesh "cloth"
    {
        point3f[] points = [(100, 0, 0), (110, 0, 0), (110, 10, 0), (100, 10, 0)]
        vector3f[] velocities = [(0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)]
        float3[] extent = [(100, 0, 0), (110, 10, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        uniform token subdivisionScheme = "none"
        string[] primvars:part = ["front"] ( interpolation = "uniform" )
    }
}
"#;

fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

fn converted(from: &Path, to: &Path) -> Result<Converted, IoError> {
    let conversion = Conversion { from: from.to_owned(), to: to.to_owned(), ..Conversion::default() };
    convert(&conversion, &mut |_| {})
}

/// Returns the position and velocity of a point of the turning quad at a frame [m, m/s; Y up].
fn expected(point: [f64; 2], frame: i64) -> (Vec3, Vec3) {
    let angle = (10.0 * (frame - 1) as f64).to_radians();
    let turn_rate = 10.0_f64.to_radians() * 24.0;
    let [x, y] = [point[0] * angle.cos() - point[1] * angle.sin(), point[0] * angle.sin() + point[1] * angle.cos()];
    // Z up as Y up: (x, y, z) becomes (x, z, -y).
    (Vec3::new(x, 0.0, -y), turn_rate * Vec3::new(-y, 0.0, -x))
}

#[test]
fn a_mesh_under_a_parent_that_turns_is_where_it_is_and_as_fast_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let from = written(folder.path(), "shot.usda", TURNING);
    let mut caches = vec![from.clone()];
    for to in ["abc", "h5", "usd", "usdc"] {
        let to = folder.path().join(format!("cloth.{to}"));
        let done = converted(&from, &to).unwrap();
        assert_eq!(
            (done.frames, done.points, done.units.length, done.units.up),
            ([1, 5], 4, LengthUnit::Centimetre, UpAxis::Z)
        );
        caches.push(to);
    }
    for path in caches {
        let cache = CacheFrames::open(&path).unwrap();
        let name = path.display();
        assert_eq!((cache.fps, cache.meshes.len()), (Some(24.0), 1), "{name}");
        assert_eq!(cache.meshes[0].frames, [1, 2, 3, 4, 5], "{name}");
        for (sample, frame) in (1..=5).enumerate() {
            let (place, rate) = expected([1.1, 0.1], frame);
            let (positions, velocities) =
                (cache.positions(0, sample).unwrap(), cache.velocities(0, sample).unwrap().unwrap());
            // f32 of 110 cm; of velocities, the chord of 10 degrees for its arc at the ends, where half a frame is held.
            assert!((positions[2] - place).norm() < 1e-7, "{name}, frame {frame}: {}", positions[2]);
            let inside = (2..=4).contains(&frame);
            assert!(
                !inside || (velocities[2] - rate).norm() < 2e-3 * rate.norm(),
                "{name}, frame {frame}: {}",
                velocities[2]
            );
        }
        let data = cache.attributes(0).unwrap();
        let texts = data.params.iter().map(|param| (param.name.as_str(), param.values.as_slice())).collect::<Vec<_>>();
        // HDF5 has no place for attributes.
        let has_texts = path.extension().unwrap() != "h5";
        assert_eq!(texts, if has_texts { vec![("part", b"front\0".as_slice())] } else { Vec::new() }, "{name}");
    }
}

#[test]
fn time_codes_are_frames_by_the_rates_of_the_stage_and_samples_tell_where_it_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let rates = "framesPerSecond = 24\n    timeCodesPerSecond = 48\n    upAxis";
    let path = written(
        folder.path(),
        "rates.usda",
        &TURNING.replace("upAxis", rates).replace("endTimeCode = 5", "endTimeCode = 10"),
    );
    let cache = CacheFrames::open(&path).unwrap();
    assert_eq!((cache.fps, cache.codes_per_frame), (Some(24.0), 2.0));
    assert_eq!(cache.meshes[0].frames, [1, 2, 3, 4, 5]);
    // Frame 2 is code 4: three quarters of 40 degrees.
    let place = cache.positions(0, 1).unwrap()[0];
    assert!((place - Vec3::new(30.0_f64.to_radians().cos(), 0.0, -0.5)).norm() < 1e-7, "{place}");
    let path = written(folder.path(), "open.usda", &TURNING.replace("startTimeCode = 1\n    endTimeCode = 5", ""));
    let cache = CacheFrames::open(&path).unwrap();
    assert_eq!(cache.meshes[0].frames, [1, 2, 3, 4, 5]);
    assert!(cache.notes.iter().any(|note| note.contains("first and last time code")), "{:?}", cache.notes);
    let endless = TURNING.replace("endTimeCode = 5", "endTimeCode = 1e12");
    let error = CacheFrames::open(&written(folder.path(), "endless.usda", &endless)).unwrap_err().to_string();
    assert!(error.contains("/set/cloth") && error.contains("100000 frames"), "{error}");
}

#[test]
fn a_unit_that_caches_do_not_have_becomes_metres() {
    let folder = tempfile::tempdir().unwrap();
    let from = written(folder.path(), "dm.usda", &TURNING.replace("metersPerUnit = 0.01", "metersPerUnit = 0.1"));
    let to = folder.path().join("m.abc");
    assert_eq!(converted(&from, &to).unwrap().units.length, LengthUnit::Metre);
    let place = CacheFrames::open(&to).unwrap().positions(0, 0).unwrap()[1];
    assert!((place - Vec3::new(11.0, 0.0, 0.0)).norm() < 1e-6, "{place}");
}

#[test]
fn what_cannot_be_a_cache_is_refused_by_name_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let two = TURNING.replace("def Mesh \"cloth\"", "def Mesh \"other\" {\n point3f[] points = [(0,0,0), (1,0,0), (0,1,0)]\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0,1,2]\n }\n    def Mesh \"cloth\"");
    let changing = TURNING.replace(
        "point3f[] points = [(100, 0, 0), (110, 0, 0), (110, 10, 0), (100, 10, 0)]",
        "point3f[] points.timeSamples = { 1: [(0,0,0), (1,0,0), (1,1,0), (0,1,0)], 3: [(0,0,0), (1,0,0), (1,1,0), (0,1,0), (2,2,2)] }",
    );
    let faces = TURNING.replace(
        "int[] faceVertexIndices = [0, 1, 2, 3]",
        "int[] faceVertexIndices.timeSamples = { 1: [0, 1, 2, 3], 3: [1, 2, 3, 0] }",
    );
    let missing = TURNING
        .replace("def Xform \"set\"\n", "def \"gone\" ( references = @./nowhere.usda@ ) {}\ndef Xform \"set\"\n");
    let cases: [(&str, &str, &[&str]); 3] = [
        ("two.usda", &two, &["2 meshes", "--object", "/set/cloth", "/set/other"]),
        ("changing.usda", &changing, &["/set/cloth", "points"]),
        ("faces.usda", &faces, &["/set/cloth", "frame 3 has different faces"]),
    ];
    for (name, text, parts) in cases {
        let from = written(folder.path(), name, text);
        let error = converted(&from, &folder.path().join("out.abc")).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{name}: {error}");
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert!(left.iter().all(|name| name.to_string_lossy().ends_with(".usda")), "{left:?}");
    }
    // All that is missing concerns a comparison; the mesh itself does not need it.
    let cache = CacheFrames::open(&written(folder.path(), "missing.usda", &missing)).unwrap();
    assert!(cache.samples.check_complete(Some(&cache.meshes[0].name)).is_ok());
    assert!(cache.samples.check_complete(None).unwrap_err().to_string().contains("nowhere.usda"));
    // Both meshes fit into one layer.
    let both = converted(&written(folder.path(), "two.usda", &two), &folder.path().join("both.usdc")).unwrap();
    assert_eq!(both.points, 7);
    let cache = CacheFrames::open(&folder.path().join("both.usdc")).unwrap();
    assert_eq!(cache.meshes.iter().map(|mesh| mesh.name.as_str()).collect::<Vec<_>>(), ["/set/cloth", "/set/other"]);
}

/// A sheet for everything, one for viewports and one that nobody sees, bound to materials of which one is not there.
const PURPOSES: &str = r#"#usda 1.0
(
    defaultPrim = "char"
    metersPerUnit = 1
    upAxis = "Y"
    startTimeCode = 1
    endTimeCode = 2
)
def Xform "char"
{
    def Mesh "cape" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 2: [(0, 0, 1), (1, 0, 1), (0, 1, 1)] }
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        uniform token subdivisionScheme = "none"
        uniform bool doubleSided = true
        int[] creaseIndices = [0, 1]
        int[] creaseLengths = [2]
        float[] creaseSharpnesses = [2]
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1)] ( interpolation = "faceVarying" )
        float[] primvars:wet.timeSamples = { 1: [0, 0, 0], 2: [1, 1, 1] }
        float[] primvars:wet ( interpolation = "vertex" )
        matrix4d[] primvars:frame = [((1, 2, 3, 4), (5, 6, 7, 8), (9, 10, 11, 12), (13, 14, 15, 16))] ( interpolation = "constant" )
        texCoord2f[] primvars:second = [(0, 0), (1, 0), (0, 1)] ( interpolation = "vertex" )
        rel material:binding = </char/mtl/red> ( bindMaterialAs = "strongerThanDescendants" )
        def GeomSubset "hem" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </looks/blue>
        }
    }
    def Mesh "rough"
    {
        uniform token purpose = "proxy"
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
    }
    def Mesh "nobody"
    {
        token visibility = "invisible"
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
    }
}
"#;

#[test]
fn meshes_of_all_purposes_are_converted_with_theirs_and_what_is_hidden_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let from = written(folder.path(), "char.usda", PURPOSES);
    let to = folder.path().join("all.usdc");
    let messages = converted(&from, &to).unwrap().left_out;
    assert!(messages.iter().any(|what| what == "/char/nobody is left out: it is invisible"), "{messages:?}");
    for path in [&from, &to] {
        let cache = CacheFrames::open(path).unwrap();
        let meshes: Vec<_> = cache.meshes.iter().map(|mesh| (mesh.name.as_str(), mesh.purpose.as_deref())).collect();
        assert_eq!(meshes, [("/char/cape", None), ("/char/rough", Some("proxy"))]);
    }
}

#[test]
fn what_a_mesh_has_and_is_not_handed_through_is_told_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let from = written(folder.path(), "char.usda", PURPOSES);
    for to in ["abc", "usd", "usdc"] {
        let object = Some("/char/cape".to_owned());
        let to = folder.path().join(format!("cape.{to}"));
        let conversion = Conversion { from: from.clone(), to: to.clone(), object, ..Conversion::default() };
        let messages = convert(&conversion, &mut |_| {}).unwrap().left_out;
        let left = ["creaseIndices", "creaseLengths", "creaseSharpnesses", "normals (faceVarying)"];
        let mut expected: Vec<String> =
            left.iter().map(|name| format!("/char/cape: {name} is not copied to the cache")).collect();
        expected.push("/char/cape: primvars:wet is animated; its first value is used in all frames".to_owned());
        if to.ends_with("cape.abc") {
            let missing = ["doubleSided", "material:binding"];
            let no_place = |what: &str| format!("/char/cape: {what} is left out: the format cannot store it");
            expected.extend(missing.map(no_place));
        }
        assert_eq!(messages, expected);
        let data = CacheFrames::open(&to).unwrap().attributes(0).unwrap();
        let param = |name: &str| data.params.iter().find(|param| param.name == name).unwrap();
        let numbers: Vec<f64> = param("frame").values.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        assert_eq!(numbers, (1..=16).map(f64::from).collect::<Vec<_>>(), "{}", to.display());
        assert_eq!(data.double_sided, Some(true).filter(|_| !to.ends_with("cape.abc")));
        let second = data.uvs.iter().map(|uvs| uvs.values.len()).next();
        let texture = data.params.iter().any(|param| param.name == "second" && param.interpretation == "vector");
        assert!(second == Some(3) || texture, "{}: {data:?}", to.display());
    }
}

#[test]
fn materials_are_bound_where_the_mesh_is_and_say_which_they_stand_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut from = written(folder.path(), "char.usda", PURPOSES);
    // What was written is written again: the same places, the same sources.
    for to in ["cape.usd", "again.usdc", "once more.usd"] {
        let object = Some("/char/cape".to_owned());
        let to = folder.path().join(to);
        convert(&Conversion { from, to: to.clone(), object, ..Conversion::default() }, &mut |_| {}).unwrap();
        let data = CacheFrames::open(&to).unwrap().attributes(0).unwrap();
        let of_mesh = data.material.unwrap();
        assert_eq!((of_mesh.path.as_str(), of_mesh.source.as_deref()), ("/char/mtl/red", Some("/char/mtl/red")));
        assert!(of_mesh.is_stronger);
        let of_hem = data.face_sets[0].material.clone().unwrap();
        assert_eq!((of_hem.path.as_str(), of_hem.source.as_deref()), ("/char/looks/blue", Some("/looks/blue")));
        assert!(!of_hem.is_stronger);
        from = to;
    }
}

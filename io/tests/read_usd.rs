//! Stages as bodies and garments of scenes: units from the file, winding, instances, variants, value clips, painted maps.
#![cfg(feature = "usd")]

use std::fs;
use std::path::Path;

use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use drapery_io::error::IoErrorKind;
use drapery_io::formats;
use drapery_io::input_motion::{InputMotion, Preroll};
use drapery_io::mesh_data::PodType;
use drapery_io::mesh_source::MeshSource;
use drapery_io::scene_file;
use drapery_io::shot_description::ShotDescription;
use drapery_io::units::Units;

/// A tetrahedron with its faces outwards; `more` goes into its prim.
fn tetrahedron(name: &str, more: &str) -> String {
    format!(
        "def Mesh \"{name}\" {{\n point3f[] points = [(0,0,0), (100,0,0), (0,100,0), (0,0,100)]\n int[] faceVertexCounts = \
         [3,3,3,3]\n int[] faceVertexIndices = [0,2,1, 0,1,3, 0,3,2, 1,2,3]\n uniform token subdivisionScheme = \"none\"\n {more}\n}}\n"
    )
}

const CENTIMETRES: &str = "metersPerUnit = 0.01\n upAxis = \"Z\"";

fn stage(folder: &Path, name: &str, metadata: &str, body: &str) -> std::path::PathBuf {
    let path = folder.join(name);
    fs::write(&path, format!("#usda 1.0\n(\n {metadata}\n)\n{body}")).unwrap();
    path
}

fn volume(source: &MeshSource) -> f64 {
    let mesh = source.mesh_at(0.0).unwrap().mesh;
    let at = |i: u32| mesh.points[i as usize];
    mesh.triangulate().0.iter().map(|&[a, b, c]| at(a).dot(&at(b).cross(&at(c))) / 6.0).sum()
}

fn scene(folder: &Path, units: &str, body: &str, garment: &str) -> Result<ShotDescription, String> {
    let text = format!(
        "drapery = 1\n[shot]\nframes = \"1-2\"\n{units}\n[gravity]\n[[body]]\nname = \"b\"\nfile = \"body.usda\"\n{body}\n\
         [[garment]]\nname = \"g\"\ntotal_mass = 1.0\nrest = \"body.usda\"\n{garment}\n[garment.stretch]\nstiffness = 10\n"
    );
    let scene = scene_file::parse(&text, "scene.toml", folder, &[]).map_err(|error| error.to_string())?;
    scene.resolve().map_err(|errors| errors[0].to_string())
}

#[test]
fn a_giant_by_the_unit_that_its_file_states_is_read_in_the_unit_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    // What Blender writes of a scene in centimetres: metres, whatever the unit scale. Points are 100 units high.
    let head = "metersPerUnit = 1\n upAxis = \"Z\"";
    stage(folder.path(), "body.usda", head, &tetrahedron("t", ""));
    let tops = |shot: &ShotDescription| {
        let body = shot.bodies[0].as_ref().unwrap().source.mesh_at(0.0).unwrap().mesh.points[3];
        [body, shot.garments[0].positions().unwrap()[3]]
    };
    let shot = scene(folder.path(), "[units]\nlength = \"cm\"", "", "").unwrap();
    assert_eq!(tops(&shot), [Vec3::y(); 2]);
    let said = shot.warnings.join("\n");
    assert!(
        said.contains(
            "the file states metres, which makes it 100.000 m high; it is read in centimetres, the unit of [units]"
        ),
        "{said}"
    );
    assert!(
        said.contains("it is read in centimetres, because the file of a body states the same unit wrongly"),
        "{said}"
    );
    assert!(!said.contains("which overrides [units]"), "{said}");
    // What is said of the file itself goes over its size, and so does what fits the file.
    let own = "units = { length = \"m\", up = \"Z\" }";
    let shot = scene(folder.path(), "[units]\nlength = \"cm\"", own, own).unwrap();
    assert_eq!(tops(&shot), [Vec3::y() * 100.0; 2]);
    stage(folder.path(), "body.usda", "metersPerUnit = 0.01\n upAxis = \"Z\"", &tetrahedron("t", ""));
    let shot = scene(folder.path(), "[units]\nlength = \"mm\"", "", "").unwrap();
    assert_eq!(tops(&shot), [Vec3::y(); 2]);
}

#[test]
fn units_and_axis_come_from_the_file_and_the_scene_may_leave_them_out() {
    let folder = tempfile::tempdir().unwrap();
    stage(folder.path(), "body.usda", CENTIMETRES, &tetrahedron("t", ""));
    // The point (0, 0, 100) in centimetres with Z up.
    let top = |shot: &ShotDescription| shot.bodies[0].as_ref().unwrap().source.mesh_at(0.0).unwrap().mesh.points[3];
    let shot = scene(folder.path(), "", "", "").unwrap();
    assert_eq!((top(&shot), shot.warnings.as_slice()), (Vec3::y(), [].as_slice()));
    assert_eq!(shot.garments[0].positions().unwrap()[3], Vec3::y());
    let shot = scene(folder.path(), "[units]\nlength = \"m\"\nup = \"Y\"", "", "").unwrap();
    assert_eq!(top(&shot), Vec3::y());
    assert!(
        shot.warnings[0].contains("the file states centimetres, Z up, which overrides [units]"),
        "{:?}",
        shot.warnings
    );
    let shot = scene(folder.path(), "", "units = { length = \"mm\", up = \"Y\" }", "").unwrap();
    assert!((top(&shot) - Vec3::z() * 0.1).norm() < 1e-15);
    assert!(
        shot.warnings[0].contains("read in millimetres, Y up, which its `units` in the scene set"),
        "{:?}",
        shot.warnings
    );
    // What is not said is centimetres with Y up, in USD.
    stage(folder.path(), "body.usda", "doc = \"no units\"", &tetrahedron("t", ""));
    let shot = scene(folder.path(), "", "", "").unwrap();
    assert_eq!(top(&shot), Vec3::z());
    assert!(shot.warnings[0].contains("neither its unit of length nor its up axis"), "{:?}", shot.warnings);
    stage(folder.path(), "body.usda", "upAxis = \"X\"", &tetrahedron("t", ""));
    let error = scene(folder.path(), "", "", "").unwrap_err();
    assert!(error.contains("upAxis is \"X\""), "{error}");
}

#[test]
fn faces_come_out_counter_clockwise_however_they_are_stored() {
    let folder = tempfile::tempdir().unwrap();
    let mirror = "float3 xformOp:scale = (-1, 2, 1)\n uniform token[] xformOpOrder = [\"xformOp:scale\"]";
    let left = "uniform token orientation = \"leftHanded\"";
    let reversed = |text: String| text.replace("[0,2,1, 0,1,3, 0,3,2, 1,2,3]", "[1,2,0, 3,1,0, 2,3,0, 3,2,1]");
    for (number, (body, size)) in [
        (tetrahedron("t", ""), 1.0),
        (tetrahedron("t", mirror), 2.0),
        (reversed(tetrahedron("t", left)), 1.0),
        (reversed(tetrahedron("t", &format!("{left}\n{mirror}"))), 2.0),
    ]
    .into_iter()
    .enumerate()
    {
        let path = stage(folder.path(), &format!("{number}.usda"), "metersPerUnit = 0.01", &body);
        let source = MeshSource::open(&path, None, Units::SI).unwrap();
        assert!((volume(&source) / 1e6 - size / 6.0).abs() < 1e-9, "{body}");
    }
}

#[test]
fn corners_of_primvars_follow_the_faces_that_are_turned() {
    let folder = tempfile::tempdir().unwrap();
    let more = "texCoord2f[] primvars:st = [(0,0), (1,0), (0,1)] (\n interpolation = \"vertex\"\n )\n \
                float[] primvars:corner = [0,1,2, 3,4,5, 6,7,8, 9,10,11] (\n interpolation = \"faceVarying\"\n )\n \
                token[] primvars:part = [\"a\", \"b\", \"\", \"d\"] (\n interpolation = \"uniform\"\n )\n \
                float[] primvars:paint = [1, 2, 3, 4] (\n interpolation = \"vertex\"\n )\n string primvars:who = \"me\"\n \
                def GeomSubset \"back\" {\n int[] indices = [3, 1]\n rel material:binding = </wool>\n }";
    let more = more.replace("(0,1)]", "(0,1), (1,1)]");
    let plain = stage(folder.path(), "a.usda", CENTIMETRES, &tetrahedron("t", &more));
    let left = format!("{more}\n uniform token orientation = \"leftHanded\"");
    let left = stage(folder.path(), "b.usda", CENTIMETRES, &tetrahedron("t", &left));
    let [plain, left] =
        [plain, left].map(|path| MeshSource::open(&path, None, Units::SI).unwrap().mesh_at(0.0).unwrap());
    for data in [&plain, &left] {
        let uvs = data.uvs.as_ref().unwrap();
        // UVs of points: each corner has that of its point.
        assert_eq!((uvs.name.as_str(), &uvs.indices), ("st", &data.mesh.face_indices));
        assert_eq!(data.face_sets[0].faces, [1, 3]);
        assert_eq!(data.face_sets[0].material.as_ref().map(|material| material.path.as_str()), Some("/wool"));
        assert_eq!(data.subdivision.as_deref(), Some("none"));
        let names: Vec<&str> = data.params.iter().map(|param| param.name.as_str()).collect();
        assert_eq!(names, ["corner", "part", "paint", "who"]);
        let text = |name: &str| data.params.iter().find(|param| param.name == name).unwrap();
        assert_eq!((text("who").values.as_slice(), text("who").interpretation.as_str()), (b"me\0".as_slice(), ""));
        assert_eq!(text("part").values, b"a\0b\0\0d\0");
        assert_eq!((text("part").data_type.pod, text("part").interpretation.as_str()), (PodType::String, "token"));
    }
    assert_eq!(left.mesh.face_indices[..3], [1, 2, 0]);
    let corners = |data: &drapery_io::mesh_data::MeshData| -> Vec<f32> {
        data.params[0].values.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    };
    // Clockwise, as Alembic counts: reversed where the faces are as they were stored, as stored where they were turned.
    assert_eq!((corners(&plain)[..3].to_vec(), corners(&left)[..3].to_vec()), (vec![2., 1., 0.], vec![0., 1., 2.]));
}

#[test]
fn references_variants_instances_and_clips_are_composed_and_time_codes_are_seconds() {
    let folder = tempfile::tempdir().unwrap();
    let moving = |from: f64, to: f64| {
        let points = |x: f64| format!("[({x},0,0), (1,0,0), (0,1,0), (0,0,1)]");
        format!("point3f[] points.timeSamples = {{ {from}: {}, {to}: {} }}", points(from), points(to))
    };
    let head = "metersPerUnit = 1\n upAxis = \"Y\"\n timeCodesPerSecond = 48\n defaultPrim = \"body\"";
    let faces = "int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0,1,2]";
    for (name, from, to) in [("clip.1.usda", 10.0, 12.0), ("clip.2.usda", 12.0, 20.0)] {
        stage(folder.path(), name, head, &format!("over \"body\" {{\n {}\n }}", moving(from, to)));
    }
    stage(folder.path(), "manifest.usda", head, "over \"body\" {\n point3f[] points\n }");
    stage(folder.path(), "topology.usda", head, &format!("def Mesh \"body\" {{\n point3f[] points\n {faces}\n }}"));
    let clips = "clips = {\n dictionary default = {\n asset[] assetPaths = [@./clip.1.usda@, @./clip.2.usda@]\n asset manifestAssetPath = \
                 @./manifest.usda@\n string primPath = \"/body\"\n double2[] active = [(10, 0), (12, 1)]\n double2[] times = [(10, 10), \
                 (12, 12), (20, 20)]\n }\n }";
    let shot = format!(
        "def \"clipped\" (\n references = @./topology.usda@\n {clips}\n ) {{}}\n\
         def \"choice\" (\n variants = {{\n string size = \"large\"\n }}\n prepend variantSets = \"size\"\n ) {{\n variantSet \"size\" = {{\n \
         \"small\" {{ {} }}\n \"large\" {{ {} }}\n }}\n }}\n\
         def \"twin\" (\n instanceable = true\n references = @./pair.usda@\n ) {{\n double3 xformOp:translate = (5, 0, 0)\n uniform token[] \
         xformOpOrder = [\"xformOp:translate\"]\n }}\n",
        tetrahedron("a", ""),
        tetrahedron("b", ""),
    );
    stage(
        folder.path(),
        "pair.usda",
        head.replace("body", "pair").as_str(),
        &format!("def Xform \"pair\" {{ {} }}", tetrahedron("half", "")),
    );
    let path = stage(folder.path(), "shot.usda", head, &shot);
    let source =
        |pattern: &str| MeshSource::open(&path, Some(pattern), Units::SI).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(source("*").objects(), ["/choice/b", "/clipped", "/twin/half"]);
    assert_eq!(source("/twin/*").mesh_at(0.0).unwrap().mesh.points[1], Vec3::new(105.0, 0.0, 0.0));
    let clipped = source("/clipped");
    assert_eq!(clipped.sample_times(), [10.0 / 48.0, 12.0 / 48.0, 20.0 / 48.0]);
    let x = |code: f64| clipped.mesh_at(code / 48.0).unwrap().mesh.points[0].x;
    assert_eq!([0.0, 10.0, 12.0, 20.0, 99.0].map(x), [10.0, 10.0, 12.0, 20.0, 20.0]);
    assert!((x(11.0) - 11.0).abs() < 1e-6 && (x(16.0) - 16.0).abs() < 1e-6);
    let motion =
        InputMotion { label: "body".into(), source: clipped, rest: None, rows: None, own_units: false, is_made: false };
    // At 24 frames a second, frame 6 is code 12, and frame 7 code 14: in between there is no sample.
    let timeline = Timeline { origin: 5, start: 5, ..Timeline::default() };
    let samples = motion.samples(timeline, Preroll::default(), 6).unwrap();
    assert_eq!(samples.iter().map(|sample| sample.positions[0].x).collect::<Vec<_>>(), [12.0]);
    let files = motion.source.other_files();
    assert!(files.iter().any(|file| file.ends_with("clip.2.usda")) && files.len() >= 4, "{files:?}");
}

#[test]
fn clips_are_found_where_no_layer_declares_what_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let head = "metersPerUnit = 1\n upAxis = \"Y\"\n defaultPrim = \"body\"";
    let faces = "int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0,1,2]";
    let held = |frame: i64| {
        format!(
            "over \"body\" {{\n double3 xformOp:translate.timeSamples = {{ {frame}: (0, {frame}, 0) }}\n over \"m\" {{\n point3f[] \
             points.timeSamples = {{ {frame}: [({frame},0,0), (1,0,0), (0,1,0)] }}\n }}\n }}"
        )
    };
    for frame in [1, 2] {
        stage(folder.path(), &format!("{frame}.usda"), head, &held(frame));
    }
    let declared = "over \"body\" {\n double3 xformOp:translate\n over \"m\" {\n point3f[] points\n }\n }";
    stage(folder.path(), "manifest.usda", head, declared);
    let clips = "clips = {\n dictionary default = {\n asset[] assetPaths = [@./1.usda@, @./2.usda@]\n asset manifestAssetPath = \
                 @./manifest.usda@\n string primPath = \"/body\"\n double2[] active = [(1, 0), (2, 1)]\n double2[] times = [(1, 1), \
                 (2, 2)]\n }\n }";
    let body = format!(
        "def Xform \"body\" (\n {clips}\n ) {{\n uniform token[] xformOpOrder = [\"xformOp:translate\"]\n def Mesh \"m\" {{\n \
         {faces}\n }}\n }}"
    );
    let path = stage(folder.path(), "body.usda", head, &body);
    let source = MeshSource::open(&path, None, Units::SI).unwrap();
    assert_eq!(source.sample_times(), [1.0 / 24.0, 2.0 / 24.0]);
    for frame in [1.0, 2.0] {
        assert_eq!(source.mesh_at(frame / 24.0).unwrap().mesh.points[0], Vec3::new(frame, frame, 0.0));
    }
    assert!(!fs::read_to_string(&path).unwrap().contains("points"), "what is declared stays in memory");
}

#[test]
fn painted_maps_are_found_among_the_primvars() {
    let folder = tempfile::tempdir().unwrap();
    let paint = "float[] primvars:stiff = [1, 2, 3, 4] (\n interpolation = \"vertex\"\n )";
    stage(folder.path(), "body.usda", CENTIMETRES, &tetrahedron("t", paint));
    let shot = scene(folder.path(), "", "", "maps = { stretch = \"stiff\" }").unwrap();
    let map = shot.scene.garments[0].maps.values().next().unwrap();
    assert_eq!(map.values, [1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn a_mesh_that_cannot_be_chosen_says_why_and_which_can() {
    let folder = tempfile::tempdir().unwrap();
    let body = tetrahedron("a", "") + &tetrahedron("guide", "uniform token purpose = \"guide\"");
    let path =
        stage(folder.path(), "body.usda", CENTIMETRES, &(body + "def \"lost\" ( references = @./no.usda@ ) {}\n"));
    let error = |pattern| MeshSource::open(&path, pattern, Units::SI).unwrap_err();
    // All that is rendered is asked for, and nobody knows what is missing.
    assert_eq!(error(None).kind(), IoErrorKind::MissingInput);
    let source = MeshSource::open(&path, Some("/a"), Units::SI).unwrap();
    assert!(source.notes()[0].contains("no.usda"), "{:?}", source.notes());
    fs::write(folder.path().join("no.usda"), "#usda 1.0\n(\n defaultPrim = \"x\"\n)\ndef \"x\" {}").unwrap();
    for (pattern, message) in
        [("/guide", "the mesh /guide is not rendered: its purpose is guide"), ("/b*", "no mesh path matches /b*")]
    {
        let text = error(Some(pattern)).to_string();
        assert!(text.contains(message) && text.contains("its meshes are /a"), "{text}");
    }
}

#[test]
fn a_stage_is_summed_up_mesh_by_mesh_also_those_that_are_broken() {
    let folder = tempfile::tempdir().unwrap();
    let body = tetrahedron("a", "") + "def Mesh \"broken\" {\n int[] faceVertexCounts = [3]\n}\ndef Camera \"c\" {}\n";
    let path = stage(folder.path(), "body.usda", CENTIMETRES, &body);
    let summary = formats::inspect(&path).unwrap();
    assert!(summary.properties.contains(&("metersPerUnit".into(), "0.01".into())), "{:?}", summary.properties);
    assert_eq!((summary.meshes[0].points, summary.meshes[0].faces), (4, [4, 0, 0]));
    assert!(summary.meshes[1].problem.as_ref().unwrap().contains("no points"), "{:?}", summary.meshes[1]);
    assert_eq!(summary.others, [("/c".to_owned(), "Camera".to_owned())]);
}

#[test]
fn prims_that_inherit_from_each_other_in_a_circle_are_refused_with_the_circle() {
    let folder = tempfile::tempdir().unwrap();
    let body = tetrahedron("m", "") + "class \"c\" (inherits = </d>) {}\nclass \"d\" (inherits = </c>) {}\n";
    let inherits = body.replacen("def Mesh \"m\"", "def Mesh \"m\" (inherits = </c>)", 1);
    assert_ne!(inherits, body);
    let path = stage(folder.path(), "circle.usda", "", &inherits);
    let said = formats::inspect(&path).unwrap_err().to_string();
    assert!(said.contains("circle.usda") && said.contains("/c → /d → /c") && said.contains("help:"), "{said}");
}

//! Checkpoints: the seal, files of any layout under a good seal, and states of any content given to a small simulation.
//! The first byte says which; the rest is the file, or edits of a good one.

use std::sync::OnceLock;

use crate::edits::Bytes;
use crate::layout::{Kind, Layout, Value};
use crate::{memory, scratch};
use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, Scene, SceneDescription,
};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_core::snapshot::{Snapshot, SnapshotSource, Values};
use drapery_io::checkpoint::{Checkpoint, CheckpointReader, FORMAT_VERSION, Head};
use sha2::{Digest, Sha256};

/// Length of the seal.
const SEAL: usize = 512;

/// Reads one input.
pub fn run(data: &[u8]) {
    let Some((kind, data)) = data.split_first() else { return };
    match kind % 3 {
        0 => unsealed(data),
        1 => sealed(data),
        _ => state(data),
    }
}

/// A file that nobody sealed never gets as far as the library.
fn unsealed(data: &[u8]) {
    let path = scratch::file("unsealed.h5", data);
    memory::bounded(|| assert!(CheckpointReader::open(&path).is_err(), "a file without a seal was accepted"));
}

fn head() -> Head {
    Head {
        format_version: FORMAT_VERSION,
        application: "Drapery 0.1.0".to_owned(),
        shot: "shot".to_owned(),
        frame: 1,
        sub_step: 0,
        time: 1.0 / 24.0,
        delivered: Some(1),
        fps: [24, 1],
        digests: [("scene".to_owned(), "ab".to_owned())].into(),
        caches: Vec::new(),
    }
}

/// A file of any layout under a good seal.
fn sealed(data: &[u8]) {
    let path = scratch::folder().join("sealed.h5");
    let mut layout = Layout { user_block: SEAL as u64, ..Layout::default() };
    layout.groups.push("state".to_owned());
    let text = "{\"format_version\":1,\"application\":\"Drapery 0.1.0\",\"shot\":\"shot\",\"frame\":1,\"sub_step\":0,\
                \"time\":0.5,\"delivered\":null,\"fps\":[24,1],\"digests\":{},\"caches\":[]}";
    layout.attribute("", "head", Value::Text(text.to_owned()));
    layout.attribute("", "time", Value::Real(0.5));
    layout.attribute("", "content_hash", Value::Text("0".repeat(64)));
    layout.attribute("state", "order", Value::Count(0));
    layout.attribute("state", "version", Value::Count(1));
    for (number, (name, kind, shape)) in [
        ("time", Kind::F64, &[1][..]),
        ("positions", Kind::F64, &[4, 3]),
        ("pairs", Kind::U32, &[2, 4]),
        ("marks", Kind::U8, &[4]),
    ]
    .into_iter()
    .enumerate()
    {
        layout.array("state", name, kind, shape, &[number as u8; 8]);
        layout.attribute(&format!("state/{name}"), "order", Value::Count(number as u64));
    }
    layout.edit(&mut Bytes(data));
    let _ = std::fs::remove_file(&path);
    if layout.write(&path).is_err() {
        return;
    }
    let mut bytes = std::fs::read(&path).unwrap_or_default();
    if bytes.len() < SEAL {
        return;
    }
    let hash: String = Sha256::digest(&bytes[SEAL..]).iter().map(|byte| format!("{byte:02x}")).collect();
    let seal = format!("Drapery checkpoint {FORMAT_VERSION}\nbytes {}\nsha256 {hash}\n", bytes.len());
    bytes[..seal.len()].copy_from_slice(seal.as_bytes());
    scratch::file("sealed.h5", &bytes);
    memory::bounded(|| {
        let _ = CheckpointReader::open(&path).map_err(|error| error.to_string()).map(read_all);
    });
}

/// Reads every array, and rows that are not there.
fn read_all(mut reader: CheckpointReader) {
    for section in reader.outline() {
        for dataset in &section.datasets {
            let _ = reader.values(&section.name, &dataset.name, 0..dataset.rows());
            let _ = reader.values(&section.name, &dataset.name, dataset.rows()..dataset.rows() + 1);
        }
    }
    let _ = reader.whole();
}

/// Two sheets that lie on each other over a ball, one of them pinned.
fn scene() -> Scene {
    let mut scene = SceneDescription::new("shot");
    for (number, height) in [0.251, 0.256].into_iter().enumerate() {
        let point = |k: u32| Vec3::new(0.05 * f64::from(k % 4) - 0.075, height, 0.05 * f64::from(k / 4) - 0.075);
        let square = |k: u32| {
            let a = k % 3 + 4 * (k / 3);
            [[a, a + 4, a + 1], [a + 1, a + 4, a + 5]]
        };
        let triangles: Vec<[u32; 3]> = (0..9).flat_map(square).collect();
        let mesh = PolygonMesh::from_triangles((0..16).map(point).collect(), &triangles);
        scene.garments.push(GarmentDescription::new(&format!("sheet{number}"), mesh, 0.2));
        scene.effects.push(EffectRequest::of_garment("stretch", number).with("stiffness", 50.0));
        scene.effects.push(EffectRequest::of_garment("bending", number).with("stiffness", 1.0));
    }
    scene.effects.push(EffectRequest::of_scene("gravity").with_vector("acceleration", [0.0, -9.81, 0.0]));
    for effect in ["pins", "body_collision", "self_repulsion", "self_collision"] {
        scene.effects.push(EffectRequest::of_scene(effect));
    }
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.25 });
    scene.bodies.push(BodyDescription::new("ball", ball, RigidMotion::at(Vec3::zeros())));
    scene.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::WhenHeld, vertices: vec![0, 3], offsets: Vec::new() },
        axes: [true; 3],
        from: 0.01,
        until: 9.0,
        hold: PinHold::Hard,
    });
    scene.solver.max_dt = Some(1e-3);
    Scene::validate(scene).unwrap_or_else(|problems| panic!("the scene of the target is wrong: {problems}"))
}

/// The scene, and its state after one frame.
fn begun() -> &'static Snapshot {
    static BEGUN: OnceLock<Snapshot> = OnceLock::new();
    BEGUN.get_or_init(|| {
        let start = Simulation::new(scene(), &FrameInput::to_frame(0));
        let mut simulation = start.unwrap_or_else(|problems| panic!("the target's scene cannot start: {problems}"));
        simulation.advance(&FrameInput::to_frame(1)).unwrap_or_else(|error| panic!("it cannot go on: {error}"));
        simulation.snapshot()
    })
}

/// A state of any content: read back from a file, then simulated for a frame.
fn state(data: &[u8]) {
    let mut snapshot = begun().clone();
    edit(&mut snapshot, &mut Bytes(data));
    memory::bounded(|| {
        let path = scratch::folder().join("state.h5");
        let written = Checkpoint { head: head(), snapshot: snapshot.clone() };
        if fits(&snapshot) && written.write(&path).is_ok() {
            let read = Checkpoint::read(&path).unwrap_or_else(|error| panic!("what was written is read: {error}"));
            assert_eq!(read.content_hash(), written.content_hash());
        }
        if let Ok(mut simulation) = Simulation::restore(scene(), &FrameInput::to_frame(1), &snapshot) {
            let _ = simulation.advance(&FrameInput::to_frame(2)).map_err(|error| error.to_string());
        }
    });
}

/// Whether the writer takes it: names that can be told apart.
fn fits(snapshot: &Snapshot) -> bool {
    let good = |name: &str| !name.is_empty() && !name.contains(['/', '.']) && !name.chars().any(char::is_control);
    let mut names = Vec::new();
    for section in &snapshot.sections {
        names.push((section.name.clone(), String::new()));
        names.extend(section.datasets.iter().map(|dataset| (section.name.clone(), dataset.name.clone())));
        if !good(&section.name) || section.datasets.iter().any(|dataset| !good(&dataset.name)) {
            return false;
        }
    }
    let count = names.len();
    names.sort();
    names.dedup();
    names.len() == count
}

/// Changes values, shapes, names and versions; the number of values still fits the shape.
fn edit(snapshot: &mut Snapshot, bytes: &mut Bytes<'_>) {
    while !bytes.is_empty() {
        let what = bytes.byte() % 8;
        let (at, of) = (bytes.below(snapshot.sections.len()), bytes.byte());
        let Some(section) = snapshot.sections.get_mut(at) else { return };
        let place = usize::from(of) % section.datasets.len().max(1);
        match (what, section.datasets.get_mut(place)) {
            (0, _) => section.version = bytes.byte().into(),
            (1, Some(_)) => drop(section.datasets.remove(place)),
            (2, Some(dataset)) => dataset.name = bytes.text(),
            (3, Some(dataset)) => {
                let rows = usize::from(bytes.byte());
                let width: usize = dataset.shape.iter().skip(1).product();
                if let Some(first) = dataset.shape.first_mut() {
                    *first = rows;
                    resize(&mut dataset.values, rows * width);
                }
            }
            (4, _) => section.name = bytes.text(),
            (_, Some(dataset)) => change_value(&mut dataset.values, bytes),
            (_, None) => {}
        }
    }
}

fn resize(values: &mut Values, count: usize) {
    match values {
        Values::F64(values) => values.resize(count, 0.25),
        Values::U64(values) => values.resize(count, 1),
        Values::I64(values) => values.resize(count, 1),
        Values::U32(values) => values.resize(count, 1),
        Values::U8(values) => values.resize(count, 1),
    }
}

fn change_value(values: &mut Values, bytes: &mut Bytes<'_>) {
    if values.is_empty() {
        return;
    }
    let (at, word) = ((bytes.byte() as usize | (bytes.byte() as usize) << 8) % values.len(), bytes.word());
    match values {
        // Half of the numbers are near the one that was there.
        Values::F64(values) if word & 1 == 0 => values[at] += (word as i64 as f64) * 2f64.powi(-66),
        Values::F64(values) => values[at] = f64::from_bits(word),
        Values::U64(values) => values[at] = word,
        Values::I64(values) => values[at] = word as i64,
        Values::U32(values) => values[at] = word as u32,
        Values::U8(values) => values[at] = word as u8,
    }
}

//! `drapery plan`: what will run and why.

use drapery_core::Vec3;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::number_curves::NumberCurve;
use drapery_core::scene::vertex_maps::MapCurve;
use drapery_core::scene::{BodyDescription, GarmentDescription, SceneDescription};
use drapery_core::settings::SettingValue;
use drapery_io::error::IoError;
use drapery_io::formats;
use drapery_io::shot_description::BodyThickness;
use drapery_shot::{RenderMeshSize, Shot};
use serde_json::{Value, json};

use crate::args::PlanArgs;
use crate::config::{Environment, Resolved, RunSettings};
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::{plan, say};

use effects::Costs;
use sources::Provenance;

mod contacts;
mod effects;
mod sources;

/// Prints the plan.
pub(crate) fn plan(args: &PlanArgs, around: &Environment) -> Result<ExitCode, Failure> {
    let settings = RunSettings::choose(&args.settings, around)?;
    let (shot, (threads, _)) = plan::prepare(&args.scene, around, &Ranks::default())?;
    if let Some(out) = args.settings.out.as_ref().filter(|out| out.to_str().is_none()) {
        tracing::warn!("a run would be refused: {}", IoError::OutputNotUtf8 { path: out.clone() });
    }
    let said = sources::all(args, around, &settings, (&shot, &threads));
    let costs = costs(args, around, &shot)?;
    if args.json {
        say::line(format_args!("{:#}", as_json(&shot, &threads, &said, costs.as_ref())));
    } else {
        say::line(as_text(&shot, &threads, &said, costs.as_ref()));
    }
    Ok(ExitCode::Done)
}

/// Measures the cost of a frame in a copy of the shot; `None` without `--measure`.
fn costs(args: &PlanArgs, around: &Environment, shot: &Shot) -> Result<Option<Costs>, Failure> {
    let Some(frames) = args.measure else { return Ok(None) };
    let trial = plan::shot(&args.scene, around, &Ranks::default())?;
    let most = u32::try_from(shot.frame_count().saturating_sub(1)).unwrap_or(u32::MAX);
    if frames > most {
        let text = format!("--measure {frames}: the shot has only {most} frames after its start");
        return Err(Failure::new(ExitCode::Usage, text));
    }
    Ok(Some(Costs { frame: trial.trial(frames)?, frames }))
}

fn as_text(shot: &Shot, threads: &Resolved<usize>, said: &[Provenance], costs: Option<&Costs>) -> String {
    let timeline = shot.timeline();
    let [first, last] = shot.frames();
    let (numerator, denominator) = (timeline.fps_numerator, timeline.fps_denominator);
    let rate = if denominator == 1 { numerator.to_string() } else { format!("{numerator}/{denominator}") };
    let mut text = format!("shot {}: frames {first}-{last} at {rate} fps\n", shot.name());
    if timeline.start < first {
        text += &format!("pre-roll: {} frames from frame {}\n", first - timeline.start, timeline.start);
    }
    text += &format!("threads: {} ({})\n", threads.value, threads.source);
    text += &scene_text(shot);
    text += &effects::text(shot.simulation(), costs);
    text += &contacts::text(shot.simulation().scene().description());
    text += &curves_text(shot.simulation().scene().description());
    text += &memory_text(shot);
    text += &format!("longest time step: {:.3e} s\n", shot.simulation().elastic_step());
    text += &output_text(shot);
    for file in shot.referred_files() {
        text += &format!("reads {}, referenced by a file of the scene\n", file.display());
    }
    text += "\nsource of each value\n";
    for Provenance { what, text: value, source, .. } in said {
        text += &format!("  {what:<20} {value:<24} {source}\n");
    }
    text + "\nsettings, with all defaults\n" + shot.resolved().trim_end()
}

fn scene_text(shot: &Shot) -> String {
    let scene = shot.simulation().scene();
    let mut text = String::new();
    for (garment, mesh) in scene.description().garments.iter().zip(scene.meshes()) {
        text += &format!(
            "garment {}: {} points, {} faces, {} triangles, {} edges\n",
            garment.name,
            mesh.rest_positions().len(),
            mesh.polygons().last().map_or(0, |polygon| polygon + 1),
            mesh.triangles().len(),
            mesh.edges().len()
        );
    }
    for RenderMeshSize { name, garment, points, triangles, bytes_per_sample } in shot.render_meshes() {
        text += &format!(
            "render mesh {name} of {garment}: {points} points, {triangles} triangles, {:.1} kB per frame in each format\n",
            bytes_per_sample as f64 / 1e3
        );
    }
    if !shot.output().attributes.is_empty() {
        let [moving, still] = shot.attribute_bytes().map(|bytes| bytes as f64 / 1e3);
        let words: Vec<&str> = shot.output().attributes.iter().map(|attribute| attribute.word()).collect();
        text += &format!(
            "attributes {}: {moving:.1} kB per frame and {still:.1} kB once, in each format\n",
            words.join(", ")
        );
    }
    let found = shot.body_thickness().iter().copied().chain(std::iter::repeat(None));
    for (body, found) in scene.description().bodies.iter().zip(found) {
        text += &format!("body {}: friction {}, thickness {} m", body.name, body.friction, body.thickness);
        text += &match found {
            Some(BodyThickness { needed, is_written: false }) if needed == body.thickness => {
                ", required by the size of the faces of body and garments at its curvature\n".to_owned()
            }
            Some(BodyThickness { needed, .. }) => {
                format!("; with these faces of body and garments its curvature requires {needed} m\n")
            }
            None => "\n".to_owned(),
        };
    }
    text
}

/// Memory of the simulation [bytes].
struct Bytes {
    /// State and arrays of a step.
    state: usize,
    effects: usize,
    /// The whole process, which has everything that a step begins with, where the system tells.
    resident: Option<u64>,
    /// List of close pairs where layers lie on each other, which the first step finds.
    pairs: usize,
}

impl Bytes {
    fn of(shot: &Shot) -> Self {
        let simulation = shot.simulation();
        let effects = simulation.plan().iter().map(|effect| effect.bytes).sum();
        let (state, pairs) = (simulation.bytes(), simulation.pair_list_bytes());
        Self { state, effects, resident: drapery_io::memory::resident_bytes(), pairs }
    }
}

fn memory_text(shot: &Shot) -> String {
    let Bytes { state, effects, resident, pairs } = Bytes::of(shot);
    let resident = resident.map(|bytes| format!("; {} resident", mebibytes(bytes as usize))).unwrap_or_default();
    let pairs =
        if pairs > 0 { format!("; {} more where layers lie on each other", mebibytes(pairs)) } else { String::new() };
    format!("memory: {} state and scratch, {} effects{resident}{pairs}\n", mebibytes(state), mebibytes(effects))
}

fn mebibytes(bytes: usize) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

fn output_text(shot: &Shot) -> String {
    let output = shot.output();
    let velocities = if output.velocities { "with velocities" } else { "without velocities" };
    let faces = match output.triangles {
        true => "garments as simulated triangles",
        false => "garments with the faces of their files; renderers may split quads along either diagonal",
    };
    let mut text = format!("output: {}, {velocities}; {faces}\n", output.units);
    for format in output.formats.iter().filter_map(|word| formats::by_extension(word)) {
        text += &format!("  .{}: {}\n", format.extension, format.summary);
    }
    if shot.origin() != Vec3::zeros() {
        let [x, y, z] = <[f64; 3]>::from(shot.origin());
        text += &format!("  positions relative to [{x}, {y}, {z}] m\n");
    }
    text
}

fn as_json(shot: &Shot, threads: &Resolved<usize>, said: &[Provenance], costs: Option<&Costs>) -> Value {
    let said: serde_json::Map<String, Value> =
        said.iter().map(|s| (s.what.to_owned(), json!({"value": s.value, "from": s.source}))).collect();
    let threads = json!({"value": threads.value, "from": threads.source});
    with(of_shot(shot, costs), json!({"threads": threads, "run": said}))
}

/// Both together.
fn with(mut object: Value, rest: Value) -> Value {
    if let (Value::Object(object), Value::Object(rest)) = (&mut object, rest) {
        object.extend(rest);
    }
    object
}

/// The thickness of curved bodies, and what their faces and those of the garments need.
fn bodies_json(shot: &Shot) -> Value {
    let bodies = shot.simulation().scene().description().bodies.iter().zip(shot.body_thickness());
    let of = |(body, found): (&BodyDescription, &Option<BodyThickness>)| {
        let BodyThickness { needed, is_written } = (*found)?;
        Some(json!({"body": body.name, "thickness": body.thickness, "needed": needed, "is_written": is_written}))
    };
    bodies.filter_map(of).collect()
}

/// Returns the JSON of a plan, without threads and settings of the run, which depend on the caller.
pub(crate) fn of_shot(shot: &Shot, costs: Option<&Costs>) -> Value {
    let timeline = shot.timeline();
    let scene = shot.simulation().scene();
    let garments: Vec<Value> = scene
        .description()
        .garments
        .iter()
        .zip(scene.meshes())
        .map(|(garment, mesh)| {
            json!({
                "name": garment.name,
                "layer": garment.layer,
                "points": mesh.rest_positions().len(),
                "triangles": mesh.triangles().len(),
            })
        })
        .collect();
    let render_meshes = shot.render_meshes().map(|mesh| {
        let RenderMeshSize { name, garment, points, triangles, bytes_per_sample } = mesh;
        let bytes = bytes_per_sample;
        json!({"name": name, "garment": garment, "points": points, "triangles": triangles, "bytes_per_sample": bytes})
    });
    let Bytes { state, effects: of_effects, resident, pairs } = Bytes::of(shot);
    let rest = json!({
        "shot": shot.name(),
        "frames": shot.frames(),
        "start_frame": timeline.start,
        "fps": [timeline.fps_numerator, timeline.fps_denominator],
        "garments": garments,
        "render_meshes": render_meshes.collect::<Vec<_>>(),
        "bodies": scene.description().bodies.iter().map(|body| &body.name).collect::<Vec<_>>(),
        "bytes": {"state": state, "effects": of_effects, "resident": resident, "pairs": pairs},
        "formats": shot.output().formats,
        "attributes": attributes_json(shot),
        "faces": if shot.output().triangles { "triangles" } else { "original" },
        "body_thickness": bodies_json(shot),
        "contacts": contacts::as_json(shot.simulation().scene().description()),
        "curves": curves_json(shot.simulation().scene().description()),
        "origin": <[f64; 3]>::from(shot.origin()),
        "referred_files": shot.referred_files().iter().map(|file| file.display().to_string()).collect::<Vec<_>>(),
        "warnings": crate::plan::warnings_json(shot),
        "resolved": shot.resolved(),
    });
    with(effects::as_json(shot.simulation(), costs), rest)
}

/// Attributes at the points of garments, and their bytes in each format.
fn attributes_json(shot: &Shot) -> Value {
    let [moving, still] = shot.attribute_bytes();
    let words: Vec<&str> = shot.output().attributes.iter().map(|attribute| attribute.word()).collect();
    json!({"names": words, "bytes_per_sample": moving, "bytes_once": still})
}

/// Numbers that change over time; nothing without any.
fn curves_text(scene: &SceneDescription) -> String {
    let maps = map_curves(scene);
    if scene.curves.is_empty() && maps.is_empty() {
        return String::new();
    }
    let mut text = String::from("\nnumbers over time, by frame\n");
    for (path, keys) in &scene.curves {
        text += &format!("  {path}: {}\n", keys_text(keys));
    }
    for (path, frames) in maps {
        let frames: Vec<String> = frames.iter().map(ToString::to_string).collect();
        text += &format!("  {path}: maps at {}\n", frames.join(", "));
    }
    text
}

/// Keys that the text of a plan shows of a curve.
const KEYS_SHOWN: usize = 12;

/// Keys of a curve: equal ones in a row as one, and of many the first and the last.
fn keys_text(keys: &NumberCurve) -> String {
    let runs: Vec<String> = keys
        .chunk_by(|(_, a), (_, b)| a == b)
        .filter_map(|run| {
            let ((first, value), (last, _)) = (run.first()?, run.last()?);
            let until = if first == last { String::new() } else { format!(" to {last}") };
            Some(format!("{} at {first}{until}", effects::value_text(&shortest(value))))
        })
        .collect();
    if runs.len() <= KEYS_SHOWN {
        return runs.join(", ");
    }
    let (first, last) = (&runs[..KEYS_SHOWN - 1], &runs[runs.len() - 1]);
    format!("{}, …, {last} ({} keys; all with --json)", first.join(", "), keys.len())
}

/// The same value with the digits of single precision where it has no more, as in files.
fn shortest(value: &SettingValue) -> SettingValue {
    let short = |number: f64| match (number as f32).to_string().parse() {
        Ok(short) if f64::from(number as f32) == number => short,
        _ => number,
    };
    match value {
        SettingValue::Number(number) => SettingValue::Number(short(*number)),
        SettingValue::Vector(vector) => SettingValue::Vector(vector.map(short)),
        other => other.clone(),
    }
}

/// Paths of the maps that change over time, and their frames.
fn map_curves(scene: &SceneDescription) -> Vec<(String, Vec<f64>)> {
    let of = |garment: &GarmentDescription| {
        let name = garment.name.clone();
        let frames = |keys: &MapCurve| keys.iter().map(|(frame, _)| *frame).collect();
        garment
            .map_curves
            .iter()
            .map(move |(of, keys)| (format!("garment.{name}.maps.{of}"), frames(keys)))
            .collect::<Vec<_>>()
    };
    scene.garments.iter().flat_map(of).collect()
}

/// The same for programs.
fn curves_json(scene: &SceneDescription) -> Value {
    let key = |(frame, value): &(f64, SettingValue)| match value {
        SettingValue::Vector(vector) => json!([frame, vector]),
        SettingValue::Number(number) => json!([frame, number]),
        other => json!([frame, effects::value_text(other)]),
    };
    let curve = |(path, keys): (&String, &NumberCurve)| (path.clone(), keys.iter().map(key).collect());
    let maps = map_curves(scene).into_iter().map(|(path, frames)| (path, json!({ "maps_at": frames })));
    Value::Object(scene.curves.iter().map(curve).chain(maps).collect())
}

//! `drapery plan`: what will run and why.

use drapery_core::effects::{Need, PlannedEffect};
use drapery_core::parallel::ranks::Ranks;
use drapery_core::settings::{Origin, SettingValue};
use drapery_io::formats;
use drapery_io::shot::Shot;
use serde_json::{Value, json};

use crate::args::PlanArgs;
use crate::config::{Chosen, RunSettings, Surroundings};
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::{plan, say};

use sources::Said;

mod sources;

/// Prints the plan.
pub(crate) fn plan(args: &PlanArgs, around: &Surroundings) -> Result<ExitCode, Failure> {
    let settings = RunSettings::choose(&args.settings, around)?;
    let (shot, (threads, _)) = plan::prepare(&args.scene, around, &Ranks::default())?;
    let said = sources::all(args, around, &settings, (&shot, &threads));
    if args.json {
        say::line(format_args!("{:#}", as_json(&shot, &threads, &said)));
    } else {
        say::line(as_text(&shot, &threads, &said));
    }
    Ok(ExitCode::Done)
}

fn as_text(shot: &Shot, threads: &Chosen<usize>, said: &[Said]) -> String {
    let timeline = shot.timeline();
    let [first, last] = shot.frames();
    let (numerator, denominator) = (timeline.fps_numerator, timeline.fps_denominator);
    let mut text = format!("shot {}: frames {first}-{last} at {numerator}/{denominator} fps\n", shot.name());
    if timeline.start < first {
        text += &format!("pre-roll: {} frames from frame {}\n", first - timeline.start, timeline.start);
    }
    text += &format!("threads: {} ({})\n", threads.value, threads.source);
    text += &scene_text(shot);
    text += "\neffects, in the order of execution\n";
    for effect in shot.simulation().plan() {
        text += &effect_text(effect);
    }
    text += "  an effect that is not here allocates nothing and runs nothing\n";
    text += &format!("\nshared structures: {}\n", structures(shot).join(", "));
    let (state, effects) = bytes(shot);
    text += &format!("memory: {} state and scratch, {} effects\n", mebibytes(state), mebibytes(effects));
    text += &format!("longest elastic step: {:.3e} s\n", shot.simulation().elastic_step());
    text += &output_text(shot);
    text += "\nwhere it comes from\n";
    for Said { what, text: value, source, .. } in said {
        text += &format!("  {what:<20} {value:<24} {source}\n");
    }
    text + "\nsettings, defaults written out\n" + shot.resolved().trim_end()
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
    for body in &scene.description().bodies {
        text += &format!("body {}: friction {}, thickness {} m\n", body.name, body.friction, body.thickness);
    }
    text
}

fn effect_text(effect: &PlannedEffect) -> String {
    let on = effect.garment.as_ref().map_or(String::new(), |garment| format!(" of {garment}"));
    let mut text = format!("  {}{on}: {}\n", effect.name, effect.because);
    for (name, value, origin) in effect.settings.iter() {
        text += &format!("    {name} = {} ({})\n", value_text(value), origin_word(origin));
    }
    for note in &effect.notes {
        text += &format!("    note: {note}\n");
    }
    text
}

fn value_text(value: &SettingValue) -> String {
    match value {
        SettingValue::Number(number) => number.to_string(),
        SettingValue::Text(text) => text.clone(),
        SettingValue::Vector(vector) => format!("{vector:?}"),
        SettingValue::Flag(flag) => flag.to_string(),
        SettingValue::Keys(keys) => format!("{keys:?}"),
    }
}

fn origin_word(origin: Origin) -> &'static str {
    match origin {
        Origin::Scene => "scene",
        Origin::Default => "default",
    }
}

/// The structures that some effect needs, each once.
fn structures(shot: &Shot) -> Vec<&'static str> {
    let mut needs: Vec<Need> = shot.simulation().plan().iter().flat_map(|effect| effect.needs).copied().collect();
    needs.sort_unstable();
    needs.dedup();
    let word = |need: &Need| match need {
        Need::State => "masses and parts",
        Need::PinTargets => "pin targets",
        Need::Bodies => "bodies and their trees",
        Need::ClothSurface => "trees over the triangles of cloth",
        Need::PairList => "list of close pairs",
        Need::SecondRing => "a second ring of triangles around parts of other ranks",
    };
    needs.iter().map(word).collect()
}

fn bytes(shot: &Shot) -> (usize, usize) {
    let simulation = shot.simulation();
    (simulation.bytes(), simulation.plan().iter().map(|effect| effect.bytes).sum())
}

fn mebibytes(bytes: usize) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

fn output_text(shot: &Shot) -> String {
    let output = shot.output();
    let velocities = if output.velocities { "with velocities" } else { "without velocities" };
    let mut text = format!("output: {}, {velocities}\n", output.units);
    for format in output.formats.iter().filter_map(|word| formats::by_extension(word)) {
        text += &format!("  .{}: {}\n", format.extension, format.summary);
    }
    text
}

fn as_json(shot: &Shot, threads: &Chosen<usize>, said: &[Said]) -> Value {
    let said: serde_json::Map<String, Value> =
        said.iter().map(|s| (s.what.to_owned(), json!({"value": s.value, "from": s.source}))).collect();
    let timeline = shot.timeline();
    let effect = |effect: &PlannedEffect| {
        let setting = |(name, value, origin): (&str, &SettingValue, Origin)| {
            let value = match value {
                SettingValue::Number(number) => json!(number),
                SettingValue::Text(text) => json!(text),
                SettingValue::Vector(vector) => json!(vector),
                SettingValue::Flag(flag) => json!(flag),
                SettingValue::Keys(keys) => json!(keys),
            };
            (name.to_owned(), json!({"value": value, "from": origin_word(origin)}))
        };
        let settings: serde_json::Map<String, Value> = effect.settings.iter().map(setting).collect();
        json!({
            "effect": effect.name,
            "garment": effect.garment,
            "because": effect.because,
            "settings": settings,
            "bytes": effect.bytes,
            "notes": effect.notes,
        })
    };
    let scene = shot.simulation().scene();
    let garments: Vec<Value> = scene
        .description()
        .garments
        .iter()
        .zip(scene.meshes())
        .map(|(garment, mesh)| {
            json!({"name": garment.name, "points": mesh.rest_positions().len(), "triangles": mesh.triangles().len()})
        })
        .collect();
    let (state, effects) = bytes(shot);
    json!({
        "shot": shot.name(),
        "frames": shot.frames(),
        "start_frame": timeline.start,
        "fps": [timeline.fps_numerator, timeline.fps_denominator],
        "threads": {"value": threads.value, "from": threads.source},
        "run": said,
        "garments": garments,
        "bodies": scene.description().bodies.iter().map(|body| &body.name).collect::<Vec<_>>(),
        "effects": shot.simulation().plan().iter().map(effect).collect::<Vec<_>>(),
        "structures": structures(shot),
        "bytes": {"state": state, "effects": effects},
        "formats": shot.output().formats,
        "resolved": shot.resolved(),
    })
}

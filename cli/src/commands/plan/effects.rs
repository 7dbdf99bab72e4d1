//! The effects of a plan: why each is there, what it holds, what it needs, and its share of a frame.

use drapery_core::effects::cost::{FrameCost, METHOD};
use drapery_core::effects::{Need, PlannedEffect, find};
use drapery_core::scene::SceneDescription;
use drapery_core::settings::{Origin, SettingValue};
use drapery_core::simulation::Simulation;
use serde_json::{Value, json};

use super::mebibytes;

/// What a frame costs, and how that is known.
pub(super) struct Costs {
    pub(super) frame: FrameCost,
    /// Number of frames that were simulated for it; none if it is expected.
    pub(super) measured: Option<u32>,
}

impl Costs {
    /// Share of a frame [%].
    fn share(&self, seconds: f64) -> f64 {
        100.0 * seconds / self.frame.total().max(f64::MIN_POSITIVE)
    }

    fn how(&self) -> String {
        match self.measured {
            Some(1) => "measured in one frame".to_owned(),
            Some(frames) => format!("measured in {frames} frames"),
            None => {
                "expected by the costs of docs/effects.md, on one thread; --measure simulates frames instead".to_owned()
            }
        }
    }
}

/// All effects, in the order of execution.
pub(super) fn text(simulation: &Simulation, costs: &Costs) -> String {
    let mut text = String::from("\neffects, in the order of execution\n");
    for (effect, seconds) in simulation.plan().iter().zip(&costs.frame.effects) {
        text += &effect_text(effect, costs.share(*seconds));
        text += &friction(effect, simulation.scene().description());
    }
    let vertices = simulation.scene().parts().partition().vertex_count();
    let share = costs.share(costs.frame.method);
    text += &format!("  the method itself\n    {vertices} {}, {share:.1} % of a frame\n", METHOD.elements);
    for name in &simulation.scene().description().left_out {
        text += &format!("  without {name}: the scene asks for it, and was told to do without\n");
    }
    text += "  an effect that is not here allocates nothing and runs nothing\n";
    let FrameCost { steps, iterations, .. } = costs.frame;
    let (seconds, how) = (costs.frame.total(), costs.how());
    text += &format!("a frame: {seconds:.3} s, {steps:.0} steps, {iterations:.0} iterations ({how})\n");
    text += "\nshared structures\n";
    for (need, users) in structures(simulation) {
        text += &format!("  {}: for {}\n", word(need), users.join(", "));
    }
    text
}

fn effect_text(effect: &PlannedEffect, share: f64) -> String {
    let on = effect.garment.as_ref().map_or(String::new(), |garment| format!(" of {garment}"));
    let mut text = format!("  {}{on}: {}\n", effect.name, effect.because);
    let (elements, kind, memory) = (effect.elements, effect.cost.elements, mebibytes(effect.bytes));
    text += &format!("    {elements} {kind}, {memory}, {share:.1} % of a frame\n");
    for (name, value, origin) in effect.settings.iter() {
        text += &format!("    {name} = {} ({})\n", value_text(value), source(effect, name, origin));
    }
    for note in &effect.notes {
        text += &format!("    note: {note}\n");
    }
    text
}

/// Why there is friction in a contact, or why not.
fn friction(effect: &PlannedEffect, scene: &SceneDescription) -> String {
    let Some(friction) = find(effect.name).and_then(|spec| spec.friction) else { return String::new() };
    let reasons = friction(&effect.settings, scene);
    match reasons.is_empty() {
        true => "    friction: off, because nothing here has any\n".to_owned(),
        false => format!("    friction: on, because {}\n", reasons.join(", ")),
    }
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

/// Who says a setting, in the words of `resolved.toml`.
fn source<'a>(effect: &'a PlannedEffect, name: &str, origin: Origin) -> &'a str {
    match origin {
        Origin::Scene => effect.sources.get(name).map_or("scene", String::as_str),
        Origin::Default => "default",
    }
}

/// The structures that some effect needs, each once, with the effects that need it.
fn structures(simulation: &Simulation) -> Vec<(Need, Vec<&'static str>)> {
    let mut needs: Vec<Need> = simulation.plan().iter().flat_map(|effect| effect.needs).copied().collect();
    needs.sort_unstable();
    needs.dedup();
    let users = |need: &Need| {
        let mut users: Vec<&str> =
            simulation.plan().iter().filter(|effect| effect.needs.contains(need)).map(|effect| effect.name).collect();
        users.dedup();
        users
    };
    needs.iter().map(|need| (*need, users(need))).collect()
}

fn word(need: Need) -> &'static str {
    match need {
        Need::State => "masses and parts",
        Need::PinTargets => "pin targets",
        Need::Bodies => "bodies and their trees",
        Need::ClothSurface => "trees over the triangles of cloth",
        Need::PairList => "list of close pairs",
        Need::SecondRing => "a second ring of triangles around parts of other ranks",
    }
}

/// The same for programs.
pub(super) fn as_json(simulation: &Simulation, costs: &Costs) -> Value {
    let effect = |(effect, seconds): (&PlannedEffect, &f64)| {
        let with_source = |(name, value, origin)| (name.to_owned(), setting(value, source(effect, name, origin)));
        let settings: serde_json::Map<String, Value> = effect.settings.iter().map(with_source).collect();
        json!({
            "effect": effect.name,
            "garment": effect.garment,
            "because": effect.because,
            "settings": settings,
            "elements": {"kind": effect.cost.elements, "number": effect.elements},
            "bytes": effect.bytes,
            "share": costs.share(*seconds) / 100.0,
            "needs": effect.needs.iter().map(|need| word(*need)).collect::<Vec<_>>(),
            "notes": effect.notes,
        })
    };
    let structures: serde_json::Map<String, Value> =
        structures(simulation).into_iter().map(|(need, users)| (word(need).to_owned(), json!(users))).collect();
    json!({
        "effects": simulation.plan().iter().zip(&costs.frame.effects).map(effect).collect::<Vec<_>>(),
        "left_out": simulation.scene().description().left_out,
        "structures": structures,
        "frame": {
            "seconds": costs.frame.total(),
            "steps": costs.frame.steps,
            "iterations": costs.frame.iterations,
            "method_share": costs.share(costs.frame.method) / 100.0,
            "from": costs.how(),
        },
    })
}

fn setting(value: &SettingValue, source: &str) -> Value {
    let value = match value {
        SettingValue::Number(number) => json!(number),
        SettingValue::Text(text) => json!(text),
        SettingValue::Vector(vector) => json!(vector),
        SettingValue::Flag(flag) => json!(flag),
        SettingValue::Keys(keys) => json!(keys),
    };
    json!({"value": value, "from": source})
}

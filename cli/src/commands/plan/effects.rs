//! The effects of a plan: why each is there, what it holds, what it needs, and its share of a frame once that was measured.

use drapery_core::effects::cost::FrameCost;
use drapery_core::effects::{Need, PlannedEffect, find};
use drapery_core::scene::{Integrator, SceneDescription};
use drapery_core::settings::{Origin, SettingValue};
use drapery_core::simulation::{FrameEstimate, PARTS_OF_A_FRAME, PlannedSteps, Simulation};
use serde_json::{Value, json};

use super::mebibytes;

/// Cost of a frame, measured over frames that were simulated for it.
pub(crate) struct Costs {
    pub(super) frame: FrameCost,
    /// Their number.
    pub(super) frames: u32,
}

impl Costs {
    /// Share of a frame, from 0 to 1.
    fn share(&self, seconds: f64) -> f64 {
        seconds / self.frame.total().max(f64::MIN_POSITIVE)
    }

    fn how(&self) -> String {
        match self.frames {
            1 => "measured in one frame".to_owned(),
            frames => format!("measured in {frames} frames"),
        }
    }
}

/// All effects, in the order of execution.
pub(super) fn text(simulation: &Simulation, costs: Option<&Costs>) -> String {
    let mut text = String::from("\neffects, in the order of execution\n");
    let share = |seconds: fn(&FrameCost, usize) -> f64, place: usize| {
        costs.map_or(String::new(), |costs| {
            format!(", {:.1} % of a frame", 100.0 * costs.share(seconds(&costs.frame, place)))
        })
    };
    for (place, effect) in simulation.plan().iter().enumerate() {
        text += &effect_text(effect, &share(|frame, place| frame.effects[place], place));
        text += &friction(effect, simulation.scene().description());
    }
    let vertices = simulation.scene().parts().partition().vertex_count();
    text += &format!("  time integration\n    {vertices} vertices{}\n", share(|frame, _| frame.method, 0));
    text += &integrator_text(simulation);
    for name in &simulation.scene().description().left_out {
        text += &format!("  without {name}: left out of this run, although the scene asks for it\n");
    }
    text += "  effects that are not listed use no memory and no time\n";
    text += &frame_text(simulation, costs);
    text += "\nshared structures\n";
    for (need, users) in structures(simulation) {
        text += &format!("  {}: for {}\n", word(need), users.join(", "));
    }
    text
}

/// Returns the integrator of a simulation, and the expected cost of a frame with the other one, as text.
fn integrator_text(simulation: &Simulation) -> String {
    let integrator = simulation.scene().description().solver.integrator;
    let expected = |integrator: &Integrator| {
        let estimate = simulation.estimate_with(*integrator);
        let least = if estimate.is_least { "at least " } else { "" };
        format!("{least}{:.2} with `{}`", estimate.total(), integrator.word())
    };
    let expected: Vec<String> = Integrator::ALL.iter().map(expected).collect();
    let changes =
        if simulation.scene().may_change_integrator() { " at first; it may change between frames" } else { "" };
    format!("    integrator `{}`{changes}; expected CPU seconds a frame: {}\n", integrator.word(), expected.join(", "))
}

/// Returns the cost of a frame as text: measured, or as far as it is known beforehand.
fn frame_text(simulation: &Simulation, costs: Option<&Costs>) -> String {
    let Some(costs) = costs else {
        let PlannedSteps { steps, because, .. } = simulation.planned_steps();
        return format!(
            "per frame: at least {steps:.0} time steps, required by {because}; --measure simulates frames and times each \
             effect\n{}",
            estimate_text(&simulation.estimate())
        );
    };
    let FrameCost { steps, iterations, .. } = costs.frame;
    let (seconds, how) = (costs.frame.total(), costs.how());
    format!("per frame: {seconds:.3} s, {steps:.0} steps, {iterations:.0} iterations ({how})\n")
}

/// Returns the estimated time of a frame as text, the longest part first.
fn estimate_text(estimate: &FrameEstimate) -> String {
    let parts: Vec<String> = by_time(estimate).map(|(name, seconds)| format!("{name} {}", about(seconds))).collect();
    let (total, iterations, parts) = (about(estimate.total()), estimate.iterations, parts.join(", "));
    if estimate.is_least {
        return format!(
            "  expected in contact, on one core: at least {total} CPU seconds ({parts}), {iterations:.0} iterations; retries of \
             steps in hard contact come on top (--measure shows them)\n"
        );
    }
    let touching = if estimate.in_contact { "in contact" } else { "without contact" };
    format!(
        "  expected {touching}, within a factor of two on one core: {total} CPU seconds ({parts}), {iterations:.0} iterations\n"
    )
}

/// Parts of a frame that take time, the longest first.
fn by_time(estimate: &FrameEstimate) -> impl Iterator<Item = (&'static str, f64)> {
    let mut parts: Vec<_> = PARTS_OF_A_FRAME.iter().map(|(name, _)| *name).zip(estimate.seconds).collect();
    parts.retain(|(_, seconds)| *seconds > 0.0);
    parts.sort_by(|a, b| b.1.total_cmp(&a.1));
    parts.into_iter()
}

/// One digit, or two from one second on.
fn about(seconds: f64) -> String {
    let digits = if seconds >= 1.0 { 1 } else { (1.0 - seconds.max(1e-3).log10()).floor() as usize };
    format!("{seconds:.digits$}")
}

fn effect_text(effect: &PlannedEffect, share: &str) -> String {
    let on = effect.garment.as_ref().map_or(String::new(), |garment| format!(" of {garment}"));
    let mut text = format!("  {}{on}: {}\n", effect.name, effect.because);
    let (elements, kind, memory) = (effect.elements, effect.kind, mebibytes(effect.bytes));
    text += &format!("    {elements} {kind}, {memory}{share}\n");
    for (name, value, origin) in effect.settings.iter() {
        let unit = unit(effect, name, value);
        text += &format!("    {name} = {}{unit} ({})\n", value_text(value), source(effect, name, origin));
    }
    for note in &effect.notes {
        text += &format!("    note: {note}\n");
    }
    text
}

/// The SI unit of a setting's numbers, with a blank in front; empty for words, flags and pure numbers.
fn unit(effect: &PlannedEffect, name: &str, value: &SettingValue) -> String {
    let has_numbers = !matches!(value, SettingValue::Text(_) | SettingValue::Flag(_));
    let field = find(effect.name).and_then(|spec| spec.fields.iter().find(|field| field.name == name));
    let unit = field.filter(|_| has_numbers).map_or("", |field| field.dimension.si_unit());
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}

/// Why there is friction in a contact, or why not.
fn friction(effect: &PlannedEffect, scene: &SceneDescription) -> String {
    let Some(friction) = find(effect.name).and_then(|spec| spec.friction) else { return String::new() };
    let reasons = friction(&effect.settings, scene);
    match reasons.is_empty() {
        true => "    friction: off, no coefficient of friction is set\n".to_owned(),
        false => format!("    friction: on, because {}\n", reasons.join(", ")),
    }
}

/// A value of a setting as text, in its SI unit.
pub(super) fn value_text(value: &SettingValue) -> String {
    match value {
        SettingValue::Number(number) => number.to_string(),
        SettingValue::Text(text) => text.clone(),
        SettingValue::Vector(vector) => format!("{vector:?}"),
        SettingValue::Flag(flag) => flag.to_string(),
        SettingValue::Keys(keys) => format!("{keys:?}"),
    }
}

/// Returns the source of a setting, in the words of `resolved.toml`.
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

/// The same for programs; what nobody measured is null.
pub(super) fn as_json(simulation: &Simulation, costs: Option<&Costs>) -> Value {
    let share = |seconds: fn(&FrameCost, usize) -> f64, place: usize| {
        costs.map(|costs| costs.share(seconds(&costs.frame, place)))
    };
    let effect = |(place, effect): (usize, &PlannedEffect)| {
        let with_source = |(name, value, origin): (&str, &SettingValue, Origin)| {
            (name.to_owned(), setting(value, source(effect, name, origin)))
        };
        let settings: serde_json::Map<String, Value> = effect.settings.iter().map(with_source).collect();
        json!({
            "effect": effect.name,
            "garment": effect.garment,
            "because": effect.because,
            "settings": settings,
            "elements": {"kind": effect.kind, "number": effect.elements},
            "bytes": effect.bytes,
            "share": share(|frame, place| frame.effects[place], place),
            "needs": effect.needs.iter().map(|need| word(*need)).collect::<Vec<_>>(),
            "notes": effect.notes,
        })
    };
    let structures: serde_json::Map<String, Value> =
        structures(simulation).into_iter().map(|(need, users)| (word(need).to_owned(), json!(users))).collect();
    let planned = simulation.planned_steps();
    json!({
        "effects": simulation.plan().iter().enumerate().map(effect).collect::<Vec<_>>(),
        "left_out": simulation.scene().description().left_out,
        "structures": structures,
        "frame": {
            "seconds": costs.map(|costs| costs.frame.total()),
            "steps": costs.map_or(planned.steps, |costs| costs.frame.steps),
            "iterations": costs.map(|costs| costs.frame.iterations),
            "method_share": share(|frame, _| frame.method, 0),
            "estimate": estimate_json(&simulation.estimate()),
            "from": costs.map_or_else(|| format!("at least, required by {}", planned.because), Costs::how),
        },
        "integrator": simulation.scene().description().solver.integrator.word(),
        "may_change_integrator": simulation.scene().may_change_integrator(),
        "expected_seconds": Integrator::ALL
            .map(|integrator| (integrator.word(), simulation.estimate_with(integrator).total()))
            .into_iter()
            .collect::<std::collections::BTreeMap<_, _>>(),
    })
}

/// Returns the estimate made beforehand as JSON, also where frames were measured.
fn estimate_json(estimate: &FrameEstimate) -> Value {
    let parts: serde_json::Map<String, Value> =
        by_time(estimate).map(|(name, seconds)| (name.to_owned(), json!(seconds))).collect();
    let FrameEstimate { in_contact, steps, solves, iterations, collision_steps, is_least, .. } = estimate;
    json!({
        "seconds": estimate.total(),
        "parts": parts,
        "in_contact": in_contact,
        "is_least": is_least,
        "steps": steps,
        "solves": solves,
        "iterations": iterations,
        "collision_steps": collision_steps,
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

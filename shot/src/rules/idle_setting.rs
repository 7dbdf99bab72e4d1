//! Settings that change nothing because of another one.

use std::collections::BTreeSet;

use drapery_core::effects;
use drapery_core::scene::{ContactRule, ContactSide, EffectRequest, SeamDescription};
use drapery_core::settings::{SettingValue, Settings};

use super::{Facts, Finding};

/// Settings of effects that change nothing in some scenes: the effect, its keys, when, and why that is so and what to write.
struct Idle {
    effect: &'static str,
    keys: &'static [&'static str],
    when: fn(&Settings) -> bool,
    because: &'static str,
    line: &'static str,
}

/// All of them.
fn idle_settings() -> [Idle; 1] {
    [Idle {
        effect: "pressure",
        keys: &["ambient"],
        when: |pressure| !pressure.flag("gas"),
        because: "without `gas` the pressure inside does not depend on the one outside",
        line: "gas = true beside it",
    }]
}

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let of_effects = facts.scene.effects.iter().flat_map(|request| of_effect(facts, request));
    of_effects.chain(of_bodies(facts)).chain(of_contacts(facts)).chain(of_seams(facts)).collect()
}

fn of_effect(facts: &Facts<'_>, request: &EffectRequest) -> Vec<Finding> {
    let Some(spec) = effects::find(&request.effect) else { return Vec::new() };
    // What is wrong with the settings themselves is reported elsewhere.
    let Ok(settings) = Settings::check(spec.fields, &request.settings) else { return Vec::new() };
    let object = match request.garment.and_then(|garment| facts.scene.garments.get(garment)) {
        Some(garment) => format!("garment \"{}\", {}", garment.name, spec.name),
        None => spec.name.to_owned(),
    };
    let usual = |key: &str| {
        let field = spec.fields.iter().find(|field| field.name == key)?;
        match field.check(&field.default.value()?).ok()? {
            SettingValue::Number(number) => Some(number),
            _ => None,
        }
    };
    let of_effect = |idle: &Idle| idle.effect == spec.name && (idle.when)(&settings);
    let idle = idle_settings().into_iter().filter(of_effect);
    let keys = idle.flat_map(|idle| idle.keys.iter().map(move |key| (*key, idle.because, idle.line)));
    let written = keys.filter(|(key, ..)| settings.optional(key) != usual(key));
    written.map(|(key, because, line)| finding(object.clone(), key, because, line)).collect()
}

fn of_bodies(facts: &Facts<'_>) -> Vec<Finding> {
    let has_preroll = facts.inputs.preroll.frames() > 0;
    let with_rest = facts.inputs.bodies.iter().flatten().filter(|body| body.rest.is_some() && !has_preroll);
    let because = "the shot has no pre-roll in which the body could hold it";
    let line = "preroll = { settle = 24, blend = 24 } in [shot]";
    with_rest.map(|body| finding(body.label.clone(), "rest", because, line)).collect()
}

/// Keys of seams that keep their gap, and so do not close.
fn of_seams(facts: &Facts<'_>) -> Vec<Finding> {
    let of_seam = |(number, seam): (usize, &SeamDescription)| {
        let idle = [("rest_gap", seam.rest_gap.is_some()), ("zip", seam.zip && seam.opens.is_none())];
        let idle = idle.into_iter().filter(|(_, written)| *written && seam.keeps_gap);
        let because = "with `keep_gap` the seam does not close";
        let line = "keep_gap = false, or leave it out";
        idle.map(|(key, _)| finding(format!("seam {number}"), key, because, line)).collect::<Vec<_>>()
    };
    facts.scene.seams.iter().enumerate().flat_map(of_seam).collect()
}

/// Rules of contact for a garment whose parts all have a rule of their own for the same pair.
fn of_contacts(facts: &Facts<'_>) -> Vec<Finding> {
    let rules = &facts.scene.contacts;
    let is_idle = |rule: &ContactRule| {
        let [a, b] = rule.between;
        a != b && [(a, b), (b, a)].into_iter().any(|(side, other)| is_covered(facts, side, other))
    };
    let idle = rules.iter().enumerate().filter(|(_, rule)| is_idle(rule));
    let of_rule = |(number, _): (usize, &ContactRule)| Finding {
        object: format!("contact {number}"),
        message: "it changes nothing here: rules for parts cover all vertices of the garment".to_owned(),
        line: "smaller parts, or leave this rule out".to_owned(),
    };
    idle.map(of_rule).collect()
}

/// Whether all vertices of a garment belong to parts that have a rule with `other`.
fn is_covered(facts: &Facts<'_>, side: ContactSide, other: ContactSide) -> bool {
    let ContactSide::Garment(garment) = side else { return false };
    let description = &facts.scene.garments[garment];
    let parts = description.parts.values().enumerate();
    let ruled = parts.filter(|(part, _)| facts.scene.contact_rule(ContactSide::Part(garment, *part), other).is_some());
    let covered: BTreeSet<u32> = ruled.flat_map(|(_, vertices)| vertices.iter().copied()).collect();
    !covered.is_empty() && facts.start_of(garment).is_some_and(|points| points.len() == covered.len())
}

fn finding(object: String, key: &str, because: &str, line: &str) -> Finding {
    Finding { object, message: format!("`{key}` changes nothing here: {because}"), line: line.to_owned() }
}

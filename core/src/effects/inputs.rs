//! Parts of a scene that are there for one effect alone: pins, seams and bodies, which ask for it, and the grid of
//! the wind.
//!
//! The table is in every build, also where an effect is not: a scene that asks for it is then refused, not run without it.

use crate::scene::{PinDescription, PinTarget, SceneDescription, SeamDescription};

/// Parts of a scene that only one effect looks at.
#[derive(Debug)]
pub struct EffectInput {
    /// The effect.
    pub effect: &'static str,
    /// One of these parts, as in "a pin".
    pub one: &'static str,
    /// Whether a scene has some, which ask for the effect; `None` where a table asks for it.
    pub asks: Option<fn(&SceneDescription) -> bool>,
    /// Description in words of the ones that the scene has; empty if it has none.
    pub because: fn(&SceneDescription) -> String,
    /// Takes them out of a scene that does without the effect.
    pub remove: fn(&mut SceneDescription),
}

/// All of them.
pub static INPUTS: [EffectInput; 6] = [
    EffectInput {
        effect: "body_collision",
        one: "a body",
        asks: Some(|scene| !scene.bodies.is_empty()),
        because: |scene| {
            let bodies = scene.bodies.len();
            format!("the scene has {bodies} bod{}", if bodies == 1 { "y" } else { "ies" })
        },
        remove: |scene| {
            let follows = |target: &PinTarget| matches!(target, PinTarget::Body { .. } | PinTarget::BodyNearest { .. });
            if !scene.pins.iter().any(|pin| follows(&pin.target)) {
                scene.bodies.clear();
            }
            scene.retain_contacts(|rule| rule.body().is_none());
        },
    },
    EffectInput {
        effect: "pins",
        one: "a pin",
        asks: Some(|scene| scene.pins.iter().any(PinDescription::is_hard)),
        because: |scene| pinned(scene, PinDescription::is_hard, "pinned"),
        remove: |scene| scene.pins.retain(|pin| !pin.is_hard()),
    },
    EffectInput {
        effect: "attachments",
        one: "a spring pin",
        asks: Some(|scene| !scene.pins.iter().all(PinDescription::is_hard)),
        because: |scene| pinned(scene, |pin| !pin.is_hard(), "spring-pinned"),
        remove: |scene| scene.pins.retain(PinDescription::is_hard),
    },
    EffectInput {
        effect: "elastic_bands",
        one: "an elastic band",
        asks: Some(|scene| !scene.elastics.is_empty()),
        because: |scene| {
            let bands = scene.elastics.len();
            format!("the garments have {bands} elastic band{}", if bands == 1 { "" } else { "s" })
        },
        remove: |scene| scene.elastics.clear(),
    },
    EffectInput {
        effect: "seams",
        one: "a seam",
        asks: Some(|scene| !scene.seams.is_empty()),
        because: |scene| {
            let (seams, stitches) =
                (scene.seams.len(), scene.seams.iter().map(SeamDescription::stitches).sum::<usize>());
            format!("{seams} seam{} of {stitches} stitches", if seams == 1 { "" } else { "s" })
        },
        remove: |scene| scene.seams.clear(),
    },
    EffectInput {
        effect: "wind",
        one: "a grid of the wind",
        asks: None,
        because: |_| String::new(),
        remove: |scene| scene.wind = None,
    },
];

/// Returns the number of vertices of each garment that these pins hold, in words.
fn pinned(scene: &SceneDescription, which: impl Fn(&PinDescription) -> bool, how: &str) -> String {
    let held = |garment: usize| -> usize {
        let pins = scene.pins.iter().filter(|pin| pin.garment == garment && which(pin));
        pins.map(|pin| pin.target.count()).sum()
    };
    let counts = scene.garments.iter().enumerate().map(|(index, garment)| (&garment.name, held(index)));
    let with_some = counts.filter(|(_, count)| *count > 0);
    let texts: Vec<String> =
        with_some.map(|(name, count)| format!("garment \"{name}\" has {count} {how} vertices")).collect();
    texts.join(", ")
}

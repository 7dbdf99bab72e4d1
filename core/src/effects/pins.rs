//! Pins: vertices whose motion is prescribed. Hard pins replace the motion of their vertices; the `attachments` effect
//! holds by springs instead. Both follow the same targets: the start position (moved along a path), an animated track, or
//! a place on a body's surface.
//!
//! ```toml
//! [[garment.pin]]
//! vertices = [0, 40]
//! to = "start"          # or "body:hero"
//! ```

use crate::effects::spec::{BuildContext, Effect, EffectSpec, Need, Report, Scope, Study};
use crate::error::Problem;
use crate::pins::{BEHIND, HardPins, SECTION, STRETCHED};
use crate::scene::SceneDescription;
use crate::settings::Settings;

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "pins",
    summary: "hard pins: kinematic vertices that follow their targets exactly",
    scope: Scope::Implied,
    example: r#"[[garment.pin]]
corners = ["i0j0"]"#,
    fields: &[],
    needs: &[Need::State, Need::PinTargets],
    elements: "vertices",
    section: Some(SECTION),
    report: Report { shared_stages: &["bodies and pins"], counts: &[BEHIND, STRETCHED], ..Report::NONE },
    study: Study { is_essential: true, does_work: Some(SceneDescription::moves_pins), ..Study::OUTSIDE },
    build,
    ..EffectSpec::BARE
};

fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let pins = HardPins::new(context.scene);
    let (elements, bytes) = (pins.count(), pins.bytes());
    Ok(Effect { pins: Some(pins), elements, bytes, ..Effect::default() })
}

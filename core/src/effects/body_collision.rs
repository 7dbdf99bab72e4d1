//! Body collision: cloth vertices stay outside bodies and feel their friction (`docs/theory/friction.md`).
//!
//! It exists as soon as the scene has a body; each body brings its own `friction` and `thickness`. What it does is in
//! `crate::contact::bodies`.

use crate::contact::bodies::collision::{BodyCollision, EFFECT, SECTION};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Report, Scope, Study};
use crate::error::Problem;
use crate::settings::Settings;

/// Registry entry.
pub static SPEC: EffectSpec = EffectSpec {
    name: EFFECT,
    summary: "collision of cloth with bodies (colliders), and friction",
    scope: Scope::Implied,
    example: r#"[[body]]
name = "ball"
shape = { sphere = { radius = "20 cm" } }"#,
    fields: &[],
    needs: &[Need::State, Need::Bodies],
    elements: "vertices",
    section: Some(SECTION),
    maps: &[MapSpec::of("friction", &["friction"])],
    report: Report {
        stages: &["B.4 body collision", "B.7 body friction", "bodies and pins"],
        counts: &[
            "body_contacts",
            "body_contacts_along_path",
            "body_queries",
            "body_squeezed",
            "body_pinched",
            "body_inside_out",
            "friction_unsettled",
        ],
        ..Report::NONE
    },
    study: Study {
        is_essential: true,
        does_work: Some(|scene| (0..scene.bodies.len()).any(|body| scene.moves_body(body))),
        ..Study::OUTSIDE
    },
    cost: Cost { bytes_of_point: 270.0, ..Cost::NONE },
    friction: Some(|_, scene| {
        let rough = scene.bodies.iter().filter(|body| body.friction > 0.0);
        rough.map(|body| format!("body {} has friction {}", body.name, body.friction)).collect()
    }),
    build,
    ..EffectSpec::BARE
};

fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let collision = BodyCollision::new(context.scene);
    let (elements, bytes) = (context.scene.parts().own().len(), collision.bytes());
    Ok(Effect { body_collision: Some(collision), elements, bytes, ..Effect::default() })
}

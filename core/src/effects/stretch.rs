//! Stretch: a spring along every edge of the triangulation, the paper's in-plane model (`docs/theory/step.md#springs`).
//!
//! ```toml
//! [garment.stretch]
//! stiffness = "500 N/m"     # membrane stiffness: the same cloth at every mesh density
//! damping_ratio = 1.0
//! ```
//!
//! The paper's scenes write `spring_stiffness = 4.142136` [N] instead: the force of one spring per unit strain, which makes
//! a finer mesh of the same cloth stiffer. Limits: in-plane stiffness is isotropic and shear follows from the mesh.

use crate::effects::spec::{BuildContext, Effect, EffectSpec, MapSpec, Need, Scope};
use crate::effects::springs::{self, FIELDS};
use crate::error::Problem;
use crate::settings::Settings;

/// Registry entry.
pub static SPEC: EffectSpec = EffectSpec {
    name: "stretch",
    summary: "springs along the edges resist stretching and compression",
    scope: Scope::Garment,
    example: r#"[garment.stretch]
stiffness = "300 N/m""#,
    fields: FIELDS,
    needs: &[Need::State],
    elements: "springs",
    maps: &[MapSpec::of("stretch"), MapSpec::of("stretch_damping")],
    bytes_of_point: 190.0,
    is_internal: true,
    is_essential: true,
    build,
    ..EffectSpec::BARE
};

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    springs::build_effect(settings, context, "stretch", springs::along_edges, true)
}

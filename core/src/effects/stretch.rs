//! Stretch: a spring along every edge of the triangulation, the paper's in-plane model (`docs/theory/step.md#springs`).
//!
//! ```toml
//! [garment.stretch]
//! stiffness = "500 N/m"     # membrane stiffness: the same cloth at every mesh density
//! damping_ratio = 1.0
//! extension = "6.1 %"       # stiffens up to 98 N/m at this strain and beyond (`tensile_curve`)
//! ```
//!
//! The paper's scenes write `spring_stiffness = 4.142136` [N] instead: the force of one spring per unit strain, which makes
//! a finer mesh of the same cloth stiffer. Limits: in-plane stiffness is isotropic and shear follows from the mesh.

use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Scope, Study};
use crate::effects::springs::{self, Springs};
use crate::effects::tensile_curve::{self, TensileCurve};
use crate::error::Problem;
use crate::settings::Settings;

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "stretch",
    summary: "springs along the edges resist stretching and compression",
    scope: Scope::Garment,
    example: r#"[garment.stretch]
stiffness = "300 N/m""#,
    fields: &[
        springs::FIELDS[0],
        springs::FIELDS[1],
        springs::FIELDS[2],
        springs::FIELDS[3],
        tensile_curve::FIELDS[0],
        tensile_curve::FIELDS[1],
        tensile_curve::FIELDS[2],
    ],
    needs: &[Need::State],
    elements: "springs",
    maps: &[
        MapSpec::of("stretch", &["stiffness", "spring_stiffness"]),
        MapSpec::of("stretch_damping", &["damping_ratio"]),
    ],
    study: Study { is_essential: true, ..Study::INTERNAL },
    cost: Cost { bytes_of_point: 190.0, update: 4.0, product: 1.0 },
    build,
    ..EffectSpec::BARE
};

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let curve = match settings.optional("stiffness") {
        Some(stiffness) => TensileCurve::of_garment(settings, context, "stretch", [stiffness])?[0],
        None => match TensileCurve::first_setting(settings) {
            Some(name) => {
                let garment = context.garment.map_or("", |garment| &context.scene.description().garments[garment].name);
                let what = format!("`{name}` belongs to the stiffness of cloth, not to that of single springs");
                let advice = "give `stiffness` (N/m) in the place of `spring_stiffness`";
                return Err(Problem::scene(format!("garment \"{garment}\", stretch"), what, advice));
            }
            None => None,
        },
    };
    springs::build_effect(
        settings,
        context,
        &Springs { name: "stretch", elements: springs::along_edges, is_cloth: true, curve },
    )
}

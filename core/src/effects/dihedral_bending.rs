//! Dihedral bending: the angle between neighbouring triangles resists change, with a bending rigidity as textile
//! laboratories measure it, the same at every density and for every kind of mesh (`docs/theory/step.md#springs`).
//!
//! ```toml
//! [garment.dihedral_bending]
//! stiffness = "20 µN·m"     # bending rigidity: moment per width and curvature
//! damping_ratio = 1.0
//! flat = false              # true: bends back to flat, whatever the rest shape
//! ```
//!
//! The three angles around a triangle say how the cloth is curved there: they are linear in the curvature tensor κ, with
//! coefficients that follow from the rest shape, and are exact where the curvature is uniform. A triangle of area A holds
//! the energy ½ A κ:C:κ with C diagonal: rigidity along warp and weft, and for twist. Every angle θ acts on its four
//! vertices along ∂θ/∂x, the directions of Bridson, Marino and Fedkiw 2003; damping acts along the same
//! directions, angle by angle, so that it is symmetric and never adds energy. How this compares with elements that look at
//! one angle alone is in decision 13.
//!
//! Limits: at a free edge curvature across that edge is not resisted. A hinge is left out while one of its triangles is
//! squashed below a tenth of its height.

#![cfg(feature = "effects")]

mod arctangent;
mod elements;
mod part_hinges;
#[cfg(test)]
mod tests;

use crate::effects::registry::find;
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Report, Scope, Study};
use crate::error::Problem;
use crate::settings::{Default, Dimension, Field, Settings};
use crate::tolerances::LOW_TRIANGLE;
use elements::{Element, Rigidity};
use part_hinges::Laws;

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "dihedral_bending",
    summary: "angles between triangles resist bending, with a measured rigidity",
    scope: Scope::Garment,
    example: r"[garment.dihedral_bending]
stiffness = 1e-5",
    fields: FIELDS,
    needs: &[Need::State, Need::SecondRing],
    elements: "hinges",
    maps: &[
        MapSpec::of("dihedral_bending", &["stiffness"]),
        MapSpec::of("dihedral_bending_damping", &["damping_ratio"]),
    ],
    report: Report { counts: &["hinges_left_out"], ..Report::NONE },
    study: Study::INTERNAL,
    cost: Cost { bytes_of_point: 1130.0, update: 20.0, product: 13.0 },
    build,
    ..EffectSpec::BARE
};

const FIELDS: &[Field] = &[
    Field {
        name: "stiffness",
        dimension: Dimension::BendingRigidity,
        default: Default::Required,
        range: (0.0, 1e3),
        help: "bending rigidity, the same at every mesh density; silk has 1, denim 70, paper 400 µN·m",
    },
    Field {
        name: "damping_ratio",
        dimension: Dimension::None,
        default: Default::Number(1.0),
        range: (0.0, 1e3),
        help: "damping of each angle; 1 is critical for its four vertices alone, 0 rings for ever",
    },
    Field {
        name: "flat",
        dimension: Dimension::None,
        default: Default::Flag(false),
        range: (0.0, 1.0),
        help: "whether the cloth bends back to flat instead of to the angles of its rest shape",
    },
];

/// Parameters by which sharp folds of a hinge stay, of [`crate::effects::plastic_wrinkles`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Yield {
    /// Radius of a bend below which it stays [m].
    pub(super) radius: f64,
    /// Growth of the yield angle by what was exceeded.
    pub(super) hardening: f64,
    /// Largest change of an angle at rest [rad].
    pub(super) largest: f64,
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let Some(garment) = context.garment else {
        let advice = "move its table under a [[garment]]";
        return Err(Problem::scene(SPEC.name, "this effect acts on one garment", advice));
    };
    let stiffness = settings.number("stiffness");
    let painted = context.scene.painted(garment, SPEC.name);
    if stiffness == 0.0 && painted.is_none_or(|map| !map.absolute) {
        return Ok(Effect::default());
    }
    let mesh = &context.scene.meshes()[garment];
    let rigidity = |triangle: usize| {
        let here = painted.map_or(stiffness, |map| map.mean(&mesh.triangles()[triangle], stiffness));
        (here > 0.0).then(|| Rigidity::isotropic(here))
    };
    let elements = elements::of_mesh(mesh, rigidity, settings.flag("flat"));
    let laws = Laws {
        damping_ratios: damping_ratios(settings, context, garment, &elements),
        yields: yields(context, garment, &elements),
    };
    let (forces, bytes) = part_hinges::build(context.scene, garment, &elements, &laws);
    let parts = context.scene.parts();
    let first = parts.garment(garment).start;
    // Each hinge counts at the rank that owns its first vertex.
    let is_own = |e: &&Element| e.vertices.iter().min().is_some_and(|v| parts.own().contains(&(first + *v as usize)));
    let own = elements.iter().filter(is_own).count();
    let softened = elements.iter().filter(is_own).filter(|element| element.softening < 1.0).count();
    let [softened] = parts.ranks().sum_of([softened as u64]);
    let notes = (softened > 0).then(|| note(softened)).into_iter().collect();
    Ok(Effect { forces, bytes, elements: own, notes, ..Effect::default() })
}

fn note(softened: u64) -> String {
    format!(
        "{softened} angles at triangles whose height and base differ by more than a factor of {} are softened, so that slivers do not tear: \
         merge vertices that nearly coincide for the full stiffness",
        1.0 / LOW_TRIANGLE
    )
}

/// Damping of each angle as a fraction of critical; where it is painted, the mean of its four vertices.
fn damping_ratios(settings: &Settings, context: &BuildContext<'_>, garment: usize, elements: &[Element]) -> Vec<f64> {
    let of_garment = settings.number("damping_ratio");
    let of = |e: &Element| context.scene.painted_mean(garment, "dihedral_bending_damping", &e.vertices, of_garment);
    elements.iter().map(of).collect()
}

/// Returns the parameters of plastic wrinkles for each hinge, if the garment asks for them; a painted value is the
/// mean of the four vertices of the hinge.
fn yields(context: &BuildContext<'_>, garment: usize, elements: &[Element]) -> Option<Vec<Yield>> {
    let spec = find("plastic_wrinkles")?;
    let mut requests = context.scene.description().effects.iter();
    let request = requests.find(|request| request.effect == spec.name && request.garment == Some(garment))?;
    // Settings that do not fit are reported where that effect is built.
    let settings = Settings::check(spec.fields, &request.settings).ok()?;
    let of = |e: &Element| {
        let here = |name: &str| context.scene.painted_mean(garment, name, &e.vertices, settings.number(name));
        Yield { radius: here("yield_radius"), hardening: here("hardening"), largest: here("largest_angle") }
    };
    Some(elements.iter().map(of).collect())
}

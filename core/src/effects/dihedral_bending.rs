//! Dihedral bending: the angle between neighbouring triangles resists change, with a bending rigidity as textile
//! laboratories measure it, the same at every density and for every kind of mesh (method 1.6).
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
//! vertices along ∂θ/∂x, the directions of Bridson, Marino and Fedkiw 2003 (method 1.6); damping acts along the same
//! directions, angle by angle, so that it is symmetric and never adds energy. How this compares with elements that look at
//! one angle alone is in decision 13.
//!
//! Limits: at a free edge curvature across that edge is not resisted. A hinge is left out while one of its triangles is
//! squashed below a tenth of its height.

mod elements;
mod part_hinges;

use crate::effects::{BuildContext, Effect, EffectSpec, Need, Scope};
use crate::error::Problem;
use crate::settings::{Default, Dimension, Field, Settings};
use elements::Rigidity;

/// Registry entry.
pub static SPEC: EffectSpec = EffectSpec {
    name: "dihedral_bending",
    summary: "angles between triangles resist bending, with a measured rigidity",
    scope: Scope::Garment,
    fields: FIELDS,
    needs: &[Need::State],
    build,
};

const FIELDS: &[Field] = &[
    Field {
        name: "stiffness",
        dimension: Dimension::BendingRigidity,
        default: Default::Required,
        range: (0.0, 1e3),
        help: "bending rigidity, the same at every mesh density; silk has 3, denim 70, paper 400 µN·m",
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

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let Some(garment) = context.garment else {
        let advice = "move its table under a [[garment]]";
        return Err(Problem::scene(SPEC.name, "this effect acts on one garment", advice));
    };
    let stiffness = settings.number("stiffness");
    if stiffness == 0.0 {
        return Ok(Effect::default());
    }
    let mesh = &context.scene.meshes()[garment];
    let elements = elements::of_mesh(mesh, Rigidity::isotropic(stiffness), settings.flag("flat"));
    let (forces, bytes) = part_hinges::build(context.scene, garment, &elements, settings.number("damping_ratio"));
    Ok(Effect { forces, bytes, ..Effect::default() })
}

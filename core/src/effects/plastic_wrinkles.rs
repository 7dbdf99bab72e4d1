//! Plastic wrinkles: folds sharper than the cloth can spring back from stay in it.
//!
//! ```toml
//! [garment.dihedral_bending]
//! stiffness = "20 µN·m"
//!
//! [garment.plastic_wrinkles]
//! yield_radius = "8 mm"      # what is bent more sharply than this, stays bent
//! hardening = 0.2            # how much stiffer against further yielding a fold gets
//! largest_angle = 2.5        # a fold keeps no more than this [rad]
//! ```
//!
//! A hinge of mean height h yields at the angle `y = h / yield_radius`, so that the radius is that of the cloth and not of
//! its mesh. At each state free of collisions, where the angle is off its rest by φ with |φ| > y, the rest angle moves to
//! `θ − sign(φ) y`, but no further than `largest_angle` from that of the rest shape, and y grows by `hardening (|φ| − y)`.
//! Between such states bending is elastic.
//!
//! It changes the rest angles of `dihedral_bending`, which the garment has to have; rest angles and yield angles that have
//! changed are in the section `plastic_wrinkles` of checkpoints. Limits: folds never relax, and stretch stays elastic.

#![cfg(feature = "effects")]

use crate::effects::spec::{BuildContext, Effect, EffectSpec, MapSpec, Need, Report, Scope, Study};
use crate::error::Problem;
use crate::settings::{Default, Dimension, Field, Settings};
use crate::snapshot::saved_section::SectionId;

/// Angles that have yielded.
const SECTION: SectionId = SectionId { name: "plastic_wrinkles", version: 1 };

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "plastic_wrinkles",
    summary: "plasticity in bending: sharp folds leave permanent creases",
    scope: Scope::Garment,
    example: r"[garment.dihedral_bending]
stiffness = 1e-5
[garment.plastic_wrinkles]
yield_radius = 1.0",
    fields: FIELDS,
    needs: &[Need::State],
    requires: &["dihedral_bending"],
    elements: "hinges",
    section: Some(SECTION),
    maps: &[
        MapSpec::of("yield_radius", &["yield_radius"]),
        MapSpec::of("hardening", &["hardening"]),
        MapSpec::of("largest_angle", &["largest_angle"]),
    ],
    report: Report { stages: &["yield"], counts: &["hinges_yielded"], ..Report::NONE },
    study: Study::INTERNAL,
    build,
    ..EffectSpec::BARE
};

const FIELDS: &[Field] = &[
    Field {
        name: "yield_radius",
        dimension: Dimension::Length,
        default: Default::Required,
        range: (0.0, 1e3),
        help: "bend radius below which a crease stays; linen keeps creases bent below 10 mm, wool hardly any",
    },
    Field {
        name: "hardening",
        dimension: Dimension::None,
        default: Default::Number(0.0),
        range: (0.0, 1.0),
        help: "work hardening: by which fraction of the excess over it the yield angle grows; 0 is no hardening",
    },
    Field {
        name: "largest_angle",
        dimension: Dimension::Angle,
        default: Default::Number(2.5),
        range: (0.0, 3.0),
        help: "largest permanent change of a fold angle; pi is a fold flat onto itself",
    },
];

/// The law itself is in the hinges of `dihedral_bending`, which look for these settings.
fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    match context.garment {
        Some(_) => Ok(Effect { yields: Some(SECTION), ..Effect::default() }),
        None => {
            let advice = "move its table under a [[garment]]";
            Err(Problem::scene(SPEC.name, "this effect acts on one garment", advice))
        }
    }
}

//! Bending: a spring across every inner edge, between the two vertices that its triangles do not share
//! (`docs/theory/step.md#springs`).
//!
//! ```toml
//! [garment.bending]
//! stiffness = "20 N/m"
//! damping_ratio = 0.5
//! ```
//!
//! Limits: a flat hinge resists folding only at second order, so the stiffness is not a bending rigidity in N·m.

#![cfg(feature = "effects")]

use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Scope, Study};
use crate::effects::springs::{self, FIELDS, SpringElement, Springs};
use crate::error::Problem;
use crate::mesh::TriangleMesh;
use crate::settings::{Field, Settings};

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "bending",
    summary: "springs across the inner edges resist folding",
    scope: Scope::Garment,
    example: r#"[garment.bending]
stiffness = "5 N/m""#,
    fields: &[
        Field {
            help: "force per width and strain of the springs across inner edges, the same at every mesh density; not a \
                   bending rigidity: a measured one belongs to `dihedral_bending`",
            ..FIELDS[0]
        },
        Field {
            help: "force of one spring per unit strain; refining the mesh stiffens the cloth; 0.83, a fifth of the value for \
                   `stretch`, in the scenes of Selle et al. (2009)",
            ..FIELDS[1]
        },
        FIELDS[2],
        FIELDS[3],
    ],
    needs: &[Need::State],
    elements: "springs",
    maps: &[
        MapSpec::of("bending", &["stiffness", "spring_stiffness"]),
        MapSpec::of("bending_damping", &["damping_ratio"]),
    ],
    study: Study::INTERNAL,
    cost: Cost { bytes_of_point: 130.0, update: 4.0, product: 1.0 },
    build,
    ..EffectSpec::BARE
};

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    springs::build_effect(
        settings,
        context,
        &Springs { name: "bending", elements: across_hinges, is_cloth: false, curve: None },
    )
}

/// One spring per pair of triangles that share an edge; pairs whose opposite corners coincide have nothing to hold apart.
fn across_hinges(mesh: &TriangleMesh) -> Vec<SpringElement> {
    let at = |v: u32| mesh.rest_positions()[v as usize];
    let element = |hinge: &crate::mesh::Hinge| SpringElement {
        vertices: hinge.opposite,
        rest_length: (at(hinge.opposite[0]) - at(hinge.opposite[1])).norm(),
        area: hinge.triangles.iter().map(|t| mesh.rest_areas()[*t as usize]).sum(),
    };
    mesh.hinges().iter().map(element).filter(|e| e.rest_length > 0.0).collect()
}

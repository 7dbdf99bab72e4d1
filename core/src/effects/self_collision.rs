//! Self-collision: what starts free of crossings stays free of them (`docs/theory/self_contact.md#geometric-collisions`).
//!
//! After every few time steps the straight way of every vertex since the last collision-free state is looked at; what
//! would pass through something is stopped, cloth against cloth and cloth against the faces and edges of bodies.
//! Hard cases form impact zones, and at last stay where they were: all of it is counted. Pairs that cross at the start are left
//! alone until they separate.
//!
//! ```toml
//! [self_collision]
//! ```

use crate::contact::self_contact::{CollisionSettings, SECTION};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, Need, Report, Scope, Study, own_triangles};
use crate::error::Problem;
use crate::settings::{Default, Dimension, Field, Settings};

/// Registry entry.
pub static SPEC: EffectSpec = EffectSpec {
    name: "self_collision",
    summary: "cloth never passes through cloth, nor through meshes, boxes and cylinders",
    scope: Scope::Scene,
    example: "[self_collision]",
    fields: &[Field {
        name: "max_steps",
        dimension: Dimension::None,
        default: Default::Number(16.0),
        range: (1.0, 64.0),
        help: "maximum number of time steps (substeps) between two collision passes; adapted up to this",
    }],
    needs: &[Need::State, Need::ClothSurface, Need::PairList],
    elements: "triangles",
    section: Some(SECTION),
    report: Report {
        stages: &["C collisions"],
        shared_stages: &["A neighbours"],
        counts: &[
            "collision_steps",
            "collision_steps_k1",
            "collision_steps_k2",
            "collision_steps_k4",
            "collision_steps_k8",
            "collision_steps_k16",
            "collision_steps_shortened",
            "pair_searches",
            "swept_searches",
            "swept_renewals",
            "collision_loops",
            "collision_attempts",
            "collision_hits",
            "rewinds",
            "zones",
            "zones_large",
            "zone_nodes",
            "zone_sweeps",
            "zones_carried",
            "zones_rigid",
            "zone_fallbacks",
            "pairs_pinched",
            "crossing_checks",
            "crossings_reverted",
            "untangling_steps",
            "crossings",
        ],
    },
    study: Study::INTERNAL,
    cost: Cost { bytes_of_point: 280.0, ..Cost::NONE },
    build,
    ..EffectSpec::BARE
};

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let collision = CollisionSettings { max_steps: settings.number("max_steps") as u32 };
    Ok(Effect { self_collision: Some(collision), elements: own_triangles(context.scene), ..Effect::default() })
}

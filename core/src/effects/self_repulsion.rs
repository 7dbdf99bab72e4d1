//! Self-repulsion: cloth keeps its distance from cloth, within a garment and between garments, by impulses in every time
//! step (`docs/theory/self_contact.md#repulsion-with-history`).
//!
//! Pairs of a point and a triangle, and of two edges, that are closer than their thickness push each other apart, feel friction
//! and stop approaching. The side on which they belong is remembered from the last collision-free state, so a pair that
//! has passed through during a step is pulled back. The thickness is that of the garment, at most `thickness_clamp` times the
//! shortest edge around a vertex. Alone it keeps most layers apart most of the time; `self_collision` makes sure.
//!
//! ```toml
//! [self_repulsion]
//! friction = 0.4
//! ```

use crate::contact::repulsion::Laws;
use crate::contact::self_contact::SECTION;
use crate::effects::spec::{
    BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Report, Scope, Study, own_triangles,
};
use crate::error::Problem;
use crate::scene::RepulsionPlace;
use crate::settings::{Default, Dimension, Field, Settings};

/// Registry entry.
pub static SPEC: EffectSpec = EffectSpec {
    name: "self_repulsion",
    summary: "repulsion and friction between layers of cloth",
    scope: Scope::Scene,
    example: r"[self_repulsion]
friction = 0.5",
    fields: &[
        Field {
            name: "friction",
            dimension: Dimension::None,
            default: Default::Number(0.4),
            range: (0.0, 100.0),
            help: "Coulomb friction between cloth and cloth; left out, the mean of the materials of both, with 0.4 for cloth \
                   without one; Selle et al. (2009) use 0.4 to 3.2",
        },
        Field {
            name: "thickness_clamp",
            dimension: Dimension::None,
            default: Default::Number(0.4),
            range: (0.001, 1.0),
            help: "largest thickness of a vertex as a fraction of its shortest rest edge; the scenes of Selle et al. \
                   (2009) have 0.03",
        },
        Field {
            name: "stiffness",
            dimension: Dimension::None,
            default: Default::Number(30.0),
            range: (0.0, 1e9),
            help: "repulsion modulus: how hard pairs closer than their thickness are pushed apart; not with `tr_bdf2`, \
                   where layers touch at a pressure of 54 kPa",
        },
        Field {
            name: "limit",
            dimension: Dimension::None,
            default: Default::Number(0.1),
            range: (0.0, 1.0),
            help: "maximum fraction of the penetration corrected per time step; not with `tr_bdf2`",
        },
        Field {
            name: "edge_attraction",
            dimension: Dimension::None,
            default: Default::Number(-0.3),
            range: (-2.0, 1.0),
            help: "two edges count as passed through each other if the cosine between their direction and that in the \
                   last intersection-free state is below this; -2: never",
        },
    ],
    needs: &[Need::State, Need::ClothSurface, Need::PairList],
    elements: "triangles",
    section: Some(SECTION),
    maps: &[MapSpec::of("thickness", &[]), MapSpec::of("self_friction", &["friction"])],
    report: Report {
        stages: &["B.2 self-repulsion", "B.8 self-repulsion", "A neighbours"],
        counts: &[
            "repulsions",
            "attractions",
            "inverted_pairs",
            "layers_unsettled",
            "collision_steps",
            "collision_steps_k1",
            "collision_steps_k2",
            "collision_steps_k4",
            "collision_steps_k8",
            "collision_steps_k16",
            "collision_steps_shortened",
            "pair_searches",
            "pairs_near",
        ],
        ..Report::NONE
    },
    study: Study::INTERNAL,
    cost: Cost { bytes_of_point: 300.0, ..Cost::NONE },
    friction: Some(|settings, _| {
        let friction = settings.number("friction");
        (friction > 0.0).then(|| format!("cloth on cloth has friction {friction}")).into_iter().collect()
    }),
    build,
    ..EffectSpec::BARE
};

/// Keys of the impulses, which act where the integrator does not have repulsion in its solves.
pub const OF_IMPULSES: [&str; 2] = ["stiffness", "limit"];

/// Refuses keys of the impulses that differ from their defaults where nothing reads them.
fn check_unused(settings: &Settings, context: &BuildContext<'_>) -> Result<(), Problem> {
    let integrator = context.scene.description().solver.integrator;
    let usual = Settings::defaults(SPEC.fields);
    let unused = OF_IMPULSES.into_iter().find(|key| settings.number(key) != usual.number(key));
    match unused.filter(|_| integrator.spec().repulsion == RepulsionPlace::Solves) {
        None => Ok(()),
        Some(key) => Err(Problem::scene(
            SPEC.name,
            format!(
                "`{key}` has no effect with `{}`, with which layers touch at a pressure of 54 kPa",
                integrator.word()
            ),
            "leave it out, or write integrator = \"semi_implicit\" under [solver]",
        )),
    }
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    check_unused(settings, context)?;
    let laws = Laws {
        stiffness: settings.number("stiffness"),
        limit: settings.number("limit"),
        friction: settings.number("friction"),
        edge_attraction: settings.number("edge_attraction"),
    };
    Ok(Effect {
        self_repulsion: Some((laws, settings.number("thickness_clamp"))),
        elements: own_triangles(context.scene),
        ..Effect::default()
    })
}

//! Networks of linear springs, shared by the stretch and bending effects (`docs/theory/step.md#springs`).
//!
//! A spring between vertices 1 and 2 with unit direction e from 1 to 2 pulls vertex 1 with
//! `k (l - l_rest) e - c ((v1 - v2)·e) e` and vertex 2 with the opposite; `k` in N/m, `c` in N s/m. The elastic term is
//! the paper's `E (l/l0 - 1) e` with `k = E/l0`; the damping term carries the sign that dissipates.
//!
//! Storage of a part's springs, and the loops over them, are in `part_springs`.

pub(super) mod part_springs;

use crate::effects::spec::{BuildContext, Effect};
use crate::effects::tensile_curve::TensileCurve;
use crate::error::Problem;
use crate::mesh::TriangleMesh;
use crate::parallel::ranks::Ranks;
use crate::scene::vertex_maps::PaintedMap;
use crate::settings::{Default, Dimension, Field, Settings};

/// Law by which the stiffness of each spring follows from a setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Stiffness {
    /// Membrane stiffness Y [N/m]: `k = Y · A / l0²` with A the rest area next to the spring, so that the cloth's
    /// stiffness does not depend on the mesh (exact for equilateral triangles: k = Y √3/2). Source: A. Van Gelder,
    /// "Approximate simulation of elastic membranes by triangulated spring meshes", 1998.
    Membrane(f64),
    /// The authors' constant E [N]: `k = E / l0`; refining the mesh makes the cloth stiffer
    /// (`docs/theory/step.md#springs`).
    Constant(f64),
}

/// One spring before it is sorted into parts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpringElement {
    /// Vertices in the garment's own order.
    pub vertices: [u32; 2],
    /// Length at rest [m], positive.
    pub rest_length: f64,
    /// Rest area that belongs to it [m²].
    pub area: f64,
}

/// The settings of springs, with the help of those along edges (`stretch`); shear and bending have their own.
pub(crate) const FIELDS: &[Field] = &[
    Field {
        name: "stiffness",
        dimension: Dimension::Stiffness,
        default: Default::Absent,
        range: (0.0, 1e8),
        help: "force per width and strain, the same at every mesh density; cloth has 50 to 2000 N/m along the threads",
    },
    Field {
        name: "spring_stiffness",
        dimension: Dimension::Force,
        default: Default::Absent,
        range: (0.0, 1e8),
        help: "force of one spring per unit strain, as in the paper's scenes; refining the mesh stiffens the cloth",
    },
    Field {
        name: "damping_ratio",
        dimension: Dimension::None,
        default: Default::Number(1.0),
        range: (0.0, 1e3),
        help: "damping of each spring; 1 is critical for its two vertices alone, 0 rings for ever",
    },
    Field {
        name: "short_edges",
        dimension: Dimension::None,
        default: Default::Absent,
        range: (0.0, 0.5),
        help: "fraction of the springs, the shortest ones, that are softened to the stiffness of the longest among \
               them, so that a few slivers do not limit the time step; 0.05 with `stiffness`, 0 with \
               `spring_stiffness`",
    },
];

/// Share of the springs that is softened when the scene says nothing and the stiffness does not depend on the mesh.
const SHORT_EDGES: f64 = 0.05;

/// Reads which stiffness the settings give.
///
/// # Errors
/// Both or none of `stiffness` and `spring_stiffness` are written.
fn stiffness_setting(settings: &Settings) -> Result<Stiffness, String> {
    match (settings.optional("stiffness"), settings.optional("spring_stiffness")) {
        (Some(y), None) => Ok(Stiffness::Membrane(y)),
        (None, Some(e)) => Ok(Stiffness::Constant(e)),
        (Some(_), Some(_)) => Err("`stiffness` and `spring_stiffness` exclude each other".into()),
        (None, None) => Err("either `stiffness` (N/m) or `spring_stiffness` (N) is needed".into()),
    }
}

/// Springs of an effect.
pub(super) struct Springs<'a> {
    /// The effect.
    pub(super) name: &'a str,
    /// Function that finds them in a garment's mesh.
    pub(super) elements: fn(&TriangleMesh) -> Vec<SpringElement>,
    /// Whether their strain is that of the cloth.
    pub(super) is_cloth: bool,
    /// Curve by which they stiffen in tension, if they do.
    pub(super) curve: Option<TensileCurve>,
}

/// Makes the effect of these springs of a garment; the body of stretch and bending alike.
///
/// # Errors
/// The stiffness is given twice or not at all.
pub(super) fn build_effect(
    settings: &Settings,
    context: &BuildContext<'_>,
    springs: &Springs<'_>,
) -> Result<Effect, Problem> {
    let Springs { name, elements, is_cloth, curve } = *springs;
    let Some(garment) = context.garment else {
        return Err(Problem::scene(name, "this effect acts on one garment", "move its table under a [[garment]]"));
    };
    let parts = context.scene.parts();
    let first = parts.garment(garment).start;
    let is_own = |vertex: u32| parts.own().contains(&(first + vertex as usize));
    let mut elements = elements(&context.scene.meshes()[garment]);
    elements.retain(|element| element.vertices.into_iter().any(is_own));
    // Each spring counts at the rank that owns its first vertex.
    let counts = elements.iter().filter(|e| e.vertices.iter().min().is_some_and(|first| is_own(*first)));
    let lengths: Vec<f64> = counts.map(|e| e.rest_length).collect();
    let Stiffnesses { of_springs, shortest, notes } = stiffnesses_of(settings, context, name, &elements, &lengths)?;
    let springs = SpringNetwork {
        elements: &elements,
        stiffnesses: &of_springs,
        damping_ratios: &damping_ratios(settings, context, name, &elements),
        shortest,
        measures_strain: is_cloth,
        curve,
    };
    let (forces, bytes) = part_springs::build(context.scene, garment, &springs);
    Ok(Effect { forces, elements: lengths.len(), bytes, notes, ..Effect::default() })
}

/// Damping of each spring as a fraction of critical; where it is painted, the mean of its ends.
pub(super) fn damping_ratios(
    settings: &Settings,
    context: &BuildContext<'_>,
    name: &str,
    elements: &[SpringElement],
) -> Vec<f64> {
    let (map, of_garment) = (format!("{name}_damping"), settings.number("damping_ratio"));
    let painted = context.garment.and_then(|garment| context.scene.painted(garment, &map));
    elements.iter().map(|e| painted.map_or(of_garment, |map| map.mean(&e.vertices, of_garment))).collect()
}

/// The springs of a garment before they are sorted into parts.
pub(super) struct SpringNetwork<'a> {
    pub(super) elements: &'a [SpringElement],
    /// Stiffness of each [N/m].
    pub(super) stiffnesses: &'a [f64],
    /// Damping of each as a fraction of critical.
    pub(super) damping_ratios: &'a [f64],
    /// The length to which shorter ones are softened [m].
    pub(super) shortest: f64,
    /// Whether their strain is that of the cloth.
    pub(super) measures_strain: bool,
    /// Curve by which they stiffen in tension, if they do.
    pub(super) curve: Option<TensileCurve>,
}

/// Stiffnesses that the settings give some springs.
pub(super) struct Stiffnesses {
    /// Stiffness of each [N/m].
    pub(super) of_springs: Vec<f64>,
    /// The length to which shorter ones are softened [m].
    pub(super) shortest: f64,
    /// A note for the plan on those, if there are any.
    pub(super) notes: Vec<String>,
}

/// Stiffnesses as the settings say; `lengths` are those that count at this rank.
///
/// # Errors
/// The stiffness is given twice or not at all.
pub(super) fn stiffnesses_of(
    settings: &Settings,
    context: &BuildContext<'_>,
    name: &str,
    elements: &[SpringElement],
    lengths: &[f64],
) -> Result<Stiffnesses, Problem> {
    let stiffness = stiffness_setting(settings).map_err(|e| {
        let garments = &context.scene.description().garments;
        let place = context.garment.map_or_else(String::new, |g| format!("garment \"{}\", {name}", garments[g].name));
        Problem::scene(place, e, "give one of them")
    })?;
    let ranks = context.scene.parts().ranks();
    let painted = context.garment.and_then(|garment| context.scene.painted(garment, name));
    let default = if matches!(stiffness, Stiffness::Membrane(_)) { SHORT_EDGES } else { 0.0 };
    let softened = softened(lengths, settings.optional("short_edges").unwrap_or(default), ranks);
    Ok(Stiffnesses {
        of_springs: elements
            .iter()
            .map(|element| stiffness_of(element, stiffness, painted, softened.shortest))
            .collect(),
        shortest: softened.shortest,
        notes: softened.note().into_iter().collect(),
    })
}

/// The shortest springs, which are softened: a rest length that is clamped from below in the stiffness and in the rate of strain,
/// not in the length at rest (`docs/theory/step.md#springs`).
struct Softened {
    /// The length to which they are [m].
    shortest: f64,
    /// Number of shorter springs.
    count: u64,
}

impl Softened {
    fn note(&self) -> Option<String> {
        let Self { shortest, count } = self;
        (*count > 0).then(|| {
            format!(
                "{count} springs shorter than {:.3} mm are softened to that length, so that they do not set the time step",
                1e3 * shortest
            )
        })
    }
}

/// This share of the springs of all ranks, of which these lengths [m] count here.
fn softened(lengths: &[f64], share: f64, ranks: &Ranks) -> Softened {
    let [count] = ranks.sum_of([lengths.len() as u64]);
    let place = (share * count as f64) as u64;
    let shortest = if place > 0 && place < count { smallest_but(place, lengths, ranks) } else { 0.0 };
    let [count] = ranks.sum_of([lengths.iter().filter(|l| **l < shortest).count() as u64]);
    Softened { shortest, count }
}

/// Stiffness of a spring [N/m], with the mean of what is painted at its ends.
fn stiffness_of(element: &SpringElement, stiffness: Stiffness, painted: Option<&PaintedMap>, shortest: f64) -> f64 {
    let length = element.rest_length.max(shortest);
    let local = |of_garment: f64| painted.map_or(of_garment, |map| map.mean(&element.vertices, of_garment));
    match stiffness {
        Stiffness::Membrane(y) => local(y) * element.area / (length * length),
        Stiffness::Constant(e) => local(e) / length,
    }
}

/// Length at this place in the ascending order of all ranks' lengths [m].
pub(super) fn smallest_but(place: u64, lengths: &[f64], ranks: &Ranks) -> f64 {
    // Positive numbers are in the order of their bits; at most 64 halvings end at a single one.
    let (mut low, mut high) = (0, f64::INFINITY.to_bits());
    while low < high {
        let middle = low.midpoint(high);
        let [not_longer] = ranks.sum_of([lengths.iter().filter(|l| l.to_bits() <= middle).count() as u64]);
        if not_longer > place { high = middle } else { low = middle + 1 }
    }
    f64::from_bits(low)
}

/// Springs along the edges of a mesh.
pub(crate) fn along_edges(mesh: &TriangleMesh) -> Vec<SpringElement> {
    let elements = mesh.edges().iter().zip(mesh.edge_areas());
    elements.map(|(e, area)| SpringElement { vertices: e.vertices, rest_length: mesh.rest_length(*e), area }).collect()
}

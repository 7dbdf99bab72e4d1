//! Elastic bands sewn into a garment: springs along its edges with a rest length of their own, as at a waist, a cuff or a hem.
//!
//! ```toml
//! [[garment.elastic]]
//! where = { box = { min = [-1, 0.98, -1], max = [1, 1.02, 1] } }
//! stiffness = "30 N"                       # force of the band per unit strain
//! rest_scale = [[1001, 1.0], [1024, 0.7]]  # relaxed length over that in the rest shape
//! ```
//!
//! Every edge with both ends among the chosen vertices is a spring with the rest length `L = rest_scale · l₀`, where l₀ is the edge
//! in the rest shape of the garment, and with `F = stiffness (l / L − 1)`: a loop of edges pulls with this force, whatever its mesh.
//! Limits: the band has no mass of its own, and one that is several edges wide is as many bands side by side.

#![cfg(feature = "effects")]

use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, Need, Scope, Study};
use crate::effects::springs::{self, SpringElement, SpringNetwork};
use crate::error::Problem;
use crate::scene::{ElasticDescription, Scene};
use crate::settings::Settings;

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "elastic_bands",
    summary: "elastic bands along edges gather the cloth",
    scope: Scope::Implied,
    example: r#"[[garment.elastic]]
where = { box = { min = [-9, -9, -9], max = [9, 9, 9] } }
stiffness = "2 N""#,
    fields: &[],
    needs: &[Need::State],
    elements: "springs",
    study: Study { does_work: Some(|_| true), ..Study::INTERNAL },
    cost: Cost { update: 4.0, product: 1.0, ..Cost::NONE },
    build,
    ..EffectSpec::BARE
};

fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (scene, mut built) = (context.scene, Effect::default());
    for (number, band) in scene.description().elastics.iter().enumerate() {
        let elements = edges(scene, number, band);
        let [count, length] = own_count_and_length(scene, band.garment, &elements);
        if count == 0.0 {
            let place = format!("garment \"{}\", elastic {number}", scene.description().garments[band.garment].name);
            let what = "no edge of the cloth has both of its ends among the chosen vertices";
            return Err(Problem::scene(place, what, "choose neighbouring vertices, as those of a loop of edges"));
        }
        built.notes.push(format!(
            "elastic {number}: {count} edges, {:.4} m long in the rest shape, {:.4} m relaxed",
            length / band.rest_scale,
            length
        ));
        let network = SpringNetwork {
            elements: &elements,
            stiffnesses: &elements.iter().map(|e| band.stiffness / e.rest_length).collect::<Vec<_>>(),
            damping_ratios: &vec![band.damping_ratio; elements.len()],
            shortest: 0.0,
            measures_strain: false,
            curve: None,
        };
        let (forces, bytes) = springs::part_springs::build(scene, band.garment, &network);
        built.forces.extend(forces);
        built.elements += count as usize;
        built.bytes += bytes;
    }
    // Each rank has its share of the elements.
    built.elements = if scene.parts().ranks().is_first() { built.elements } else { 0 };
    Ok(built)
}

/// The edges of a band with an own vertex, of their relaxed lengths.
fn edges(scene: &Scene, number: usize, band: &ElasticDescription) -> Vec<SpringElement> {
    let (parts, mesh) = (scene.parts(), &scene.meshes()[band.garment]);
    let first = parts.garment(band.garment).start;
    let chosen = scene.painted(band.garment, &ElasticDescription::map(number));
    let is_chosen = |vertex: u32| chosen.is_some_and(|map| map.values[vertex as usize] > 0.0);
    let is_own = |vertex: u32| parts.own().contains(&(first + vertex as usize));
    // Lengths at rest do not follow those of a garment that shrinks.
    let at = |vertex: u32| mesh.modelled_positions()[vertex as usize];
    let edges = springs::along_edges(mesh).into_iter();
    edges
        .filter(|edge| edge.vertices.into_iter().all(is_chosen) && edge.vertices.into_iter().any(is_own))
        .map(|edge| {
            let [a, b] = edge.vertices;
            SpringElement { rest_length: band.rest_scale * (at(a) - at(b)).norm(), ..edge }
        })
        .collect()
}

/// Number of the edges of all ranks, and their length [m]; each counts where its first vertex is.
fn own_count_and_length(scene: &Scene, garment: usize, elements: &[SpringElement]) -> [f64; 2] {
    let parts = scene.parts();
    let first = parts.garment(garment).start;
    let (mut counts, mut lengths) = (vec![0.0; parts.count()], vec![0.0; parts.count()]);
    for element in elements {
        let vertex = first + element.vertices[0] as usize;
        if parts.own().contains(&vertex) {
            let part = parts.part_of(vertex);
            (counts[part], lengths[part]) = (counts[part] + 1.0, lengths[part] + element.rest_length);
        }
    }
    parts.join_parts(&[&counts, &lengths])
}

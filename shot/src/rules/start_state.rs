//! Rules about the start of the cloth: crossings there, vertices inside bodies, layers the other way round, and edges that are far from their length at rest.

use drapery_core::simulation::{Simulation, StartCrossings, StartInside, StartLayers, StartLengths};

use super::Finding;

pub(super) fn find_crossings(simulation: &Simulation) -> Vec<Finding> {
    let garments = &simulation.scene().description().garments;
    let lacks_layer = |object: &String| {
        garments.iter().any(|garment| garment.layer.is_none() && *object == format!("garment \"{}\"", garment.name))
    };
    let are_garments =
        |objects: &[String; 2]| objects[0] != objects[1] && objects.iter().all(|o| o.starts_with("garment"));
    let of_objects = |found: &StartCrossings| {
        let may_get_layers = are_garments(&found.objects) && found.objects.iter().any(lacks_layer);
        of_objects(found, may_get_layers)
    };
    simulation.start_crossings().iter().map(of_objects).collect()
}

fn of_objects(
    StartCrossings { objects: [edge_of, triangle_of], pairs, edge: [p, q], triangle: [a, b, c] }: &StartCrossings,
    may_get_layers: bool,
) -> Finding {
    let (object, other) = if edge_of == triangle_of {
        (edge_of.clone(), "itself".to_owned())
    } else if triangle_of.starts_with("garment") && edge_of.starts_with("body") {
        (triangle_of.clone(), edge_of.clone())
    } else {
        (edge_of.clone(), triangle_of.clone())
    };
    let where_to = if other == "itself" { "unfold it" } else { "move them apart" };
    let message = format!(
        "it intersects {other} at the start, in {pairs} pair{} of an edge and a triangle; the first is edge {p}-{q} of \
         {edge_of} and triangle {a}-{b}-{c} of {triangle_of}: {where_to} at the start, or start from a pose without \
         intersections{}",
        if *pairs == 1 { "" } else { "s" },
        if may_get_layers { "; or give both a `layer`, and they are drawn apart in that order" } else { "" },
    );
    let line = if may_get_layers {
        "layer = 1 at the inner garment and layer = 2 at the outer one".to_owned()
    } else {
        "start = \"file.abc@frame\" with such a pose".to_owned()
    };
    Finding { object, message, line }
}

pub(super) fn find_inside(simulation: &Simulation) -> Vec<Finding> {
    let of_garment = |found: &StartInside| {
        let StartInside { garment, body, vertices, deepest: (depth, vertex) } = found;
        Finding {
            object: format!("garment \"{garment}\", vertex {vertex}"),
            message: format!(
                "{vertices} of its vertices start inside body \"{body}\"; this one is deepest, at {:.2} mm. The body draws them \
                 out, which the first frames show: move the garment off the body, or start from a draped pose",
                1e3 * depth
            ),
            line: "start = \"file.abc@frame\" with such a pose".to_owned(),
        }
    };
    simulation.start_inside().iter().map(of_garment).collect()
}

pub(super) fn find_layers(simulation: &Simulation) -> Vec<Finding> {
    let of_pair = |StartLayers { outer, inner, right, wrong }: &StartLayers| Finding {
        object: format!("garment \"{outer}\""),
        message: format!(
            "its `layer` is larger than that of garment \"{inner}\", but {wrong} of the {} points where they are close lie on the \
             inside, by the normals of the faces: swap the layers, or flip the faces of the garment whose normals point inwards",
            right + wrong
        ),
        line: "the larger `layer` at the garment that is worn outside".to_owned(),
    };
    simulation.start_layers().iter().map(of_pair).collect()
}

pub(super) fn find_lengths(simulation: &Simulation) -> Vec<Finding> {
    simulation.start_lengths().iter().map(of_garment).collect()
}

fn of_garment(found: &StartLengths) -> Finding {
    let StartLengths { garment, edges, collapsed, stretched, longest } = found;
    let none = (*collapsed > 0).then(|| format!("{collapsed} have no length"));
    let long = longest.map(|(strain, [p, q])| {
        format!("{stretched} are too long, edge {p}-{q} {:.1} times as long as at rest", 1.0 + strain)
    });
    let what: Vec<String> = none.into_iter().chain(long).collect();
    Finding {
        object: format!("garment \"{garment}\""),
        message: format!(
            "{edges} edges, of which {} at the start: check its `start`, the unit of that file, `jitter`, and the \
             positions that pins give to vertices",
            what.join(", and ")
        ),
        line: "start = \"file.abc@frame\" of the same mesh, or leave it out".to_owned(),
    }
}

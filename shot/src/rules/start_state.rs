//! Rules about the start of the cloth: crossings there, and edges that are far from their length at rest.

use drapery_core::simulation::{Simulation, StartCrossings, StartLengths};

use super::Finding;

pub(super) fn find_crossings(simulation: &Simulation) -> Vec<Finding> {
    simulation.start_crossings().iter().map(of_objects).collect()
}

fn of_objects(
    StartCrossings { objects: [edge_of, triangle_of], pairs, edge: [p, q], triangle: [a, b, c] }: &StartCrossings,
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
         intersections",
        if *pairs == 1 { "" } else { "s" }
    );
    let line = "start = \"file.abc@frame\" with such a pose".to_owned();
    Finding { object, message, line }
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

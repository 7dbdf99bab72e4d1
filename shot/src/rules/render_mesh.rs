//! Render meshes that are bound to their garment as nobody means it.

use super::Finding;
use crate::render_mesh::JudgedBinding;

/// Points that stand far from the cloth.
pub(super) fn find_distance(bindings: &[JudgedBinding]) -> Vec<Finding> {
    let found = |binding: &JudgedBinding| {
        let JudgedBinding { far, points, max_distance, .. } = binding;
        let (worst, distance) = binding.farthest?;
        let message = format!(
            "{far} of {points} points are farther than {} from the cloth at rest, which they follow loosely; the \
             farthest is point {worst}, {} away: model the mesh at the rest shape, or check its units; if it is meant \
             to stand off, raise `max_distance`",
            millimetres(*max_distance),
            millimetres(distance),
        );
        let (message, line) = match binding.unit {
            Some((unit, up)) => {
                let size =
                    format!("in {} it would have the size of the garment: its unit is probably wrong", unit.plural());
                let line =
                    format!("units = {{ length = \"{}\", up = \"{up:?}\" }} in [garment.render_mesh]", unit.word());
                (format!("{message}; {size}"), line)
            }
            None => (message, format!("max_distance = \"{} mm\" in [garment.render_mesh]", (distance * 1e3).ceil())),
        };
        Some(Finding { object: binding.object.clone(), message, line })
    };
    bindings.iter().filter_map(found).collect()
}

/// Edges between layers of the cloth.
pub(super) fn find_layers(bindings: &[JudgedBinding]) -> Vec<Finding> {
    let found = |binding: &JudgedBinding| {
        let [a, b] = *binding.torn.first()?;
        let message = format!(
            "{} of its edges join points that are bound to different layers of the cloth, the first joins the points \
             {a} and {b}; they are stretched where the layers part: move these points closer to the layer that they \
             belong to",
            binding.torn.len()
        );
        Some(Finding { object: binding.object.clone(), message, line: String::new() })
    };
    bindings.iter().filter_map(found).collect()
}

/// Faces that look to the wrong side.
pub(super) fn find_flipped(bindings: &[JudgedBinding]) -> Vec<Finding> {
    let what = "it is flipped: its faces point the opposite way to the faces of the cloth; reverse one of the two";
    let found = |binding: &JudgedBinding| Finding {
        object: binding.object.clone(),
        message: what.to_owned(),
        line: String::new(),
    };
    bindings.iter().filter(|binding| binding.is_flipped).map(found).collect()
}

fn millimetres(metres: f64) -> String {
    format!("{:.1} mm", metres * 1e3)
}

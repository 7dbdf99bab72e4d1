//! Triangles of analytic bodies with sharp edges, for the edges and faces of cloth.

use crate::contact::bodies::collision;
use crate::effects::registry;
use crate::effects::spec::Need;
use crate::geometry::shape_mesh::ShapeMesh;
use crate::scene::{BodyDescription, BodyShape, ContactSide, SceneDescription};

/// The triangles of each analytic body that edges and faces of cloth meet; none in scenes in which pairs do not touch. They are those
/// of the start, whatever thickness a curve gives the body later.
pub(crate) fn shape_meshes(description: &SceneDescription) -> Vec<Option<ShapeMesh>> {
    let has = |holds: &dyn Fn(&str) -> bool| description.effects.iter().any(|request| holds(&request.effect));
    let touches = has(&|effect| effect == collision::EFFECT);
    let in_pairs = has(&|effect| registry::find(effect).is_some_and(|spec| spec.needs.contains(&Need::PairList)));
    if !(touches && in_pairs) {
        return vec![None; description.bodies.len()];
    }
    let of_body = |(number, body): (usize, &BodyDescription)| {
        let BodyShape::Rigid(shape) = &body.shape else { return None };
        shape.mesh(smallest_thickness(description, number))
    };
    description.bodies.iter().enumerate().map(of_body).collect()
}

/// Smallest distance that any vertex keeps from a body, by its own thickness and by rules of contact [m].
fn smallest_thickness(description: &SceneDescription, body: usize) -> f64 {
    let rules = description.contacts.iter().filter(|rule| rule.between.contains(&ContactSide::Body(body)));
    rules.filter_map(|rule| rule.thickness).fold(description.bodies[body].thickness, f64::min)
}

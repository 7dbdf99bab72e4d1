//! Triangles of analytic bodies, where edges or faces of cloth can cut into them.

use crate::contact::bodies::collision;
use crate::effects::registry;
use crate::effects::spec::Need;
use crate::geometry::shape_mesh::ShapeMesh;
use crate::scene::{BodyDescription, BodyShape, ContactSide, Scene, SceneDescription};

/// Share of a body's thickness that a face of cloth may cut into by the distances of its corners alone.
const CUT: f64 = 1.0 / 3.0;

/// Factor on the longest edge at rest, for cloth that stretches.
const STRETCH: f64 = 1.2;

/// The triangles of each analytic body that edges and faces of cloth have to meet: those with sharp edges, and round ones that the
/// faces of the cloth cut deeper into than its vertices keep away from them. None in scenes in which pairs do not touch.
/// They are those of the start, whatever thickness a curve gives the body later. All ranks call it together.
pub(crate) fn shape_meshes(scene: &Scene) -> Vec<Option<ShapeMesh>> {
    let description = scene.description();
    let has = |holds: &dyn Fn(&str) -> bool| description.effects.iter().any(|request| holds(&request.effect));
    let touches = has(&|effect| effect == collision::SECTION.name);
    let in_pairs = has(&|effect| registry::find(effect).is_some_and(|spec| spec.needs.contains(&Need::PairList)));
    let is_rigid = |shape: &BodyShape| matches!(shape, BodyShape::Rigid(_));
    if !(touches && in_pairs && description.bodies.iter().any(|body| is_rigid(&body.shape))) {
        return vec![None; description.bodies.len()];
    }
    let edge = longest_edge(scene);
    let of_body = |(number, body): (usize, &BodyDescription)| {
        let BodyShape::Rigid(shape) = &body.shape else { return None };
        let thickness = smallest_thickness(description, number);
        let cut = shape.cut(STRETCH * edge, thickness);
        let is_needed = cut > CUT * thickness && cut > shape.finest_sagitta();
        is_needed.then(|| shape.mesh(thickness)).flatten()
    };
    description.bodies.iter().enumerate().map(of_body).collect()
}

/// Smallest distance that any vertex keeps from a body, by its own thickness and by rules of contact [m].
fn smallest_thickness(description: &SceneDescription, body: usize) -> f64 {
    let rules = description.contacts.iter().filter(|rule| rule.between.contains(&ContactSide::Body(body)));
    rules.filter_map(|rule| rule.thickness).fold(description.bodies[body].thickness, f64::min)
}

/// Longest rest edge of all garments [m].
fn longest_edge(scene: &Scene) -> f64 {
    let lengths = scene.meshes().iter().flat_map(|mesh| mesh.edges().iter().map(|edge| mesh.rest_length(*edge)));
    scene.parts().ranks().max(lengths.fold(0.0, f64::max))
}

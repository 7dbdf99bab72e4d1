//! The faces that caches hold, in whatever triangles a renderer cuts them: whether cloth meets cloth or a body along a diagonal that
//! the solver did not take. Looked at by rank 0, which has the positions of a garment at hand when it writes them.

use drapery_core::Vec3;
use drapery_core::effects::{body_collision, self_collision};
use drapery_core::geometry::crossings::Crossing;
use drapery_core::geometry::face_cuts::FaceSearch;
use drapery_core::scene::{BodyShape, ContactSide};
use drapery_core::simulation::Simulation;
use drapery_io::error::IoError;
use drapery_io::garment_mesh::{GarmentMesh, triangles_of};
use drapery_io::units::Units;
use serde_json::{Value, json};

use crate::inputs::Inputs;

/// Two objects that cross along another diagonal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct OtherCut {
    /// The garment.
    pub(crate) garment: String,
    /// The other garment, or itself, or the body.
    pub(crate) other: String,
    /// Whether that is a body.
    pub(crate) is_body: bool,
    /// Number of crossings.
    pub(crate) count: usize,
    /// The first one, in words.
    first: String,
}

impl OtherCut {
    /// Describes the objects that cross, and the place.
    pub(crate) fn in_words(&self) -> String {
        let Self { garment, other, is_body, count, first } = self;
        let with = match (is_body, garment == other) {
            (true, _) => format!("body \"{other}\""),
            (false, true) => "itself".to_owned(),
            (false, false) => format!("garment \"{other}\""),
        };
        format!(
            "garment \"{garment}\" intersects {with} {count} times where faces are cut along the other diagonal, as renderers \
             may cut them; first: {first}"
        )
    }

    /// Returns the remedy to write in the scene.
    pub(crate) fn line(&self) -> &'static str {
        match self.is_body {
            true => "a larger `thickness` at the body",
            false => "faces = \"triangles\" under [output]",
        }
    }

    pub(crate) fn to_json(&self) -> Value {
        let Self { garment, other, is_body, count, first } = self;
        let other = if *is_body { json!({"body": other}) } else { json!({"garment": other}) };
        json!({"garment": garment, "with": other, "count": count, "first": first})
    }
}

/// Something with faces.
struct Object {
    name: String,
    search: FaceSearch,
}

/// The faces that are written, and those of the bodies.
pub(crate) struct WrittenFaces {
    garments: Vec<Object>,
    /// Bodies that are meshes, with their numbers.
    bodies: Vec<(usize, Object)>,
    /// Whether cloth keeps free of cloth.
    cloth: bool,
    units: Units,
    origin: Vec3,
}

impl WrittenFaces {
    /// The faces of garments as they are written in these units, and of bodies; `None` where nothing can be cut otherwise, or may cross anyway.
    ///
    /// # Errors
    /// A mesh can no longer be read.
    pub(crate) fn of(
        written: &[GarmentMesh],
        inputs: &Inputs,
        simulation: &Simulation,
        units: Units,
    ) -> Result<Option<Self>, IoError> {
        let scene = simulation.scene().description();
        let cloth = scene.effects.iter().any(|request| request.effect == self_collision::SPEC.name);
        let collides = scene.effects.iter().any(|request| request.effect == body_collision::SPEC.name);
        if !collides && !cloth {
            return Ok(None);
        }
        let mut garments = Vec::new();
        for (garment, mesh) in scene.garments.iter().zip(written) {
            let data = mesh.read()?;
            let faces = (data.mesh.face_counts.as_slice(), data.mesh.face_indices.as_slice());
            let search = FaceSearch::new(faces, triangles_of(&data), data.mesh.points.clone());
            garments.push(Object { name: garment.name.clone(), search });
        }
        let mut bodies = Vec::new();
        let described = scene.bodies.iter().zip(&inputs.bodies).enumerate();
        for (number, (body, motion)) in described.filter(|_| collides) {
            let (BodyShape::Surface { triangles, .. }, Some(motion)) = (&body.shape, motion) else { continue };
            let mesh = motion.source.mesh_at(inputs.timeline.file_time(inputs.timeline.origin))?.mesh;
            let faces = (mesh.face_counts.as_slice(), mesh.face_indices.as_slice());
            let search = FaceSearch::new(faces, triangles.clone(), mesh.points.clone());
            bodies.push((number, Object { name: body.name.clone(), search }));
        }
        let all = garments.iter().chain(bodies.iter().map(|(_, object)| object));
        let any = all.into_iter().any(|object| object.search.has_other_cuts());
        let origin = simulation.scene().origin();
        Ok(any.then_some(Self { garments, bodies, cloth, units, origin }))
    }

    /// Takes the positions of a garment as they are stored.
    pub(crate) fn place(&mut self, garment: usize, stored: &[[f32; 3]]) {
        self.garments[garment].search.place(stored.iter().map(|p| Vec3::from(p.map(f64::from))));
    }

    /// Finds crossings along another diagonal than the solver's: garments at their places, bodies where they stand
    /// now.
    pub(crate) fn find(&mut self, simulation: &Simulation) -> Vec<OtherCut> {
        let (units, origin) = (self.units, self.origin);
        for (number, body) in &mut self.bodies {
            let positions = simulation.bodies().contact_positions(*number);
            body.search.place(positions.iter().map(|x| units.from_si(x - origin)));
        }
        let scene = simulation.scene().description();
        let mut found = Vec::new();
        for (index, garment) in self.garments.iter().enumerate() {
            let ignores = |other| scene.ignores_in_part(ContactSide::Garment(index), other);
            if self.cloth && garment.search.has_other_cuts() && !ignores(ContactSide::Garment(index)) {
                found.extend(other_cut((garment, garment), false, [garment.search.find().other, Vec::new()]));
            }
            let others = self.garments.iter().enumerate().skip(index + 1).filter(|_| self.cloth);
            let others = others.map(|(number, other)| (ContactSide::Garment(number), other));
            let bodies = self.bodies.iter().map(|(number, body)| (ContactSide::Body(*number), body));
            for (side, other) in others.chain(bodies).filter(|(side, _)| !ignores(*side)) {
                let is_body = matches!(side, ContactSide::Body(_));
                let [a, b] = [&garment.search, &other.search];
                if a.has_other_cuts() || b.has_other_cuts() {
                    let both = [a.find_through(b).other, b.find_through(a).other];
                    found.extend(other_cut((garment, other), is_body, both));
                }
            }
        }
        found
    }
}

/// Describes crossings of edges of the first with triangles of the second, and the other way round.
fn other_cut((one, other): (&Object, &Object), is_body: bool, lists: [Vec<Crossing>; 2]) -> Option<OtherCut> {
    let [through, back] = &lists;
    let first = match (through.first(), back.first()) {
        (Some(crossing), _) => in_words(crossing, [one, other]),
        (None, Some(crossing)) => in_words(crossing, [other, one]),
        (None, None) => return None,
    };
    let (garment, count) = (one.name.clone(), through.len() + back.len());
    Some(OtherCut { garment, other: other.name.clone(), is_body, count, first })
}

fn in_words(crossing: &Crossing, [edge_of, triangle_of]: [&Object; 2]) -> String {
    let Crossing { edge: [p, q], triangle: [a, b, c] } = *crossing;
    let face = |face: Option<u32>| face.map_or_else(String::new, |face| format!(" (face {face})"));
    let one = face(edge_of.search.face_of_edge(crossing.edge));
    let other = face(triangle_of.search.face_of_triangle(crossing.triangle));
    format!("edge {p}-{q}{one} of {} through triangle {a}-{b}-{c}{other} of {}", edge_of.name, triangle_of.name)
}

//! Meshes whose elements lack the neighbours that usual cloth has, under all effects at once: they are simulated, to the same
//! bits on any number of ranks.

use drapery_core::Vec3;
use drapery_core::effects::{REGISTRY, Scope};
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::vertex_maps::PaintedMap;
use drapery_core::scene::{
    BodyShape, EffectRequest, GarmentDescription, Integrator, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, SceneDescription, SeamDescription,
};
use drapery_tests::*;

use crate::bits::{Shot, no_input};

/// Points and faces, in units of 10 cm, within a square of two units in the plane.
type Piece = (&'static str, &'static [[f64; 3]], &'static [&'static [u32]]);

const PIECES: [Piece; 12] = [
    ("button", &[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], &[&[0, 1, 2]]),
    ("pair", &[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.1, 1.0]], &[&[0, 1, 2], &[1, 3, 2]]),
    (
        "bow_tie",
        &[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.8, 0.0, 0.5], [1.6, 0.0, 0.0], [1.6, 0.0, 1.0]],
        &[&[0, 1, 2], &[2, 4, 3]],
    ),
    (
        "two_pieces",
        &[
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.8, 0.0, 0.0],
            [0.8, 0.0, 1.0],
            [1.2, 0.0, 0.0],
            [1.2, 0.0, 1.0],
            [1.8, 0.0, 0.0],
        ],
        &[&[0, 1, 3, 2], &[4, 5, 6]],
    ),
    (
        "loose_vertices",
        &[[1.5, 0.0, 1.5], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.8, 0.2, 0.0]],
        &[&[1, 2, 3]],
    ),
    (
        "book",
        &[[0.9, 0.0, 0.0], [0.9, 0.0, 1.0], [0.0, 0.0, 0.5], [1.8, 0.0, 0.5], [0.9, 0.9, 0.5], [0.2, 0.6, 0.5]],
        &[&[0, 1, 2], &[1, 0, 3], &[0, 1, 4], &[0, 1, 5]],
    ),
    ("line", &[[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]], &[&[0, 1, 2]]),
    ("no_faces", &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], &[]),
    (
        "fan",
        &[[0.9, 0.3, 0.9], [0.0, 0.0, 0.9], [0.4, 0.0, 1.7], [1.4, 0.0, 1.7], [1.8, 0.0, 0.9], [0.9, 0.0, 0.0]],
        &[&[0, 1, 2], &[0, 2, 3], &[0, 3, 4], &[0, 4, 5], &[0, 5, 1]],
    ),
    ("flat_fold", &[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.5], [0.7, 0.0, 0.2]], &[&[0, 1, 2], &[1, 0, 3]]),
    (
        "tetrahedron",
        &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 1.0], [0.5, 0.8, 0.4]],
        &[&[0, 1, 2], &[0, 3, 1], &[1, 3, 2], &[2, 3, 0]],
    ),
    (
        "dented",
        &[[0.0, 0.0, 0.0], [0.9, 0.0, 0.7], [1.8, 0.0, 0.0], [1.8, 0.0, 1.8], [0.9, 0.0, 0.8], [0.0, 0.0, 1.8]],
        &[&[5, 4, 3, 2, 1, 0]],
    ),
];

/// The piece shifted by so much [m].
fn mesh((_, points, faces): &Piece, shift: Vec3) -> PolygonMesh {
    PolygonMesh {
        points: points.iter().map(|p| Vec3::from(*p) * 0.1 + shift).collect(),
        face_counts: faces.iter().map(|face| face.len() as u32).collect(),
        face_indices: faces.concat(),
    }
}

/// Pieces of all kinds side by side in one mesh.
fn heap(count: usize) -> PolygonMesh {
    let mut all = PolygonMesh::default();
    for number in 0..count {
        let shift = Vec3::new((number % 30) as f64, 3.0, (number / 30) as f64) * 0.21;
        let piece = mesh(&PIECES[number % PIECES.len()], shift);
        let first = all.points.len() as u32;
        all.points.extend(piece.points);
        all.face_counts.extend(piece.face_counts);
        all.face_indices.extend(piece.face_indices.iter().map(|corner| corner + first));
    }
    all
}

/// Adds a garment with all effects that garments can have but these, held by a hard pin and by one that breaks.
fn add_garment(description: &mut SceneDescription, name: &str, mesh: PolygonMesh, without: &[&str]) {
    let (garment, points) = (description.garments.len(), mesh.points.len());
    let mut cloth = GarmentDescription { thickness: 0.002, ..GarmentDescription::new(name, mesh, 0.2) };
    for map in ["density", "thickness", "dihedral_bending", "stretch"].into_iter().filter(|map| !without.contains(map))
    {
        let values = (0..points).map(|v| 1.0 + 0.1 * (v % 7) as f64).collect();
        cloth.maps.insert(map.into(), PaintedMap { values, absolute: false });
    }
    description.garments.push(cloth);
    let required = [
        ("stretch", "stiffness", 50.0),
        ("shear", "stiffness", 10.0),
        ("membrane", "warp", 50.0),
        ("bending", "stiffness", 0.5),
        ("dihedral_bending", "stiffness", 1e-5),
        ("plastic_wrinkles", "yield_radius", 0.2),
        ("pressure", "overpressure", 2.0),
        ("strain_limit", "limit", 0.1),
    ];
    let of_garments = REGISTRY.iter().filter(|spec| spec.scope == Scope::Garment).map(|spec| spec.name);
    assert_eq!(of_garments.collect::<Vec<_>>(), required.map(|(effect, ..)| effect), "each garment has all of them");
    for (effect, setting, value) in required.into_iter().filter(|(effect, ..)| !without.contains(effect)) {
        let request = EffectRequest::of_garment(effect, garment).with(setting, value);
        let is_open = effect == "pressure";
        description.effects.push(if is_open { request.with_flag("open", true) } else { request });
    }
    for (vertex, hold) in
        [(0, PinHold::Hard), (1, PinHold::Spring { stiffness: 20.0, damping_ratio: 1.0, break_force: Some(0.05) })]
    {
        let target = PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![vertex], offsets: Vec::new() };
        let (from, until) = (f64::NEG_INFINITY, f64::INFINITY);
        description.pins.push(PinDescription { garment, target, axes: [true; 3], from, until, hold });
    }
}

/// Pieces side by side, a heap of them above that is shared among parts, and everything that a whole scene can have but these
/// effects.
fn everything(without: &[&str]) -> SceneDescription {
    let mut description = SceneDescription::new("odd");
    description.timeline.fps_numerator = 120;
    for (number, piece) in PIECES.iter().enumerate() {
        add_garment(&mut description, piece.0, mesh(piece, Vec3::x() * (0.21 * number as f64)), without);
    }
    add_garment(&mut description, "heap", heap(600), without);
    // Two vertices of one triangle, and a piece with itself.
    for (garments, pairs) in [([0, 0], vec![[1, 2]]), ([3, 3], vec![[2, 4], [3, 5]])] {
        description.seams.push(SeamDescription { until: 0.01, ..SeamDescription::new(garments, pairs, 20.0) });
    }
    for effect in ["seams", "attachments", "pins", "self_repulsion", "self_collision"] {
        description.effects.push(EffectRequest::of_scene(effect));
    }
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    let wind = EffectRequest::of_scene("wind").with("density", 1.2).with("normal", 0.5);
    description.effects.push(wind.with_vector("velocity", [0.0, 3.0, 1.0]));
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 2.0));
    add_body(
        &mut description,
        BodyShape::Rigid(Shape::Sphere { radius: 0.1 }),
        RigidMotion::at(Vec3::y() * -0.11),
        0.4,
    );
    description
}

#[test]
fn pieces_without_neighbours_are_simulated_as_a_membrane_with_angles_to_the_same_bits() {
    let description = everything(&["stretch", "shear", "bending"]);
    Shot { description, input: no_input, frames: 4 }.has_the_same_bits_everywhere();
}

#[test]
fn pieces_without_neighbours_are_simulated_in_implicit_steps_to_the_same_bits() {
    for effects in [["stretch", "shear", "bending"], ["membrane", "dihedral_bending", "plastic_wrinkles"]] {
        let mut description = everything(&effects);
        description.solver.integrator = Integrator::TrBdf2;
        Shot { description, input: no_input, frames: 4 }.has_the_same_bits_everywhere();
    }
}

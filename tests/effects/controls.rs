//! For every effect a small scene in which it has something to do.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyShape, EffectRequest, ElasticDescription, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, SceneDescription, SeamDescription,
};
use drapery_tests::{add_body, add_gravity, add_pins, scene_of, sheet, unit_ball};

/// Makes the scene of an effect.
type Control = fn() -> SceneDescription;

/// In the order of the registry.
pub(crate) const CONTROLS: &[(&str, Control)] = &[
    ("gravity", hanging),
    ("stretch", hanging),
    ("shear", sheared),
    ("membrane", measured_cloth),
    ("bending", hanging),
    ("dihedral_bending", creased),
    ("plastic_wrinkles", creased),
    ("elastic_bands", gathered),
    ("wind", in_the_wind),
    ("ether_drag", in_a_medium),
    ("pressure", blown_up),
    ("seams", sewn),
    ("attachments", held_by_springs),
    ("pins", hanging),
    ("strain_limit", limited),
    ("body_collision", on_a_ball),
    ("self_repulsion", sheet_on_sheet),
    ("self_collision", sheet_through_sheet),
];

/// A small sheet, free and at rest, with springs.
fn cloth() -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(6, 6, 0.05), 0.2), 24);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
    description
}

/// It hangs from two corners, and resists folding.
fn hanging() -> SceneDescription {
    let mut description = cloth();
    description.effects.push(EffectRequest::of_garment("bending", 0).with("stiffness", 5.0));
    add_pins(&mut description, vec![0, 6]);
    description
}

/// Two corners hang on springs, of which one breaks.
fn held_by_springs() -> SceneDescription {
    let mut description = cloth();
    for (vertex, break_force) in [(0, None), (6, Some(0.01))] {
        description.pins.push(PinDescription {
            garment: 0,
            target: PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![vertex], offsets: Vec::new() },
            axes: [true; 3],
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            hold: PinHold::Spring { stiffness: 50.0, damping_ratio: 1.0, break_force },
        });
    }
    description.effects.push(EffectRequest::of_scene("attachments"));
    description
}

/// It falls on a ball just below.
fn on_a_ball() -> SceneDescription {
    let mut description = cloth();
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
    add_body(&mut description, ball, RigidMotion::at(Vec3::new(0.0, -0.11, 0.0)), 0.4);
    description
}

/// It falls on a second one that is pinned along its rim.
fn sheet_on_sheet() -> SceneDescription {
    let mut description = cloth();
    let mut below = sheet(6, 6, 0.05);
    below.points.iter_mut().for_each(|p| *p += Vec3::new(0.01, -0.02, 0.013));
    description.garments.push(GarmentDescription::new("below", below, 0.2));
    description.garments.iter_mut().for_each(|garment| garment.thickness = 0.004);
    description.effects.push(EffectRequest::of_garment("stretch", 1).with("stiffness", 100.0));
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    description.effects.push(EffectRequest::of_scene("self_collision"));
    let rim = (0..49).filter(|v| v % 7 == 0 || v % 7 == 6 || v / 7 == 0 || v / 7 == 6);
    add_pins(&mut description, rim.collect());
    description.pins[0].garment = 1;
    description
}

/// It hits the second one so fast that it would be on the other side after one step, and nothing repels it before.
fn sheet_through_sheet() -> SceneDescription {
    let mut description = sheet_on_sheet();
    description.effects.retain(|request| request.effect != "self_repulsion");
    description.garments[0].velocity = Vec3::new(0.0, -5.0, 0.0);
    description
}

/// The hanging sheet with one more effect.
fn hanging_with(request: EffectRequest) -> SceneDescription {
    let mut description = hanging();
    description.effects.push(request);
    description
}

fn sheared() -> SceneDescription {
    hanging_with(EffectRequest::of_garment("shear", 0).with("stiffness", 20.0))
}

fn measured_cloth() -> SceneDescription {
    let mut description = hanging_with(EffectRequest::of_garment("membrane", 0).with("warp", 100.0));
    description.effects.retain(|request| request.effect != "stretch");
    description
}

/// Folded by a right angle, with hinges that yield beyond a gentle bend.
fn creased() -> SceneDescription {
    let mut description = cloth();
    let flat = description.garments[0].mesh.points.clone();
    let folded = flat.iter().map(|p| if p.x > 0.0 { Vec3::new(0.0, p.x, p.z) } else { *p });
    description.garments[0].start = Some(folded.collect());
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", 1e-5));
    description.effects.push(EffectRequest::of_garment("plastic_wrinkles", 0).with("yield_radius", 0.2));
    description
}

fn in_the_wind() -> SceneDescription {
    hanging_with(EffectRequest::of_scene("wind").with("density", 1.2).with_vector("velocity", [0.0, 3.0, 1.0]))
}

fn in_a_medium() -> SceneDescription {
    hanging_with(EffectRequest::of_scene("ether_drag").with("rate", 2.0))
}

/// A closed ball of cloth.
fn blown_up() -> SceneDescription {
    let (triangles, points) = unit_ball(6, 8);
    let points = points.into_iter().map(|p| p * 0.1).collect();
    let mesh = PolygonMesh::from_triangles(points, &triangles);
    let mut description = scene_of(GarmentDescription::new("ball", mesh, 0.2), 24);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
    description.effects.push(EffectRequest::of_garment("pressure", 0).with("overpressure", 50.0));
    description
}

/// An elastic band gathers the lower edge of the hanging sheet.
fn gathered() -> SceneDescription {
    let mut description = hanging_with(EffectRequest::of_scene("elastic_bands"));
    let band = ElasticDescription::new(0, (42..49).collect(), 5.0);
    description.elastics.push(ElasticDescription { rest_scale: 0.6, ..band });
    description
}

/// Two corners of the hanging sheet are drawn together.
fn sewn() -> SceneDescription {
    let mut description = hanging_with(EffectRequest::of_scene("seams"));
    description.seams.push(SeamDescription {
        until: 0.2,
        rest_gap: Some(0.0),
        break_force: Some(0.05),
        ..SeamDescription::new([0, 0], vec![[42, 48]], 50.0)
    });
    description
}

/// It hangs on springs that are too weak for it.
fn limited() -> SceneDescription {
    let mut description = hanging_with(EffectRequest::of_garment("strain_limit", 0).with("limit", 0.02));
    let stretch = description.effects.iter_mut().find(|request| request.effect == "stretch");
    *stretch.expect("the sheet has springs") = EffectRequest::of_garment("stretch", 0).with("stiffness", 2.0);
    description
}

//! A scene description as bytes, without the arrays of its garments and pins: what every rank has to know.

use std::sync::Arc;

use nalgebra::{Quaternion, UnitQuaternion};

use crate::geometry::attachment::SurfaceAttachment;
use crate::geometry::shapes::Shape;
use crate::mesh::{MeshStream, PolygonMesh};
use crate::parallel::message::{Codec, Decoder, codec};
use crate::scene::seam_pairs::{Sewn, SewnTo};
use crate::scene::vertex_maps::PaintedMap;
use crate::scene::{
    BodyDescription, BodyShape, ContactRule, ContactSide, EffectRequest, ElasticDescription, FacePoint,
    GarmentDescription, Integrator, Mass, MergedVertex, PinAnchor, PinDescription, PinHold, PinTarget, Pinned,
    RigidMotion, SceneDescription, SeamDescription, Timeline, WindGridShape,
};
use crate::settings::SettingValue;

codec!(struct Timeline { fps_numerator, fps_denominator, origin, start });
codec!(enum Integrator { 0 => SemiImplicit, 1 => TrBdf2, 2 => Auto });
codec!(enum Mass { 0 => Density(value), 1 => UniformTotal(value) });
codec!(struct PolygonMesh { points, face_counts, face_indices });
codec!(struct GarmentDescription { name, mesh, stream, start, velocity, start_velocities, mass, thickness, rest_scale, layer, parts, maps, map_curves });
codec!(struct PaintedMap { values, absolute });
codec!(struct ElasticDescription { garment, vertices, stiffness, rest_scale, damping_ratio });
codec!(enum Shape {
    0 => HalfSpace,
    1 => Sphere { radius },
    2 => Capsule { radius, half_length },
    3 => Cylinder { radius, half_length },
    4 => Box { half_extents },
});
codec!(enum BodyShape { 0 => Rigid(shape), 1 => Surface { triangles, point_count } });
codec!(struct RigidMotion { path, rotation, angular_velocity, spin_start });
codec!(struct BodyDescription { name, shape, motion, friction, thickness, max_push_speed, faces_inwards });
codec!(enum PinAnchor { 0 => Start, 1 => WhenHeld });
codec!(enum PinHold { 0 => Hard, 1 => Spring { stiffness, damping_ratio, break_force } });
codec!(struct SurfaceAttachment { vertex, body_points, weights, offset });
codec!(enum PinTarget {
    0 => Path { anchor, vertices, offsets },
    1 => Track { vertices, track },
    2 => Body { body, attachments },
    3 => BodyNearest { body, vertices },
});
codec!(struct PinDescription { garment, target, axes, from, until, hold });
codec!(enum SettingValue { 0 => Number(value), 1 => Text(value), 2 => Vector(value), 3 => Flag(value), 4 => Keys(keys) });
codec!(struct EffectRequest { effect, garment, settings, sources, because });
codec!(struct SeamDescription { garments, pairs, faces, keeps_gap, from, until, opens, opened, zip, rest_gap, stiffness, damping_ratio, break_force });
codec!(enum ContactSide { 0 => Garment(garment), 1 => Body(body), 2 => Part(garment, part) });
codec!(struct ContactRule { between, ignore, friction, thickness });
codec!(struct WindGridShape { origin, spacing, counts });
codec!(struct SceneDescription { name, timeline, origin, solver, garments, bodies, pins, elastics, seams, contacts, curves, wind, effects, left_out });
codec!(struct Pinned { number, pin, row, vertex, attachment });
codec!(struct MergedVertex { vertex, leader, offset });
codec!(enum SewnTo { 0 => Vertex(vertex), 1 => Face { corners, weights } });
codec!(struct Sewn { number, seam, vertex, to, gap, share });
codec!(struct FacePoint { vertex, corners, weights });

/// Only rank 0 reads.
impl Codec for Option<Arc<dyn MeshStream>> {
    fn put(&self, _: &mut Vec<u8>) {}

    fn take(_: &mut Decoder<'_>) -> Self {
        None
    }
}

impl Codec for UnitQuaternion<f64> {
    fn put(&self, out: &mut Vec<u8>) {
        <[f64; 4]>::from(self.coords).put(out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        // As it was, to the last bit: it was of unit length.
        Self::new_unchecked(Quaternion::from_vector(<[f64; 4]>::take(message).into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::parallel::message::decode;

    #[test]
    fn a_description_comes_back_as_it_was() {
        let mut description = SceneDescription::new("wired");
        description.timeline.start = -12;
        description.origin = Some(Vec3::new(1e5, 0.0, -3.0));
        description.solver.max_dt = Some(0.01);
        description.solver.integrator = Integrator::TrBdf2;
        let mesh = PolygonMesh::from_triangles(vec![Vec3::x(), Vec3::y(), Vec3::z()], &[[0, 1, 2]]);
        let mut garment = GarmentDescription::new("flag", mesh, 0.2);
        garment.start_velocities = Some(vec![Vec3::x(); 3]);
        garment.mass = Mass::UniformTotal(0.3);
        description.garments.push(garment);
        let shapes = [Shape::HalfSpace, Shape::Sphere { radius: 0.1 }, Shape::Box { half_extents: [0.1, 0.2, 0.3] }];
        for shape in shapes {
            let mut motion = RigidMotion::at(Vec3::x());
            motion.rotation = UnitQuaternion::from_scaled_axis(Vec3::new(0.1, 0.7, -0.3));
            description.bodies.push(BodyDescription::new("b", BodyShape::Rigid(shape), motion));
        }
        let shape = BodyShape::Surface { triangles: vec![[0, 1, 2]], point_count: 3 };
        description.bodies.push(BodyDescription::new("s", shape, RigidMotion::at(Vec3::y())));
        let attachment =
            SurfaceAttachment { vertex: 2, body_points: [0, 1, 2], weights: [0.2, 0.3, 0.5], offset: Vec3::z() };
        let targets = [
            PinTarget::Path { anchor: PinAnchor::WhenHeld, vertices: vec![1], offsets: vec![(0.5, Vec3::z())] },
            PinTarget::Track { vertices: vec![0, 2], track: 3 },
            PinTarget::Body { body: 3, attachments: vec![attachment] },
            PinTarget::BodyNearest { body: 3, vertices: vec![2] },
        ];
        for (target, hold) in targets.into_iter().zip([PinHold::Hard; 4]) {
            let axes = [true, false, true];
            description.pins.push(PinDescription { garment: 0, target, axes, from: -1.0, until: 2.0, hold });
        }
        description.pins[0].hold = PinHold::Spring { stiffness: 3.0, damping_ratio: 1.0, break_force: Some(2.0) };
        let rule = ContactRule::new([ContactSide::Garment(0), ContactSide::Body(3)]);
        description.contacts.push(ContactRule { friction: Some(0.2), ..rule });
        description.curves.insert("gravity.acceleration".into(), vec![(1.0, SettingValue::Vector([0.0, 1.0, 0.0]))]);
        let gravity = EffectRequest::of_scene("gravity").with_vector("acceleration", [0.0, -9.81, 0.0]);
        description.effects.push(gravity.with_flag("flag", true).with("number", 4.0));
        let bytes = description.to_bytes();
        let back: SceneDescription = decode(0, "scene", &bytes);
        assert_eq!(format!("{back:?}"), format!("{description:?}"));
        let cut = |end: usize| decode::<SceneDescription>(0, "scene", &bytes[..end]);
        assert!((0..bytes.len()).all(|end| std::panic::catch_unwind(|| cut(end)).is_err()));
    }
}

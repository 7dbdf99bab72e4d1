//! Bodies where they stand at the start.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::geometry::surface_binding::SurfaceBinding;
use drapery_core::scene::{BodyShape, RigidMotion};
use drapery_core::simulation::FrameInput;

use super::{Facts, bounds};

/// A body at the start.
pub(super) enum Solid<'a> {
    Mesh { triangles: &'a [[u32; 3]], positions: &'a [Vec3] },
    Shape { shape: &'a Shape, motion: &'a RigidMotion },
}

/// The bodies of a scene with their numbers, without those that cannot be read, which is reported elsewhere.
pub(super) fn solids<'a>(facts: &Facts<'a>, input: &'a FrameInput) -> Vec<(usize, Solid<'a>)> {
    let bodies = facts.scene.bodies.iter().zip(&input.bodies).enumerate();
    let solids = bodies.filter_map(|(number, (body, samples))| match &body.shape {
        BodyShape::Surface { triangles, point_count } => {
            let sample = samples.last().filter(|sample| sample.positions.len() == *point_count)?;
            Some((number, Solid::Mesh { triangles, positions: &sample.positions }))
        }
        BodyShape::Rigid(shape) => Some((number, Solid::Shape { shape, motion: &body.motion })),
    });
    solids.collect()
}

/// Returns a place in the frame of a shape that stands where its path begins [m].
pub(super) fn in_frame_of(motion: &RigidMotion, place: &Vec3) -> Vec3 {
    let origin = motion.path.first().map_or_else(Vec3::zeros, |(_, origin)| *origin);
    motion.rotation.inverse_transform_vector(&(place - origin))
}

impl Solid<'_> {
    /// Returns the places that are closer to the surface than `limit` [m], or inside a shape, each with its number and its distance from the
    /// surface or shape [m].
    pub(super) fn close(&self, places: &[(u32, Vec3)], limit: f64) -> Vec<(u32, f64)> {
        match self {
            Self::Shape { shape, motion } => {
                let distances =
                    places.iter().map(|(vertex, place)| (*vertex, shape.distance(&in_frame_of(motion, place))));
                distances.filter(|(_, distance)| *distance < limit).map(|(vertex, d)| (vertex, d.max(0.0))).collect()
            }
            Self::Mesh { triangles, positions } => {
                let Some([low, high]) = bounds(positions) else { return Vec::new() };
                let is_near = |(_, place): &(u32, Vec3)| {
                    (0..3).all(|axis| (low[axis] - limit..=high[axis] + limit).contains(&place[axis]))
                };
                let (vertices, near): (Vec<u32>, Vec<Vec3>) = places.iter().copied().filter(is_near).unzip();
                let bound = SurfaceBinding::new(positions.to_vec(), triangles.to_vec(), &near, &[]);
                let distances = bound.iter().flat_map(SurfaceBinding::distances);
                vertices.into_iter().zip(distances).filter(|(_, distance)| *distance < limit).collect()
            }
        }
    }
}

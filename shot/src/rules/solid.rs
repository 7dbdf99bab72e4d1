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
    /// Returns the places that may be closer to the body than `limit` [m], each with its number.
    pub(super) fn near(&self, places: &[(u32, Vec3)], limit: f64) -> (Vec<u32>, Vec<Vec3>) {
        let bounds = match self {
            Self::Shape { .. } => return places.iter().copied().unzip(),
            Self::Mesh { positions, .. } => bounds(positions),
        };
        let Some([low, high]) = bounds else { return Default::default() };
        let is_near = |(_, place): &(u32, Vec3)| {
            (0..3).all(|axis| (low[axis] - limit..=high[axis] + limit).contains(&place[axis]))
        };
        places.iter().copied().filter(is_near).unzip()
    }

    /// Returns the distance of each place from the surface of a mesh, or from a shape, in which it is zero [m].
    pub(super) fn distances(&self, places: &[Vec3]) -> Vec<f64> {
        match self {
            Self::Shape { shape, motion } => {
                places.iter().map(|place| shape.distance(&in_frame_of(motion, place)).max(0.0)).collect()
            }
            Self::Mesh { triangles, positions } => {
                let bound = SurfaceBinding::new(positions.to_vec(), triangles.to_vec(), places, &[]);
                bound.iter().flat_map(SurfaceBinding::distances).collect()
            }
        }
    }
}

//! Analytic shapes in rigid motion, at both ends of a step.

use nalgebra::{Isometry3, Matrix3, Translation3};

use super::BodyPoint;
use crate::Vec3;
use crate::geometry::attachment::along_path;
use crate::geometry::rotation::rotation_by;
use crate::geometry::shapes::Shape;
use crate::scene::RigidMotion;
use crate::tolerances;

/// Bounds on the distance of a rigid body from a vertex and on the displacement that the body gives it in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    /// The vertex is at least this far from the body at the start of the step [m].
    pub distance: f64,
    /// The body carries the vertex at most this far [m].
    pub displacement: f64,
}

#[derive(Debug)]
pub(super) struct Rigid {
    pub shape: Shape,
    motion: RigidMotion,
    /// Poses at the start and the end of the step.
    poses: [Isometry3<f64>; 2],
    /// Whether it spins at the end of the step.
    spinning: bool,
    /// Whether its rotation changes in the step.
    turning: bool,
    /// Way of its origin in the step [m].
    moved: Vec3,
    /// Velocity of its origin [m/s].
    linear: Vec3,
    /// From directions of the world to those of its own frame at the start of the step.
    into_start: Matrix3<f64>,
    /// Angle that it turns in the step [rad].
    angle: f64,
    /// Length of `moved` [m].
    travelled: f64,
    /// Sum of the largest coordinates of its origins at both ends [m], for rounding.
    extent: f64,
    /// Points of the triangles that edges and faces of cloth meet, in its own frame [m]; empty if they meet none.
    points: Vec<Vec3>,
    /// The same in the world at the start and at the end of the step [m].
    path: [Vec<Vec3>; 2],
}

impl Rigid {
    /// A body at rest at the origin until its first step; edges and faces of cloth meet triangles with these points [m].
    pub(super) fn new(shape: Shape, motion: RigidMotion, points: Vec<Vec3>) -> Self {
        Self {
            shape,
            path: [points.clone(), points.clone()],
            points,
            motion,
            poses: [Isometry3::identity(); 2],
            spinning: false,
            turning: false,
            moved: Vec3::zeros(),
            linear: Vec3::zeros(),
            into_start: Matrix3::identity(),
            angle: 0.0,
            travelled: 0.0,
            extent: 0.0,
        }
    }

    /// Puts it at the ends of a step [s].
    pub(super) fn set_step(&mut self, t0: f64, t1: f64) {
        self.poses = [t0, t1].map(|t| pose(&self.motion, t));
        self.spinning = t1 > t0.max(self.motion.spin_start);
        let [start, end] = &self.poses;
        let dt = t1 - t0;
        self.moved = end.translation.vector - start.translation.vector;
        self.linear = if dt > 0.0 { self.moved / dt } else { Vec3::zeros() };
        // A body that does not turn carries everything alike, to the last bit.
        self.turning = start.rotation != end.rotation;
        self.angle = if self.turning { start.rotation.angle_to(&end.rotation) } else { 0.0 };
        self.into_start = start.rotation.inverse().to_rotation_matrix().into_inner();
        self.travelled = self.moved.norm();
        self.extent = start.translation.vector.amax() + end.translation.vector.amax();
        for (pose, path) in self.poses.iter().zip(&mut self.path) {
            path.clear();
            path.extend(self.points.iter().map(|point| pose.transform_point(&(*point).into()).coords));
        }
    }

    /// Points of its triangles at the start and at the end of the step [m].
    pub(super) fn path(&self) -> [&[Vec3]; 2] {
        [&self.path[0], &self.path[1]]
    }

    /// Adds the points of its triangles at a time [s] to `all` [m].
    pub(super) fn extend_with_points_at(&self, time: f64, all: &mut Vec<Vec3>) {
        let pose = pose(&self.motion, time);
        all.extend(self.points.iter().map(|point| pose.transform_point(&(*point).into()).coords));
    }

    /// A displacement is the way of the origin plus a chord of the circle that a turn moves `x` on.
    pub(super) fn bounds(&self, x: &Vec3) -> Bounds {
        let rounding = tolerances::BOUND_ROUNDING * (x.x.abs() + x.y.abs() + x.z.abs() + self.extent);
        let from_origin = x - self.poses[0].translation.vector;
        let turned = if self.turning { self.angle * from_origin.norm() } else { 0.0 };
        Bounds {
            distance: self.shape.distance(&(self.into_start * from_origin)) - rounding,
            displacement: self.travelled + turned + rounding,
        }
    }

    /// A place in the body's own frame, at the start (0) or the end (1) of the step.
    pub(super) fn local(&self, end: usize, x: &Vec3) -> Vec3 {
        self.poses[end].inverse_transform_point(&(*x).into()).coords
    }

    /// Returns the point of the body at `local`: the velocity of the material there, and the displacement that it
    /// gives a vertex that was at `from`.
    pub(super) fn point(&self, from: &Vec3, local: &Vec3, phi: f64, normal: &Vec3) -> BodyPoint {
        let end = &self.poses[1];
        let arm = end.rotation * local;
        let turning = if self.spinning { self.motion.angular_velocity.cross(&arm) } else { Vec3::zeros() };
        let displacement =
            if self.turning { end.transform_point(&self.local(0, from).into()).coords - from } else { self.moved };
        BodyPoint { phi, normal: end.rotation * normal, velocity: self.linear + turning, displacement, triangle: 0 }
    }
}

/// Pose of a rigid motion at a time.
fn pose(motion: &RigidMotion, time: f64) -> Isometry3<f64> {
    let turned = motion.angular_velocity * (time - motion.spin_start).max(0.0);
    let rotation = rotation_by(&turned) * motion.rotation;
    Isometry3::from_parts(Translation3::from(along_path(&motion.path, time)), rotation)
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::contact::bodies::{Bodies, Kind};
    use crate::geometry::random::SplitMix64;
    use crate::geometry::testing::SHAPES;

    /// One body between 0 and 0.1 s.
    fn moving(shape: Shape, motion: RigidMotion) -> Bodies {
        let kind = Kind::Rigid(Box::new(Rigid::new(shape, motion, Vec::new())));
        let mut bodies = Bodies { list: vec![kind], properties: Vec::new(), times: [0.0; 2], standstill: None };
        bodies.set_step(0.0, 0.1);
        bodies
    }

    #[test]
    fn a_body_that_stands_still_keeps_its_pose_and_has_no_velocity() {
        let path = vec![(0.0, Vec3::zeros()), (1.0, Vec3::x())];
        let motion = RigidMotion { path, angular_velocity: Vec3::z(), ..RigidMotion::at(Vec3::zeros()) };
        let mut bodies = moving(Shape::Sphere { radius: 0.1 }, motion);
        bodies.stand_still(Some(0.5));
        bodies.set_step(-0.3, -0.1);
        let at = Vec3::new(0.65, 0.0, 0.0);
        let found = bodies.closest(0, &at, &at, f64::INFINITY, None).expect("the sphere");
        assert!((found.phi - 0.05).abs() < 1e-12 && found.velocity == Vec3::zeros(), "{found:?}");
        bodies.stand_still(None);
        bodies.set_step(0.5, 0.6);
        let found = bodies.closest(0, &at, &at, f64::INFINITY, None).expect("the sphere");
        assert!((found.velocity - Vec3::x()).norm() < 0.2, "{found:?}");
    }

    #[test]
    fn bounds_on_a_rigid_body_hold_at_both_ends_of_a_step() {
        let mut random = SplitMix64::new(21);
        for round in 0..20_000_usize {
            // Near and far from the origin, with and without a way and a turn, the latter up to several times around.
            let origin = random.vector() * [1.0, 1e3][round % 2];
            let shift = random.vector() * [0.0, 0.2][round / 2 % 2];
            let motion = RigidMotion {
                path: vec![(0.0, origin), (0.1, origin + shift)],
                rotation: UnitQuaternion::from_scaled_axis(random.vector() * 3.0),
                angular_velocity: random.vector() * [0.0, 1e-6, 3.0, 100.0][round / 4 % 4],
                spin_start: 0.05 * random.signed(),
            };
            let shape = SHAPES[round % SHAPES.len()];
            let bodies = moving(shape, motion);
            let x = origin + random.vector() * 3.0;
            let to = x + random.vector() * [0.0, 1.0][round / 16 % 2];
            let bounds = bodies.bounds(0, &x).unwrap();
            let at_end = bodies.closest(0, &x, &to, f64::INFINITY, None).unwrap();
            assert!(bounds.distance <= bodies.distance_at_start(0, &x), "{shape:?} {x:?}");
            assert!(bounds.displacement >= at_end.displacement.norm(), "{shape:?} {x:?}");
            let least = bounds.distance - bounds.displacement - (to - x).norm();
            assert!(at_end.phi >= least, "{shape:?} {x:?} {to:?}: {} {least}", at_end.phi);
        }
    }

    #[test]
    fn bounds_on_a_rigid_body_are_close_to_what_they_bound() {
        let spin = RigidMotion { angular_velocity: Vec3::y(), ..RigidMotion::at(Vec3::x()) };
        let bounds = moving(Shape::Sphere { radius: 0.5 }, spin).bounds(0, &(Vec3::x() * 3.0)).unwrap();
        assert!((bounds.distance - 1.5).abs() < 1e-10);
        assert!((bounds.displacement - 0.2).abs() < 1e-10); // 2 m from the axis, 0.1 rad
    }
}

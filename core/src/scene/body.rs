//! Bodies of a description, and how they move.

use nalgebra::UnitQuaternion;

use crate::Vec3;
use crate::geometry::shapes::Shape;
use crate::scene::described::described;

/// A body that garments collide with. It moves as prescribed; cloth never moves it.
///
/// ```
/// use drapery_core::{BodyDescription, BodyShape, RigidMotion, Shape, Vec3};
/// let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.3 });
/// let body = BodyDescription::new("ball", ball, RigidMotion::at(Vec3::new(0.0, 1.0, 0.0)));
/// let body = BodyDescription { friction: 0.4, thickness: 0.001, ..body };
/// assert_eq!(body.max_push_speed, f64::INFINITY);
/// ```
#[derive(Debug, Clone)]
pub struct BodyDescription {
    /// Name, unique among the bodies.
    pub name: String,
    /// Surface of the body.
    pub shape: BodyShape,
    /// Motion of an analytic shape; a deforming surface moves by its samples and ignores this.
    pub motion: RigidMotion,
    /// Coulomb friction coefficient against cloth.
    pub friction: f64,
    /// Distance that cloth keeps from the surface [m].
    pub thickness: f64,
    /// Fastest speed at which a vertex that is already too deep is pushed out [m/s]; infinite corrects in one step.
    pub max_push_speed: f64,
    /// Whether the triangles of a closed surface face what they enclose, as those of a room do; a surface that faces outwards and
    /// comes to enclose the outside has turned inside out, and its sides are exchanged.
    pub faces_inwards: bool,
}

/// Surface of a body, in its own frame.
///
/// ```
/// use drapery_core::{BodyShape, Shape};
/// let ground = BodyShape::Rigid(Shape::HalfSpace);
/// let character = BodyShape::Surface { triangles: vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], point_count: 4 };
/// assert!(matches!(ground, BodyShape::Rigid(_)) && matches!(character, BodyShape::Surface { point_count: 4, .. }));
/// ```
#[derive(Debug, Clone)]
pub enum BodyShape {
    /// An analytic shape that moves rigidly.
    Rigid(Shape),
    /// A deforming triangle mesh whose positions the caller pushes frame by frame, in world space.
    Surface {
        /// Triangles, counter-clockwise seen from outside.
        triangles: Vec<[u32; 3]>,
        /// Number of points of every sample.
        point_count: usize,
    },
}

/// Prescribed rigid motion: a piecewise linear path of the origin, and a rotation that may spin.
///
/// ```
/// use drapery_core::{RigidMotion, Vec3};
/// let path = vec![(0.0, Vec3::zeros()), (1.0, Vec3::new(0.0, 0.5, 0.0))];
/// let spin = Vec3::y() * std::f64::consts::TAU;
/// let motion = RigidMotion { path, angular_velocity: spin, spin_start: 1.0, ..RigidMotion::at(Vec3::zeros()) };
/// assert_eq!(motion.path.len(), 2);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RigidMotion {
    /// Times [s] and positions [m] of the origin, ascending in time; held before the first and after the last.
    pub path: Vec<(f64, Vec3)>,
    /// Orientation before any spin.
    pub rotation: UnitQuaternion<f64>,
    /// Angular velocity in world axes [rad/s], acting from `spin_start` on.
    pub angular_velocity: Vec3,
    /// Solver time at which the spin starts [s].
    pub spin_start: f64,
}

impl RigidMotion {
    /// At rest at `position` [m].
    pub fn at(position: Vec3) -> Self {
        Self {
            path: vec![(0.0, position)],
            rotation: UnitQuaternion::identity(),
            angular_velocity: Vec3::zeros(),
            spin_start: 0.0,
        }
    }
}

impl BodyDescription {
    /// A frictionless body without thickness.
    pub fn new(name: &str, shape: BodyShape, motion: RigidMotion) -> Self {
        Self {
            name: name.into(),
            shape,
            motion,
            friction: 0.0,
            thickness: 0.0,
            max_push_speed: f64::INFINITY,
            faces_inwards: false,
        }
    }
}

described! { BodyDescription as body {
    "friction", body.friction => None, default Number(0.3), range (0.0, 1e3),
        "Coulomb friction against cloth; left out, that of each garment's material, and the default for cloth without one; a `[[contact]]` sets it \
         for one garment";
    "thickness", body.thickness => Length, default Quantity("1 mm"), range (0.0, 1e3),
        "collision thickness: distance that cloth keeps from the surface; left out, the largest of the garments' \
         materials if there are any, and for a mesh at least the distance that keeps coarse faces of body and garments \
         from showing through each other";
    "max_push_speed", body.max_push_speed => Speed, default Number(f64::INFINITY), range (f64::MIN_POSITIVE, f64::INFINITY),
        "maximum depenetration speed; `inf`: no limit, penetration is resolved within a frame";
} }

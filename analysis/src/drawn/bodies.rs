//! The bodies of a run: their shapes stand in the resolved scene, and their motion there or in the files that it names.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyShape, RigidMotion};
use drapery_io::error::IoError;
use drapery_io::shot_description::ShotDescription;
use nalgebra::UnitQuaternion;

/// Segments around a round shape.
const AROUND: u32 = 48;

/// Rings from pole to pole of a round shape.
const RINGS: u32 = 24;

/// A body at one frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BodyMesh {
    /// Positions [m].
    pub(crate) positions: Vec<Vec3>,
    /// Triangles, counter-clockwise seen from outside.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Whether it has no end: it is drawn around the cloth, and does not belong to what the picture has to hold.
    pub(crate) is_ground: bool,
}

/// A body at a frame; `around` are middle and size of the cloth [m], for bodies that have no end.
///
/// # Errors
/// The file of its motion cannot be read.
pub(crate) fn at(
    shot: &ShotDescription,
    body: usize,
    frame: i64,
    around: (Vec3, f64),
) -> Result<Option<BodyMesh>, IoError> {
    let timeline = shot.scene.timeline;
    let described = &shot.scene.bodies[body];
    match (&described.shape, shot.bodies.get(body).and_then(Option::as_ref)) {
        (BodyShape::Rigid(shape), _) => Ok(Some(rigid(shape, &described.motion, timeline.time(frame), around))),
        (BodyShape::Surface { triangles, .. }, Some(motion)) => {
            let sample = motion.samples(timeline, shot.preroll, frame)?.pop();
            let mesh = |positions| BodyMesh { positions, triangles: triangles.clone(), is_ground: false };
            Ok(sample.map(|sample| mesh(sample.positions)))
        }
        (BodyShape::Surface { .. }, None) => Ok(None),
    }
}

/// Rotation and origin [m] of a rigid motion at a time [s].
pub(crate) fn placement(motion: &RigidMotion, time: f64) -> (UnitQuaternion<f64>, Vec3) {
    let turn = motion.angular_velocity * (time - motion.spin_start).max(0.0);
    (UnitQuaternion::from_scaled_axis(turn) * motion.rotation, place(&motion.path, time))
}

/// An analytic shape where its motion has brought it.
fn rigid(shape: &Shape, motion: &RigidMotion, time: f64, around: (Vec3, f64)) -> BodyMesh {
    let (rotation, origin) = placement(motion, time);
    let (local, triangles) = match *shape {
        Shape::HalfSpace => ground(rotation.inverse() * (around.0 - origin), around.1),
        Shape::Sphere { radius } => round(0.0, |angle| [radius * angle.sin(), radius * angle.cos()]),
        Shape::Capsule { radius, half_length } => {
            round(half_length, |angle| [radius * angle.sin(), radius * angle.cos()])
        }
        Shape::Cylinder { radius, half_length } => cylinder(radius, half_length),
        Shape::Box { half_extents } => cuboid(half_extents),
    };
    let positions = local.into_iter().map(|p| rotation * p + origin).collect();
    BodyMesh { positions, triangles, is_ground: matches!(shape, Shape::HalfSpace) }
}

/// Place on a piecewise linear path [m]; held before its first time and after its last.
fn place(path: &[(f64, Vec3)], time: f64) -> Vec3 {
    let after = path.partition_point(|(t, _)| *t <= time);
    match (after.checked_sub(1).and_then(|i| path.get(i)), path.get(after)) {
        (Some((t_a, a)), Some((t_b, b))) => a.lerp(b, (time - t_a) / (t_b - t_a)),
        (Some((_, only)), None) | (None, Some((_, only))) => *only,
        (None, None) => Vec3::zeros(),
    }
}

/// A square of the plane y = 0 under a place.
fn ground(below: Vec3, size: f64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let corner = |x: f64, z: f64| Vec3::new(below.x + x * size, 0.0, below.z + z * size);
    let corners = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
    (corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]])
}

/// A shape around the y axis: `profile` gives radius and height [m] at an angle from the upper pole; its upper half is
/// raised and its lower half lowered by `lift`.
fn round(lift: f64, profile: impl Fn(f64) -> [f64; 2]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut rings = Vec::new();
    for ring in 0..=RINGS {
        let [radius, height] = profile(std::f64::consts::PI * f64::from(ring) / f64::from(RINGS));
        // The middle ring stands twice, so that a straight wall joins the halves.
        if 2 * ring <= RINGS {
            rings.push([radius, height + lift]);
        }
        if 2 * ring >= RINGS {
            rings.push([radius, height - lift]);
        }
    }
    turned(&rings)
}

fn cylinder(radius: f64, half_length: f64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let [top, bottom] = [half_length, -half_length];
    // Rims stand twice, so that their edges stay sharp.
    let (upper, upper_faces) = turned(&[[0.0, top], [radius, top]]);
    let (wall, wall_faces) = turned(&[[radius, top], [radius, bottom]]);
    let (lower, lower_faces) = turned(&[[radius, bottom], [0.0, bottom]]);
    let mut positions = upper;
    let mut triangles = upper_faces;
    for (more, faces) in [(wall, wall_faces), (lower, lower_faces)] {
        let first = positions.len() as u32;
        positions.extend(more);
        triangles.extend(faces.into_iter().map(|face| face.map(|v| v + first)));
    }
    (positions, triangles)
}

/// Rings of radius and height [m], from above to below, around the y axis.
fn turned(rings: &[[f64; 2]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = Vec::new();
    for &[radius, height] in rings {
        for step in 0..AROUND {
            let angle = std::f64::consts::TAU * f64::from(step) / f64::from(AROUND);
            positions.push(Vec3::new(radius * angle.cos(), height, -radius * angle.sin()));
        }
    }
    let mut triangles = Vec::new();
    for ring in 1..rings.len() as u32 {
        for step in 0..AROUND {
            let next = (step + 1) % AROUND;
            let [a, b] = [(ring - 1) * AROUND + step, (ring - 1) * AROUND + next];
            let [c, d] = [ring * AROUND + step, ring * AROUND + next];
            triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    (positions, triangles)
}

/// A box of six squares that share no points, so that its edges stay sharp.
fn cuboid(half: [f64; 3]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let first = positions.len() as u32;
            for [u, v] in [[-1.0, -1.0], [sign, -sign], [1.0, 1.0], [-sign, sign]] {
                let mut p = Vec3::zeros();
                p[axis] = sign * half[axis];
                p[(axis + 1) % 3] = u * half[(axis + 1) % 3];
                p[(axis + 2) % 3] = v * half[(axis + 2) % 3];
                positions.push(p);
            }
            triangles.extend([[0, 1, 2], [0, 2, 3]].map(|face| face.map(|v: u32| v + first)));
        }
    }
    (positions, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume of a closed surface [m³]: positive when its faces are counter-clockwise seen from outside.
    fn volume((positions, triangles): &(Vec<Vec3>, Vec<[u32; 3]>)) -> f64 {
        let corner = |v: u32| positions[v as usize];
        triangles.iter().map(|[a, b, c]| corner(*a).dot(&corner(*b).cross(&corner(*c))) / 6.0).sum()
    }

    #[test]
    fn shapes_have_their_volume_and_look_outwards() {
        let ball = volume(&round(0.0, |a| [a.sin(), a.cos()]));
        // Corners lie on the ball, so its volume is a little less; an inscribed polygon of 48 corners loses 0.3 %.
        assert!((ball / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{ball}");
        assert!((volume(&cuboid([0.5, 1.0, 1.5])) - 6.0).abs() < 1e-12);
        let can = volume(&cylinder(1.0, 1.0));
        assert!((can / std::f64::consts::TAU - 1.0).abs() < 0.01, "{can}");
        let capsule = volume(&round(1.0, |a| [a.sin(), a.cos()]));
        assert!((capsule / (10.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{capsule}");
    }

    #[test]
    fn a_path_is_straight_between_its_times_and_held_outside() {
        let path = [(1.0, Vec3::zeros()), (3.0, Vec3::x())];
        assert_eq!([0.0, 2.0, 9.0].map(|time| place(&path, time).x), [0.0, 0.5, 1.0]);
    }
}

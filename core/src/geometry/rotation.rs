//! Rotations without functions of the system's mathematical library, which are others on another processor.

use nalgebra::{Quaternion, Unit, UnitQuaternion};

use crate::Vec3;

/// Rotation about `angles`, by their length [rad], however small; nalgebra's own leaves out those below machine epsilon.
pub fn rotation_by(angles: &Vec3) -> UnitQuaternion<f64> {
    let angle = angles.norm();
    if angle == 0.0 {
        return UnitQuaternion::identity();
    }
    let (sin, cos) = libm::sincos(0.5 * angle);
    UnitQuaternion::new_unchecked(Quaternion::from_parts(cos, angles * (sin / angle)))
}

/// Smallest rotation that carries one unit vector to another; half a turn about some axis across for opposite ones.
pub(crate) fn rotation_between(from: &Vec3, to: &Vec3) -> UnitQuaternion<f64> {
    if from.dot(to) < 0.0 {
        // A half turn about an axis across carries it to the opposite, whatever rounding leaves of the axis.
        let axis = from.cross(to).try_normalize(f64::EPSILON).unwrap_or_else(|| across(from).into_inner());
        let axis = (axis - from * axis.dot(from)).normalize();
        return rotation_between(&-from, to) * UnitQuaternion::new_unchecked(Quaternion::from_parts(0.0, axis));
    }
    // The sum has the length 2 cos(angle / 2), and the cross product 2 sin(angle / 2) cos(angle / 2).
    let doubled = (from + to).norm();
    UnitQuaternion::new_normalize(Quaternion::from_parts(0.5 * doubled, from.cross(to) / doubled))
}

/// Some direction at right angles to a unit vector.
fn across(line: &Vec3) -> Unit<Vec3> {
    Unit::new_normalize(line.cross(&Vec3::ith(line.iamin(), 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    #[test]
    fn rotations_are_nalgebras() {
        let mut random = SplitMix64::new(5);
        for size in [3.0, 1e-3] {
            let angles = random.vector() * size;
            assert!(rotation_by(&angles).angle_to(&UnitQuaternion::from_scaled_axis(angles)) < 1e-14);
        }
        let least = rotation_by(&(Vec3::x() * 1e-150));
        assert!((least.imag() - Vec3::x() * 0.5e-150).norm() < 1e-165, "{least}");
        assert_eq!(rotation_by(&Vec3::zeros()), UnitQuaternion::identity());
    }

    #[test]
    fn a_rotation_carries_one_unit_vector_to_another() {
        let mut random = SplitMix64::new(6);
        for tilt in [1.0, 1e-7, 1e-15, 0.0] {
            let from = random.vector().normalize();
            for to in [(from + random.vector() * tilt).normalize(), (random.vector() * tilt - from).normalize()] {
                let rotation = rotation_between(&from, &to);
                assert!((rotation * from - to).norm() < 1e-14, "{from} {to}");
                assert!(rotation.imag().dot(&(from + to)).abs() < 1e-14, "{from} {to}");
            }
        }
    }
}

//! The rigid motion that a set of points has in common, taken out before motions are compared with distances: cloth that
//! falls or turns as a whole brings no two of its points closer.

use nalgebra::{Matrix3, Rotation3};

use crate::Vec3;

/// Every how many points one is looked at. Any motion will do; a better one saves work.
const STRIDE: usize = 4;

/// A rotation and a translation [m].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidFit {
    rotation: Rotation3<f64>,
    /// Centres of the points before and after [m].
    centres: [Vec3; 2],
}

impl RigidFit {
    /// The rigid motion that brings `from` closest to `to` in the mean square (Kabsch 1976), on some of the points.
    pub fn new(from: &[Vec3], to: &[Vec3]) -> Self {
        let some = || from.iter().zip(to).step_by(STRIDE);
        let count = some().len().max(1) as f64;
        let centres = [some().map(|(a, _)| a).sum::<Vec3>() / count, some().map(|(_, b)| b).sum::<Vec3>() / count];
        let covariance: Matrix3<f64> = some().map(|(a, b)| (b - centres[1]) * (a - centres[0]).transpose()).sum();
        Self { rotation: nearest_rotation(&covariance), centres }
    }

    /// Where the motion takes a point [m].
    #[inline]
    pub fn apply(&self, point: &Vec3) -> Vec3 {
        self.rotation * (point - self.centres[0]) + self.centres[1]
    }

    /// Shortest that a unit length can become on the straight paths from this motion to another: the mean of two rotations
    /// by an angle θ apart shortens by cos θ/2.
    pub fn shortening_to(&self, other: &Self) -> f64 {
        let cosine = 0.5 * ((self.rotation.matrix().transpose() * other.rotation.matrix()).trace() - 1.0);
        // The cosine of half the angle; rounding may take that of the angle out of bounds.
        (0.5 * (1.0 + cosine.clamp(-1.0, 1.0))).sqrt()
    }
}

/// The rotation closest to a matrix; none where it has no direction.
fn nearest_rotation(matrix: &Matrix3<f64>) -> Rotation3<f64> {
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return Rotation3::identity() };
    let turned = u * v;
    let rotation = if turned.determinant() > 0.0 {
        turned
    } else {
        // A flat set can be fitted by a reflection as well: turn the direction that matters least.
        u * Matrix3::from_diagonal(&Vec3::new(1.0, 1.0, -1.0)) * v
    };
    if rotation.iter().all(|x| x.is_finite()) {
        Rotation3::from_matrix_unchecked(rotation)
    } else {
        Rotation3::identity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::testing::Random;

    #[test]
    fn a_turned_and_shifted_cloud_has_no_motion_left() {
        let mut random = Random(81);
        for flat in [false, true] {
            let from: Vec<Vec3> = (0..100)
                .map(|_| random.vector().component_mul(&Vec3::new(1.0, if flat { 0.0 } else { 1.0 }, 1.0)))
                .collect();
            let turn = Rotation3::new(Vec3::new(0.3, -1.2, 0.4));
            let to: Vec<Vec3> = from.iter().map(|p| turn * p + Vec3::new(3.0, 1.0, -2.0)).collect();
            let fit = RigidFit::new(&from, &to);
            assert!(from.iter().zip(&to).all(|(a, b)| (fit.apply(a) - b).norm() < 1e-14 * 10.0));
            let none = RigidFit::new(&from, &from);
            assert!((none.shortening_to(&fit) - (0.5 * turn.angle()).cos()).abs() < 1e-12);
        }
    }

    #[test]
    fn one_point_and_points_in_one_place_are_only_shifted() {
        for count in [1, 7] {
            let fit = RigidFit::new(&vec![Vec3::x(); count], &vec![Vec3::y(); count]);
            assert!((fit.apply(&Vec3::x()) - Vec3::y()).norm() < 1e-15);
            let lengths = fit.apply(&Vec3::z()) - fit.apply(&Vec3::zeros());
            assert!((lengths.norm() - 1.0).abs() < 1e-14);
        }
    }
}

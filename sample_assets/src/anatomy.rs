//! The flesh of the mannequin: limbs on bones, joined into one smooth body.

use nalgebra::{Rotation3, UnitQuaternion};

use crate::sdf::{Shape, Vec3, smooth_min};
use crate::skeleton::{Bone, Side, arm_direction, shoulder};

/// A shape that belongs to a bone.
#[derive(Debug, Clone, Copy)]
pub struct Limb {
    /// Bone that carries the limb.
    pub bone: Bone,
    /// The shape in the rest pose.
    pub shape: Shape,
    /// Width of the blend with the limbs before it \[m\].
    pub blend: f64,
    /// A ball around the shape (centre and radius, \[m\]) if the shape's distance is exact, so that the limb has no
    /// effect where the ball is far.
    ball: Option<(Vec3, f64)>,
}

impl Limb {
    fn new(bone: Bone, shape: Shape, blend: f64) -> Limb {
        let ball = match shape {
            Shape::RoundCone { ends, radii } => {
                Some((ends[0].lerp(&ends[1], 0.5), 0.5 * (ends[1] - ends[0]).norm() + radii[0].max(radii[1])))
            }
            // The first-order distance can be less than that of the ball.
            Shape::Ellipsoid { .. } => None,
        };
        Limb { bone, shape, blend, ball }
    }
}

/// All limbs of the body in the rest pose, in the order in which they are blended.
pub fn limbs() -> Vec<Limb> {
    let mut limbs = torso();
    for side in Side::BOTH {
        limbs.extend(arm(side));
    }
    for side in Side::BOTH {
        limbs.extend(leg(side));
    }
    limbs
}

/// The smooth union of limbs: a signed field \[m\].
pub fn union(limbs: &[Limb], p: &Vec3) -> f64 {
    let mut value = f64::INFINITY;
    for limb in limbs {
        let far = |(center, radius): (Vec3, f64)| {
            let reach = value + limb.blend + radius;
            reach > 0.0 && (p - center).norm_squared() > reach * reach
        };
        if limb.ball.is_some_and(far) {
            continue;
        }
        value = smooth_min(value, limb.shape.distance(p), limb.blend);
    }
    value
}

/// Spheres on the sole of a foot (heel, ball, toe): rest centre \[m\] and radius \[m\]. Their lowest points are the
/// floor contact whatever way the foot is turned.
pub fn sole(side: Side) -> [(Vec3, f64); 3] {
    let x = side.sign();
    [
        (Vec3::new(x * 0.134, 0.034, -0.043), 0.034),
        (Vec3::new(x * 0.146, 0.030, 0.085), 0.030),
        (Vec3::new(x * 0.150, 0.023, 0.135), 0.023),
    ]
}

fn ellipsoid(bone: Bone, center: [f64; 3], radii: [f64; 3], blend: f64) -> Limb {
    let shape =
        Shape::Ellipsoid { center: Vec3::from(center), radii: Vec3::from(radii), rotation: UnitQuaternion::identity() };
    Limb::new(bone, shape, blend)
}

fn cone(bone: Bone, ends: [Vec3; 2], radii: [f64; 2], blend: f64) -> Limb {
    Limb::new(bone, Shape::RoundCone { ends, radii }, blend)
}

fn torso() -> Vec<Limb> {
    let mut limbs = vec![
        ellipsoid(Bone::Pelvis, [0.0, 0.945, -0.008], [0.165, 0.105, 0.108], 0.05),
        ellipsoid(Bone::Abdomen, [0.0, 1.065, 0.0], [0.118, 0.150, 0.086], 0.09),
        ellipsoid(Bone::Chest, [0.0, 1.255, -0.010], [0.138, 0.165, 0.098], 0.09),
        cone(Bone::Neck, [Vec3::new(0.0, 1.37, -0.02), Vec3::new(0.0, 1.51, -0.002)], [0.055, 0.046], 0.05),
        ellipsoid(Bone::Head, [0.0, 1.598, 0.008], [0.074, 0.102, 0.092], 0.03),
        cone(Bone::Head, [Vec3::new(0.0, 1.545, 0.035), Vec3::new(0.0, 1.525, 0.062)], [0.045, 0.026], 0.05),
    ];
    for side in Side::BOTH {
        let at = |x: f64, y: f64, z: f64| Vec3::new(side.sign() * x, y, z);
        limbs.push(ellipsoid(Bone::Chest, at(0.066, 1.252, 0.058).into(), [0.062, 0.060, 0.050], 0.05));
        limbs.push(ellipsoid(Bone::Pelvis, at(0.072, 0.905, -0.052).into(), [0.082, 0.090, 0.075], 0.06));
        let collar = [at(0.03, 1.375, -0.015), shoulder(side)];
        limbs.push(cone(Bone::Clavicle(side), collar, [0.052, 0.050], 0.06));
        // The slope from the neck to the shoulder, on which a T-shirt hangs.
        let slope = [at(0.02, 1.425, -0.025), at(0.115, 1.395, -0.02)];
        limbs.push(cone(Bone::Clavicle(side), slope, [0.036, 0.030], 0.05));
    }
    limbs
}

fn arm(side: Side) -> Vec<Limb> {
    let along = arm_direction(side);
    let at = |distance: f64| shoulder(side) + along * distance;
    let forward = Vec3::z();
    let hand = Bone::Hand(side);
    // A flat mitt, palm to the thigh: wide along z, thin across the body.
    let axes = Rotation3::from_basis_unchecked(&[along.cross(&forward), along, forward]);
    let mitt = Shape::Ellipsoid {
        center: at(0.600) + forward * 0.004,
        radii: Vec3::new(0.022, 0.090, 0.040),
        rotation: UnitQuaternion::from_rotation_matrix(&axes),
    };
    vec![
        cone(Bone::UpperArm(side), [at(0.0), at(0.275)], [0.050, 0.036], 0.035),
        cone(Bone::Forearm(side), [at(0.275), at(0.335)], [0.036, 0.0385], 0.012),
        cone(Bone::Forearm(side), [at(0.335), at(0.515)], [0.0385, 0.0265], 0.012),
        Limb::new(hand, mitt, 0.03),
        cone(hand, [at(0.545) + forward * 0.022, at(0.610) + forward * 0.052], [0.017, 0.0135], 0.02),
    ]
}

fn leg(side: Side) -> Vec<Limb> {
    let at = |x: f64, y: f64, z: f64| Vec3::new(side.sign() * x, y, z);
    let [heel, ball, toe] = sole(side);
    let (thigh, shin, foot) = (Bone::Thigh(side), Bone::Shin(side), Bone::Foot(side));
    let knee = shin.rest_joint();
    let ankle = foot.rest_joint();
    vec![
        cone(thigh, [at(0.090, 0.865, -0.002), knee], [0.085, 0.049], 0.035),
        cone(shin, [knee, at(0.118, 0.375, -0.012)], [0.049, 0.054], 0.012),
        cone(shin, [at(0.118, 0.375, -0.012), ankle], [0.054, 0.035], 0.012),
        cone(foot, [ankle, heel.0], [0.036, heel.1], 0.02),
        cone(foot, [ankle, ball.0], [0.038, ball.1], 0.04),
        cone(foot, [heel.0, ball.0], [heel.1, ball.1], 0.008),
        cone(foot, [ball.0 + at(0.012, 0.0, 0.0), toe.0], [ball.1, toe.1], 0.008),
        cone(foot, [ball.0 - at(0.012, 0.0, 0.0), toe.0 - at(0.014, 0.0, -0.006)], [ball.1, toe.1], 0.008),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaving_out_far_limbs_does_not_change_the_union() {
        let limbs = limbs();
        let plain = |p: &Vec3| {
            limbs.iter().fold(f64::INFINITY, |value, limb| smooth_min(value, limb.shape.distance(p), limb.blend))
        };
        for i in 0..4000 {
            let p = Vec3::new(
                f64::from(i % 20) * 0.06 - 0.6,
                f64::from(i / 20 % 20) * 0.09,
                f64::from(i / 400) * 0.05 - 0.2,
            );
            assert_eq!(union(&limbs, &p), plain(&p), "{p:?}");
        }
    }

    #[test]
    fn the_body_is_symmetric_and_stands_on_the_floor() {
        let limbs = limbs();
        for p in [Vec3::new(0.2, 1.3, 0.02), Vec3::new(0.1, 0.5, -0.1), Vec3::new(0.4, 1.0, 0.0)] {
            let mirrored = Vec3::new(-p.x, p.y, p.z);
            // The blends are taken one after the other, so the two sides agree to the second order of a blend only.
            assert!((union(&limbs, &p) - union(&limbs, &mirrored)).abs() < 2e-3);
        }
        for side in Side::BOTH {
            for (center, radius) in sole(side) {
                assert!((center.y - radius).abs() < 1e-12);
            }
        }
    }
}

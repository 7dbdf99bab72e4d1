//! The bones of the mannequin: a tree of joints, and the transforms of all bones for a set of joint rotations.
//!
//! Rest pose: height 1.70 m, y up, facing +z, the character's left on +x, arms 40 degrees from the body, legs apart.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use crate::sdf::Vec3;

/// Angle between the hanging arm and the vertical in the rest pose \[degrees\].
pub const REST_ARM_ANGLE: f64 = 40.0;

/// Left is +x; every paired bone exists once on each side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The character's left, +x.
    Left,
    /// The character's right, -x.
    Right,
}

impl Side {
    /// Both sides, in the order in which the bones are stored.
    pub const BOTH: [Side; 2] = [Side::Left, Side::Right];

    /// +1 on the left, -1 on the right: the factor that mirrors x.
    pub fn sign(self) -> f64 {
        match self {
            Side::Left => 1.0,
            Side::Right => -1.0,
        }
    }
}

/// A rigid part of the skeleton.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the anatomy
pub enum Bone {
    Pelvis,
    Abdomen,
    Chest,
    Neck,
    Head,
    Clavicle(Side),
    UpperArm(Side),
    Forearm(Side),
    Hand(Side),
    Thigh(Side),
    Shin(Side),
    Foot(Side),
}

impl Bone {
    /// Number of bones.
    pub const COUNT: usize = 19;

    /// All bones, parents before children; the position in this list is [`Bone::index`].
    pub const ALL: [Bone; Bone::COUNT] = {
        use Bone::*;
        use Side::*;
        [
            Pelvis,
            Abdomen,
            Chest,
            Neck,
            Head,
            Clavicle(Left),
            Clavicle(Right),
            UpperArm(Left),
            UpperArm(Right),
            Forearm(Left),
            Forearm(Right),
            Hand(Left),
            Hand(Right),
            Thigh(Left),
            Thigh(Right),
            Shin(Left),
            Shin(Right),
            Foot(Left),
            Foot(Right),
        ]
    };

    /// Place of the bone in [`Bone::ALL`].
    pub fn index(self) -> usize {
        let paired = |first: usize, side: Side| first + usize::from(side == Side::Right);
        match self {
            Bone::Pelvis => 0,
            Bone::Abdomen => 1,
            Bone::Chest => 2,
            Bone::Neck => 3,
            Bone::Head => 4,
            Bone::Clavicle(side) => paired(5, side),
            Bone::UpperArm(side) => paired(7, side),
            Bone::Forearm(side) => paired(9, side),
            Bone::Hand(side) => paired(11, side),
            Bone::Thigh(side) => paired(13, side),
            Bone::Shin(side) => paired(15, side),
            Bone::Foot(side) => paired(17, side),
        }
    }

    /// The side of a paired bone.
    pub fn side(self) -> Option<Side> {
        match self {
            Bone::Clavicle(side) | Bone::UpperArm(side) | Bone::Forearm(side) | Bone::Hand(side) => Some(side),
            Bone::Thigh(side) | Bone::Shin(side) | Bone::Foot(side) => Some(side),
            Bone::Pelvis | Bone::Abdomen | Bone::Chest | Bone::Neck | Bone::Head => None,
        }
    }

    /// The bone it hangs on; none for the pelvis.
    pub fn parent(self) -> Option<Bone> {
        Some(match self {
            Bone::Pelvis => return None,
            Bone::Abdomen => Bone::Pelvis,
            Bone::Chest => Bone::Abdomen,
            Bone::Neck => Bone::Chest,
            Bone::Head => Bone::Neck,
            Bone::Clavicle(_) => Bone::Chest,
            Bone::UpperArm(side) => Bone::Clavicle(side),
            Bone::Forearm(side) => Bone::UpperArm(side),
            Bone::Hand(side) => Bone::Forearm(side),
            Bone::Thigh(_) => Bone::Pelvis,
            Bone::Shin(side) => Bone::Thigh(side),
            Bone::Foot(side) => Bone::Shin(side),
        })
    }

    /// Rest position of the joint about which the bone turns \[m\].
    pub fn rest_joint(self) -> Vec3 {
        let mirrored = |side: Side, x: f64, y: f64, z: f64| Vec3::new(side.sign() * x, y, z);
        match self {
            Bone::Pelvis => Vec3::new(0.0, 0.95, 0.0),
            Bone::Abdomen => Vec3::new(0.0, 1.03, -0.005),
            Bone::Chest => Vec3::new(0.0, 1.16, -0.01),
            Bone::Neck => Vec3::new(0.0, 1.42, -0.02),
            Bone::Head => Vec3::new(0.0, 1.505, -0.005),
            Bone::Clavicle(side) => mirrored(side, 0.025, 1.385, -0.01),
            Bone::UpperArm(side) => shoulder(side),
            Bone::Forearm(side) => shoulder(side) + arm_direction(side) * 0.275,
            Bone::Hand(side) => shoulder(side) + arm_direction(side) * 0.515,
            Bone::Thigh(side) => mirrored(side, 0.088, 0.905, 0.0),
            Bone::Shin(side) => mirrored(side, 0.112, 0.485, 0.008),
            Bone::Foot(side) => mirrored(side, 0.132, 0.08, -0.02),
        }
    }
}

/// Rest position of the shoulder joint \[m\].
pub fn shoulder(side: Side) -> Vec3 {
    Vec3::new(side.sign() * 0.162, 1.365, -0.015)
}

/// Unit vector from the shoulder to the hand in the rest pose.
pub fn arm_direction(side: Side) -> Vec3 {
    let angle = REST_ARM_ANGLE.to_radians();
    Vec3::new(side.sign() * angle.sin(), -angle.cos(), 0.0)
}

/// For every bone the motion from the rest pose to the posed one, about the joints; `rotations` are relative to the
/// parent, in axes that are parallel to the world's in the rest pose. The pelvis keeps its place.
pub fn pose_bones(rotations: &[UnitQuaternion<f64>; Bone::COUNT]) -> [Isometry3<f64>; Bone::COUNT] {
    let mut posed = [Isometry3::identity(); Bone::COUNT];
    for bone in Bone::ALL {
        let joint = Translation3::from(bone.rest_joint());
        let local = joint * rotations[bone.index()] * joint.inverse();
        posed[bone.index()] = match bone.parent() {
            Some(parent) => posed[parent.index()] * local,
            None => local,
        };
    }
    posed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bones_are_listed_by_index_with_parents_first() {
        for (i, bone) in Bone::ALL.into_iter().enumerate() {
            assert_eq!(bone.index(), i);
            assert!(bone.parent().is_none_or(|parent| parent.index() < i));
        }
    }

    #[test]
    fn turning_a_joint_leaves_the_joint_in_place_and_carries_its_children() {
        let mut rotations = [UnitQuaternion::identity(); Bone::COUNT];
        let thigh = Bone::Thigh(Side::Left);
        rotations[thigh.index()] = UnitQuaternion::from_axis_angle(&Vec3::x_axis(), -std::f64::consts::FRAC_PI_2);
        let posed = pose_bones(&rotations);
        let hip = thigh.rest_joint();
        assert!((posed[thigh.index()] * nalgebra::Point3::from(hip) - hip).coords.norm() < 1e-12);
        // The leg points straight forward: the height of the knee over the hip is the depth it had before.
        let knee = Bone::Shin(Side::Left).rest_joint();
        let raised = posed[Bone::Shin(Side::Left).index()] * nalgebra::Point3::from(knee);
        assert!((raised.z - (hip.y - knee.y)).abs() < 1e-12 && (raised.y - hip.y - knee.z).abs() < 1e-12);
    }
}

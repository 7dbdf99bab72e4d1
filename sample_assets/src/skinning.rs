//! Skin weights from the limbs, and dual quaternion skinning (Kavan, Collins, Zara, O'Sullivan 2007).

use nalgebra::{Isometry3, Quaternion};
use rayon::prelude::*;

use crate::anatomy::Limb;
use crate::sdf::Vec3;
use crate::skeleton::Bone;
use crate::surface_mesh::SurfaceMesh;

/// Distance \[m\] to a limb at which its weight has fallen to 2^-FALL_OFF of what it is inside.
const REACH: f64 = 0.014;
const FALL_OFF: i32 = 3;
/// Weights below this share are dropped: no vertex follows a far bone.
const SMALLEST_WEIGHT: f64 = 0.01;
/// Length over which the weights are averaged along the surface \[m\].
const SMOOTHING_LENGTH: f64 = 0.05;

/// Weights of the bones for one vertex; they are positive and add up to 1.
pub type BoneWeights = Vec<(Bone, f64)>;

/// Weights of all vertices: each bone counts the more, the closer its limbs are, averaged along the surface.
pub fn skin_weights(mesh: &SurfaceMesh, limbs: &[Limb]) -> Vec<BoneWeights> {
    let mut weights: Vec<[f64; Bone::COUNT]> = mesh.points.par_iter().map(|p| raw_weights(p, limbs)).collect();
    let mut neighbours = vec![Vec::new(); mesh.points.len()];
    for ([a, b], _) in mesh.edges() {
        neighbours[a].push(b);
        neighbours[b].push(a);
    }
    // One pass spreads by about one edge, and the spread grows with the square root of the passes.
    let passes = (SMOOTHING_LENGTH / mesh.mean_edge()).powi(2).ceil() as usize;
    for _ in 0..passes {
        let old = &weights;
        let averaged = |v: usize| {
            let share = 0.5 / neighbours[v].len() as f64;
            std::array::from_fn(|bone| {
                0.5 * old[v][bone] + share * neighbours[v].iter().map(|&n| old[n][bone]).sum::<f64>()
            })
        };
        weights = (0..old.len()).into_par_iter().map(averaged).collect();
    }
    weights.iter().map(without_small).collect()
}

fn raw_weights(p: &Vec3, limbs: &[Limb]) -> [f64; Bone::COUNT] {
    let mut nearest = [f64::INFINITY; Bone::COUNT];
    for limb in limbs {
        let distance = &mut nearest[limb.bone.index()];
        *distance = distance.min(limb.shape.distance(p).max(0.0));
    }
    let mut weights = [0.0; Bone::COUNT];
    for bone in Bone::ALL {
        let fall = (1.0 + nearest[bone.index()] / REACH).powi(-FALL_OFF);
        weights[bone.index()] = fall * own_side(bone, p);
    }
    let total: f64 = weights.iter().sum();
    weights.map(|weight| weight / total)
}

/// Keeps the limbs of one side off the skin of the other: between the thighs both are close.
fn own_side(bone: Bone, p: &Vec3) -> f64 {
    let Some(side) = bone.side() else { return 1.0 };
    let t = (0.5 + side.sign() * p.x / 0.03).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn without_small(weights: &[f64; Bone::COUNT]) -> BoneWeights {
    let kept: BoneWeights = Bone::ALL
        .into_iter()
        .map(|bone| (bone, weights[bone.index()] - SMALLEST_WEIGHT))
        .filter(|(_, weight)| *weight > 0.0)
        .collect();
    let total: f64 = kept.iter().map(|(_, weight)| weight).sum();
    kept.into_iter().map(|(bone, weight)| (bone, weight / total)).collect()
}

/// Points \[m\] carried by the bones' motions from the rest pose.
pub fn skin(points: &[Vec3], weights: &[BoneWeights], bones: &[Isometry3<f64>; Bone::COUNT]) -> Vec<Vec3> {
    let dual = bones.map(|bone| {
        let real = bone.rotation.into_inner();
        let shift = Quaternion::from_parts(0.0, bone.translation.vector);
        (real, shift * real * 0.5)
    });
    let carried = |(p, weights): (&Vec3, &BoneWeights)| {
        let lead = dual[weights[0].0.index()].0;
        let (mut real, mut moved) = (Quaternion::from_real(0.0), Quaternion::from_real(0.0));
        for (bone, weight) in weights {
            let (r, d) = dual[bone.index()];
            // q and -q are the same rotation; all are brought to the half sphere of the first.
            let signed = weight.copysign(r.dot(&lead));
            real += r * signed;
            moved += d * signed;
        }
        let length = real.norm();
        let (real, moved) = (real / length, moved / length);
        let turned = real * Quaternion::from_parts(0.0, *p) * real.conjugate();
        turned.imag() + (moved * real.conjugate()).imag() * 2.0
    };
    points.par_iter().zip(weights).map(carried).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn a_vertex_of_one_bone_moves_rigidly_and_half_weights_turn_by_half() {
        let mut bones = [Isometry3::identity(); Bone::COUNT];
        let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), 1.0);
        bones[1] = Isometry3::from_parts(Vec3::new(0.1, 0.2, 0.3).into(), turn);
        let p = Vec3::new(0.3, -0.2, 0.5);
        let rigid = skin(&[p], &[vec![(Bone::Abdomen, 1.0)]], &bones)[0];
        assert!((rigid - (turn * p + Vec3::new(0.1, 0.2, 0.3))).norm() < 1e-12);
        bones[1].translation.vector = Vec3::zeros();
        let half = skin(&[p], &[vec![(Bone::Pelvis, 0.5), (Bone::Abdomen, 0.5)]], &bones)[0];
        assert!((half - turn.powf(0.5) * p).norm() < 1e-12);
    }
}

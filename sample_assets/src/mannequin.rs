//! The skinned body: mesh, weights and motion together.

use nalgebra::Isometry3;

use crate::anatomy::{Limb, limbs, union};
use crate::motion::{Motion, Root};
use crate::sdf::Vec3;
use crate::skeleton::{Bone, pose_bones};
use crate::skinning::{BoneWeights, skin, skin_weights};
use crate::surface_mesh::{Grid, SurfaceMesh, relax_on, start_at_better_diagonal, surface_net};

/// Cell of the mesher at resolution 1 \[m\]; it gives about 10,000 points.
const BODY_CELL: f64 = 0.0149;
const RELAX_PASSES: usize = 24;

/// A body that moves: its rest mesh, skin and joint curves.
#[derive(Debug, Clone)]
pub struct Mannequin {
    /// Quads of the rest pose \[m\], counter-clockwise seen from outside.
    pub rest: SurfaceMesh,
    /// Its limbs in the rest pose.
    pub limbs: Vec<Limb>,
    weights: Vec<BoneWeights>,
    motion: Motion,
}

impl Mannequin {
    /// A body with edges of about 13 mm / `resolution` that moves for `duration` \[s\].
    pub fn new(resolution: f64, duration: f64, seed: u64) -> Mannequin {
        let limbs = limbs();
        let rest = body_mesh(&limbs, BODY_CELL / resolution);
        let weights = skin_weights(&rest, &limbs);
        Mannequin { rest, limbs, weights, motion: Motion::new(duration, seed) }
    }

    /// The joint curves and the root's path.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Points \[m\] at `time` \[s\] relative to the root, and the root.
    pub fn points_in_root(&self, time: f64) -> (Vec<Vec3>, Root) {
        let bones: [Isometry3<f64>; Bone::COUNT] = pose_bones(&self.motion.pose(time).rotations());
        (skin(&self.rest.points, &self.weights, &bones), self.motion.root(time))
    }

    /// Points in the world \[m\] at `time` \[s\].
    pub fn points(&self, time: f64) -> Vec<Vec3> {
        let (points, root) = self.points_in_root(time);
        let transform = root.transform();
        points.iter().map(|p| transform.transform_point(&(*p).into()).coords).collect()
    }
}

fn body_mesh(limbs: &[Limb], cell: f64) -> SurfaceMesh {
    let field = |p: &Vec3| union(limbs, p);
    let mut mesh = surface_net(&field, &grid_around(limbs, 0.0, cell));
    relax_on(&field, &mut mesh, RELAX_PASSES);
    start_at_better_diagonal(&field, &mut mesh);
    mesh
}

/// A grid of `cell` \[m\] around limbs that are thicker by `offset` \[m\].
pub fn grid_around(limbs: &[Limb], offset: f64, cell: f64) -> Grid {
    let empty = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    let (lower, upper) = limbs
        .iter()
        .map(|limb| limb.shape.bounds())
        .fold(empty, |whole, part| (whole.0.inf(&part.0), whole.1.sup(&part.1)));
    Grid::around(&lower.add_scalar(-offset), &upper.add_scalar(offset), cell)
}

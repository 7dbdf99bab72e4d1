//! Loose trousers: the offset surface of hips and legs, with straight wide legs.

use super::{Garment, Panel, WAIST_GAP, WAIST_HEIGHT, highest_ring, panelled};
use crate::anatomy::{Limb, union};
use crate::mannequin::grid_around;
use crate::remesh::{Cut, cut_and_remesh};
use crate::sdf::{Shape, Vec3, smooth_min};
use crate::skeleton::{Bone, Side};
use crate::surface_mesh::{relax_on, surface_net};

const HEM_HEIGHT: f64 = 0.105;
const WAISTBAND: f64 = 0.035;
const HEM: f64 = 0.03;
const RELAX_PASSES: usize = 5;

/// The trousers over a body in its rest pose, as triangles with edges of about `edge` \[m\].
pub fn trousers(limbs: &[Limb], edge: f64) -> Garment {
    let covered: Vec<Limb> = limbs
        .iter()
        .copied()
        .filter(|limb| matches!(limb.bone, Bone::Pelvis | Bone::Abdomen | Bone::Chest | Bone::Thigh(_) | Bone::Shin(_)))
        .collect();
    let legs = loose_legs();
    let field = |p: &Vec3| {
        let body = union(&covered, p) - WAIST_GAP;
        legs.iter().fold(body, |value, leg| smooth_min(value, leg.distance(p), 0.03))
    };
    let mut closed = surface_net(&field, &grid_around(&covered, 0.1, 0.8 * edge));
    relax_on(&field, &mut closed, RELAX_PASSES);
    let mesh = cut_and_remesh(&field, &closed, &cuts(), edge);
    let panel = |center: &Vec3| {
        let set = if center.y > WAIST_HEIGHT - f64::max(WAISTBAND, 1.2 * edge) {
            2
        } else if center.y < HEM_HEIGHT + f64::max(HEM, 1.2 * edge) {
            3
        } else {
            usize::from(center.x < 0.0)
        };
        Panel { set, chart: 2 * usize::from(center.x < 0.0) + usize::from(center.z < 0.0) }
    };
    let sets = ["left_leg", "right_leg", "waistband", "hem"];
    let mut garment = panelled("trousers", mesh, &sets, panel, flatten);
    garment.waist_ring = highest_ring(&garment.mesh);
    garment
}

/// Wide straight legs from the hip to below the hem, one round cone each above and below the knee.
fn loose_legs() -> Vec<Shape> {
    let mut shapes = Vec::new();
    for side in Side::BOTH {
        let at = |x: f64, y: f64, z: f64| Vec3::new(side.sign() * x, y, z);
        let (hip, knee, hem) = (at(0.106, 0.80, 0.0), at(0.124, 0.47, -0.002), at(0.136, 0.0, -0.016));
        shapes.push(Shape::RoundCone { ends: [hip, knee], radii: [0.088, 0.084] });
        shapes.push(Shape::RoundCone { ends: [knee, hem], radii: [0.084, 0.086] });
    }
    shapes
}

fn cuts() -> [Cut; 2] {
    let within = |lower: f64, upper: f64| [Vec3::new(-1.0, lower, -1.0), Vec3::new(1.0, upper, 1.0)];
    [
        Cut { normal: Vec3::y(), point: Vec3::new(0.0, WAIST_HEIGHT, 0.0), within: within(0.9, 2.0) },
        Cut { normal: -Vec3::y(), point: Vec3::new(0.0, HEM_HEIGHT, 0.0), within: within(-1.0, 0.3) },
    ]
}

/// Front and back of each leg are unrolled from a vertical cylinder around the leg; 1 unit is about 1 m.
fn flatten(chart: usize, p: &Vec3) -> [f64; 2] {
    let (sign, facing) = (1.0 - (chart / 2 * 2) as f64, 1.0 - (chart % 2 * 2) as f64);
    // The axis leans from the hip to the ankle.
    let axis_x = sign * (0.14 - 0.055 * p.y);
    let around = (p.x - axis_x).atan2(0.03 + (facing * p.z).max(0.0));
    [0.2 + 0.4 * chart as f64 + facing * 0.10 * around, p.y - HEM_HEIGHT]
}

//! A T-shirt: the offset surface of torso and upper arms with loose sleeves, over the waist of the skirt.

use super::{Garment, Panel, Skirt, panelled};
use crate::anatomy::{Limb, union};
use crate::mannequin::grid_around;
use crate::remesh::{Cut, cut_and_remesh};
use crate::sdf::{Shape, Vec3, smooth_min};
use crate::skeleton::{Bone, Side, arm_direction, shoulder};
use crate::surface_mesh::{relax_on, surface_net};

/// Smallest distance of the cloth from the body \[m\].
const BODY_GAP: f64 = 0.010;
/// Distance of the cloth from the skirt below it \[m\].
const SKIRT_GAP: f64 = 0.008;
const HEM_HEIGHT: f64 = 0.945;
/// Length of the sleeves from the shoulder joint \[m\].
const SLEEVE: f64 = 0.165;
/// Distance from the shoulder joint to the seam between sleeve and body \[m\].
const ARMHOLE: f64 = 0.02;
/// Depth of the seam between front and back \[m\].
const SIDE_SEAM_Z: f64 = -0.013;
const RELAX_PASSES: usize = 5;

/// The T-shirt over a body in its rest pose and the skirt, as triangles with edges of about `edge` \[m\].
pub fn tshirt(limbs: &[Limb], skirt: &Skirt, edge: f64) -> Garment {
    let covered: Vec<Limb> = limbs
        .iter()
        .copied()
        .filter(|limb| {
            !matches!(limb.bone, Bone::Forearm(_) | Bone::Hand(_) | Bone::Head | Bone::Shin(_) | Bone::Foot(_))
        })
        .collect();
    let loose = loose_shapes();
    let field = |p: &Vec3| {
        let mut value = union(&covered, p) - BODY_GAP;
        for (shape, blend) in &loose {
            value = smooth_min(value, shape.distance(p), *blend);
        }
        smooth_min(value, skirt.distance(p) - SKIRT_GAP, 0.03)
    };
    let mut closed = surface_net(&field, &grid_around(&covered, 0.2, 0.8 * edge));
    relax_on(&field, &mut closed, RELAX_PASSES);
    let mesh = cut_and_remesh(&field, &closed, &cuts(), edge);
    let hem_set = HEM_HEIGHT + f64::max(0.03, 1.2 * edge);
    let panel = |center: &Vec3| {
        let chart = chart(center);
        let set = if chart > 1 { 1 } else { 2 * usize::from(center.y < hem_set) };
        Panel { set, chart }
    };
    panelled("tshirt", mesh, &["body", "sleeves", "hem"], panel, flatten)
}

/// Returns the shapes that make the shirt wider than the body.
fn loose_shapes() -> Vec<(Shape, f64)> {
    let mut shapes = vec![(
        Shape::Ellipsoid {
            center: Vec3::new(0.0, 1.14, 0.004),
            radii: Vec3::new(0.160, 0.33, 0.122),
            rotation: nalgebra::UnitQuaternion::identity(),
        },
        0.06,
    )];
    for side in Side::BOTH {
        let at = |distance: f64| shoulder(side) + arm_direction(side) * distance;
        shapes.push((Shape::RoundCone { ends: [at(0.02), at(0.30)], radii: [0.058, 0.072] }, 0.04));
    }
    shapes
}

fn cuts() -> Vec<Cut> {
    let tall = |lower: f64, upper: f64| [Vec3::new(-1.0, lower, -1.0), Vec3::new(1.0, upper, 1.0)];
    let neck = Vec3::new(0.0, 0.94, 0.34).normalize();
    let mut cuts = vec![
        Cut { normal: -Vec3::y(), point: Vec3::new(0.0, HEM_HEIGHT, 0.0), within: tall(-1.0, 1.1) },
        Cut {
            normal: neck,
            point: Vec3::new(0.0, 1.455, -0.02),
            within: [Vec3::new(-0.12, 1.3, -1.0), Vec3::new(0.12, 2.0, 1.0)],
        },
    ];
    for side in Side::BOTH {
        let x = if side == Side::Left { [0.19, 1.0] } else { [-1.0, -0.19] };
        cuts.push(Cut {
            normal: arm_direction(side),
            point: shoulder(side) + arm_direction(side) * SLEEVE,
            within: [Vec3::new(x[0], 1.0, -1.0), Vec3::new(x[1], 2.0, 1.0)],
        });
    }
    cuts
}

/// Front and back of the body, of the left and of the right sleeve.
fn chart(center: &Vec3) -> usize {
    let on_sleeve = |side: &Side| {
        let along = (center - shoulder(*side)).dot(&arm_direction(*side));
        along > ARMHOLE && side.sign() * center.x > 0.15 && center.y > 1.1
    };
    let part = Side::BOTH.iter().position(on_sleeve).map_or(0, |sleeve| 1 + sleeve);
    2 * part + usize::from(center.z < SIDE_SEAM_Z)
}

/// Body panels are unrolled from a vertical cylinder, sleeve panels from a cylinder around the arm; 1 unit is about 1
/// m.
fn flatten(chart: usize, p: &Vec3) -> [f64; 2] {
    let facing = if chart.is_multiple_of(2) { 1.0 } else { -1.0 };
    let depth = (facing * (p.z - SIDE_SEAM_Z)).max(0.0);
    let place = 0.25 + 0.5 * chart as f64;
    if chart < 2 {
        return [place + facing * 0.24 * p.x.atan2(0.14 + depth), p.y - HEM_HEIGHT];
    }
    let side = Side::BOTH[chart / 2 - 1];
    let from = p - shoulder(side);
    let along = arm_direction(side);
    let outward = along.cross(&Vec3::z()) * -side.sign();
    [place + 0.07 * from.dot(&outward).atan2(depth), SLEEVE - from.dot(&along)]
}

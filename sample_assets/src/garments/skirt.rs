//! A flared knee-length skirt: rings of quads from the waist to the hem.

use std::f64::consts::TAU;

use super::{Garment, WAIST_GAP, WAIST_HEIGHT};
use crate::anatomy::{Limb, union};
use crate::sdf::Vec3;
use crate::skeleton::Bone;
use crate::surface_mesh::SurfaceMesh;

const HEM_HEIGHT: f64 = 0.47;
/// Depth of the skirt's axis \[m\].
const AXIS_Z: f64 = -0.004;
/// Slope of the flare, radius per height, below the hips.
const FLARE: f64 = 0.30;
/// Height over which the flare sets in below the waist \[m\].
const FLARE_START: f64 = 0.12;
const ANGLES: usize = 240;
const LEVELS: usize = 160;
/// Passes over the table of radii; they round off where the flare leaves the hips.
const SMOOTHING_PASSES: usize = 27;
/// Heights of the waistband and of the hem's face set \[m\].
const BAND: f64 = 0.035;

/// The shape of the skirt: its radius around a vertical axis.
#[derive(Debug, Clone)]
pub struct Skirt {
    /// Radius \[m\] by level from the waist down, then by angle from the front to the left.
    radii: Vec<f64>,
}

impl Skirt {
    /// Fits the skirt over the rest pose: [`WAIST_GAP`] off the body at the waist, over the hips, then flared.
    pub fn over(limbs: &[Limb]) -> Skirt {
        let covered: Vec<Limb> = limbs
            .iter()
            .copied()
            .filter(|limb| {
                matches!(limb.bone, Bone::Pelvis | Bone::Abdomen | Bone::Chest | Bone::Thigh(_) | Bone::Shin(_))
            })
            .collect();
        let mut closest = vec![0.0; LEVELS * ANGLES];
        let mut radii = vec![0.0; LEVELS * ANGLES];
        for level in 0..LEVELS {
            for angle in 0..ANGLES {
                let at = level * ANGLES + angle;
                closest[at] = body_radius(&covered, level_height(level), angle as f64 * TAU / ANGLES as f64);
                radii[at] = if level == 0 {
                    closest[at]
                } else {
                    let below_waist = WAIST_HEIGHT - level_height(level);
                    let slope = FLARE * (below_waist / FLARE_START).min(1.0).powi(2);
                    closest[at].max(radii[at - ANGLES] + slope * level_step())
                };
            }
        }
        let mut skirt = Skirt { radii };
        for _ in 0..SMOOTHING_PASSES {
            skirt.smooth(&closest);
        }
        skirt
    }

    /// Averages each radius with its neighbours, but stays outside the body; the waist stays on its offset.
    fn smooth(&mut self, closest: &[f64]) {
        let old = self.radii.clone();
        for level in 1..LEVELS - 1 {
            for angle in 0..ANGLES {
                let at = |level: usize, angle: usize| old[level * ANGLES + angle % ANGLES];
                let around =
                    at(level - 1, angle) + at(level + 1, angle) + at(level, angle + 1) + at(level, angle + ANGLES - 1);
                let i = level * ANGLES + angle;
                self.radii[i] = (0.5 * old[i] + 0.125 * around).max(closest[i]);
            }
        }
    }

    /// Radius at a height \[m\] and an angle \[radians\]; held above the waist and below the hem.
    fn radius(&self, height: f64, angle: f64) -> f64 {
        let level = ((WAIST_HEIGHT - height) / level_step()).clamp(0.0, (LEVELS - 1) as f64);
        let turn = (angle / TAU).rem_euclid(1.0) * ANGLES as f64;
        let (i, j) = ((level as usize).min(LEVELS - 2), turn as usize);
        let (s, t) = (level - i as f64, turn - j as f64);
        let at = |i: usize, j: usize| self.radii[i * ANGLES + j % ANGLES];
        let upper = (1.0 - t) * at(i, j) + t * at(i, j + 1);
        let lower = (1.0 - t) * at(i + 1, j) + t * at(i + 1, j + 1);
        (1.0 - s) * upper + s * lower
    }

    fn point(&self, height: f64, angle: f64) -> Vec3 {
        let radius = self.radius(height, angle);
        Vec3::new(radius * angle.sin(), height, AXIS_Z + radius * angle.cos())
    }

    /// Signed distance \[m\], to first order, to the solid inside the skirt.
    pub fn distance(&self, p: &Vec3) -> f64 {
        let (x, z) = (p.x, p.z - AXIS_Z);
        let angle = x.atan2(z);
        let step = 2.0 * level_step();
        let height = p.y.clamp(HEM_HEIGHT + step, WAIST_HEIGHT - step);
        let slope = (self.radius(height - step, angle) - self.radius(height + step, angle)) / (2.0 * step);
        let sideways = (x.hypot(z) - self.radius(p.y, angle)) / (1.0 + slope * slope).sqrt();
        sideways.max(p.y - WAIST_HEIGHT)
    }
}

fn level_step() -> f64 {
    (WAIST_HEIGHT - HEM_HEIGHT) / (LEVELS - 1) as f64
}

fn level_height(level: usize) -> f64 {
    WAIST_HEIGHT - level as f64 * level_step()
}

/// Outermost radius at which a ray from the axis is [`WAIST_GAP`] off the body: walks in from outside by the distance.
fn body_radius(limbs: &[Limb], height: f64, angle: f64) -> f64 {
    let mut radius: f64 = 0.5;
    for _ in 0..200 {
        let p = Vec3::new(radius * angle.sin(), height, AXIS_Z + radius * angle.cos());
        let distance = union(limbs, &p) - WAIST_GAP;
        if distance < 1e-7 || radius <= 0.0 {
            break;
        }
        radius -= 0.9 * distance;
    }
    radius.max(0.0)
}

/// The skirt as quads with edges of about `edge` \[m\] in the mean.
pub fn skirt(shape: &Skirt, edge: f64) -> Garment {
    let middle = 0.5 * (WAIST_HEIGHT + HEM_HEIGHT);
    // Columns are counted from the back, where the seam of the texture coordinates is.
    let table_angle = |i: f64| i * TAU / ANGLES as f64 + std::f64::consts::PI;
    let around = arc_lengths(ANGLES, |i| shape.point(middle, table_angle(i as f64)));
    let down = arc_lengths(LEVELS - 1, |i| shape.point(level_height(i), 0.25 * TAU));
    let (girth, length) = (around[ANGLES], down[LEVELS - 1]);
    let columns = (girth / edge).round().max(8.0) as usize;
    let rows = (length / edge).round().max(4.0) as usize;
    let mut points = Vec::with_capacity((rows + 1) * columns);
    let mut uvs = Vec::with_capacity((rows + 1) * (columns + 1));
    for row in 0..=rows {
        let fallen = length * row as f64 / rows as f64;
        let height = WAIST_HEIGHT - inverse(&down, fallen) * level_step();
        for column in 0..=columns {
            let turned = girth * column as f64 / columns as f64;
            if column < columns {
                points.push(shape.point(height, table_angle(inverse(&around, turned))));
            }
            uvs.push([turned, length - fallen]);
        }
    }
    let band = (BAND * rows as f64 / length).ceil() as usize;
    let mut face_sets = vec![("waistband", Vec::new()), ("body", Vec::new()), ("hem", Vec::new())];
    let (mut faces, mut uv_corners) = (Vec::new(), Vec::new());
    for row in 0..rows {
        let set = if row < band { 0 } else { 1 + usize::from(row >= rows - band) };
        for column in 0..columns {
            face_sets[set].1.push(faces.len());
            let corners = |stride: usize, next: usize| {
                let (upper, lower) = (row * stride, (row + 1) * stride);
                vec![upper + column, lower + column, lower + next, upper + next]
            };
            faces.push(corners(columns, (column + 1) % columns));
            uv_corners.push(corners(columns + 1, column + 1));
        }
    }
    let mesh = SurfaceMesh { points, faces };
    let waist_ring = (0..columns).collect();
    Garment { name: "skirt", mesh, uvs, uv_corners, face_sets, waist_ring }
}

/// Lengths along a polyline from its first point to each of its `count` + 1 points.
fn arc_lengths(count: usize, point: impl Fn(usize) -> Vec3) -> Vec<f64> {
    let mut total = 0.0;
    let mut lengths = vec![0.0];
    for i in 0..count {
        total += (point(i + 1) - point(i)).norm();
        lengths.push(total);
    }
    lengths
}

/// Place, in points, at which an increasing table takes `value`.
fn inverse(table: &[f64], value: f64) -> f64 {
    let i = table.partition_point(|&entry| entry <= value).clamp(1, table.len() - 1) - 1;
    i as f64 + (value - table[i]) / (table[i + 1] - table[i])
}

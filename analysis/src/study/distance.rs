//! Distance between two runs at a frame. Where their meshes differ, points correspond by their places in the rest
//! shape.

use drapery_core::Vec3;
use drapery_core::geometry::bvh::Bvh;
use drapery_core::geometry::distance::closest_on_triangle;

use crate::study::cloth::{Cloth, FrameState, percentile};
use crate::study::record::Distance;

/// Distance of two states of the same points; `areas` are those of the vertices [m²].
pub(super) fn between(areas: &[f64], a: &FrameState, b: &FrameState) -> Distance {
    let mut distances: Vec<f64> = a.positions.iter().zip(&b.positions).map(|(a, b)| (a - b).norm()).collect();
    let (rms, velocity_rms) =
        (weighted_rms(areas, &a.positions, &b.positions), weighted_rms(areas, &a.velocities, &b.velocities));
    distances.sort_by(f64::total_cmp);
    let [max, p99] = [1.0, 0.99].map(|share| percentile(&distances, share));
    Distance { rms, p99, max, velocity_rms, ..Distance::default() }
}

/// Root of the area-weighted mean of the squared angles between normals of a mesh at two states [rad]; weights are the
/// rest areas of the triangles.
pub(super) fn normals(cloth: &Cloth, a: &FrameState, b: &FrameState) -> f64 {
    let normal = |x: &[Vec3], [i, j, k]: [u32; 3]| {
        let [p, q, r] = [i, j, k].map(|v| x[v as usize]);
        (q - p).cross(&(r - p))
    };
    let (mut sum, mut whole) = (0.0, 0.0);
    for corners in &cloth.triangles {
        let [m, n] = [a, b].map(|state| normal(&state.positions, *corners));
        let area = normal(&cloth.rest, *corners).norm();
        sum += area * m.cross(&n).norm().atan2(m.dot(&n)).powi(2);
        whole += area;
    }
    (sum / f64::max(whole, f64::MIN_POSITIVE)).sqrt()
}

/// Root of the weighted mean of squared distances.
fn weighted_rms(areas: &[f64], a: &[Vec3], b: &[Vec3]) -> f64 {
    let whole: f64 = areas.iter().sum();
    let sum: f64 = a.iter().zip(b).zip(areas).map(|((a, b), area)| area * (a - b).norm_squared()).sum();
    (sum / whole.max(f64::MIN_POSITIVE)).sqrt()
}

/// Place of each vertex of a mesh on another mesh of the same rest shape.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MeshMap {
    /// Triangle of the other mesh, and weights of its corners.
    places: Vec<(u32, [f64; 3])>,
}

impl MeshMap {
    /// Finds the places of the vertices of `onto` on `from`, garment by garment in the rest shape; `None` if they have not
    /// the same garments.
    pub(super) fn new(from: &Cloth, onto: &Cloth) -> Option<Self> {
        if from.garments.len() != onto.garments.len() {
            return None;
        }
        let boxes = from.boxes(&from.rest);
        let mut places = Vec::with_capacity(onto.rest.len());
        for (ends, own) in from.garments.windows(2).zip(onto.garments.windows(2)) {
            let first = ends[0][0];
            let tree = Bvh::build(&boxes[first..ends[1][0]]);
            for vertex in own[0][1]..own[1][1] {
                let point = onto.rest[vertex];
                let squared = |t: u32| from.distance_squared(&from.rest, t + first as u32, &point);
                let (triangle, _) = tree.nearest(&point, f64::MAX.sqrt(), None, squared)?;
                let triangle = triangle + first as u32;
                let corners = from.triangles[triangle as usize].map(|v| from.rest[v as usize]);
                places.push((triangle, closest_on_triangle(&point, &corners).weights));
            }
        }
        Some(Self { places })
    }

    /// The state of `from` at the vertices of `onto`.
    pub(super) fn carry(&self, from: &Cloth, state: &FrameState) -> FrameState {
        let at = |values: &[Vec3]| -> Vec<Vec3> {
            let place = |(triangle, weights): &(u32, [f64; 3])| {
                let corners = from.triangles[*triangle as usize].map(|v| values[v as usize]);
                corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
            };
            self.places.iter().map(place).collect()
        };
        FrameState { positions: at(&state.positions), velocities: at(&state.velocities) }
    }
}

/// Largest distance from a vertex of either surface to the other one [m].
pub(super) fn surfaces(a: (&Cloth, &FrameState), b: (&Cloth, &FrameState)) -> f64 {
    let one_way = |(points, _): (&FrameState, ()), (cloth, state): (&Cloth, &FrameState)| {
        let x = &state.positions;
        let tree = Bvh::build(&cloth.boxes(x));
        let squared = |point: &Vec3| {
            let nearest = tree.nearest(point, f64::MAX.sqrt(), None, |t| cloth.distance_squared(x, t, point));
            nearest.map_or(0.0, |(_, squared)| squared)
        };
        points.positions.iter().map(squared).fold(0.0, f64::max)
    };
    one_way((a.1, ()), b).max(one_way((b.1, ()), a)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of `cells` squares over 1 m by 0.1 m.
    fn strip(cells: usize) -> Cloth {
        let at = |i: usize| Vec3::new((i / 2) as f64 / cells as f64, 0.0, 0.1 * (i % 2) as f64);
        let squares =
            (0..cells as u32).flat_map(|c| [[2 * c, 2 * c + 1, 2 * c + 2], [2 * c + 1, 2 * c + 3, 2 * c + 2]]);
        let rest: Vec<Vec3> = (0..2 * (cells + 1)).map(at).collect();
        let triangles: Vec<[u32; 3]> = squares.collect();
        let garments = vec![[0, 0], [triangles.len(), rest.len()]];
        let areas = vec![1.0; rest.len()];
        Cloth::with(rest, triangles, garments, areas)
    }

    fn state(cloth: &Cloth, place: impl Fn(&Vec3) -> Vec3) -> FrameState {
        let positions: Vec<Vec3> = cloth.rest.iter().map(place).collect();
        FrameState { velocities: positions.clone(), positions }
    }

    #[test]
    fn a_shift_has_its_length_in_every_norm_and_areas_weigh() {
        let cloth = strip(4);
        let (here, there) = (state(&cloth, |p| *p), state(&cloth, |p| p + Vec3::new(0.0, 0.3, 0.4)));
        let found = between(&cloth.areas, &here, &there);
        for value in [found.rms, found.p99, found.max, found.velocity_rms] {
            assert!((value - 0.5).abs() < 1e-12, "{found:?}");
        }
        // One vertex of ten is off by 1 m and has three quarters of the area.
        let mut off = here.clone();
        off.positions[0].y += 1.0;
        let mut areas = vec![1.0 / 36.0; 10];
        areas[0] = 0.75;
        assert!((between(&areas, &here, &off).rms - 0.75_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn normals_turn_with_the_cloth_and_do_not_care_where_it_is() {
        let cloth = strip(4);
        let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::x_axis(), 0.5);
        let (here, moved) = (state(&cloth, |p| *p), state(&cloth, |p| p + Vec3::y()));
        let turned = state(&cloth, |p| turn * p);
        assert_eq!(normals(&cloth, &here, &moved), 0.0);
        assert!((normals(&cloth, &here, &turned) - 0.5).abs() < 1e-12);
        // Half of the strip upside down.
        let folded = state(&cloth, |p| Vec3::new(if p.x > 0.5 { 1.0 - p.x } else { p.x }, 0.0, p.z));
        let expected = std::f64::consts::PI * 0.5_f64.sqrt();
        assert!((normals(&cloth, &here, &folded) - expected).abs() < 1e-12);
    }

    #[test]
    fn meshes_of_one_rest_shape_that_move_alike_do_not_differ() {
        let (coarse, fine) = (strip(3), strip(12));
        let bend = |p: &Vec3| Vec3::new(p.x, 0.2 * p.x, p.z);
        let (on_coarse, on_fine) = (state(&coarse, bend), state(&fine, bend));
        let map = MeshMap::new(&coarse, &fine).unwrap();
        let carried = map.carry(&coarse, &on_coarse);
        assert!(between(&fine.areas, &carried, &on_fine).max < 1e-12);
        assert!(surfaces((&coarse, &on_coarse), (&fine, &on_fine)) < 1e-12);
    }

    #[test]
    fn the_distance_of_surfaces_is_that_of_hausdorff() {
        let (a, b) = (strip(3), strip(5));
        // Sliding along itself by 0.25 m leaves the ends apart, and nothing else.
        let found = surfaces((&a, &state(&a, |p| *p)), (&b, &state(&b, |p| p + Vec3::x() * 0.25)));
        assert!((found - 0.25).abs() < 1e-12, "{found}");
    }
}

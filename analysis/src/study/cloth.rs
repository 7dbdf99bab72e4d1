//! All garments of a simulation as one surface, and what a study measures of it at a frame.

use drapery_core::Vec3;
use drapery_core::geometry::aabb::Aabb;
use drapery_core::geometry::bvh::Bvh;
use drapery_core::geometry::distance::closest_on_triangle;
use drapery_core::simulation::{FrameSummary, Simulation};

use crate::study::record::Figures;

/// Angles from which an edge counts as a fold [degrees].
pub(super) const FOLDS: [f64; 3] = [30.0, 60.0, 90.0];

/// Cells of the drape area along the size of the cloth.
const CELLS: f64 = 256.0;

/// A vertex lies on a body when it is no farther above its thickness than this share of an edge.
const ON_BODY: f64 = 0.01;

/// Share of an edge beyond which cloth does not count as lying on cloth: next triangles of flat cloth are farther apart.
const ON_CLOTH: f64 = 0.5;

/// Edges within which the deepest vertex in a body is looked for.
const DEPTH: f64 = 10.0;

/// Positions and velocities of all garments at a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct FrameState {
    /// Positions [m], garment after garment in their own orders.
    pub positions: Vec<Vec3>,
    /// Velocities [m/s], likewise.
    pub velocities: Vec<Vec3>,
}

/// All garments as one surface, in the order of the solver.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Cloth {
    /// Rest positions [m].
    pub rest: Vec<Vec3>,
    /// Triangles of all garments.
    pub triangles: Vec<[u32; 3]>,
    /// First triangle and first vertex of each garment, and their numbers at the end.
    pub garments: Vec<[usize; 2]>,
    /// Rest area of each vertex [m²]: a third of that of its triangles.
    pub areas: Vec<f64>,
    /// Mass of each vertex [kg].
    pub masses: Vec<f64>,
    /// Ends and rest length [m] of each edge.
    edges: Vec<([u32; 2], f64)>,
    /// Edge and triangles of each hinge, and its angle at rest.
    hinges: Vec<(u32, [u32; 2], f64)>,
    /// Mean rest length of the edges [m].
    pub edge: f64,
    /// Size of the cells of the drape area [m].
    cell: f64,
    /// Distance within which cloth lies on cloth [m].
    touch: f64,
}

impl Cloth {
    /// The cloth of a simulation on one rank; `size` is that of the cloth at the start [m], `thickness` that of the
    /// thinnest garment [m].
    pub(super) fn of(simulation: &Simulation, size: f64, thickness: f64) -> Self {
        let scene = simulation.scene();
        let masses = scene.masses().to_vec();
        let mut cloth = Self { masses, garments: vec![[0, 0]], cell: size / CELLS, ..Self::default() };
        for (garment, mesh) in scene.meshes().iter().enumerate() {
            let first = scene.parts().garment(garment).start as u32;
            let (edge, triangle) = (cloth.edges.len() as u32, cloth.triangles.len() as u32);
            cloth.rest.extend(mesh.rest_positions());
            cloth.triangles.extend(mesh.triangles().iter().map(|corners| corners.map(|v| v + first)));
            let ends = |edge: &drapery_core::mesh::Edge| edge.vertices.map(|v| v + first);
            cloth.edges.extend(mesh.edges().iter().map(|edge| (ends(edge), mesh.rest_length(*edge))));
            let hinges =
                mesh.hinges().into_iter().map(|hinge| (hinge.edge + edge, hinge.triangles.map(|t| t + triangle), 0.0));
            cloth.hinges.extend(hinges);
            cloth.areas.resize(cloth.rest.len(), 0.0);
            for (corners, area) in mesh.triangles().iter().zip(mesh.rest_areas()) {
                corners.iter().for_each(|v| cloth.areas[(v + first) as usize] += area / 3.0);
            }
            cloth.garments.push([cloth.triangles.len(), cloth.rest.len()]);
        }
        let rest = cloth.rest.clone();
        let angles: Vec<f64> = cloth.hinges.iter().map(|(_, triangles, _)| cloth.angle(&rest, *triangles)).collect();
        cloth.hinges.iter_mut().zip(angles).for_each(|(hinge, angle)| hinge.2 = angle);
        cloth.edge = cloth.edges.iter().map(|(_, length)| length).sum::<f64>() / cloth.edges.len().max(1) as f64;
        cloth.touch = thickness.min(ON_CLOTH * cloth.edge);
        cloth
    }

    /// A surface that is only compared: rest positions [m], triangles, garments and areas of vertices [m²].
    pub(super) fn with(rest: Vec<Vec3>, triangles: Vec<[u32; 3]>, garments: Vec<[usize; 2]>, areas: Vec<f64>) -> Self {
        Self { rest, triangles, garments, areas, ..Self::default() }
    }

    /// Whether points of both correspond one to one.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        self.triangles == other.triangles && self.rest == other.rest
    }

    /// Angle between the normals of two triangles.
    fn angle(&self, x: &[Vec3], triangles: [u32; 2]) -> f64 {
        let normal = |triangle: u32| {
            let [a, b, c] = self.triangles[triangle as usize].map(|v| x[v as usize]);
            (b - a).cross(&(c - a))
        };
        let [m, n] = triangles.map(normal);
        m.cross(&n).norm().atan2(m.dot(&n))
    }

    /// Boxes around the triangles.
    pub(super) fn boxes(&self, x: &[Vec3]) -> Vec<Aabb> {
        let around = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|v| x[v as usize]);
            Aabb::of_segment(&a, &b).union(&Aabb::of_point(&c))
        };
        self.triangles.iter().map(around).collect()
    }

    /// Squared distance of a point from a triangle [m²].
    pub(super) fn distance_squared(&self, x: &[Vec3], triangle: u32, point: &Vec3) -> f64 {
        let corners = self.triangles[triangle as usize].map(|v| x[v as usize]);
        (closest_on_triangle(point, &corners).point - point).norm_squared()
    }

    /// Everything that is measured of a frame: of a state of all vertices, and of what rank 0 knows of the rest.
    pub(super) fn measure(&self, simulation: &Simulation, state: &FrameState, summary: &FrameSummary) -> Figures {
        let (x, v) = (&state.positions, &state.velocities);
        let mass: f64 = self.masses.iter().sum();
        let weighted = |of: &[Vec3]| -> Vec3 { of.iter().zip(&self.masses).map(|(of, mass)| of * *mass).sum() };
        let (on_cloth, gap) = self.on_cloth(x);
        let (on_bodies, depth) = self.on_bodies(simulation, x);
        Figures {
            kinetic_energy: summary.kinetic_energy,
            potential_energy: summary.potential_energy,
            centre: (weighted(x) / mass).into(),
            momentum: weighted(v).into(),
            strain: self.strain(x),
            drape_area: self.drape_area(x),
            folds: self.folds(x),
            contact_area: [on_bodies, on_cloth],
            gap,
            depth,
            crossings: simulation.crossings().len() as u64,
        }
    }

    /// Largest and 99th percentile of the extension of edges.
    fn strain(&self, x: &[Vec3]) -> [f64; 2] {
        let length = |[a, b]: [u32; 2]| (x[a as usize] - x[b as usize]).norm();
        let mut strains: Vec<f64> = self.edges.iter().map(|(ends, rest)| length(*ends) / rest - 1.0).collect();
        strains.sort_by(f64::total_cmp);
        [1.0, 0.99].map(|share| percentile(&strains, share))
    }

    /// Length of the folds sharper than each of [`FOLDS`], beyond the angle at rest [m].
    fn folds(&self, x: &[Vec3]) -> [f64; 3] {
        let mut lengths = [0.0; 3];
        for (edge, triangles, rest) in &self.hinges {
            let [a, b] = self.edges[*edge as usize].0;
            let (length, angle) = ((x[a as usize] - x[b as usize]).norm(), (self.angle(x, *triangles) - rest).abs());
            for (sum, limit) in lengths.iter_mut().zip(FOLDS) {
                *sum += if angle > limit.to_radians() { length } else { 0.0 };
            }
        }
        lengths
    }

    /// Area of the shadow of the cloth under a light straight above [m²], counted in cells.
    fn drape_area(&self, x: &[Vec3]) -> f64 {
        let flat = |v: u32| [x[v as usize].x / self.cell, x[v as usize].z / self.cell];
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for v in 0..x.len() as u32 {
            for (axis, place) in flat(v).into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(place.floor()), high[axis].max(place.ceil()));
            }
        }
        let sides = [0, 1].map(|axis| (high[axis] - low[axis]).max(1.0) as usize);
        // Cloth that was thrown far apart has no drape area worth counting.
        if sides[0].saturating_mul(sides[1]) > (4.0 * CELLS * 4.0 * CELLS) as usize {
            return 0.0;
        }
        let mut covered = vec![false; sides[0] * sides[1]];
        for corners in &self.triangles {
            let places = corners.map(|v| [0, 1].map(|axis| flat(v)[axis] - low[axis]));
            cover(&mut covered, sides, places);
        }
        covered.iter().filter(|cell| **cell).count() as f64 * self.cell * self.cell
    }

    /// Area of the cloth that lies on bodies [m²], and how deep the deepest vertex is in one [m].
    fn on_bodies(&self, simulation: &Simulation, x: &[Vec3]) -> (f64, f64) {
        let bodies = simulation.bodies();
        let (mut area, mut depth) = (0.0, 0.0_f64);
        for (x, own) in x.iter().zip(&self.areas) {
            let mut touches = false;
            for (body, description) in simulation.scene().description().bodies.iter().enumerate() {
                let reach = (DEPTH * self.edge).max(2.0 * description.thickness);
                let Some(at) = bodies.closest(body, x, x, reach, None) else { continue };
                touches |= at.phi <= description.thickness + ON_BODY * self.edge;
                depth = depth.max(-at.phi);
            }
            area += if touches { *own } else { 0.0 };
        }
        (area, depth)
    }

    /// Area of the cloth that lies on cloth [m²], and the smallest distance of a vertex from a triangle of which it is no
    /// corner, up to twice what counts as lying on it [m].
    fn on_cloth(&self, x: &[Vec3]) -> (f64, Option<f64>) {
        let tree = Bvh::build(&self.boxes(x));
        let (mut area, mut gap) = (0.0, f64::INFINITY);
        for (vertex, point) in x.iter().enumerate() {
            let is_corner = |triangle: u32| self.triangles[triangle as usize].contains(&(vertex as u32));
            let distance = |triangle: u32| {
                if is_corner(triangle) { f64::INFINITY } else { self.distance_squared(x, triangle, point) }
            };
            let Some((_, squared)) = tree.nearest(point, 2.0 * self.touch, None, distance) else { continue };
            let distance = squared.sqrt();
            gap = gap.min(distance);
            area += if distance <= self.touch { self.areas[vertex] } else { 0.0 };
        }
        (area, gap.is_finite().then_some(gap))
    }
}

/// Marks the cells whose middle lies in a triangle.
fn cover(covered: &mut [bool], sides: [usize; 2], [a, b, c]: [[f64; 2]; 3]) {
    let side = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let span = |axis: usize| {
        let values = [a[axis], b[axis], c[axis]];
        let low = values.into_iter().fold(f64::INFINITY, f64::min).max(0.0) as usize;
        low..(values.into_iter().fold(0.0, f64::max).ceil() as usize).min(sides[axis])
    };
    for row in span(1) {
        for column in span(0) {
            let middle = [column as f64 + 0.5, row as f64 + 0.5];
            let signs = [side(a, b, middle), side(b, c, middle), side(c, a, middle)];
            if signs.iter().all(|s| *s >= 0.0) || signs.iter().all(|s| *s <= 0.0) {
                covered[row * sides[0] + column] = true;
            }
        }
    }
}

/// The value of sorted ones that a share of them does not exceed; zero of none.
pub(super) fn percentile(sorted: &[f64], share: f64) -> f64 {
    let place = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(place.saturating_sub(1)).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of side 1 m of two triangles, folded along its diagonal by `angle` [degrees], and lying flat otherwise.
    fn folded(angle: f64) -> (Cloth, Vec<Vec3>) {
        let rest = vec![Vec3::zeros(), Vec3::x(), Vec3::x() + Vec3::z(), Vec3::z()];
        let cloth = Cloth {
            triangles: vec![[0, 2, 1], [0, 3, 2]],
            edges: vec![([0, 2], 2.0_f64.sqrt()), ([0, 1], 1.0)],
            hinges: vec![(0, [0, 1], 0.0)],
            areas: vec![1.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0],
            cell: 1.0 / 256.0,
            touch: 0.1,
            rest: rest.clone(),
            ..Cloth::default()
        };
        let axis = nalgebra::Unit::new_normalize(rest[2]);
        let turn = nalgebra::Rotation3::from_axis_angle(&axis, angle.to_radians());
        (cloth, vec![rest[0], rest[1], rest[2], turn * rest[3]])
    }

    #[test]
    fn a_fold_counts_with_its_length_from_its_angle_on() {
        let (cloth, x) = folded(70.0);
        let folds = cloth.folds(&x);
        assert!((folds[0] - 2.0_f64.sqrt()).abs() < 1e-12 && folds[1] == folds[0] && folds[2] == 0.0, "{folds:?}");
        assert_eq!(folded(0.0).0.folds(&folded(0.0).1), [0.0; 3]);
    }

    #[test]
    fn the_drape_area_is_that_of_the_shadow() {
        let (cloth, x) = folded(0.0);
        // The error is that of cells along the outline: less than one cell of 1/256 m along 4 m.
        assert!((cloth.drape_area(&x) - 1.0).abs() < 4.0 / 256.0, "{}", cloth.drape_area(&x));
        // Folded by 180 degrees one half lies on the other.
        let (cloth, x) = folded(180.0);
        assert!((cloth.drape_area(&x) - 0.5).abs() < 4.0 / 256.0, "{}", cloth.drape_area(&x));
    }

    #[test]
    fn cloth_on_cloth_is_found_with_its_gap() {
        let (cloth, mut x) = folded(0.0);
        assert_eq!(cloth.on_cloth(&x), (0.0, None));
        // The third corner of the one triangle 5 cm above the middle of the other.
        x[3] = Vec3::new(2.0 / 3.0, 0.05, 1.0 / 3.0);
        let (area, gap) = cloth.on_cloth(&x);
        assert!((gap.unwrap() - 0.05).abs() < 1e-12, "{gap:?}");
        assert!((area - 1.0 / 6.0).abs() < 1e-12, "{area}");
    }

    #[test]
    fn strain_is_extension_by_rest_length() {
        let (cloth, mut x) = folded(0.0);
        x[1].x = 1.25;
        assert!((cloth.strain(&x)[0] - 0.25).abs() < 1e-12);
        assert_eq!(percentile(&[1.0, 2.0, 3.0, 4.0], 0.5), 2.0);
        assert_eq!(percentile(&[], 0.5), 0.0);
    }
}

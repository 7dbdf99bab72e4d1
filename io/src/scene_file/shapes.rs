//! Generated garments: the authors' panel, disc, sphere, tube, and a cloud of small panels.
//!
//! All are triangles in metres, with texture coordinates in metres along the cloth where the shape can be unrolled. The
//! same numbers give the same bytes on every machine.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use drapery_core::Vec3;
use drapery_core::geometry::rotation::rotation_by;
use drapery_core::mesh::PolygonMesh;
use nalgebra::{Rotation3, Unit, UnitQuaternion};

use super::random::Random;
use super::raw::{Ball, Disc, Garment, Leaves, MAX_RESOLUTION, Panel, PanelShape, Rotation, Tube};

/// A generated mesh as a whole.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    pub(super) mesh: PolygonMesh,
    /// One texture coordinate per point.
    pub(super) uvs: Vec<[f64; 2]>,
}

/// Takes a point and its texture coordinate.
type TakePoint<'a> = &'a mut dyn FnMut(Vec3, [f64; 2]);

/// Takes the corners of a triangle.
type TakeTriangle<'a> = &'a mut dyn FnMut([u32; 3]);

/// Shape that is generated.
#[derive(Debug, Clone)]
pub(super) enum Form {
    Panel(Panel),
    Disc(Disc),
    Sphere(Ball),
    Tube(Tube),
    Leaves(Box<Cloud>),
}

impl Form {
    /// Returns the shape that a garment is generated from; `None` for one from a file.
    pub(super) fn of(garment: &Garment) -> Option<Self> {
        let Garment { panel, disc, sphere, tube, leaves, .. } = garment;
        let first =
            panel.map(Self::Panel).or(disc.map(Self::Disc)).or(sphere.map(Self::Sphere)).or(tube.map(Self::Tube));
        first.or_else(|| leaves.map(|leaves| Self::Leaves(Box::new(Cloud::of(leaves)))))
    }

    /// Gives the points in their order.
    pub(super) fn points(&self, take: TakePoint<'_>) {
        match self {
            Self::Panel(panel) => panel_points(panel, take),
            Self::Disc(disc) => disc_points(disc, take),
            Self::Sphere(ball) => sphere_points(ball, take),
            Self::Tube(tube) => tube_points(tube, take),
            Self::Leaves(cloud) => cloud.points(take),
        }
    }

    /// Gives the triangles in their order.
    pub(super) fn triangles(&self, take: TakeTriangle<'_>) {
        match self {
            Self::Panel(panel) => herring_bone(cells(panel), take),
            Self::Disc(disc) => disc_triangles(disc, take),
            Self::Sphere(ball) => sphere_triangles(ball, take),
            Self::Tube(tube) => tube_triangles(tube, take),
            Self::Leaves(cloud) => cloud.triangles(take),
        }
    }

    /// Nodes along x (fastest) and z, if the points form one grid.
    pub(super) fn grid(&self) -> Option<[u32; 2]> {
        let Self::Panel(panel) = self else { return None };
        Some(cells(panel).map(|count| count + 1))
    }

    /// All of it.
    pub(super) fn shape(&self) -> Shape {
        let mut shape = Shape { mesh: PolygonMesh::default(), uvs: Vec::new() };
        self.points(&mut |point, uv| {
            shape.mesh.points.push(point);
            shape.uvs.push(uv);
        });
        self.triangles(&mut |corners| {
            shape.mesh.face_counts.push(3);
            shape.mesh.face_indices.extend(corners);
        });
        shape
    }
}

/// Rotation as a matrix; an axis of no direction turns nothing (the caller refuses it before).
fn turn(rotation: Option<Rotation>) -> Rotation3<f64> {
    let Some(Rotation { axis, degrees }) = rotation else {
        return Rotation3::identity();
    };
    Unit::try_new(Vec3::from(axis), 0.0)
        .map_or_else(UnitQuaternion::identity, |axis| rotation_by(&(*axis * degrees.to_radians())))
        .to_rotation_matrix()
}

/// Cells along x of a panel with `resolution` cells along z: floor(aspect · resolution).
fn columns(aspect: f64, resolution: u32) -> u32 {
    // 2.3 · 100 is a hair below 230 in binary; the artist means 230.
    ((aspect * f64::from(resolution) + 1e-9).floor() as u32).max(1)
}

/// Cells of a panel along x and z.
fn cells(panel: &Panel) -> [u32; 2] {
    [columns(panel.aspect, panel.resolution), panel.resolution]
}

/// The authors' panel: nodes with i (along x) fastest, node (i, j) at (i dx, 0.5, j dy), diagonals in a herring-bone by
/// the parity of i. With a centre or a rotation its bounding box is first moved to the origin.
fn panel_points(panel: &Panel, take: TakePoint<'_>) {
    if panel.center.is_none() && panel.rotation.is_none() {
        return unplaced_panel(panel, take);
    }
    let mut bounds: Option<[Vec3; 2]> = None;
    unplaced_panel(panel, &mut |p, _| {
        bounds = Some(bounds.map_or([p, p], |[low, high]| [low.inf(&p), high.sup(&p)]));
    });
    let [low, high] = bounds.unwrap_or_default();
    let (middle, turn) = ((low + high) / 2.0, turn(panel.rotation));
    let center = Vec3::from(panel.center.unwrap_or_default());
    unplaced_panel(panel, &mut |p, uv| take(turn * (p - middle) + center, uv));
}

fn unplaced_panel(panel: &Panel, take: TakePoint<'_>) {
    let [m, n] = cells(panel);
    let dx = panel.aspect * panel.side / f64::from(m);
    let dy = panel.side / f64::from(n);
    let bend: Vec<[f64; 2]> = match panel.shape {
        PanelShape::Flat => (0..=m).map(|i| [f64::from(i) * dx, 0.5]).collect(),
        PanelShape::Parabola => parabola(m),
    };
    let along_cloth = |i: u32| match panel.shape {
        PanelShape::Flat => f64::from(i) * dx,
        PanelShape::Parabola => f64::from(i) * distance(bend[0], bend[1]),
    };
    let z0 = if panel.shape == PanelShape::Parabola { -panel.side / 2.0 } else { 0.0 };
    for j in 0..=n {
        for (i, [x, y]) in bend.iter().enumerate() {
            take(Vec3::new(*x, *y, z0 + f64::from(j) * dy), [along_cloth(i as u32), f64::from(j) * dy]);
        }
    }
}

/// Triangles of a grid of m by n cells: the diagonal of a cell joins (i+1, j) to (i, j+1) if i is even, else the
/// others.
fn herring_bone([m, n]: [u32; 2], take: TakeTriangle<'_>) {
    let node = |i: u32, j: u32| i + (m + 1) * j;
    for j in 0..n {
        for i in 0..m {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            split(i, [a, b, c, d]).into_iter().for_each(&mut *take);
        }
    }
}

/// The triangles of a cell of column i.
fn split(i: u32, [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    if i.is_multiple_of(2) { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// Points x, y on the parabola y = 1.5 x², x in [-1, 1], at `cells` equal arc lengths, scaled by 0.25 (scene 32 of
/// Selle et al.). Arc length from 0: with u = 3x, s = (u √(1+u²) + asinh u) / 6.
fn parabola(cells: u32) -> Vec<[f64; 2]> {
    let arc = |x: f64| {
        let u = 3.0 * x;
        (u * libm::hypot(u, 1.0) + libm::asinh(u)) / 6.0
    };
    let full = arc(1.0);
    (0..=cells)
        .map(|i| {
            let target = full * (2.0 * f64::from(i) / f64::from(cells) - 1.0);
            // Newton on a convex increasing function; ds/dx = √(1+9x²) ≥ 1, so it converges from anywhere in a few
            // steps.
            let mut x = target / full;
            for _ in 0..20 {
                x -= (arc(x) - target) / libm::hypot(3.0 * x, 1.0);
            }
            [0.25 * x, 0.25 * 1.5 * x * x]
        })
        .collect()
}

/// A flat disc around the origin: ring k has 6k points. 6 N² triangles, 1 + 3 N (N + 1) points.
fn disc_points(disc: &Disc, take: TakePoint<'_>) {
    let (turn, center) = (turn(disc.rotation), Vec3::from(disc.center));
    let mut placed = |p: Vec3| take(turn * p + center, [p.x, -p.z]);
    placed(Vec3::zeros());
    for k in 1..=disc.resolution {
        let radius = disc.radius * f64::from(k) / f64::from(disc.resolution);
        for i in 0..6 * k {
            let (sin, cos) = libm::sincos(TAU * f64::from(i) / f64::from(6 * k));
            placed(Vec3::new(radius * cos, 0.0, -radius * sin));
        }
    }
}

fn disc_triangles(disc: &Disc, take: TakeTriangle<'_>) {
    let first = |k: u32| if k == 0 { 0 } else { 1 + 3 * k * (k - 1) };
    for k in 1..=disc.resolution {
        for sector in 0..6 {
            let outer = |i: u32| first(k) + (sector * k + i) % (6 * k);
            let inner = |i: u32| if k == 1 { 0 } else { first(k - 1) + (sector * (k - 1) + i) % (6 * (k - 1)) };
            for i in 0..k {
                take([outer(i), outer(i + 1), inner(i)]);
                if i + 1 < k {
                    take([inner(i), outer(i + 1), inner(i + 1)]);
                }
            }
        }
    }
}

/// Quarter of the points of ring k of a sphere.
fn ring(ball: &Ball, k: u32) -> u32 {
    k.min(2 * ball.resolution - k)
}

/// A closed sphere from an octahedron: ring k from the north pole has 4 min(k, 2N - k) points at equal angles.
/// 8 N² triangles, 4 N² + 2 points, counter-clockwise seen from outside.
fn sphere_points(ball: &Ball, take: TakePoint<'_>) {
    let (n, center) = (ball.resolution, Vec3::from(ball.center));
    for k in 0..=2 * n {
        let polar = FRAC_PI_2 * f64::from(k) / f64::from(n);
        let (ring_radius, height) = libm::sincos(polar);
        for i in 0..(4 * ring(ball, k)).max(1) {
            let angle = FRAC_PI_2 * f64::from(i) / f64::from(ring(ball, k).max(1));
            let (sin, cos) = libm::sincos(angle);
            let direction = Vec3::new(ring_radius * cos, height, -ring_radius * sin);
            take(direction * ball.radius + center, [angle * ball.radius, (PI - polar) * ball.radius]);
        }
    }
}

fn sphere_triangles(ball: &Ball, take: TakeTriangle<'_>) {
    let n = ball.resolution;
    let count = |k: u32| (4 * ring(ball, k)).max(1);
    let mut first = vec![0];
    (0..=2 * n).for_each(|k| first.push(first[k as usize] + count(k)));
    for k in 0..2 * n {
        let (narrow, wide) = if k < n { (k, k + 1) } else { (k + 1, k) };
        let at = |k: u32, sector: u32, i: u32| first[k as usize] + (sector * ring(ball, k) + i) % count(k);
        for sector in 0..4 {
            for i in 0..ring(ball, wide) {
                let base = [at(wide, sector, i), at(wide, sector, i + 1), at(narrow, sector, i)];
                take(if k < n { base } else { [base[1], base[0], base[2]] });
                if i + 1 < ring(ball, wide) {
                    let tip = [at(narrow, sector, i), at(wide, sector, i + 1), at(narrow, sector, i + 1)];
                    take(if k < n { tip } else { [tip[1], tip[0], tip[2]] });
                }
            }
        }
    }
}

/// Cells of a tube along its axis.
fn rows(tube: &Tube) -> u32 {
    let around = TAU * tube.radius;
    ((tube.length / around * f64::from(tube.resolution)).round() as u32).clamp(1, MAX_RESOLUTION)
}

/// A tube along y around the origin, `resolution` cells around and as many along as make them nearly square.
fn tube_points(tube: &Tube, take: TakePoint<'_>) {
    let (n, rows) = (tube.resolution, rows(tube));
    let (turn, center, around) = (turn(tube.rotation), Vec3::from(tube.center), TAU * tube.radius);
    for j in 0..=rows {
        let v = tube.length * f64::from(j) / f64::from(rows);
        for i in 0..n {
            let (sin, cos) = libm::sincos(TAU * f64::from(i) / f64::from(n));
            let point = Vec3::new(tube.radius * cos, v - tube.length / 2.0, -tube.radius * sin);
            take(turn * point + center, [around * f64::from(i) / f64::from(n), v]);
        }
    }
}

fn tube_triangles(tube: &Tube, take: TakeTriangle<'_>) {
    let n = tube.resolution;
    for j in 0..rows(tube) {
        for i in 0..n {
            let next = (i + 1) % n;
            split(i, [i + n * j, next + n * j, next + n * (j + 1), i + n * (j + 1)]).into_iter().for_each(&mut *take);
        }
    }
}

/// Distance that is kept between leaves, each way [m] (scene 35 of the authors).
const LEAF_MARGIN: f64 = 0.015;
/// Step by which the cells grow until no two leaves touch [m] (scene 35 of the authors).
const CELL_GROWTH: f64 = 0.01;

/// Panels in random orientations in a block of cells, merged into one mesh, centred over the origin.
#[derive(Debug, Clone)]
pub(super) struct Cloud {
    leaves: Leaves,
    turns: Vec<Rotation3<f64>>,
    /// Side of a cell [m].
    cell: f64,
}

impl Cloud {
    fn of(leaves: Leaves) -> Self {
        let Leaves { count, side, aspect, seed, max_angle, .. } = leaves;
        let mut random = Random::new(seed);
        let total = count.iter().product::<u32>();
        let turns: Vec<Rotation3<f64>> = (0..total).map(|_| random_tilt(&mut random, max_angle.to_radians())).collect();
        let half = Vec3::new(aspect * side / 2.0 + LEAF_MARGIN, LEAF_MARGIN, side / 2.0 + LEAF_MARGIN);
        let mut cell = CELL_GROWTH;
        while !disjoint(&turns, count, cell, half) {
            cell += CELL_GROWTH;
        }
        Self { leaves, turns, cell }
    }

    /// One of the panels, around the origin.
    fn leaf(&self) -> Panel {
        let Leaves { resolution, side, aspect, .. } = self.leaves;
        Panel { resolution, side, aspect, shape: PanelShape::Flat, center: Some([0.0; 3]), rotation: None }
    }

    fn points(&self, take: TakePoint<'_>) {
        let leaf = self.leaf();
        for (turn, index) in self.turns.iter().zip(0..) {
            let center =
                cell_center(index, self.leaves.count, self.cell) + Vec3::new(0.0, self.leaves.base_height, 0.0);
            panel_points(&leaf, &mut |p, uv| take(turn * p + center, uv));
        }
    }

    fn triangles(&self, take: TakeTriangle<'_>) {
        let cells = cells(&self.leaf());
        let points = cells.map(|count| count + 1).iter().product::<u32>();
        for index in 0..self.turns.len() as u32 {
            herring_bone(cells, &mut |corners| take(corners.map(|corner| corner + index * points)));
        }
    }
}

/// Centre of a cell relative to the middle of the lowest layer.
fn cell_center(index: u32, count: [u32; 3], cell: f64) -> Vec3 {
    let [i, j, k] = [index % count[0], (index / count[0]) % count[1], index / (count[0] * count[1])];
    let middle = |c: u32, of: u32| f64::from(c) - f64::from(of - 1) / 2.0;
    Vec3::new(middle(i, count[0]), f64::from(j), middle(k, count[2])) * cell
}

/// A rotation about a random direction by a random angle of at most `max_angle` [rad].
fn random_tilt(random: &mut Random, max_angle: f64) -> Rotation3<f64> {
    let axis = Unit::new_normalize(random.direction());
    rotation_by(&(*axis * (max_angle * random.unit()))).to_rotation_matrix()
}

/// Whether no two oriented boxes with half extents `half` overlap.
fn disjoint(turns: &[Rotation3<f64>], count: [u32; 3], cell: f64, half: Vec3) -> bool {
    let reach = 2.0 * half.norm();
    let centers: Vec<Vec3> = (0..turns.len()).map(|i| cell_center(i as u32, count, cell)).collect();
    (0..turns.len()).all(|a| {
        (a + 1..turns.len()).all(|b| {
            let apart = centers[b] - centers[a];
            apart.norm() > reach || separated(&turns[a], &turns[b], apart, half)
        })
    })
}

/// Separating axis test of two boxes of the same size.
fn separated(a: &Rotation3<f64>, b: &Rotation3<f64>, apart: Vec3, half: Vec3) -> bool {
    let axis_of = |r: &Rotation3<f64>, i: usize| r.matrix().column(i).into_owned();
    let extent = |r: &Rotation3<f64>, axis: &Vec3| (0..3).map(|i| half[i] * axis_of(r, i).dot(axis).abs()).sum::<f64>();
    let splits = |axis: Vec3| apart.dot(&axis).abs() > extent(a, &axis) + extent(b, &axis);
    (0..3).any(|i| splits(axis_of(a, i)) || splits(axis_of(b, i)))
        || (0..9).any(|k| splits(axis_of(a, k / 3).cross(&axis_of(b, k % 3))))
}

#[cfg(test)]
#[path = "shapes_tests.rs"]
mod tests;

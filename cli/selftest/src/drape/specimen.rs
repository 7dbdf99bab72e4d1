//! The specimen of a drape test: its mesh, how uneven it is before it hangs, and its shadow.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;

use super::Mounting;

/// Radius of the specimen [m].
pub(super) const SPECIMEN: f64 = 0.15;

/// Radius of the support [m].
pub(super) const SUPPORT: f64 = 0.09;

/// Side of a cell of the shadow [m].
const PIXEL: f64 = 2.5e-4;

/// Largest height at the start [m].
const UNEVENNESS: f64 = 2e-4;

/// Numbers of folds that the unevenness has: the rim of the coarsest specimen has 61 vertices.
const FOLDS: Range<u32> = 2..21;

/// Largest displacement of vertices off their regular places along a ring and across it, as a share of an edge.
const IRREGULARITY: f64 = 0.1;

/// Numbers between 0 and 1 drawn by a seed.
struct Draw(u32);

impl Draw {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(self.0 >> 8) / f64::from(1 << 24)
    }

    /// Between -1 and 1.
    fn either_way(&mut self) -> f64 {
        2.0 * self.next() - 1.0
    }
}

/// The part of the specimen that matters, as rings of nearly equilateral triangles, and the vertices of its rim.
///
/// Each mounting has a mesh of its own: rings are turned at random and vertices moved off their places. Of two rings the outer
/// one has five or six vertices more; where these are decides between that many folds and others, if nothing else does.
pub(super) fn specimen(cells: usize, mounting: Mounting) -> (PolygonMesh, Range<usize>) {
    let mut draw = Draw(2 * mounting.seed + u32::from(mounting.turned_over));
    for _ in 0..8 {
        draw.next(); // the first numbers of neighbouring seeds are alike
    }
    let width = (SPECIMEN - SUPPORT) / (cells as f64 + 0.5);
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    let mut before: Option<(usize, usize)> = None;
    for ring in 0..=cells + 1 {
        let radius = SUPPORT + (ring as f64 - 0.5) * width;
        // Height of an equilateral triangle over its side.
        let count = (TAU * radius / width * 0.75_f64.sqrt()).round() as usize;
        let first = points.len();
        let turn = draw.next();
        // What is held and the rim stay circles.
        let wavy = if (2..=cells).contains(&ring) { IRREGULARITY * width } else { 0.0 };
        points.extend((0..count).map(|n| {
            let angle = TAU * (turn + (n as f64 + IRREGULARITY * draw.either_way()) / count as f64);
            let (sin, cos) = angle.sin_cos();
            let radius = radius + wavy * draw.either_way();
            Vec3::new(radius * cos, 0.0, -radius * sin)
        }));
        if let Some(inner) = before {
            stitch(&points, inner, (first, count), &mut triangles);
        }
        before = Some((first, count));
    }
    let rim = before.map_or(0, |(first, _)| first)..points.len();
    (PolygonMesh::from_triangles(points, &triangles), rim)
}

/// Fills the gap between two rings (first vertex and number of vertices), always with the shorter of the two edges that may
/// come next.
fn stitch(points: &[Vec3], inner: (usize, usize), outer: (usize, usize), triangles: &mut Vec<[u32; 3]>) {
    let apart = |a: usize, b: usize| (points[a] - points[b]).norm();
    let nearest = |a: &usize, b: &usize| apart(inner.0 + a, outer.0).total_cmp(&apart(inner.0 + b, outer.0));
    let start = (0..inner.1).min_by(nearest).unwrap_or_default();
    let at_inner = |n: usize| inner.0 + (start + n) % inner.1;
    let at_outer = |n: usize| outer.0 + n % outer.1;
    let (mut i, mut o) = (0, 0);
    while i < inner.1 || o < outer.1 {
        let (a, b) = (at_inner(i), at_outer(o));
        let (next_in, next_out) = (at_inner(i + 1), at_outer(o + 1));
        let inwards = o == outer.1 || (i < inner.1 && apart(next_in, b) < apart(a, next_out));
        if inwards {
            triangles.push([a, b, next_in].map(|v| v as u32));
            i += 1;
        } else {
            triangles.push([a, b, next_out].map(|v| v as u32));
            o += 1;
        }
    }
}

/// The vertices that the support holds.
pub(super) fn inside(mesh: &PolygonMesh, cells: usize) -> Vec<u32> {
    let edge = SUPPORT + (SPECIMEN - SUPPORT) / (cells as f64 + 0.5);
    (0..mesh.points.len() as u32).filter(|v| mesh.points[*v as usize].norm() < edge).collect()
}

/// Heights at which the vertices of a specimen start [m], those of its other face turned over: a sum of folds of all numbers that
/// the coarsest mesh can show, as strong as each other, with phases drawn by the seed. It is a function of the place, so that all
/// meshes start from the same specimen.
pub(super) fn unevenness(points: &[Vec3], mounting: Mounting) -> Vec<f64> {
    let mut draw = Draw(mounting.seed);
    let phases: Vec<f64> = FOLDS.map(|_| TAU * draw.next()).collect();
    let side = if mounting.turned_over { -1.0 } else { 1.0 };
    let height = |at: &Vec3| {
        let free = ((at.norm() - SUPPORT) / (SPECIMEN - SUPPORT)).max(0.0);
        let angle = at.z.atan2(at.x);
        let sum: f64 = FOLDS.zip(&phases).map(|(n, phase)| (f64::from(n) * angle + phase).sin()).sum();
        side * free * UNEVENNESS * sum / f64::from(FOLDS.end - FOLDS.start)
    };
    points.iter().map(height).collect()
}

/// Area that the specimen shades from above, the support included [m²].
pub(super) fn shadow(mesh: &PolygonMesh, x: &[Vec3]) -> f64 {
    let side = (2.2 * SPECIMEN / PIXEL) as usize;
    let centre = |n: usize| (n as f64 + 0.5 - 0.5 * side as f64) * PIXEL;
    let cell = |at: f64| ((at / PIXEL + 0.5 * side as f64).max(0.0) as usize).min(side - 1);
    let mut shaded = vec![false; side * side];
    for corners in mesh.faces() {
        let [a, b, c] = [0, 1, 2].map(|n| x[corners[n] as usize]);
        let cross = |p: Vec3, q: Vec3, (u, w): (f64, f64)| (q.x - p.x) * (w - p.z) - (q.z - p.z) * (u - p.x);
        let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        for row in cell(low.z)..=cell(high.z) {
            for column in cell(low.x)..=cell(high.x) {
                let at = (centre(column), centre(row));
                let sides = [cross(a, b, at), cross(b, c, at), cross(c, a, at)];
                if sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0) {
                    shaded[row * side + column] = true;
                }
            }
        }
    }
    let of_support = |n: &usize| centre(n % side).hypot(centre(n / side)) < SUPPORT;
    let count = (0..side * side).filter(|n| shaded[*n] && !of_support(n)).count();
    count as f64 * PIXEL * PIXEL + PI * SUPPORT * SUPPORT
}

/// Number of times that the rim comes out beyond its mean radius.
pub(super) fn folds(rim: &[Vec3]) -> usize {
    let radii: Vec<f64> = rim.iter().map(|x| x.x.hypot(x.z)).collect();
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    (0..radii.len()).filter(|n| radii[*n] > mean && radii[(n + radii.len() - 1) % radii.len()] <= mean).count()
}

#[cfg(test)]
mod tests {
    use super::super::DENSITIES;
    use super::*;

    #[test]
    fn a_flat_specimen_has_the_shadow_of_its_disc() {
        for (cells, seed) in DENSITIES.into_iter().zip(1..) {
            let (mesh, rim) = specimen(cells, Mounting { seed, turned_over: seed == 2 });
            let share = shadow(&mesh, &mesh.points) / (PI * SPECIMEN * SPECIMEN);
            // A polygon in place of the circle, and the cells of the shadow.
            assert!((0.99..1.001).contains(&share), "{cells} cells: {share}");
            assert_eq!(rim.end, mesh.points.len());
            // A ring has one hole: as many edges as vertices and triangles together.
            assert_eq!(mesh.face_counts.len(), 2 * mesh.points.len() - rim.len() - rim_of_hole(&mesh, cells));
            let length = |a: u32, b: u32| (mesh.points[a as usize] - mesh.points[b as usize]).norm();
            let even = |c: &[u32]| {
                let edges = [length(c[0], c[1]), length(c[1], c[2]), length(c[2], c[0])];
                edges.iter().copied().fold(0.0, f64::max) < 2.0 * edges.iter().copied().fold(f64::INFINITY, f64::min)
            };
            assert!(mesh.faces().all(even), "a mesh without slivers");
        }
    }

    /// Vertices of the innermost ring.
    fn rim_of_hole(mesh: &PolygonMesh, cells: usize) -> usize {
        let radius = SUPPORT - 0.25 * (SPECIMEN - SUPPORT) / (cells as f64 + 0.5);
        mesh.points.iter().filter(|p| p.norm() < radius).count()
    }

    #[test]
    fn all_meshes_start_from_the_same_specimen() {
        let mounting = Mounting { seed: 1, turned_over: false };
        let at_rim = |cells: usize| {
            let (mesh, rim) = specimen(cells, mounting);
            let heights = unevenness(&mesh.points[rim.clone()], mounting);
            mesh.points[rim].iter().zip(heights).map(|(p, h)| (p.z.atan2(p.x), h)).collect::<Vec<_>>()
        };
        let coarse = at_rim(DENSITIES[0]);
        assert!(coarse.len() as u32 > 2 * FOLDS.end, "every number of folds can be seen");
        for cells in DENSITIES {
            let fine = at_rim(cells);
            assert!(fine.iter().all(|(_, h)| h.abs() <= UNEVENNESS));
            for (angle, height) in &coarse {
                let near = |(a, _): &&(f64, f64)| (a - angle).abs() < 0.005;
                assert!(fine.iter().filter(near).all(|(_, h)| (h - height).abs() < 0.1 * UNEVENNESS), "{cells} cells");
            }
            assert!(fine.iter().filter(|(a, _)| coarse.iter().any(|(b, _)| (a - b).abs() < 0.005)).count() > 0);
        }
        let points = &specimen(DENSITIES[0], mounting).0.points;
        let turned = unevenness(points, Mounting { turned_over: true, ..mounting });
        assert!(unevenness(points, mounting).iter().zip(turned).all(|(a, b)| *a == -b));
        assert_ne!(unevenness(points, mounting), unevenness(points, Mounting { seed: 2, ..mounting }));
    }
}

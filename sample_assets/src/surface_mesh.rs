//! Polygon meshes, and quads on the zero level of a field: surface nets, then projection and tangential smoothing.

use rayon::prelude::*;

use crate::sdf::{Field, Vec3, gradient, project};

/// Newton steps that bring a vertex back to the surface after each smoothing pass.
const PROJECTION_STEPS: usize = 4;

/// A polygon mesh; faces turn counter-clockwise seen from outside.
#[derive(Debug, Clone, Default)]
pub struct SurfaceMesh {
    /// Vertex positions \[m\].
    pub points: Vec<Vec3>,
    /// Vertices of each face.
    pub faces: Vec<Vec<usize>>,
}

impl SurfaceMesh {
    /// Every face as a fan of triangles from its first corner.
    pub fn triangles(&self) -> Vec<[usize; 3]> {
        let fan = |face: &Vec<usize>| (2..face.len()).map(|i| [face[0], face[i - 1], face[i]]).collect::<Vec<_>>();
        self.faces.iter().flat_map(fan).collect()
    }

    /// Undirected edges, sorted, each with the number of faces on it.
    pub fn edges(&self) -> Vec<([usize; 2], usize)> {
        let mut all: Vec<[usize; 2]> = self.faces.iter().flat_map(|face| face_edges(face)).map(sorted).collect();
        all.sort_unstable();
        let mut counted: Vec<([usize; 2], usize)> = Vec::new();
        for edge in all {
            match counted.last_mut() {
                Some((last, count)) if *last == edge => *count += 1,
                _ => counted.push((edge, 1)),
            }
        }
        counted
    }

    /// Closed rings of boundary vertices, in the order of the faces beside them. The smallest vertex comes first.
    pub fn boundary_loops(&self) -> Vec<Vec<usize>> {
        let mut next = vec![usize::MAX; self.points.len()];
        let open: Vec<[usize; 2]> =
            self.edges().into_iter().filter(|(_, count)| *count == 1).map(|(edge, _)| edge).collect();
        for face in &self.faces {
            for [a, b] in face_edges(face) {
                if open.binary_search(&sorted([a, b])).is_ok() {
                    next[a] = b;
                }
            }
        }
        let mut loops = Vec::new();
        for start in 0..next.len() {
            let mut ring = Vec::new();
            let mut at = start;
            while next[at] != usize::MAX {
                ring.push(at);
                at = std::mem::replace(&mut next[at], usize::MAX);
            }
            if !ring.is_empty() {
                loops.push(ring);
            }
        }
        loops
    }

    /// Enclosed volume \[m3\]; positive when faces turn counter-clockwise seen from outside.
    pub fn volume(&self) -> f64 {
        let x = &self.points;
        self.triangles().iter().map(|&[a, b, c]| x[a].dot(&x[b].cross(&x[c])) / 6.0).sum()
    }

    /// Mean length of all edges \[m\].
    pub fn mean_edge(&self) -> f64 {
        let edges = self.edges();
        let total: f64 = edges.iter().map(|([a, b], _)| (self.points[*a] - self.points[*b]).norm()).sum();
        total / edges.len() as f64
    }

    /// Smallest altitude of all triangles of [`SurfaceMesh::triangles`] \[m\].
    pub fn smallest_altitude(&self) -> f64 {
        let altitude = |&[a, b, c]: &[usize; 3]| {
            let [a, b, c] = [self.points[a], self.points[b], self.points[c]];
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            (b - a).cross(&(c - a)).norm() / longest
        };
        self.triangles().iter().map(altitude).fold(f64::INFINITY, f64::min)
    }

    /// Drops vertices that no face uses, keeping the order of the others.
    pub fn without_unused_points(&self) -> SurfaceMesh {
        let mut used = vec![false; self.points.len()];
        self.faces.iter().flatten().for_each(|&v| used[v] = true);
        let mut renumbered = vec![usize::MAX; self.points.len()];
        let mut points = Vec::new();
        for v in (0..used.len()).filter(|&v| used[v]) {
            renumbered[v] = points.len();
            points.push(self.points[v]);
        }
        let faces = self.faces.iter().map(|face| face.iter().map(|&v| renumbered[v]).collect()).collect();
        SurfaceMesh { points, faces }
    }
}

/// The directed edges of a face.
pub fn face_edges(face: &[usize]) -> impl Iterator<Item = [usize; 2]> + '_ {
    (0..face.len()).map(|i| [face[i], face[(i + 1) % face.len()]])
}

/// An undirected edge in its stored form.
pub fn sorted([a, b]: [usize; 2]) -> [usize; 2] {
    [a.min(b), a.max(b)]
}

/// A box of cubic cells to look for a surface in.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    origin: Vec3,
    cell: f64,
    nodes: [usize; 3],
}

impl Grid {
    /// Grid of `cell`-sized cubes \[m\] that covers `lower..upper` with two cells to spare. In x it is symmetric
    /// about 0, with the plane x = 0 in the middle of a cell.
    pub fn around(lower: &Vec3, upper: &Vec3, cell: f64) -> Grid {
        let half = (lower.x.abs().max(upper.x.abs()) / cell).ceil() + 2.5;
        let origin = Vec3::new(-half * cell, lower.y - 2.37 * cell, lower.z - 2.41 * cell);
        let count = |length: f64| (length / cell).ceil() as usize + 5;
        let nodes = [(2.0 * half) as usize + 1, count(upper.y - lower.y), count(upper.z - lower.z)];
        Grid { origin, cell, nodes }
    }

    fn node(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        self.origin + Vec3::new(i as f64, j as f64, k as f64) * self.cell
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.nodes[1] + j) * self.nodes[0] + i
    }

    fn sample(&self, field: &Field) -> Vec<f64> {
        let [nx, ny, nz] = self.nodes;
        let row = |row: usize| (0..nx).map(move |i| field(&self.node([i, row % ny, row / ny]))).collect::<Vec<_>>();
        (0..ny * nz).into_par_iter().map(row).collect::<Vec<_>>().concat()
    }
}

/// Quads on the zero level of `field`: one vertex in every cell that the surface crosses, at the mean of the
/// crossings of the cell's edges, and one quad around every grid edge with a change of sign (surface nets, Gibson
/// 1998). The quads form a manifold: see [`remove_ambiguities`].
pub fn surface_net(field: &Field, grid: &Grid) -> SurfaceMesh {
    let mut values = grid.sample(field);
    remove_ambiguities(grid, &mut values);
    let mut mesh = SurfaceMesh::default();
    let mut vertex = vec![usize::MAX; values.len()];
    let [nx, ny, nz] = grid.nodes;
    for k in 0..nz - 1 {
        for j in 0..ny - 1 {
            for i in 0..nx - 1 {
                if let Some(point) = crossing_mean(grid, &values, [i, j, k]) {
                    vertex[grid.index([i, j, k])] = mesh.points.len();
                    mesh.points.push(point);
                }
            }
        }
    }
    for k in 1..nz - 1 {
        for j in 1..ny - 1 {
            for i in 1..nx - 1 {
                for axis in 0..3 {
                    mesh.faces.extend(quad_around_edge(grid, &values, &vertex, [i, j, k], axis));
                }
            }
        }
    }
    mesh
}

/// Flips the sign of single grid values, the smallest first, until no cell holds two sheets of the surface: there the
/// net would have an edge with four faces or a pinched vertex. The surface moves by less than a cell, and projection
/// brings it back.
fn remove_ambiguities(grid: &Grid, values: &mut [f64]) {
    let [nx, ny, nz] = grid.nodes;
    let mut changed = true;
    while changed {
        changed = false;
        for k in 0..nz - 1 {
            for j in 0..ny - 1 {
                for i in 0..nx - 1 {
                    let nodes: [usize; 8] =
                        std::array::from_fn(|c| grid.index([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)]));
                    if is_ambiguous(&nodes.map(|node| values[node] < 0.0)) {
                        let closest = nodes.into_iter().min_by(|a, b| values[*a].abs().total_cmp(&values[*b].abs()));
                        let closest = closest.expect("a cell has eight corners");
                        // Away from zero, so that the node is not the next one to flip back.
                        values[closest] = -values[closest].signum() * 0.25 * grid.cell;
                        changed = true;
                    }
                }
            }
        }
    }
}

/// True if a face of the cell has two inside corners across from each other and two outside, or if the inside or the
/// outside corners do not hang together along the cell's edges.
fn is_ambiguous(inside: &[bool; 8]) -> bool {
    let checkered =
        |&[a, b, c, d]: &[usize; 4]| inside[a] == inside[d] && inside[b] == inside[c] && inside[a] != inside[b];
    const FACES: [[usize; 4]; 6] = [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 3, 6, 7], [0, 2, 4, 6], [1, 3, 5, 7]];
    if FACES.iter().any(checkered) {
        return true;
    }
    [false, true].into_iter().any(|state| {
        let Some(first) = (0..8).find(|&c| inside[c] == state) else { return false };
        let mut reached = 1_u8 << first;
        for _ in 0..8 {
            for c in (0..8_usize).filter(|&c| inside[c] == state) {
                if [c ^ 1, c ^ 2, c ^ 4].into_iter().any(|n| reached >> n & 1 == 1) {
                    reached |= 1 << c;
                }
            }
        }
        (0..8).any(|c| inside[c] == state && reached >> c & 1 == 0)
    })
}

fn crossing_mean(grid: &Grid, values: &[f64], cell: [usize; 3]) -> Option<Vec3> {
    let corner = |c: usize| [cell[0] + (c & 1), cell[1] + (c >> 1 & 1), cell[2] + (c >> 2)];
    let mut sum = Vec3::zeros();
    let mut count = 0;
    for a in 0..8 {
        for b in [a | 1, a | 2, a | 4].into_iter().filter(|&b| b != a) {
            let (va, vb) = (values[grid.index(corner(a))], values[grid.index(corner(b))]);
            if (va < 0.0) != (vb < 0.0) {
                sum += grid.node(corner(a)).lerp(&grid.node(corner(b)), va / (va - vb));
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum / f64::from(count))
}

fn quad_around_edge(
    grid: &Grid,
    values: &[f64],
    vertex: &[usize],
    node: [usize; 3],
    axis: usize,
) -> Option<Vec<usize>> {
    let mut end = node;
    end[axis] += 1;
    let starts_inside = values[grid.index(node)] < 0.0;
    if starts_inside == (values[grid.index(end)] < 0.0) {
        return None;
    }
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let cell = |db: usize, dc: usize| {
        let mut at = node;
        at[b] -= db;
        at[c] -= dc;
        vertex[grid.index(at)]
    };
    let mut quad = vec![cell(1, 1), cell(0, 1), cell(0, 0), cell(1, 0)];
    if !starts_inside {
        quad.reverse();
    }
    Some(quad)
}

/// Evens out a closed mesh on the zero level of `field`: each pass moves every vertex along the surface toward the mean
/// of the centres of its faces, weighted by their areas, and projects it back.
pub fn relax_on(field: &Field, mesh: &mut SurfaceMesh, passes: usize) {
    let mut stars = vec![Vec::new(); mesh.points.len()];
    for (i, face) in mesh.faces.iter().enumerate() {
        face.iter().for_each(|&v| stars[v].push(i));
    }
    for _ in 0..passes {
        let old = &mesh.points;
        let centers: Vec<(Vec3, f64)> = mesh.faces.iter().map(|face| center_and_area(old, face)).collect();
        let moved = |v: usize| {
            let area: f64 = stars[v].iter().map(|&face| centers[face].1).sum();
            let mean = stars[v].iter().map(|&face| centers[face].0 * centers[face].1).sum::<Vec3>() / area;
            let normal = gradient(field, &old[v]).normalize();
            let step = mean - old[v];
            project(field, &(old[v] + (step - normal * normal.dot(&step)) * 0.8), PROJECTION_STEPS)
        };
        mesh.points = (0..old.len()).into_par_iter().map(moved).collect();
    }
}

/// Turns the corners of every quad so that the diagonal from its first corner is the one closer to the zero level of
/// `field`: programs that split quads do it there, and a bent quad split the other way is a dent.
pub fn start_at_better_diagonal(field: &Field, mesh: &mut SurfaceMesh) {
    let x = &mesh.points;
    for face in mesh.faces.iter_mut().filter(|face| face.len() == 4) {
        let off = |a: usize, b: usize| field(&((x[a] + x[b]) / 2.0)).abs();
        if off(face[1], face[3]) < off(face[0], face[2]) {
            face.rotate_left(1);
        }
    }
}

fn center_and_area(points: &[Vec3], face: &[usize]) -> (Vec3, f64) {
    let center = face.iter().map(|&v| points[v]).sum::<Vec3>() / face.len() as f64;
    let turned = face_edges(face).map(|[a, b]| (points[a] - center).cross(&(points[b] - center))).sum::<Vec3>();
    (center, 0.5 * turned.norm())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_is_meshed_closed_with_the_right_volume_and_euler_characteristic() {
        let ball = |p: &Vec3| p.norm() - 0.5;
        let corner = Vec3::repeat(0.5);
        let mut mesh = surface_net(&ball, &Grid::around(&-corner, &corner, 0.05));
        relax_on(&ball, &mut mesh, 5);
        let edges = mesh.edges();
        assert!(edges.iter().all(|(_, faces)| *faces == 2));
        assert_eq!(mesh.points.len() + mesh.faces.len() - edges.len(), 2);
        // A polyhedron inscribed with edges of 0.05 loses about (0.05 / 0.5)^2 / 4 of the volume.
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.125;
        assert!((mesh.volume() / exact - 1.0).abs() < 0.005, "{}", mesh.volume() / exact);
    }
}

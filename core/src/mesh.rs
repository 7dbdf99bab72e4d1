//! Meshes: the artist's polygons as they are in the file, and the fixed triangulation that is simulated.

use crate::Vec3;
use crate::tolerances::FLAT_CUT;

/// The corners of each face, from the number of corners of every face and the point of every corner; ends before a face that
/// has fewer corners than its count.
pub fn faces<'a>(counts: &'a [u32], corners: &'a [u32]) -> impl Iterator<Item = &'a [u32]> {
    counts.iter().scan(corners, |rest, count| {
        let (face, after) = rest.split_at_checked(*count as usize)?;
        *rest = after;
        Some(face)
    })
}

/// Polygons of any size over points [m]; kept for output exactly as they were read.
///
/// Faces wind counter-clockwise seen from outside.
///
/// ```
/// use drapery_core::{PolygonMesh, Vec3};
/// let points = vec![Vec3::zeros(), Vec3::z(), Vec3::x() + Vec3::z(), Vec3::x()];
/// let quad = PolygonMesh { points, face_counts: vec![4], face_indices: vec![0, 1, 2, 3] };
/// let (triangles, polygons) = quad.triangulate();
/// assert_eq!((triangles.len(), polygons), (2, vec![0, 0]));
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PolygonMesh {
    /// Positions [m].
    pub points: Vec<Vec3>,
    /// Number of corners of each face.
    pub face_counts: Vec<u32>,
    /// Point of each corner, face by face.
    pub face_indices: Vec<u32>,
}

impl PolygonMesh {
    /// A mesh of triangles.
    pub fn from_triangles(points: Vec<Vec3>, triangles: &[[u32; 3]]) -> Self {
        Self { points, face_counts: vec![3; triangles.len()], face_indices: triangles.concat() }
    }

    /// The corners of each face; ends before a face that has fewer indices than its count.
    pub fn faces(&self) -> impl Iterator<Item = &[u32]> {
        faces(&self.face_counts, &self.face_indices)
    }

    /// Triangulates every face by a rule that depends on the positions alone: quads along their shorter diagonal (the
    /// first on ties), larger polygons by cutting ears. A polygon in which this leaves a triangle without area, because
    /// corners lie on a line, is cut along other diagonals if there are better ones. Returns the triangles and, for
    /// each, its polygon.
    pub fn triangulate(&self) -> (Vec<[u32; 3]>, Vec<u32>) {
        let mut triangles = Vec::new();
        let mut polygons = Vec::new();
        for (polygon, corners) in self.faces().enumerate() {
            triangulate_face(|vertex| self.points[vertex as usize], corners, &mut triangles);
            polygons.resize(triangles.len(), polygon as u32);
        }
        (triangles, polygons)
    }
}

/// Appends the triangles of one polygon by the rule of [`PolygonMesh::triangulate`]; `at` says where a point is. A triangle is
/// not looked at.
pub(crate) fn triangulate_face(at: impl Fn(u32) -> Vec3, corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let first = triangles.len();
    match *corners {
        [a, b, c] => triangles.push([a, b, c]),
        [a, b, c, d] => triangles.extend(cut_quad(&at, [a, b, c, d])),
        _ => cut_ears(&at, corners, triangles),
    }
    if (4..=LARGEST_CUT_AGAIN).contains(&corners.len()) {
        let normal = normal(&at, corners);
        let cost = |[a, b, c]: [u32; 3]| CutCost::of([at(a), at(b), at(c)], normal);
        let before = triangles[first..].iter().map(|t| cost(*t)).fold(CutCost::NONE, CutCost::with);
        if before.flat > 0 {
            let (after, others) = cut_at_least_cost(corners, cost);
            if after.is_below(&before) {
                triangles.truncate(first);
                triangles.extend(others);
            }
        }
    }
}

/// Most corners of a polygon that is cut again if it has triangles without area: the time grows with their third power.
const LARGEST_CUT_AGAIN: usize = 512;

/// Faults of the triangles that a polygon is cut into, the worse ones first.
#[derive(Debug, Clone, Copy)]
struct CutCost {
    /// Triangles that face the other side.
    turned: u32,
    /// Triangles without area.
    flat: u32,
    /// Smallest area of the others by the square of their longest edges.
    quality: f64,
}

impl CutCost {
    /// No triangle.
    const NONE: Self = Self { turned: 0, flat: 0, quality: f64::INFINITY };

    /// One triangle of a polygon with this normal.
    fn of([a, b, c]: [Vec3; 3], normal: Vec3) -> Self {
        let area = 0.5 * (b - a).cross(&(c - a));
        let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        let quality = area.norm() / longest;
        // Not a number where all corners are in one place.
        let is_flat = quality.is_nan() || quality <= FLAT_CUT;
        let is_turned = !is_flat && area.dot(&normal) < 0.0;
        Self {
            turned: u32::from(is_turned),
            flat: u32::from(is_flat),
            quality: if is_flat { f64::INFINITY } else { quality },
        }
    }

    /// The triangles of both.
    fn with(self, other: Self) -> Self {
        Self {
            turned: self.turned + other.turned,
            flat: self.flat + other.flat,
            quality: self.quality.min(other.quality),
        }
    }

    fn is_below(&self, other: &Self) -> bool {
        let faults = (self.turned, self.flat).cmp(&(other.turned, other.flat));
        faults.is_lt() || (faults.is_eq() && self.quality > other.quality)
    }
}

/// The triangulation with the least cost, the first on ties: the best of each run of corners from those of shorter runs. In a
/// polygon that does not cross itself, triangles that all face its side do not overlap.
fn cut_at_least_cost(corners: &[u32], cost: impl Fn([u32; 3]) -> CutCost) -> (CutCost, Vec<[u32; 3]>) {
    let count = corners.len();
    // By the first and the last corner of the run; with the corner of the triangle over these two.
    let mut best = vec![(CutCost::NONE, 0); count * count];
    for length in 2..count {
        for first in 0..count - length {
            let last = first + length;
            let run = |apex: usize| {
                let both = best[first * count + apex].0.with(best[apex * count + last].0);
                (both.with(cost([corners[first], corners[apex], corners[last]])), apex)
            };
            let least = |a: (CutCost, usize), b: (CutCost, usize)| if b.0.is_below(&a.0) { b } else { a };
            best[first * count + last] = (first + 2..last).map(run).fold(run(first + 1), least);
        }
    }
    let (mut runs, mut triangles) = (vec![(0, count - 1)], Vec::with_capacity(count - 2));
    while let Some((first, last)) = runs.pop() {
        if last - first > 1 {
            let apex = best[first * count + last].1;
            triangles.push([corners[first], corners[apex], corners[last]]);
            runs.extend([(first, apex), (apex, last)]);
        }
    }
    (best[count - 1].0, triangles)
}

/// A quad along its shorter diagonal, the first on ties.
fn cut_quad(at: impl Fn(u32) -> Vec3, [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    // A concave quad has to be cut at its reflex corner, whatever the diagonals' lengths.
    let convex = |p: u32, q: u32, r: u32, s: u32| {
        (at(q) - at(p)).cross(&(at(r) - at(p))).dot(&(at(r) - at(p)).cross(&(at(s) - at(p)))) > 0.0
    };
    let (along_ac, along_bd) = (convex(a, b, c, d), convex(b, c, d, a));
    let shorter_ac = (at(a) - at(c)).norm_squared() <= (at(b) - at(d)).norm_squared();
    if (shorter_ac && along_ac) || !along_bd { [[a, b, c], [a, c, d]] } else { [[b, c, d], [b, d, a]] }
}

/// Mean normal of a polygon, twice its area long [m²].
fn normal(at: impl Fn(u32) -> Vec3, corners: &[u32]) -> Vec3 {
    let origin = at(corners[0]);
    corners.windows(2).map(|w| (at(w[0]) - origin).cross(&(at(w[1]) - origin))).sum()
}

/// Ear cutting in the plane of the polygon's mean normal; takes the first ear found, so the result is fixed by the order
/// of the corners. A polygon without a proper ear (it crosses itself) is fanned from its first corner.
fn cut_ears(at: impl Fn(u32) -> Vec3, corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let normal = normal(&at, corners);
    let mut ring = corners.to_vec();
    while ring.len() > 3 {
        let count = ring.len();
        let ear = (0..count).find(|&i| {
            let (p, q, r) = (ring[(i + count - 1) % count], ring[i], ring[(i + 1) % count]);
            let side = |u: u32, v: u32, w: u32| (at(v) - at(u)).cross(&(at(w) - at(u))).dot(&normal);
            side(p, q, r) > 0.0
                && ring.iter().all(|&s| {
                    [p, q, r].contains(&s) || side(p, q, s) < 0.0 || side(q, r, s) < 0.0 || side(r, p, s) < 0.0
                })
        });
        let Some(i) = ear else {
            break;
        };
        triangles.push([ring[(i + count - 1) % count], ring[i], ring[(i + 1) % count]]);
        ring.remove(i);
    }
    triangles.extend((1..ring.len().saturating_sub(1)).map(|i| [ring[0], ring[i], ring[i + 1]]));
}

/// A mesh that is read piece by piece, in order: what rank 0 knows of a garment that is never as a whole in its memory.
pub trait MeshStream: std::fmt::Debug + Send + Sync {
    /// Number of points.
    fn point_count(&self) -> usize;

    /// Number of faces.
    fn face_count(&self) -> usize;

    /// Gives the positions [m].
    ///
    /// # Errors
    /// Description of the fault in the data.
    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), String>;

    /// Gives the faces: the number of corners of each, and the point of each corner, face by face. Nothing is promised of
    /// these numbers but that they fit each other.
    ///
    /// # Errors
    /// Description of the fault in the data.
    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), String>;
}

impl MeshStream for PolygonMesh {
    fn point_count(&self) -> usize {
        self.points.len()
    }

    fn face_count(&self) -> usize {
        self.face_counts.len()
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), String> {
        take(&self.points);
        Ok(())
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), String> {
        let corners: u64 = self.face_counts.iter().map(|c| u64::from(*c)).sum();
        if corners != self.face_indices.len() as u64 {
            return Err(format!("its faces have {corners} corners, but {} indices are given", self.face_indices.len()));
        }
        take(&self.face_counts, &self.face_indices);
        Ok(())
    }
}

/// An edge of the triangulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edge {
    /// Its two vertices, the smaller number first.
    pub vertices: [u32; 2],
}

/// Two triangles that share an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hinge {
    /// Number of the shared edge.
    pub edge: u32,
    /// The corners opposite to it, in the order of the triangles' numbers.
    pub opposite: [u32; 2],
    /// The triangles.
    pub triangles: [u32; 2],
}

/// The simulated triangulation of a garment, or of a rank's piece of it, with what follows from the rest shape.
#[derive(Debug, Clone)]
pub struct TriangleMesh {
    triangles: Vec<[u32; 3]>,
    polygons: Vec<u32>,
    edges: Vec<Edge>,
    rest_positions: Vec<Vec3>,
    rest_areas: Vec<f64>,
    /// Rest positions before they were scaled [m], if they are.
    modelled: Option<Vec<Vec3>>,
}

impl TriangleMesh {
    /// Triangulates `mesh`. Assumes valid indices; `Scene::validate` checks them.
    pub fn new(mesh: &PolygonMesh) -> Self {
        let (triangles, polygons) = mesh.triangulate();
        Self::of_triangles(mesh.points.clone(), triangles, polygons)
    }

    /// The mesh of these triangles, each with its polygon, over rest positions [m], with its edges (ascending by vertex
    /// numbers).
    pub(crate) fn of_triangles(rest_positions: Vec<Vec3>, triangles: Vec<[u32; 3]>, polygons: Vec<u32>) -> Self {
        let at = |i: u32| rest_positions[i as usize];
        let rest_areas: Vec<f64> =
            triangles.iter().map(|&[a, b, c]| 0.5 * (at(b) - at(a)).cross(&(at(c) - at(a))).norm()).collect();
        let mut edges: Vec<Edge> =
            sides(triangles.iter().copied()).map(|[p, q, _]| Edge { vertices: [p, q] }).collect();
        edges.sort_unstable();
        edges.dedup();
        edges.shrink_to_fit();
        Self { triangles, polygons, edges, rest_positions, rest_areas, modelled: None }
    }

    /// The sides of each triangle with the triangle and its opposite corner, those of an edge together, in the order of the edges.
    fn sides_by_edge(&self) -> Vec<([u32; 2], u32, u32)> {
        let mut sides: Vec<([u32; 2], u32, u32)> = Vec::with_capacity(3 * self.triangles.len());
        for (t, &[a, b, c]) in self.triangles.iter().enumerate() {
            for (p, q, opposite) in [(a, b, c), (b, c, a), (c, a, b)] {
                sides.push(([p.min(q), p.max(q)], t as u32, opposite));
            }
        }
        sides.sort_unstable();
        sides
    }

    /// Triangles, counter-clockwise seen from the side that the polygons face.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Polygon of each triangle.
    pub fn polygons(&self) -> &[u32] {
        &self.polygons
    }

    /// Edges, ascending by vertex numbers.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Every pair of triangles that share an edge, also where more than two meet, ascending by edge. They are found anew: no step
    /// needs them.
    pub fn hinges(&self) -> Vec<Hinge> {
        let sides = self.sides_by_edge();
        let mut hinges = Vec::with_capacity(sides.len() / 2);
        for (edge, group) in (0..).zip(sides.chunk_by(|a, b| a.0 == b.0)) {
            for (i, first) in group.iter().enumerate() {
                hinges.extend(group[i + 1..].iter().map(|second| Hinge {
                    edge,
                    opposite: [first.2, second.2],
                    triangles: [first.1, second.1],
                }));
            }
        }
        hinges
    }

    /// Rest positions [m].
    pub fn rest_positions(&self) -> &[Vec3] {
        &self.rest_positions
    }

    /// Rest positions before they were scaled [m].
    pub(crate) fn modelled_positions(&self) -> &[Vec3] {
        self.modelled.as_deref().unwrap_or(&self.rest_positions)
    }

    /// The same mesh with `scale` times the lengths at rest that were modelled, whatever it had before.
    pub(crate) fn scaled(self, scale: f64) -> Self {
        if scale == 1.0 && self.modelled.is_none() {
            return self;
        }
        let Self { triangles, polygons, rest_positions, modelled, .. } = self;
        let modelled = modelled.unwrap_or(rest_positions);
        let scaled = modelled.iter().map(|place| place * scale).collect();
        let modelled = (scale != 1.0).then_some(modelled);
        Self { modelled, ..Self::of_triangles(scaled, triangles, polygons) }
    }

    /// Rest area of each triangle [m²].
    pub fn rest_areas(&self) -> &[f64] {
        &self.rest_areas
    }

    /// Sum of the rest areas of the triangles at each edge [m²]. They are summed anew: no step needs them.
    pub fn edge_areas(&self) -> Vec<f64> {
        let area = |group: &[([u32; 2], u32, u32)]| group.iter().map(|(_, t, _)| self.rest_areas[*t as usize]).sum();
        self.sides_by_edge().chunk_by(|a, b| a.0 == b.0).map(area).collect()
    }

    /// Rest length of an edge [m].
    pub fn rest_length(&self, edge: Edge) -> f64 {
        let [a, b] = edge.vertices;
        (self.rest_positions[a as usize] - self.rest_positions[b as usize]).norm()
    }
}

/// Each side of each triangle: the ends of its edge, the lower first, and 1 where the triangle runs from the lower to the higher.
pub fn sides(triangles: impl Iterator<Item = [u32; 3]>) -> impl Iterator<Item = [u32; 3]> {
    let edges = triangles.flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]);
    edges.map(|[p, q]| [p.min(q), p.max(q), u32::from(p < q)])
}

/// Edges, by their ends, that do not belong to exactly two triangles which run along them in opposite directions: where a
/// surface is open, branches, or turns its other side out. Looks at edges whose lower end `is_own`.
pub(crate) fn unpaired_edges(triangles: &[[u32; 3]], is_own: impl Fn(u32) -> bool) -> Vec<[u32; 2]> {
    let sides = sides(triangles.iter().copied()).filter(|[low, ..]| is_own(*low));
    let paired = |of_edge: &[[u32; 3]]| match of_edge {
        // From a corner to itself it runs in both directions.
        [[p, q, _]] => p == q,
        [[.., one], [.., other]] => one != other,
        _ => false,
    };
    edges_of(sides.collect(), |of_edge| !paired(of_edge))
}

/// Edges, by their ends, with two triangles that run along them in the same direction, and so show opposite sides; from all
/// [`sides`] of these edges.
pub fn turned_edges(sides: Vec<[u32; 3]>) -> Vec<[u32; 2]> {
    edges_of(sides, |of_edge| matches!(of_edge, [[p, q, one], [.., other]] if one == other && p != q))
}

/// The edges for whose sides `keep` holds, ascending.
fn edges_of(mut sides: Vec<[u32; 3]>, keep: impl Fn(&[[u32; 3]]) -> bool) -> Vec<[u32; 2]> {
    sides.sort_unstable();
    let edges = sides.chunk_by(|a, b| a[..2] == b[..2]).filter(|of_edge| keep(of_edge));
    edges.map(|of_edge| [of_edge[0][0], of_edge[0][1]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    fn area_of(points: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
        let at = |i: u32| points[i as usize];
        triangles.iter().map(|&[a, b, c]| 0.5 * (at(b) - at(a)).cross(&(at(c) - at(a))).z).sum()
    }

    #[test]
    fn a_concave_polygon_keeps_its_area_and_its_winding() {
        // An arrow head and an L: the shoelace formula gives their areas.
        let arrow: Vec<Vec3> =
            [[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).into();
        let corner: Vec<Vec3> = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]
            .map(|[x, y]| Vec3::new(x, y, 0.0))
            .into();
        for (points, area) in [(arrow, 0.5), (corner, 4.0)] {
            let count = points.len() as u32;
            let mesh =
                PolygonMesh { points: points.clone(), face_counts: vec![count], face_indices: (0..count).collect() };
            let (triangles, _) = mesh.triangulate();
            assert_eq!(triangles.len(), count as usize - 2);
            assert!((area_of(&points, &triangles) - area).abs() < 1e-15);
            assert!(triangles.iter().all(|t| area_of(&points, &[*t]) > 0.0), "{triangles:?}");
        }
    }

    /// Polygons with corners on a line, drawn on squared paper: merged quads, a rectangle with corners on all sides, an L, a
    /// triangle and two quads with corners on a side.
    const ON_LINES: [&[[i32; 2]]; 6] = [
        &[[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [2, 1], [1, 1], [0, 1]],
        &[[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [3, 2], [2, 2], [1, 2], [0, 2], [0, 1]],
        &[[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [2, 1], [1, 1], [1, 2], [1, 3], [0, 3], [0, 2], [0, 1]],
        &[[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [2, 3]],
        &[[0, 0], [1, 0], [2, 0], [1, 5]],
        &[[2, 0], [1, 5], [0, 0], [1, 0]],
    ];

    /// Turned about all axes and moved by up to ten metres.
    fn placed(corners: &[[f64; 2]], random: &mut SplitMix64) -> Vec<Vec3> {
        let angles = [(); 3].map(|()| 4.0 * random.signed());
        let turn = nalgebra::Rotation3::from_euler_angles(angles[0], angles[1], angles[2]);
        let shift = Vec3::from([(); 3].map(|()| 10.0 * random.signed()));
        corners.iter().map(|[x, y]| turn * Vec3::new(*x, *y, 0.0) + shift).collect()
    }

    #[test]
    fn a_polygon_with_corners_on_a_line_has_no_triangle_without_area_however_it_lies() {
        let mut random = SplitMix64::new(11);
        for corners in ON_LINES {
            let doubled = (0..corners.len()).map(|i| (corners[i], corners[(i + 1) % corners.len()]));
            let area = 0.5 * f64::from(doubled.map(|([x, y], [u, v])| x * v - y * u).sum::<i32>());
            let real: Vec<[f64; 2]> = corners.iter().map(|corner| corner.map(f64::from)).collect();
            for single in (0..1000).map(|case| case % 2 == 0) {
                let mut points = placed(&real, &mut random);
                if single {
                    points.iter_mut().for_each(|p| *p = p.map(|c| f64::from(c as f32)));
                }
                let count = points.len() as u32;
                let face = PolygonMesh { points, face_counts: vec![count], face_indices: (0..count).collect() };
                let triangles = face.triangulate().0;
                assert_eq!(triangles.len(), corners.len() - 2);
                let at = |v: u32| face.points[v as usize];
                let normals = triangles.iter().map(|&[a, b, c]| 0.5 * (at(b) - at(a)).cross(&(at(c) - at(a))));
                let normals: Vec<Vec3> = normals.collect();
                let whole: Vec3 = normals.iter().sum();
                // Corners are on squared paper, so a triangle that has an area has half a square.
                let smallest = normals.iter().map(|n| n.dot(&whole) / area).fold(f64::INFINITY, f64::min);
                assert!(smallest > 0.499, "{smallest} in {triangles:?} of {corners:?}");
                assert!((normals.iter().map(Vec3::norm).sum::<f64>() - area).abs() < 1e-4, "{triangles:?}");
                let used: std::collections::BTreeSet<u32> = triangles.iter().flatten().copied().collect();
                assert_eq!(used.len(), corners.len());
            }
        }
    }

    #[test]
    fn a_polygon_without_corners_on_a_line_keeps_its_ears_and_one_that_is_a_line_its_fan() {
        let mut random = SplitMix64::new(12);
        for count in 5..12 {
            let star = |i: i32| {
                let (angle, radius) = (6.0 * f64::from(i) / f64::from(count), if i % 3 == 0 { 3.0 } else { 10.0 });
                [radius * angle.cos(), radius * angle.sin()]
            };
            let corners: Vec<[f64; 2]> = (0..count).map(star).collect();
            let points = placed(&corners, &mut random);
            let (mut ears, mut found) = (Vec::new(), Vec::new());
            let numbers: Vec<u32> = (0..count as u32).collect();
            cut_ears(|v| points[v as usize], &numbers, &mut ears);
            triangulate_face(|v| points[v as usize], &numbers, &mut found);
            assert_eq!(found, ears);
        }
        let mut line = Vec::new();
        triangulate_face(|v| Vec3::x() * f64::from(v), &[0, 1, 2, 3, 4], &mut line);
        assert_eq!(line, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    }

    #[test]
    fn a_square_of_two_triangles_has_five_edges_and_one_hinge() {
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).into();
        let mesh = TriangleMesh::new(&PolygonMesh { points, face_counts: vec![4], face_indices: vec![0, 1, 2, 3] });
        assert_eq!(mesh.edges().len(), 5);
        assert_eq!(mesh.hinges().len(), 1);
        assert_eq!(mesh.edge_areas().iter().copied().fold(0.0, f64::max), 1.0);
        let [p, q] = mesh.hinges()[0].opposite;
        assert_ne!(p, q);
    }

    #[test]
    fn open_and_turned_edges_are_found() {
        let closed = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        assert!(unpaired_edges(&closed, |_| true).is_empty());
        assert_eq!(unpaired_edges(&closed[..3], |_| true), [[0, 2], [0, 3], [2, 3]]);
        let turned = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 3, 2]];
        assert_eq!(unpaired_edges(&turned, |_| true), [[0, 2], [0, 3], [2, 3]]);
        assert_eq!(unpaired_edges(&turned, |v| v == 2), [[2, 3]]);
        let turned_edges = |triangles: &[[u32; 3]]| turned_edges(sides(triangles.iter().copied()).collect());
        assert_eq!(turned_edges(&turned), [[0, 2], [0, 3], [2, 3]]);
        assert!(turned_edges(&closed).is_empty() && turned_edges(&closed[..3]).is_empty());
        // Where more than two meet there is no winding that suits all.
        assert!(turned_edges(&[[0, 1, 2], [0, 1, 3], [0, 1, 4]]).is_empty());
    }

    #[test]
    fn a_triangle_with_a_corner_twice_opens_nothing_but_an_edge_of_others() {
        let closed = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        let with = |corners: [u32; 3]| unpaired_edges(&[closed.as_slice(), &[corners]].concat(), |_| true);
        assert!(with([4, 4, 5]).is_empty());
        assert_eq!(with([0, 0, 1]), [[0, 1]]);
        assert_eq!(with([4, 4, 4]), [[4, 4]]);
    }
}

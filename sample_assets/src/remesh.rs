//! Open triangle meshes on an implicit surface: cut along planes, then remeshed to even triangles by splits, collapses,
//! flips and tangential smoothing (Botsch, Kobbelt 2004).

use std::collections::BTreeMap;

use crate::sdf::{Field, Vec3, gradient, project};
use crate::surface_mesh::{SurfaceMesh, face_edges, sorted};

/// Rounds of split, collapse, flip and smoothing.
const ROUNDS: usize = 14;
/// Rounds at the end that only flip for shape and smooth.
const FINISHING_ROUNDS: usize = 6;
/// Altitude below which a triangle is thin, as a share of the edge length, and rounds that may be spent on thin
/// triangles.
const SMALLEST_ALTITUDE: f64 = 0.42;
const EXTRA_ROUNDS: u32 = 8;
/// Newton steps of a projection.
const PROJECTION_STEPS: usize = 5;

/// An opening: the part of the surface beyond a plane is cut away.
#[derive(Debug, Clone, Copy)]
pub struct Cut {
    /// Unit normal toward the part that goes.
    pub normal: Vec3,
    /// A point of the plane \[m\].
    pub point: Vec3,
    /// Box (lower and upper corner, \[m\]) outside of which the plane cuts nothing.
    pub within: [Vec3; 2],
}

impl Cut {
    fn beyond(&self, p: &Vec3) -> f64 {
        self.normal.dot(&(p - self.point))
    }

    fn reaches(&self, p: &Vec3) -> bool {
        (0..3).all(|axis| self.within[0][axis] <= p[axis] && p[axis] <= self.within[1][axis])
    }
}

/// Cuts a closed mesh on the zero level of `field` open and remeshes it to edges of about `edge` \[m\].
pub fn cut_and_remesh(field: &Field, closed: &SurfaceMesh, cuts: &[Cut], edge: f64) -> SurfaceMesh {
    let mut points = closed.points.clone();
    let mut faces = closed.triangles();
    let mut openings = vec![None; points.len()];
    for (opening, cut) in cuts.iter().enumerate() {
        clip(&mut points, &mut faces, cut, 0.2 * edge);
        openings.resize(points.len(), None);
        let mesh = SurfaceMesh { points: points.clone(), faces: faces.iter().map(|face| face.to_vec()).collect() };
        for (ends, _) in mesh.edges().into_iter().filter(|(_, count)| *count == 1) {
            for v in ends {
                openings[v] = openings[v].or(Some(opening));
            }
        }
    }
    let mut remesher = Remesher::new(field, cuts, points, faces, openings, edge);
    for _ in 0..ROUNDS {
        remesher.round(0.8);
    }
    remesher.polish();
    for extra in 1..=EXTRA_ROUNDS {
        if remesher.smallest_altitude() > SMALLEST_ALTITUDE * edge {
            break;
        }
        // A thin triangle that survived has edges just long enough; a little more is collapsed each time.
        remesher.round(0.8 + 0.02 * f64::from(extra));
        remesher.polish();
    }
    remesher.finish()
}

/// Keeps the part of the mesh on the near side of a cut, with new vertices on the plane. Vertices closer than `snap`
/// \[m\] move onto it first.
fn clip(points: &mut Vec<Vec3>, faces: &mut Vec<[usize; 3]>, cut: &Cut, snap: f64) {
    let mut side: Vec<f64> = points.iter().map(|p| if cut.reaches(p) { cut.beyond(p) } else { -1.0 }).collect();
    for (p, d) in points.iter_mut().zip(&mut side) {
        if d.abs() < snap {
            *p -= cut.normal * *d;
            *d = 0.0;
        }
    }
    let mut crossings: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    let mut kept = Vec::new();
    for face in faces.iter() {
        if face.iter().all(|&v| side[v] >= 0.0) {
            continue;
        }
        let mut polygon = Vec::with_capacity(4);
        for [a, b] in face_edges(face) {
            if side[a] <= 0.0 {
                polygon.push(a);
            }
            if side[a] * side[b] < 0.0 {
                let [low, high] = sorted([a, b]);
                polygon.push(*crossings.entry([low, high]).or_insert_with(|| {
                    points.push(points[low].lerp(&points[high], side[low] / (side[low] - side[high])));
                    points.len() - 1
                }));
            }
        }
        kept.extend((2..polygon.len()).map(|i| [polygon[0], polygon[i - 1], polygon[i]]));
    }
    *faces = kept;
}

struct Remesher<'a> {
    field: &'a Field<'a>,
    cuts: &'a [Cut],
    edge: f64,
    points: Vec<Vec3>,
    /// Removed faces are none.
    faces: Vec<Option<[usize; 3]>>,
    /// Faces around each vertex.
    stars: Vec<Vec<usize>>,
    /// The cut on which a boundary vertex lies.
    openings: Vec<Option<usize>>,
}

impl<'a> Remesher<'a> {
    fn new(
        field: &'a Field<'a>,
        cuts: &'a [Cut],
        points: Vec<Vec3>,
        faces: Vec<[usize; 3]>,
        openings: Vec<Option<usize>>,
        edge: f64,
    ) -> Self {
        let mut stars = vec![Vec::new(); points.len()];
        for (i, face) in faces.iter().enumerate() {
            face.iter().for_each(|&v| stars[v].push(i));
        }
        let faces = faces.into_iter().map(Some).collect();
        Remesher { field, cuts, edge, points, faces, stars, openings }
    }

    fn round(&mut self, collapse_share: f64) {
        self.split_long_edges();
        self.collapse_short_edges(collapse_share);
        self.flip_edges(Remesher::valence_gain);
        self.smooth();
        self.smooth();
    }

    fn polish(&mut self) {
        for _ in 0..FINISHING_ROUNDS {
            self.flip_edges(Remesher::shape_gain);
            self.smooth();
        }
        self.flip_edges(Remesher::shape_gain);
    }

    fn smallest_altitude(&self) -> f64 {
        let altitude = |face: &[usize; 3]| {
            let longest = face_edges(face).map(|edge| self.length(edge)).fold(0.0, f64::max);
            self.area_normal(*face).norm() / longest
        };
        self.faces.iter().flatten().map(altitude).fold(f64::INFINITY, f64::min)
    }

    fn edges(&self) -> Vec<[usize; 2]> {
        let mut edges: Vec<[usize; 2]> =
            self.faces.iter().flatten().flat_map(|face| face_edges(face).map(sorted).collect::<Vec<_>>()).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    fn length(&self, [a, b]: [usize; 2]) -> f64 {
        (self.points[a] - self.points[b]).norm()
    }

    fn corners(&self, face: usize) -> [usize; 3] {
        self.faces[face].expect("stars hold live faces only")
    }

    /// Faces on an edge, one or two.
    fn faces_on(&self, [a, b]: [usize; 2]) -> Vec<usize> {
        self.stars[a].iter().copied().filter(|&face| self.corners(face).contains(&b)).collect()
    }

    fn neighbours(&self, v: usize) -> Vec<usize> {
        let mut around: Vec<usize> =
            self.stars[v].iter().flat_map(|&face| self.corners(face)).filter(|&n| n != v).collect();
        around.sort_unstable();
        around.dedup();
        around
    }

    fn add_face(&mut self, face: [usize; 3]) {
        face.iter().for_each(|&v| self.stars[v].push(self.faces.len()));
        self.faces.push(Some(face));
    }

    fn remove_face(&mut self, face: usize) {
        for v in self.corners(face) {
            self.stars[v].retain(|&other| other != face);
        }
        self.faces[face] = None;
    }

    fn area_normal(&self, [a, b, c]: [usize; 3]) -> Vec3 {
        (self.points[b] - self.points[a]).cross(&(self.points[c] - self.points[a]))
    }

    /// Smallest altitude over longest edge: the shape of a triangle, 0.87 at best.
    fn shape(&self, face: [usize; 3]) -> f64 {
        let longest = face_edges(&face).map(|edge| self.length(edge)).fold(0.0, f64::max);
        self.area_normal(face).norm() / (longest * longest)
    }

    /// The vertex moved to the surface, and to its opening if it is on one.
    fn projected(&self, opening: Option<usize>, p: &Vec3) -> Vec3 {
        let Some(opening) = opening else { return project(self.field, p, PROJECTION_STEPS) };
        let cut = &self.cuts[opening];
        let mut q = *p;
        for _ in 0..PROJECTION_STEPS {
            q -= cut.normal * cut.beyond(&q);
            let g = gradient(self.field, &q);
            let along = g - cut.normal * cut.normal.dot(&g);
            q -= along * ((self.field)(&q) / along.norm_squared().max(1e-6));
        }
        q
    }

    fn split_long_edges(&mut self) {
        for edge in self.edges() {
            if self.length(edge) <= 4.0 / 3.0 * self.edge {
                continue;
            }
            let [a, b] = edge;
            let around = self.faces_on(edge);
            let opening = if around.len() == 1 { self.openings[a].or(self.openings[b]) } else { None };
            let middle = self.points.len();
            self.points.push(self.projected(opening, &self.points[a].lerp(&self.points[b], 0.5)));
            self.openings.push(opening);
            self.stars.push(Vec::new());
            for face in around {
                let corners = self.corners(face);
                self.remove_face(face);
                self.add_face(corners.map(|v| if v == a { middle } else { v }));
                self.add_face(corners.map(|v| if v == b { middle } else { v }));
            }
        }
    }

    /// Collapses edges shorter than `share` of the aim.
    fn collapse_short_edges(&mut self, share: f64) {
        for edge in self.edges() {
            // An earlier collapse may have taken the edge away.
            if self.length(edge) < share * self.edge && !self.faces_on(edge).is_empty() {
                self.collapse(edge);
            }
        }
    }

    /// Joins the ends of an edge unless that would pinch, flip or stretch the mesh or bridge an opening.
    fn collapse(&mut self, [a, b]: [usize; 2]) {
        let around = self.faces_on([a, b]);
        let on_boundary = around.len() == 1;
        let (kept, gone) = if self.openings[a].is_some() { (a, b) } else { (b, a) };
        if self.openings[gone].is_some() && !on_boundary {
            return;
        }
        let others: Vec<usize> = self.neighbours(gone);
        let common = self.neighbours(kept).into_iter().filter(|v| others.contains(v)).count();
        if common != around.len() {
            return;
        }
        let middle = self.points[a].lerp(&self.points[b], 0.5);
        let target = match (self.openings[kept], self.openings[gone]) {
            (Some(_), None) => self.points[kept],
            (opening, _) => self.projected(opening, &middle),
        };
        let old = [self.points[a], self.points[b]];
        let moved: Vec<usize> =
            self.stars[a].iter().chain(&self.stars[b]).copied().filter(|face| !around.contains(face)).collect();
        let before: Vec<Vec3> = moved.iter().map(|&face| self.area_normal(self.corners(face))).collect();
        self.points[a] = target;
        self.points[b] = target;
        let good = moved.iter().zip(&before).all(|(&face, before)| {
            let corners = self.corners(face);
            let after = self.area_normal(corners);
            let short = face_edges(&corners).all(|edge| self.length(edge) < 4.0 / 3.0 * self.edge);
            short && after.dot(before) > 0.3 * after.norm() * before.norm() && self.shape(corners) > 0.1
        });
        if !good {
            [self.points[a], self.points[b]] = old;
            return;
        }
        for face in around {
            self.remove_face(face);
        }
        for face in self.stars[gone].clone() {
            let corners = self.corners(face);
            self.remove_face(face);
            self.add_face(corners.map(|v| if v == gone { kept } else { v }));
        }
    }

    /// Flips every inner edge for which `gain` is positive and the surface stays smooth.
    fn flip_edges(&mut self, gain: fn(&Self, [usize; 2], [usize; 2]) -> f64) {
        for edge in self.edges() {
            let around = self.faces_on(edge);
            if around.len() != 2 {
                continue;
            }
            let [a, b] = edge;
            let faces = [self.corners(around[0]), self.corners(around[1])];
            let apex = faces.map(|face| face.into_iter().find(|&v| v != a && v != b).expect("a triangle has an apex"));
            let bridged = !self.faces_on(apex).is_empty();
            if bridged || (self.openings[apex[0]].is_some() && self.openings[apex[1]].is_some()) {
                continue;
            }
            // Keep the turn: the first face loses b to the apex of the second, the second loses a to that of the first.
            let flipped = [
                faces[0].map(|v| if v == b { apex[1] } else { v }),
                faces[1].map(|v| if v == a { apex[0] } else { v }),
            ];
            let normal = self.area_normal(faces[0]) + self.area_normal(faces[1]);
            let upright = flipped.iter().all(|&face| {
                let n = self.area_normal(face);
                n.dot(&normal) > 0.5 * n.norm() * normal.norm() && self.shape(face) > 0.15
            });
            if upright && gain(self, edge, apex) > 0.0 {
                around.iter().for_each(|&face| self.remove_face(face));
                flipped.into_iter().for_each(|face| self.add_face(face));
            }
        }
    }

    /// Decrease of the squared valence errors; the aim is six neighbours inside and four on the boundary.
    fn valence_gain(&self, edge: [usize; 2], apex: [usize; 2]) -> f64 {
        let error = |v: usize, change: i64| {
            let aim = if self.openings[v].is_some() { 4 } else { 6 };
            (self.neighbours(v).len() as i64 + change - aim).pow(2)
        };
        let before: i64 = edge.iter().chain(&apex).map(|&v| error(v, 0)).sum();
        let after: i64 = edge.iter().map(|&v| error(v, -1)).chain(apex.iter().map(|&v| error(v, 1))).sum();
        (before - after) as f64
    }

    /// Increase of the worse of the two triangles' shapes.
    fn shape_gain(&self, [a, b]: [usize; 2], [c, d]: [usize; 2]) -> f64 {
        let worse = |faces: [[usize; 3]; 2]| self.shape(faces[0]).min(self.shape(faces[1]));
        worse([[a, d, c], [b, c, d]]) - worse([[a, b, c], [a, b, d]]) - 1e-6
    }

    /// Moves every vertex along the surface toward the mean of its neighbours; on the boundary, of its boundary
    /// neighbours.
    fn smooth(&mut self) {
        let mut moved = self.points.clone();
        for v in (0..self.points.len()).filter(|&v| !self.stars[v].is_empty()) {
            let mut around = self.neighbours(v);
            if self.openings[v].is_some() {
                around.retain(|&n| self.faces_on([v, n]).len() == 1);
            }
            let p = self.points[v];
            let step = around.iter().map(|&n| self.points[n]).sum::<Vec3>() / around.len() as f64 - p;
            let normal = gradient(self.field, &p).normalize();
            moved[v] = self.projected(self.openings[v], &(p + (step - normal * normal.dot(&step)) * 0.7));
        }
        self.points = moved;
    }

    fn finish(self) -> SurfaceMesh {
        let faces = self.faces.into_iter().flatten().map(|face| face.to_vec()).collect();
        SurfaceMesh { points: self.points, faces }.without_unused_points()
    }
}

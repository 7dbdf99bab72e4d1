//! Crossings of faces with more corners than three, whichever triangles they are cut into.
//!
//! The solver cuts every face once. Caches hold the faces, and a renderer may cut them along other diagonals, so that another
//! surface is seen. Looked at are, beside the solver's triangles: of a quad the two along its other diagonal; of a larger face the
//! fans from its first and its last corner, which is where file formats of either winding begin. Cuts that fold a face over are
//! left out: a concave quad has one diagonal, and a concave face no fan from some corners.
//!
//! A pair may be of any two of these triangles, since each face may be cut either way. Two cuts of the same face are no pair.

use crate::Vec3;
use crate::geometry::crossings::{self, Crossing, CrossingSearch};

/// A surface with all cuts of its faces, whose crossings are asked for again and again while it moves.
#[derive(Clone, Debug)]
pub struct FaceSearch {
    /// The solver's triangles, then the others.
    search: CrossingSearch,
    simulated: usize,
    /// Faces with more corners than three by their corners.
    faces: Vec<Vec<u32>>,
    /// Corners of each of the solver's triangles, ascending; these ascend too. Empty where there is no other cut.
    own: Vec<[u32; 3]>,
    /// Edges of these, ascending.
    own_edges: Vec<[u32; 2]>,
    /// Corners of every triangle, ascending, with its face; these ascend too.
    face_of: Vec<([u32; 3], u32)>,
    /// Every edge of them with the first face that has it; these ascend.
    face_of_edge: Vec<([u32; 2], u32)>,
}

/// Crossings found by a search.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CutCrossings {
    /// Crossings of the solver's triangles, ascending.
    pub simulated: Vec<Crossing>,
    /// Crossings with another cut of a face, ascending.
    pub other: Vec<Crossing>,
}

impl FaceSearch {
    /// Takes faces by their number of corners and the point of each corner, the triangles that the solver cuts them into, and
    /// the first places of the points \[m\]. All numbers are in range.
    pub fn new((counts, corners): (&[u32], &[u32]), simulated: Vec<[u32; 3]>, positions: Vec<Vec3>) -> Self {
        let mut rest = corners;
        let mut faces = Vec::with_capacity(counts.len());
        for count in counts {
            let (face, later) = rest.split_at(*count as usize);
            faces.push(face);
            rest = later;
        }
        let mut own: Vec<[u32; 3]> = simulated.iter().map(ascending).collect();
        own.sort_unstable();
        let (mut triangles, count) = (simulated, own.len());
        for face in &faces {
            let mut found = other_cuts(face, |vertex| positions[vertex as usize]);
            found.retain(|triangle| own.binary_search(&ascending(triangle)).is_err());
            triangles.append(&mut found);
        }
        let mut built = Self {
            simulated: count,
            faces: Vec::new(),
            own: Vec::new(),
            own_edges: Vec::new(),
            face_of: Vec::new(),
            face_of_edge: Vec::new(),
            search: CrossingSearch::new(triangles, positions),
        };
        if built.has_other_cuts() {
            built.index(own, &faces);
        }
        built
    }

    /// Notes which face each triangle and edge is of.
    fn index(&mut self, own: Vec<[u32; 3]>, faces: &[&[u32]]) {
        let mut own_edges: Vec<[u32; 2]> = own.iter().flat_map(edges).collect();
        own_edges.sort_unstable();
        own_edges.dedup();
        // A triangle is of the face that has all its corners; those are few around a point.
        let mut around: Vec<(u32, u32)> = Vec::new();
        for (face, number) in faces.iter().zip(0..) {
            around.extend(face.iter().map(|corner| (*corner, number)));
        }
        around.sort_unstable();
        let faces_at = |corner: u32| {
            let first = around.partition_point(|(other, _)| *other < corner);
            around[first..].iter().take_while(move |(other, _)| *other == corner).map(|(_, face)| *face)
        };
        for triangle in self.search.surface().triangles {
            let of = |face: &u32| triangle.iter().all(|corner| faces[*face as usize].contains(corner));
            let face = faces_at(triangle[0]).find(of).unwrap_or(u32::MAX);
            self.face_of.push((ascending(triangle), face));
            self.face_of_edge.extend(edges(triangle).map(|edge| (edge, face)));
        }
        self.face_of.sort_unstable();
        self.face_of_edge.sort_unstable();
        self.face_of_edge.dedup_by_key(|(edge, _)| *edge);
        (self.own, self.own_edges) = (own, own_edges);
        // A quad has too few corners for two of its cuts to be a pair.
        let kept = |face: &&[u32]| if face.len() > 4 { face.to_vec() } else { Vec::new() };
        self.faces = faces.iter().map(kept).collect();
    }

    /// Moves the points; as many as before.
    pub fn place(&mut self, positions: impl IntoIterator<Item = Vec3>) {
        self.search.place(positions);
    }

    /// Returns the positions of the points.
    pub fn positions(&self) -> &[Vec3] {
        self.search.surface().positions
    }

    /// Number of the solver's triangles.
    pub fn triangle_count(&self) -> usize {
        self.simulated
    }

    /// Whether any face may be cut otherwise than the solver does.
    pub fn has_other_cuts(&self) -> bool {
        self.search.surface().triangles.len() > self.simulated
    }

    /// Crossings of the surface with itself.
    pub fn find(&self) -> CutCrossings {
        let all = crossings::find(&self.search.surface());
        self.divided(all.into_iter().filter(|crossing| !self.is_within_a_face(crossing)), self)
    }

    /// Crossings of edges of this surface with triangles of another, by the points of each.
    pub fn find_through(&self, triangles_of: &Self) -> CutCrossings {
        let all = crossings::find_between(&self.search.surface(), &triangles_of.search.surface());
        self.divided(all.into_iter(), triangles_of)
    }

    /// The face of an edge, the first that has it, and of a triangle, where faces may be cut otherwise.
    pub fn face_of_edge(&self, edge: [u32; 2]) -> Option<u32> {
        let place = self.face_of_edge.binary_search_by_key(&edge, |(edge, _)| *edge).ok()?;
        Some(self.face_of_edge[place].1).filter(|face| *face != u32::MAX)
    }

    /// The face of a triangle, where faces may be cut otherwise.
    pub fn face_of_triangle(&self, triangle: [u32; 3]) -> Option<u32> {
        let place = self.face_of.binary_search_by_key(&ascending(&triangle), |(corners, _)| *corners).ok()?;
        Some(self.face_of[place].1).filter(|face| *face != u32::MAX)
    }

    /// Tells crossings of the solver's triangles from the others.
    fn divided(&self, all: impl Iterator<Item = Crossing>, triangles_of: &Self) -> CutCrossings {
        let is_own = |crossing: &Crossing| {
            (!self.has_other_cuts() || self.own_edges.binary_search(&crossing.edge).is_ok())
                && (!triangles_of.has_other_cuts()
                    || triangles_of.own.binary_search(&ascending(&crossing.triangle)).is_ok())
        };
        let (simulated, other) = all.partition(is_own);
        CutCrossings { simulated, other }
    }

    /// Whether the edge and the triangle are cuts of one face.
    fn is_within_a_face(&self, Crossing { edge, triangle }: &Crossing) -> bool {
        let face = self.face_of_triangle(*triangle).and_then(|face| self.faces.get(face as usize));
        face.is_some_and(|face| edge.iter().all(|end| face.contains(end)))
    }
}

/// Triangles that others may cut a face into, without those that fold it over; among them may be the solver's.
fn other_cuts(face: &[u32], at: impl Fn(u32) -> Vec3) -> Vec<[u32; 3]> {
    let count = face.len();
    if count < 4 {
        return Vec::new();
    }
    let origin = at(face[0]);
    let normal: Vec3 = face.windows(2).map(|w| (at(w[0]) - origin).cross(&(at(w[1]) - origin))).sum();
    // Of a quad the fans from two neighbours are both of its diagonals.
    let fans = [0, count - 1].map(|first| fan(face, first));
    let stands = |[a, b, c]: &[u32; 3]| (at(*b) - at(*a)).cross(&(at(*c) - at(*a))).dot(&normal) > 0.0;
    fans.into_iter().filter(|fan| fan.iter().all(stands)).flatten().collect()
}

/// The triangles of a face around one of its corners.
fn fan(face: &[u32], first: usize) -> Vec<[u32; 3]> {
    let count = face.len();
    let corner = |step: usize| face[(first + step) % count];
    (1..count - 1).map(|step| [corner(0), corner(step), corner(step + 1)]).collect()
}

fn ascending(triangle: &[u32; 3]) -> [u32; 3] {
    let mut corners = *triangle;
    corners.sort_unstable();
    corners
}

fn edges(triangle: &[u32; 3]) -> [[u32; 2]; 3] {
    let [a, b, c] = *triangle;
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PolygonMesh;

    fn search(mesh: &PolygonMesh) -> FaceSearch {
        FaceSearch::new((&mesh.face_counts, &mesh.face_indices), mesh.triangulate().0, mesh.points.clone())
    }

    fn one_face(corners: &[[f64; 3]]) -> PolygonMesh {
        let count = corners.len() as u32;
        let points = corners.iter().map(|p| Vec3::from(*p)).collect();
        PolygonMesh { points, face_counts: vec![count], face_indices: (0..count).collect() }
    }

    /// A needle upright at the middle of the unit square, from one height to another.
    fn needle(from: f64, to: f64) -> PolygonMesh {
        one_face(&[[0.5, 0.5, from], [0.5, 0.5, to], [0.5, 0.4999, to]])
    }

    #[test]
    fn what_reaches_between_the_diagonals_of_a_warped_quad_crosses_one_cut_alone() {
        // Its first diagonal, the shorter one, is at height 0, the other at 0.2.
        let quad = one_face(&[[0.01, 0.01, 0.0], [1.0, 0.0, 0.2], [0.99, 0.99, 0.0], [0.0, 1.0, 0.2]]);
        let quad = search(&quad);
        assert_eq!(quad.triangle_count(), 2);
        assert!(quad.has_other_cuts());
        assert_eq!(quad.find(), CutCrossings::default(), "its two cuts are no pair");
        for (from, to, simulated, other) in
            [(0.1, 0.3, false, true), (-0.1, 0.1, true, false), (-0.1, 0.3, true, true), (0.05, 0.15, false, false)]
        {
            let needle = search(&needle(from, to));
            assert!(!needle.has_other_cuts());
            let found = needle.find_through(&quad);
            assert_eq!((!found.simulated.is_empty(), !found.other.is_empty()), (simulated, other), "{from} to {to}");
            for Crossing { edge, triangle } in found.other {
                assert_eq!((needle.face_of_edge(edge), quad.face_of_triangle(triangle)), (None, Some(0)));
            }
            let back = quad.find_through(&needle);
            assert!(back.other.iter().all(|crossing| quad.face_of_edge(crossing.edge) == Some(0)));
        }
    }

    #[test]
    fn a_flat_mesh_of_quads_and_larger_faces_crosses_nothing_however_it_is_cut() {
        let points: Vec<Vec3> = (0..20).map(|k| Vec3::new(f64::from(k % 5), f64::from(k / 5), 0.0)).collect();
        // Quads, a hexagon of two cells, a pentagon and a triangle.
        let faces: [&[u32]; 5] =
            [&[0, 1, 6, 5], &[1, 2, 3, 8, 7, 6], &[5, 6, 7, 11, 10], &[7, 12, 11], &[7, 8, 13, 12]];
        let face_counts = faces.iter().map(|face| face.len() as u32).collect();
        let mesh = PolygonMesh { points, face_counts, face_indices: faces.concat() };
        let search = search(&mesh);
        assert!(search.has_other_cuts());
        assert_eq!(search.find(), CutCrossings::default());
    }

    #[test]
    fn concave_faces_are_cut_as_the_solver_cuts_them() {
        let arrow = one_face(&[[0.0, 0.0, 0.0], [2.0, -1.0, 0.0], [0.5, 0.0, 0.0], [2.0, 1.0, 0.0]]);
        assert!(!search(&arrow).has_other_cuts());
        let corner = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let corner = search(&one_face(&corner.map(|[x, y]| [x, y, 0.0])));
        assert!(corner.find().other.is_empty());
    }

    #[test]
    fn a_needle_through_a_bent_hexagon_is_found_for_every_fan() {
        // Flat but for one corner far up: a fan from there covers the middle from above.
        let mut corners: Vec<[f64; 3]> =
            (0..6).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_3).map(|a| [a.cos(), a.sin(), 0.0]).collect();
        corners[0][2] = 0.4;
        let hexagon = search(&one_face(&corners));
        let through = |low: f64, high: f64| {
            let needle = one_face(&[[0.01, 0.02, low], [0.01, 0.02, high], [0.01, 0.0201, high]]);
            search(&needle).find_through(&hexagon)
        };
        let found = through(0.1, 0.3);
        assert!(!found.simulated.is_empty() || !found.other.is_empty());
        assert_eq!(through(0.45, 0.6), CutCrossings::default());
    }
}

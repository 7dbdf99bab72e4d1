//! What of a garment takes no part: faces without area, faces that are there twice, vertices that no other face has.
//!
//! None of it is simulated, so that the rest moves as it would without it. In the output everything stays: a vertex that
//! only faces without area have goes with the nearest of their other corners, any other stays where it starts.

use crate::Vec3;
use crate::mesh::PolygonMesh;
use crate::scene::Scene;
use crate::tolerances::{DEGENERATE_AREA, DEGENERATE_EDGE};

/// Elements of one kind that a warning lists before the rest is only counted.
const LISTED: usize = 5;

/// A vertex that takes no part and goes with another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Follower {
    /// Its number in the scene, and that of the vertex that it follows.
    pub(crate) vertex: u32,
    pub(crate) leader: u32,
    /// From there to it, at the start [m].
    pub(crate) offset: Vec3,
}

/// The triangles of a garment that are simulated, and what was left out of them.
#[derive(Debug, Default)]
pub(super) struct Sound {
    pub(super) triangles: Vec<[u32; 3]>,
    /// Polygon of each triangle.
    pub(super) polygons: Vec<u32>,
    /// Vertices that go with another, ascending, and which; numbers of the garment.
    pub(super) follows: Vec<[u32; 2]>,
    /// What was left out, in words.
    pub(super) warnings: Vec<String>,
}

impl Sound {
    /// The triangles with an area, each once. Of faces on the same corners, the first stays.
    pub(super) fn of(name: &str, mesh: &PolygonMesh) -> Self {
        let points = &mesh.points;
        let (all, polygons) = mesh.triangulate();
        let shortest = DEGENERATE_EDGE * size(points);
        let mut repeated = repeated_polygons(mesh);
        let (mut sound, mut flat) = (Self::default(), Vec::new());
        let once = |(_, polygon): &([u32; 3], u32)| repeated.binary_search(polygon).is_err();
        for (corners, polygon) in all.into_iter().zip(polygons).filter(once) {
            if is_flat(corners.map(|v| points[v as usize]), shortest) {
                flat.push((corners, polygon));
            } else {
                sound.triangles.push(corners);
                sound.polygons.push(polygon);
            }
        }
        repeated.extend(sound.drop_repeated());
        let mut lives = vec![false; points.len()];
        sound.triangles.iter().flatten().for_each(|v| lives[*v as usize] = true);
        sound.follows = leaders(points, &flat, &lives);
        sound.warn((name, mesh), repeated, flat.into_iter().map(|(_, polygon)| polygon).collect(), &lives);
        sound
    }

    /// Takes out triangles on the corners of one before; returns their polygons.
    fn drop_repeated(&mut self) -> Vec<u32> {
        let sorted = |t: usize| {
            let mut key = self.triangles[t];
            key.sort_unstable();
            (key, t)
        };
        let mut keys: Vec<([u32; 3], usize)> = (0..self.triangles.len()).map(sorted).collect();
        keys.sort_unstable();
        let mut twice: Vec<usize> = keys.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| w[1].1).collect();
        twice.sort_unstable();
        let dropped = twice.iter().map(|t| self.polygons[*t]).collect();
        let mut number = 0..;
        self.triangles.retain(|_| number.next().is_none_or(|t| twice.binary_search(&t).is_err()));
        let mut number = 0..;
        self.polygons.retain(|_| number.next().is_none_or(|t| twice.binary_search(&t).is_err()));
        dropped
    }

    fn warn(&mut self, (name, mesh): (&str, &PolygonMesh), repeated: Vec<u32>, flat: Vec<u32>, lives: &[bool]) {
        let goes = |v: &u32| self.follows.binary_search_by_key(v, |[follower, _]| *follower).is_ok();
        let inert = (0..lives.len() as u32).filter(|v| !lives[*v as usize]);
        let (follow, stay): (Vec<u32>, Vec<u32>) = inert.partition(goes);
        let says = [
            ("faces", repeated, "lie on other faces of the same corners, and take no part: delete the duplicate faces"),
            ("faces", flat, "have no area, or a part of them has none: it takes no part; merge points by distance"),
            ("vertices", follow, "are in no other face, and go with the nearest corner of these: delete such faces"),
            ("vertices", stay, "belong to no face that has an area, and stay where they start: delete loose vertices"),
        ];
        let place = format!("garment \"{name}\"");
        if mesh.face_counts.is_empty() {
            self.warnings
                .push(format!("{place}: it has no faces, so nothing of it moves: export a mesh with polygons"));
        }
        for (what, list, is) in says {
            self.warnings.extend(listed(list).map(|list| format!("{place}: {what} {list} {is}")));
        }
    }
}

impl Scene {
    /// What of the garments takes no part, and why, a sentence each: on rank 0, nothing elsewhere.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Own vertices that no triangle has, ascending, if any rank has such.
    pub(crate) fn inert(&self) -> Option<&[u32]> {
        self.inert.as_deref()
    }

    /// Vertices of all ranks that take no part and go with another in the output.
    pub(crate) fn followers(&self) -> &[Follower] {
        &self.followers
    }

    /// What takes no part has no velocity.
    pub(super) fn stop_inert(&self, v: &mut [Vec3]) {
        if let Some(inert) = &self.inert {
            inert.iter().for_each(|vertex| v[*vertex as usize] = Vec3::zeros());
            self.parts.halo().refresh(self.parts.ranks(), v);
        }
    }
}

/// The triangles of a mesh that a scene simulates: those with an area, each once, in the order of their polygons.
pub fn simulated_triangles(mesh: &PolygonMesh) -> Vec<[u32; 3]> {
    Sound::of("", mesh).triangles
}

/// Diagonal of the bounds [m].
fn size(points: &[Vec3]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let [low, high] = points.iter().fold([*first; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
    (high - low).norm()
}

/// Whether a triangle has no area or an edge of no length, which is up to `shortest` [m].
fn is_flat([a, b, c]: [Vec3; 3], shortest: f64) -> bool {
    let edges = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
    let longest = edges.into_iter().fold(0.0, f64::max);
    let area = 0.5 * (b - a).cross(&(c - a)).norm();
    edges.iter().any(|edge| *edge <= shortest) || area <= DEGENERATE_AREA * longest * longest
}

/// Polygons of four and more corners that have those of one before, ascending: however they are wound or turned.
fn repeated_polygons(mesh: &PolygonMesh) -> Vec<u32> {
    // Few polygons share their three lowest corners; those are looked at closely.
    let mut keys: Vec<([u32; 3], u32, usize)> = Vec::new();
    let mut first = 0;
    for (polygon, corners) in mesh.faces().enumerate() {
        if corners.len() > 3 {
            let low = sorted(corners);
            keys.push(([low[0], low[1], low[2]], polygon as u32, first));
        }
        first += corners.len();
    }
    keys.sort_unstable();
    let all = |(_, polygon, first): &([u32; 3], u32, usize)| {
        sorted(&mesh.face_indices[*first..*first + mesh.face_counts[*polygon as usize] as usize])
    };
    let mut repeated = Vec::new();
    for group in keys.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1) {
        let mut sets: Vec<(Vec<u32>, u32)> = group.iter().map(|key| (all(key), key.1)).collect();
        sets.sort_unstable();
        repeated.extend(sets.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| w[1].1));
    }
    repeated.sort_unstable();
    repeated
}

fn sorted(corners: &[u32]) -> Vec<u32> {
    let mut corners = corners.to_vec();
    corners.sort_unstable();
    corners
}

/// For each vertex of flat triangles that has no other, the nearest corner of these that has: the lowest of equally near ones.
fn leaders(points: &[Vec3], flat: &[([u32; 3], u32)], lives: &[bool]) -> Vec<[u32; 2]> {
    let mut all: Vec<(u32, f64, u32)> = Vec::new();
    for corners in flat.iter().map(|(corners, _)| corners) {
        for v in corners.iter().filter(|v| !lives[**v as usize]) {
            let others = corners.iter().filter(|other| lives[**other as usize]);
            all.extend(others.map(|w| (*v, (points[*v as usize] - points[*w as usize]).norm(), *w)));
        }
    }
    all.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    all.dedup_by_key(|(vertex, ..)| *vertex);
    all.into_iter().map(|(vertex, _, leader)| [vertex, leader]).collect()
}

/// The first few of these numbers, and how many more there are; `None` if there is none.
fn listed(mut numbers: Vec<u32>) -> Option<String> {
    numbers.sort_unstable();
    numbers.dedup();
    let names: Vec<String> = numbers.iter().take(LISTED).map(u32::to_string).collect();
    let more = numbers.len() - names.len();
    match more {
        _ if names.is_empty() => None,
        0 => Some(names.join(", ")),
        _ => Some(format!("{} and {more} more", names.join(", "))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound(points: &[[f64; 3]], faces: &[&[u32]]) -> Sound {
        let mesh = PolygonMesh {
            points: points.iter().map(|p| Vec3::from(*p)).collect(),
            face_counts: faces.iter().map(|face| face.len() as u32).collect(),
            face_indices: faces.concat(),
        };
        Sound::of("skirt", &mesh)
    }

    /// A square, a point on the line through its first two corners, one in the place of the third, and one far away.
    const POINTS: [[f64; 3]; 7] = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [3.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [9.0, 9.0, 9.0],
    ];

    #[test]
    fn what_is_repeated_flat_or_loose_is_left_out_and_named_and_the_rest_is_that_of_the_clean_mesh() {
        let clean = sound(&POINTS[..4], &[&[0, 1, 2, 3]]);
        assert!(clean.warnings.is_empty() && clean.follows.is_empty(), "{clean:?}");
        // Turned, so that its shorter diagonal is another on a tie; flipped; the half of it; without area in three ways.
        let faces: [&[u32]; 7] =
            [&[0, 1, 2, 3], &[1, 2, 3, 0], &[3, 2, 1, 0], &[2, 1, 0], &[0, 1, 4], &[2, 5, 3], &[0, 0, 3]];
        let odd = sound(&POINTS, &faces);
        assert_eq!(odd.triangles, clean.triangles);
        assert_eq!(odd.polygons, [0, 0]);
        assert_eq!(odd.follows, [[4, 1], [5, 2]]);
        let said = odd.warnings.join("\n");
        for part in ["faces 1, 2, 3 lie on", "faces 4, 5, 6 have no area", "vertices 4, 5 are in", "vertices 6 belong"]
        {
            assert!(said.contains(part), "{part}\n{said}");
        }
    }

    #[test]
    fn faces_that_share_some_corners_are_not_repeated() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 1.0]];
        let sound = sound(&points, &[&[0, 1, 2, 3], &[0, 1, 2, 4]]);
        assert_eq!(sound.triangles.len(), 4);
        assert!(sound.warnings.is_empty(), "{:?}", sound.warnings);
    }

    #[test]
    fn a_mesh_without_faces_or_points_is_said_to_be_one() {
        for points in [&POINTS[..3], &[]] {
            let sound = sound(points, &[]);
            assert!(sound.triangles.is_empty() && sound.warnings[0].contains("it has no faces"), "{sound:?}");
        }
    }
}

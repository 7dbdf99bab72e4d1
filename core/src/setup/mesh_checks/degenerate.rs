//! Degenerate geometry of a garment, which takes no part: faces without area, duplicate faces, vertices that no other
//! face has.
//!
//! None of it is simulated, so that the rest moves as it would without it. In the output everything stays: a vertex that
//! only faces without area have goes with the nearest of their other corners, any other stays where it starts.

use bytemuck::{Pod, Zeroable};

use crate::Vec3;
use crate::mesh::{PolygonMesh, triangulate_face};
use crate::parallel::message::is_broken;
use crate::parallel::problems::listed;
use crate::parallel::ranks::Ranks;
use crate::scene::coarse_place;
use crate::setup::distribute::block_rows::BlockDistribution;
use crate::setup::distribute::even_blocks::{BlockOfMesh, FetchedValues, joined};
use crate::setup::distribute::one_ring::Triangle;
use crate::tolerances::{DEGENERATE_AREA, DEGENERATE_EDGE};

/// The triangles of a garment that are simulated, as far as their faces are in this rank's block, and what was left out of them.
#[derive(Debug)]
pub(crate) struct CleanMesh {
    /// Its triangles by numbers of the garment, in the order of the polygons.
    pub(crate) triangles: Vec<Triangle>,
    /// 1 for each point in this rank's block that such a triangle has, 0 for the others.
    pub(crate) lives: Vec<u8>,
    /// Vertices that go with another, ascending; the same on all ranks.
    pub(crate) follows: Vec<MergedInto>,
    /// Faces and vertices that were left out, in words; on rank 0.
    pub(crate) warnings: Vec<String>,
}

/// A vertex that goes with another, by numbers of the garment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MergedInto {
    pub(crate) vertex: u32,
    pub(crate) leader: u32,
}

/// Polygons that are left out or lose a part.
struct LeftOut {
    /// Polygons on the corners of an earlier one.
    repeated: Vec<u32>,
    /// Polygons with a triangle that has no area.
    flat: Vec<u32>,
}

impl CleanMesh {
    /// The triangles with an area, each once. Of faces on the same corners, the first stays. All ranks call it together.
    pub(crate) fn of(ranks: &Ranks, name: &str, block: &BlockOfMesh<'_>) -> Self {
        let positions = block.positions(ranks);
        let shortest = DEGENERATE_EDGE * size(ranks, block);
        let mut repeated = repeated_polygons(ranks, block);
        let (mut triangles, mut flat, mut cut) = (Vec::new(), Vec::new(), Vec::new());
        let mut farthest = [0.0_f64; 2];
        let once = |(polygon, _): &(u32, &[u32])| repeated.binary_search(polygon).is_err();
        for (polygon, corners) in block.faces(ranks).filter(once) {
            triangulate_face(|vertex| positions.at(vertex), corners, &mut cut);
            for [a, b, c] in cut.drain(..) {
                let corners = [a, b, c].map(|v| positions.at(v));
                let is_flat = is_flat(corners, shortest);
                if let Some((far, apart)) = coarse_place(corners).filter(|_| is_flat) {
                    farthest = [farthest[0].max(far), farthest[1].max(apart)];
                }
                let list = if is_flat { &mut flat } else { &mut triangles };
                list.push(Triangle { polygon, corners: [a, b, c] });
            }
        }
        repeated.extend(drop_repeated(ranks, block, &mut triangles));
        let lives = lives(ranks, &block.points_of, &triangles);
        let follows = leaders(ranks, &block.points_of, &flat, &lives, &positions);
        let flat = flat.into_iter().map(|triangle| triangle.polygon).collect();
        let mut sound = Self { triangles, lives, follows, warnings: Vec::new() };
        sound.warnings = sound.warnings_of(ranks, name, block, LeftOut { repeated, flat });
        sound.warnings.extend(coarseness_warning(ranks, name, farthest));
        sound
    }

    /// Describes in words, on rank 0, the elements that were left out: these polygons, and the points that have no
    /// other.
    fn warnings_of(&self, ranks: &Ranks, name: &str, block: &BlockOfMesh<'_>, left_out: LeftOut) -> Vec<String> {
        let goes = |v: &u32| self.follows.binary_search_by_key(v, |merged| merged.vertex).is_ok();
        let first = block.points_of.rows(ranks.rank()).start as u32;
        let isolated = (first..).zip(&self.lives).filter(|(_, lives)| **lives == 0).map(|(v, _)| v);
        let (follow, stay): (Vec<u32>, Vec<u32>) = isolated.partition(goes);
        let LeftOut { repeated, flat } = left_out;
        let says = [
            ("faces", repeated, "duplicate other faces and are not simulated: delete them"),
            ("faces", flat, "have no area, at least in part; that part is not simulated: merge points by distance"),
            (
                "vertices",
                follow,
                "belong only to faces without area and follow the nearest corner of these: delete such faces",
            ),
            ("vertices", stay, "belong to no face with an area and stay where they start: delete loose vertices"),
        ];
        let place = format!("garment \"{name}\"");
        let mut warnings = Vec::new();
        if block.faces_of.count() == 0 {
            warnings.push(format!("{place}: it has no faces, so it does not move: export a mesh with polygons"));
        }
        for (what, list, is) in says {
            let list = listed(ranks, list.into_iter().map(|number| [number; 2]).collect());
            warnings.extend(list.map(|list| format!("{place}: {what} {list} {is}")));
        }
        if ranks.is_first() { warnings } else { Vec::new() }
    }
}

/// A triangle in the block of the lowest of its corners; ordered by the corners first.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
struct TriangleKey {
    /// Its corners, ascending.
    corners: [u32; 3],
    polygon: u32,
    /// Its number where its polygon is in the block.
    number: u32,
}

/// Takes out triangles on the corners of one before; returns their polygons. They meet in the block of the lowest of these
/// corners.
fn drop_repeated(ranks: &Ranks, block: &BlockOfMesh<'_>, triangles: &mut Vec<Triangle>) -> Vec<u32> {
    let mut lists = vec![Vec::new(); ranks.count()];
    for (number, Triangle { polygon, corners }) in (0u32..).zip(&*triangles) {
        let mut corners = *corners;
        corners.sort_unstable();
        lists[block.points_of.of(corners[0] as usize)].push(TriangleKey { corners, polygon: *polygon, number });
    }
    let mut keys = joined(ranks.all_to_all_v(lists));
    keys.sort_unstable();
    let mut answers = vec![Vec::new(); ranks.count()];
    for twice in keys.windows(2).filter(|w| w[0].corners == w[1].corners) {
        answers[block.faces_of.of(twice[1].polygon as usize)].push(twice[1].number);
    }
    drop(keys);
    let mut twice = joined(ranks.all_to_all_v(answers));
    twice.sort_unstable();
    let dropped = twice.iter().map(|t| triangles[*t as usize].polygon).collect();
    let mut number = 0..;
    triangles.retain(|_| number.next().is_none_or(|t| twice.binary_search(&t).is_err()));
    dropped
}

/// 1 for each point in this rank's block that one of the triangles of all ranks has, 0 for the others.
fn lives(ranks: &Ranks, blocks: &BlockDistribution, triangles: &[Triangle]) -> Vec<u8> {
    let here = blocks.rows(ranks.rank());
    let mut lives = vec![0; here.len()];
    let corners = || triangles.iter().flat_map(|triangle| triangle.corners);
    let is_here = |v: &u32| here.contains(&(*v as usize));
    corners().filter(is_here).for_each(|v| lives[v as usize - here.start] = 1);
    let mut others: Vec<u32> = corners().filter(|v| !is_here(v)).collect();
    others.sort_unstable();
    others.dedup();
    let mut lists = vec![Vec::new(); ranks.count()];
    others.into_iter().for_each(|v| lists[blocks.of(v as usize)].push(v));
    ranks.all_to_all_v(lists).into_iter().flatten().for_each(|v| lives[v as usize - here.start] = 1);
    lives
}

/// Returns on rank 0 the warning about faces without area that single precision may have taken it: how far from the origin the
/// farthest of them is on each rank [m], and how far apart numbers are there.
fn coarseness_warning(ranks: &Ranks, name: &str, farthest: [f64; 2]) -> Option<String> {
    let [far, apart] = ranks.max_of(farthest);
    (far > 0.0 && ranks.is_first()).then(|| {
        format!(
            "garment \"{name}\": its faces without area are {far:.0} m from the origin, where single precision \
             resolves only {apart:.1e} m and points of a file coincide: bake the garment near the origin, and put the \
             distance into a transform above the mesh, which has double precision"
        )
    })
}

/// The triangles of a mesh that a scene simulates: those with an area, each once, in the order of their polygons.
pub fn simulated_triangles(mesh: &PolygonMesh) -> Vec<[u32; 3]> {
    let sound = CleanMesh::of(&Ranks::default(), "", &BlockOfMesh::alone(mesh));
    sound.triangles.into_iter().map(|triangle| triangle.corners).collect()
}

/// Diagonal of the bounds of the points of all ranks [m].
fn size(ranks: &Ranks, block: &BlockOfMesh<'_>) -> f64 {
    if block.points_of.count() == 0 {
        return 0.0;
    }
    let none = Vec3::repeat(f64::NEG_INFINITY);
    let (low, high) = block.points.iter().fold((none, none), |(l, h), p| (l.sup(&-p), h.sup(p)));
    let all = ranks.max_of([low.x, low.y, low.z, high.x, high.y, high.z]);
    (Vec3::new(all[3], all[4], all[5]) + Vec3::new(all[0], all[1], all[2])).norm()
}

/// Whether a triangle has no area or an edge of no length, which is up to `shortest` [m].
fn is_flat([a, b, c]: [Vec3; 3], shortest: f64) -> bool {
    let edges = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
    let longest = edges.into_iter().fold(0.0, f64::max);
    let area = 0.5 * (b - a).cross(&(c - a)).norm();
    edges.iter().any(|edge| *edge <= shortest) || area <= DEGENERATE_AREA * longest * longest
}

/// A polygon in the block of the lowest of its corners; the corners are sent beside it.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PolygonKey {
    polygon: u32,
    /// Number of its corners.
    corners: u32,
}

/// Polygons of four and more corners, in this rank's block, that have those of one before, ascending: however they are wound or turned.
/// They meet in the block of the lowest of these corners.
fn repeated_polygons(ranks: &Ranks, block: &BlockOfMesh<'_>) -> Vec<u32> {
    let (mut keys, mut corners) = (vec![Vec::new(); ranks.count()], vec![Vec::new(); ranks.count()]);
    let mut sorted = Vec::new();
    for (polygon, of_polygon) in block.faces(ranks).filter(|(_, corners)| corners.len() > 3) {
        sorted.clear();
        sorted.extend_from_slice(of_polygon);
        sorted.sort_unstable();
        let to = block.points_of.of(sorted[0] as usize);
        keys[to].push(PolygonKey { polygon, corners: sorted.len() as u32 });
        corners[to].extend_from_slice(&sorted);
    }
    let (keys, corners) = (joined(ranks.all_to_all_v(keys)), joined(ranks.all_to_all_v(corners)));
    let mut rest = corners.as_slice();
    let row = |key: &PolygonKey| match rest.split_off(..key.corners as usize) {
        Some(row) => (row, key.polygon),
        None => is_broken(ranks.rank(), "corners of polygons", format_args!("polygon {} lacks some", key.polygon)),
    };
    let mut rows: Vec<(&[u32], u32)> = keys.iter().map(row).collect();
    rows.sort_unstable();
    let mut answers = vec![Vec::new(); ranks.count()];
    for twice in rows.windows(2).filter(|w| w[0].0 == w[1].0) {
        answers[block.faces_of.of(twice[1].1 as usize)].push(twice[1].1);
    }
    drop(rows);
    drop(corners);
    let mut repeated = joined(ranks.all_to_all_v(answers));
    repeated.sort_unstable();
    repeated
}

/// For each vertex of flat triangles that has no other, the nearest corner of these that has: the lowest of equally near ones.
/// The same on all ranks.
fn leaders(
    ranks: &Ranks,
    blocks: &BlockDistribution,
    flat: &[Triangle],
    lives: &[u8],
    positions: &FetchedValues<'_, Vec3>,
) -> Vec<MergedInto> {
    let lives = FetchedValues::new(ranks, flat.iter().flat_map(|triangle| triangle.corners), blocks, lives);
    let mut all: Vec<NearLeader> = Vec::new();
    for Triangle { corners, .. } in flat {
        for v in corners.iter().filter(|v| lives.at(**v) == 0) {
            let others = corners.iter().filter(|other| lives.at(**other) != 0);
            let distance = |w: &u32| (positions.at(*v) - positions.at(*w)).norm();
            all.extend(others.map(|w| NearLeader { distance: distance(w), vertex: *v, leader: *w }));
        }
    }
    let order = |a: &NearLeader, b: &NearLeader| {
        a.vertex.cmp(&b.vertex).then(a.distance.total_cmp(&b.distance)).then(a.leader.cmp(&b.leader))
    };
    let nearest = |all: &mut Vec<NearLeader>| {
        all.sort_unstable_by(order);
        all.dedup_by_key(|near| near.vertex);
    };
    nearest(&mut all);
    let mut all = ranks.all_gather_v(&all).concat();
    nearest(&mut all);
    all.into_iter().map(|NearLeader { vertex, leader, .. }| MergedInto { vertex, leader }).collect()
}

/// A corner that a vertex of a flat triangle may go with.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct NearLeader {
    /// From the one to the other [m].
    distance: f64,
    vertex: u32,
    leader: u32,
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::geometry::random::SplitMix64;
    use crate::mesh::MeshStream;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::setup::distribute::even_blocks::MeshSize;

    /// The triangles with their polygons, who follows whom, and what is said, by as many ranks.
    type Found = (Vec<Triangle>, Vec<MergedInto>, Vec<String>);

    fn sound_by(count: usize, mesh: &PolygonMesh) -> Found {
        let all = LocalRanks::run(count, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let size = MeshSize { points: mesh.points.len(), faces: mesh.face_counts.len() };
            let (given, mut problems) = (ranks.is_first().then_some(mesh as &dyn MeshStream), Vec::new());
            let block = BlockOfMesh::read(&ranks, given, size, "skirt", &mut problems);
            let sound = CleanMesh::of(&ranks, "skirt", &block);
            let first = block.points_of.rows(ranks.rank()).start as u32;
            let lives =
                (first..).zip(&sound.lives).filter(|(_, lives)| **lives == 1).map(|(v, _)| v).collect::<Vec<_>>();
            assert!(problems.is_empty() && (ranks.is_first() || sound.warnings.is_empty()));
            (sound, lives)
        });
        let all = all.expect("no rank ends early");
        let triangles: Vec<Triangle> = all.iter().flat_map(|(sound, _)| sound.triangles.clone()).collect();
        let mut corners: Vec<u32> = triangles.iter().flat_map(|triangle| triangle.corners).collect();
        corners.sort_unstable();
        corners.dedup();
        assert_eq!(all.iter().flat_map(|(_, lives)| lives.clone()).collect::<Vec<_>>(), corners);
        let follows = all[0].0.follows.clone();
        assert!(all.iter().all(|(sound, _)| sound.follows == follows));
        (triangles, follows, all[0].0.warnings.clone())
    }

    /// Returns the result that any number of ranks find alike.
    fn sound(points: &[[f64; 3]], faces: &[&[u32]]) -> Found {
        let mesh = PolygonMesh {
            points: points.iter().map(|p| Vec3::from(*p)).collect(),
            face_counts: faces.iter().map(|face| face.len() as u32).collect(),
            face_indices: faces.concat(),
        };
        let alone = sound_by(1, &mesh);
        assert_eq!(simulated_triangles(&mesh), alone.0.iter().map(|triangle| triangle.corners).collect::<Vec<_>>());
        (2..6).for_each(|ranks| assert_eq!(sound_by(ranks, &mesh), alone, "{ranks} ranks"));
        alone
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
    fn repeated_flat_and_loose_parts_are_left_out_and_named_and_the_rest_is_the_clean_mesh() {
        let clean = sound(&POINTS[..4], &[&[0, 1, 2, 3]]);
        let (triangles, follows, warnings) = &clean;
        assert!(triangles.len() == 2 && warnings.is_empty() && follows.is_empty(), "{clean:?}");
        // Turned, so that its shorter diagonal is another on a tie; flipped; the half of it; without area in three ways.
        let faces: [&[u32]; 7] =
            [&[0, 1, 2, 3], &[1, 2, 3, 0], &[3, 2, 1, 0], &[2, 1, 0], &[0, 1, 4], &[2, 5, 3], &[0, 0, 3]];
        let odd = sound(&POINTS, &faces);
        assert_eq!(&odd.0, triangles);
        assert_eq!(odd.1, [[4, 1], [5, 2]].map(|[vertex, leader]| MergedInto { vertex, leader }));
        let said = odd.2.join("\n");
        for part in [
            "faces 1, 2, 3 duplicate",
            "faces 4, 5, 6 have no area",
            "vertices 4, 5 belong only",
            "vertices 6 belong to no",
        ] {
            assert!(said.contains(part), "{part}\n{said}");
        }
    }

    #[test]
    fn faces_that_share_some_corners_are_not_repeated() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 1.0]];
        let (triangles, _, warnings) = sound(&points, &[&[0, 1, 2, 3], &[0, 1, 2, 4]]);
        assert_eq!(triangles.len(), 4);
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn a_mesh_without_faces_or_points_is_said_to_be_one() {
        for points in [&POINTS[..3], &[]] {
            let (triangles, _, warnings) = sound(points, &[]);
            assert!(triangles.is_empty() && warnings[0].contains("it has no faces"), "{warnings:?}");
        }
    }

    /// Faces of three to five corners on points of a small grid: many have no area, and many are there twice.
    fn soup(seed: u64) -> (Vec<[f64; 3]>, Vec<Vec<u32>>) {
        let mut random = SplitMix64::new(seed);
        let mut below = |end: usize| ((random.signed() + 1.0) * 0.5 * end as f64) as usize;
        let points: Vec<[f64; 3]> = (0..24).map(|_| [below(3), below(3), below(2)].map(|c| c as f64)).collect();
        let mut faces: Vec<Vec<u32>> = Vec::new();
        for _ in 0..10 {
            let corners = 3 + below(3);
            let mut face: Vec<u32> = (0..corners).map(|_| below(points.len() - 4) as u32).collect();
            if !faces.is_empty() && below(3) == 0 {
                face.clone_from(&faces[below(faces.len())]);
                let turns = below(face.len());
                face.rotate_left(turns);
                if below(2) == 0 {
                    face.reverse();
                }
            }
            faces.push(face);
        }
        (points, faces)
    }

    #[test]
    fn any_ranks_leave_out_what_one_look_after_the_other_at_the_whole_mesh_leaves_out() {
        let (mut twice, mut led) = (0, 0);
        for seed in 0..40 {
            let (points, faces) = soup(seed);
            let (found, follows, _) = sound(&points, &faces.iter().map(Vec::as_slice).collect::<Vec<_>>());
            let at = |v: u32| Vec3::from(points[v as usize]);
            let set = |corners: &[u32]| {
                let mut set = corners.to_vec();
                set.sort_unstable();
                set
            };
            let (mut seen, mut triangles, mut flat) = (BTreeSet::new(), Vec::new(), Vec::new());
            for (polygon, corners) in (0..).zip(&faces) {
                if corners.len() > 3 && !seen.insert(set(corners)) {
                    twice += 1;
                    continue;
                }
                let mut cut = Vec::new();
                triangulate_face(at, corners, &mut cut);
                for [a, b, c] in cut {
                    // Exact on a grid of small integers.
                    if (at(b) - at(a)).cross(&(at(c) - at(a))) == Vec3::zeros() {
                        flat.push([a, b, c]);
                    } else {
                        triangles.push(Triangle { polygon, corners: [a, b, c] });
                    }
                }
            }
            seen.clear();
            triangles.retain(|triangle| seen.insert(set(&triangle.corners)));
            assert_eq!(found, triangles, "soup {seed}");
            let lives = |v: u32| triangles.iter().any(|triangle| triangle.corners.contains(&v));
            let leader = |v: u32| {
                let near = flat.iter().filter(|corners| corners.contains(&v)).flatten().filter(|w| lives(**w));
                let nearer =
                    |a: &&u32, b: &&u32| (at(**a) - at(v)).norm().total_cmp(&(at(**b) - at(v)).norm()).then(a.cmp(b));
                near.min_by(nearer).map(|leader| MergedInto { vertex: v, leader: *leader })
            };
            let expected: Vec<MergedInto> =
                (0..points.len() as u32).filter(|v| !lives(*v)).filter_map(leader).collect();
            assert_eq!(follows, expected, "soup {seed}");
            led += expected.len();
        }
        assert!(twice > 12 && led > 2, "{twice} faces were there twice, {led} vertices followed another");
    }
}

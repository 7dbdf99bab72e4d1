//! Vertices of a garment in one place that nothing joins: borders of panels that meet without being merged, sides of a slit.
//!
//! Cloth that touches itself at the start has no side on which to stay. Each such vertex is therefore drawn into its own
//! triangles by a share of their size that nobody sees, before anything is derived from the mesh: the borders then lie side by
//! side, and contact keeps them there. Layers that lie on each other as a whole have no such way apart and stay as they are.
//!
//! Vertices meet on a rank that their place says, whatever their numbers; whoever has their triangles tells what these ask for.

use crate::Vec3;
use crate::parallel::ranks::Ranks;
use crate::parallel::spread::{Homes, ask};
use crate::scene::home::{Known, joined};
use crate::scene::inert::Sound;
use crate::scene::listed;
use crate::tolerances::SET_APART;

/// What is set apart of a garment.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Apart {
    /// Vertices and their new places [m]; each on one rank.
    pub(super) moved: Vec<(u32, Vec3)>,
    /// Those of them that were in one place, lower numbers first; each on one rank.
    pub(super) pairs: Vec<[u32; 2]>,
}

/// Bits of a position, both zeros alike, and the vertex that is there.
type Row = [u64; 4];

impl Apart {
    /// Draws vertices that lie where others are into their triangles. `points` are the positions of the vertices at home here,
    /// by which `homes` go. All ranks call it together.
    pub(super) fn of(ranks: &Ranks, homes: &Homes, points: &[Vec3], sound: &Sound) -> Self {
        let groups = coinciding(ranks, homes, points, &sound.lives);
        if !ranks.any(!groups.is_empty()) {
            return Self::default();
        }
        let first = homes.rows(ranks.rank()).start;
        let mut lists = vec![Vec::new(); ranks.count()];
        groups.iter().flatten().for_each(|v| lists[homes.of(*v as usize)].push(*v));
        let mut coincides = vec![0; points.len()];
        ranks.send_lists(lists).into_iter().flatten().for_each(|v| coincides[v as usize - first] = 1);
        let inwards = inwards(ranks, homes, points, (sound, &coincides));
        // All that coincides at home here is among them.
        let row = |v: u32| inwards.partition_point(|(vertex, _)| *vertex < v);
        let moved = ask(ranks, &groups.concat(), |v| homes.of(v as usize), |v| inwards[row(v)].1);
        let mut moved = moved.as_slice();
        let mut apart = Self::default();
        for group in groups {
            let (places, rest) = moved.split_at(group.len());
            moved = rest;
            if places.iter().any(|place| *place != places[0]) {
                apart.pairs.extend(group.windows(2).map(|pair| [pair[0], pair[1]]));
                apart.moved.extend(group.into_iter().zip(places.iter().copied()));
            }
        }
        apart
    }
}

/// Says in words, on rank 0, which vertices of a garment were set apart, at rest or at the start. All ranks call it together.
pub(super) fn told(ranks: &Ranks, name: &str, homes: &Homes, pairs: Vec<[u32; 2]>) -> Option<String> {
    // A pair may be known to one rank by its places at rest, and to another by those at the start.
    let mut lists = vec![Vec::new(); ranks.count()];
    pairs.into_iter().for_each(|pair| lists[homes.of(pair[0] as usize)].push(pair));
    let list = listed(ranks, joined(ranks.send_lists(lists)))?;
    let share = 1.0 / SET_APART;
    ranks.is_first().then(|| {
        format!(
            "garment \"{name}\": vertices {list} lie in one place without being joined: they are set apart by about \
             1/{share:.0} of their edges, so that they can touch; merge by distance what belongs together"
        )
    })
}

/// Vertices with triangles that lie in one place, ascending; each group on one rank.
fn coinciding(ranks: &Ranks, homes: &Homes, points: &[Vec3], lives: &[u8]) -> Vec<Vec<u32>> {
    let mut lists: Vec<Vec<Row>> = vec![Vec::new(); ranks.count()];
    let vertices = homes.rows(ranks.rank()).start as u64..;
    for ((vertex, point), _) in vertices.zip(points).zip(lives).filter(|(_, lives)| **lives != 0) {
        // Adding zero turns a negative zero into the positive one.
        let [x, y, z] = [point.x, point.y, point.z].map(|c| (c + 0.0).to_bits());
        lists[meeting_place([x, y, z], ranks.count())].push([x, y, z, vertex]);
    }
    let mut rows = joined(ranks.send_lists(lists));
    rows.sort_unstable();
    let groups = rows.chunk_by(|a, b| a[..3] == b[..3]).filter(|group| group.len() > 1);
    groups.map(|group| group.iter().map(|row| row[3] as u32).collect()).collect()
}

/// The rank on which those meet whose positions have these bits.
fn meeting_place(bits: [u64; 3], ranks: usize) -> usize {
    // Fibonacci hashing: multiplying by 2^64 over the golden ratio spreads what differs in a few bits over the upper ones.
    const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
    let mixed = bits.into_iter().fold(0u64, |hash, bits| (hash.rotate_left(u64::BITS / 2) ^ bits).wrapping_mul(GOLDEN));
    (mixed >> (u64::BITS / 2)) as usize % ranks
}

/// The new places [m] of the vertices at home here that coincide with others, ascending.
fn inwards(
    ranks: &Ranks,
    homes: &Homes,
    points: &[Vec3],
    (sound, coincides): (&Sound, &[u8]),
) -> Vec<(u32, Vec3)> {
    let all = sound.triangles.iter().flat_map(|[_, corners @ ..]| *corners);
    let coincides = Known::new(ranks, all, homes, coincides);
    let touched: Vec<(u32, &[u32; 4])> = (0..)
        .zip(&sound.triangles)
        .filter(|(_, [_, corners @ ..])| corners.iter().any(|v| coincides.at(*v) != 0))
        .collect();
    let positions = Known::new(ranks, touched.iter().flat_map(|(_, [_, corners @ ..])| *corners), homes, points);
    // Vertex, polygon, number among the triangles at home there, and the way to the middle.
    let mut lists: Vec<Vec<[u64; 6]>> = vec![Vec::new(); ranks.count()];
    for (number, [polygon, corners @ ..]) in touched {
        let middle = corners.iter().map(|v| positions.at(*v)).sum::<Vec3>() / 3.0;
        for v in corners.iter().filter(|v| coincides.at(**v) != 0) {
            let [x, y, z] = <[f64; 3]>::from(middle - positions.at(*v)).map(f64::to_bits);
            let row = [u64::from(*v), u64::from(*polygon), u64::from(number), x, y, z];
            lists[homes.of(*v as usize)].push(row);
        }
    }
    let mut rows = joined(ranks.send_lists(lists));
    // So that the sums are those of a mesh at hand, triangle after triangle.
    rows.sort_unstable_by_key(|row| [row[0], row[1], row[2]]);
    let first = homes.rows(ranks.rank()).start;
    let moved = |group: &[[u64; 6]]| {
        let way = |row: &[u64; 6]| Vec3::new(f64::from_bits(row[3]), f64::from_bits(row[4]), f64::from_bits(row[5]));
        let ways: Vec3 = group.iter().map(way).sum();
        let vertex = group[0][0] as u32;
        (vertex, points[vertex as usize - first] + ways * (SET_APART / group.len() as f64))
    };
    rows.chunk_by(|a, b| a[0] == b[0]).map(moved).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PolygonMesh;

    /// Two squares side by side in the plane, whose common border has two vertices at each end.
    fn panels() -> (GarmentDescription, Vec<[u32; 3]>) {
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]];
        let points = points.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        (GarmentDescription::new("skirt", PolygonMesh::from_triangles(points, &triangles), 0.2), triangles)
    }

    #[test]
    fn borders_in_one_place_move_into_their_own_panels_by_a_share_of_their_edges_and_are_named() {
        let (mut garment, triangles) = panels();
        let before = garment.mesh.points.clone();
        let said = set_apart(&mut garment, &triangles).unwrap();
        assert!(said.contains("vertices 1-4, 2-7 lie in one place"), "{said}");
        let after = &garment.mesh.points;
        for (left, right) in [(1, 4), (2, 7)] {
            assert!(after[left].x < 1.0 && after[right].x > 1.0, "{after:?}");
            assert!((after[left] - after[right]).norm() < 2.0 * SET_APART);
        }
        assert!([0, 3, 5, 6].into_iter().all(|v: usize| after[v] == before[v]));
    }

    #[test]
    fn a_start_of_its_own_is_set_apart_without_the_shape_at_rest() {
        let (mut garment, triangles) = panels();
        garment.start = Some(garment.mesh.points.clone());
        garment.mesh.points[4..].iter_mut().for_each(|p| p.x += 1.0);
        let rest = garment.mesh.points.clone();
        assert!(set_apart(&mut garment, &triangles).is_some());
        assert_eq!(garment.mesh.points, rest);
        assert_ne!(garment.start.as_ref().unwrap()[1], garment.start.as_ref().unwrap()[4]);
    }

    #[test]
    fn layers_on_each_other_and_meshes_without_coinciding_vertices_stay() {
        let (mut garment, mut triangles) = panels();
        garment.mesh.points.truncate(4);
        triangles.truncate(2);
        let clean = garment.mesh.points.clone();
        assert_eq!(set_apart(&mut garment, &triangles), None);
        assert_eq!(garment.mesh.points, clean);
        garment.mesh.points.extend(clean.clone());
        triangles.extend([[4, 5, 6], [4, 6, 7]]);
        assert_eq!(set_apart(&mut garment, &triangles), None);
        assert_eq!(garment.mesh.points, [clean.clone(), clean].concat());
    }
}

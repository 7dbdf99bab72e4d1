//! Vertices of a garment in one place that nothing joins: borders of panels that meet without being merged, sides of a slit.
//!
//! Cloth that touches itself at the start has no side on which to stay. Each such vertex is therefore drawn into its own
//! triangles by a share of their size that nobody sees, before anything is derived from the mesh: the borders then lie side by
//! side, and contact keeps them there. Layers that lie on each other as a whole have no such way apart and stay as they are.
//!
//! Vertices are compared on a rank that follows from their position, whatever their numbers; the rank of their triangles sends the
//! directions into these.

use bytemuck::{Pod, Zeroable};

use crate::Vec3;
use crate::parallel::problems::listed;
use crate::parallel::ranks::Ranks;
use crate::setup::distribute::block_rows::{BlockDistribution, fetch};
use crate::setup::distribute::even_blocks::{FetchedValues, joined};
use crate::setup::distribute::one_ring::Triangle;
use crate::setup::mesh_checks::degenerate::CleanMesh;
use crate::tolerances::SET_APART;

/// Vertices of a garment that are set apart.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Apart {
    /// Vertices and their new places [m]; each on one rank.
    pub(crate) moved: Vec<(u32, Vec3)>,
    /// Pairs of these vertices that were in one place, lower numbers first; each on one rank.
    pub(crate) pairs: Vec<[u32; 2]>,
}

/// A vertex where it meets those in its place. Packed, so that nothing lies between its end and the next.
#[repr(C, packed(4))]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PlacedVertex {
    /// Rest position or start [m], both zeros alike.
    position: Vec3,
    vertex: u32,
}

impl PlacedVertex {
    /// Returns the bits of the position, which are equal for two vertices in one place.
    fn bits(&self) -> [u64; 3] {
        <[f64; 3]>::from(self.position).map(f64::to_bits)
    }
}

/// The way from a vertex into one of its triangles; packed likewise.
#[repr(C, packed(4))]
#[derive(Clone, Copy, Pod, Zeroable)]
struct WayInwards {
    vertex: u32,
    polygon: u32,
    /// Number of the triangle where its polygon is in the block.
    triangle: u32,
    /// From the vertex to the middle of the triangle [m].
    way: Vec3,
}

impl Apart {
    /// Draws vertices that lie where others are into their triangles. `points` are the positions of the vertices in this rank's block,
    /// by which `blocks` go. All ranks call it together.
    pub(crate) fn of(ranks: &Ranks, blocks: &BlockDistribution, points: &[Vec3], sound: &CleanMesh) -> Self {
        let groups = coinciding(ranks, blocks, points, &sound.lives);
        if !ranks.any(!groups.is_empty()) {
            return Self::default();
        }
        let first = blocks.rows(ranks.rank()).start;
        let mut lists = vec![Vec::new(); ranks.count()];
        groups.iter().flatten().for_each(|v| lists[blocks.of(*v as usize)].push(*v));
        let mut coincides = vec![0; points.len()];
        ranks.all_to_all_v(lists).into_iter().flatten().for_each(|v| coincides[v as usize - first] = 1);
        let inwards = inwards(ranks, blocks, points, sound, &coincides);
        // All that coincides in this rank's block is among them.
        let row = |v: u32| inwards.partition_point(|(vertex, _)| *vertex < v);
        let moved = fetch(ranks, &groups.concat(), |v| blocks.of(v as usize), |v| inwards[row(v)].1);
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
pub(crate) fn warning(ranks: &Ranks, name: &str, blocks: &BlockDistribution, pairs: Vec<[u32; 2]>) -> Option<String> {
    // A pair may be known to one rank by its places at rest, and to another by those at the start.
    let mut lists = vec![Vec::new(); ranks.count()];
    pairs.into_iter().for_each(|pair| lists[blocks.of(pair[0] as usize)].push(pair));
    let list = listed(ranks, joined(ranks.all_to_all_v(lists)))?;
    let share = 1.0 / SET_APART;
    ranks.is_first().then(|| {
        format!(
            "garment \"{name}\": vertices {list} coincide but are not joined: they are moved apart by about \
             1/{share:.0} of their edges so that they can collide; merge by distance what belongs together"
        )
    })
}

/// Vertices with triangles that lie in one place, ascending; each group on one rank.
fn coinciding(ranks: &Ranks, blocks: &BlockDistribution, points: &[Vec3], lives: &[u8]) -> Vec<Vec<u32>> {
    let mut lists: Vec<Vec<PlacedVertex>> = vec![Vec::new(); ranks.count()];
    let vertices = blocks.rows(ranks.rank()).start as u32..;
    for ((vertex, point), _) in vertices.zip(points).zip(lives).filter(|(_, lives)| **lives != 0) {
        // Adding zero turns a negative zero into the positive one.
        let placed = PlacedVertex { position: point.add_scalar(0.0), vertex };
        lists[meeting_place(placed.bits(), ranks.count())].push(placed);
    }
    let mut rows = joined(ranks.all_to_all_v(lists));
    rows.sort_unstable_by_key(|row| (row.bits(), row.vertex));
    let groups = rows.chunk_by(|a, b| a.bits() == b.bits()).filter(|group| group.len() > 1);
    groups.map(|group| group.iter().map(|row| row.vertex).collect()).collect()
}

/// The rank on which those meet whose positions have these bits.
fn meeting_place(bits: [u64; 3], ranks: usize) -> usize {
    // Fibonacci hashing: multiplying by 2^64 over the golden ratio spreads what differs in a few bits over the upper ones.
    const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
    let mixed = bits.into_iter().fold(0u64, |hash, bits| (hash.rotate_left(u64::BITS / 2) ^ bits).wrapping_mul(GOLDEN));
    (mixed >> (u64::BITS / 2)) as usize % ranks
}

/// The new places [m] of the vertices in this rank's block that coincide with others, ascending.
fn inwards(
    ranks: &Ranks,
    blocks: &BlockDistribution,
    points: &[Vec3],
    sound: &CleanMesh,
    coincides: &[u8],
) -> Vec<(u32, Vec3)> {
    let all = sound.triangles.iter().flat_map(|triangle| triangle.corners);
    let coincides = FetchedValues::new(ranks, all, blocks, coincides);
    let touched: Vec<(u32, &Triangle)> = (0..)
        .zip(&sound.triangles)
        .filter(|(_, triangle)| triangle.corners.iter().any(|v| coincides.at(*v) != 0))
        .collect();
    let positions = FetchedValues::new(ranks, touched.iter().flat_map(|(_, t)| t.corners), blocks, points);
    let mut lists: Vec<Vec<WayInwards>> = vec![Vec::new(); ranks.count()];
    for (triangle, &Triangle { polygon, corners }) in touched {
        let middle = corners.iter().map(|v| positions.at(*v)).sum::<Vec3>() / 3.0;
        for v in corners.iter().filter(|v| coincides.at(**v) != 0) {
            let way = middle - positions.at(*v);
            lists[blocks.of(*v as usize)].push(WayInwards { vertex: *v, polygon, triangle, way });
        }
    }
    let mut rows = joined(ranks.all_to_all_v(lists));
    // So that the sums are those of a mesh at hand, triangle after triangle.
    rows.sort_unstable_by_key(|row| (row.vertex, row.polygon, row.triangle));
    let first = blocks.rows(ranks.rank()).start;
    let moved = |group: &[WayInwards]| {
        let inwards: Vec3 = group.iter().map(|row| row.way).sum();
        let vertex = group[0].vertex;
        (vertex, points[vertex as usize - first] + inwards * (SET_APART / group.len() as f64))
    };
    rows.chunk_by(|a, b| a.vertex == b.vertex).map(moved).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PolygonMesh;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};

    /// Positions at rest and at the start, vertex after vertex of the garment, and warnings.
    type Found = ([Vec<Vec3>; 2], Vec<String>);

    fn handed_out_by(count: usize, garment: &GarmentDescription) -> Found {
        let all = LocalRanks::run(count, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let mut description = SceneDescription::new("skirt");
            description.garments.push(garment.clone());
            description.effects.push(EffectRequest::of_scene("self_repulsion"));
            let scene = Scene::distribute(&ranks, ranks.is_first().then_some(description));
            let scene = scene.unwrap_or_else(|problems| panic!("{problems}"));
            let ([start, _], rest) = (scene.start_state(), scene.rest_positions());
            let row = |local: usize| (scene.parts().own_vertex(local).1, [rest[local], start[local]]);
            (scene.parts().own().map(row).collect::<Vec<_>>(), scene.warnings().to_vec())
        });
        let all = all.expect("no rank ends early");
        let mut rows: Vec<(u32, [Vec3; 2])> = all.iter().flat_map(|(rows, _)| rows.clone()).collect();
        rows.sort_unstable_by_key(|(vertex, _)| *vertex);
        ([0, 1].map(|side| rows.iter().map(|(_, places)| places[side]).collect()), all[0].1.clone())
    }

    /// Returns the result that any number of ranks get alike.
    fn handed_out(garment: &GarmentDescription) -> Found {
        let alone = handed_out_by(1, garment);
        (2..6).for_each(|ranks| assert_eq!(handed_out_by(ranks, garment), alone, "{ranks} ranks"));
        alone
    }

    /// Two squares side by side in the plane, whose common border has two vertices at each end; at one of them the zeros have
    /// other signs.
    fn panels() -> GarmentDescription {
        let points =
            [[-1.0, 0.0], [0.0, 0.0], [-0.0, 1.0], [-1.0, 1.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let points = points.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        GarmentDescription::new("skirt", PolygonMesh::from_triangles(points, &triangles), 0.2)
    }

    #[test]
    fn borders_in_one_place_move_into_their_own_panels_by_a_share_of_their_edges_and_are_named() {
        let garment = panels();
        let before = &garment.mesh.points;
        let ([after, _], said) = handed_out(&garment);
        assert!(said.concat().contains("vertices 1-4, 2-7 coincide"), "{said:?}");
        for (left, right) in [(1, 4), (2, 7)] {
            assert!(after[left].x < 0.0 && after[right].x > 0.0, "{after:?}");
            assert!((after[left] - after[right]).norm() < 2.0 * SET_APART);
        }
        assert!([0, 3, 5, 6].into_iter().all(|v: usize| after[v] == before[v]));
    }

    #[test]
    fn a_start_of_its_own_is_set_apart_without_the_shape_at_rest() {
        let mut garment = panels();
        garment.start = Some(garment.mesh.points.clone());
        garment.mesh.points[4..].iter_mut().for_each(|p| p.x += 1.0);
        let ([rest, start], said) = handed_out(&garment);
        assert_eq!(said.len(), 1);
        assert_eq!(rest, garment.mesh.points);
        assert_ne!(start[1], start[4]);
    }

    #[test]
    fn layers_on_each_other_and_meshes_without_coinciding_vertices_stay() {
        let mut garment = panels();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let clean = garment.mesh.points[..4].to_vec();
        garment.mesh = PolygonMesh::from_triangles(clean.clone(), &triangles[..2]);
        assert_eq!(handed_out(&garment), ([clean.clone(), clean.clone()], Vec::new()));
        let both = [clean.clone(), clean].concat();
        garment.mesh = PolygonMesh::from_triangles(both.clone(), &triangles);
        assert_eq!(handed_out(&garment), ([both.clone(), both], Vec::new()));
    }

    /// Points along a side of each panel.
    const SIDE: usize = 60;

    /// Two panels of quads, numbered at random, whose points along the common border lie in one place.
    fn large_panels() -> PolygonMesh {
        let count = 2 * SIDE * SIDE;
        // 7919 is prime and no divisor of the number of points.
        let number = |place: usize| (place * 7919 % count) as u32;
        let mut mesh = PolygonMesh { points: vec![Vec3::zeros(); count], ..PolygonMesh::default() };
        for place in 0..count {
            let (panel, row, column) = (place / (SIDE * SIDE), place / SIDE % SIDE, place % SIDE);
            // The first panel lies to the left of the border, and the second to the right of it.
            let x = if panel == 0 { -0.013 * (SIDE - 1 - column) as f64 } else { 0.017 * column as f64 };
            let z = 0.011 * row as f64;
            mesh.points[number(place) as usize] = Vec3::new(x, 0.01 * (40.0 * x).sin() * (30.0 * z).cos(), z);
            if row + 1 < SIDE && column + 1 < SIDE {
                mesh.face_counts.push(4);
                mesh.face_indices.extend([place, place + SIDE, place + SIDE + 1, place + 1].map(number));
            }
        }
        mesh
    }

    #[test]
    fn any_ranks_sum_up_the_ways_inwards_triangle_after_triangle() {
        let mesh = large_panels();
        let triangles = mesh.triangulate().0;
        let mut expected = mesh.points.clone();
        let mut names = 0;
        for (v, p) in mesh.points.iter().enumerate() {
            let twins = mesh.points.iter().filter(|q| *q == p).count();
            if twins == 1 {
                continue;
            }
            names += 1;
            let (mut inwards, mut count) = (Vec3::zeros(), 0.0);
            for corners in triangles.iter().filter(|corners| corners.contains(&(v as u32))) {
                let [a, b, c] = corners.map(|corner| mesh.points[corner as usize]);
                inwards += (a + b + c) / 3.0 - p;
                count += 1.0;
            }
            expected[v] += inwards * (SET_APART / count);
        }
        assert_eq!(names, 2 * SIDE);
        let garment = GarmentDescription::new("skirt", mesh, 0.2);
        let ([after, _], said) = handed_out(&garment);
        assert_eq!(after, expected);
        assert!(said.concat().contains(&format!("and {} more coincide", SIDE - 5)), "{said:?}");
    }
}

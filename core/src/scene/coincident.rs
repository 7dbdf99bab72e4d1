//! Vertices of a garment in one place that nothing joins: borders of panels that meet without being merged, sides of a slit.
//!
//! Cloth that touches itself at the start has no side on which to stay. Each such vertex is therefore drawn into its own
//! triangles by a share of their size that nobody sees, before anything is derived from the mesh: the borders then lie side by
//! side, and contact keeps them there. Layers that lie on each other as a whole have no such way apart and stay as they are.

use crate::Vec3;
use crate::scene::GarmentDescription;
use crate::tolerances::SET_APART;

/// Pairs that a warning lists before the rest is only counted.
const LISTED: usize = 5;

/// Sets apart what coincides at rest and at the start, each for itself; says in words what that was.
pub(super) fn set_apart(garment: &mut GarmentDescription, triangles: &[[u32; 3]]) -> Option<String> {
    let mut pairs = apart(&mut garment.mesh.points, triangles);
    if let Some(start) = &mut garment.start {
        pairs.extend(apart(start, triangles));
    }
    pairs.sort_unstable();
    pairs.dedup();
    let names: Vec<String> = pairs.iter().take(LISTED).map(|[a, b]| format!("{a}-{b}")).collect();
    let more = match pairs.len() - names.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let (name, share) = (&garment.name, 1.0 / SET_APART);
    (!pairs.is_empty()).then(|| {
        format!(
            "garment \"{name}\": vertices {}{more} lie in one place without being joined: they are set apart by about 1/{share:.0} \
             of their edges, so that they can touch; merge by distance what belongs together",
            names.join(", ")
        )
    })
}

/// Draws vertices that lie where others are into their triangles; returns the pairs that are apart now, lower numbers first.
fn apart(points: &mut [Vec3], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mut lives = vec![false; points.len()];
    triangles.iter().flatten().for_each(|v| lives[*v as usize] = true);
    let mut order: Vec<u32> = (0..points.len() as u32).filter(|v| lives[*v as usize]).collect();
    let place = |v: u32, points: &[Vec3]| <[f64; 3]>::from(points[v as usize]);
    let along = |a: &u32, b: &u32| {
        let (p, q) = (place(*a, points), place(*b, points));
        p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])).then(p[2].total_cmp(&q[2])).then(a.cmp(b))
    };
    order.sort_unstable_by(along);
    let groups: Vec<Vec<u32>> = order
        .chunk_by(|a, b| place(*a, points) == place(*b, points))
        .filter(|group| group.len() > 1)
        .map(<[u32]>::to_vec)
        .collect();
    drop(order);
    if groups.is_empty() {
        return Vec::new();
    }
    let mut inwards: Vec<(u32, Vec3, f64)> = groups.concat().into_iter().map(|v| (v, Vec3::zeros(), 0.0)).collect();
    inwards.sort_unstable_by_key(|(vertex, ..)| *vertex);
    for corners in triangles {
        let middle = corners.iter().map(|v| points[*v as usize]).sum::<Vec3>() / 3.0;
        for v in corners {
            if let Ok(row) = inwards.binary_search_by_key(v, |(vertex, ..)| *vertex) {
                inwards[row].1 += middle - points[*v as usize];
                inwards[row].2 += 1.0;
            }
        }
    }
    let moved = |v: u32| {
        // All of the groups are there.
        let row = inwards.partition_point(|(vertex, ..)| *vertex < v);
        points[v as usize] + inwards[row].1 * (SET_APART / inwards[row].2)
    };
    let parts = |group: &&Vec<u32>| group.iter().any(|v| moved(*v) != moved(group[0]));
    let groups: Vec<&Vec<u32>> = groups.iter().filter(parts).collect();
    let places: Vec<(u32, Vec3)> = groups.iter().flat_map(|group| group.iter().map(|v| (*v, moved(*v)))).collect();
    places.into_iter().for_each(|(vertex, place)| points[vertex as usize] = place);
    groups.into_iter().flat_map(|group| group.windows(2)).map(|pair| [pair[0], pair[1]]).collect()
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

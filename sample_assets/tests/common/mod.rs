//! Slow, obvious judges for the generated meshes.

use std::collections::BTreeMap;

use drapery_assets::sdf::Vec3;
use drapery_assets::surface_mesh::SurfaceMesh;

/// Several meshes as one.
pub(crate) fn together(meshes: &[&SurfaceMesh]) -> SurfaceMesh {
    let mut all = SurfaceMesh::default();
    for mesh in meshes {
        let first = all.points.len();
        all.points.extend(&mesh.points);
        all.faces.extend(mesh.faces.iter().map(|face| face.iter().map(|v| v + first).collect()));
    }
    all
}

/// Number of edge-triangle pairs without a common vertex that cross: zero if no surface crosses itself or another.
pub(crate) fn crossings(mesh: &SurfaceMesh) -> usize {
    let x = &mesh.points;
    let triangles = mesh.triangles();
    let flat = SurfaceMesh { points: x.clone(), faces: triangles.iter().map(|t| t.to_vec()).collect() };
    let edges = flat.edges();
    let bin = 2.0 * flat.mean_edge();
    let bins_of = |points: &[Vec3]| {
        let cell = |p: Vec3| p.map(|value| (value / bin).floor() as i64);
        let lower = cell(points.iter().copied().reduce(|a, b| a.inf(&b)).unwrap());
        let upper = cell(points.iter().copied().reduce(|a, b| a.sup(&b)).unwrap());
        (lower.x..=upper.x)
            .flat_map(move |i| (lower.y..=upper.y).map(move |j| (i, j)))
            .flat_map(move |(i, j)| (lower.z..=upper.z).map(move |k| [i, j, k]))
    };
    let mut in_bin: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for (i, t) in triangles.iter().enumerate() {
        for at in bins_of(&t.map(|v| x[v])) {
            in_bin.entry(at).or_default().push(i);
        }
    }
    let mut found = 0;
    for ([a, b], _) in edges {
        let mut near: Vec<usize> =
            bins_of(&[x[a], x[b]]).flat_map(|at| in_bin.get(&at).cloned().unwrap_or_default()).collect();
        near.sort_unstable();
        near.dedup();
        found += near
            .into_iter()
            .filter(|&i| !triangles[i].contains(&a) && !triangles[i].contains(&b))
            .filter(|&i| segment_crosses(x[a], x[b], triangles[i].map(|v| x[v])))
            .count();
    }
    found
}

fn segment_crosses(p: Vec3, q: Vec3, [a, b, c]: [Vec3; 3]) -> bool {
    // Six times the volume of a tetrahedron; rounding is about 1e-19 m3 here, and on a flat or conical surface all of
    // them are rounding.
    let side = |a: Vec3, b: Vec3, c: Vec3, d: Vec3| {
        let volume = (b - a).cross(&(c - a)).dot(&(d - a));
        if volume.abs() < 1e-15 { 0.0 } else { volume.signum() }
    };
    let turns = side(p, q, a, b) + side(p, q, b, c) + side(p, q, c, a);
    side(a, b, c, p) * side(a, b, c, q) < 0.0 && turns.abs() == 3.0
}

/// Smallest distance \[m\] from vertices, edge middles and face centres of `from` to the triangles of `to`.
pub(crate) fn gap(from: &SurfaceMesh, to: &SurfaceMesh) -> f64 {
    let triangles: Vec<[Vec3; 3]> = to.triangles().iter().map(|t| t.map(|v| to.points[v])).collect();
    samples(from)
        .iter()
        .map(|p| triangles.iter().map(|t| distance(p, t)).fold(f64::INFINITY, f64::min))
        .fold(f64::INFINITY, f64::min)
}

/// Vertices, edge middles and triangle centres.
pub(crate) fn samples(mesh: &SurfaceMesh) -> Vec<Vec3> {
    let x = &mesh.points;
    let middles = mesh.edges().into_iter().map(|([a, b], _)| (x[a] + x[b]) / 2.0);
    let centers = mesh.triangles().into_iter().map(|[a, b, c]| (x[a] + x[b] + x[c]) / 3.0);
    x.iter().copied().chain(middles).chain(centers).collect()
}

fn distance(p: &Vec3, t: &[Vec3; 3]) -> f64 {
    let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let over = |i: usize| (t[(i + 1) % 3] - t[i]).cross(&(p - t[i])).dot(&normal) >= 0.0;
    if (0..3).all(over) {
        return (p - t[0]).dot(&normal).abs() / normal.norm();
    }
    let to_edge = |i: usize| {
        let along = t[(i + 1) % 3] - t[i];
        let s = ((p - t[i]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (t[i] + along * s - p).norm()
    };
    to_edge(0).min(to_edge(1)).min(to_edge(2))
}

#[test]
fn two_crossing_triangles_are_counted_and_measured() {
    let triangle =
        |points: [[f64; 3]; 3]| SurfaceMesh { points: points.map(Vec3::from).to_vec(), faces: vec![vec![0, 1, 2]] };
    let flat = triangle([[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
    let through = triangle([[0.2, 0.2, -0.5], [0.2, 0.2, 0.5], [0.9, 0.9, 0.9]]);
    let above = triangle([[0., 0., 0.3], [1., 0., 0.3], [0., 1., 0.3]]);
    assert_eq!(crossings(&together(&[&flat, &through])), 2); // one edge each way
    assert_eq!(crossings(&together(&[&flat, &above])), 0);
    assert!((gap(&above, &flat) - 0.3).abs() < 1e-12);
}

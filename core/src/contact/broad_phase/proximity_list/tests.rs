use super::*;
use crate::contact::ccd;
use crate::contact::topology::pair::KINDS;
use crate::geometry::random::SplitMix64;
use crate::mesh::PolygonMesh;
use crate::scene::{GarmentDescription, Scene, SceneDescription};

pub(crate) mod ranks;

const N: usize = 7;

/// Two small sheets, crumpled into each other.
fn crumpled(random: &mut SplitMix64) -> (Scene, Vec<Vec3>) {
    let at = |k: usize| Vec3::new((k % N) as f64, 0.0, (k / N) as f64) * 0.01;
    let corners = (0..(N - 1) * N).filter(|k| k % N < N - 1).map(|k| k as u32);
    let triangles: Vec<_> =
        corners.flat_map(|k| [[k, k + N as u32, k + 1], [k + 1, k + N as u32, k + 1 + N as u32]]).collect();
    let mesh = PolygonMesh::from_triangles((0..N * N).map(at).collect(), &triangles);
    let mut description = SceneDescription::new("crumpled");
    for name in ["one", "two"] {
        let garment = GarmentDescription { thickness: 0.002, ..GarmentDescription::new(name, mesh.clone(), 0.2) };
        description.garments.push(garment);
    }
    let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
    let x = crate::state::State::at_start(&scene).x;
    let x = x.iter().map(|x| x + random.vector() * 0.008).collect();
    (scene, x)
}

/// Every pair of a point and a triangle, and of two edges, without a common node.
fn all_pairs(surface: &ContactSurface) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for &[a, b, c] in surface.cloth().triangles() {
        let points = (0..surface.node_count() as u32).filter(|p| ![a, b, c].contains(p));
        pairs.extend(points.map(|p| Pair { kind: PairKind::PointTriangle, nodes: [p, a, b, c] }));
    }
    for e in surface.cloth().edges() {
        for f in surface.cloth().edges() {
            if e < f && !e.iter().any(|node| f.contains(node)) {
                pairs.push(Pair { kind: PairKind::EdgeEdge, nodes: [e[0], e[1], f[0], f[1]] });
            }
        }
    }
    pairs
}

#[test]
fn a_list_of_neighbours_holds_all_that_brute_force_finds() {
    let mut random = SplitMix64::new(91);
    for reach in [0.05, 0.3] {
        let (scene, x) = crumpled(&mut random);
        let mut surface = ContactSurface::new(&scene, 0.4);
        let mut search = PairSearch::new();
        let mut proximity = ProximityList::new(&surface, PairOrder::Coloured);
        assert!(proximity.update_displacements(&surface, &x, &x).is_infinite(), "there is no list yet");
        proximity.rebuild(&mut surface, &mut search, &mut x.clone(), reach, 0.0);
        let all = all_pairs(&surface);
        for round in 0..5 {
            // Everything turns and falls together, and a little apart, up to the reach.
            let turn = nalgebra::Rotation3::new(random.vector() * 0.05 * f64::from(round));
            let shift = random.vector();
            let edge = surface.edge_length();
            let moved = |random: &mut SplitMix64| -> Vec<Vec3> {
                let own = |i: usize, random: &mut SplitMix64| random.vector().normalize() * 0.55 * reach * edge[i];
                x.iter().enumerate().map(|(i, x)| turn * x + shift + own(i, random)).collect()
            };
            let (start, end) = (moved(&mut random), moved(&mut random));
            let displacement = proximity.update_displacements(&surface, &start, &end);
            assert!(displacement <= proximity.skin(), "{displacement} in {}", proximity.skin());
            let mut found: Vec<Pair> = KINDS.iter().flat_map(|k| proximity.list(*k)).map(|n| n.pair).collect();
            found.sort_unstable();
            assert!(found.windows(2).all(|w| w[0] < w[1]), "each pair once");
            let (mut close, mut least) = (0, f64::INFINITY);
            for pair in &all {
                let reach = ACTIVE * surface.pair_thickness(pair);
                for share in [0.0, 0.3, 1.0] {
                    let now: Vec<Vec3> = start.iter().zip(&end).map(|(a, b)| a.lerp(b, share)).collect();
                    let distance = pair.closest(&pair.positions(&now)).apart.norm();
                    let listed = found.binary_search(pair);
                    assert!(distance > reach || listed.is_ok(), "{pair:?} at {distance}");
                    close += usize::from(distance <= reach);
                    if listed.is_ok() {
                        let same = |n: &&CandidatePair| n.pair == *pair;
                        let neighbour = proximity.list(pair.kind).iter().find(same).expect("it is in the list");
                        least = least.min(distance - proximity.distance_bound(neighbour));
                    }
                }
            }
            assert!(close > 100, "the sheets are close: {close}");
            assert!(least >= 0.0, "a bound is not above the distance: {least}");
        }
    }
}

#[test]
fn a_search_along_paths_meets_all_that_collides() {
    let mut random = SplitMix64::new(92);
    let (scene, start) = crumpled(&mut random);
    let surface = ContactSurface::new(&scene, 0.4);
    let end: Vec<Vec3> = start.iter().map(|x| x + random.vector() * 0.02).collect();
    let mut search = PairSearch::new();
    let mut found = Vec::new();
    search.refit(&surface, |i| Aabb::of_segment(&start[i], &end[i]));
    search.pairs(&surface, |pair, out| out.push(pair), &mut found);
    found.sort_unstable();
    assert!(found.windows(2).all(|w| w[0] < w[1]), "each pair once");
    let mut collide = 0;
    for pair in all_pairs(&surface) {
        let ends = [&start, &end].map(|x| pair.positions(x));
        let contact = match pair.kind {
            PairKind::PointTriangle => ccd::point_triangle(&ends[0], &ends[1], 0.0),
            PairKind::EdgeEdge => ccd::edge_edge(&ends[0], &ends[1], 0.0),
        };
        collide += usize::from(contact.is_some());
        assert!(contact.is_none() || found.binary_search(&pair).is_ok(), "{pair:?}");
    }
    assert!(collide > 100, "they collide: {collide}");
}

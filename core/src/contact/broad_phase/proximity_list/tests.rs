use std::collections::BTreeMap;

use super::*;
use crate::contact::broad_phase::swept_search::Inflation;
use crate::contact::ccd;
use crate::contact::topology::nodes::NodePaths;
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
        let mut proximity = ProximityList::new(&surface);
        assert!(
            proximity.update_displacements(&surface, [&x; 2].map(Vec::as_slice), [0.0; 2]).is_infinite(),
            "there is no list yet"
        );
        let density = proximity.density_with(&mut surface, &mut search, &mut x.clone(), reach, 0.0);
        assert!(proximity.reference().is_none(), "pairs are only counted");
        proximity.rebuild(&mut surface, &mut search, &mut x.clone(), reach, 0.0, None);
        assert_eq!(proximity.density(), density);
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
            let displacement = proximity.update_displacements(&surface, [&start, &end].map(Vec::as_slice), [0.0; 2]);
            assert!(displacement <= proximity.skin(), "{displacement} in {}", proximity.skin());
            assert_holds_all(&proximity, &surface, &all, [&start, &end]);
        }
    }
}

/// Checks that a list has each pair once, all that come close on these paths, and bounds that are not above distances.
fn assert_holds_all(proximity: &ProximityList, surface: &ContactSurface, all: &[Pair], [start, end]: [&[Vec3]; 2]) {
    let entries: BTreeMap<Pair, CandidatePair> =
        KINDS.iter().flat_map(|k| proximity.list(*k)).map(|n| (n.pair, n)).collect();
    assert_eq!(entries.len(), KINDS.iter().map(|k| proximity.list(*k).count()).sum::<usize>(), "each pair once");
    let (mut close, mut least) = (0, f64::INFINITY);
    for share in [0.0, 0.3, 1.0] {
        let now: Vec<Vec3> = start.iter().zip(end).map(|(a, b)| a.lerp(b, share)).collect();
        for pair in all {
            let distance = pair.closest(&pair.positions(&now)).apart.norm();
            let entry = entries.get(pair);
            let is_close = distance <= ACTIVE * surface.pair_thickness(pair);
            assert!(!is_close || entry.is_some(), "{pair:?} at {distance}");
            close += usize::from(is_close);
            least = entry.map_or(least, |entry| least.min(distance - proximity.distance_bound(entry)));
        }
    }
    assert!(close > 100, "the sheets are close: {close}");
    assert!(least >= 0.0, "a bound is not above the distance: {least}");
}

#[test]
fn a_list_around_predicted_paths_holds_all_that_brute_force_finds() {
    const REACH: f64 = 0.1;
    let mut random = SplitMix64::new(93);
    for duration in [0.5, 1e-3] {
        let (scene, mut x) = crumpled(&mut random);
        let mut surface = ContactSurface::new(&scene, 0.4);
        let mut proximity = ProximityList::new(&surface);
        let (all, shift) = (all_pairs(&surface), random.vector());
        let ends: Vec<Vec3> = x.iter().map(|x| x + shift + random.vector() * 0.01).collect();
        let predicted = PredictedPaths { ends: ends.clone(), duration };
        proximity.rebuild(&mut surface, &mut PairSearch::new(), &mut x, REACH, 0.0, Some(predicted));
        let edge = surface.edge_length().to_vec();
        for share in [0.0, 0.4, 1.0, 1.5] {
            // As far along the paths as time has come, or to their ends, and a little beside them.
            let beside = |i: usize, random: &mut SplitMix64| random.vector().normalize() * 0.9 * REACH * edge[i];
            let at = |i: usize| x[i].lerp(&ends[i], f64::min(share, 1.0));
            let end: Vec<Vec3> = (0..x.len()).map(|i| at(i) + beside(i, &mut random)).collect();
            let displacement = proximity.update_displacements(&surface, [&x, &end], [0.0, share * duration]);
            assert!(displacement <= proximity.skin(), "{displacement} in {}", proximity.skin());
            assert_holds_all(&proximity, &surface, &all, [&x, &end]);
            assert!(share > 0.0 || proximity.common_shift() == Vec3::zeros());
            assert!(share < 1.0 || (proximity.common_shift() - shift).norm() < 0.01);
            assert_eq!(proximity.count_beyond_skin(surface.nodes(), 0.0), 0);
        }
        // A node beside its path by more than its reach is named.
        let mut end = ends.clone();
        end[17] += Vec3::x() * 2.0 * REACH * edge[17];
        proximity.update_displacements(&surface, [&x, &end], [0.0, duration]);
        let mut marks = vec![0; x.len()];
        proximity.mark_beyond_skin(0.0, &mut marks);
        assert_eq!((proximity.count_beyond_skin(surface.nodes(), 0.0), marks[17]), (1, 1));
        assert_eq!(marks.iter().filter(|mark| **mark != 0).count(), 1);
    }
}

#[test]
fn a_search_along_paths_meets_all_that_collides() {
    let mut random = SplitMix64::new(92);
    let (scene, start) = crumpled(&mut random);
    let surface = ContactSurface::new(&scene, 0.4);
    let end: Vec<Vec3> = start.iter().map(|x| x + random.vector() * 0.02).collect();
    let mut search = PairSearch::new();
    search.refit(&surface, |i| Aabb::of_segment(&start[i], &end[i]));
    let mut found = search.pieces_of_pairs(&surface, |pair, out: &mut Vec<Pair>| out.push(pair), &|_| ()).concat();
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

#[test]
fn a_search_along_paths_holds_for_nodes_that_stop_anywhere_on_their_paths() {
    let inflation = Inflation { gap: 1e-5, margin: 0.02 };
    let mut random = SplitMix64::new(94);
    let (scene, start) = crumpled(&mut random);
    let mut surface = ContactSurface::new(&scene, 0.4);
    let (mut search, mut proximity) = (PairSearch::new(), ProximityList::new(&surface));
    let end: Vec<Vec3> = start.iter().map(|x| x + random.vector() * 0.02).collect();
    let mut paths = NodePaths { start: start.clone(), end: end.clone() };
    let mut pieces = Vec::new();
    search.swept_pairs(&mut surface, &mut proximity, &mut paths, inflation, &mut pieces);
    let mut found = pieces.concat();
    found.sort_unstable();
    let all = search.pieces_of_pairs(&surface, |_, count: &mut usize| *count += 1, &|_| ()).iter().sum::<usize>();
    assert!(10 * found.len() < 9 * all, "{} of {all} pairs whose boxes overlap may meet", found.len());
    let edge = surface.edge_length();
    let mut collide = 0;
    for round in 0..5 {
        // Somewhere on the path, or a little beside it.
        let mut stop = |i: usize| {
            let beside = random.vector().normalize() * 0.999 * inflation.margin * edge[i];
            start[i].lerp(&end[i], random.unit()) + beside * f64::from(round % 2)
        };
        let stops: Vec<Vec3> = (0..start.len()).map(&mut stop).collect();
        let covers = |i: usize, end: &Vec3| search.covers(i as u32, [&start[i], end], inflation.margin * edge[i]);
        assert!(stops.iter().enumerate().all(|(i, end)| covers(i, end)));
        let farther = |i: usize| end[i] + (end[i] - start[i]).normalize() * 1.001 * inflation.margin * edge[i];
        assert!((0..start.len()).all(|i| !covers(i, &farther(i))));
        for pair in all_pairs(&surface) {
            let ends = [&start, &stops].map(|x| pair.positions(x));
            let contact = match pair.kind {
                PairKind::PointTriangle => ccd::point_triangle(&ends[0], &ends[1], inflation.gap),
                PairKind::EdgeEdge => ccd::edge_edge(&ends[0], &ends[1], inflation.gap),
            };
            collide += usize::from(contact.is_some());
            assert!(contact.is_none() || found.binary_search(&pair).is_ok(), "{pair:?}");
        }
    }
    assert!(collide > 500, "they collide: {collide}");
}

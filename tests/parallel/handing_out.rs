//! Piece of a garment on each rank, compared with the garment on one rank.

use std::collections::BTreeSet;
use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::mesh::{MeshStream, PolygonMesh};
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};

const SIDE: usize = 90;

/// Quads, hexagons and triangles over points that are numbered at random, on a wavy ground.
fn patches() -> PolygonMesh {
    let count = SIDE * SIDE;
    // 7919 is prime and no divisor of the number of points.
    let number = |place: usize| (place * 7919 % count) as u32;
    let mut mesh = PolygonMesh { points: vec![Vec3::zeros(); count], ..PolygonMesh::default() };
    for place in 0..count {
        let (x, z) = ((place % SIDE) as f64, (place / SIDE) as f64);
        mesh.points[number(place) as usize] = Vec3::new(x, 0.3 * (x * 1.7 + z * z * 0.9).sin(), z) * 0.01;
    }
    let mut add = |places: &[usize]| {
        mesh.face_counts.push(places.len() as u32);
        mesh.face_indices.extend(places.iter().map(|place| number(*place)));
    };
    for row in 0..SIDE - 1 {
        let mut x = 0;
        while x + 1 < SIDE {
            let at = row * SIDE + x;
            match (x + row) % 3 {
                0 if x + 2 < SIDE => {
                    add(&[at, at + SIDE, at + SIDE + 1, at + SIDE + 2, at + 2, at + 1]);
                    x += 1;
                }
                1 => add(&[at, at + SIDE, at + SIDE + 1, at + 1]),
                _ => {
                    add(&[at, at + SIDE, at + 1]);
                    add(&[at + 1, at + SIDE, at + SIDE + 1]);
                }
            }
            x += 1;
        }
    }
    mesh
}

fn described(effect: &str) -> SceneDescription {
    let mut description = SceneDescription::new("patches");
    for (garment, shift) in [("first", 0.0), ("second", 2.0)] {
        let mut mesh = patches();
        mesh.points.iter_mut().for_each(|p| p.y += shift);
        description.garments.push(GarmentDescription::new(garment, mesh, 0.2));
    }
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0));
    description.effects.push(EffectRequest::of_garment(effect, 0).with("stiffness", 1e-5));
    description
}

/// Polygon and corners, by numbers of the scene, of what a rank has of a garment.
fn triangles(scene: &Scene, garment: usize) -> Vec<[u32; 4]> {
    let (mesh, parts) = (&scene.meshes()[garment], scene.parts());
    let first = parts.garment(garment).start;
    let row = |(corners, polygon): (&[u32; 3], &u32)| {
        let [a, b, c] = corners.map(|v| parts.number(first + v as usize));
        [*polygon, a, b, c]
    };
    mesh.triangles().iter().zip(mesh.polygons()).map(row).collect()
}

/// The triangles with an own vertex, and those that share an edge with one of them, `rings` times.
fn expected(all: &[[u32; 4]], own: &dyn Fn(u32) -> bool, rings: usize) -> Vec<[u32; 4]> {
    let edges = |[_, a, b, c]: &[u32; 4]| [(a, b), (b, c), (c, a)].map(|(p, q)| [*p.min(q), *p.max(q)]);
    let mut near: BTreeSet<[u32; 4]> = all.iter().filter(|t| t[1..].iter().any(|v| own(*v))).copied().collect();
    for _ in 0..rings {
        let known: BTreeSet<[u32; 2]> = near.iter().flat_map(edges).collect();
        near.extend(all.iter().filter(|t| edges(t).iter().any(|edge| known.contains(edge))));
    }
    near.into_iter().collect()
}

#[test]
fn every_rank_gets_the_triangles_around_its_vertices_and_those_beyond_their_edges() {
    for (effect, rings) in [("bending", 1), ("dihedral_bending", 2)] {
        let description = described(effect);
        let whole = Scene::validate(description.clone()).unwrap_or_else(|problems| panic!("{problems}"));
        let all = [0, 1].map(|garment| triangles(&whole, garment));
        for ranks in [2, 3, 5, 8] {
            let same = LocalRanks::run(ranks, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                let given = ranks.is_first().then(|| description.clone());
                let scene = Scene::distribute(&ranks, given).unwrap_or_else(|problems| panic!("{problems}"));
                let parts = scene.parts();
                assert_eq!(parts.partition(), whole.parts().partition());
                let own = |v: u32| parts.local(v).is_some_and(|local| parts.own().contains(&local));
                for garment in [0, 1] {
                    let rings = if garment == 0 { rings } else { 1 };
                    assert_eq!(triangles(&scene, garment), expected(&all[garment], &own, rings));
                }
                for local in 0..parts.local_count() {
                    let there = parts.number(local) as usize;
                    assert_eq!(parts.own_vertex(local), whole.parts().own_vertex(there));
                    assert_eq!(scene.rest_positions()[local], whole.rest_positions()[there]);
                }
            });
            assert!(same.is_ok(), "{effect}, {ranks} ranks");
        }
    }
}

/// Promises a point more than it gives.
#[derive(Debug)]
struct Shrinking(PolygonMesh);

impl MeshStream for Shrinking {
    fn point_count(&self) -> usize {
        self.0.points.len() + 1
    }

    fn face_count(&self) -> usize {
        self.0.face_counts.len()
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), String> {
        take(&self.0.points);
        Ok(())
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), String> {
        MeshStream::faces(&self.0, take)
    }
}

#[test]
fn a_mesh_that_changes_while_it_is_read_is_refused_on_every_rank() {
    let messages = LocalRanks::run(4, 1, |communicator| {
        let ranks = Ranks::new(communicator);
        let given = ranks.is_first().then(|| {
            let mut description = described("bending");
            description.garments[1].stream = Some(Arc::new(Shrinking(patches())));
            description
        });
        Scene::distribute(&ranks, given).expect_err("a point is missing").to_string()
    });
    for message in messages.expect("no rank waits for ever") {
        assert!(message.contains("garment \"second\"") && message.contains("from 8101 points"), "{message}");
    }
}

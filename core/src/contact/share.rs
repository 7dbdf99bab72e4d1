//! What a rank brings into contact: its own vertices, and the triangles that have one of them.

use std::ops::Range;

use crate::Vec3;
use crate::parallel::ranks::Ranks;
use crate::parallel::sum::SUM_BLOCK;
use crate::scene::Scene;

/// The cloth of a rank. Arrays over its own vertices, in the order of the scene.
#[derive(Debug, Clone)]
pub struct ClothShare {
    /// This rank and the others.
    pub ranks: Ranks,
    /// First vertex of every rank in the scene's numbering, and the number of all at the end.
    pub rank_starts: Vec<u32>,
    /// First block of sums of every rank, and the number of all at the end.
    pub block_starts: Vec<usize>,
    /// Own vertices of each own block, counted from the rank's first vertex.
    pub blocks: Vec<Range<usize>>,
    /// Where the own vertices stand in arrays over the scene's local vertices.
    pub place: Range<usize>,
    /// Triangles with an own vertex, by their corners' numbers in the scene, in the order of the garments.
    pub triangles: Vec<[u32; 3]>,
    /// Positions at rest [m].
    pub rest: Vec<Vec3>,
    /// Thickness that repulsions keep [m].
    pub thickness: Vec<f64>,
    /// Mean rest length of the edges of each vertex [m].
    pub edge_length: Vec<f64>,
    /// Garment of each vertex.
    pub garment: Vec<u32>,
    /// Inverse masses [1/kg].
    pub mobility: Vec<f64>,
    /// Mean rest length of all edges of the scene [m].
    pub mean_edge: f64,
}

impl ClothShare {
    /// The cloth of a scene; `clamp` is the largest thickness of a vertex as a fraction of its shortest rest edge.
    pub fn of(scene: &Scene, clamp: f64) -> Self {
        let parts = scene.parts();
        let count = parts.vertex_count();
        let mut triangles = Vec::new();
        let (mut rest, mut garment) = (vec![Vec3::zeros(); count], vec![0; count]);
        for (g, mesh) in scene.meshes().iter().enumerate() {
            let solver = |v: u32| parts.solver_index(g, v) as u32;
            triangles.extend(mesh.triangles().iter().map(|t| t.map(solver)));
            for (v, position) in mesh.rest_positions().iter().enumerate() {
                let solver = solver(v as u32) as usize;
                rest[solver] = *position;
                garment[solver] = g as u32;
            }
        }
        let cut = |part: &Range<usize>| {
            let end = part.end;
            part.clone().step_by(SUM_BLOCK).map(move |start| start..(start + SUM_BLOCK).min(end))
        };
        let blocks: Vec<Range<usize>> = parts.ranges().iter().flat_map(cut).collect();
        Self {
            ranks: Ranks::default(),
            rank_starts: vec![0, count as u32],
            block_starts: vec![0, blocks.len()],
            blocks,
            place: 0..count,
            triangles,
            rest,
            thickness: thicknesses(scene, clamp),
            edge_length: edge_lengths(scene),
            garment,
            mobility: scene.masses().iter().map(|m| 1.0 / m).collect(),
            mean_edge: scene.mean_edge(),
        }
    }
}

/// Thickness per vertex in solver order: the garment's, at most `clamp` times each rest edge of the vertex (method 3.2).
fn thicknesses(scene: &Scene, clamp: f64) -> Vec<f64> {
    let parts = scene.parts();
    let mut thickness = vec![0.0; parts.vertex_count()];
    for (g, (mesh, garment)) in scene.meshes().iter().zip(&scene.description().garments).enumerate() {
        parts.garment(g).for_each(|solver| thickness[solver] = garment.thickness);
        for edge in mesh.edges() {
            let [a, b] = edge.vertices.map(|v| mesh.rest_positions()[v as usize]);
            let longest: f64 = clamp * (a - b).norm();
            for v in edge.vertices {
                let own: &mut f64 = &mut thickness[parts.solver_index(g, v)];
                *own = own.min(longest);
            }
        }
    }
    thickness
}

/// Mean rest length of the edges of each vertex [m]; of all cloth for vertices without edges.
fn edge_lengths(scene: &Scene) -> Vec<f64> {
    let parts = scene.parts();
    let count = parts.vertex_count();
    let (mut sums, mut counts) = (vec![0.0; count], vec![0u32; count]);
    for (g, mesh) in scene.meshes().iter().enumerate() {
        for edge in mesh.edges() {
            let [a, b] = edge.vertices.map(|v| mesh.rest_positions()[v as usize]);
            for v in edge.vertices {
                sums[parts.solver_index(g, v)] += (a - b).norm();
                counts[parts.solver_index(g, v)] += 1;
            }
        }
    }
    let mean = |(sum, count): (&f64, &u32)| if *count > 0 { sum / f64::from(*count) } else { scene.mean_edge() };
    sums.iter().zip(&counts).map(mean).collect()
}

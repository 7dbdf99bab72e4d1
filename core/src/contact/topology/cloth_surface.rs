//! Contribution of a rank to contact: its own vertices, and the triangles that have one of them.

use std::ops::Range;

use crate::Vec3;
use crate::contact::topology::wearing_order::WearingOrder;
use crate::parallel::ranks::Ranks;
use crate::parallel::reduce::SUM_BLOCK;
use crate::scene::Scene;
use crate::scene::contact_matrix::{ContactMatrix, objects_of_vertices};

/// The cloth of a rank. Arrays over its own vertices, in the order of the scene.
#[derive(Debug, Clone)]
pub(crate) struct LocalClothSurface {
    /// This rank and the others.
    pub ranks: Ranks,
    /// First vertex of every rank in the scene's numbering, and the number of all at the end.
    pub rank_starts: Vec<u32>,
    /// First block of sums of every rank, and the number of all at the end.
    pub block_starts: Vec<usize>,
    /// Own vertices of each own block, counted from the rank's first vertex.
    pub blocks: Vec<Range<usize>>,
    /// Range of the own vertices in arrays over the scene's local vertices.
    pub place: Range<usize>,
    /// Triangles with an own vertex, by their corners' numbers in the scene, in the order of the garments.
    pub triangles: Vec<[u32; 3]>,
    /// Positions at rest [m].
    pub rest: Vec<Vec3>,
    /// Thickness that repulsions keep [m].
    pub thickness: Vec<f64>,
    /// Largest thickness that short edges allow [m]; `None` where no rule gives cloth a thickness.
    pub largest_thickness: Option<Vec<f64>>,
    /// Factor on the friction of cloth on cloth, and term added to it, as painted; `None` if it is nowhere painted.
    pub friction: Option<Vec<[f64; 2]>>,
    /// The same on the friction of bodies.
    pub body_friction: Option<Vec<[f64; 2]>>,
    /// Mean rest length of the edges of each vertex [m].
    pub edge_length: Vec<f64>,
    /// Object of each vertex: its garment, or a part of it that rules name.
    pub object: Vec<u32>,
    /// Inverse masses [1/kg].
    pub mobility: Vec<f64>,
    /// Mean rest length of all edges of the scene [m].
    pub mean_edge: f64,
    /// Rules of contact by pair; `None` in scenes without rules.
    pub matrix: Option<ContactMatrix>,
    /// Order in which garments are worn; `None` if no two of them have a layer.
    pub wearing_order: Option<WearingOrder>,
}

impl LocalClothSurface {
    /// This rank's share of a scene; `clamp` is the largest thickness of a vertex as a fraction of its shortest rest edge.
    pub(crate) fn of(scene: &Scene, clamp: f64) -> Self {
        let parts = scene.parts();
        let own = parts.own();
        let matrix = ContactMatrix::of(scene.description());
        let has_thickness = matrix.as_ref().is_some_and(ContactMatrix::has_cloth_thickness);
        let painted = |map: &str| scene.painted_everywhere(map).map(|all| all[own.clone()].to_vec());
        let mut share = Self {
            ranks: parts.ranks().clone(),
            rank_starts: parts.rank_starts().to_vec(),
            block_starts: parts.rank_block_starts(),
            blocks: parts
                .ranges()
                .iter()
                .flat_map(|part| blocks_of(part.start - own.start..part.end - own.start))
                .collect(),
            place: own.clone(),
            triangles: Vec::new(),
            rest: vec![Vec3::zeros(); own.len()],
            thickness: vec![0.0; own.len()],
            largest_thickness: has_thickness.then(|| vec![f64::INFINITY; own.len()]),
            friction: painted("self_friction"),
            body_friction: painted("friction").filter(|_| !scene.description().bodies.is_empty()),
            edge_length: vec![0.0; own.len()],
            object: objects_of_vertices(scene),
            mobility: scene.masses()[own.clone()].iter().map(|m| 1.0 / m).collect(),
            mean_edge: scene.mean_edge(),
            matrix,
            wearing_order: WearingOrder::of(scene),
        };
        let mut edges = vec![0; own.len()];
        for garment in 0..scene.meshes().len() {
            share.add_garment(scene, garment, clamp, &mut edges);
        }
        for (length, edges) in share.edge_length.iter_mut().zip(edges) {
            *length = if edges > 0 { *length / f64::from(edges) } else { share.mean_edge };
        }
        share
    }

    /// Adds a garment's triangles, the lengths of its edges, and their number at each own vertex. Own vertices have all their
    /// edges here, in the same order on any number of ranks.
    fn add_garment(&mut self, scene: &Scene, garment: usize, clamp: f64, edges: &mut [u32]) {
        let (parts, mesh) = (scene.parts(), &scene.meshes()[garment]);
        let first = parts.garment(garment).start;
        let own = |v: u32| Some(first + v as usize).filter(|v| self.place.contains(v)).map(|v| v - self.place.start);
        let touches = |corners: &&[u32; 3]| corners.iter().any(|v| own(*v).is_some());
        let number = |v: u32| parts.number(first + v as usize);
        self.triangles.extend(mesh.triangles().iter().filter(touches).map(|t| t.map(number)));
        let thickness = scene.description().garments[garment].thickness;
        let painted = scene.painted(garment, "thickness");
        for (place, rest) in mesh.rest_positions().iter().enumerate() {
            if let Some(v) = own(place as u32) {
                self.rest[v] = *rest;
                self.thickness[v] = painted.map_or(thickness, |map| map.at(place, thickness));
            }
        }
        for edge in mesh.edges() {
            let [a, b] = edge.vertices.map(|v| mesh.rest_positions()[v as usize]);
            let length = (a - b).norm();
            for v in edge.vertices.into_iter().filter_map(own) {
                // Method 3.2.
                self.thickness[v] = self.thickness[v].min(clamp * length);
                if let Some(largest) = &mut self.largest_thickness {
                    largest[v] = largest[v].min(clamp * length);
                }
                self.edge_length[v] += length;
                edges[v] += 1;
            }
        }
    }
}

/// The blocks of sums of a part.
fn blocks_of(part: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    part.clone().step_by(SUM_BLOCK).map(move |start| start..(start + SUM_BLOCK).min(part.end))
}

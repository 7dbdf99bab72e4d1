//! Share of a scene that a rank has: everything around its own vertices. It comes from rank 0, which has the
//! description (`scatter`), or from other ranks when vertices move.
//!
//! A rank's piece of a garment are the triangles that have one of its vertices, and those that share an edge with one of these:
//! all that springs along edges and across them, masses and contacts of its own vertices need. Where an effect looks further
//! (`Need::SecondRing`), the triangles beyond their edges belong to it too.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use crate::Vec3;
use crate::effects;
use crate::effects::spec::Need;
use crate::mesh::TriangleMesh;
use crate::parallel::message::{codec, codec_of_rows, is_broken};
use crate::parallel::parts::{Partition, Parts};
use crate::parallel::ranks::Ranks;
use crate::scene::MergedVertex;
use crate::scene::seam_pairs::{Sewn, partners, sewn_to};
use crate::scene::vertex_maps::PaintedMap;
use crate::scene::{PinDescription, PinTarget, Pinned, Scene, SceneDescription};
use crate::setup::distribute::one_ring::Triangle;

/// Data that a rank needs of a garment, vertices ascending by their numbers in the scene.
#[derive(Debug, Default)]
pub(crate) struct SubMesh {
    pub(crate) vertices: Vec<VertexNumbers>,
    pub(crate) rest: Vec<Vec3>,
    /// Start of own vertices, where it differs from the rest shape [m].
    pub(crate) start: Vec<Vec3>,
    /// Velocities of own vertices at the start, where they differ among each other [m/s].
    pub(crate) velocities: Vec<Vec3>,
    /// Painted values of all vertices, map after map in the order of their names.
    pub(crate) maps: Vec<Vec<f64>>,
    /// Triangles by numbers of the scene, ascending: the order in which they stand on every rank.
    pub(crate) triangles: Vec<Triangle>,
}

/// The numbers of a vertex; ordered by that in the scene.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
pub(crate) struct VertexNumbers {
    pub(crate) scene: u32,
    pub(crate) garment: u32,
}

codec_of_rows!(VertexNumbers);
codec!(struct SubMesh { vertices, rest, start, velocities, maps, triangles });

/// Returns the number of times that the pieces of a garment are widened by the triangles beyond their edges.
pub(crate) fn halo_width(description: &SceneDescription, garment: usize) -> usize {
    let of_garment = description.effects.iter().filter(|request| request.garment == Some(garment));
    let mut specs = of_garment.filter_map(|request| effects::find(&request.effect));
    if specs.any(|spec| spec.needs.contains(&Need::SecondRing)) { 2 } else { 1 }
}

impl SubMesh {
    /// Name of the message in the error of a damaged one.
    const NAME: &str = "cloth that moves to another rank";

    /// Makes sure that a piece which came to a rank is whole.
    ///
    /// # Panics
    /// It is not.
    fn check(&self, rank: usize) {
        let count = self.vertices.len();
        if self.rest.len() != count || self.maps.iter().any(|map| map.len() != count) {
            is_broken(rank, Self::NAME, format_args!("not all of its {count} vertices have their values"));
        }
    }

    /// The piece around the vertices `own` of the scene, all of them this rank's own, of what it has of a garment, with those
    /// that are sewn to them.
    fn of_local(scene: &Scene, garment: usize, own: &Range<u32>) -> Self {
        let (parts, mesh) = (&scene.parts, &scene.meshes[garment]);
        let first = parts.garment(garment).start;
        let number = |v: u32| parts.number(first + v as usize);
        let numbers = |v: &u32| VertexNumbers { scene: number(*v), garment: parts.own_numbers()[first + *v as usize] };
        let mut here: Vec<bool> =
            mesh.triangles().iter().map(|corners| corners.iter().any(|v| own.contains(&number(*v)))).collect();
        let width = halo_width(&scene.description, garment);
        let hinges = if width > 0 { mesh.hinges() } else { Vec::new() };
        for _ in 0..width {
            let near = here.clone();
            for hinge in &hinges {
                let [a, b] = hinge.triangles.map(|t| t as usize);
                (here[a], here[b]) = (here[a] || near[b], here[b] || near[a]);
            }
        }
        let chosen = || mesh.triangles().iter().zip(mesh.polygons()).zip(&here).filter(|(_, here)| **here);
        let mut vertices: Vec<u32> = chosen().flat_map(|((corners, _), _)| *corners).collect();
        vertices.extend((0..mesh.rest_positions().len() as u32).filter(|v| own.contains(&number(*v))));
        let run = own.start as usize..own.end as usize;
        let partners = partners(&scene.sewn, &run, &parts.partition().garments()[garment]);
        vertices.extend(partners.iter().filter_map(|far| parts.local(*far)).map(|local| (local - first) as u32));
        vertices.sort_unstable();
        vertices.dedup();
        let mut triangles: Vec<Triangle> = chosen()
            .map(|((corners, polygon), _)| Triangle { polygon: *polygon, corners: corners.map(number) })
            .collect();
        triangles.sort_unstable();
        Self {
            rest: vertices.iter().map(|v| mesh.modelled_positions()[*v as usize]).collect(),
            vertices: vertices.iter().map(numbers).collect(),
            maps: scene.painted[garment].values().map(|map| painted(map, &vertices)).collect(),
            triangles,
            ..Self::default()
        }
    }

    /// Joins the pieces of neighbouring runs of vertices.
    fn joined(pieces: Vec<Self>) -> Self {
        // Each vertex from the first piece that has it.
        let all = pieces.iter().enumerate().flat_map(|(p, piece)| (0..piece.vertices.len()).map(move |row| (p, row)));
        let mut places: Vec<(usize, usize)> = all.collect();
        places.sort_unstable_by_key(|(p, row)| (pieces[*p].vertices[*row], *p));
        places.dedup_by_key(|(p, row)| pieces[*p].vertices[*row]);
        let vertices = places.iter().map(|(p, row)| pieces[*p].vertices[*row]).collect();
        let rest = places.iter().map(|(p, row)| pieces[*p].rest[*row]).collect();
        let map = |m: usize| places.iter().map(|(p, row)| pieces[*p].maps[m][*row]).collect();
        let maps = (0..pieces.first().map_or(0, |piece| piece.maps.len())).map(map).collect();
        let mut triangles: Vec<Triangle> = pieces.into_iter().flat_map(|piece| piece.triangles).collect();
        triangles.sort_unstable();
        triangles.dedup();
        Self { vertices, rest, maps, triangles, ..Self::default() }
    }

    /// The mesh of this piece.
    fn mesh(self) -> TriangleMesh {
        let local = |number: u32| self.vertices.partition_point(|other| other.scene < number) as u32;
        let corners = self.triangles.iter().map(|triangle| triangle.corners.map(local)).collect();
        let polygons = self.triangles.iter().map(|triangle| triangle.polygon).collect();
        TriangleMesh::of_triangles(self.rest, corners, polygons)
    }
}

/// Values of a map at these vertices.
fn painted(map: &PaintedMap, vertices: &[u32]) -> Vec<f64> {
    vertices.iter().map(|v| map.values[*v as usize]).collect()
}

/// Vertices of a rank that are held or sewn, by numbers of the scene.
pub(crate) struct Held {
    pub(crate) pinned: Vec<Pinned>,
    pub(crate) pin_targets: usize,
    pub(crate) sewn: Vec<Sewn>,
    pub(crate) merged_vertices: Vec<MergedVertex>,
}

/// The parts of a scene, and who has them.
pub(crate) struct AssignedPartition {
    pub(crate) partition: Partition,
    /// First part of every rank, and the number of all at the end.
    pub(crate) assignment: Vec<usize>,
}

codec!(struct Held { pinned, pin_targets, sewn, merged_vertices });

/// Builds what a rank keeps from its pieces; masses and all else that follows from them is not there yet.
pub(crate) fn assemble(
    ranks: &Ranks,
    description: SceneDescription,
    AssignedPartition { partition, assignment }: AssignedPartition,
    mut pieces: Vec<SubMesh>,
    Held { mut pinned, pin_targets, sewn, merged_vertices }: Held,
) -> Scene {
    let starts = partition.starts();
    let own = starts[assignment[ranks.rank()]] as u32..starts[assignment[ranks.rank() + 1]] as u32;
    let vertices = || pieces.iter().flat_map(|piece| &piece.vertices);
    let ghosts = vertices().map(|vertex| vertex.scene).filter(|number| !own.contains(number)).collect();
    let own_numbers = vertices().map(|vertex| vertex.garment).collect();
    let parts = Parts::new(ranks.clone(), partition, assignment, ghosts, own_numbers);
    for pinned in &mut pinned {
        // What was sent are the pins of own vertices.
        pinned.vertex = pinned.vertex - own.start + parts.own().start as u32;
    }
    let differs = |of: fn(&SubMesh) -> &Vec<Vec3>| ranks.any(pieces.iter().any(|piece| !of(piece).is_empty()));
    let own_places = |garment: usize| parts.own_of_garment(garment);
    let start = differs(|piece| &piece.start).then(|| {
        let mut x: Vec<Vec3> = pieces.iter().flat_map(|piece| &piece.rest).copied().collect();
        for (g, piece) in pieces.iter().enumerate().filter(|(_, piece)| !piece.start.is_empty()) {
            x[own_places(g)].copy_from_slice(&piece.start);
        }
        parts.halo().update(ranks, &mut x);
        x
    });
    let velocities = differs(|piece| &piece.velocities).then(|| {
        let mut v = vec![Vec3::zeros(); parts.local_count()];
        for (g, piece) in pieces.iter().enumerate() {
            if piece.velocities.is_empty() {
                v[own_places(g)].fill(description.garments[g].velocity);
            } else {
                v[own_places(g)].copy_from_slice(&piece.velocities);
            }
        }
        parts.halo().update(ranks, &mut v);
        v
    });
    let painted = pieces.iter_mut().zip(&description.garments).map(|(piece, garment)| {
        let maps = garment.maps.iter().zip(std::mem::take(&mut piece.maps));
        maps.map(|((name, map), values)| (name.clone(), PaintedMap { values, absolute: map.absolute })).collect()
    });
    let painted = painted.collect();
    let meshes = pieces.into_iter().map(SubMesh::mesh).collect();
    Scene {
        identity: Arc::default(),
        shape_meshes: Arc::default(),
        description,
        meshes,
        parts,
        masses: Vec::new(),
        mean_edge: 0.0,
        start,
        velocities,
        pinned,
        pin_targets,
        sewn,
        isolated: None,
        merged_vertices,
        warnings: Vec::new(),
        painted,
        integrator_costs: None,
    }
}

/// Returns the scene on this rank with another assignment of the parts: the ranks hand each other the data that
/// moves. Nothing is known of the start any more, and what follows from the pieces is not there yet.
pub(crate) fn migrate(scene: &Scene, assignment: Vec<usize>) -> Scene {
    let (parts, ranks) = (&scene.parts, scene.parts.ranks());
    let partition = parts.partition().clone();
    let now = |rank: usize| parts.rank_starts()[rank]..parts.rank_starts()[rank + 1];
    let (mine, starts) = (now(ranks.rank()), partition.starts());
    let then = |rank: usize| starts[assignment[rank]] as u32..starts[assignment[rank + 1]] as u32;
    // From own vertices to those that the other rank will have.
    let moves = |rank: usize| mine.start.max(then(rank).start)..mine.end.min(then(rank).end);
    let mut pieces = Vec::new();
    for garment in 0..scene.meshes.len() {
        let piece = |rank: usize| match moves(rank) {
            none if none.is_empty() => Vec::new(),
            own => vec![SubMesh::of_local(scene, garment, &own)],
        };
        let received = ranks.all_to_all_encoded(SubMesh::NAME, (0..ranks.count()).map(piece).collect());
        let arrived: Vec<SubMesh> = received.into_iter().flatten().collect();
        arrived.iter().for_each(|piece| piece.check(ranks.rank()));
        pieces.push(SubMesh::joined(arrived));
    }
    let numbered = scene.pinned.iter().map(|pinned| Pinned { vertex: parts.number(pinned.vertex as usize), ..*pinned });
    let numbered: Vec<Pinned> = numbered.collect();
    let pins = |rank: usize| match then(rank) {
        own if own.is_empty() || (numbered.is_empty() && scene.sewn.is_empty()) => Vec::new(),
        own => {
            let own = own.start as usize..own.end as usize;
            vec![(pins_of(&numbered, &own), sewn_to(&scene.sewn, &own))]
        }
    };
    let name = "pins and seams that move to another rank";
    let received = ranks.all_to_all_encoded(name, (0..ranks.count()).map(pins).collect());
    let (mut pinned, mut sewn) = (Vec::new(), Vec::new());
    for (pins, pairs) in received.into_iter().flatten() {
        pinned.extend(pins);
        sewn.extend(pairs);
    }
    pinned.sort_unstable_by_key(|pinned| pinned.number);
    // Both owners of a pair may have sent it.
    sewn.sort_unstable_by_key(|pair| pair.number);
    sewn.dedup_by_key(|pair| pair.number);
    let held = Held { pinned, pin_targets: scene.pin_targets, sewn, merged_vertices: scene.merged_vertices.clone() };
    let assigned = AssignedPartition { partition, assignment };
    let identity = Arc::clone(&scene.identity);
    Scene {
        warnings: scene.warnings.clone(),
        identity,
        shape_meshes: Arc::clone(&scene.shape_meshes),
        integrator_costs: scene.integrator_costs,
        ..assemble(ranks, scene.description.clone(), assigned, pieces, held)
    }
}

/// The pinned vertices among `own`, which are numbers of the scene.
pub(crate) fn pins_of(pinned: &[Pinned], own: &Range<usize>) -> Vec<Pinned> {
    pinned.iter().filter(|pinned| own.contains(&(pinned.vertex as usize))).cloned().collect()
}

/// Removes the vertices that a pin holds: they are known to the ranks that own them.
pub(crate) fn forget_vertices(pin: &mut PinDescription) {
    match &mut pin.target {
        PinTarget::Path { vertices, .. }
        | PinTarget::Track { vertices, .. }
        | PinTarget::BodyNearest { vertices, .. } => *vertices = Vec::new(),
        PinTarget::Body { attachments, .. } => *attachments = Vec::new(),
    }
}

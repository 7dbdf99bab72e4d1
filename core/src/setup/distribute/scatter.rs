//! Handing out a scene. Rank 0 has the description and reads each garment piece by piece; it never has a garment as a whole.
//!
//! Data that is read goes first to *blocks*, an even one of the points and faces on each rank (`even_blocks`), where
//! it is checked. Then the ranks find the order of the vertices together (`bisection`), each takes the rest positions
//! of its own, and blocks receive the numbers in the scene of their points. Faces are cut into triangles there, what
//! takes no part is left out (`degenerate`), and the rest goes to the owners of the corners (`one_ring`); what else
//! belongs to a vertex is asked for by the ranks that have it.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::Vec3;
use crate::effects::registry as effects;
use crate::effects::spec::Need;
use crate::error::Problem;
use crate::geometry::attachment::SurfaceAttachment;
use crate::parallel::message::codec;
use crate::parallel::parts::Partition;
use crate::parallel::ranks::Ranks;
use crate::scene::MergedVertex;
use crate::scene::seam_pairs::{Sewn, SewnTo, partners, sewn_to};
use crate::scene::vertex_maps::{self, PaintedMap};
use crate::scene::{
    ElasticDescription, GarmentDescription, PinDescription, PinHold, PinTarget, Pinned, Scene, SceneDescription,
    SeamDescription,
};
use crate::setup::distribute::bisection;
use crate::setup::distribute::block_rows::{BlockDistribution, fetch, scatter_rows};
use crate::setup::distribute::even_blocks::{BlockOfMesh, MeshSize};
use crate::setup::distribute::one_ring::{Triangle, grow, one_ring, owner};
use crate::setup::distribute::submesh::{
    AssignedPartition, Held, SubMesh, VertexNumbers, assemble, forget_vertices, halo_width, pins_of,
};
use crate::setup::mesh_checks::coincident;
use crate::setup::mesh_checks::coincident::Apart;
use crate::setup::mesh_checks::degenerate::{CleanMesh, MergedInto};
use crate::setup::mesh_checks::winding;

/// Data of the points of a garment besides their rest positions; on rank 0, where they are given.
#[derive(Default)]
struct Columns {
    start: Option<Vec<Vec3>>,
    velocities: Option<Vec<Vec3>>,
    maps: Vec<Vec<f64>>,
}

/// Own vertices of a garment, in the order of the scene.
struct Own {
    /// Their numbers in the garment.
    vertices: Vec<u32>,
    rest: Vec<Vec3>,
    start: Vec<Vec3>,
    velocities: Vec<Vec3>,
    maps: Vec<Vec<f64>>,
}

/// Data that a rank has of a garment in its block.
struct OfBlock<'a> {
    /// Rest positions of its points [m].
    points: &'a [Vec3],
    sound: &'a CleanMesh,
    /// Number of each of its points in the scene.
    places: &'a [u32],
}

/// Data that rank 0 tells all ranks before anything is read.
struct Outline {
    /// Without the arrays of garments and pins.
    description: SceneDescription,
    /// Sizes of the garments.
    sizes: Vec<MeshSize>,
}

codec!(struct Outline { description, sizes });

/// Position to which a vertex was set apart. Packed, so that nothing lies between its end and the next.
#[repr(C, packed(4))]
#[derive(Clone, Copy, Pod, Zeroable)]
struct MovedVertex {
    /// Number in the scene.
    number: u32,
    /// New position [m].
    position: Vec3,
}

/// A scene that is being handed out.
pub(crate) struct SceneScatter {
    description: SceneDescription,
    partition: Partition,
    assignment: Vec<usize>,
    /// First vertex of every rank, and the number of all at the end.
    starts: Vec<u32>,
    /// Contents of this rank's block of each garment, until it is handed out; and the blocks in which all points of
    /// each garment are.
    blocks: Vec<BlockOfMesh<'static>>,
    points_of: Vec<BlockDistribution>,
    /// On rank 0.
    columns: Vec<Columns>,
    pins: Vec<PinDescription>,
    /// Pairs of each seam, on rank 0.
    stitches: Vec<Vec<(u32, SewnTo)>>,
}

impl SceneScatter {
    /// Tells all ranks what is small, reads the garments and spreads them. All ranks call it together, rank 0 with the
    /// description.
    pub(crate) fn begin(ranks: &Ranks, description: Option<SceneDescription>, problems: &mut Vec<Problem>) -> Self {
        let mut meshes = Vec::new();
        let (mut columns, mut pins, mut stitches) = (Vec::new(), Vec::new(), Vec::new());
        let outline = description.map(|mut description| {
            pins.clone_from(&description.pins);
            stitches = description.seams.iter_mut().map(SeamDescription::take_stitches).collect();
            description.pins.iter_mut().for_each(forget_vertices);
            add_columns(&mut description);
            let size = |g: &GarmentDescription| MeshSize { points: g.point_count(), faces: g.face_count() };
            let sizes = description.garments.iter().map(size).collect();
            for garment in &mut description.garments {
                meshes.push(garment.take_mesh());
                columns.push(take_columns(garment));
            }
            Outline { description, sizes }
        });
        let Outline { description, sizes } = ranks.broadcast_encoded("description of the scene", outline);
        let mut meshes = meshes.into_iter();
        let mut blocks = Vec::new();
        let mut partition = Partition::default();
        for (size, garment) in sizes.into_iter().zip(&description.garments) {
            let place = format!("garment \"{}\"", garment.name);
            // Each mesh is forgotten when it has been read.
            let block = BlockOfMesh::read(ranks, meshes.next().as_deref(), size, &place, problems);
            problems.extend(block.check(ranks, &place, size.points));
            blocks.push(block);
            partition.add_garment(size.points);
        }
        let assignment = partition.balance(&partition.sizes(), ranks.count());
        let starts = assignment.iter().map(|part| partition.starts()[*part] as u32).collect();
        let points_of = blocks.iter().map(|block| block.points_of.clone()).collect();
        Self { description, partition, assignment, starts, blocks, points_of, columns, pins, stitches }
    }

    /// This rank's pieces of the scene, as [`assemble`] leaves them; there are no problems so far. All ranks call it together.
    pub(crate) fn finish(mut self, ranks: &Ranks) -> Scene {
        let mut owns = Vec::new();
        let mut places = Vec::new();
        for g in 0..self.blocks.len() {
            let own = self.own(ranks, g);
            places.push(self.places(ranks, g, &own.vertices));
            owns.push(own);
        }
        let (mut held, pinned) = self.held(ranks, &owns, &places);
        let (mut pieces, mut warnings) = (Vec::new(), Vec::new());
        // One garment after the other, and each is forgotten when it is handed out.
        let garments = std::mem::take(&mut self.blocks).into_iter().zip(owns).zip(places);
        for (g, ((block, mut own), places)) in garments.enumerate() {
            let mut sound = CleanMesh::of(ranks, &self.description.garments[g].name, &block);
            warnings.append(&mut sound.warnings);
            warnings.extend(winding::warning(ranks, &self.description, g, &self.points_of[g], &sound.triangles));
            if touches(&self.description) {
                let of_block = OfBlock { points: &block.points, sound: &sound, places: &places };
                warnings.extend(self.set_apart(ranks, g, &of_block, &mut own));
            }
            drop(block);
            // The same list on all ranks, of which one asks.
            let follows = if ranks.is_first() { &*sound.follows } else { &[] };
            let merged_vertices = self.merged_vertices(ranks, g, follows, &own, &places);
            held.merged_vertices
                .extend(merged_vertices.into_iter().filter(|f| pinned.binary_search(&f.vertex).is_err()));
            let near = one_ring(ranks, &self.points_of[g], sound.triangles, &places, &self.starts);
            let near = grow(ranks, near, &self.run(ranks), &self.starts, halo_width(&self.description, g));
            pieces.push(self.piece(ranks, g, own, near, &held.sewn));
        }
        let merged_vertices = ranks.is_first().then_some(held.merged_vertices);
        held.merged_vertices = ranks.broadcast_encoded("vertices that follow others", merged_vertices);
        let assigned = AssignedPartition { partition: self.partition, assignment: self.assignment };
        Scene { warnings, ..assemble(ranks, self.description, assigned, pieces, held) }
    }

    /// Own vertices of the scene.
    fn run(&self, ranks: &Ranks) -> Range<u32> {
        self.starts[ranks.rank()]..self.starts[ranks.rank() + 1]
    }

    /// Numbers in the scene of the own vertices of a garment.
    fn run_of(&self, ranks: &Ranks, garment: usize) -> Range<u32> {
        let Range { start, end } = self.partition.garments()[garment].clone();
        let run = self.run(ranks);
        run.start.clamp(start as u32, end as u32)..run.end.clamp(start as u32, end as u32)
    }

    /// Finds the own vertices of a garment, and fetches what belongs to them.
    fn own(&mut self, ranks: &Ranks, garment: usize) -> Own {
        let (block, blocks) = (&self.blocks[garment], &self.points_of[garment]);
        let first = blocks.rows(ranks.rank()).start;
        let places = self.partition.garments()[garment].clone();
        let (vertices, rest) = bisection::order(ranks, places, &self.starts, first, &block.points);
        let Columns { start, velocities, maps } = self.columns.get_mut(garment).map(std::mem::take).unwrap_or_default();
        let mut maps = maps.into_iter();
        let maps = (0..self.description.garments[garment].maps.len()).map(|_| maps.next());
        Own {
            start: column(ranks, blocks, start, &vertices),
            velocities: column(ranks, blocks, velocities, &vertices),
            maps: maps.map(|values| column(ranks, blocks, values, &vertices)).collect(),
            vertices,
            rest,
        }
    }

    /// The number in the scene of each point in this rank's block.
    fn places(&self, ranks: &Ranks, garment: usize, own: &[u32]) -> Vec<u32> {
        let blocks = &self.points_of[garment];
        let mut lists = vec![Vec::new(); ranks.count()];
        for (garment, scene) in own.iter().copied().zip(self.run_of(ranks, garment)) {
            lists[blocks.of(garment as usize)].push(VertexNumbers { scene, garment });
        }
        let here = blocks.rows(ranks.rank());
        let mut places = vec![0; here.len()];
        for VertexNumbers { scene, garment } in ranks.all_to_all_v(lists).into_iter().flatten() {
            places[garment as usize - here.start] = scene;
        }
        places
    }

    /// Numbers in the scene of vertices of a garment.
    fn numbers(&self, ranks: &Ranks, garment: usize, vertices: &[u32], places: &[u32]) -> Vec<u32> {
        let blocks = &self.points_of[garment];
        let first = blocks.rows(ranks.rank()).start;
        fetch(ranks, vertices, |vertex| blocks.of(vertex as usize), |vertex| places[vertex as usize - first])
    }

    /// Returns the own vertices that are held or sewn; and on rank 0, which knows all and asks where they are, the
    /// vertices of all ranks that a pin moves, ascending.
    fn held(&self, ranks: &Ranks, owns: &[Own], places: &[Vec<u32>]) -> (Held, Vec<u32>) {
        let mut pinned = Vec::new();
        let mut sewn = Vec::new();
        if !self.description.pins.is_empty() {
            pinned = self.pinned(ranks, places);
        }
        if !self.description.seams.is_empty() {
            sewn = self.sewn(ranks, owns, places);
        }
        let held = ranks.scatter_encoded("pins and seams of a rank", |rank| {
            let own = self.starts[rank] as usize..self.starts[rank + 1] as usize;
            let (of_rank, sewn) = (pins_of(&pinned, &own), sewn_to(&sewn, &own));
            Held { pinned: of_rank, pin_targets: pinned.len(), sewn, merged_vertices: Vec::new() }
        });
        let is_hard = |pinned: &&Pinned| self.description.pins[pinned.pin].hold == PinHold::Hard;
        let mut moved: Vec<u32> = pinned.iter().filter(is_hard).map(|pinned| pinned.vertex).collect();
        moved.sort_unstable();
        (held, moved)
    }

    /// Sets apart what coincides of a garment, at rest and at the start, each for itself: in what the owners have. Says on rank 0
    /// in words what that was.
    fn set_apart(
        &self,
        ranks: &Ranks,
        garment: usize,
        &OfBlock { points, sound, places }: &OfBlock<'_>,
        own: &mut Own,
    ) -> Option<String> {
        let blocks = &self.points_of[garment];
        let first = self.run_of(ranks, garment).start;
        let rest = Apart::of(ranks, blocks, points, sound);
        self.move_to(ranks, garment, &rest, places, &mut own.rest);
        let mut pairs = rest.pairs;
        if ranks.any(!own.start.is_empty()) {
            let start = fetch(
                ranks,
                places,
                |number| owner(&self.starts, number),
                |number| own.start[(number - first) as usize],
            );
            let start = Apart::of(ranks, blocks, &start, sound);
            self.move_to(ranks, garment, &start, places, &mut own.start);
            pairs.extend(start.pairs);
        }
        coincident::warning(ranks, &self.description.garments[garment].name, blocks, pairs)
    }

    /// Moves own vertices to where they were set apart.
    fn move_to(&self, ranks: &Ranks, garment: usize, apart: &Apart, places: &[u32], own: &mut [Vec3]) {
        let vertices: Vec<u32> = apart.moved.iter().map(|(vertex, _)| *vertex).collect();
        let numbers = self.numbers(ranks, garment, &vertices, places);
        let mut lists = vec![Vec::new(); ranks.count()];
        for (number, (_, place)) in numbers.into_iter().zip(&apart.moved) {
            lists[owner(&self.starts, number)].push(MovedVertex { number, position: *place });
        }
        let first = self.run_of(ranks, garment).start;
        for MovedVertex { number, position } in ranks.all_to_all_v(lists).into_iter().flatten() {
            own[(number - first) as usize] = position;
        }
    }

    /// Returns the vertices that follow another vertex, by numbers of the scene.
    fn merged_vertices(
        &self,
        ranks: &Ranks,
        garment: usize,
        follows: &[MergedInto],
        own: &Own,
        places: &[u32],
    ) -> Vec<MergedVertex> {
        let wanted: Vec<u32> = follows.iter().flat_map(|merged| [merged.vertex, merged.leader]).collect();
        let numbers = self.numbers(ranks, garment, &wanted, places);
        let at = self.starts_at(ranks, garment, &numbers, own);
        let merged =
            |(&[vertex, leader], at): (&[u32; 2], &[Vec3; 2])| MergedVertex { vertex, leader, offset: at[0] - at[1] };
        numbers.as_chunks().0.iter().zip(at.as_chunks().0).map(merged).collect()
    }

    /// Returns the positions at the start of vertices of the scene, all of one garment [m].
    fn starts_at(&self, ranks: &Ranks, garment: usize, numbers: &[u32], own: &Own) -> Vec<Vec3> {
        let first = self.run_of(ranks, garment).start;
        let start = if own.start.is_empty() { &own.rest } else { &own.start };
        fetch(ranks, numbers, |number| owner(&self.starts, number), |number| start[(number - first) as usize])
    }

    /// Every pinned vertex of the scene by its number, in the order of the targets, on rank 0.
    fn pinned(&self, ranks: &Ranks, places: &[Vec<u32>]) -> Vec<Pinned> {
        let of_garment = |g: usize| {
            let pins = self.pins.iter().filter(|pin| pin.garment == g);
            let vertices: Vec<u32> = pins.flat_map(|pin| targets(&pin.target)).map(|(vertex, _)| vertex).collect();
            self.numbers(ranks, g, &vertices, &places[g]).into_iter()
        };
        let mut numbers: Vec<_> = (0..places.len()).map(of_garment).collect();
        let mut all = Vec::new();
        for (p, pin) in self.pins.iter().enumerate() {
            let targets = targets(&pin.target).into_iter().zip(numbers[pin.garment].by_ref());
            for (row, ((_, attachment), vertex)) in targets.enumerate() {
                all.push(Pinned { number: all.len() as u32, pin: p, row, vertex, attachment });
            }
        }
        all
    }

    /// Every stitch of the scene, on rank 0.
    fn sewn(&self, ranks: &Ranks, owns: &[Own], places: &[Vec<u32>]) -> Vec<Sewn> {
        let seams = || self.description.seams.iter().zip(&self.stitches);
        let of_garment = |g: usize| {
            let sewn = |side: usize| seams().filter(move |(seam, _)| seam.garments[side] == g);
            let near = sewn(0).flat_map(|(_, stitches)| stitches.iter().map(|(vertex, _)| *vertex));
            let far = sewn(1).flat_map(|(_, stitches)| stitches.iter().flat_map(|(_, to)| to.vertices()).copied());
            let first_sides = near.clone().count();
            let vertices: Vec<u32> = near.chain(far).collect();
            let numbers = self.numbers(ranks, g, &vertices, &places[g]);
            let at = self.starts_at(ranks, g, &numbers, &owns[g]);
            let mut ends: Vec<(u32, Vec3)> = numbers.into_iter().zip(at).collect();
            let second = ends.split_off(first_sides);
            [ends.into_iter(), second.into_iter()]
        };
        let mut ends: Vec<[_; 2]> = (0..places.len()).map(of_garment).collect();
        let mut all = Vec::new();
        // Other ranks have no stitches, and only answer.
        for (seam, (description, stitches)) in seams().enumerate() {
            let [a, b] = description.garments;
            let share = |stitch: usize| [stitch, stitch + 1].map(|end| end as f64 / stitches.len() as f64);
            for (stitch, (_, to)) in stitches.iter().enumerate() {
                let Some((vertex, x)) = ends[a][0].next() else { break };
                let (mut y, mut weights) = (Vec3::zeros(), to.weights().iter());
                let to = to.renumbered(|unknown| {
                    let (number, place) = ends[b][1].next().unwrap_or((unknown, x));
                    y += place * weights.next().copied().unwrap_or_default();
                    number
                });
                all.push(Sewn {
                    number: all.len() as u32,
                    seam,
                    vertex,
                    to,
                    gap: (x - y).norm(),
                    share: share(stitch),
                });
            }
        }
        all
    }

    /// The piece of own vertices of a garment with the triangles `near` them; partners of own vertices are there too.
    fn piece(&self, ranks: &Ranks, garment: usize, own: Own, near: Vec<Triangle>, sewn: &[Sewn]) -> SubMesh {
        let (run, all) = (self.run(ranks), self.run_of(ranks, garment));
        let partners = partners(sewn, &(run.start as usize..run.end as usize), &self.partition.garments()[garment]);
        let corners = near.iter().flat_map(|triangle| &triangle.corners);
        let mut far: Vec<u32> = corners.chain(&partners).copied().filter(|number| !all.contains(number)).collect();
        far.sort_unstable();
        far.dedup();
        let from = |number: u32| owner(&self.starts, number);
        let row = |number: u32| (number - all.start) as usize;
        let numbers = fetch(ranks, &far, from, |number| own.vertices[row(number)]);
        let rest = fetch(ranks, &far, from, |number| own.rest[row(number)]);
        let maps: Vec<Vec<f64>> =
            own.maps.iter().map(|map| fetch(ranks, &far, from, |number| map[row(number)])).collect();
        let below = far.partition_point(|number| *number < all.start);
        let named = |(scene, garment)| VertexNumbers { scene, garment };
        let mut vertices: Vec<VertexNumbers> = far.into_iter().zip(numbers).map(named).collect();
        vertices.splice(below..below, all.zip(own.vertices).map(named));
        SubMesh {
            vertices,
            rest: between(rest, below, own.rest),
            start: own.start,
            velocities: own.velocities,
            maps: maps.into_iter().zip(own.maps).map(|(far, own)| between(far, below, own)).collect(),
            triangles: near,
        }
    }
}

/// Makes maps of what is handed out as they are: the vertices of elastic bands, and the keys of maps that change over time.
fn add_columns(description: &mut SceneDescription) {
    let SceneDescription { elastics, garments, .. } = description;
    for (number, band) in elastics.iter_mut().enumerate() {
        // Numbers that do not fit have been reported.
        let Some(garment) = garments.get_mut(band.garment) else { continue };
        let mut values = vec![0.0; garment.point_count()];
        for vertex in std::mem::take(&mut band.vertices) {
            values.get_mut(vertex as usize).into_iter().for_each(|value| *value = 1.0);
        }
        garment.maps.insert(ElasticDescription::map(number), PaintedMap { values, absolute: true });
    }
    for garment in garments {
        let GarmentDescription { maps, map_curves, .. } = garment;
        for (of, keys) in map_curves {
            for (number, (_, map)) in keys.iter_mut().enumerate() {
                maps.insert(vertex_maps::column(of, number), std::mem::take(map));
            }
        }
    }
}

/// Whether an effect of the scene lets cloth touch cloth.
fn touches(description: &SceneDescription) -> bool {
    let mut specs = description.effects.iter().filter_map(|request| effects::find(&request.effect));
    specs.any(|spec| spec.needs.contains(&Need::ClothSurface))
}

/// Values of own vertices among those of the others, of which `below` come before.
fn between<T>(mut far: Vec<T>, below: usize, own: Vec<T>) -> Vec<T> {
    if far.is_empty() {
        return own;
    }
    far.splice(below..below, own);
    far
}

/// Values of own vertices of a column that rank 0 has; nothing where there is no such column.
fn column<T: Pod>(ranks: &Ranks, blocks: &BlockDistribution, values: Option<Vec<T>>, own: &[u32]) -> Vec<T> {
    if !ranks.any(values.is_some()) {
        return Vec::new();
    }
    let [values] = scatter_rows(ranks, blocks, |take| {
        values.iter().flatten().for_each(|value| take([std::slice::from_ref(value)]));
    });
    let first = blocks.rows(ranks.rank()).start;
    fetch(ranks, own, |vertex| blocks.of(vertex as usize), |vertex| values[vertex as usize - first])
}

/// Takes what belongs to the points; what is painted stays known, and how.
fn take_columns(garment: &mut GarmentDescription) -> Columns {
    let shell = |(name, map): (&String, &PaintedMap)| (name.clone(), PaintedMap { values: Vec::new(), ..*map });
    let shells = garment.maps.iter().map(shell).collect();
    let maps = std::mem::replace(&mut garment.maps, shells);
    Columns {
        start: garment.start.take(),
        velocities: garment.start_velocities.take(),
        maps: maps.into_values().map(|map| map.values).collect(),
    }
}

/// The vertices of a target, and where they are attached if it says so.
fn targets(target: &PinTarget) -> Vec<(u32, Option<SurfaceAttachment>)> {
    match target {
        PinTarget::Path { vertices, .. }
        | PinTarget::Track { vertices, .. }
        | PinTarget::BodyNearest { vertices, .. } => vertices.iter().map(|vertex| (*vertex, None)).collect(),
        PinTarget::Body { attachments, .. } => attachments.iter().map(|a| (a.vertex, Some(*a))).collect(),
    }
}

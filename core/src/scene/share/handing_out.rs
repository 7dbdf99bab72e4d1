//! Handing out a scene. Rank 0 has the description and reads each garment piece by piece; it never has a garment as a whole.
//!
//! What is read goes first to a *home*, an even share of the points and faces on each rank, where it is checked. Then the ranks
//! find the order of the vertices together (`bisection`), each takes the rest positions of its own, and homes learn which number
//! in the scene their points have. Faces are cut into triangles at home and go to the owners of their corners (`stars`); what else
//! belongs to a vertex is asked for by whoever has it.

use std::ops::Range;

use super::stars::{owner, stars, widen};
use super::{Held, Piece, Received, forget_vertices, pins_of, rings, settle};
use crate::Vec3;
use crate::error::Problem;
use crate::mesh::MeshStream;
use crate::parallel::bisection;
use crate::parallel::communicator::{Expected, Message};
use crate::parallel::parts::Partition;
use crate::parallel::ranks::Ranks;
use crate::parallel::spread::{Homes, ask, spread};
use crate::parallel::wire::Wire;
use crate::scene::painted::PaintedMap;
use crate::scene::sewn::{Sewn, partners, sewn_to};
use crate::scene::validate::listed;
use crate::scene::{GarmentDescription, PinDescription, PinTarget, Pinned, SceneDescription, SurfaceAttachment};

/// What a rank has of a garment as it was read.
pub(super) struct Home {
    pub(super) points_of: Homes,
    pub(super) faces_of: Homes,
    /// Rest positions [m].
    pub(super) points: Vec<Vec3>,
    /// Number of corners and corners of each face.
    corners: Vec<u32>,
}

impl Home {
    /// The corners of each face.
    pub(super) fn faces(&self) -> impl Iterator<Item = &[u32]> {
        let mut rest = self.corners.as_slice();
        std::iter::from_fn(move || {
            let (count, after) = rest.split_first()?;
            let (corners, after) = after.split_at_checked(*count as usize)?;
            rest = after;
            Some(corners)
        })
    }

    /// Numbers that are not finite, and faces that cannot be: what has to hold before anything can be derived.
    fn check(&self, ranks: &Ranks, place: &str, points: usize) -> Vec<Problem> {
        let [first_point, first_face] = [&self.points_of, &self.faces_of].map(|of| of.rows(ranks.rank()).start as u32);
        let broken = (first_point..).zip(&self.points).filter(|(_, p)| !p.iter().all(|c| c.is_finite()));
        let bad = |corners: &[u32]| corners.len() < 3 || corners.iter().any(|v| *v as usize >= points);
        let impossible = (first_face..).zip(self.faces()).filter(|(_, corners)| bad(corners));
        let vertices = listed(ranks, broken.map(|(v, _)| [v; 2]).collect()).map(|list| {
            let what = format!("vertices {list} are not finite numbers");
            Problem::data(place, what, "repair these points and export the mesh again")
        });
        let faces = listed(ranks, impossible.map(|(f, _)| [f; 2]).collect()).map(|list| {
            let what = format!(
                "faces {list} have fewer than three corners or name a point that does not exist ({points} points)"
            );
            Problem::data(place, what, "export the mesh again")
        });
        vertices.into_iter().chain(faces).collect()
    }
}

/// What belongs to the points of a garment beside their rest positions; on rank 0, where they are given.
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

/// A scene that is being handed out.
pub(in crate::scene) struct HandingOut {
    description: SceneDescription,
    partition: Partition,
    assignment: Vec<usize>,
    /// First vertex of every rank, and the number of all at the end.
    starts: Vec<u32>,
    homes: Vec<Home>,
    /// On rank 0.
    columns: Vec<Columns>,
    pins: Vec<PinDescription>,
    /// Pairs of each seam, on rank 0.
    pairs: Vec<Vec<[u32; 2]>>,
}

impl HandingOut {
    /// Tells all ranks what is small, reads the garments and spreads them. `None` if rank 0's message is not one. All ranks
    /// call it together, rank 0 with the description.
    pub(in crate::scene) fn begin(
        ranks: &Ranks,
        description: Option<SceneDescription>,
        problems: &mut Vec<Problem>,
    ) -> Option<Self> {
        let mut meshes = Vec::new();
        let (mut columns, mut pins, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
        let mut all = Vec::new();
        let given = description.map(|mut description| {
            pins.clone_from(&description.pins);
            pairs = description.seams.iter_mut().map(|seam| std::mem::take(&mut seam.pairs)).collect();
            description.pins.iter_mut().for_each(forget_vertices);
            let counts: Vec<(usize, usize)> =
                description.garments.iter().map(|garment| (garment.point_count(), garment.face_count())).collect();
            for garment in &mut description.garments {
                meshes.push(garment.take_mesh());
                columns.push(take_columns(garment));
            }
            (description.to_bytes(), counts.clone()).put(&mut all);
            (description, counts)
        });
        ranks.broadcast(&mut all);
        let (description, counts) = match given {
            Some(given) => given,
            None => {
                let (bytes, counts) = <(Vec<u8>, Vec<(usize, usize)>)>::take(&mut all.as_slice())?;
                (SceneDescription::take(&mut bytes.as_slice())?, counts)
            }
        };
        drop(all);
        let mut meshes = meshes.into_iter();
        let mut homes = Vec::new();
        let mut partition = Partition::default();
        for ((points, faces), garment) in counts.into_iter().zip(&description.garments) {
            let place = format!("garment \"{}\"", garment.name);
            // Each mesh is forgotten when it has been read.
            let home = read(ranks, meshes.next().as_deref(), (points, faces), &place, problems);
            problems.extend(home.check(ranks, &place, points));
            homes.push(home);
            partition.add_garment(points);
        }
        let assignment = partition.share_out(&partition.sizes(), ranks.count());
        let starts = assignment.iter().map(|part| partition.starts()[*part] as u32).collect();
        Some(Self { description, partition, assignment, starts, homes, columns, pins, pairs })
    }

    /// What this rank gets of the scene, which has no problems so far. All ranks call it together.
    pub(in crate::scene) fn finish(mut self, ranks: &Ranks) -> Option<Received> {
        let mut owns = Vec::new();
        let mut places = Vec::new();
        for g in 0..self.homes.len() {
            let own = self.own(ranks, g);
            places.push(self.places(ranks, g, &own.vertices));
            owns.push(own);
        }
        let held = self.held(ranks, &owns, &places)?;
        let mut pieces = Vec::new();
        let (mut owns, mut places) = (owns.into_iter(), places.into_iter());
        for (g, home) in std::mem::take(&mut self.homes).into_iter().enumerate() {
            let near = stars(ranks, home, &places.next()?, &self.starts);
            let near = widen(ranks, near, &self.run(ranks), &self.starts, rings(&self.description, g));
            pieces.push(self.piece(ranks, g, owns.next()?, near, &held.sewn));
        }
        Some(settle(ranks, self.description, (self.partition, self.assignment), pieces, held))
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
        let home = &self.homes[garment];
        let first = home.points_of.rows(ranks.rank()).start;
        let places = self.partition.garments()[garment].clone();
        let (vertices, rest) = bisection::order(ranks, places, &self.starts, (first, &home.points));
        let Columns { start, velocities, maps } = self.columns.get_mut(garment).map(std::mem::take).unwrap_or_default();
        let mut maps = maps.into_iter();
        let maps = (0..self.description.garments[garment].maps.len()).map(|_| maps.next());
        Own {
            start: column(ranks, &home.points_of, start, &vertices),
            velocities: column(ranks, &home.points_of, velocities, &vertices),
            maps: maps.map(|values| column(ranks, &home.points_of, values, &vertices)).collect(),
            vertices,
            rest,
        }
    }

    /// The number in the scene of each point at home here.
    fn places(&self, ranks: &Ranks, garment: usize, own: &[u32]) -> Vec<u32> {
        let homes = &self.homes[garment].points_of;
        let mut lists = vec![Vec::new(); ranks.count()];
        for (vertex, number) in own.iter().zip(self.run_of(ranks, garment)) {
            lists[homes.of(*vertex as usize)].push([*vertex, number]);
        }
        let here = homes.rows(ranks.rank());
        let mut places = vec![0; here.len()];
        for [vertex, number] in ranks.send_lists(lists).into_iter().flatten() {
            places[vertex as usize - here.start] = number;
        }
        places
    }

    /// Numbers in the scene of vertices of a garment.
    fn numbers(&self, ranks: &Ranks, garment: usize, vertices: &[u32], places: &[u32]) -> Vec<u32> {
        let homes = &self.homes[garment].points_of;
        let first = homes.rows(ranks.rank()).start;
        ask(ranks, vertices, |vertex| homes.of(vertex as usize), |vertex| places[vertex as usize - first])
    }

    /// What is held or sewn of own vertices. Rank 0, which knows all, asks where they are.
    fn held(&self, ranks: &Ranks, owns: &[Own], places: &[Vec<u32>]) -> Option<Held> {
        let mut pinned = Vec::new();
        let mut sewn = Vec::new();
        if !self.description.pins.is_empty() {
            pinned = self.pinned(ranks, places);
        }
        if !self.description.seams.is_empty() {
            sewn = self.sewn(ranks, owns, places);
        }
        let own = |rank: usize| self.starts[rank] as usize..self.starts[rank + 1] as usize;
        if ranks.is_first() {
            for rank in 1..ranks.count() {
                let of_rank = (pins_of(&pinned, &own(rank)), sewn_to(&sewn, &own(rank)));
                let bytes = (pinned.len(), of_rank).to_bytes();
                ranks.start(vec![Message { to: rank, bytes }], &[]).finish();
            }
            let pin_targets = pinned.len();
            return Some(Held { pinned: pins_of(&pinned, &own(0)), pin_targets, sewn: sewn_to(&sewn, &own(0)) });
        }
        let bytes = ranks.start(Vec::new(), &[Expected { from: 0, length: None }]).finish().pop()?;
        let (pin_targets, (pinned, sewn)) = <(usize, (Vec<Pinned>, Vec<Sewn>))>::take(&mut bytes.as_slice())?;
        Some(Held { pinned, pin_targets, sewn })
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

    /// Every sewn pair of the scene, on rank 0.
    fn sewn(&self, ranks: &Ranks, owns: &[Own], places: &[Vec<u32>]) -> Vec<Sewn> {
        let sides = || self.description.seams.iter().zip(&self.pairs);
        let of_garment = |g: usize| {
            let of_side = |side: usize| {
                let seams = sides().filter(move |(seam, _)| seam.garments[side] == g);
                seams.flat_map(move |(_, pairs)| pairs.iter().map(move |pair| pair[side]))
            };
            let vertices: Vec<u32> = of_side(0).chain(of_side(1)).collect();
            let numbers = self.numbers(ranks, g, &vertices, &places[g]);
            let (own, first) = (&owns[g], self.run_of(ranks, g).start);
            let start = if own.start.is_empty() { &own.rest } else { &own.start };
            let at = ask(ranks, &numbers, |n| owner(&self.starts, n), |n| start[(n - first) as usize]);
            let first_sides = of_side(0).count();
            let mut ends: Vec<(u32, Vec3)> = numbers.into_iter().zip(at).collect();
            let second = ends.split_off(first_sides);
            [ends.into_iter(), second.into_iter()]
        };
        let mut ends: Vec<[_; 2]> = (0..places.len()).map(of_garment).collect();
        let mut all = Vec::new();
        for (number, (seam, pairs)) in sides().enumerate() {
            let [a, b] = seam.garments;
            let first: Vec<_> = ends[a][0].by_ref().take(pairs.len()).collect();
            for ((p, x), (q, y)) in first.into_iter().zip(ends[b][1].by_ref()) {
                all.push(Sewn { number: all.len() as u32, seam: number, ends: [p, q], gap: (x - y).norm() });
            }
        }
        all
    }

    /// The piece of own vertices of a garment with the triangles `near` them; partners of own vertices are there too.
    fn piece(&self, ranks: &Ranks, garment: usize, own: Own, near: Vec<[u32; 4]>, sewn: &[Sewn]) -> Piece {
        let (run, all) = (self.run(ranks), self.run_of(ranks, garment));
        let partners = partners(sewn, &(run.start as usize..run.end as usize), &self.partition.garments()[garment]);
        let corners = near.iter().flat_map(|[_, corners @ ..]| corners);
        let mut far: Vec<u32> = corners.chain(&partners).copied().filter(|number| !all.contains(number)).collect();
        far.sort_unstable();
        far.dedup();
        let from = |number: u32| owner(&self.starts, number);
        let row = |number: u32| (number - all.start) as usize;
        let numbers = ask(ranks, &far, from, |number| own.vertices[row(number)]);
        let rest = ask(ranks, &far, from, |number| own.rest[row(number)]);
        let maps: Vec<Vec<f64>> =
            own.maps.iter().map(|map| ask(ranks, &far, from, |number| map[row(number)])).collect();
        let below = far.partition_point(|number| *number < all.start);
        let mut vertices: Vec<[u32; 2]> = far.into_iter().zip(numbers).map(Into::into).collect();
        vertices.splice(below..below, all.zip(own.vertices).map(Into::into));
        Piece {
            vertices,
            rest: between(rest, below, own.rest),
            start: own.start,
            velocities: own.velocities,
            maps: maps.into_iter().zip(own.maps).map(|(far, own)| between(far, below, own)).collect(),
            triangles: near,
        }
    }
}

/// Values of own vertices among those of the others, of which so many come before.
fn between<T>(mut far: Vec<T>, below: usize, own: Vec<T>) -> Vec<T> {
    if far.is_empty() {
        return own;
    }
    far.splice(below..below, own);
    far
}

/// Reads a mesh of so many points and faces on rank 0, and spreads it.
fn read(
    ranks: &Ranks,
    mesh: Option<&dyn MeshStream>,
    (points, faces): (usize, usize),
    place: &str,
    problems: &mut Vec<Problem>,
) -> Home {
    let [points_of, faces_of] = [points, faces].map(|rows| Homes::new(rows, ranks.count()));
    let (mut read, mut given) = (Ok(()), [0, 0]);
    let own_points = spread(ranks, &points_of, |take| {
        let mut each = |points: &[Vec3]| {
            given[0] += points.len();
            points.iter().for_each(|point| take(std::slice::from_ref(point)));
        };
        read = mesh.map_or(Ok(()), |mesh| mesh.points(&mut each));
    });
    let mut row = Vec::new();
    let corners = spread(ranks, &faces_of, |take| {
        let mut each = |counts: &[u32], corners: &[u32]| {
            let mut rest = corners;
            for count in counts {
                let Some((corners, after)) = rest.split_at_checked(*count as usize) else { return };
                rest = after;
                given[1] += 1;
                row.clear();
                row.push(*count);
                row.extend_from_slice(corners);
                take(&row);
            }
        };
        read = std::mem::replace(&mut read, Ok(())).and(mesh.map_or(Ok(()), |mesh| mesh.faces(&mut each)));
    });
    if mesh.is_some() && read.is_ok() && given != [points, faces] {
        let [now_points, now_faces] = given;
        read = Err(format!("it had {points} points and {faces} faces, and has {now_points} and {now_faces} now"));
    }
    if let Err(what) = read {
        problems.push(Problem::data(place, what, "export the mesh again, and leave it alone while it is read"));
    }
    let points = own_points;
    Home { points_of, faces_of, points, corners }
}

/// Values of own vertices of a column that rank 0 has; nothing where there is no such column.
fn column<T: bytemuck::Pod>(ranks: &Ranks, homes: &Homes, values: Option<Vec<T>>, own: &[u32]) -> Vec<T> {
    if !ranks.any(values.is_some()) {
        return Vec::new();
    }
    let values =
        spread(ranks, homes, |take| values.iter().flatten().for_each(|value| take(std::slice::from_ref(value))));
    let first = homes.rows(ranks.rank()).start;
    ask(ranks, own, |vertex| homes.of(vertex as usize), |vertex| values[vertex as usize - first])
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

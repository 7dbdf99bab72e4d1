//! What goes from a simulation to files: fields of garments as caches store them, and what rank 0 reads for all. All ranks
//! call these together; rank 0 alone gives and gets.

use super::{FrameInput, Sample, Simulation};
use crate::Vec3;
use crate::parallel::message::codec;
use crate::parallel::ranks::Ranks;
use crate::scene::MergedVertex;
use crate::scene::Scene;
use crate::wind_grid::WindSample;

/// A field of the vertices of a garment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Positions [m].
    Positions,
    /// Velocities [m/s].
    Velocities,
}

codec!(struct Sample { time, positions });
codec!(struct WindSample { time, velocities });
codec!(struct FrameInput { frame, bodies, tracks, wind });

/// The number in its garment of the vertex that follows another in a row.
struct MergedNumber {
    row: u32,
    number: u32,
}

/// What the vertex in a row gets of the one that it follows.
struct MergedValue {
    row: u32,
    /// Position [m] or velocity [m/s].
    value: Vec3,
}

codec!(struct MergedNumber { row, number });
codec!(struct MergedValue { row, value });

impl Scene {
    /// The input of a frame for each rank, of what rank 0 has read: all bodies, and of the tracks what own pins follow. All
    /// ranks call it together; `None` everywhere but on rank 0.
    pub fn share_input(&self, input: Option<FrameInput>) -> FrameInput {
        let ranks = self.parts().ranks();
        if ranks.is_alone() {
            return input.expect("rank 0 has read the input");
        }
        let mut tracks = Vec::new();
        let input = input.map(|mut input| {
            let shells = vec![Vec::new(); input.tracks.len()];
            tracks = std::mem::replace(&mut input.tracks, shells);
            input
        });
        let mut shared = ranks.broadcast_encoded("input of a frame", input);
        for (track, samples) in shared.tracks.iter_mut().enumerate() {
            *samples = self.share_track(track, tracks.get(track));
        }
        shared
    }

    /// The rows of a track that own pins follow, of the samples that rank 0 has.
    fn share_track(&self, track: usize, samples: Option<&Vec<Sample>>) -> Vec<Sample> {
        let ranks = self.parts().ranks();
        let wanted = ranks.gather(&self.track_rows(track));
        let rows_of = |sample: &Sample, rows: &[u32]| Sample {
            time: sample.time,
            positions: rows.iter().filter_map(|row| sample.positions.get(*row as usize).copied()).collect(),
        };
        ranks.scatter_encoded("samples of a track", |rank| {
            samples.into_iter().flatten().map(|sample| rows_of(sample, &wanted[rank])).collect()
        })
    }
}

impl Simulation {
    /// This rank and the others.
    pub fn ranks(&self) -> &Ranks {
        self.scene().parts().ranks()
    }

    /// One field of a garment as it is stored, in the garment's own order: on rank 0, `None` elsewhere.
    pub fn stored(
        &self,
        garment: usize,
        field: Field,
        convert: &(dyn Fn(&Vec3) -> [f32; 3] + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        self.in_own_order(garment, field, [0.0; 3], convert)
    }

    /// Positions of a garment in its own order [m], on rank 0; nothing elsewhere.
    pub fn garment_positions(&self, garment: usize, out: &mut Vec<Vec3>) {
        *out = self.in_own_order(garment, Field::Positions, Vec3::zeros(), &|x| *x).unwrap_or_default();
    }

    /// Velocities of a garment in its own order [m/s], on rank 0; nothing elsewhere.
    pub fn garment_velocities(&self, garment: usize, out: &mut Vec<Vec3>) {
        *out = self.in_own_order(garment, Field::Velocities, Vec3::zeros(), &|v| *v).unwrap_or_default();
    }

    /// Number of crossings of cloth with cloth when every vertex is where `place` puts it; the same on all ranks. Zero without
    /// self-contact. All ranks call it together.
    pub fn crossings_when(&mut self, place: &(dyn Fn(&Vec3) -> Vec3 + Sync)) -> u32 {
        let Self { contacts, cloth, prescribed, .. } = self;
        let found = contacts.cloth.as_mut().map_or(0, |c| c.crossings_when(&cloth.state.x, &prescribed.bodies, place));
        u32::try_from(found).unwrap_or(u32::MAX)
    }

    fn in_own_order<T: bytemuck::Pod>(
        &self,
        garment: usize,
        field: Field,
        zero: T,
        convert: &(dyn Fn(&Vec3) -> T + Sync),
    ) -> Option<Vec<T>> {
        let (parts, ranks) = (self.scene().parts(), self.ranks());
        let own = parts.own_of_garment(garment);
        let values = match field {
            Field::Positions => &self.state().x[own.clone()],
            Field::Velocities => &self.state().v[own.clone()],
        };
        let numbers = &parts.own_numbers()[own];
        let count = parts.partition().garments()[garment].len();
        let mut all = vec![zero; if ranks.is_first() { count } else { 0 }];
        let mut put = |numbers: &[u32], values: &mut dyn Iterator<Item = T>| {
            numbers.iter().zip(values).for_each(|(number, value)| all[*number as usize] = value);
        };
        if ranks.is_first() {
            put(numbers, &mut values.iter().map(convert));
        }
        if !ranks.is_alone() {
            // Rank after rank, so that rank 0 never holds more than what it hands on and the share of one.
            for rank in 1..ranks.count() {
                let here = rank == ranks.rank();
                let values: Vec<T> = if here { values.iter().map(convert).collect() } else { Vec::new() };
                let numbers = ranks.send_to_root(rank, if here { numbers } else { &[] });
                let values = ranks.send_to_root(rank, &values);
                if ranks.is_first() {
                    put(&numbers, &mut values.into_iter());
                }
            }
        }
        self.put_followers(garment, field, convert, &mut all);
        ranks.is_first().then_some(all)
    }

    /// Puts what takes no part to where the vertex is that it follows.
    fn put_followers<T>(&self, garment: usize, field: Field, convert: &(dyn Fn(&Vec3) -> T + Sync), all: &mut [T]) {
        let (parts, ranks, state) = (self.scene().parts(), self.ranks(), self.state());
        let place = parts.partition().garments()[garment].clone();
        let of_garment = self.scene().followers().iter().filter(|follower| place.contains(&(follower.vertex as usize)));
        let followers: Vec<&MergedVertex> = of_garment.collect();
        if followers.is_empty() {
            return;
        }
        let own = parts.own();
        // The number of a follower is known to its owner, and its place to that of its leader.
        let (mut numbers, mut values) = (Vec::new(), Vec::new());
        for (row, follower) in (0..).zip(&followers) {
            let local = |number: u32| parts.local(number).filter(|local| own.contains(local));
            let number = |local: usize| MergedNumber { row, number: parts.own_numbers()[local] };
            numbers.extend(local(follower.vertex).map(number));
            let value = |local: usize| match field {
                Field::Positions => state.x[local] + follower.offset,
                Field::Velocities => state.v[local],
            };
            values.extend(local(follower.leader).map(|local| MergedValue { row, value: value(local) }));
        }
        let mut number_of = vec![0; followers.len()];
        for MergedNumber { row, number } in ranks.all_gather_encoded("numbers of followers", numbers) {
            number_of[row as usize] = number;
        }
        let values = ranks.all_gather_encoded("values of followers", values);
        if ranks.is_first() {
            values.iter().for_each(|merged| all[number_of[merged.row as usize] as usize] = convert(&merged.value));
        }
    }
}

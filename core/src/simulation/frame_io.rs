//! What goes from a simulation to files: fields of garments as caches store them, and what rank 0 reads for all. All ranks
//! call these together; rank 0 alone gives and gets.

use super::{FrameInput, Sample, Simulation};
use crate::Vec3;
use crate::parallel::message::{Codec, decode, wire};
use crate::parallel::ranks::Ranks;
use crate::scene::Scene;
use crate::scene::gather::{LocalValues, VertexField};
use crate::state::State;
use crate::wind_grid::WindSample;

wire!(struct Sample { time, positions });
wire!(struct WindSample { time, velocities });
wire!(struct FrameInput { frame, bodies, tracks, wind });

impl Scene {
    /// The input of a frame for each rank, of what rank 0 has read: all bodies, and of the tracks what own pins follow. All
    /// ranks call it together; `None` everywhere but on rank 0.
    pub fn share_input(&self, input: Option<FrameInput>) -> FrameInput {
        let ranks = self.parts().ranks();
        let mut input = input.unwrap_or_default();
        if ranks.is_alone() {
            return input;
        }
        let tracks = std::mem::take(&mut input.tracks);
        let mut bytes = (input, tracks.len()).to_bytes();
        ranks.broadcast(&mut bytes);
        let (mut shared, count): (FrameInput, usize) = decode(ranks.rank(), "input of a frame", &bytes);
        shared.tracks = (0..count).map(|track| self.share_track(track, tracks.get(track))).collect();
        shared
    }

    /// The rows of a track that own pins follow, of the samples that rank 0 has.
    fn share_track(&self, track: usize, samples: Option<&Vec<Sample>>) -> Vec<Sample> {
        let ranks = self.parts().ranks();
        let wanted = ranks.gather(&self.track_rows(track));
        let rows = |rows: &Vec<u32>| -> Vec<u8> {
            let of = |sample: &Sample| Sample {
                time: sample.time,
                positions: rows.iter().filter_map(|row| sample.positions.get(*row as usize).copied()).collect(),
            };
            samples.map_or_else(Vec::new, |samples| samples.iter().map(of).collect()).to_bytes()
        };
        let mut lists: Vec<Vec<u8>> = wanted.iter().map(rows).collect();
        lists.resize(ranks.count(), Vec::new());
        decode(ranks.rank(), "samples of a track", &ranks.all_to_all_v(lists)[0])
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
        field: VertexField,
        convert: &(dyn Fn(&Vec3) -> [f32; 3] + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        self.in_own_order(garment, field, convert)
    }

    /// Positions of a garment in its own order [m], on rank 0; nothing elsewhere.
    pub fn garment_positions(&self, garment: usize, out: &mut Vec<Vec3>) {
        *out = self.in_own_order(garment, VertexField::Positions, &|x| *x).unwrap_or_default();
    }

    /// Velocities of a garment in its own order [m/s], on rank 0; nothing elsewhere.
    pub fn garment_velocities(&self, garment: usize, out: &mut Vec<Vec3>) {
        *out = self.in_own_order(garment, VertexField::Velocities, &|v| *v).unwrap_or_default();
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
        field: VertexField,
        convert: &(dyn Fn(&Vec3) -> T + Sync),
    ) -> Option<Vec<T>> {
        let State { x, v, .. } = self.state();
        let values = if field == VertexField::Positions { x } else { v };
        self.scene().gather_garment(garment, LocalValues { field, values }, convert)
    }
}

//! Data exchanged between a simulation and files: fields of garments as caches store them, and input that rank 0
//! reads for all. All ranks call these together; rank 0 alone gives and gets.

use super::{FrameInput, Sample, Simulation};
use crate::Vec3;
use crate::parallel::message::codec;
use crate::parallel::ranks::Ranks;
use crate::scene::Scene;
use crate::scene::gather::{LocalValues, VertexField};
use crate::state::State;
use crate::wind_grid::WindSample;

codec!(struct Sample { time, positions });
codec!(struct WindSample { time, velocities });
codec!(struct FrameInput { frame, bodies, tracks, wind, output_times });

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

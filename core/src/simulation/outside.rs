//! What goes from a simulation to files and back: fields of garments as caches store them, and everything that a checkpoint
//! needs. All ranks call these together; rank 0 alone gives and gets.

use std::sync::Arc;

use super::{FrameInput, RestoreError, Simulation};
use crate::Vec3;
use crate::error::Problems;
use crate::geometry::crossings::{CrossingSearch, find};
use crate::parallel::ranks::Ranks;
use crate::scene::{Scene, SceneDescription};
use crate::snapshot::{Snapshot, SnapshotSink, SnapshotSource};

/// A field of the vertices of a garment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Positions [m].
    Positions,
    /// Velocities [m/s].
    Velocities,
}

impl Scene {
    /// The checked scene on all ranks, each with its share. Rank 0 gives the description, the others `None`.
    ///
    /// # Errors
    /// All problems of the description, the same on all ranks.
    ///
    /// # Panics
    /// Rank 0 gives no description.
    pub fn distribute(_ranks: &Ranks, description: Option<SceneDescription>) -> Result<Self, Problems> {
        Self::validate(description.expect("rank 0 has the description"))
    }

    /// The input of a frame for each rank, of what rank 0 has read: all bodies, and of the tracks what its pins follow.
    ///
    /// # Panics
    /// Rank 0 gives no input.
    pub fn share_input(&self, input: Option<FrameInput>) -> FrameInput {
        input.expect("rank 0 has the input")
    }
}

impl Simulation {
    /// One field of a garment as it is stored, in the garment's own order: on rank 0, `None` elsewhere.
    pub fn stored(
        &self,
        garment: usize,
        field: Field,
        convert: &(dyn Fn(&Vec3) -> [f32; 3] + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        let mut values = Vec::new();
        match field {
            Field::Positions => self.garment_positions(garment, &mut values),
            Field::Velocities => self.garment_velocities(garment, &mut values),
        }
        Some(values.iter().map(convert).collect())
    }

    /// Number of crossings of cloth with cloth when every vertex is where `place` puts it; the same on all ranks.
    pub fn crossings_when(&mut self, place: &(dyn Fn(&Vec3) -> Vec3 + Sync)) -> u32 {
        let scene = &self.scene;
        let (mut triangles, mut all, mut positions) = (Vec::new(), Vec::new(), Vec::new());
        for (garment, mesh) in scene.meshes().iter().enumerate() {
            let first = all.len() as u32;
            triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
            self.garment_positions(garment, &mut positions);
            all.extend(positions.iter().map(place));
        }
        let search = CrossingSearch::new(triangles, all);
        u32::try_from(find(&search.surface()).len()).unwrap_or(u32::MAX)
    }

    /// Everything that time has changed, section by section and rows in order, to the sink of rank 0. Only between calls of
    /// [`Simulation::advance_or_pause`].
    pub fn save(&self, sink: Option<&mut dyn SnapshotSink>) {
        if let Some(sink) = sink {
            self.snapshot().give(sink);
        }
    }

    /// A simulation that goes on from what was saved, which rank 0 gives; `start` is the input of the frame that the state
    /// follows.
    ///
    /// # Errors
    /// As [`Simulation::restore`].
    ///
    /// # Panics
    /// Rank 0 gives no source.
    pub fn restore_from(
        scene: impl Into<Arc<Scene>>,
        start: &FrameInput,
        source: Option<&mut dyn SnapshotSource>,
    ) -> Result<Self, RestoreError> {
        let snapshot = Snapshot::take(source.expect("rank 0 has the source"))?;
        Self::restore(scene, start, &snapshot)
    }
}

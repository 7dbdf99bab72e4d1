//! Saving a simulation, and going on from what was saved.

use std::sync::Arc;

use super::{FrameInput, Simulation};
use crate::Vec3;
use crate::contact::self_contact;
use crate::effects::{body_collision, pins};
use crate::error::Problems;
use crate::scene::Scene;
use crate::snapshot::{Section, Snapshot, SnapshotError};

/// Name of the section with positions and velocities.
const STATE: &str = "state";

/// Version of that section.
const VERSION: u32 = 1;

/// Why a simulation cannot go on from a snapshot.
#[derive(Debug, thiserror::Error)]
pub enum RestoreError {
    /// The scene or its inputs cannot be simulated.
    #[error("{0}")]
    Problems(Problems),
    /// The snapshot does not fit the scene.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
}

impl Simulation {
    /// Everything that time has changed. Only between calls of [`Simulation::advance_or_pause`], which return at states free
    /// of collisions.
    pub fn snapshot(&self) -> Snapshot {
        let parts = self.scene.parts();
        let state = Section::new(STATE, VERSION)
            .number("time", self.state.time)
            .number("last_step", self.limit.last())
            .vectors("positions", parts.in_own_order(&self.state.x))
            .vectors("velocities", parts.in_own_order(&self.state.v));
        let pins = (!self.targets.is_empty()).then(|| self.targets.save());
        let collision = self.collision.as_ref().and_then(|collision| collision.save(parts));
        let contact = self.self_contact.as_ref().map(|contact| contact.save(parts));
        Snapshot { sections: [Some(state), pins, collision, contact].into_iter().flatten().collect() }
    }

    /// A simulation that goes on from a snapshot taken at the frame of `start`, or after it and before the next one; `start`
    /// holds one sample per deforming body and track, at that frame.
    ///
    /// # Errors
    /// Problems of the scene as in [`Simulation::new`]; a snapshot of another scene or version.
    pub fn restore(
        scene: impl Into<Arc<Scene>>,
        start: &FrameInput,
        snapshot: &Snapshot,
    ) -> Result<Self, RestoreError> {
        let mut simulation = Self::build(scene.into(), start).map_err(RestoreError::Problems)?;
        simulation.load(start.frame, snapshot)?;
        Ok(simulation)
    }

    fn load(&mut self, frame: i64, snapshot: &Snapshot) -> Result<(), SnapshotError> {
        let Self { scene, state, targets, collision, self_contact, bodies, limit, .. } = self;
        let parts = scene.parts();
        let section = snapshot.section(STATE, VERSION)?;
        let timeline = scene.description().timeline;
        state.time = section.read_number("time")?;
        if !(timeline.time(frame)..timeline.time(frame + 1)).contains(&state.time) {
            let (time, frame_time) = (state.time, timeline.time(frame));
            return Err(section.error(format!("its time {time} s does not follow frame {frame} at {frame_time} s")));
        }
        limit.set_last(section.read_number("last_step")?);
        let vectors = |name: &str| -> Result<Vec<Vec3>, SnapshotError> {
            Ok(parts.in_solver_order(&section.read_vectors(name, parts.vertex_count())?).collect())
        };
        (state.x, state.v) = (vectors("positions")?, vectors("velocities")?);
        bodies.set_step(state.time, state.time);
        if !targets.is_empty() {
            targets.load(snapshot.section(pins::SPEC.name, pins::VERSION)?, bodies)?;
        }
        if let Some(collision) = collision.as_mut().filter(|collision| collision.remembers()) {
            collision.load(snapshot.section(body_collision::SPEC.name, body_collision::VERSION)?, parts)?;
        }
        if let Some(contact) = self_contact {
            contact.load(snapshot.section(self_contact::SECTION, self_contact::VERSION)?, parts)?;
            self.crossings = contact.known_crossings().to_vec();
        }
        self.frame = frame;
        Ok(())
    }
}

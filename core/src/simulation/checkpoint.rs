//! Saving a simulation, and going on from what was saved.

use std::sync::Arc;

use super::{FrameInput, Simulation};
use crate::Vec3;
use crate::contact::bodies::collision;
use crate::contact::self_contact;
use crate::error::Problems;
use crate::scene::{Integrator, Scene};
use crate::snapshot::saved_section::{ElementRows, Field, SavedSection, SectionId, TargetNumbers};
use crate::snapshot::{Snapshot, SnapshotError, SnapshotSink, SnapshotSource};
use crate::step::Prescribed;

/// Positions and velocities, which every scene has.
const STATE: SectionId = SectionId { name: "state", version: 2 };

/// Name of the rows of hinges, and how many vertices and values each has.
const HINGES: &str = "hinges";
const HINGE_VERTICES: usize = 4;
const HINGE_VALUES: usize = 2;

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
    /// Everything that time has changed, in memory. Only between calls of [`Simulation::advance_or_pause`], which return at
    /// states free of collisions. All ranks call it together; rank 0 has the snapshot, the others an empty one.
    pub fn snapshot(&self) -> Snapshot {
        let mut snapshot = Snapshot::default();
        self.save(self.ranks().is_first().then_some(&mut snapshot));
        snapshot
    }

    /// Everything that time has changed, section by section and rows in order, to the sink of rank 0. When, as
    /// [`Simulation::snapshot`].
    pub fn save(&self, mut sink: Option<&mut dyn SnapshotSink>) {
        let numbers = self.prescribed.targets.numbers();
        let targets = TargetNumbers { own: &numbers, all: self.scene.pin_targets() };
        for section in self.saved_sections() {
            section.write(self.scene.parts(), targets, sink.as_deref_mut());
        }
    }

    /// What time has changed, on this rank.
    pub(super) fn saved_sections(&self) -> Vec<SavedSection> {
        let own = self.scene.parts().own();
        let of_own = |vectors: &[Vec3]| Field::Vectors(vectors[own.clone()].to_vec());
        let state = SavedSection::new(STATE)
            .with("time", Field::Number(self.cloth.state.time))
            .with("last_step", Field::Number(self.limit.last()))
            .with("halvings", Field::Count(self.retry.saved()[0]))
            .with("calm", Field::Count(self.retry.saved()[1]))
            .with("positions", of_own(&self.cloth.state.x))
            .with("velocities", of_own(&self.cloth.state.v));
        // Only the implicit step foresees with accelerations.
        let state = match self.variants.integrator {
            Integrator::SemiImplicit => state,
            Integrator::TrBdf2 => state.with("accelerations", of_own(&self.cloth.state.a)),
        };
        let pins = (self.scene.pin_targets() > 0).then(|| self.prescribed.targets.save());
        let collision = self.contacts.bodies.as_ref().and_then(|collision| collision.save());
        let contact = self.contacts.cloth.as_ref().map(|contact| contact.save());
        let yielded = self.yields.map(|section| self.remember_elements(section));
        [Some(state), pins, collision, contact, yielded].into_iter().flatten().collect()
    }

    /// What has yielded in elements that count on this rank, by vertices of the scene.
    fn remember_elements(&self, section: SectionId) -> SavedSection {
        let (parts, mut rows) = (self.scene.parts(), ElementRows::new(HINGE_VERTICES, HINGE_VALUES));
        let plastic = self.dynamics.forces.iter().flatten().filter_map(|force| force.plastic());
        plastic.for_each(|force| force.save_elements(&mut rows));
        let rows = rows.renumbered(|vertex| Some(parts.number(vertex as usize)));
        SavedSection::new(section).with(HINGES, Field::Elements(rows))
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
        Self::restore_from(scene, start, Some(&mut snapshot.clone()))
    }

    /// The same over ranks: rank 0 has the source. All ranks call it together.
    ///
    /// # Errors
    /// As [`Simulation::restore`], the same on all ranks.
    pub fn restore_from(
        scene: impl Into<Arc<Scene>>,
        start: &FrameInput,
        mut source: Option<&mut dyn SnapshotSource>,
    ) -> Result<Self, RestoreError> {
        let mut simulation = Self::build(scene.into(), start).map_err(RestoreError::Problems)?;
        // What a new simulation remembers says what there is to read.
        let mut memory = simulation.saved_sections();
        let numbers = simulation.prescribed.targets.numbers();
        let targets = TargetNumbers { own: &numbers, all: simulation.scene.pin_targets() };
        for section in &mut memory {
            section.read(simulation.scene.parts(), targets, source.as_deref_mut())?;
        }
        simulation.restore_sections(start.frame, &memory)?;
        Ok(simulation)
    }

    /// Goes on from what was remembered at the frame `frame` or after it.
    pub(super) fn restore_sections(&mut self, frame: i64, memory: &[SavedSection]) -> Result<(), SnapshotError> {
        let Self { scene, cloth, prescribed: Prescribed { targets, bodies, .. }, contacts, limit, retry, .. } = self;
        let state = &mut cloth.state;
        let parts = scene.parts();
        let timeline = scene.description().timeline;
        let mut sections = memory.iter();
        let mut problem = None;
        if let Some(section) = sections.next() {
            state.time = section.number("time");
            if !(timeline.time(frame)..timeline.time(frame + 1)).contains(&state.time) {
                let (time, frame_time) = (state.time, timeline.time(frame));
                let what = format!("its time {time} s does not follow frame {frame} at {frame_time} s");
                return Err(SnapshotError { section: STATE.name.to_owned(), what });
            }
            limit.set_last(section.number("last_step"));
            retry.restore(["halvings", "calm"].map(|name| section.count(name)));
            for (name, vectors) in [("positions", &mut state.x), ("velocities", &mut state.v)] {
                vectors[parts.own()].copy_from_slice(section.vectors(name));
                parts.halo().update(parts.ranks(), vectors);
            }
            if scene.description().solver.integrator == Integrator::TrBdf2 {
                state.a[parts.own()].copy_from_slice(section.vectors("accelerations"));
                parts.halo().update(parts.ranks(), &mut state.a);
            }
        }
        bodies.set_step(state.time, state.time);
        if scene.pin_targets() > 0
            && let Some(section) = sections.next()
        {
            problem = targets.restore(section, bodies).err();
        }
        if let (Some(collision), Some(section)) = (
            contacts.bodies.as_mut().filter(|c| c.remembers()),
            memory.iter().find(|s| s.name == collision::SECTION.name),
        ) {
            collision.restore(section);
        }
        if let (Some(contact), Some(section)) =
            (&mut contacts.cloth, memory.iter().find(|section| section.name == self_contact::SECTION.name))
        {
            contact.restore(section)?;
            self.crossings = contact.known_crossings().to_vec();
        }
        let yielded = self.yields.and_then(|section| memory.iter().find(|known| known.name == section.name));
        if let Some(rows) = yielded.and_then(|section| section.elements(HINGES)) {
            let rows = rows.renumbered(|number| parts.local(number).map(|vertex| vertex as u32));
            let plastic = self.dynamics.forces.iter_mut().flatten().filter_map(|force| force.plastic_mut());
            plastic.for_each(|force| force.restore_elements(&rows));
        }
        self.frame = frame;
        let elsewhere =
            || SnapshotError { section: STATE.name.to_owned(), what: "another rank cannot resume from it".into() };
        match (scene.parts().ranks().any(problem.is_some()), problem) {
            (false, _) => Ok(()),
            (true, problem) => Err(problem.unwrap_or_else(elsewhere)),
        }
    }
}

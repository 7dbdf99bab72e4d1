//! Saving a simulation, and going on from what was saved.

use std::sync::Arc;

use super::integrator_change::take_saved_integrator;
use super::integrator_choice::choose_integrator;
use super::{FrameInput, Simulation};
use crate::Vec3;
use crate::error::Problems;
use crate::scene::Scene;
use crate::snapshot::elements::{ElementRows, renumbered};
use crate::snapshot::rows::TargetNumbers;
use crate::snapshot::saved_section::{Field, SavedSection, SectionId};
use crate::snapshot::{Snapshot, SnapshotError, SnapshotSink, SnapshotSource};
use crate::step::Prescribed;

/// Positions and velocities, which every scene has.
const STATE: SectionId = SectionId { name: "state", version: 2 };

/// Name of the rows of elements that have yielded.
const HINGES: &str = "hinges";

/// Name of the rows of stitches that have broken.
const BROKEN: &str = "broken";

/// A room of the solver that remembers something from frame to frame.
pub(super) struct Room {
    /// Its section with what it remembers on this rank; `None` if the scene does not have it.
    save: fn(&Simulation) -> Option<SavedSection>,
    /// Goes on from a section that it has saved; ranks call it together, and come to the same.
    restore: fn(&mut Simulation, &SavedSection) -> Result<(), SnapshotError>,
}

/// All rooms, in the order of their sections in a snapshot.
static ROOMS: [Room; 8] = [
    Room { save: Simulation::save_integrator, restore: Simulation::restore_integrator },
    Room { save: |simulation| Some(simulation.save_state()), restore: Simulation::restore_state },
    Room { save: Simulation::save_pins, restore: Simulation::restore_pins },
    Room { save: |simulation| simulation.contacts.bodies.as_ref()?.save(), restore: Simulation::restore_collision },
    Room { save: Simulation::save_deep_parts, restore: Simulation::restore_deep_parts },
    Room { save: |simulation| Some(simulation.contacts.cloth.as_ref()?.save()), restore: Simulation::restore_contact },
    Room { save: Simulation::save_elements, restore: Simulation::restore_elements },
    Room { save: Simulation::save_seams, restore: Simulation::restore_seams },
];

/// Error of [`Simulation::restore`]: the scene is at fault, or the snapshot.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::{FrameInput, RestoreError, Scene, Simulation, Snapshot};
/// let scene = Scene::validate(description).expect("a valid scene");
/// let nothing = Simulation::restore(scene, &FrameInput::to_frame(0), &Snapshot::default());
/// assert!(matches!(nothing, Err(RestoreError::Snapshot(error)) if error.section == "state"));
/// ```
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
        for (_, section) in self.saved_sections() {
            section.write(self.scene.parts(), targets, sink.as_deref_mut());
        }
    }

    /// State of this rank that time has changed: a section for each room.
    pub(super) fn saved_sections(&self) -> Vec<(&'static Room, SavedSection)> {
        ROOMS.iter().filter_map(|room| Some((room, (room.save)(self)?))).collect()
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
    /// The same as of [`Simulation::restore`], alike on all ranks.
    pub fn restore_from(
        scene: impl Into<Arc<Scene>>,
        start: &FrameInput,
        mut source: Option<&mut dyn SnapshotSource>,
    ) -> Result<Self, RestoreError> {
        let mut scene = scene.into();
        choose_integrator(&mut scene).map_err(RestoreError::Problems)?;
        take_saved_integrator(&mut scene, source.as_deref_mut())?;
        let mut simulation = Self::build(scene, start).map_err(RestoreError::Problems)?;
        // What a new simulation remembers says what there is to read.
        let mut memory = simulation.saved_sections();
        let numbers = simulation.prescribed.targets.numbers();
        let targets = TargetNumbers { own: &numbers, all: simulation.scene.pin_targets() };
        for (_, section) in &mut memory {
            section.read(simulation.scene.parts(), targets, source.as_deref_mut())?;
        }
        simulation.restore_sections(start.frame, &memory)?;
        Ok(simulation)
    }

    /// Goes on from what was remembered at the frame `frame` or after it.
    pub(super) fn restore_sections(
        &mut self,
        frame: i64,
        memory: &[(&'static Room, SavedSection)],
    ) -> Result<(), SnapshotError> {
        self.frame = frame;
        memory.iter().try_for_each(|(room, section)| (room.restore)(self, section))
    }

    fn save_state(&self) -> SavedSection {
        let own = self.scene.parts().own();
        let of_own = |vectors: &[Vec3]| Field::vectors(&vectors[own.clone()]);
        let [halvings, calm] = self.retry.saved();
        let state = SavedSection::new(STATE)
            .with("time", Field::single(self.cloth.state.time))
            .with("last_step", Field::single(self.limit.last()))
            .with("halvings", Field::single(halvings))
            .with("calm", Field::single(calm))
            .with("positions", of_own(&self.cloth.state.x))
            .with("velocities", of_own(&self.cloth.state.v));
        let keeps_acceleration = self.scene.description().solver.integrator.spec().keeps_acceleration;
        if keeps_acceleration { state.with("accelerations", of_own(&self.cloth.state.a)) } else { state }
    }

    fn restore_state(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        let Self { scene, cloth, prescribed, limit, retry, frame, .. } = self;
        let (state, parts, timeline) = (&mut cloth.state, scene.parts(), scene.description().timeline);
        state.time = section.single("time");
        if !(timeline.time(*frame)..timeline.time(*frame + 1)).contains(&state.time) {
            let (time, frame_time) = (state.time, timeline.time(*frame));
            let what = format!("its time {time} s does not follow frame {frame} at {frame_time} s");
            return Err(SnapshotError { section: STATE.name.to_owned(), what });
        }
        limit.set_last(section.single("last_step"));
        retry.restore(["halvings", "calm"].map(|name| section.single(name)));
        let take = |name: &str, vectors: &mut [Vec3]| {
            vectors[parts.own()].copy_from_slice(section.vectors(name));
            parts.halo().update(parts.ranks(), vectors);
        };
        take("positions", &mut state.x);
        take("velocities", &mut state.v);
        // The frames before may have had short steps, which keep none.
        if scene.description().solver.integrator.spec().keeps_acceleration && section.has("accelerations") {
            take("accelerations", &mut state.a);
        }
        prescribed.bodies.set_step(state.time, state.time);
        Ok(())
    }

    fn save_pins(&self) -> Option<SavedSection> {
        (self.scene.pin_targets() > 0).then(|| self.prescribed.targets.save())
    }

    fn restore_pins(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        let Prescribed { targets, bodies, .. } = &mut self.prescribed;
        let problem = targets.restore(section, bodies).err();
        let elsewhere =
            || SnapshotError { section: section.id.name.to_owned(), what: "another rank cannot resume from it".into() };
        match (self.scene.parts().ranks().any(problem.is_some()), problem) {
            (false, _) => Ok(()),
            (true, problem) => Err(problem.unwrap_or_else(elsewhere)),
        }
    }

    fn restore_collision(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        self.contacts.bodies.iter_mut().for_each(|collision| collision.restore(section));
        Ok(())
    }

    /// Number of the vertices of cloth of all ranks.
    fn cloth_count(&self) -> u32 {
        self.scene.parts().partition().vertex_count() as u32
    }

    /// Time of the last frame [s].
    fn frame_time(&self) -> f64 {
        self.scene.description().timeline.time(self.frame)
    }

    fn save_deep_parts(&self) -> Option<SavedSection> {
        self.contacts.bodies.as_ref()?;
        self.prescribed.bodies.save_deep_parts(self.cloth_count(), self.frame_time())
    }

    fn restore_deep_parts(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        let (cloth, time) = (self.cloth_count(), self.frame_time());
        self.prescribed.bodies.restore_deep_parts(cloth, time, section)
    }

    fn restore_contact(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        let Some(contact) = &mut self.contacts.cloth else { return Ok(()) };
        contact.restore(section)?;
        self.crossings = contact.known_crossings().to_vec();
        Ok(())
    }

    /// Yielded values of elements with an own vertex, by vertices of the scene.
    fn save_elements(&self) -> Option<SavedSection> {
        let section = SavedSection::new(self.yields?);
        let (parts, mut rows) = (self.scene.parts(), ElementRows::new());
        let plastic = self.dynamics.forces.iter().flatten().filter_map(|force| force.plastic());
        plastic.for_each(|force| force.save_elements(&mut rows));
        let rows = renumbered(rows, |vertex| Some(parts.number(vertex as usize)));
        Some(section.with(HINGES, Field::elements(&rows)))
    }

    fn restore_elements(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        let parts = self.scene.parts();
        let local = |number| parts.local(number).map(|vertex| vertex as u32);
        let rows = renumbered(section.elements(HINGES), local);
        let plastic = self.dynamics.forces.iter_mut().flatten().filter_map(|force| force.plastic_mut());
        plastic.for_each(|force| force.restore_elements(&rows));
        Ok(())
    }

    /// Broken stitches with an own vertex, by vertices of the scene; nothing where none can break.
    fn save_seams(&self) -> Option<SavedSection> {
        let section = SavedSection::new(self.breaks?);
        let (parts, mut rows) = (self.scene.parts(), ElementRows::new());
        for force in self.dynamics.forces.iter().flatten().filter_map(|force| force.breakable()) {
            force.visit_broken(&mut |element| {
                rows.insert(element.vertices, [element.time, 0.0]);
            });
        }
        let rows = renumbered(rows, |vertex| Some(parts.number(vertex as usize)));
        Some(section.with(BROKEN, Field::elements(&rows)))
    }

    fn restore_seams(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        let parts = self.scene.parts();
        let local = |number| parts.local(number).map(|vertex| vertex as u32);
        let rows = renumbered(section.elements(BROKEN), local);
        let breakable = self.dynamics.forces.iter_mut().flatten().filter_map(|force| force.breakable_mut());
        breakable.for_each(|force| force.restore_broken(&rows));
        Ok(())
    }
}

//! Change of the integrator between frames, in scenes that leave it to the solver
//! (`docs/theory/tr_bdf2.md#a-change-within-the-shot`).
//!
//! The integrator that is not present is tried for a frame, or for two: where the present one costs more than the other is known to cost,
//! and after some time in any case. It stays if its frame costs less. Costs follow from counts, never from the clock, so that every run
//! changes at the same frames.

use std::sync::Arc;

use super::Simulation;
use super::frame_cost::{COUNTS, Counts, SceneSizes, counts_of};
use super::rebuild_error::RebuildError;
use super::recovery::RetryState;
use crate::contact::self_contact::SelfContact;
use crate::error::StepError;
use crate::scene::{Integrator, Scene};
use crate::snapshot::rows::TargetNumbers;
use crate::snapshot::saved_section::{Field, SavedSection, SectionId};
use crate::snapshot::{SnapshotError, SnapshotSource};

const SECTION: SectionId = SectionId { name: "integrator", version: 2 };

/// Cost of a frame over the cost of one with the other integrator above which a frame is dear.
const DEAR: f64 = 1.25;

/// Frames in a row that have to be dear.
const FRAMES: usize = 2;

/// Frames of a trial at most. The first one behind a change is dearer than later ones, so that one that is not dear is not the last.
const TRIAL: u64 = 2;

/// Names of the costs of the last frames in a snapshot.
const RECENT: [&str; FRAMES] = ["recent_0", "recent_1"];

/// Time with each of [`Integrator::ALL`] after which the other one is tried for the first time [s of film]: a landing or a pinch is over.
const FIRST_WAITS: [f64; 2] = [0.25, 1.0];

/// Costs of frames with both integrators. Which one is present says the scene.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct IntegratorChange {
    sizes: SceneSizes,
    /// Frames with each of [`Integrator::ALL`] after which the other one is tried for the first time.
    first_waits: [u64; 2],
    /// Cost of a frame with each of [`Integrator::ALL`] [CPU s]: as expected, and for the one before the present as it was.
    costs: [f64; 2],
    /// Counts of the frame under way, up to the last pause: sums of costs would depend on where the pauses are.
    under_way: Counts,
    /// Costs of the last frames with the present integrator, the latest first [CPU s].
    recent: [f64; FRAMES],
    /// Frames with the present integrator.
    frames: u64,
    /// Frames with each of [`Integrator::ALL`] after which the other one is tried.
    waits: [u64; 2],
    /// Whether the present integrator is tried.
    is_trial: bool,
}

impl IntegratorChange {
    /// Nothing simulated yet; none where the scene keeps its integrator. All ranks call it together.
    pub(super) fn new(scene: &Scene) -> Option<Self> {
        let costs = scene.integrator_costs?;
        let frame = scene.description().timeline.frame_duration();
        let first_waits = FIRST_WAITS.map(|wait| (wait / frame).round().max(1.0) as u64);
        Some(Self {
            sizes: SceneSizes::of(scene),
            first_waits,
            costs,
            under_way: Counts::default(),
            recent: [0.0; FRAMES],
            frames: 0,
            waits: first_waits,
            is_trial: false,
        })
    }

    /// Ends the frame under way; returns the integrator of the next one if it is another than the present one.
    fn end_frame(&mut self, present: Integrator) -> Option<Integrator> {
        let counts = std::mem::take(&mut self.under_way);
        self.next_after(present, self.sizes.cost(present, &counts))
    }

    /// Returns the integrator of the frame after one of this cost [CPU s], if it is another than the present one.
    fn next_after(&mut self, present: Integrator, cost: f64) -> Option<Integrator> {
        self.recent.rotate_right(1);
        self.recent[0] = cost;
        self.frames = self.frames.saturating_add(1);
        let other = other_than(present);
        let [here, there] = [present as usize, other as usize];
        let is_dear = |cost: f64| cost > DEAR * self.costs[there];
        if self.is_trial {
            let is_in_vain = cost >= self.costs[there];
            if is_in_vain && !is_dear(cost) && self.frames < TRIAL {
                return None;
            }
            self.costs[here] = cost;
            self.waits[there] = if is_in_vain { self.waits[there].saturating_mul(2) } else { self.first_waits[there] };
            (self.is_trial, self.frames) = (false, 0);
            return is_in_vain.then(|| self.leave(other));
        }
        let seen = (self.frames as usize).min(FRAMES);
        let are_dear = seen == FRAMES && self.recent.iter().all(|cost| is_dear(*cost));
        if !are_dear && self.frames < self.waits[here] {
            return None;
        }
        self.costs[here] = self.recent[..seen].iter().sum::<f64>() / seen as f64;
        self.is_trial = true;
        Some(self.leave(other))
    }

    /// Goes on with the other integrator, of which no frame is known yet.
    fn leave(&mut self, other: Integrator) -> Integrator {
        (self.recent, self.frames) = ([0.0; FRAMES], 0);
        other
    }

    /// Stays with the present integrator: effects cannot be built with the other one.
    fn stay_with(&mut self, present: Integrator) {
        self.costs[other_than(present) as usize] = f64::MAX;
        self.waits[present as usize] = u64::MAX;
        self.is_trial = false;
    }

    /// Section with all that a snapshot needs of it.
    fn section(&self, present: Integrator) -> SavedSection {
        let section = SavedSection::new(SECTION)
            .with("is_implicit", Field::single(u64::from(present.spec().is_implicit)))
            .with("short", Field::single(self.costs[0]))
            .with("long", Field::single(self.costs[1]))
            .with("frames", Field::single(self.frames))
            .with("wait_short", Field::single(self.waits[0]))
            .with("wait_long", Field::single(self.waits[1]))
            .with("is_trial", Field::single(u64::from(self.is_trial)));
        let recent = RECENT.into_iter().zip(self.recent);
        let section = recent.fold(section, |section, (name, cost)| section.with(name, Field::single(cost)));
        let counts = COUNTS.into_iter().zip(self.under_way);
        counts.fold(section, |section, (name, count)| section.with(name, Field::single(count)))
    }

    /// Goes on from a section; returns the integrator of its snapshot.
    fn restore(&mut self, section: &SavedSection) -> Integrator {
        self.costs = [section.single("short"), section.single("long")];
        self.under_way = COUNTS.map(|name| section.single(name));
        self.frames = section.single("frames");
        self.waits = [section.single("wait_short"), section.single("wait_long")];
        self.is_trial = section.single::<u64>("is_trial") > 0;
        self.recent = RECENT.map(|name| section.single(name));
        Integrator::ALL[usize::from(section.single::<u64>("is_implicit") > 0)]
    }
}

/// The other one of [`Integrator::ALL`].
fn other_than(integrator: Integrator) -> Integrator {
    Integrator::ALL[1 - integrator as usize]
}

/// Gives the scene of a snapshot the integrator that the snapshot was taken with. All ranks call it together; rank 0 has the source.
///
/// # Errors
/// The snapshot is of a scene that keeps its integrator, or cannot be read.
pub(super) fn take_saved_integrator(
    scene: &mut Arc<Scene>,
    source: Option<&mut (dyn SnapshotSource + '_)>,
) -> Result<(), SnapshotError> {
    let Some(mut change) = IntegratorChange::new(scene) else { return Ok(()) };
    let mut section = change.section(scene.description().solver.integrator);
    section.read(scene.parts(), TargetNumbers { own: &[], all: 0 }, source)?;
    let integrator = change.restore(&section);
    if scene.description().solver.integrator != integrator {
        Arc::make_mut(scene).description.solver.integrator = integrator;
    }
    Ok(())
}

impl Simulation {
    /// Adds what was counted since the last frame or pause. All ranks call it together, before the counts are taken.
    pub(super) fn note_cost(&mut self) {
        let Some(change) = &mut self.integrator_change else { return };
        let counts = counts_of(&self.metrics, self.scene.parts().ranks());
        change.under_way.iter_mut().zip(counts).for_each(|(all, count)| *all = all.saturating_add(count));
    }

    /// Changes the integrator behind a frame if the other one has become cheaper; returns the new one. All ranks call it together.
    ///
    /// # Errors
    /// The solver can be built with neither integrator.
    pub(super) fn reconsider_integrator(&mut self) -> Result<Option<Integrator>, StepError> {
        let present = self.scene.description().solver.integrator;
        let next = self.integrator_change.as_mut().and_then(|change| change.end_frame(present));
        let Some(next) = next else { return Ok(None) };
        let mut scene = Arc::clone(&self.scene);
        Arc::make_mut(&mut scene).description.solver.integrator = next;
        // What was found out about steps of another length does not count.
        self.retry = RetryState::default();
        self.limit.set_last(0.0);
        self.contacts.cloth.iter_mut().for_each(SelfContact::restart_substeps);
        let memory = self.saved_sections();
        // Numbers that have changed since the start may suit one integrator alone.
        match self.rebuild(scene, None, &memory) {
            Ok(()) => Ok(Some(next)),
            Err(RebuildError::Refused(_)) => {
                self.integrator_change.iter_mut().for_each(|change| change.stay_with(present));
                Ok(None)
            }
            Err(RebuildError::Broken(SnapshotError { what, .. })) => Err(StepError::Broken { frame: self.frame, what }),
        }
    }

    pub(super) fn save_integrator(&self) -> Option<SavedSection> {
        Some(self.integrator_change.as_ref()?.section(self.scene.description().solver.integrator))
    }

    pub(super) fn restore_integrator(&mut self, section: &SavedSection) -> Result<(), SnapshotError> {
        // The scene has the integrator already.
        if let Some(change) = &mut self.integrator_change {
            change.restore(section);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: Integrator = Integrator::ALL[0];
    const LONG: Integrator = Integrator::ALL[1];

    /// At 16 frames a second, with short steps that cost three times as much as long ones.
    fn change() -> IntegratorChange {
        let sizes = SceneSizes { vertices: 1.0, triangles: 1.0, surface_triangles: 0.0, shapes: 0.0, surfaces: 0.0 };
        IntegratorChange {
            sizes,
            first_waits: [4, 16],
            costs: [3.0, 1.0],
            under_way: Counts::default(),
            recent: [0.0; FRAMES],
            frames: 0,
            waits: [4, 16],
            is_trial: false,
        }
    }

    /// Integrators of frames with these costs.
    fn course(change: &mut IntegratorChange, mut present: Integrator, costs: &[f64]) -> Vec<Integrator> {
        let frame = |cost: &f64| {
            let here = present;
            present = change.next_after(present, *cost).unwrap_or(present);
            here
        };
        costs.iter().map(frame).collect()
    }

    #[test]
    fn two_dear_frames_in_a_row_try_the_other_integrator_and_one_does_not() {
        let found = course(&mut change(), LONG, &[9.0, 3.7, 9.0, 3.7, 3.8, 3.8, 3.0]);
        assert_eq!(found, [LONG, LONG, LONG, LONG, LONG, LONG, SHORT]);
    }

    #[test]
    fn a_trial_that_costs_less_stays_and_one_that_costs_more_ends_after_its_frame() {
        // Short steps are tried after 16 frames, in vain, and then after 32; they cost less there.
        let costs = [[1.0; 16].as_slice(), &[3.0], &[1.0; 32], &[0.5], &[0.5; 4], &[0.7], &[0.5]].concat();
        let found = course(&mut change(), LONG, &costs);
        let expected = [[LONG; 16].as_slice(), &[SHORT], &[LONG; 32], &[SHORT], &[SHORT; 4], &[LONG], &[SHORT]];
        assert_eq!(found, expected.concat());
    }

    #[test]
    fn a_trial_that_is_hardly_dearer_goes_on_for_a_second_frame_which_decides() {
        // Long steps are tried after four frames. At 1.2 times the cost of short ones they have a second frame, at 1.3 times they have not.
        for (trial, expected) in [([1.2, 0.9], [LONG, LONG]), ([1.2, 1.1], [LONG, SHORT]), ([1.3, 0.9], [SHORT, SHORT])]
        {
            let costs = [[1.0; 4].as_slice(), &trial, &[1.0]].concat();
            let found = course(&mut change(), SHORT, &costs);
            let start = [SHORT, SHORT, SHORT, SHORT, LONG];
            assert_eq!(found, [start.as_slice(), &expected].concat(), "{trial:?}");
        }
    }

    #[test]
    fn cloth_that_only_one_integrator_can_have_stays_with_it() {
        let mut change = change();
        change.stay_with(SHORT);
        assert_eq!(course(&mut change, SHORT, &[1e9; 20]), [SHORT; 20]);
    }
}

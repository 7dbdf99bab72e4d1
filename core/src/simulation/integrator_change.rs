//! Change of the integrator between frames, in scenes that leave it to the solver
//! (`docs/theory/tr_bdf2.md#a-change-within-the-shot`).
//!
//! A shot that starts with long steps goes on with short ones where folded or struck cloth makes long steps the dearer ones, and tries
//! long steps again later. Costs follow from counts, never from the clock, so that every run changes at the same frames.

use std::sync::Arc;

use super::Simulation;
use super::frame_cost::{COUNTS, Counts, SceneSizes, counts_of};
use super::recovery::RetryState;
use crate::contact::self_contact::SelfContact;
use crate::scene::{Integrator, Scene};
use crate::snapshot::rows::TargetNumbers;
use crate::snapshot::saved_section::{Field, SavedSection, SectionId};
use crate::snapshot::{SnapshotError, SnapshotSource};

const SECTION: SectionId = SectionId { name: "integrator", version: 1 };

/// Cost of a frame over the cost of one with the other integrator above which a frame is dear: counts tell costs within a factor of 1.5,
/// and a change has a price of its own.
const DEAR: f64 = 1.5;

/// The same above which one frame after a change is enough to take it back.
const TOO_DEAR: f64 = 2.0;

/// Frames in a row that have to be dear.
const FRAMES: usize = 2;

/// Names of the costs of the last frames in a snapshot.
const RECENT: [&str; FRAMES] = ["recent_0", "recent_1"];

/// Time with short steps after which long ones are tried again for the first time [s of film]: a landing or a pinch is over.
const FIRST_WAIT: f64 = 0.25;

/// Costs of frames with both integrators. Which one is present says the scene.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct IntegratorChange {
    sizes: SceneSizes,
    /// Frames that short steps stay at least.
    first_wait: u64,
    /// Cost of a frame with each of [`Integrator::ALL`] [CPU s]: as expected, and for the one before the present as it was.
    costs: [f64; 2],
    /// Counts of the frame under way, up to the last pause: sums of costs would depend on where the pauses are.
    under_way: Counts,
    /// Costs of the last frames with the present integrator, the latest first [CPU s].
    recent: [f64; FRAMES],
    /// Frames with the present integrator.
    frames: u64,
    /// Frames with short steps after which long ones are tried again.
    wait: u64,
    /// Number of changes so far.
    changes: u64,
}

impl IntegratorChange {
    /// Nothing simulated yet; none where the scene keeps its integrator. All ranks call it together.
    pub(super) fn new(scene: &Scene) -> Option<Self> {
        let costs = scene.integrator_costs?;
        let first_wait = (FIRST_WAIT / scene.description().timeline.frame_duration()).round().max(1.0) as u64;
        Some(Self {
            sizes: SceneSizes::of(scene),
            first_wait,
            costs,
            under_way: Counts::default(),
            recent: [0.0; FRAMES],
            frames: 0,
            wait: first_wait,
            changes: 0,
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
        let known = self.costs[other as usize];
        let seen = (self.frames as usize).min(FRAMES);
        let is_dear = seen == FRAMES && self.recent.iter().all(|cost| *cost > DEAR * known);
        let is_too_dear = seen < FRAMES && self.recent[0] > TOO_DEAR * known && self.changes > 0;
        let is_tried_again = !present.spec().is_implicit && self.frames >= self.wait;
        if !(is_dear || is_too_dear || is_tried_again) {
            return None;
        }
        if present.spec().is_implicit {
            // Tried in vain: the next attempt is later.
            let was_in_vain = self.changes > 0 && self.frames <= self.wait;
            self.wait = if was_in_vain { self.wait.saturating_mul(2) } else { self.first_wait };
        }
        self.costs[present as usize] = self.recent[..seen].iter().sum::<f64>() / seen as f64;
        (self.recent, self.frames) = ([0.0; FRAMES], 0);
        self.changes = self.changes.saturating_add(1);
        Some(other)
    }

    /// Stays with the present integrator: effects cannot be built with the other one.
    fn stay_with(&mut self, present: Integrator) {
        self.costs[other_than(present) as usize] = f64::MAX;
        self.wait = u64::MAX;
    }

    /// Section with all that a snapshot needs of it.
    fn section(&self, present: Integrator) -> SavedSection {
        let section = SavedSection::new(SECTION)
            .with("is_implicit", Field::single(u64::from(present.spec().is_implicit)))
            .with("short", Field::single(self.costs[0]))
            .with("long", Field::single(self.costs[1]))
            .with("frames", Field::single(self.frames))
            .with("wait", Field::single(self.wait))
            .with("changes", Field::single(self.changes));
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
        (self.wait, self.changes) = (section.single("wait"), section.single("changes"));
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
    pub(super) fn reconsider_integrator(&mut self) -> Option<Integrator> {
        let present = self.scene.description().solver.integrator;
        let next = self.integrator_change.as_mut()?.end_frame(present)?;
        let mut scene = Arc::clone(&self.scene);
        Arc::make_mut(&mut scene).description.solver.integrator = next;
        // What was found out about steps of another length does not count.
        self.retry = RetryState::default();
        self.limit.set_last(0.0);
        self.contacts.cloth.iter_mut().for_each(SelfContact::restart_substeps);
        let memory = self.saved_sections();
        // Numbers that have changed since the start may suit one integrator alone.
        if self.rebuild(scene, None, &memory).is_err() {
            self.integrator_change.iter_mut().for_each(|change| change.stay_with(present));
            return None;
        }
        Some(next)
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
            first_wait: 4,
            costs: [3.0, 1.0],
            under_way: Counts::default(),
            recent: [0.0; FRAMES],
            frames: 0,
            wait: 4,
            changes: 0,
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
    fn two_dear_frames_in_a_row_change_the_integrator_and_one_does_not() {
        let found = course(&mut change(), LONG, &[9.0, 4.0, 9.0, 4.6, 4.6, 3.0]);
        assert_eq!(found, [LONG, LONG, LONG, LONG, SHORT, SHORT]);
    }

    #[test]
    fn long_steps_are_tried_again_after_some_frames_and_later_each_time_it_is_in_vain() {
        let mut change = change();
        // One frame at more than twice the cost, or two dear ones, end an attempt.
        let costs = [[8.0; 2].as_slice(), &[3.0; 4], &[8.0], &[3.0; 8], &[5.0; 2], &[3.0; 16], &[1.0; 9]].concat();
        let found = course(&mut change, LONG, &costs);
        let expected = [[LONG; 2].as_slice(), &[SHORT; 4], &[LONG], &[SHORT; 8], &[LONG; 2], &[SHORT; 16], &[LONG; 9]];
        assert_eq!(found, expected.concat());
    }

    #[test]
    fn cloth_that_only_one_integrator_can_have_stays_with_it() {
        let mut change = change();
        change.stay_with(SHORT);
        assert_eq!(course(&mut change, SHORT, &[1e9; 20]), [SHORT; 20]);
    }
}

//! Untangling at a held time: garments that are worn in an order and cross each other at the start of a frame are drawn apart before time
//! goes on.
//!
//! On its way out a line of intersection wanders over the cloth, and has more crossings at one time and fewer at another. So the cloth moves
//! while bodies, pins and seams stay where the frame finds them, with its velocities damped, until no such crossing is left, or for some
//! frames' length. The last state with no more of them than before is taken. No frame has more of them than the one before. Nothing yields
//! and no seam breaks meanwhile: the cloth has come there at no time of the shot.

use super::{FrameSummary, Simulation};
use crate::contact::self_contact::SelfContact;

/// Longest time that the cloth gets in one frame, in lengths of a frame.
const MOST_FRAMES: f64 = 6.0;

/// Rate at which velocities are damped [1/s]: cloth that is drawn stays behind by a tenth of a frame or so, and does not swing.
const DAMPING: f64 = 60.0;

impl Simulation {
    /// Draws apart what the wearing order decides, at the start `from` [s] of a frame.
    pub(super) fn untangle(&mut self, from: f64, summary: &mut FrameSummary) {
        let tangled = |simulation: &Self| simulation.contacts.cloth.as_ref().map_or(0, SelfContact::tangled);
        let most = tangled(self);
        if most == 0 || self.cloth.state.time != from {
            return;
        }
        let start = self.cloth.state.clone();
        let mut best = start.x.clone();
        self.let_wander(true);
        self.prescribed.bodies.stand_still(Some(from));
        self.cloth.state.time = from - MOST_FRAMES * self.scene.description().timeline.frame_duration();
        self.hold_still();
        let mut steps = 0;
        let mut left = most;
        while left > 0 && self.cloth.state.time < from {
            let before = self.cloth.state.time;
            // A step that fails for good ends the attempt; the frame goes on from the state taken.
            if self.collision_step(from, summary).is_err() {
                break;
            }
            steps += 1;
            let damping = 1.0 / (1.0 + DAMPING * (self.cloth.state.time - before).max(0.0));
            self.cloth.state.v.iter_mut().for_each(|v| *v *= damping);
            left = tangled(self);
            if left <= most {
                best.clone_from(&self.cloth.state.x);
            }
        }
        self.metrics.count_once(self.scene.parts().ranks(), "untangling_steps", steps);
        self.cloth.state = start;
        self.cloth.state.x = best;
        self.cloth.state.time = from;
        self.let_wander(false);
        self.end_recovery();
        self.prescribed.bodies.stand_still(None);
        self.hold_still();
        self.crossings = self.find_crossings();
    }

    fn let_wander(&mut self, lets_wander: bool) {
        self.contacts.cloth.iter_mut().for_each(|contact| contact.let_wander(lets_wander));
    }
}

//! Number K of time steps between two collision-free states, and their length: both found by trying.
//!
//! K starts at 1, and the share of the allowed dt that a step takes at 1. After three collision steps without a hard case the
//! share is doubled if it is below 1, otherwise K, up to `max_steps`; K is also no more than what keeps every vertex from
//! moving half an edge, foreseen from the last collision step. Where impulses leave many pairs to impact zones and K is
//! above 1, C gives the state back (a rewind), and K is halved; at K = 1 the share is halved, down to an eighth: contact
//! then changes faster than the steps resolve.

/// Collision steps without a rewind after which K is doubled.
const GROWTH_PERIOD: u32 = 3;

/// Shortest share of a time step to which hard contact shortens it.
const SHORTEST_STEP: f64 = 0.125;

/// Number and length of the time steps per collision step, found by trying.
#[derive(Debug)]
pub(super) struct Substeps {
    pub(super) steps: u32,
    max_steps: u32,
    /// Share of the step that the cloth would allow.
    pub(super) share: f64,
    pub(super) successes: u32,
}

impl Substeps {
    pub(super) fn new(max_steps: u32) -> Self {
        Self { steps: 1, max_steps, share: 1.0, successes: 0 }
    }

    /// Starts again, with steps of another length.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.max_steps);
    }

    /// Goes on from what was remembered, within what is possible.
    pub(super) fn restore(&mut self, steps: u32, share: f64, successes: u32) {
        self.steps = steps.clamp(1, self.max_steps);
        self.share = share.clamp(SHORTEST_STEP, 1.0);
        self.successes = successes;
    }

    pub(super) fn succeeded(&mut self) {
        // Only whether it is a multiple matters, and a state from elsewhere may begin anywhere.
        self.successes = self.successes.wrapping_add(1);
        if self.successes.is_multiple_of(GROWTH_PERIOD) {
            if self.share < 1.0 {
                self.share = (2.0 * self.share).min(1.0);
            } else {
                self.steps = (2 * self.steps).min(self.max_steps);
            }
        }
    }

    /// Halves K, or the share at K = 1: contact changes faster than the steps resolve where zones are needed even
    /// after single steps.
    pub(super) fn failed(&mut self) {
        self.successes = 0;
        if self.steps > 1 {
            self.steps /= 2;
        } else {
            self.share = (0.5 * self.share).max(SHORTEST_STEP);
        }
    }
}

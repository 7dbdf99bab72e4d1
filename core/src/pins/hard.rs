//! Hard pins: they replace the motion of their vertices.

use crate::Vec3;
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::parallel::parts::Parts;
use crate::pins::targets::PinTargets;
use crate::scene::{PinHold, Pinned, Scene};

/// Count of held vertices that do not reach their targets in a step.
pub(crate) const BEHIND: &str = "pins_behind";

/// Count of edges that are torn apart between two held vertices at the end of a frame.
pub(crate) const STRETCHED: &str = "pins_stretched";

#[derive(Debug, Clone, Copy)]
struct HardPin {
    vertex: usize,
    target: usize,
    axes: [bool; 3],
}

/// Vertices whose position and velocity are prescribed, sorted by solver index.
#[derive(Debug)]
pub struct HardPins {
    entries: Vec<HardPin>,
    /// First entry of each part; one more at the end.
    rows: Vec<usize>,
}

impl HardPins {
    pub(crate) fn new(scene: &Scene) -> Self {
        let parts: &Parts = scene.parts();
        let pins = &scene.description().pins;
        let hard = scene.pinned().iter().enumerate().filter(|(_, pinned)| pins[pinned.pin].hold == PinHold::Hard);
        let entry = |(target, pinned): (usize, &Pinned)| HardPin {
            vertex: pinned.vertex as usize,
            target,
            axes: pins[pinned.pin].axes,
        };
        let mut entries: Vec<HardPin> = hard.map(entry).collect();
        entries.sort_unstable_by_key(|e| (e.vertex, e.target));
        let mut rows: Vec<usize> =
            parts.ranges().iter().map(|r| entries.partition_point(|e| e.vertex < r.start)).collect();
        rows.push(entries.len());
        Self { entries, rows }
    }

    /// Calls `set(vertex in the part, axis, target)` for every held component of a part.
    fn held(&self, part: usize, start: usize, targets: &PinTargets, mut set: impl FnMut(usize, usize, usize)) {
        for pin in &self.entries[self.rows[part]..self.rows[part + 1]] {
            if targets.is_active(pin.target) {
                (0..3).filter(|axis| pin.axes[*axis]).for_each(|axis| set(pin.vertex - start, axis, pin.target));
            }
        }
    }

    /// Puts the part's held components where their targets are at the end of the step.
    pub(crate) fn start_at(&self, part: usize, start: usize, targets: &PinTargets, x: &mut [Vec3]) {
        self.held(part, start, targets, |vertex, axis, target| x[vertex][axis] = targets.at_t1[target][axis]);
    }

    /// Puts the part's held components where they have to be at the end of the step: at their targets, or, where their
    /// vertices were too far behind in `x` [m], as much closer as `recovery_speed` allows.
    pub(crate) fn set_positions(
        &self,
        part: usize,
        start: usize,
        targets: &PinTargets,
        recovery_speed: RecoverySpeed,
        (x, x_new): (&[Vec3], &mut [Vec3]),
    ) {
        self.held(part, start, targets, |vertex, axis, target| {
            let rest = targets.rest_of_lag(target, recovery_speed, x[vertex], axis);
            x_new[vertex][axis] = targets.at_t1[target][axis] - rest;
        });
    }

    /// Puts the part's held components where they have to be at a fraction of the step from `x` [m]: on the straight way to where
    /// [`HardPins::set_positions`] puts them.
    pub(crate) fn set_stage_positions(
        &self,
        part: usize,
        start: usize,
        targets: &PinTargets,
        recovery_speed: RecoverySpeed,
        fraction: f64,
        (x, x_stage): (&[Vec3], &mut [Vec3]),
    ) {
        self.held(part, start, targets, |vertex, axis, target| {
            let rest = targets.rest_of_lag(target, recovery_speed, x[vertex], axis);
            let way = targets.at_t1[target][axis] - rest - x[vertex][axis];
            x_stage[vertex][axis] = x[vertex][axis] + fraction * way;
        });
    }

    /// Returns the number of own vertices that stay behind their targets in the step from `x` [m].
    pub(crate) fn behind(&self, targets: &PinTargets, recovery_speed: RecoverySpeed, x: &[Vec3]) -> u64 {
        let is_late = |pin: &&HardPin| {
            let late = |axis: usize| {
                pin.axes[axis] && targets.rest_of_lag(pin.target, recovery_speed, x[pin.vertex], axis) != 0.0
            };
            targets.is_active(pin.target) && (0..3).any(late)
        };
        self.entries.iter().filter(is_late).count() as u64
    }

    /// Gives the part's held components their prescribed velocity.
    pub(crate) fn set_velocities(&self, part: usize, start: usize, targets: &PinTargets, v: &mut [Vec3]) {
        self.held(part, start, targets, |vertex, axis, target| v[vertex][axis] = targets.velocity(target)[axis]);
    }

    /// Removes the part's held components from a residual or search direction.
    pub(crate) fn project(&self, part: usize, start: usize, targets: &PinTargets, r: &mut [Vec3]) {
        self.held(part, start, targets, |vertex, axis, _| r[vertex][axis] = 0.0);
    }

    /// Own vertices that pins hold at some time, by their local numbers, ascending; one that several hold as often.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.entries.iter().map(|pin| pin.vertex)
    }

    /// Number of pinned own vertices, each as often as pins hold it.
    pub(crate) fn count(&self) -> usize {
        self.entries.len()
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.entries.as_slice()) + size_of_val(self.rows.as_slice())
    }

    /// Every held vertex with its target and the axes in which it is held, in solver order.
    pub(crate) fn axes(&self) -> impl Iterator<Item = (usize, usize, [bool; 3])> + '_ {
        self.entries.iter().map(|e| (e.vertex, e.target, e.axes))
    }

    /// Vertices that are held in all directions by one pin at some time, in solver order.
    pub(crate) fn fully_held(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.entries.iter().filter(|e| e.axes == [true; 3]).map(|e| (e.vertex, e.target))
    }
}

//! Speed at which a vertex that is behind its pin or too deep in a body comes to where it has to be.
//!
//! One that made up for all of it in one step would strike the cloth that it meets with the speed distance/dt, which has nothing
//! to do with the motion and is the larger the shorter the step is: cloth struck so changes its length too fast, the step is
//! halved, and the blow is twice as hard.

/// Limit on the correction of vertices in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecoverySpeed {
    /// Correction that is allowed in any case [m].
    least: f64,
    /// Share of the distance that is allowed as correction, if that is more.
    share: f64,
}

impl RecoverySpeed {
    /// In a step of `dt` [s]: `speed` [m/s] in any case, and fast enough to be there within a `frame` [s].
    pub fn new(dt: f64, speed: f64, frame: f64) -> Self {
        Self { least: dt * speed, share: dt / frame }
    }

    /// Returns the part of a distance that is made up for [m].
    pub fn of(self, distance: f64) -> f64 {
        distance.min(self.least.max(self.share * distance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_is_put_right_at_once_and_what_is_far_as_fast_at_any_length_of_the_step() {
        let frame = 1.0 / 24.0;
        let all = [1e-3, 1e-4].map(|dt| RecoverySpeed::new(dt, 5.0, frame));
        assert_eq!((all[0].of(5e-3), all[0].of(-1.0)), (5e-3, -1.0));
        assert_eq!(all[0].of(0.1), 5e-3);
        for distance in [0.01, 0.1, 10.0] {
            assert!((all[0].of(distance) - 10.0 * all[1].of(distance)).abs() < 1e-12, "{distance} m");
        }
        assert_eq!(
            RecoverySpeed::new(frame, 5.0, frame).of(10.0),
            10.0,
            "a step that is a frame puts everything right"
        );
    }
}

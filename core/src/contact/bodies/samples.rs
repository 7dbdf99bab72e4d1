//! Positions of a mesh at the times that the caller gives, and between two of them.

use crate::Vec3;

/// Positions of the points of a mesh at one time.
///
/// ```
/// use drapery_core::{FrameInput, Sample, Vec3};
/// let points = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].map(Vec3::from);
/// let at = |time: f64| Sample { time, positions: points.map(|p| p + Vec3::x() * time).to_vec() };
/// let input = FrameInput { bodies: vec![vec![at(1.0 / 48.0), at(1.0 / 24.0)]], ..FrameInput::to_frame(1) };
/// assert_eq!(input.bodies[0].last().map(|sample| sample.time), Some(1.0 / 24.0));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Solver time [s].
    pub time: f64,
    /// Positions [m], in the mesh's own order.
    pub positions: Vec<Vec3>,
}

/// Two samples between which positions move straight.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    /// The earlier one.
    pub a: Sample,
    /// The later one; the same at the very start.
    pub b: Sample,
}

impl Samples {
    /// Standing still at one sample.
    pub(crate) fn still(sample: Sample) -> Self {
        Self { a: sample.clone(), b: sample }
    }

    /// Goes on to the next sample.
    pub fn push(&mut self, next: Sample) {
        self.a = std::mem::replace(&mut self.b, next);
    }

    /// Position of a row at a time between the samples [m].
    pub fn position(&self, row: usize, time: f64) -> Vec3 {
        let span = self.b.time - self.a.time;
        let share = if span > 0.0 { ((time - self.a.time) / span).clamp(0.0, 1.0) } else { 1.0 };
        self.a.positions[row].lerp(&self.b.positions[row], share)
    }
}

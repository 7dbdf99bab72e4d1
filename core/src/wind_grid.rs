//! Wind that a file gives: velocities on a regular grid, trilinear in space and linear in time. The caller pushes the
//! samples frame by frame; beyond the grid and its samples the nearest value holds.

use crate::Vec3;
use crate::error::Problem;
use crate::scene::WindGridShape;

/// Velocities of the air on all nodes of a grid at one time.
///
/// ```
/// use drapery_core::{FrameInput, Vec3, WindSample};
/// let gust = WindSample { time: 1.0 / 24.0, velocities: vec![Vec3::new(3.0, 0.0, 0.0); 8] };
/// let input = FrameInput { wind: vec![gust], ..FrameInput::to_frame(1) };
/// assert_eq!(input.wind[0].velocities.len(), 2 * 2 * 2);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WindSample {
    /// Solver time [s].
    pub time: f64,
    /// Velocities [m/s], x fastest, then y, then z.
    pub velocities: Vec<Vec3>,
}

/// The grid between two samples; without a grid the air of it is still.
#[derive(Debug, Clone, Default)]
pub struct WindGrid {
    shape: Option<WindGridShape>,
    /// The earlier and the later sample; the same at the very start.
    samples: [WindSample; 2],
}

impl WindGrid {
    /// The grid at its first sample, the last of `start`.
    ///
    /// # Errors
    /// There is no sample, or one that does not fit the grid.
    pub(crate) fn new(shape: Option<WindGridShape>, start: &[WindSample]) -> Result<Self, Problem> {
        let Some(shape) = shape else { return Ok(Self::default()) };
        let problem = |what: String| {
            Problem::data("wind", what, "give velocities for every node of the grid, from the first frame on")
        };
        let first = start.last().ok_or_else(|| problem("there is no sample of its grid at the start".into()))?;
        let samples = [first.clone(), first.clone()];
        let grid = Self { shape: Some(shape), samples };
        grid.fits(first).map(|()| grid).map_err(problem)
    }

    /// Whether a sample has one finite velocity for each node.
    fn fits(&self, sample: &WindSample) -> Result<(), String> {
        let nodes = self.shape.map_or(0, |shape| shape.counts.iter().product());
        if sample.velocities.len() != nodes {
            let count = sample.velocities.len();
            return Err(format!(
                "the sample at {} s has {count} velocities for {nodes} nodes of the grid",
                sample.time
            ));
        }
        match sample.velocities.iter().position(|v| !v.iter().all(|c| c.is_finite())) {
            Some(node) => Err(format!("the sample at {} s is not finite at node {node} of the grid", sample.time)),
            None => Ok(()),
        }
    }

    /// Whether there is a grid.
    pub fn exists(&self) -> bool {
        self.shape.is_some()
    }

    /// Solver time of the later sample [s].
    pub(crate) fn sampled_until(&self) -> f64 {
        self.samples[1].time
    }

    /// Goes on to the next sample.
    ///
    /// # Errors
    /// It does not fit the grid.
    pub fn push(&mut self, next: WindSample) -> Result<(), String> {
        self.fits(&next)?;
        self.samples.swap(0, 1);
        self.samples[1] = next;
        Ok(())
    }

    /// Velocity of the air of the grid at a place [m] and time [s]; zero without a grid.
    pub fn velocity(&self, place: &Vec3, time: f64) -> Vec3 {
        let Some(shape) = &self.shape else { return Vec3::zeros() };
        let [a, b] = &self.samples;
        let span = b.time - a.time;
        let share = if span > 0.0 { ((time - a.time) / span).clamp(0.0, 1.0) } else { 1.0 };
        // For each axis the lower and the upper node, as strides into the list, and the share of the upper one.
        let mut stride = 1;
        let axes: [(usize, usize, f64); 3] = std::array::from_fn(|axis| {
            let last = shape.counts[axis] - 1;
            let at = ((place[axis] - shape.origin[axis]) / shape.spacing[axis]).clamp(0.0, last as f64);
            let low = (at as usize).min(last.saturating_sub(1));
            let found = (low * stride, (low + 1).min(last) * stride, at - low as f64);
            stride *= shape.counts[axis];
            found
        });
        let node = |n: usize| a.velocities[n].lerp(&b.velocities[n], share);
        let [(x0, x1, u), (y0, y1, v), (z0, z1, w)] = axes;
        let row = |yz: usize| node(x0 + yz).lerp(&node(x1 + yz), u);
        let face = |z: usize| row(y0 + z).lerp(&row(y1 + z), v);
        face(z0).lerp(&face(z1), w)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wind_that_is_linear_in_place_and_time_is_exact_and_held_beyond_the_grid() {
        let shape =
            WindGridShape { origin: Vec3::new(-1.0, 0.5, 2.0), spacing: Vec3::new(0.5, 0.25, 2.0), counts: [4, 3, 2] };
        let field = |p: Vec3, t: f64| Vec3::new(p.x - 2.0 * p.y + t, 3.0 * p.z, 1.0 - p.x * (1.0 + t));
        let place = |k: usize| {
            let node = Vec3::new((k % 4) as f64, (k / 4 % 3) as f64, (k / 12) as f64);
            shape.origin + node.component_mul(&shape.spacing)
        };
        let sample = |time| WindSample { time, velocities: (0..24).map(|k| field(place(k), time)).collect() };
        let mut grid = WindGrid::new(Some(shape), &[sample(1.0)]).expect("a fitting sample");
        grid.push(sample(3.0)).expect("a fitting sample");
        for (p, t) in [([-0.9, 0.6, 3.1], 1.2), ([0.5, 1.0, 4.0], 3.0), ([-1.0, 0.5, 2.0], 1.0), ([0.1, 0.9, 2.5], 2.0)]
        {
            let place = Vec3::from(p);
            assert!((grid.velocity(&place, t) - field(place, t)).norm() < 1e-14, "{p:?} at {t} s");
        }
        let corner = Vec3::new(0.5, 1.0, 4.0);
        assert!((grid.velocity(&Vec3::repeat(9.0), 9.0) - field(corner, 3.0)).norm() < 1e-14);
        assert!(grid.push(WindSample { time: 4.0, velocities: vec![Vec3::zeros(); 23] }).is_err());
        let mut broken = sample(4.0);
        broken.velocities[7].y = f64::NAN;
        assert!(grid.push(broken).unwrap_err().contains("node 7"));
        assert_eq!(WindGrid::default().velocity(&corner, 0.0), Vec3::zeros());
    }

    #[test]
    fn a_grid_of_one_layer_does_not_vary_across_it() {
        let shape = WindGridShape { origin: Vec3::zeros(), spacing: Vec3::repeat(1.0), counts: [2, 1, 1] };
        let sample = WindSample { time: 0.0, velocities: vec![Vec3::zeros(), Vec3::x()] };
        let grid = WindGrid::new(Some(shape), &[sample]).expect("a fitting sample");
        assert_eq!(grid.velocity(&Vec3::new(0.25, 7.0, -3.0), 5.0), Vec3::x() * 0.25);
    }
}

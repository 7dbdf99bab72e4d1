//! Random directions and numbers, seeded by the scene.

use std::f64::consts::TAU;

use drapery_core::Vec3;
use drapery_core::geometry::random::SplitMix64;

/// A stream of random numbers.
pub(super) struct Random(SplitMix64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(SplitMix64::new(seed))
    }

    /// The next direction, uniform on the unit sphere.
    pub(super) fn direction(&mut self) -> Vec3 {
        // A height and a longitude that are uniform give a direction that is uniform on the sphere.
        let (height, longitude) = (2.0 * self.unit() - 1.0, TAU * self.unit());
        let ring = (1.0 - height * height).max(0.0).sqrt();
        let (sin, cos) = libm::sincos(longitude);
        Vec3::new(ring * cos, height, ring * sin)
    }

    /// The next number, uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        self.0.unit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_uniform_on_the_sphere() {
        let mut random = Random::new(1823);
        let directions: Vec<Vec3> = (0..100_000).map(|_| random.direction()).collect();
        assert!(directions.iter().all(|d| (d.norm() - 1.0).abs() < 1e-15));
        // A coordinate is uniform in [-1, 1]; three standard deviations of means of 1e5: of it (√(1/3)), and of its
        // square (√(4/45)).
        for axis in 0..3 {
            let mean = directions.iter().map(|d| d[axis]).sum::<f64>() / 1e5;
            let square = directions.iter().map(|d| d[axis] * d[axis]).sum::<f64>() / 1e5;
            assert!(mean.abs() < 0.0055 && (square - 1.0 / 3.0).abs() < 0.0029, "{axis}: {mean} {square}");
        }
    }
}

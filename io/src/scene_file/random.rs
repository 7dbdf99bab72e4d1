//! Random numbers that are the same everywhere: SplitMix64 (Steele, Lea, Flood 2014, "Fast splittable pseudorandom
//! number generators"), seeded by the scene.

use std::f64::consts::TAU;

use drapery_core::Vec3;

/// A stream of random numbers.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next direction, uniform on the unit sphere.
    pub(super) fn direction(&mut self) -> Vec3 {
        // A height and a longitude that are uniform give a direction that is uniform on the sphere.
        let (height, longitude) = (2.0 * self.unit() - 1.0, TAU * self.unit());
        let ring = (1.0 - height * height).max(0.0).sqrt();
        Vec3::new(ring * longitude.cos(), height, ring * longitude.sin())
    }

    /// The next number, uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        // The upper 53 bits fill the mantissa of an f64.
        (z >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_is_that_of_the_published_generator() {
        // First output of SplitMix64 for seed 1234567 is 6457827717110365317.
        let expected = (6_457_827_717_110_365_317_u64 >> 11) as f64 / (1_u64 << 53) as f64;
        assert_eq!(Random::new(1_234_567).unit(), expected);
    }

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

    #[test]
    fn numbers_are_uniform() {
        let mut random = Random::new(1823);
        let numbers: Vec<f64> = (0..100_000).map(|_| random.unit()).collect();
        let mean = numbers.iter().sum::<f64>() / 1e5;
        // Three standard deviations of the mean of 1e5 uniform numbers: 3 · √(1/12) / √1e5.
        assert!((mean - 0.5).abs() < 0.0028, "{mean}");
        assert!(numbers.iter().all(|n| (0.0..1.0).contains(n)));
    }
}

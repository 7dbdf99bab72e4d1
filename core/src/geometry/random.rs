//! Numbers that look random and are the same everywhere.

use crate::Vec3;

/// A stream of numbers that follows from its seed: SplitMix64 (G. Steele, D. Lea, C. Flood, "Fast splittable pseudorandom
/// number generators", OOPSLA 2014).
#[derive(Debug, Clone)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// The stream of a seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        Self::mixed(self.0)
    }

    /// The finaliser of the stream: 64 bits of which each depends on all of `z`.
    pub(crate) const fn mixed(mut z: u64) -> u64 {
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// The next number, uniform in [0, 1): the upper 53 bits fill the mantissa.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// The next number, uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// The next point, uniform in the cube [-1, 1)³.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_is_that_of_the_published_generator() {
        // First output of SplitMix64 for seed 1234567.
        assert_eq!(SplitMix64::new(1_234_567).bits(), 6_457_827_717_110_365_317);
    }

    #[test]
    fn numbers_are_uniform() {
        let mut random = SplitMix64::new(1823);
        let numbers: Vec<f64> = (0..100_000).map(|_| random.unit()).collect();
        let mean = numbers.iter().sum::<f64>() / 1e5;
        // Three standard deviations of the mean of 1e5 uniform numbers: 3 · √(1/12) / √1e5.
        assert!((mean - 0.5).abs() < 0.0028, "{mean}");
        assert!(numbers.iter().all(|n| (0.0..1.0).contains(n)));
        assert!((0..1000).all(|_| (-1.0..1.0).contains(&random.signed())));
    }
}

//! Random numbers that are the same everywhere: SplitMix64 (Steele, Lea, Flood 2014, "Fast splittable pseudorandom
//! number generators"), seeded by the scene.

/// A stream of random numbers.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
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
    fn numbers_are_uniform() {
        let mut random = Random::new(1823);
        let numbers: Vec<f64> = (0..100_000).map(|_| random.unit()).collect();
        let mean = numbers.iter().sum::<f64>() / 1e5;
        // Three standard deviations of the mean of 1e5 uniform numbers: 3 · √(1/12) / √1e5.
        assert!((mean - 0.5).abs() < 0.0028, "{mean}");
        assert!(numbers.iter().all(|n| (0.0..1.0).contains(n)));
    }
}

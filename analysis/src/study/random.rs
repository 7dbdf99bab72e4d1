//! Numbers that look random and are the same everywhere.

use drapery_core::Vec3;
use drapery_core::geometry::random::SplitMix64;

/// A sequence of numbers that follows from its seed.
#[derive(Debug, Clone)]
pub(super) struct Random(SplitMix64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(SplitMix64::new(seed))
    }

    /// Between -1 and 1.
    pub(super) fn number(&mut self) -> f64 {
        self.0.bits() as f64 / (u64::MAX as f64 / 2.0) - 1.0
    }

    /// Each coordinate between -1 and 1.
    pub(super) fn vector(&mut self) -> Vec3 {
        Vec3::new(self.number(), self.number(), self.number())
    }

    /// The numbers below `count`, in some order (Fisher and Yates).
    pub(super) fn order(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for last in (1..count).rev() {
            order.swap(last, (self.0.bits() % (last as u64 + 1)) as usize);
        }
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_spread_over_both_signs_and_the_same_every_time() {
        let mut random = Random::new(3);
        let numbers: Vec<f64> = (0..1000).map(|_| random.number()).collect();
        assert!(numbers.iter().all(|number| number.abs() <= 1.0));
        let mean = numbers.iter().sum::<f64>() / 1000.0;
        // The mean of 1000 numbers that are spread evenly over [-1, 1] has a standard deviation of 0.018.
        assert!(mean.abs() < 0.06, "{mean}");
        assert_eq!(Random::new(3).number(), numbers[0]);
        assert!(Random::new(4).number() != numbers[0]);
    }

    #[test]
    fn an_order_holds_every_number_once() {
        let order = Random::new(1).order(20);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..20) && order != sorted, "{order:?}");
    }
}

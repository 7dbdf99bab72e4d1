//! Numbers that look random and are the same everywhere.

use drapery_core::Vec3;

/// A sequence of numbers that follows from its seed (SplitMix64, Steele and others 2014).
#[derive(Debug, Clone)]
pub(super) struct Random(pub(super) u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    }

    /// Between -1 and 1.
    pub(super) fn number(&mut self) -> f64 {
        self.bits() as f64 / (u64::MAX as f64 / 2.0) - 1.0
    }

    /// Each coordinate between -1 and 1.
    pub(super) fn vector(&mut self) -> Vec3 {
        Vec3::new(self.number(), self.number(), self.number())
    }

    /// The numbers below `count`, in some order (Fisher and Yates).
    pub(super) fn order(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for last in (1..count).rev() {
            order.swap(last, (self.bits() % (last as u64 + 1)) as usize);
        }
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_spread_over_both_signs_and_the_same_every_time() {
        let mut random = Random(3);
        let numbers: Vec<f64> = (0..1000).map(|_| random.number()).collect();
        assert!(numbers.iter().all(|number| number.abs() <= 1.0));
        let mean = numbers.iter().sum::<f64>() / 1000.0;
        // The mean of 1000 numbers that are spread evenly over [-1, 1] has a standard deviation of 0.018.
        assert!(mean.abs() < 0.06, "{mean}");
        assert_eq!(Random(3).number(), numbers[0]);
        assert!(Random(4).number() != numbers[0]);
    }

    #[test]
    fn an_order_holds_every_number_once() {
        let order = Random(1).order(20);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..20) && order != sorted, "{order:?}");
    }
}

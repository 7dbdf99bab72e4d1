//! Axes of charts: which values stand at their ends, and which have labels.

/// Room beyond the values at the ends of a logarithmic axis, as a factor.
const ROOM: f64 = 1.25;

/// Values over whose ratio an axis becomes logarithmic, where that is allowed.
const LOGARITHMIC: f64 = 30.0;

/// An axis of values.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    low: f64,
    high: f64,
    logarithmic: bool,
    /// Values with labels.
    pub(crate) ticks: Vec<f64>,
}

impl Axis {
    /// From one value to another, with labels at these.
    pub(crate) fn between([low, high]: [f64; 2], ticks: Vec<f64>) -> Self {
        Self { low, high, logarithmic: false, ticks }
    }

    /// From zero, or below, to the largest value; about `wanted` labels.
    pub(crate) fn linear(values: impl Iterator<Item = f64>, wanted: usize) -> Self {
        Self::in_steps_of(0.0, values, wanted)
    }

    /// The same for whole numbers: no label stands between two of them.
    pub(crate) fn counts(values: impl Iterator<Item = f64>, wanted: usize) -> Self {
        Self::in_steps_of(1.0, values, wanted)
    }

    fn in_steps_of(least: f64, values: impl Iterator<Item = f64>, wanted: usize) -> Self {
        let (mut low, mut high) = (0.0_f64, 0.0_f64);
        for value in values.filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low == high {
            high = low + 1.0;
        }
        let step = nice_step((high - low) / wanted.max(1) as f64).max(least);
        let (first, last) = ((low / step).floor() as i64, (high / step).ceil() as i64);
        let ticks: Vec<f64> = (first..=last).map(|i| i as f64 * step).collect();
        Self { low: first as f64 * step, high: last as f64 * step, logarithmic: false, ticks }
    }

    /// Logarithmic if the positive values span more than a factor of thirty.
    pub(crate) fn logarithmic_if_wide(values: impl Iterator<Item = f64> + Clone, wanted: usize) -> Self {
        let positive = values.clone().filter(|value| *value > 0.0 && value.is_finite());
        let low = positive.clone().min_by(f64::total_cmp);
        let high = positive.max_by(f64::total_cmp);
        match low.zip(high) {
            Some((low, high)) if high / low > LOGARITHMIC => Self::powers_of_ten(low, high, wanted),
            _ => Self::linear(values, wanted),
        }
    }

    /// Logarithmic between whole powers of ten.
    fn powers_of_ten(low: f64, high: f64, wanted: usize) -> Self {
        let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
        let every = ((last - first) as usize).div_ceil(wanted.max(1)).max(1);
        let ticks = (first..=last).step_by(every).map(|power| 10.0_f64.powi(power)).collect();
        Self { low: 10.0_f64.powi(first), high: 10.0_f64.powi(last), logarithmic: true, ticks }
    }

    /// Logarithmic around the positive values, with a little room at both ends; labels at 1, 2 and 5 times powers of ten where
    /// these are few.
    pub(crate) fn logarithmic(values: impl Iterator<Item = f64>, wanted: usize) -> Self {
        let positive: Vec<f64> = values.filter(|value| *value > 0.0 && value.is_finite()).collect();
        let low = positive.iter().copied().fold(f64::INFINITY, f64::min);
        let high = positive.iter().copied().fold(0.0, f64::max);
        if positive.is_empty() {
            return Self::powers_of_ten(0.1, 10.0, wanted);
        }
        let (low, high) = (low / ROOM, high * ROOM);
        let axis = Self::powers_of_ten(low, high, wanted);
        let inside = |tick: &f64| *tick >= low && *tick <= high;
        let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
        let at = |digits: &[f64]| -> Vec<f64> {
            let of = |power: i32| digits.iter().map(move |digit| digit * 10.0_f64.powi(power)).collect::<Vec<_>>();
            powers.clone().flat_map(of).filter(inside).collect()
        };
        let fine = at(&[1.0, 2.0, 5.0]);
        // Values that are close together still have two labels, where that is possible.
        let fine = if fine.len() < 3 { at(&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]) } else { fine };
        let coarse: Vec<f64> = axis.ticks.iter().copied().filter(inside).collect();
        let ticks = if fine.len() <= wanted.max(3) || coarse.len() < 2 { fine } else { coarse };
        Self { low, high, logarithmic: true, ticks }
    }

    /// Place of a value, 0 at the lower and 1 at the upper end; outside values lie on the ends.
    pub(crate) fn share(&self, value: f64) -> f64 {
        let share = if self.logarithmic {
            (value.max(self.low) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        share.clamp(0.0, 1.0)
    }
}

/// The smallest of 1, 2 and 5 times a power of ten that is not below `rough`.
pub(crate) fn nice_step(rough: f64) -> f64 {
    let power = 10.0_f64.powi(rough.log10().floor() as i32);
    let steps = [1.0, 2.0, 5.0, 10.0];
    steps.into_iter().map(|s| s * power).find(|step| *step >= rough * (1.0 - f64::EPSILON)).unwrap_or(10.0 * power)
}

/// A coordinate with one decimal at most.
pub(crate) fn coordinate(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map(str::to_owned).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_begins_at_zero_and_ends_on_a_round_number_above_the_largest_value() {
        let axis = Axis::linear([0.3, 7.2].into_iter(), 4);
        assert_eq!(axis.ticks, [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!((axis.share(0.0), axis.share(4.0), axis.share(99.0)), (0.0, 0.5, 1.0));
        let below = Axis::linear([-3.0, 5.0].into_iter(), 4);
        assert_eq!((below.ticks[0], below.high), (-4.0, 6.0));
        assert_eq!(Axis::counts([1.0].into_iter(), 4).ticks, [0.0, 1.0]);
        // Nothing but zeros, or nothing at all, still is an axis.
        assert_eq!(Axis::linear(std::iter::empty(), 4).high, 1.0);
    }

    #[test]
    fn an_axis_is_logarithmic_only_for_values_that_span_orders() {
        let wide = Axis::logarithmic_if_wide([2e-6, 4e-3].into_iter(), 5);
        assert!(wide.logarithmic);
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
        assert!(close(wide.low, 1e-6) && close(wide.high, 1e-2), "{wide:?}");
        assert!((wide.share(1e-4) - 0.5).abs() < 1e-12);
        assert!(!Axis::logarithmic_if_wide([1.0, 5.0].into_iter(), 5).logarithmic);
    }

    #[test]
    fn steps_are_round() {
        assert_eq!([0.7, 1.0, 1.2, 3.0, 70.0].map(nice_step), [1.0, 1.0, 2.0, 5.0, 100.0]);
    }

    #[test]
    fn a_logarithmic_axis_holds_its_values_and_has_labels_between_powers_of_ten() {
        let axis = Axis::logarithmic([2.0, 4.0, 9.0].into_iter(), 6);
        assert_eq!(axis.ticks, [2.0, 5.0, 10.0]);
        assert!(axis.share(2.0) > 0.0 && axis.share(9.0) < 1.0);
        assert_eq!(Axis::logarithmic([2.4, 3.3].into_iter(), 6).ticks, [2.0, 3.0, 4.0]);
        assert!(Axis::logarithmic([1e-6, 1.0].into_iter(), 4).ticks.len() <= 4);
        assert!(!Axis::logarithmic(std::iter::empty(), 4).ticks.is_empty());
    }
}

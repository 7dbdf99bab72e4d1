//! Periodic curves through equally spaced values.

use nalgebra::{DMatrix, DVector};

/// A periodic cubic spline with continuous second derivative through values at equal steps of one period.
#[derive(Debug, Clone)]
pub struct PeriodicSpline {
    coefficients: Vec<f64>,
}

impl PeriodicSpline {
    /// The spline with `value(i / values.len()) == values[i]`; at least three values.
    pub fn through(values: &[f64]) -> PeriodicSpline {
        let n = values.len();
        // A uniform cubic B-spline takes (c[i-1] + 4 c[i] + c[i+1]) / 6 at knot i; the matrix is diagonally dominant.
        let matrix = DMatrix::from_fn(n, n, |row, column| match (row + n - column) % n {
            0 => 4.0 / 6.0,
            d if d == 1 || d == n - 1 => 1.0 / 6.0,
            _ => 0.0,
        });
        let solved = matrix.lu().solve(&DVector::from_column_slice(values));
        let coefficients = solved.expect("a diagonally dominant matrix is regular").as_slice().to_vec();
        PeriodicSpline { coefficients }
    }

    /// Value at `phase`, counted in periods.
    pub fn value(&self, phase: f64) -> f64 {
        let n = self.coefficients.len();
        let at = phase.rem_euclid(1.0) * n as f64;
        let knot = (at as usize).min(n - 1);
        let t = at - knot as f64;
        let weights = [
            (1.0 - t).powi(3) / 6.0,
            (3.0 * t.powi(3) - 6.0 * t * t + 4.0) / 6.0,
            (-3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
            t.powi(3) / 6.0,
        ];
        weights.iter().enumerate().map(|(i, w)| w * self.coefficients[(knot + n + i - 1) % n]).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_takes_its_values_and_is_smooth_across_the_period() {
        let values = [3.0, -1.0, 2.0, 5.0, 0.0];
        let spline = PeriodicSpline::through(&values);
        for (i, value) in values.iter().enumerate() {
            assert!((spline.value(i as f64 / 5.0) - value).abs() < 1e-12);
        }
        let h = 1e-4;
        let slope = |phase: f64| (spline.value(phase + h) - spline.value(phase - h)) / (2.0 * h);
        let curvature = |phase: f64| (slope(phase + h) - slope(phase - h)) / (2.0 * h);
        // Third derivative is about 10 n^3; over 4 h this is the most the curvature may change.
        assert!((curvature(-2.0 * h) - curvature(2.0 * h)).abs() < 100.0 * 125.0 * 4.0 * h);
    }
}

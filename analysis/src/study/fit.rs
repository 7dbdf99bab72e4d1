//! Straight lines through logarithms, and which settings no other one beats.

use serde::Serialize;

/// An order of convergence: the slope of a straight line through the logarithms of errors over those of time steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Order {
    /// The slope.
    pub order: f64,
    /// Half of the width of its 95 % interval; `None` from two points.
    pub uncertainty: Option<f64>,
    /// Share of the variance that the line explains.
    pub r_squared: f64,
    /// Error at dt = 1 s by the line.
    pub scale: f64,
}

/// Quantiles of Student's distribution that hold 95 % between them, by degrees of freedom from 1.
const STUDENT: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];

/// The same for many degrees of freedom.
const NORMAL: f64 = 1.96;

/// Fits an order to time steps and errors, both above zero; `None` from fewer than two different steps.
pub(super) fn order(points: &[(f64, f64)]) -> Option<Order> {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(dt, error)| *dt > 0.0 && *error > 0.0).map(|(dt, e)| (dt.ln(), e.ln())).collect();
    let count = logs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |of: &dyn Fn(f64, f64) -> f64| logs.iter().map(|p| of(p.0 - x, p.1 - y)).sum::<f64>();
    let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
    if logs.len() < 2 || xx <= f64::EPSILON {
        return None;
    }
    let order = xy / xx;
    let left = (yy - order * xy).max(0.0);
    let freedom = logs.len() - 2;
    let student = STUDENT.get(freedom.wrapping_sub(1)).copied().unwrap_or(NORMAL);
    let uncertainty = (freedom > 0).then(|| student * (left / freedom as f64 / xx).sqrt());
    let r_squared = if yy > 0.0 { 1.0 - left / yy } else { 1.0 };
    Some(Order { order, uncertainty, r_squared, scale: (y - order * x).exp() })
}

/// Marks the points (cost, error) that no other one beats in both; of equal ones the first.
pub(super) fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |(i, a): (usize, &(f64, f64)), (j, b): (usize, &(f64, f64))| {
        a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1 || i < j)
    };
    let is_beaten = |b: (usize, &(f64, f64))| points.iter().enumerate().any(|a| a.0 != b.0 && beats(a, b));
    points.iter().enumerate().map(|point| !is_beaten(point)).collect()
}

/// The point of a front that lies farthest below the straight line between its ends, on logarithmic axes: where more time
/// begins to buy less. `None` of fewer than three points, and where none lies below.
pub(super) fn knee(front: &[(f64, f64)]) -> Option<usize> {
    let logs: Vec<(f64, f64)> = front.iter().map(|(cost, error)| (cost.ln(), error.ln())).collect();
    if front.len() < 3 || logs.iter().any(|(x, y)| !x.is_finite() || !y.is_finite()) {
        return None;
    }
    let order = |a: &usize, b: &usize| logs[*a].0.total_cmp(&logs[*b].0);
    let first = (0..logs.len()).min_by(order)?;
    let last = (0..logs.len()).max_by(order)?;
    let (a, b) = (logs[first], logs[last]);
    let below = |p: (f64, f64)| (b.0 - a.0) * (a.1 - p.1) + (b.1 - a.1) * (p.0 - a.0);
    (0..logs.len())
        .filter(|i| below(logs[*i]) > f64::EPSILON)
        .max_by(|i, j| below(logs[*i]).total_cmp(&below(logs[*j])))
}

/// The middle of values; the mean of the two middle ones of an even number. `None` of none.
pub(super) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted.get(sorted.len().wrapping_sub(1) / 2)?, sorted.get(sorted.len() / 2)?);
    Some((low + high) / 2.0)
}

/// The median of the distances from the median. `None` of none.
pub(super) fn median_deviation(values: &[f64]) -> Option<f64> {
    let middle = median(values)?;
    median(&values.iter().map(|value| (value - middle).abs()).collect::<Vec<_>>())
}

/// Mean and standard deviation; the latter needs two values.
pub(super) fn mean_and_deviation(values: &[f64]) -> (f64, Option<f64>) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count.max(1.0);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (values.len() > 1).then(|| (squares / (count - 1.0)).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of a method of this order, with a relative disturbance that alternates.
    fn errors(order: f64, disturbance: f64) -> Vec<(f64, f64)> {
        let level = |i: i32| {
            let dt = 0.5_f64.powi(i);
            (dt, 3.0 * dt.powf(order) * (1.0 + disturbance * f64::from(i % 2)))
        };
        (0..5).map(level).collect()
    }

    #[test]
    fn the_order_of_convergent_data_is_found_with_its_scale() {
        for order_of in [1.0, 2.0] {
            let fit = order(&errors(order_of, 0.0)).unwrap();
            assert!((fit.order - order_of).abs() < 1e-12 && (fit.scale - 3.0).abs() < 1e-9, "{fit:?}");
            assert!(fit.uncertainty.unwrap() < 1e-6 && fit.r_squared > 1.0 - 1e-12, "{fit:?}");
        }
    }

    #[test]
    fn scatter_widens_the_interval_which_still_holds_the_order() {
        let fit = order(&errors(1.0, 0.3)).unwrap();
        let uncertainty = fit.uncertainty.unwrap();
        assert!(uncertainty > 0.05 && (fit.order - 1.0).abs() < uncertainty, "{fit:?}");
        // By hand: three points (0, 0), (1, 1), (2, 3) on natural logarithms have slope 1.5, residual sum 1/6 and one
        // degree of freedom: 12.706 √(1/6/2).
        let by_hand: Vec<(f64, f64)> =
            [(0.0_f64, 0.0_f64), (1.0, 1.0), (2.0, 3.0)].map(|(x, y)| (x.exp(), y.exp())).into();
        let fit = order(&by_hand).unwrap();
        assert!((fit.order - 1.5).abs() < 1e-12, "{fit:?}");
        assert!((fit.uncertainty.unwrap() - 12.706 * (1.0_f64 / 12.0).sqrt()).abs() < 1e-9, "{fit:?}");
        assert!(order(&[(0.1, 1.0), (0.1, 2.0)]).is_none() && order(&[]).is_none());
    }

    #[test]
    fn a_front_holds_what_nobody_beats() {
        let points = [(1.0, 4.0), (2.0, 2.0), (2.0, 3.0), (3.0, 2.0), (4.0, 1.0), (4.0, 1.0)];
        assert_eq!(front(&points), [true, true, false, false, true, false]);
        assert!(front(&[]).is_empty());
    }

    #[test]
    fn the_knee_is_where_time_begins_to_buy_less() {
        // Ten times less error for twice the time, then hardly anything for ten times the time.
        assert_eq!(knee(&[(1.0, 10.0), (2.0, 1.0), (20.0, 0.9)]), Some(1));
        // On a straight line there is none, nor on one that bends the other way.
        assert_eq!(knee(&[(1.0, 8.0), (2.0, 4.0), (4.0, 2.0)]), None);
        assert_eq!(knee(&[(1.0, 10.0), (10.0, 9.0), (20.0, 1.0)]), None);
    }

    #[test]
    fn middles_and_spreads_are_those_of_the_textbook() {
        assert_eq!(
            (median(&[3.0, 1.0, 2.0]), median(&[4.0, 1.0, 2.0, 3.0]), median(&[])),
            (Some(2.0), Some(2.5), None)
        );
        assert_eq!(median_deviation(&[1.0, 2.0, 4.0, 10.0]), Some(1.5));
        let (mean, deviation) = mean_and_deviation(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
        assert!(mean == 5.0 && (deviation.unwrap() - (32.0_f64 / 7.0).sqrt()).abs() < 1e-12);
    }
}

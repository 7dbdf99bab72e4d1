//! Orders of convergence, from errors at several step lengths.

/// Slope of log(error) over log(step), by least squares, and the share of the scatter that the line explains.
pub(crate) fn fit(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|(dt, e)| (dt.ln(), e.ln())).collect();
    let (mx, my) = (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    let sum = |of: &dyn Fn(f64, f64) -> f64| logs.iter().map(|(x, y)| of(x - mx, y - my)).sum::<f64>();
    let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
    (xy / xx, xy * xy / (xx * yy))
}

/// Demands that the errors fall with the order `expected`, within 0.2, along a line, over four levels at least.
pub(crate) fn assert_order(points: &[(f64, f64)], expected: f64, what: &str) {
    assert!(points.len() >= 4, "{what}: a slope needs four levels");
    let (slope, explained) = fit(points);
    assert!((slope - expected).abs() < 0.2 && explained > 0.98, "{what}: slope {slope}, R² {explained}, {points:?}");
}

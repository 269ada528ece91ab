//! Medians, tails, and slopes of lists of numbers.

/// The median, or the mean of the two middle numbers. `None` for an empty list.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let count = values.len();
    (count > 0).then(|| 0.5 * (values[(count - 1) / 2] + values[count / 2]))
}

/// The median, the 99th percentile (the smallest value that 99 % of the values do not exceed), and the maximum.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spread {
    pub median: Option<f64>,
    pub p99: Option<f64>,
    pub max: Option<f64>,
}

impl Spread {
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let rank = (values.len() * 99).div_ceil(100).saturating_sub(1);
        Self { p99: values.get(rank).copied(), max: values.last().copied(), median: median(values) }
    }
}

/// The mean. `None` for an empty list.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.into_iter().fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Slope of the least-squares line through the logarithms of both coordinates.
pub fn log_slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let (mean_x, mean_y) = (mean(logs.iter().map(|log| log.0))?, mean(logs.iter().map(|log| log.1))?);
    let spread: f64 = logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    let product: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    (spread > 0.0).then(|| product / spread)
}

/// Indices of the points on the Pareto front, from left to right. A point is on the front if no other point is at least
/// as low and at least as far left.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut lowest = f64::INFINITY;
    order.retain(|&place| {
        let is_lower = points[place].1 < lowest;
        lowest = lowest.min(points[place].1);
        is_lower
    });
    order
}

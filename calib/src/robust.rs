//! Weights that leave outliers little to say.

/// Residuals beyond this many scales count less (Huber 1964).
const HUBER: f64 = 1.5;
/// From the median of absolute values to the standard deviation of normal ones.
const MEDIAN_TO_SIGMA: f64 = 1.4826;

/// Huber's weight of a residual in units of the scale.
pub(crate) fn huber(residual: f64) -> f64 {
    let size = residual.abs();
    if size <= HUBER { 1.0 } else { HUBER / size }
}

/// The scale of residuals by their median size; 1 of none, and never so small that a weight grows beyond measure.
pub(crate) fn scale(residuals: &mut [f64]) -> f64 {
    residuals.iter_mut().for_each(|residual| *residual = residual.abs());
    residuals.sort_by(f64::total_cmp);
    residuals.get(residuals.len() / 2).map_or(1.0, |median| (MEDIAN_TO_SIGMA * median).max(1e-3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_fall_beyond_three_halves_and_the_scale_ignores_outliers() {
        assert_eq!([0.0, -1.5, 3.0].map(huber), [1.0, 1.0, 0.5]);
        // The median size of −1, 1, 2, 100, 0.5 is 1.
        assert!((scale(&mut [-1.0, 1.0, 2.0, 100.0, 0.5]) - 1.4826).abs() < 1e-12);
        assert_eq!(scale(&mut []), 1.0);
    }
}

//! Bounds within which sums of normalised squares lie.

use core::f64::consts::FRAC_1_SQRT_2;

/// The value that a χ² of `freedom` degrees of freedom stays below with a probability: Wilson and Hilferty's cube, which is
/// within 3 % of the value at 6 degrees of freedom and within 0.1 % from 50 on. `probability` in 0..1 exclusive.
pub fn chi_square_quantile(probability: f64, freedom: f64) -> f64 {
    let part = 2.0 / (9.0 * freedom);
    let root = (1.0 - part + normal_quantile(probability) * libm::sqrt(part)).max(0.0);
    freedom * root * root * root
}

/// Where the mean of `count` independent χ² of `freedom` degrees of freedom each lies in 95 of 100 cases.
pub fn mean_bounds(freedom: u32, count: u32) -> (f64, f64) {
    let count = f64::from(count.max(1));
    let all = f64::from(freedom) * count;
    (chi_square_quantile(0.025, all) / count, chi_square_quantile(0.975, all) / count)
}

/// By halving: the normal distribution is `erfc`, and its inverse is needed a few times a report.
fn normal_quantile(probability: f64) -> f64 {
    let below = |x: f64| 0.5 * libm::erfc(-x * FRAC_1_SQRT_2);
    let (mut low, mut high) = (-38.0, 38.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if below(middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // (probability, degrees of freedom, table, share off)
        let table = [
            (0.025, 6.0, 1.237, 0.03),
            (0.975, 6.0, 14.449, 0.001),
            (0.9999, 6.0, 27.856, 0.02),
            (0.025, 12.0, 4.404, 0.006),
            (0.5, 12.0, 11.340, 0.001),
            (0.975, 12.0, 23.337, 0.001),
            (0.025, 50.0, 32.357, 0.001),
            (0.975, 100.0, 129.561, 0.001),
        ];
        for (probability, freedom, expected, off) in table {
            let found = chi_square_quantile(probability, freedom);
            assert!((found - expected).abs() < off * expected, "{probability} {freedom}: {found}, not {expected}");
        }
    }

    #[test]
    fn normal_quantiles_are_those_of_the_tables() {
        for (probability, expected) in [(0.5, 0.0), (0.975, 1.959_964), (0.025, -1.959_964), (0.999_9, 3.719_016)] {
            assert!((normal_quantile(probability) - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn fifty_runs_give_the_bounds_of_the_design() {
        // χ²(300): 253.9 and 349.9; χ²(600): 534.0 and 669.8; over 50.
        let near = |(low, high): (f64, f64), (a, b): (f64, f64)| (low - a).abs() < 0.005 && (high - b).abs() < 0.005;
        assert!(near(mean_bounds(6, 50), (5.08, 7.00)), "{:?}", mean_bounds(6, 50));
        assert!(near(mean_bounds(12, 50), (10.68, 13.40)), "{:?}", mean_bounds(12, 50));
    }
}

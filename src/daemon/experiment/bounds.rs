//! How sure a share of trials is: Clopper and Pearson's exact bounds.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// So many of so many, and the 95 % interval of the share behind them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Share {
    /// How many did.
    pub count: u64,
    /// Of how many.
    pub of: u64,
    /// `count / of`; null: of none.
    pub share: Option<f64>,
    /// Lower end of the 95 % interval (Clopper and Pearson 1934).
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// Left out on either side of the interval.
const TAIL: f64 = 0.025;

impl Share {
    /// A share with its interval.
    pub fn new(count: usize, of: usize) -> Self {
        let (k, n) = (count as u64, of as u64);
        let low = if k == 0 { 0.0 } else { solve(|p| 1.0 - at_most(k - 1, n, p) >= TAIL) };
        let high = if k == n { 1.0 } else { solve(|p| at_most(k, n, p) <= TAIL) };
        Self { count: k, of: n, share: (n > 0).then(|| k as f64 / n as f64), low, high }
    }

    /// In percent, `97.3 %`; `-`: of none.
    pub fn percent(&self) -> String {
        self.share.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 100.0 * share))
    }
}

/// The least probability for which `reached` holds; it holds from there on.
fn solve(reached: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if reached(middle) { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}

/// The probability of at most `k` of `n` where each is of probability `p`, 0 < p < 1.
fn at_most(k: u64, n: u64, p: f64) -> f64 {
    let (success, failure) = (p.ln(), (-p).ln_1p());
    let mut ways = 0.0; // ln of n over i
    let mut sum = 0.0;
    for i in 0..=k.min(n) {
        sum += (ways + i as f64 * success + (n - i) as f64 * failure).exp();
        ways += ((n - i) as f64 / (i + 1) as f64).ln();
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// None of n: the upper end is 1 − 0.025^(1/n); all of n: the lower end is 0.025^(1/n).
    #[test]
    fn none_and_all_have_the_bounds_of_one_power() {
        for n in [1, 10, 100, 1000] {
            let bound = 0.025f64.powf(1.0 / n as f64);
            let (none, all) = (Share::new(0, n), Share::new(n, n));
            assert_eq!((none.low, all.high), (0.0, 1.0));
            assert!((none.high - (1.0 - bound)).abs() < 1e-9 && (all.low - bound).abs() < 1e-9, "{n}");
        }
    }

    /// Clopper and Pearson's own kind of table: 5 of 10 is 0.187 to 0.813, 1 of 20 is 0.0013 to 0.2487.
    #[test]
    fn known_intervals_come_out() {
        let half = Share::new(5, 10);
        assert!((half.low - 0.187).abs() < 5e-4 && (half.high - 0.813).abs() < 5e-4, "{half:?}");
        let one = Share::new(1, 20);
        assert!((one.low - 0.0013).abs() < 5e-5 && (one.high - 0.2487).abs() < 5e-5, "{one:?}");
    }

    #[test]
    fn of_none_nothing_is_known() {
        let share = Share::new(0, 0);
        assert_eq!((share.share, share.low, share.high), (None, 0.0, 1.0));
        assert_eq!(share.percent(), "-");
    }
}

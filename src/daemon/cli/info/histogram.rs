//! Smallest, median and greatest of any number of values, in bounded memory.

use super::report::Spread;

/// Bins at most; what lies beyond the last counts there. Covers 262.14 m in centimetres, the longest range that the 16
/// bits of a VLP-32C can say, and 26 m in millimetres.
const MAX_BINS: usize = 26_215;

/// Counts values by the bin they round to.
pub(super) struct Histogram {
    bins_per_unit: f32,
    bins: Vec<u64>,
    count: u64,
    min: f32,
    max: f32,
}

impl Histogram {
    /// Bins of 1/`bins_per_unit`.
    pub(super) fn new(bins_per_unit: f32) -> Self {
        Self { bins_per_unit, bins: Vec::new(), count: 0, min: f32::INFINITY, max: f32::NEG_INFINITY }
    }

    /// Counts one value; one that is no number is ignored.
    pub(super) fn add(&mut self, value: f32) {
        if value.is_nan() {
            return;
        }
        self.count += 1;
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        // `as` takes what is negative to 0.
        let bin = ((value * self.bins_per_unit).round() as usize).min(MAX_BINS - 1);
        if bin >= self.bins.len() {
            self.bins.resize(bin + 1, 0);
        }
        if let Some(count) = self.bins.get_mut(bin) {
            *count += 1;
        }
    }

    /// What was counted; `None` before any value. The median is the lower one, to the nearest bin.
    pub(super) fn spread(&self) -> Option<Spread> {
        let below = self.count.checked_sub(1)? / 2;
        let mut seen = 0;
        let median_bin = self.bins.iter().position(|count| {
            seen += count;
            seen > below
        })?;
        let median = median_bin as f64 / f64::from(self.bins_per_unit);
        // No sensor here resolves a tenth of a millimetre; the digits behind it are those of f32.
        let rounded = |value: f32| (f64::from(value) * 1e4).round() / 1e4;
        // The bin's middle may lie just outside of what it holds.
        let (min, max) = (rounded(self.min), rounded(self.max));
        Some(Spread { min, median: median.clamp(min, max), max })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(values: &[f32]) -> Option<Spread> {
        let mut histogram = Histogram::new(100.0);
        values.iter().for_each(|value| histogram.add(*value));
        histogram.spread()
    }

    #[test]
    fn the_median_is_the_lower_middle_value_to_a_centimetre() {
        // Sorted 0.5, 1.234, 7, 9: the lower middle is 1.234, which rounds to 1.23.
        let spread = spread(&[9.0, 0.5, 1.234, 7.0]).expect("four values");
        assert_eq!((spread.min, spread.median, spread.max), (0.5, 1.23, 9.0));
    }

    #[test]
    fn values_beyond_the_last_bin_are_still_the_greatest() {
        assert_eq!(spread(&[1e9]).map(|s| s.max), Some(1e9));
        assert_eq!(spread(&[]), None);
        assert_eq!(spread(&[f32::NAN]), None);
    }

    #[test]
    fn a_median_is_never_outside_of_what_was_counted() {
        let spread = spread(&[0.004]).expect("one value"); // its bin's middle is 0
        assert_eq!(spread.median, spread.min);
    }
}

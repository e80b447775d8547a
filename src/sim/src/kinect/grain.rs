//! The noise of the disparity: how large at a depth, and alike from pixel to pixel.
//!
//! The device correlates a window of dots, so neighbours share most of their error: recorded patches have 0.55 to 0.65
//! between neighbours, after rounding. White numbers go through a separable window of five taps; the rounding afterwards
//! adds its own 1/12 step², which is not as alike.

use crate::noise::Noise;
use tumbled_kinect::{HEIGHT, WIDTH};

/// Standard deviation of the disparity by depth (m, steps), rounding included: measured on 13 047 smooth patches of 25 × 25
/// pixels of recorded frames up to 3 m; between 2 and 7 m frames of another device have 0.49 to 0.53.
const MEASURED: [(f64, f64); 6] = [(0.8, 0.56), (1.25, 0.52), (1.75, 0.47), (2.25, 0.445), (2.75, 0.45), (4.5, 0.51)];
/// Variance of a rounding error, steps².
const ROUNDING: f64 = 1.0 / 12.0;
/// The quadratic surface that was removed from each recorded patch takes a part of noise this alike with it: 14 % of the
/// variance, measured on patches made here. This much more is put in.
const BEFORE_THE_FIT: f64 = 1.075;
/// Pixels the window reaches to either side.
pub(super) const REACH: usize = 2;
/// Its taps: a Gaussian of 1.25 px, scaled so that the variance of what goes through stays.
pub(super) const WINDOW: [f32; 5] = [0.187_06, 0.488_55, 0.672_80, 0.488_55, 0.187_06];

/// Standard deviation before rounding at a depth, steps.
pub(super) fn sigma(metres: f64) -> f64 {
    let [(first, nearest), .., (_, farthest)] = MEASURED;
    let pairs = MEASURED.iter().zip(MEASURED.iter().skip(1));
    let between = pairs
        .filter(|((_, _), (end, _))| metres < *end)
        .map(|((start, s), (end, e))| s + (e - s) * (metres - start) / (end - start))
        .next();
    let measured = if metres <= first { nearest } else { between.unwrap_or(farthest) };
    BEFORE_THE_FIT * (measured * measured - ROUNDING).sqrt()
}

/// [`sigma`] by 1/z, for the loop over the pixels.
#[derive(Clone, Debug)]
pub(super) struct SigmaTable(Vec<f32>);

impl SigmaTable {
    /// Places per 1/m.
    const PER_INVERSE_M: f64 = 256.0;

    /// For depths from 0.25 m on.
    pub(super) fn new(share: f64) -> Self {
        let inverse_depth = |place: u32| (f64::from(place) + 0.5) / Self::PER_INVERSE_M;
        Self((0..1_024).map(|place| (share * sigma(1.0 / inverse_depth(place))) as f32).collect())
    }

    pub(super) fn at(&self, inverse_depth: f64) -> f32 {
        self.0.get((inverse_depth * Self::PER_INVERSE_M) as usize).copied().unwrap_or_default()
    }
}

/// One row of white numbers through the window along the row. Down the columns they go through it when they are used.
pub(super) fn along(seed: u64, name: &str, index: u64, v: usize, row: &mut [f32]) {
    let mut noise = Noise::new(seed, name, index.wrapping_mul(HEIGHT as u64).wrapping_add(v as u64));
    let mut white = [0.0_f32; WIDTH + 2 * REACH];
    for pair in white.chunks_mut(2) {
        let bits = noise.bits();
        for (number, half) in pair.iter_mut().zip([bits as u32, (bits >> 32) as u32]) {
            *number = nearly_normal(half);
        }
    }
    for (out, taps) in row.iter_mut().zip(white.windows(WINDOW.len())) {
        *out = taps.iter().zip(&WINDOW).map(|(number, tap)| number * tap).sum();
    }
}

/// Mean 0, standard deviation 1: the sum of four bytes. Its tails end at 3.5, and its 1021 steps and its fourth moment
/// (2.7, not 3) are gone when 25 of them have been added.
pub(super) fn nearly_normal(bits: u32) -> f32 {
    /// Standard deviation of the sum of four bytes: √(4 · (256² − 1)/12).
    const SPREAD: f32 = 147.800_77;
    let sum: i32 = bits.to_le_bytes().iter().map(|byte| i32::from(*byte)).sum();
    (sum - 510) as f32 / SPREAD
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_keeps_the_variance() {
        let power: f32 = WINDOW.iter().map(|tap| tap * tap).sum();
        assert!((power - 1.0).abs() < 1e-4, "{power}");
    }

    #[test]
    fn white_numbers_have_mean_0_and_variance_1() {
        let mut noise = Noise::new(3, "white", 0);
        let numbers: Vec<f32> = (0..100_000).map(|_| nearly_normal(noise.bits() as u32)).collect();
        let mean = numbers.iter().sum::<f32>() / 1e5;
        let square = numbers.iter().map(|x| x * x).sum::<f32>() / 1e5;
        // Standard errors 0.0032 and 0.0041; four of each.
        assert!(mean.abs() < 0.013 && (square - 1.0).abs() < 0.017, "{mean} {square}");
    }

    #[test]
    fn the_table_holds_the_measured_noise_less_rounding() {
        // 0.56² − 1/12 = 0.230 267, root 0.479 861; halfway from 0.47 to 0.445 is 0.4575: √(0.209 306 − 0.083 333) = 0.354 927.
        for (metres, expected) in [(0.5, 0.479_861), (0.8, 0.479_861), (2.0, 0.354_927), (7.0, 0.420_437)] {
            let expected = 1.075 * expected;
            assert!((sigma(metres) - expected).abs() < 1e-5, "{metres} m: {}", sigma(metres));
            assert!((f64::from(SigmaTable::new(1.0).at(1.0 / metres)) - expected).abs() < 2e-3, "{metres} m");
        }
    }
}

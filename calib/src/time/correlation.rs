//! Cross-correlation: a rate that rises and falls does so in the sensor's states as in the encoder's angles, later by the
//! offset.

use super::{TimedAngle, student};
use tumbled_model::se3::less_turns;

/// How often both rates are taken, 1/s.
const RATE_HZ: f64 = 200.0;
/// A rate is the difference over so long, s: a state's noise stays small against it. Both are smoothed alike.
const STEP_S: f64 = 0.4;
/// The largest offset that is looked for, s.
pub const REACH_S: f64 = 0.2;
/// A second peak this high makes the first one no evidence.
pub const SECOND_PEAK: f64 = 0.8;
/// The rates' change has to be so many times their noise.
pub const LEAST_SIGNAL: f64 = 3.0;
/// Pieces whose scatter tells the uncertainty.
const PIECES: usize = 6;
/// The least length of the whole, s.
pub const LEAST_S: f64 = 12.0;

/// How late a sensor's stamps are, by correlation.
#[derive(Clone, Debug, PartialEq)]
pub struct Correlated {
    /// Seconds by which the times are late still.
    pub late_s: f64,
    /// One standard deviation, by the scatter of six pieces, with what so few are uncertain by.
    pub sigma_s: f64,
    /// The correlation at its peak, 1 at most.
    pub peak: f64,
    /// The second highest peak over the first; 0: there is one alone.
    pub second_peak: f64,
    /// Lags, s, and the correlation at each, for a plot.
    pub curve: Vec<(f64, f64)>,
}

/// Why correlation tells no offset.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoCorrelation {
    /// Too short.
    #[error("{found_s:.1} s of states with the encoder known, and {LEAST_S} s are the least")]
    Short {
        /// What there is, s.
        found_s: f64,
    },
    /// The rate is the same throughout.
    #[error(
        "the stage's rate changes by {signal_dps:.2} °/s only, the states' own noise is {noise_dps:.2} °/s: let the stage stop \
         and go, or swing"
    )]
    NoSignal {
        /// Standard deviation of the encoder's rate, °/s.
        signal_dps: f64,
        /// Of the difference of both, °/s.
        noise_dps: f64,
    },
    /// The peak is at the end of what is looked at.
    #[error(
        "the rates agree best at the end of the ±200 ms that are looked at: the clocks are farther apart, correct them first"
    )]
    BeyondReach,
    /// Two peaks.
    #[error(
        "a second peak has {ratio:.2} of the first one's height: the stage swings too fast; let it stop and go irregularly"
    )]
    Ambiguous {
        /// Second over first.
        ratio: f64,
    },
}

/// Correlates the changes of |rate|, as the states and the encoder have them.
///
/// # Errors
/// [`NoCorrelation`], in words.
pub fn correlate(samples: &[TimedAngle]) -> Result<Correlated, NoCorrelation> {
    let (encoder, states) = rates(samples);
    let found_s = encoder.len() as f64 / RATE_HZ;
    if found_s < LEAST_S {
        return Err(NoCorrelation::Short { found_s });
    }
    let curve = curve(&encoder, &states);
    let (peak, late_s) = peak(&curve).ok_or(NoCorrelation::BeyondReach)?;
    check_signal(&encoder, &states, late_s)?;
    let second_peak = second(&curve, peak) / peak;
    if second_peak > SECOND_PEAK {
        return Err(NoCorrelation::Ambiguous { ratio: second_peak });
    }
    let piece = encoder.len() / PIECES;
    let pieces = encoder.chunks(piece).zip(states.chunks(piece)).take(PIECES);
    // A piece in which nothing changes tells nothing.
    let told: Vec<f64> =
        pieces.filter_map(|(encoder, states)| Some(self::peak(&self::curve(encoder, states))?.1)).collect();
    let freedom = told.len().saturating_sub(1);
    let sigma_s = if freedom == 0 {
        REACH_S
    } else {
        let mean = told.iter().sum::<f64>() / told.len() as f64;
        let variance = told.iter().map(|late| (late - mean) * (late - mean)).sum::<f64>() / freedom as f64;
        (variance / told.len() as f64).sqrt() * student(freedom)
    };
    Ok(Correlated { late_s, sigma_s, peak, second_peak, curve })
}

/// |rate| of encoder and states, rad/s, at even times.
fn rates(samples: &[TimedAngle]) -> (Vec<f64>, Vec<f64>) {
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Default::default() };
    let mut unwrapped = Vec::with_capacity(samples.len());
    let mut state = first.state_rad;
    for (before, sample) in core::iter::once(first).chain(samples).zip(samples) {
        state += less_turns(sample.state_rad - before.state_rad);
        unwrapped.push((sample.t_s, sample.encoder_rad, state));
    }
    let at = |t: f64| {
        let next = unwrapped.partition_point(|(time, ..)| *time <= t).clamp(1, unwrapped.len().max(2) - 1);
        let (a, b) = (unwrapped.get(next - 1)?, unwrapped.get(next)?);
        let share = if b.0 > a.0 { (t - a.0) / (b.0 - a.0) } else { 0.0 };
        Some((a.1 + share * (b.1 - a.1), a.2 + share * (b.2 - a.2)))
    };
    let count = ((last.t_s - first.t_s - STEP_S).max(0.0) * RATE_HZ) as usize;
    let rate = |n: usize| {
        let t = first.t_s + STEP_S / 2.0 + n as f64 / RATE_HZ;
        let (before, after) = (at(t - STEP_S / 2.0)?, at(t + STEP_S / 2.0)?);
        Some(((after.0 - before.0).abs() / STEP_S, (after.1 - before.1).abs() / STEP_S))
    };
    (0..count).filter_map(rate).unzip()
}

fn less_mean(values: impl Iterator<Item = f64> + Clone) -> (f64, usize) {
    let count = values.clone().count();
    (values.sum::<f64>() / count.max(1) as f64, count)
}

/// The normalised correlation at each lag of the states, −[`REACH_S`]..=[`REACH_S`].
fn curve(encoder: &[f64], states: &[f64]) -> Vec<(f64, f64)> {
    let reach = (REACH_S * RATE_HZ) as usize;
    let inner = encoder.len().min(states.len()).saturating_sub(2 * reach);
    let fixed = encoder.get(reach..reach + inner).unwrap_or_default();
    let (mean, _) = less_mean(fixed.iter().copied());
    let power: f64 = fixed.iter().map(|value| (value - mean) * (value - mean)).sum();
    let at = |shift: usize| {
        let moved = states.get(shift..shift + inner).unwrap_or_default();
        let (moved_mean, _) = less_mean(moved.iter().copied());
        let moved_power: f64 = moved.iter().map(|value| (value - moved_mean) * (value - moved_mean)).sum();
        let product: f64 = fixed.iter().zip(moved).map(|(a, b)| (a - mean) * (b - moved_mean)).sum();
        let scale = (power * moved_power).sqrt();
        let lag = (shift as f64 - reach as f64) / RATE_HZ;
        (lag, if scale > 0.0 { product / scale } else { 0.0 })
    };
    (0..=2 * reach).map(at).collect()
}

/// Height and lag of the highest point, by a parabola through it and its neighbours; `None`: it is at an end.
fn peak(curve: &[(f64, f64)]) -> Option<(f64, f64)> {
    let highest = curve.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1))?.0;
    let (before, at, after) = (curve.get(highest.checked_sub(1)?)?, curve.get(highest)?, curve.get(highest + 1)?);
    let bend = before.1 - 2.0 * at.1 + after.1;
    if at.1 <= 0.0 || bend >= 0.0 {
        return None;
    }
    let shift = 0.5 * (before.1 - after.1) / bend;
    Some((at.1, at.0 + shift / RATE_HZ))
}

/// The highest point that is higher than its neighbours, the first one left out; 0: there is none.
fn second(curve: &[(f64, f64)], first: f64) -> f64 {
    let heights: Vec<f64> = curve.iter().map(|point| point.1).collect();
    let tops = heights.windows(3).filter_map(|three| match three {
        [a, b, c] if b > a && b >= c && *b < first => Some(*b),
        _ => None,
    });
    tops.fold(0.0, f64::max)
}

fn check_signal(encoder: &[f64], states: &[f64], late_s: f64) -> Result<(), NoCorrelation> {
    let shift = libm::round(late_s * RATE_HZ) as isize;
    let (skip_encoder, skip_states) = ((-shift).max(0) as usize, shift.max(0) as usize);
    let differences = encoder.iter().skip(skip_encoder).zip(states.iter().skip(skip_states)).map(|(a, b)| b - a);
    let std = |values: Vec<f64>| {
        let (mean, count) = less_mean(values.iter().copied());
        (values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / count.max(1) as f64).sqrt()
    };
    let (signal, noise) = (std(encoder.to_vec()), std(differences.collect()));
    if signal < LEAST_SIGNAL * noise || signal < 1e-6 {
        let (signal_dps, noise_dps) = (signal.to_degrees(), noise.to_degrees());
        return Err(NoCorrelation::NoSignal { signal_dps, noise_dps });
    }
    Ok(())
}

//! Which poses are believed: by the normalised innovation squared, χ² of six degrees of freedom.

use super::measurement::innovation;
use super::options::{FilterMethod, PoseMeasurement};
use super::paper;
use super::sigma::predict;
use super::state::{RATE, Setup, State};
use super::update::update;

/// Above: refused. One right pose in ten thousand.
const REFUSE: f64 = 27.9;
/// Above: taken with its noise widened until it is not. One in a thousand.
const DOUBT: f64 = 22.5;
/// So many refused in a row: the angular velocity is doubted, its deviations made twice as wide.
const DOUBT_RATE: u32 = 3;
/// So many refused in a row: lost.
const LOST: u32 = 6;
/// Weight of a pose in the running mean of the squared innovations: about 30 poses.
const MEMORY: f64 = 1.0 / 30.0;
/// The mean of 30 poses' squared innovations that right noise stays below: χ²₁₈₀ of 0.975, by 30.
const BAND: f64 = 7.3;
/// The most that a mean above the band widens a sensor's noise.
const MOST_WIDENED: f64 = 16.0;

/// What became of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Used {
    /// Taken as it is.
    Full,
    /// Taken with its noise widened.
    Soft,
    /// Refused: too far off.
    Rejected,
    /// Older than what the filter remembers.
    TooOld,
    /// Not a pose of a known sensor: numbers that are not finite, an information matrix that is none.
    Unusable,
    /// The filter's numbers failed; it stands where it stood before.
    Failed,
}

/// What became of a pose, and of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Its normalised innovation squared; of six degrees of freedom. None where there was nothing to compare.
    pub nis: Option<f64>,
    /// Whether it was taken.
    pub used: Used,
    /// Six in a row were refused: the target has to be acquired anew.
    pub lost: bool,
}

/// The state after a pose.
pub(super) fn step(setup: &Setup, before: &State, z: &PoseMeasurement) -> (State, Verdict) {
    let predicted = predict(setup, before, z.t);
    let (state, used, nis) = judged(setup, predicted, z);
    let (state, used) = if state.is_sound(setup) { (state, used) } else { (before.clone(), Used::Failed) };
    let lost = is_lost(&state);
    (state, Verdict { nis, used, lost })
}

/// Whether too many poses were refused in a row.
pub(super) fn is_lost(state: &State) -> bool {
    state.refused >= LOST
}

fn judged(setup: &Setup, mut state: State, z: &PoseMeasurement) -> (State, Used, Option<f64>) {
    let Some(innovation) = innovation(setup, &state, z) else { return (state, Used::Unusable, None) };
    let corrected = |state: &State, widened: f64| match setup.options.method {
        FilterMethod::Cubature => update(setup, state, &innovation, widened),
        FilterMethod::Paper => paper::update(setup, state, &innovation, widened),
    };
    let mean = state.sensors.get(z.sensor).map_or(0.0, |sensor| sensor.mean_nis);
    let widened = if mean > BAND { (mean / 6.0).clamp(1.0, MOST_WIDENED) } else { 1.0 };
    let Some((after, nis)) = corrected(&state, widened) else { return (state, Used::Failed, None) };
    if !nis.is_finite() {
        return (state, Used::Failed, None);
    }
    let (after, used) = if nis > REFUSE {
        state.refused = state.refused.saturating_add(1);
        if state.refused == DOUBT_RATE {
            state.root.scale(RATE, 2.0);
        }
        return (state, Used::Rejected, Some(nis));
    } else if nis > DOUBT {
        match corrected(&state, widened * nis / DOUBT) {
            Some((after, _)) => (after, Used::Soft),
            None => return (state, Used::Failed, Some(nis)),
        }
    } else {
        (after, Used::Full)
    };
    state = after;
    state.refused = 0;
    if let Some(sensor) = state.sensors.get_mut(z.sensor) {
        sensor.last = Some(z.t);
        // Brought back to the noise as stated: else a widened noise would hide what widened it.
        sensor.mean_nis += MEMORY * (nis * widened - sensor.mean_nis);
    }
    (state, used, Some(nis))
}

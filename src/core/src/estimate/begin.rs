//! How a filter is begun.

use super::manoeuvre;
use super::sensors::PointSensor;
use super::settings::EstimateSettings;
use crate::ukf::{Filter, FilterMethod, FilterOptions, Motion, PoseMeasurement};

/// Shares of the poses' information with which a filter is begun, until it can be.
const BELIEVED: [f64; 3] = [1.0, 1.0 / 16.0, 1.0 / 256.0];
/// A start that refuses one pose or more to so many that it takes was of no steady motion.
const UNSTEADY_START: u64 = 2;

/// A filter from poses of a target that was acquired at a place, rig frame.
pub(super) fn filter(
    settings: &EstimateSettings,
    sensors: &[PointSensor],
    window: &[PoseMeasurement],
    motion: Motion,
    acquired_m: [f64; 3],
) -> Option<Filter> {
    let first = window.first()?;
    let priors: Vec<_> = sensors.iter().map(|sensor| sensor.prior(&first.pose.translation.vector)).collect();
    let options = match motion {
        _ if settings.method == FilterMethod::Paper => FilterOptions { motion, ..FilterOptions::paper() },
        Motion::FixedAxis => FilterOptions::fixed_axis(),
        Motion::FreeTumble => FilterOptions::free_tumble(),
    };
    let options = FilterOptions {
        method: settings.method,
        mean_motion_rps: settings.mean_motion_rps,
        orbit_center_m: settings.orbit_center_m.unwrap_or(acquired_m),
        ..options
    };
    // What moves by hand keeps to no steady motion as closely as its poses are known: they are then believed less.
    BELIEVED.iter().find_map(|share| {
        let poses: Vec<_> =
            window.iter().map(|pose| PoseMeasurement { information: pose.information * *share, ..*pose }).collect();
        let mut filter = Filter::start(options, priors.clone(), &poses)?;
        let counts = filter.counts();
        let is_unsteady = *share < 1.0 || counts.rejected * UNSTEADY_START > counts.full + counts.soft;
        if let Some(newest) = window.last().filter(|_| is_unsteady) {
            // The steady motion of most of them passes by where the target is now: measured 1.7° and 17 mm.
            filter.disturb(&manoeuvre::MOST);
            filter.update(newest);
        }
        Some(filter)
    })
}

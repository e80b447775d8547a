//! What the estimation says of itself: where the pose's uncertainty comes from, and how the sensors' calibration stands.

use super::mounting::{ALARM, Disagreement, MountingCheck};
use super::state::{Mode, TargetState};
use crate::ukf::{Filter, SigmaBySource};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, SensorId};

/// The estimation as of its newest epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EstimateHealth {
    /// The newest epoch.
    pub epoch: u64,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// How much is known of the target.
    pub mode: Mode,
    /// Since when, ns on the session's timeline: the epoch with which it began. Predictions over less than a second do not
    /// end tracking.
    pub since_ns: i64,
    /// How the target spins; null: nobody knows, or no more than noise.
    pub spin: Option<SpinReport>,
    /// Where the pose's uncertainty comes from; null: nothing is tracked, or the filter does not tell the sources apart.
    pub sigma_by_source: Option<SigmaReport>,
    /// How late the stamps of Kinects are beyond what the config says.
    pub lateness: Vec<LatenessReport>,
    /// Sensors' mountings held against the reference's; empty while fewer than two sensors see the target.
    pub mountings: Vec<MountingReport>,
}

/// A spin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpinReport {
    /// The axis, of length 1, rig axes, right-handed.
    pub axis: [f64; 3],
    /// The rate, degrees a second, above 0.
    pub rate_dps: f64,
}

/// A pose's standard deviations by source. The squares of the sources add up to that of `total`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SigmaReport {
    /// Of the attitude, three axes together, degrees.
    pub attitude_deg: SigmaParts,
    /// Of the place of the target frame's origin, three axes together, mm.
    pub position_mm: SigmaParts,
}

/// Standard deviations by source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SigmaParts {
    /// Noise of the registrations, and of the motion.
    pub registration: f64,
    /// Slow errors: what registering to the model leaves, alike for some 30° of turning.
    pub model: f64,
    /// Constant errors: the mountings, a Kinect's depth scale and warp, the tilt of a LiDAR's beams.
    pub extrinsic: f64,
    /// How late a Kinect's stamps are.
    pub time: f64,
    /// All of it.
    pub total: f64,
}

/// How late a sensor's stamps are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LatenessReport {
    /// The sensor.
    pub sensor: String,
    /// Beyond `time_offset_ms`, ms: what to add to it.
    pub late_ms: f64,
    /// One standard deviation, ms.
    pub sigma_ms: f64,
}

/// A sensor's mounting held against the reference's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MountingReport {
    /// The sensor.
    pub sensor: String,
    /// The one it is held against. Which of the two is off cannot be seen.
    pub reference: String,
    /// Beyond what the stated σ explain.
    pub alarm: bool,
    /// Six on the average if the mountings are as well known as the config says.
    pub chi_square: f64,
    /// An alarm begins above this: one rig in 100 000 whose stated σ are right.
    pub alarm_above: f64,
    /// If the reference is right, the sensor is turned by so much from what the config says, degrees …
    pub turned_deg: f64,
    /// … about this axis, of length 1, rig axes, right-handed; zeros without a turn.
    pub about: [f64; 3],
    /// … and its origin is shifted by so much, mm, rig axes.
    pub shifted_mm: [f64; 3],
}

impl SigmaReport {
    fn new(sigma: &SigmaBySource) -> Self {
        let parts = |pick: fn((f64, f64)) -> f64, scale: f64| {
            let [registration, model, extrinsic, time] =
                [sigma.noise, sigma.slow, sigma.calibration, sigma.time].map(|part| pick(part) * scale);
            let squares = [registration, model, extrinsic, time].iter().map(|part| part * part).sum();
            SigmaParts { registration, model, extrinsic, time, total: libm::sqrt(squares) }
        };
        Self {
            attitude_deg: parts(|part| part.0, 180.0 / core::f64::consts::PI),
            position_mm: parts(|part| part.1, 1e3),
        }
    }
}

impl EstimateHealth {
    /// After an epoch's state, of a target that is tracked; `since` when it stands so; `names` are the sensors'.
    pub(super) fn new(
        (state, since): (&TargetState, RigNs),
        tracked: Option<(&Filter, &MountingCheck)>,
        names: &[&SensorId],
    ) -> Self {
        let found = tracked.map(|(_, mounting)| mounting.disagreements(state.t)).unwrap_or_default();
        Self {
            epoch: state.epoch,
            t_ns: state.t.0,
            mode: state.mode,
            since_ns: since.0,
            spin: state
                .motion
                .as_ref()
                .and_then(|motion| motion.spin)
                .map(|spin| SpinReport { axis: spin.axis.into(), rate_dps: spin.rate_rps.to_degrees() }),
            sigma_by_source: tracked.and_then(|(filter, _)| Some(SigmaReport::new(&filter.sigma_by_source()?))),
            lateness: tracked.map(|(filter, _)| LatenessReport::of(filter, names)).unwrap_or_default(),
            mountings: found.iter().filter_map(|found| MountingReport::new(found, names)).collect(),
        }
    }
}

impl LatenessReport {
    /// Of the sensors whose lateness a filter estimates.
    fn of(filter: &Filter, names: &[&SensorId]) -> Vec<Self> {
        let report = |(sensor, name): (usize, &&SensorId)| {
            let (late_s, sigma_s) = filter.lateness(sensor)?;
            Some(Self { sensor: name.to_string(), late_ms: late_s * 1e3, sigma_ms: sigma_s * 1e3 })
        };
        names.iter().enumerate().filter_map(report).collect()
    }
}

impl MountingReport {
    fn new(disagreement: &Disagreement, names: &[&SensorId]) -> Option<Self> {
        let turn = disagreement.correction.fixed_rows::<3>(0).into_owned();
        let shift = disagreement.correction.fixed_rows::<3>(3) * 1e3;
        Some(Self {
            sensor: names.get(disagreement.sensor)?.to_string(),
            reference: names.get(disagreement.reference)?.to_string(),
            alarm: disagreement.is_alarm,
            chi_square: disagreement.chi_square,
            alarm_above: ALARM,
            turned_deg: turn.norm().to_degrees(),
            about: turn.try_normalize(0.0).unwrap_or_default().into(),
            shifted_mm: [shift.x, shift.y, shift.z],
        })
    }

    /// In a sentence, for people.
    pub fn sentence(&self) -> String {
        let Self { sensor, reference, turned_deg, about: [x, y, z], shifted_mm: [a, b, c], chi_square, .. } = self;
        format!(
            "{sensor} and {reference} disagree by more than their mountings' stated σ explain (χ² {chi_square:.0}, 6 \
             expected): if {reference} is where the config says, {sensor} is turned by {turned_deg:.1}° about \
             ({x:.2}, {y:.2}, {z:.2}) and shifted by ({a:.0}, {b:.0}, {c:.0}) mm, rig axes; else {reference} the other \
             way. Check both mountings and their transforms in the config"
        )
    }
}

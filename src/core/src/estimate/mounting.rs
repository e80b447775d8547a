//! Whether the sensors are mounted as the config says: where each sees the target, held against the others.
//!
//! A mounting's error puts all that its sensor sees off by one twist e about the target's nominal centre (`ukf`). Of every
//! fit beyond doubt the apparent twist from the filter's pose to the fit's is averaged, **also of fits that the gate
//! refuses**: a sensor that was knocked may be refused, and the filter's own calibration never learns of it. The filter's
//! pose, whoever holds it, cancels in the difference of two sensors' means,
//!
//! ```text
//!   d = e_b − Ad e_a,   D = Σ_b + Ad Σ_a Adᵀ,   q = dᵀ D⁻¹ d
//! ```
//! with Σ the prior of e (stated mounting, warp, scale, beams' tilt) and what the mean leaves of the sensor's slow error:
//! of variance σ_b² and forgotten over the angle θ_c, a mean over the angle A leaves less than `σ_b² θ_c / (θ_c + A/2)`. The
//! beams' biases lie along the rays, so that their tilt lies across the line of sight and hardly about it.
//!
//! If the stated σ are right, q is χ² of six degrees of freedom, **once for a rig**: e is constant, so that time gives no
//! further draws. Above [`ALARM`] lies one rig in 100 000; below [`CLEAR`] an alarm ends (one in 1 000 lies above).

use crate::register::SensorKind;
use crate::ukf::{BEAM_TILT_RAD, FilterOptions, SensorPrior};
use nalgebra::{Isometry3, Matrix6, UnitQuaternion, Vector6};
use tumbled_model::se3::adjoint;
use tumbled_model::{RigNs, Twist};

/// χ² of six degrees of freedom that one in 100 000 exceeds.
pub(super) const ALARM: f64 = 33.1;
/// The same of one in 1 000.
const CLEAR: f64 = 22.5;
/// Fits of a sensor before it is held against others.
const LEAST_FITS: u32 = 15;
/// Fits are averaged over so long, s.
const MEAN_S: f64 = 20.0;
/// Of the beams' tilt, what may lie about the line of sight, rad: 0.1°.
const TILT_ABOUT_SIGHT_RAD: f64 = 0.1 / 180.0 * core::f64::consts::PI;
/// A sensor without a fit for so long is not held against others, s.
const RECENT_S: f64 = 3.0;

/// By how much a sensor seems to be mounted otherwise than the config says, if the reference is right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Disagreement {
    /// Which sensor.
    pub(super) sensor: usize,
    /// Held against which.
    pub(super) reference: usize,
    /// q: six if the mountings are as well known as the config says.
    pub(super) chi_square: f64,
    /// What would put it right: the mounting in the config, changed by this about its own origin, rig axes; rotation, rad,
    /// then shift, m.
    pub(super) correction: Vector6<f64>,
    /// Whether it is beyond what the stated σ explain.
    pub(super) is_alarm: bool,
}

/// What one sensor showed.
#[derive(Clone, Copy, Debug, Default)]
struct Shown {
    /// Mean apparent twist, axes of the prior's `nominal`.
    mean: Vector6<f64>,
    fits: u32,
    /// The newest fit's time and the filter's rotation then.
    last: Option<(RigNs, UnitQuaternion<f64>)>,
    /// The angle that the target turned while the mean was made, rad.
    turned_rad: f64,
}

/// The check of one target's sensors.
#[derive(Clone, Debug)]
pub(super) struct MountingCheck {
    priors: Vec<SensorPrior>,
    /// Sensor to rig, as the config says.
    mountings: Vec<Isometry3<f64>>,
    reference: usize,
    shown: Vec<Shown>,
    alarms: Vec<bool>,
}

impl MountingCheck {
    /// Of sensors with their priors and mountings; the first LiDAR is the reference, as it makes the rig's frame, else the
    /// first sensor.
    pub(super) fn new(priors: Vec<SensorPrior>, mountings: Vec<Isometry3<f64>>) -> Self {
        let is_lidar = |prior: &SensorPrior| prior.kind == SensorKind::Lidar;
        let reference = priors.iter().position(is_lidar).unwrap_or(0);
        let sensors = priors.len();
        Self { priors, mountings, reference, shown: vec![Shown::default(); sensors], alarms: vec![false; sensors] }
    }

    /// A fit beyond doubt of a sensor, and the filter's pose of its time.
    pub(super) fn take(&mut self, sensor: usize, t: RigNs, filter: &Isometry3<f64>, fit: &Isometry3<f64>) {
        let (Some(prior), Some(shown)) = (self.priors.get(sensor), self.shown.get_mut(sensor)) else { return };
        // Exp_C(e) T̂ = Z: e = Log(C⁻¹ Z T̂⁻¹ C).
        let apparent = Twist::log(&(prior.nominal.inv_mul(fit) * filter.inv_mul(&prior.nominal))).vector();
        let (since_s, turned) =
            shown.last.map_or((0.0, 0.0), |(last, pose)| ((t - last).as_secs_f64(), pose.angle_to(&filter.rotation)));
        shown.last = Some((t, filter.rotation));
        shown.fits = shown.fits.saturating_add(1);
        let forgotten = (since_s / MEAN_S).clamp(0.0, 1.0);
        shown.turned_rad = shown.turned_rad * (1.0 - forgotten) + turned;
        let share = forgotten.max(1.0 / f64::from(shown.fits));
        shown.mean += (apparent - shown.mean) * share;
        for other in 0..self.priors.len() {
            let alarm = self.judge(other, t).is_some_and(|(_, q)| q > if self.raised(other) { CLEAR } else { ALARM });
            if let Some(raised) = self.alarms.get_mut(other) {
                *raised = alarm;
            }
        }
    }

    fn raised(&self, sensor: usize) -> bool {
        self.alarms.get(sensor).copied().unwrap_or(false)
    }

    /// Whether any sensor's mounting is beyond what the stated σ explain.
    pub(super) fn is_alarm(&self) -> bool {
        self.alarms.contains(&true)
    }

    /// Every sensor that was held against the reference.
    pub(super) fn disagreements(&self, t: RigNs) -> Vec<Disagreement> {
        let of_sensor = |sensor: usize| {
            let (twist, chi_square) = self.judge(sensor, t)?;
            let (prior, mounting) = (self.priors.get(sensor)?, self.mountings.get(sensor)?);
            // What the sensor sees lies off by Exp_C(d): its true mounting is the file's, moved back.
            let back = prior.nominal * Twist::from_vector(&-twist).exp() * prior.nominal.inverse();
            let rotation = back.rotation.scaled_axis();
            let shift = (back * mounting).translation.vector - mounting.translation.vector;
            let correction = Vector6::new(rotation.x, rotation.y, rotation.z, shift.x, shift.y, shift.z);
            let (reference, is_alarm) = (self.reference, self.raised(sensor));
            Some(Disagreement { sensor, reference, chi_square, correction, is_alarm })
        };
        (0..self.priors.len()).filter_map(of_sensor).collect()
    }

    /// d and q of a sensor against the reference; `None`: not both have shown enough.
    fn judge(&self, sensor: usize, t: RigNs) -> Option<(Vector6<f64>, f64)> {
        if sensor == self.reference {
            return None;
        }
        let ready = |sensor: usize| {
            let shown = self.shown.get(sensor)?;
            let is_recent = shown.last.is_some_and(|(last, _)| (t - last).as_secs_f64() < RECENT_S);
            (is_recent && shown.fits >= LEAST_FITS).then_some(shown.mean)
        };
        let (own, other) = (ready(sensor)?, ready(self.reference)?);
        let (nominal_own, nominal_other) = (self.priors.get(sensor)?.nominal, self.priors.get(self.reference)?.nominal);
        let map = adjoint(&nominal_own.inv_mul(&nominal_other));
        let d = own - map * other;
        let covariance = self.believed(sensor)? + map * self.believed(self.reference)? * map.transpose();
        Some((d, d.dot(&covariance.cholesky()?.solve(&d))))
    }

    /// How far a sensor's mean may be off zero: its constant error and what is left of its slow one.
    fn believed(&self, sensor: usize) -> Option<Matrix6<f64>> {
        let (prior, mounting) = (self.priors.get(sensor)?, self.mountings.get(sensor)?);
        let angle = FilterOptions::default().correlation_angle_rad;
        let left = angle / (angle + 0.5 * self.shown.get(sensor)?.turned_rad);
        // The slow errors are alike along every axis of the body, and the nominal centre lies in it.
        let variance = prior.sigma_e.zip_map(&prior.sigma_b, |e, b| e * e + b * b * left);
        let mut covariance = Matrix6::from_diagonal(&variance);
        if prior.kind == SensorKind::Lidar {
            let sight = prior.nominal.translation.vector - mounting.translation.vector;
            let along = (prior.nominal.rotation.inverse() * sight).try_normalize(0.0)?;
            let less = BEAM_TILT_RAD * BEAM_TILT_RAD - TILT_ABOUT_SIGHT_RAD * TILT_ABOUT_SIGHT_RAD;
            let mut rotation = covariance.fixed_view_mut::<3, 3>(0, 0);
            rotation -= along * along.transpose() * less;
        }
        Some(covariance)
    }
}

#[cfg(test)]
mod tests;

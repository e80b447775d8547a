//! Errors against a turntable's encoder, whose axis in the rig nobody knows: what turns about the estimate's own axis.

use super::pose::ScalarErrors;
use super::{EstimateSample, EvaluateError, EvaluateOptions, check_order};
use core::f64::consts::{PI, TAU};
use nalgebra::{UnitQuaternion, Vector3};
use tumbled_model::se3::log_rotation;
use tumbled_model::{RigNs, Span};

/// Readings farther apart say nothing of what was between them.
const LONGEST_GAP: Span = Span(500_000_000);
/// The encoder's rate is its difference over so long to both sides: a reading's own noise stays small against it.
const STEP: Span = Span(250_000_000);
/// Estimates that turn less have no axis, rad.
const LEAST_TRAVEL: f64 = 5.0 / 180.0 * PI;

/// Where the turntable was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderSample {
    /// When.
    pub t: RigNs,
    /// Not wrapped, rad; either sense.
    pub angle_rad: f64,
}

/// How well estimates follow a turntable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurntableEvaluation {
    /// Estimates scored: in the interval, with the encoder known at their time.
    pub scored: u32,
    /// Estimates not scored.
    pub left_out: u32,
    /// The times of the first and the last one scored.
    pub span: (RigNs, RigNs),
    /// How far the table turned between them, rad.
    pub travel_rad: f64,
    /// The axis that all the estimated turning was about, rig axes, of length 1.
    pub axis: Vector3<f64>,
    /// Angle turned about that axis, less the encoder's and the mean of that, rad; `mean` is therefore 0.
    pub about_axis_rad: ScalarErrors,
    /// How far the target's own attitude tilts off that axis, r.m.s. about the mean, rad. A true turntable has none.
    pub tilt_rms_rad: f64,
    /// Angle between each estimate's spin axis and that axis, rad: the cone.
    pub cone_rad: ScalarErrors,
    /// Estimated rate |ω| less the encoder's, rad/s.
    pub rate_rps: ScalarErrors,
}

/// Scores estimates, in the order of their times, against the encoder's readings, in the order of theirs.
///
/// # Errors
/// [`EvaluateError`]: too few of either, not in order, or a target that does not turn.
pub fn evaluate_turntable(
    estimates: &[EstimateSample],
    encoder: &[EncoderSample],
    options: &EvaluateOptions,
) -> Result<TurntableEvaluation, EvaluateError> {
    check_order(estimates)?;
    check_encoder(encoder)?;
    let is_scored = |estimate: &&EstimateSample| options.from.is_none_or(|from| estimate.t >= from);
    let scored = estimates.iter().filter(is_scored);
    let pairs: Vec<(&EstimateSample, f64)> =
        scored.filter_map(|estimate| Some((estimate, angle_at(encoder, estimate.t)?))).collect();
    let ends = pairs.first().zip(pairs.last()).filter(|_| pairs.len() >= 2);
    let Some(((first, from), (last, to))) = ends else {
        return Err(EvaluateError::FewEstimates { found: pairs.len(), estimates: estimates.len() });
    };
    let turned = turned(&pairs);
    let Some(axis) = turned.try_normalize(LEAST_TRAVEL) else {
        return Err(EvaluateError::NoTurn { travel_deg: turned.norm().to_degrees() as u32 });
    };
    // The axis is the sense in which the target turns; the encoder may count the other way.
    let sense = if to < from { -1.0 } else { 1.0 };
    let start = first.t_rig_target.rotation;
    let (mut errors, mut tilts) = (Vec::with_capacity(pairs.len()), Vec::with_capacity(pairs.len()));
    for (estimate, encoder) in &pairs {
        let (about, tilt) = split(&(estimate.t_rig_target.rotation * start.inverse()), &axis);
        let error = about - sense * (encoder - from);
        // Of the angles a turn apart the one that the encoder is nearest to.
        errors.push(error - TAU * libm::round(error / TAU));
        tilts.push(tilt);
    }
    let count = pairs.len() as f64;
    let mean_error = errors.iter().sum::<f64>() / count;
    let mean_tilt = tilts.iter().sum::<Vector3<f64>>() / count;
    let tilt_square = tilts.iter().map(|tilt| (tilt - mean_tilt).norm_squared()).sum::<f64>() / count;
    let rates = pairs
        .iter()
        .filter_map(|(estimate, _)| Some(estimate.angular_velocity_rps.norm() - rate_at(encoder, estimate.t)?.abs()));
    let cones = pairs.iter().map(|(estimate, _)| super::angle(&estimate.angular_velocity_rps, &axis));
    Ok(TurntableEvaluation {
        scored: pairs.len() as u32,
        left_out: (estimates.len() - pairs.len()) as u32,
        span: (first.t, last.t),
        travel_rad: (to - from).abs(),
        axis,
        about_axis_rad: ScalarErrors::of(errors.iter().map(|error| error - mean_error)).unwrap_or_default(),
        tilt_rms_rad: libm::sqrt(tilt_square),
        cone_rad: ScalarErrors::of(cones).unwrap_or_default(),
        rate_rps: ScalarErrors::of(rates).unwrap_or_default(),
    })
}

/// The sum of the rotation vectors from estimate to estimate, rig axes: of its steps' noise only the ends' stays.
fn turned(pairs: &[(&EstimateSample, f64)]) -> Vector3<f64> {
    let rotation = |(estimate, _): &(&EstimateSample, f64)| estimate.t_rig_target.rotation;
    let steps = pairs.iter().zip(pairs.iter().skip(1));
    steps.map(|(before, after)| log_rotation(&(rotation(after) * rotation(before).inverse()))).sum()
}

/// A rotation as one about the axis, rad in −π..=π, after a tilt across it, a rotation vector.
fn split(rotation: &UnitQuaternion<f64>, axis: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let along = rotation.imag().dot(axis);
    let about = 2.0 * libm::atan2(along, rotation.w);
    let about = about - TAU * libm::round(about / TAU);
    let twist = UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_unchecked(*axis), about);
    (about, log_rotation(&(twist.inverse() * rotation)))
}

fn check_encoder(encoder: &[EncoderSample]) -> Result<(), EvaluateError> {
    if encoder.len() < 2 {
        return Err(EvaluateError::FewTruth { found: encoder.len() });
    }
    let pairs = encoder.iter().zip(encoder.iter().skip(1));
    match pairs.zip(1..).find(|((before, after), _)| before.t >= after.t) {
        Some((_, sample)) => Err(EvaluateError::TruthOutOfOrder { sample }),
        None => Ok(()),
    }
}

/// Between readings a straight line; `None`: outside them or in a gap.
fn angle_at(encoder: &[EncoderSample], t: RigNs) -> Option<f64> {
    let next = encoder.partition_point(|sample| sample.t <= t);
    let before = encoder.get(next.checked_sub(1)?)?;
    if before.t == t {
        return Some(before.angle_rad);
    }
    let after = encoder.get(next)?;
    let gap = after.t - before.t;
    let share = (t - before.t).as_secs_f64() / gap.as_secs_f64();
    (gap <= LONGEST_GAP).then_some(before.angle_rad + share * (after.angle_rad - before.angle_rad))
}

fn rate_at(encoder: &[EncoderSample], t: RigNs) -> Option<f64> {
    let (before, after) = (angle_at(encoder, t - STEP)?, angle_at(encoder, t + STEP)?);
    Some((after - before) / (2.0 * STEP.as_secs_f64()))
}

//! Errors against full poses.

use super::consistency::{Consistency, Error12, NormalisedMean, consistency, normalised};
use super::gauge::mean_gauge;
use super::trajectory::{Trajectory, TruthAt};
use super::{EstimateSample, EvaluateError, EvaluateOptions, angle, check_order};
use nalgebra::{Isometry3, Vector3};
use tumbled_model::{RigNs, Span, Twist};

/// The first estimates, by which their frame is aligned once.
const FIRST: Span = Span(1_000_000_000);
/// Slow errors of a pose are correlated over so much of a turn, rad (30°): farther on, an estimate tells something new.
const CORRELATED: f64 = core::f64::consts::PI / 6.0;

/// How the estimate's target frame was laid on the truth's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alignment {
    /// The mean body twist of the error over the scored interval is removed.
    MeanTwist,
    /// The same over the first second of all estimates.
    FirstSecond,
    /// By [`EvaluateOptions::gauge`].
    Given,
}

/// How good the estimates are.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Estimates scored: in the interval, with truth at their time.
    pub scored: u32,
    /// Estimates not scored.
    pub left_out: u32,
    /// The times of the first and the last one scored.
    pub span: (RigNs, RigNs),
    /// How far the target truly turned between them, rad.
    pub travel_rad: f64,
    /// By the mean twist; then by the first second, where the truth covers it; then by the given gauge, where one is.
    pub aligned: Vec<Aligned>,
    /// Errors that no alignment changes.
    pub motion: MotionErrors,
    /// Mean of the innovations' normalised squares: 6 if the measurements are as good as believed.
    pub nis: Option<NormalisedMean>,
    /// Error by error, by the mean twist's alignment, each with the number of its estimate: of every estimate with truth,
    /// those before the interval too.
    pub series: Vec<(usize, ErrorSample)>,
}

/// The figures of one alignment.
#[derive(Clone, Debug, PartialEq)]
pub struct Aligned {
    /// Which.
    pub alignment: Alignment,
    /// Truth's target frame to the estimate's: estimate ≈ truth · gauge.
    pub gauge: Isometry3<f64>,
    /// Of the poses.
    pub pose: PoseErrors,
    /// Of the covariances, where the estimates have some.
    pub consistency: Option<Consistency>,
}

/// Errors of poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseErrors {
    /// The whole angle, r.m.s., rad.
    pub attitude_rms_rad: f64,
    /// The largest, rad.
    pub attitude_max_rad: f64,
    /// The part about the true spin axis, r.m.s., rad; of estimates while the target turns.
    pub about_axis_rms_rad: f64,
    /// The part across it, r.m.s., rad.
    pub across_axis_rms_rad: f64,
    /// Of the origin, about the mean offset, rig axes, r.m.s. of the whole length, m.
    pub position_rms_m: f64,
    /// The mean offset, estimate less truth, rig axes, m.
    pub position_offset_m: Vector3<f64>,
    /// Of the origin's velocity, r.m.s. of the whole length, m/s.
    pub velocity_rms_mps: f64,
}

/// A number's errors, estimate less truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScalarErrors {
    /// Mean.
    pub mean: f64,
    /// Root mean square.
    pub rms: f64,
    /// The largest without its sign.
    pub max: f64,
    /// Of the last estimate scored.
    pub end: f64,
}

/// Errors of the motion in rig axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionErrors {
    /// Angle between estimated and true spin axis, rad.
    pub axis_rad: ScalarErrors,
    /// Of the rate |ω|, rad/s.
    pub rate_rps: ScalarErrors,
    /// Angle between estimated and true angular momentum, rad, where both are known.
    pub momentum_rad: Option<ScalarErrors>,
}

/// The errors of one estimate, estimate less truth, in rig axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSample {
    /// When.
    pub t: RigNs,
    /// Rotation vector, rad.
    pub attitude_rad: Vector3<f64>,
    /// Of the origin, mean offset left, m.
    pub position_m: Vector3<f64>,
    /// Of the origin, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Angle between the spin axes, rad.
    pub axis_rad: f64,
    /// Of the rate, rad/s.
    pub rate_rps: f64,
    /// Of twelve degrees of freedom, where there is a covariance.
    pub nees12: Option<f64>,
    /// As estimated.
    pub nis: Option<f64>,
}

/// An estimate with the truth of its time.
type Pair<'a> = (&'a EstimateSample, TruthAt);

/// Scores estimates, in the order of their times, against the truth.
///
/// # Errors
/// [`EvaluateError::EstimatesOutOfOrder`]; [`EvaluateError::FewEstimates`]: not two of them can be scored.
pub fn evaluate(
    estimates: &[EstimateSample],
    truth: &Trajectory,
    options: &EvaluateOptions,
) -> Result<Evaluation, EvaluateError> {
    check_order(estimates)?;
    let is_scored = |estimate: &&EstimateSample| options.from.is_none_or(|from| estimate.t >= from);
    let pairs: Vec<Pair<'_>> =
        estimates.iter().filter(is_scored).filter_map(|estimate| with_truth(estimate, truth)).collect();
    let ends = pairs.first().zip(pairs.last()).filter(|_| pairs.len() >= 2);
    let Some(((first, _), (last, _))) = ends else {
        return Err(EvaluateError::FewEstimates { found: pairs.len(), estimates: estimates.len() });
    };
    let travel_rad = travel(&pairs);
    let independent = 1 + (travel_rad / CORRELATED) as u32;
    let begin = estimates.first().map_or(first.t, |estimate| estimate.t);
    let early = estimates.iter().take_while(|estimate| estimate.t - begin <= FIRST);
    let early: Vec<Pair<'_>> = early.filter_map(|estimate| with_truth(estimate, truth)).collect();
    let gauges = [
        (Alignment::MeanTwist, gauge_of(&pairs)),
        (Alignment::FirstSecond, gauge_of(&early)),
        (Alignment::Given, options.gauge),
    ];
    let with_gauge = gauges.into_iter().filter_map(|(alignment, gauge)| Some((alignment, gauge?)));
    let aligned: Vec<Aligned> =
        with_gauge.map(|(alignment, gauge)| align(&pairs, alignment, gauge, independent)).collect();
    let gauge = aligned.first().map_or_else(Isometry3::identity, |mean| mean.gauge);
    let numbered = estimates.iter().enumerate();
    let numbered = numbered.filter_map(|(number, estimate)| Some((number, with_truth(estimate, truth)?)));
    Ok(Evaluation {
        scored: pairs.len() as u32,
        left_out: (estimates.len() - pairs.len()) as u32,
        span: (first.t, last.t),
        travel_rad,
        motion: motion(&pairs, options.momentum),
        // Innovations are white: each one tells something new.
        nis: NormalisedMean::of(pairs.iter().filter_map(|(estimate, _)| estimate.nis), 6, pairs.len() as u32),
        series: numbered.map(|(number, pair)| (number, sample(&pair, &gauge))).collect(),
        aligned,
    })
}

fn with_truth<'a>(estimate: &'a EstimateSample, truth: &Trajectory) -> Option<Pair<'a>> {
    Some((estimate, truth.at(estimate.t)?))
}

fn gauge_of(pairs: &[Pair<'_>]) -> Option<Isometry3<f64>> {
    mean_gauge(pairs.iter().map(|(estimate, truth)| (&truth.pose, &estimate.t_rig_target)))
}

/// By the true rates, trapezoids between the estimates.
fn travel(pairs: &[Pair<'_>]) -> f64 {
    let rate = |truth: &TruthAt| truth.angular_velocity.norm();
    let steps = pairs.iter().zip(pairs.iter().skip(1));
    steps.map(|((a, at_a), (b, at_b))| 0.5 * (rate(at_a) + rate(at_b)) * (b.t - a.t).as_secs_f64()).sum()
}

/// What the truth says of the estimate's own target frame: its pose, and its origin's velocity.
fn moved(truth: &TruthAt, gauge: &Isometry3<f64>) -> (Isometry3<f64>, Vector3<f64>) {
    let arm = truth.pose.rotation * gauge.translation.vector;
    (truth.pose * gauge, truth.velocity + truth.angular_velocity.cross(&arm))
}

/// Truth less estimate, in the covariance's order.
fn error((estimate, truth): &Pair<'_>, gauge: &Isometry3<f64>) -> Error12 {
    let (pose, velocity) = moved(truth, gauge);
    let mut error = Error12::zeros();
    error.fixed_rows_mut::<6>(0).copy_from(&Twist::log(&(estimate.t_rig_target.inverse() * pose)).vector());
    error.fixed_rows_mut::<3>(6).copy_from(&(velocity - estimate.velocity_mps));
    error.fixed_rows_mut::<3>(9).copy_from(&(truth.angular_velocity - estimate.angular_velocity_rps));
    error
}

fn sample(pair: &Pair<'_>, gauge: &Isometry3<f64>) -> ErrorSample {
    let (estimate, truth) = pair;
    let error = error(pair, gauge);
    let (pose, velocity) = moved(truth, gauge);
    let turn: Vector3<f64> = error.fixed_rows::<3>(0).into();
    let nees = estimate.covariance.as_ref().and_then(|covariance| normalised(&error, covariance));
    ErrorSample {
        t: estimate.t,
        attitude_rad: estimate.t_rig_target.rotation * -turn,
        position_m: estimate.t_rig_target.translation.vector - pose.translation.vector,
        velocity_mps: estimate.velocity_mps - velocity,
        axis_rad: angle(&estimate.angular_velocity_rps, &truth.angular_velocity),
        rate_rps: estimate.angular_velocity_rps.norm() - truth.angular_velocity.norm(),
        nees12: nees.map(|(twelve, _)| twelve),
        nis: estimate.nis,
    }
}

fn align(pairs: &[Pair<'_>], alignment: Alignment, gauge: Isometry3<f64>, independent: u32) -> Aligned {
    let samples: Vec<ErrorSample> = pairs.iter().map(|pair| sample(pair, &gauge)).collect();
    let count = samples.len().max(1) as f64;
    let offset = samples.iter().map(|sample| sample.position_m).sum::<Vector3<f64>>() / count;
    let rms = |of: &dyn Fn(&ErrorSample) -> Vector3<f64>| {
        libm::sqrt(samples.iter().map(|sample| of(sample).norm_squared()).sum::<f64>() / count)
    };
    let (mut about, mut across, mut turning) = (0.0, 0.0, 0.0);
    for ((_, truth), sample) in pairs.iter().zip(&samples) {
        let Some(axis) = truth.angular_velocity.try_normalize(1e-9) else { continue };
        let along = sample.attitude_rad.dot(&axis);
        about += along * along;
        across += (sample.attitude_rad - axis * along).norm_squared();
        turning += 1.0;
    }
    let turning = f64::max(turning, 1.0);
    let errors: Vec<Error12> = pairs.iter().map(|pair| error(pair, &gauge)).collect();
    let stated = errors.iter().zip(pairs).filter_map(|(e, (estimate, _))| Some((e, estimate.covariance.as_ref()?)));
    Aligned {
        alignment,
        gauge,
        pose: PoseErrors {
            attitude_rms_rad: rms(&|sample| sample.attitude_rad),
            attitude_max_rad: samples.iter().map(|sample| sample.attitude_rad.norm()).fold(0.0, f64::max),
            about_axis_rms_rad: libm::sqrt(about / turning),
            across_axis_rms_rad: libm::sqrt(across / turning),
            position_rms_m: rms(&|sample| sample.position_m - offset),
            position_offset_m: offset,
            velocity_rms_mps: rms(&|sample| sample.velocity_mps),
        },
        consistency: consistency(stated, independent),
    }
}

fn motion(pairs: &[Pair<'_>], momentum: Option<Vector3<f64>>) -> MotionErrors {
    let axis = |(estimate, truth): &Pair<'_>| angle(&estimate.angular_velocity_rps, &truth.angular_velocity);
    let rate = |(estimate, truth): &Pair<'_>| estimate.angular_velocity_rps.norm() - truth.angular_velocity.norm();
    let directions = pairs.iter().filter_map(|(estimate, _)| Some(angle(&estimate.momentum?, &momentum?)));
    MotionErrors {
        axis_rad: ScalarErrors::of(pairs.iter().map(axis)).unwrap_or_default(),
        rate_rps: ScalarErrors::of(pairs.iter().map(rate)).unwrap_or_default(),
        momentum_rad: ScalarErrors::of(directions),
    }
}

impl ScalarErrors {
    /// `None`: no error.
    pub(super) fn of(errors: impl Iterator<Item = f64>) -> Option<Self> {
        let (mut found, mut count) = (Self::default(), 0.0);
        for error in errors {
            found.mean += error;
            found.rms += error * error;
            found.max = found.max.max(error.abs());
            found.end = error;
            count += 1.0;
        }
        (count > 0.0).then(|| Self { mean: found.mean / count, rms: libm::sqrt(found.rms / count), ..found })
    }
}

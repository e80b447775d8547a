//! Errors against a turntable's encoder, whose axis in the rig nobody knows: what turns about the estimate's own axis.

use super::consistency::NormalisedMean;
use super::pose::ScalarErrors;
use super::{EstimateSample, EvaluateError, EvaluateOptions, check_order};
use core::f64::consts::PI;
use nalgebra::{UnitQuaternion, Vector3};
use tumbled_model::se3::{less_turns, log_rotation, turned_about};
use tumbled_model::{RigNs, Span};

/// Readings farther apart say nothing of what was between them.
const LONGEST_GAP: Span = Span(500_000_000);
/// The encoder's rate is its difference over so long to both sides: a reading's own noise stays small against it.
const STEP: Span = Span(250_000_000);
/// A table that turns more slowly rests, rad/s (0.5 °/s).
const AT_REST: f64 = 0.5 / 180.0 * PI;
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
#[derive(Clone, Debug, PartialEq)]
pub struct TurntableEvaluation {
    /// Estimates scored: in the interval, with the encoder known at their time.
    pub scored: u32,
    /// Estimates not scored.
    pub left_out: u32,
    /// The times of the first and the last one scored.
    pub span: (RigNs, RigNs),
    /// How far the table turned between them, rad, to and fro added.
    pub travel_rad: f64,
    /// The axis that all the estimated turning was about, rig axes, of length 1, in the sense in which the table turned at
    /// the end more than at the begin; turning back counts too.
    pub axis: Vector3<f64>,
    /// Angle turned about that axis, less the encoder's and the mean of that, rad; `mean` is therefore 0.
    pub about_axis_rad: ScalarErrors,
    /// How far the target's own attitude tilts off that axis, r.m.s. about the mean, rad. A true turntable has none.
    pub tilt_rms_rad: f64,
    /// Angle between each estimate's spin axis and that axis, rad: the cone. Of estimates at which the table turned.
    pub cone_rad: ScalarErrors,
    /// Estimated rate |ω| less the encoder's, rad/s.
    pub rate_rps: ScalarErrors,
    /// Mean of the innovations' normalised squares: 6 if the measurements are as good as believed.
    pub nis: Option<NormalisedMean>,
    /// Error by error, each with the number of its estimate: of every estimate whose angle is known, those before the
    /// interval too.
    pub series: Vec<(usize, TurntableError)>,
}

/// The errors of one estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurntableError {
    /// When.
    pub t: RigNs,
    /// About the axis, less the mean of those scored, rad in −π..=π.
    pub about_axis_rad: f64,
    /// Across it, less the mean of those scored, rad.
    pub tilt_rad: f64,
    /// Angle between its spin axis and the axis, rad; `None`: the table rested, or nobody knows.
    pub cone_rad: Option<f64>,
    /// Of the rate, rad/s; `None`: at the encoder's ends and gaps nobody knows it.
    pub rate_rps: Option<f64>,
    /// As estimated.
    pub nis: Option<f64>,
}

/// An estimate with the encoder's angle at its time, rad.
type Pair<'a> = (&'a EstimateSample, f64);

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
    let numbered = estimates.iter().enumerate();
    let known: Vec<(usize, Pair<'_>)> =
        numbered.filter_map(|(number, estimate)| Some((number, (estimate, angle_at(encoder, estimate.t)?)))).collect();
    let is_scored = |(estimate, _): &Pair<'_>| options.from.is_none_or(|from| estimate.t >= from);
    let pairs: Vec<Pair<'_>> = known.iter().map(|(_, pair)| *pair).filter(is_scored).collect();
    let ends = pairs.first().zip(pairs.last()).filter(|_| pairs.len() >= 2);
    let Some((first, last)) = ends else {
        return Err(EvaluateError::FewEstimates { found: pairs.len(), estimates: estimates.len() });
    };
    let turned = turned(&pairs);
    let travel_rad = pairs.iter().zip(pairs.iter().skip(1)).map(|(before, after)| (after.1 - before.1).abs()).sum();
    let Some(axis) = turned.try_normalize(LEAST_TRAVEL) else {
        return Err(EvaluateError::NoTurn { travel_deg: turned.norm().to_degrees() as u32 });
    };
    // The axis is the sense in which the target turns; the encoder may count the other way.
    let sense = if last.1 < first.1 { -1.0 } else { 1.0 };
    let axis = axis * sense;
    let from = |pair: &Pair<'_>| turn_from(first, pair, sense, &axis);
    let count = pairs.len() as f64;
    let (mut mean_error, mut mean_tilt) = (0.0, Vector3::zeros());
    for (error, tilt) in pairs.iter().map(from) {
        mean_error += error / count;
        mean_tilt += tilt / count;
    }
    let series = known.iter().map(|(number, pair)| {
        let (estimate, (error, tilt)) = (pair.0, from(pair));
        let table_rps = rate_at(encoder, estimate.t);
        let spin_axis = |rate: f64| axis * (sense * rate).signum();
        let error = TurntableError {
            t: estimate.t,
            about_axis_rad: less_turns(error - mean_error),
            tilt_rad: (tilt - mean_tilt).norm(),
            cone_rad: table_rps
                .filter(|rate| rate.abs() >= AT_REST)
                .map(|rate| super::angle(&estimate.angular_velocity_rps, &spin_axis(rate))),
            rate_rps: table_rps.map(|rate| estimate.angular_velocity_rps.norm() - rate.abs()),
            nis: estimate.nis,
        };
        (*number, error)
    });
    let series: Vec<(usize, TurntableError)> = series.collect();
    // Those scored are the last ones: estimates are in the order of their times.
    let scored = || series.iter().skip(series.len() - pairs.len()).map(|(_, error)| error);
    let of =
        |what: &dyn Fn(&TurntableError) -> Option<f64>| ScalarErrors::of(scored().filter_map(what)).unwrap_or_default();
    Ok(TurntableEvaluation {
        scored: pairs.len() as u32,
        left_out: (estimates.len() - pairs.len()) as u32,
        span: (first.0.t, last.0.t),
        travel_rad,
        axis,
        about_axis_rad: of(&|error| Some(error.about_axis_rad)),
        tilt_rms_rad: of(&|error| Some(error.tilt_rad)).rms,
        cone_rad: of(&|error| error.cone_rad),
        rate_rps: of(&|error| error.rate_rps),
        nis: NormalisedMean::of(scored().filter_map(|error| error.nis), 6, pairs.len() as u32),
        series,
    })
}

/// How far an estimate is turned from the first one about the axis, rad, less what the encoder says, in −π..=π; and across
/// it, a rotation vector.
fn turn_from(first: &Pair<'_>, pair: &Pair<'_>, sense: f64, axis: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let rotation = pair.0.t_rig_target.rotation * first.0.t_rig_target.rotation.inverse();
    let (about, tilt) = split(&rotation, axis);
    (less_turns(about - sense * (pair.1 - first.1)), tilt)
}

/// The sum of the rotation vectors from estimate to estimate, rig axes, those backwards by the encoder turned round: of a way
/// in one sense only the ends' noise stays.
fn turned(pairs: &[Pair<'_>]) -> Vector3<f64> {
    let rotation = |(estimate, _): &Pair<'_>| estimate.t_rig_target.rotation;
    let steps = pairs.iter().zip(pairs.iter().skip(1));
    let step = |(before, after): (&Pair<'_>, &Pair<'_>)| {
        let sense = if after.1 < before.1 { -1.0 } else { 1.0 };
        log_rotation(&(rotation(after) * rotation(before).inverse())) * sense
    };
    steps.map(step).sum()
}

/// A rotation as one about the axis, rad in −π..=π, after a tilt across it, a rotation vector.
fn split(rotation: &UnitQuaternion<f64>, axis: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let about = less_turns(turned_about(rotation, axis));
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

/// The encoder's angle at a time, rad: between readings, in the order of their times, a straight line; `None`: outside
/// them or in a gap of more than half a second.
pub fn angle_at(encoder: &[EncoderSample], t: RigNs) -> Option<f64> {
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

//! Gathered states against a truth.

use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use tumbled_core::evaluate::{
    EncoderSample, EstimateSample, EvaluateError, EvaluateOptions, Evaluation, Trajectory, TurntableEvaluation,
    evaluate, evaluate_turntable,
};
use tumbled_model::{RigNs, UnixNs};

use super::figures::{MeanSquare, TruthFigures, TurntableFigures};
use super::gather::Gathered;
use super::interval::{AT_REST, Travel};
use super::report::{Scored, TruthClock, TruthSource};
use super::truth::TimedTruth;
use crate::cli::Failure;
use crate::experiment::bounds::Share;

/// Farther off than this, rad, a state that says `tracking` and `ok` is wrong: 10°.
const WRONG: f64 = 10.0 / 360.0 * TAU;

/// From when on states are scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum From {
    /// Session time.
    At(RigNs),
    /// After so many turns of the target since it was first tracked.
    Turns(f64),
}

/// What is scored of a session, and what of it is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// From when on.
    pub from: From,
    /// Until when; `None`: to the end.
    pub until: Option<From>,
    /// Truth's target frame to the estimate's, where it is known.
    pub gauge: Option<Isometry3<f64>>,
    /// The true direction of the angular momentum, rig axes, where it is known.
    pub momentum: Option<Vector3<f64>>,
}

impl Wanted {
    /// All from a time on, and nothing known beforehand.
    pub const fn from(from: From) -> Self {
        Self { from, until: None, gauge: None, momentum: None }
    }
}

/// What is held against the states.
#[derive(Debug)]
pub enum Truth {
    /// Full poses.
    Poses(Trajectory, Travel),
    /// A turntable's angles.
    Encoder(Vec<EncoderSample>, Travel),
}

/// Errors, error by error.
#[derive(Debug)]
pub enum Series {
    /// Against full poses.
    Poses(Box<Evaluation>),
    /// Against a turntable.
    Encoder(Box<TurntableEvaluation>),
}

/// What scoring gave.
#[derive(Debug)]
pub enum Outcome {
    /// Figures, and the errors behind them.
    Scored(Box<Scored>, Series),
    /// Nothing, and why.
    Unscored(String),
}

/// A file's truth on the session's timeline: by wall time where inputs and file share some, unless `is_simulated`: a
/// scene's own times are the session's. States' times are moved to the same clock.
///
/// # Errors
/// The file tells of other times than the inputs: exit code 2.
pub fn poses(
    path: &Path,
    samples: &[TimedTruth],
    gathered: &mut Gathered,
    have_wall: bool,
    is_simulated: bool,
) -> Result<(Truth, TruthSource), Failure> {
    let zero = gathered.unix_at_zero();
    let wall = |unix: UnixNs| RigNs((unix - zero).0);
    let time = |clock: TruthClock, truth: &TimedTruth| match clock {
        TruthClock::Wall => wall(truth.unix),
        TruthClock::Session => truth.sample.t,
    };
    let overlaps = |clock: &TruthClock| {
        let (first, last) = (samples.first(), samples.last());
        let (first, last) = (first.map(|truth| time(*clock, truth)), last.map(|truth| time(*clock, truth)));
        gathered.span.is_none_or(|(from, to)| first.is_some_and(|t| t <= to) && last.is_some_and(|t| t >= from))
    };
    let clocks = match (have_wall, is_simulated) {
        (false, _) => vec![TruthClock::Session],
        (true, true) => vec![TruthClock::Session, TruthClock::Wall],
        (true, false) => vec![TruthClock::Wall, TruthClock::Session],
    };
    let Some(clock) = clocks.into_iter().find(overlaps) else {
        let span = samples.first().zip(samples.last()).map(|(a, b)| (a.sample.t, b.sample.t, a.unix, b.unix));
        let (a, b, unix_a, unix_b) = span.unwrap_or_default();
        let (from, to) = gathered.span.unwrap_or_default();
        let second = |t: RigNs| t.0 as f64 * 1e-9;
        return Err(Failure::input(format!(
            "{} is of other times than the inputs: t_ns {:.3} to {:.3} s and unix_ns {} to {}; the inputs' epochs are at {:.3} to {:.3} s \
             of the session, which began at {}",
            path.display(), second(a), second(b), unix_a.0, unix_b.0, second(from), second(to), zero.0
        ))
        .with_help("give the truth of this recording; its unix_ns are wall time, its t_ns count from the session's start"));
    };
    if clock == TruthClock::Wall {
        for (estimate, mark) in gathered.estimates.iter_mut().zip(&gathered.marks) {
            estimate.t = wall(mark.unix);
        }
        // A wall clock that was set back has its times twice.
        if !gathered.estimates.is_sorted_by_key(|estimate| estimate.t) {
            return Err(Failure::input(
                "the wall clock was set back within the inputs: their times are no longer those of the truth",
            )
            .with_help("evaluate the parts before and after separately"));
        }
    }
    let moved: Vec<_> = samples
        .iter()
        .map(|truth| tumbled_core::evaluate::TruthSample { t: time(clock, truth), ..truth.sample })
        .collect();
    let travel = Travel::of_truth(&moved);
    let source = TruthSource { name: path.display().to_string(), clock, samples: moved.len() as u64, left_out: 0 };
    Ok((Truth::Poses(Trajectory::new(moved).map_err(Failure::input)?, travel), source))
}

/// The turntable of the ledger; of several the one that tells most.
///
/// # Errors
/// No angle is truth: exit code 2.
pub fn turntable(gathered: &Gathered, warnings: &mut Vec<String>) -> Result<(Truth, TruthSource), Failure> {
    let samples = &gathered.turntable;
    let count =
        |id: &tumbled_model::SensorId| samples.iter().filter(|sample| sample.is_truth && sample.sensor == *id).count();
    let mut ids: Vec<_> = Vec::new();
    for sample in samples {
        if !ids.contains(&&sample.sensor) {
            ids.push(&sample.sensor);
        }
    }
    let Some(id) = ids.iter().copied().max_by_key(|id| count(id)) else {
        return Err(Failure::input("the inputs hold no angle of a turntable").with_help(
            "record one (docs/turntable.md), and have [turntable] in the config; or give --truth FILE.csv",
        ));
    };
    if ids.len() > 1 {
        warnings.push(format!("the inputs hold {} turntables; {id} is taken for the truth", ids.len()));
    }
    let of_it = || samples.iter().filter(|sample| sample.sensor == *id);
    let mut angles: Vec<EncoderSample> = Vec::with_capacity(samples.len());
    for sample in of_it().filter(|sample| sample.is_truth) {
        if angles.last().is_none_or(|last| last.t < sample.t) {
            angles.push(EncoderSample { t: sample.t, angle_rad: sample.angle_rad });
        }
    }
    let left_out = of_it().count() - angles.len();
    if angles.len() < 2 {
        return Err(Failure::input(format!("of {left_out} angles of {id} none is truth"))
            .with_help("a stage without encoder, with a fault or a slip only tells where it was told to be: `tumbled info` says which"));
    }
    if left_out > 0 {
        warnings.push(format!("{left_out} angles of {id} are no truth and were left out: the stage slipped, reports a fault or was told again"));
    }
    let (samples, travel) = (angles.len() as u64, Travel::of_encoder(&angles));
    let source =
        TruthSource { name: format!("turntable {id}"), clock: TruthClock::Session, samples, left_out: left_out as u64 };
    Ok((Truth::Encoder(angles, travel), source))
}

/// Scores.
///
/// # Errors
/// An interval without states or without truth: exit code 2.
pub fn score(
    gathered: &Gathered,
    truth: &Truth,
    wanted: &Wanted,
    warnings: &mut Vec<String>,
) -> Result<Outcome, Failure> {
    let (Truth::Poses(_, travel) | Truth::Encoder(_, travel)) = truth;
    let estimates = until(&gathered.estimates, travel, wanted.until);
    let (Some(first), Some(last)) = (estimates.first(), estimates.last()) else {
        return Ok(Outcome::Unscored("no epoch was tracked".to_owned()));
    };
    if estimates.len() < 2 {
        return Ok(Outcome::Unscored("one epoch alone was tracked, and two are the least".to_owned()));
    }
    let options = EvaluateOptions {
        from: begin(travel, wanted.from, (first.t, last.t), warnings),
        gauge: wanted.gauge,
        momentum: wanted.momentum,
    };
    let (scored, series) = match truth {
        Truth::Poses(trajectory, _) => {
            let found = evaluate(estimates, trajectory, &options).map_err(Failure::input)?;
            let wrong = found.series.iter().map(|(number, error)| (*number, error.attitude_rad.norm()));
            let scored = Scored {
                states: found.scored.into(),
                left_out: found.left_out.into(),
                wrong: wrong_of(gathered, wrong),
                nis: found.nis.as_ref().map(|nis| MeanSquare::of(nis, 6)),
                pose: Some(TruthFigures::of(&found, found.travel_rad > AT_REST)),
                turntable: None,
                ..interval(found.span, found.travel_rad)
            };
            (scored, Series::Poses(Box::new(found)))
        }
        Truth::Encoder(angles, _) => {
            let found = match evaluate_turntable(estimates, angles, &options) {
                Ok(found) => found,
                Err(error @ EvaluateError::NoTurn { .. }) => return Ok(Outcome::Unscored(error.to_string())),
                Err(error) => return Err(Failure::input(error)),
            };
            let wrong =
                found.series.iter().map(|(number, error)| (*number, error.about_axis_rad.hypot(error.tilt_rad)));
            let scored = Scored {
                states: found.scored.into(),
                left_out: found.left_out.into(),
                wrong: wrong_of(gathered, wrong),
                nis: found.nis.as_ref().map(|nis| MeanSquare::of(nis, 6)),
                turntable: Some(TurntableFigures::of(&found)),
                ..interval(found.span, found.travel_rad)
            };
            (scored, Series::Encoder(Box::new(found)))
        }
    };
    Ok(Outcome::Scored(Box::new(scored), series))
}

/// The states until a time, which are scored or come before the interval.
fn until<'a>(estimates: &'a [EstimateSample], travel: &Travel, until: Option<From>) -> &'a [EstimateSample] {
    let end = match until {
        None => None,
        Some(From::At(t)) => Some(t),
        Some(From::Turns(turns)) => estimates.first().and_then(|first| travel.after(first.t, turns * TAU)),
    };
    let count = end.map_or(estimates.len(), |end| estimates.partition_point(|estimate| estimate.t <= end));
    estimates.get(..count).unwrap_or(estimates)
}

/// When scoring begins; `None`: with the first state.
fn begin(travel: &Travel, from: From, (first, last): (RigNs, RigNs), warnings: &mut Vec<String>) -> Option<RigNs> {
    let turns = match from {
        From::At(t) => return Some(t),
        From::Turns(turns) => turns,
    };
    let turned = travel.between(first, last);
    if turned < AT_REST || turns <= 0.0 {
        return None;
    }
    let begin = travel.after(first, turns * TAU).filter(|begin| *begin < last);
    if begin.is_none() {
        warnings.push(format!(
            "tracked over {:.2} revolutions of the target, and scoring would begin after {turns}: everything is scored, the time in \
             which the model is made included",
            turned / TAU
        ));
    }
    begin
}

fn interval((from, to): (RigNs, RigNs), travel_rad: f64) -> Scored {
    let second = |t: RigNs| t.0 as f64 * 1e-9;
    Scored {
        from_s: second(from),
        to_s: second(to),
        travel_deg: travel_rad.to_degrees(),
        states: 0,
        left_out: 0,
        wrong: Share::new(0, 0),
        nis: None,
        pose: None,
        turntable: None,
    }
}

fn wrong_of(gathered: &Gathered, errors: impl Iterator<Item = (usize, f64)>) -> Share {
    let is_ok = |number: usize| gathered.marks.get(number).is_some_and(|mark| mark.is_ok);
    let (mut wrong, mut of) = (0, 0);
    for (_, error) in errors.filter(|(number, _)| is_ok(*number)) {
        of += 1;
        // Not a number is no small error.
        wrong += usize::from(error > WRONG || error.is_nan());
    }
    Share::new(wrong, of)
}

#[cfg(test)]
mod tests;

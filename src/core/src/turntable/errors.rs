//! What the target's estimate is off by against the turntable's encoder, while both run.
//!
//! ```text
//!   TurntableSample ─▶ segments of one zero ─┐
//!   TargetState ─────▶ waiting, 1 s ─────────┴─▶ scored ─▶ the last ten seconds ─▶ TurntableErrors
//! ```
//!
//! States are scored a second after their time: by then the angles to both sides are in, however the sensors' events lay
//! among each other, so a replay tells the same errors.

use crate::estimate::{Mode, TargetState};
use crate::evaluate::{EncoderSample, angle, angle_at};
use crate::turntable::TurntableSample;
use core::f64::consts::PI;
use nalgebra::{UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use tumbled_model::se3::{less_turns, log_rotation, turned_about};
use tumbled_model::{RigNs, Span};

/// How long a state waits for the angles around it.
const WAIT: Span = Span(1_000_000_000);
/// Angles nearer to the one before are not kept.
const THIN: Span = Span(8_000_000);
/// The encoder's rate is its difference over so long to both sides.
const STEP: Span = Span(250_000_000);
/// The errors told are of so long.
const WINDOW: Span = Span(10_000_000_000);
/// The first so long after the begin is the zero of the turned angle.
const ZERO: Span = Span(1_000_000_000);
/// The turning of the target is summed up over steps of the table of so much, rad (1°): less is noise.
const LEAST_STEP: f64 = 1.0 / 180.0 * PI;
/// Between states that lie farther apart nobody knows which way round the target went, rad.
const LONGEST_STEP: f64 = 2.0;
/// A table that has turned less has shown no axis, rad (5°).
const LEAST_TRAVEL: f64 = 5.0 / 180.0 * PI;
/// A sample's angle, and the one before with its rate, differ by rounding alone, rad.
const SAME_ZERO: f64 = 1e-6;
/// Most angles, states and segments kept, whatever comes.
const MOST: usize = 1_024;
const MOST_SEGMENTS: usize = 8;

/// The estimate's errors against the turntable's encoder, up to a second ago.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurntableErrors {
    /// From when on angles are compared, ns: the first state that was tracked while the encoder was truth.
    pub since_ns: i64,
    /// States compared since.
    pub states: u64,
    /// States that the errors below are of: those of the last ten seconds.
    pub recent: u32,
    /// How far the target has turned about the axis of its own turning, less what the encoder has, the mean of the first
    /// second taken off: the newest, degrees in -180..=180. What accumulates since then stays in it.
    pub about_axis_deg: f64,
    /// Its root mean square over the last ten seconds, degrees.
    pub about_axis_rms_deg: f64,
    /// Estimated rate about that axis less the encoder's, the mean of the last ten seconds, degrees a second.
    pub rate_dps: f64,
    /// Its root mean square over the last ten seconds, degrees a second.
    pub rate_rms_dps: f64,
    /// Angle between that axis and the calibrated one, degrees; null: the calibration file has none.
    pub axis_deg: Option<f64>,
}

/// A tracked target: attitude in the rig, and angular velocity, rig axes, rad/s.
type Turning = (UnitQuaternion<f64>, Vector3<f64>);

/// A state held against the encoder.
#[derive(Clone, Copy, Debug)]
struct Scored {
    t: RigNs,
    rotation: UnitQuaternion<f64>,
    angular_velocity_rps: Vector3<f64>,
    angle_rad: f64,
    rate_rps: f64,
}

/// Where the comparison began, and what was turned since.
#[derive(Clone, Debug)]
struct Since {
    segment: u64,
    first: Scored,
    /// Those of the first second.
    zero: Vec<Scored>,
    /// The last one that the sum below reaches to.
    summed: Scored,
    /// The target's turning, rotation vectors added up, in the sense in which the encoder grows.
    turned: Vector3<f64>,
    states: u64,
    recent: VecDeque<Scored>,
}

/// Holds states against the encoder of one turntable.
#[derive(Clone, Debug, Default)]
pub(crate) struct ErrorWatch {
    /// Axis by the calibration, of length 1, about which the target turns counter-clockwise where the encoder grows.
    axis: Option<Vector3<f64>>,
    /// Angles that count from one zero, with the number of the zero.
    segments: VecDeque<(u64, Vec<EncoderSample>)>,
    begun: u64,
    /// The newest angle that is truth, kept or not.
    newest: Option<EncoderSample>,
    /// States not scored yet; `None`: there was no tracked target.
    waiting: VecDeque<(RigNs, Option<Turning>)>,
    since: Option<Since>,
}

impl ErrorWatch {
    /// The calibrated axis, rig axes, any length above 0, in the sense in which the encoder grows.
    pub(crate) fn set_axis(&mut self, axis: Option<Vector3<f64>>) {
        self.axis = axis.and_then(|axis| axis.try_normalize(0.0));
    }

    /// Takes an angle, in the order of their times.
    pub(crate) fn angle(&mut self, sample: &TurntableSample) {
        if !sample.is_truth {
            self.newest = None;
            return;
        }
        let next = EncoderSample { t: sample.t, angle_rad: sample.angle_rad };
        // A sample's rate is from the reading before: where it does not lead here from the sample before, there was
        // another reading between, and with it a new zero.
        let goes_on = self.newest.is_some_and(|before| {
            let step_s = (next.t - before.t).as_secs_f64();
            (before.angle_rad + sample.rate_rps * step_s - next.angle_rad).abs() <= SAME_ZERO
        });
        self.newest = Some(next);
        if !goes_on {
            self.begun += 1;
            self.segments.push_back((self.begun, Vec::new()));
            if self.segments.len() > MOST_SEGMENTS {
                self.segments.pop_front();
            }
        }
        let Some((_, kept)) = self.segments.back_mut() else { return };
        if kept.last().is_none_or(|last| next.t - last.t >= THIN) {
            if kept.len() >= MOST {
                kept.drain(..MOST / 2);
            }
            kept.push(next);
        }
    }

    /// Takes the target after an epoch, in the order of their times.
    pub(crate) fn state(&mut self, state: &TargetState) {
        let turning = match (state.mode, &state.motion) {
            (Mode::Tracking, Some(motion)) => Some((motion.t_rig_target.rotation, motion.angular_velocity_rps)),
            // Another target may come, or the same with another frame.
            (Mode::NoTarget | Mode::Acquiring, _) => None,
            // What is predicted measured nothing; what was lost comes back in the frame it had, at the right angle or not.
            _ => return,
        };
        if self.waiting.len() >= MOST {
            self.waiting.pop_front();
        }
        self.waiting.push_back((state.t, turning));
    }

    /// The errors as of `t`. `None`: nothing was compared in the last ten seconds, or too little was turned.
    pub(crate) fn errors(&mut self, t: RigNs) -> Option<TurntableErrors> {
        let until = t - WAIT;
        while let Some((at, turning)) = self.waiting.pop_front_if(|(at, _)| *at <= until) {
            match turning {
                Some(turning) => self.score(at, turning),
                None => self.since = None,
            }
        }
        for (_, kept) in &mut self.segments {
            let old = kept.partition_point(|sample| sample.t < until - WAIT);
            kept.drain(..old);
        }
        let newest = self.begun;
        self.segments.retain(|(number, kept)| *number == newest || !kept.is_empty());
        let since = self.since.as_mut()?;
        since.recent.retain(|scored| scored.t > until - WINDOW);
        since.errors(self.axis.as_ref())
    }

    fn score(&mut self, t: RigNs, (rotation, angular_velocity_rps): Turning) {
        let found = self.segments.iter().find_map(|(number, kept)| {
            let (before, after) = (angle_at(kept, t - STEP)?, angle_at(kept, t + STEP)?);
            Some((*number, angle_at(kept, t)?, (after - before) / (2.0 * STEP.as_secs_f64())))
        });
        let Some((segment, angle_rad, rate_rps)) = found else { return };
        let scored = Scored { t, rotation, angular_velocity_rps, angle_rad, rate_rps };
        match self.since.as_mut().filter(|since| since.segment == segment) {
            Some(since) => since.take(scored),
            None => self.since = Some(Since::begin(segment, scored)),
        }
    }
}

impl Since {
    fn begin(segment: u64, first: Scored) -> Self {
        let recent = VecDeque::from([first]);
        Self { segment, first, zero: vec![first], summed: first, turned: Vector3::zeros(), states: 1, recent }
    }

    fn take(&mut self, scored: Scored) {
        self.states += 1;
        if scored.t - self.first.t <= ZERO && self.zero.len() < MOST {
            self.zero.push(scored);
        }
        if self.recent.len() >= MOST {
            self.recent.pop_front();
        }
        self.recent.push_back(scored);
        let turned = scored.angle_rad - self.summed.angle_rad;
        if turned.abs() < LEAST_STEP {
            return;
        }
        if turned.abs() <= LONGEST_STEP {
            self.turned += log_rotation(&(scored.rotation * self.summed.rotation.inverse())) * turned.signum();
        }
        self.summed = scored;
    }

    fn errors(&self, calibrated: Option<&Vector3<f64>>) -> Option<TurntableErrors> {
        let axis = self.turned.try_normalize(LEAST_TRAVEL)?;
        let about = |scored: &Scored| {
            let rotation = scored.rotation * self.first.rotation.inverse();
            less_turns(turned_about(&rotation, &axis) - (scored.angle_rad - self.first.angle_rad))
        };
        let zero = self.zero.iter().map(&about).sum::<f64>() / self.zero.len() as f64;
        let about = |scored: &Scored| less_turns(about(scored) - zero);
        let rate = |scored: &Scored| scored.angular_velocity_rps.dot(&axis) - scored.rate_rps;
        let newest = self.recent.back()?;
        let count = self.recent.len() as f64;
        let mean = |of: &dyn Fn(&Scored) -> f64| self.recent.iter().map(of).sum::<f64>() / count;
        let rms = |of: &dyn Fn(&Scored) -> f64| mean(&|scored| of(scored) * of(scored)).sqrt().to_degrees();
        Some(TurntableErrors {
            since_ns: self.first.t.0,
            states: self.states,
            recent: self.recent.len() as u32,
            about_axis_deg: about(newest).to_degrees(),
            about_axis_rms_deg: rms(&about),
            rate_dps: mean(&rate).to_degrees(),
            rate_rms_dps: rms(&rate),
            axis_deg: calibrated.map(|truth| angle(&axis, truth).to_degrees()),
        })
    }
}

#[cfg(test)]
mod tests;

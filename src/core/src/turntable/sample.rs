//! Where a turntable was, and how well that is known.

use tumbled_model::{RigNs, SensorId, Span};
use tumbled_serial::zaber::{PositionKind, Scale, Warning};

/// Readings farther apart say nothing of the rate between them.
const LONGEST_STEP: Span = Span(1_000_000_000);

/// Where a turntable was.
#[derive(Clone, Debug, PartialEq)]
pub struct TurntableSample {
    /// Whose.
    pub sensor: SensorId,
    /// When.
    pub t: RigNs,
    /// One standard deviation of `t`.
    pub t_sigma: Span,
    /// How far `t` may be off at most; `None`: it is by the device's clock, and only `t_sigma` is known.
    pub half_rtt: Option<Span>,
    /// Its angle from the stage's zero, rad, not wrapped; positive as the stage counts.
    pub angle_rad: f64,
    /// One standard deviation of the angle at `t`: the encoder's step, and what the stage turns in `t_sigma`.
    pub sigma_rad: f64,
    /// How fast it turned since the sample before, rad/s.
    pub rate_rps: f64,
    /// Whether the stage says that it moves; `None`: this protocol has no such word.
    pub moving: Option<bool>,
    /// Measured by an encoder of a stage that reports no fault and no slip.
    pub is_truth: bool,
}

/// A position as the line has it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reading {
    pub(super) t: RigNs,
    pub(super) half_rtt: Option<Span>,
    pub(super) t_sigma: Span,
    pub(super) counts: i64,
    pub(super) kind: PositionKind,
    pub(super) moving: Option<bool>,
    pub(super) warning: Option<Warning>,
}

/// Readings to samples: each but the first has a rate, and without one nobody knows how uncertain its angle is.
#[derive(Clone, Debug, Default)]
pub(super) struct Angles {
    before: Option<(RigNs, f64)>,
}

impl Angles {
    /// The next reading has nothing to do with those before it.
    pub(super) fn begin(&mut self) {
        self.before = None;
    }

    /// The sample of a reading; `None`: it is the first, or no later than the one before.
    pub(super) fn sample(
        &mut self,
        sensor: &SensorId,
        reading: &Reading,
        scale: Scale,
        is_truth: bool,
    ) -> Option<TurntableSample> {
        let angle_rad = scale.angle_rad(reading.counts);
        let (t, t_sigma) = (reading.t, reading.t_sigma);
        let (before_t, before_rad) = self.before.replace((t, angle_rad))?;
        let step = t - before_t;
        if step <= Span(0) || step > LONGEST_STEP {
            return None;
        }
        let rate_rps = (angle_rad - before_rad) / step.as_secs_f64();
        // A half round trip h is spread evenly, which is what the scale takes: rate² h² / 3; for a clock's σ, h = √3 σ.
        let half_rtt = reading.half_rtt.unwrap_or(Span((t_sigma.0 as f64 * 3.0_f64.sqrt()).round() as i64));
        Some(TurntableSample {
            sensor: sensor.clone(),
            t,
            t_sigma,
            half_rtt: reading.half_rtt,
            angle_rad,
            sigma_rad: scale.sigma_rad(rate_rps, half_rtt),
            rate_rps,
            moving: reading.moving,
            is_truth: is_truth && reading.kind == PositionKind::Encoder,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(ms: i64, counts: i64) -> Reading {
        let half_rtt = Span::from_micros(2_000);
        Reading {
            t: RigNs(1_000_000 * ms),
            half_rtt: Some(half_rtt),
            t_sigma: Span(1_154_701),
            counts,
            kind: PositionKind::Encoder,
            moving: Some(true),
            warning: Some(Warning::NONE),
        }
    }

    #[test]
    fn two_milliseconds_at_five_degrees_a_second_are_six_thousandths_of_a_degree() {
        let scale = Scale::new(768_000, 1).expect("counts");
        let mut angles = Angles::default();
        let id = SensorId::from("turntable");
        assert_eq!(angles.sample(&id, &reading(0, 0), scale, true), None);
        // 5 °/s are 10 666.67 counts a second: 213.33 in 20 ms.
        let sample = angles.sample(&id, &reading(20, 213), scale, true).expect("a second one");
        assert!((sample.rate_rps.to_degrees() - 4.992_19).abs() < 1e-5, "{sample:?}");
        // 4.992 °/s · 2 ms / √3 = 0.005765°, and the step of 0.00047° / √12 = 0.000135°.
        assert!((sample.sigma_rad.to_degrees() - 0.005_766).abs() < 2e-6, "{}", sample.sigma_rad.to_degrees());
        // By the clock alone, σ = 2 ms / √3: the same.
        let by_clock = Reading { half_rtt: None, ..reading(40, 426) };
        let again = angles.sample(&id, &by_clock, scale, true).expect("a third one");
        assert!((again.sigma_rad - sample.sigma_rad).abs() < 1e-9 && again.half_rtt.is_none());
    }

    #[test]
    fn after_a_pause_the_rate_is_found_anew() {
        let scale = Scale::new(768_000, 1).expect("counts");
        let (mut angles, id) = (Angles::default(), SensorId::from("turntable"));
        let given: Vec<bool> = [(0, 0), (20, 9), (1_021, 9_000), (1_041, 9_009), (1_041, 9_009)]
            .into_iter()
            .map(|(ms, counts)| angles.sample(&id, &reading(ms, counts), scale, true).is_some())
            .collect();
        assert_eq!(given, [false, true, false, true, false]);
    }
}

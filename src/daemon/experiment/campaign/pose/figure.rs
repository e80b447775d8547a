//! What trials come to.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::trial::{PoseErrors, PoseTrial, Squares};
use crate::experiment::bounds::Share;

/// A figure of trials taken together. What is an r.m.s. in a trial is one over trials too.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseFigure {
    /// Attitude, gauge-free, degrees.
    AttitudeDeg,
    /// The largest of any state, degrees.
    AttitudeMaxDeg,
    /// Attitude with the frames aligned in the first second, degrees.
    DriftDeg,
    /// Position about its mean offset, mm.
    PositionMm,
    /// Velocity, mm/s.
    VelocityMmps,
    /// Spin axis, degrees.
    AxisDeg,
    /// Spin axis, the r.m.s. of the worst trial, degrees.
    AxisWorstDeg,
    /// Spin rate, °/s.
    RateDps,
    /// Direction of the angular momentum, degrees.
    MomentumDeg,
    /// Mean NEES(12), gauge-free.
    NeesGaugeFree,
    /// Mean NEES(12) with the target's frame known.
    NeesKnownFrame,
    /// Stated σ over r.m.s. error of each of the twelve axes, gauge-free: the least and the greatest.
    SigmaOverRmsGaugeFree,
    /// The same with the target's frame known.
    SigmaOverRmsKnownFrame,
    /// Stated σ of the attitude, degrees.
    SigmaDeg,
    /// From the first epoch to the first that is tracked, s: of the slowest trial.
    AcquiredS,
    /// From the target's return to the first epoch that is tracked, s: of the slowest trial.
    ReturnedS,
    /// Share of the interval's epochs that are tracked.
    Tracked,
    /// States `tracking` and `ok` and more than 10° off, a share of those `tracking` and `ok`.
    Wrong,
    /// How many states were `tracking` and `ok`.
    OkStates,
}

/// A figure's value: one number, or the least and the greatest of several.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Value {
    /// The number, or the least.
    pub low: f64,
    /// The number, or the greatest.
    pub high: f64,
}

impl Value {
    /// One number; `None`: it is none.
    fn one(number: f64) -> Option<Self> {
        number.is_finite().then_some(Self { low: number, high: number })
    }
}

impl PoseFigure {
    /// Those of a table's columns.
    pub const COLUMNS: [Self; 14] = [
        Self::AttitudeDeg,
        Self::PositionMm,
        Self::VelocityMmps,
        Self::AxisDeg,
        Self::AxisWorstDeg,
        Self::RateDps,
        Self::MomentumDeg,
        Self::NeesGaugeFree,
        Self::SigmaOverRmsGaugeFree,
        Self::NeesKnownFrame,
        Self::SigmaOverRmsKnownFrame,
        Self::AcquiredS,
        Self::Tracked,
        Self::Wrong,
    ];

    /// The others.
    pub const OTHERS: [Self; 5] =
        [Self::AttitudeMaxDeg, Self::DriftDeg, Self::SigmaDeg, Self::ReturnedS, Self::OkStates];

    /// In words, with its unit.
    pub const fn name(self) -> &'static str {
        match self {
            Self::AttitudeDeg => "attitude",
            Self::AttitudeMaxDeg => "attitude, largest",
            Self::DriftDeg => "attitude, aligned first",
            Self::PositionMm => "position",
            Self::VelocityMmps => "velocity",
            Self::AxisDeg => "axis",
            Self::AxisWorstDeg => "axis, worst seed",
            Self::RateDps => "rate",
            Self::MomentumDeg => "momentum",
            Self::NeesGaugeFree => "NEES(12) gauge-free",
            Self::NeesKnownFrame => "NEES(12) known frame",
            Self::SigmaOverRmsGaugeFree => "σ/r.m.s. gauge-free",
            Self::SigmaOverRmsKnownFrame => "σ/r.m.s. known frame",
            Self::SigmaDeg => "stated σ of attitude",
            Self::AcquiredS => "acquired",
            Self::ReturnedS => "tracked again",
            Self::Tracked => "tracked",
            Self::Wrong => "wrong",
            Self::OkStates => "states",
        }
    }

    /// Whether it can be divided by that of other trials.
    pub const fn has_ratio(self) -> bool {
        !matches!(
            self,
            Self::SigmaOverRmsGaugeFree | Self::SigmaOverRmsKnownFrame | Self::Tracked | Self::Wrong | Self::OkStates
        )
    }

    /// A number of it for people.
    pub fn written(self, value: f64) -> String {
        match self {
            Self::AttitudeDeg | Self::DriftDeg | Self::AttitudeMaxDeg | Self::MomentumDeg | Self::SigmaDeg => {
                format!("{value:.3}°")
            }
            Self::AxisDeg | Self::AxisWorstDeg => format!("{value:.3}°"),
            Self::PositionMm => format!("{value:.2} mm"),
            Self::VelocityMmps => format!("{value:.2} mm/s"),
            Self::RateDps => format!("{value:.4} °/s"),
            Self::NeesGaugeFree | Self::NeesKnownFrame => format!("{value:.1}"),
            Self::SigmaOverRmsGaugeFree | Self::SigmaOverRmsKnownFrame => format!("{value:.2}"),
            Self::AcquiredS | Self::ReturnedS => format!("{value:.2} s"),
            Self::Tracked | Self::Wrong => format!("{:.2} %", 100.0 * value),
            Self::OkStates => format!("{value:.0}"),
        }
    }

    /// Of trials; `None`: there is none, or one of them could not be scored. What failed must not make a figure better.
    pub fn of(self, trials: &[&PoseTrial]) -> Option<Value> {
        if trials.is_empty() {
            return None;
        }
        match self {
            Self::Tracked | Self::Wrong => Value::one(self.share(trials)?.share?),
            Self::OkStates => Value::one(trials.iter().map(|trial| trial.wrong.of).sum::<u64>() as f64),
            Self::AcquiredS => slowest(trials.iter().map(|trial| trial.acquired_s)),
            Self::ReturnedS => slowest(trials.iter().map(|trial| trial.returned_s)),
            _ => {
                let errors: Option<Vec<&PoseErrors>> = trials.iter().map(|trial| trial.errors.as_ref()).collect();
                self.of_errors(&errors?)
            }
        }
    }

    fn of_errors(self, errors: &[&PoseErrors]) -> Option<Value> {
        let all =
            |of: fn(&PoseErrors) -> Option<f64>| errors.iter().map(|errors| of(errors)).collect::<Option<Vec<f64>>>();
        let mean = |numbers: Vec<f64>| numbers.iter().sum::<f64>() / numbers.len() as f64;
        let rms = |of| Value::one(mean(all(of)?.into_iter().map(|error| error * error).collect()).sqrt());
        let greatest = |of| Value::one(all(of)?.into_iter().fold(f64::NEG_INFINITY, f64::max));
        match self {
            Self::AttitudeDeg => rms(|errors| Some(errors.attitude_deg)),
            Self::AttitudeMaxDeg => greatest(|errors| Some(errors.attitude_max_deg)),
            Self::DriftDeg => rms(|errors| errors.drift_deg),
            Self::PositionMm => rms(|errors| Some(errors.position_mm)),
            Self::VelocityMmps => rms(|errors| Some(errors.velocity_mmps)),
            Self::AxisDeg => rms(|errors| Some(errors.axis_deg)),
            Self::AxisWorstDeg => greatest(|errors| Some(errors.axis_deg)),
            Self::RateDps => rms(|errors| Some(errors.rate_dps)),
            Self::MomentumDeg => rms(|errors| errors.momentum_deg),
            Self::SigmaDeg => rms(|errors| Some(errors.sigma_deg)),
            Self::NeesGaugeFree => Value::one(mean(all(|errors| Some(errors.gauge_free.as_ref()?.nees12))?)),
            Self::NeesKnownFrame => Value::one(mean(all(|errors| Some(errors.known_frame.as_ref()?.nees12))?)),
            Self::SigmaOverRmsGaugeFree => ratios(errors.iter().map(|errors| errors.gauge_free.as_ref())),
            Self::SigmaOverRmsKnownFrame => ratios(errors.iter().map(|errors| errors.known_frame.as_ref())),
            Self::AcquiredS | Self::ReturnedS | Self::Tracked | Self::Wrong | Self::OkStates => None,
        }
    }

    /// A share's count; `None`: the figure is none.
    pub fn share(self, trials: &[&PoseTrial]) -> Option<Share> {
        let shares = trials.iter().map(|trial| match self {
            Self::Tracked => Some(trial.tracked),
            Self::Wrong => Some(trial.wrong),
            _ => None,
        });
        let (mut count, mut of) = (0, 0);
        for share in shares {
            let share = share?;
            (count, of) = (count + share.count, of + share.of);
        }
        Some(Share::new(count as usize, of as usize))
    }
}

fn slowest(times: impl Iterator<Item = Option<f64>>) -> Option<Value> {
    times.collect::<Option<Vec<f64>>>().and_then(|times| Value::one(times.into_iter().fold(0.0, f64::max)))
}

/// The least and the greatest axis of the stated σ over the r.m.s. error, both over all trials.
fn ratios<'a>(squares: impl Iterator<Item = Option<&'a Squares>>) -> Option<Value> {
    let squares: Vec<&Squares> = squares.collect::<Option<_>>()?;
    let ratio = |axis: usize| {
        let sum = |of: fn(&Squares) -> &[f64; 12]| squares.iter().map(|squares| of(squares)[axis]).sum::<f64>();
        (sum(|squares| &squares.variance) / sum(|squares| &squares.square)).sqrt()
    };
    let ratios: Vec<f64> = (0..12).map(ratio).collect();
    let (low, high) =
        ratios.iter().fold((f64::INFINITY, 0.0), |(low, high), r| (f64::min(low, *r), f64::max(high, *r)));
    (low.is_finite() && high.is_finite()).then_some(Value { low, high })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A trial with an attitude error of so many degrees; `None`: it could not be scored.
    pub(crate) fn trial(seed: u64, attitude_deg: Option<f64>) -> PoseTrial {
        let squares = |nees12| Squares { nees12, nees6: 6.0, variance: [4.0; 12], square: [1.0 + seed as f64; 12] };
        let errors = attitude_deg.map(|attitude_deg| PoseErrors {
            states: 100,
            attitude_deg,
            attitude_max_deg: 3.0 * attitude_deg,
            drift_deg: None,
            position_mm: 2.0,
            velocity_mmps: 1.0,
            axis_deg: attitude_deg,
            rate_dps: 0.01,
            momentum_deg: None,
            sigma_deg: 0.2,
            sigma_mm: 3.0,
            nis: Some(5.0),
            gauge_free: Some(squares(6.0 + 2.0 * seed as f64)),
            known_frame: None,
        });
        PoseTrial {
            scene: "a".to_owned(),
            config: "fused".to_owned(),
            interval: "settled".to_owned(),
            seed,
            digest: String::new(),
            epochs: 120,
            acquired_s: attitude_deg.map(|_| 0.7 + 0.1 * seed as f64),
            returned_s: None,
            tracked: Share::new(90, 100),
            wrong: Share::new(seed as usize, 100),
            unscored: attitude_deg.is_none().then(|| "no epoch was tracked".to_owned()),
            errors,
        }
    }

    #[test]
    fn figures_are_of_all_seeds_together() {
        let (a, b) = (trial(0, Some(0.3)), trial(2, Some(0.4)));
        let of = |figure: PoseFigure| figure.of(&[&a, &b]).map(|value| (value.low, value.high));
        let near = |found: Option<(f64, f64)>, expected: f64| {
            assert!(found.is_some_and(|(low, high)| (low - expected).abs() < 1e-12 && low == high), "{found:?}");
        };
        // √((0.09 + 0.16) / 2).
        near(of(PoseFigure::AttitudeDeg), 0.125f64.sqrt());
        near(of(PoseFigure::AxisWorstDeg), 0.4);
        near(of(PoseFigure::AcquiredS), 0.9);
        // 6 and 10.
        near(of(PoseFigure::NeesGaugeFree), 8.0);
        // √((4 + 4) / (1 + 3)).
        near(of(PoseFigure::SigmaOverRmsGaugeFree), 2f64.sqrt());
        near(of(PoseFigure::Wrong), 0.01);
        near(of(PoseFigure::OkStates), 200.0);
        assert_eq!((of(PoseFigure::MomentumDeg), of(PoseFigure::ReturnedS)), (None, None));
    }

    #[test]
    fn a_seed_that_could_not_be_scored_is_no_better_figure_but_none() {
        let (a, b) = (trial(0, Some(0.3)), trial(1, None));
        assert_eq!(PoseFigure::AttitudeDeg.of(&[&a, &b]), None);
        assert_eq!(PoseFigure::AcquiredS.of(&[&a, &b]), None);
        assert_eq!(PoseFigure::Tracked.of(&[&a, &b]), Some(Value { low: 0.9, high: 0.9 }));
    }
}

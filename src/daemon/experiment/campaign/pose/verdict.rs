//! Figures of trials, held against what is claimed of them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::figure::{PoseFigure, Value};
use super::file::PoseClaim;
use super::trial::PoseTrial;
use crate::experiment::bounds::Share;
use crate::experiment::campaign::claims::Limits;

/// A claim, and what was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseVerdict {
    /// The claim.
    pub claim: PoseClaim,
    /// Trials it is about.
    pub trials: u64,
    /// Of these could not be scored.
    pub unscored: u64,
    /// The figure, or its ratio; null: there is none, and the claim does not hold.
    pub value: Option<Value>,
    /// What the figure was divided by; null: by nothing.
    pub against: Option<f64>,
    /// A share's count and 95 % interval; null: the figure is no share.
    pub share: Option<Share>,
    /// It is what it has to be.
    pub holds: bool,
    /// It is what it should be.
    pub reaches_aim: bool,
}

/// The trials of a run over an interval.
pub fn trials_of<'a>(trials: &'a [PoseTrial], run: &str, interval: &str) -> Vec<&'a PoseTrial> {
    let is_of = |trial: &&PoseTrial| {
        run.split_once('/') == Some((trial.scene.as_str(), trial.config.as_str())) && trial.interval == interval
    };
    trials.iter().filter(is_of).collect()
}

impl PoseVerdict {
    /// Of a claim about trials.
    pub fn of(claim: &PoseClaim, all: &[PoseTrial]) -> Self {
        let trials: Vec<&PoseTrial> = claim.runs.iter().flat_map(|run| trials_of(all, run, &claim.interval)).collect();
        let found = claim.figure.of(&trials);
        let least = claim.against.as_ref().map(|against| {
            let interval = against.interval.as_ref().unwrap_or(&claim.interval);
            let is_seed = |other: &&PoseTrial| trials.iter().any(|trial| trial.seed == other.seed);
            let figures = against.runs.iter().map(|run| {
                let others: Vec<&PoseTrial> = trials_of(all, run, interval).into_iter().filter(is_seed).collect();
                claim.figure.of(&others)
            });
            // Runs without a figure are no competition; that none has one leaves nothing to compare with.
            figures.flatten().map(|value| value.low).fold(f64::INFINITY, f64::min)
        });
        let value = match least {
            None => found,
            Some(least) => found
                .filter(|_| least.is_finite() && least > 0.0)
                .map(|value| Value { low: value.low / least, high: value.high / least }),
        };
        let within = |limits: &Limits| value.is_some_and(|value| limits.hold(value.low) && limits.hold(value.high));
        Self {
            trials: trials.len() as u64,
            unscored: trials.iter().filter(|trial| trial.errors.is_none()).count() as u64,
            value,
            against: least.filter(|least| least.is_finite()),
            share: claim.figure.share(&trials),
            holds: within(&claim.must),
            reaches_aim: within(claim.aim.as_ref().unwrap_or(&claim.must)),
            claim: claim.clone(),
        }
    }

    /// A number of the claim's figure, or of a ratio, for people.
    pub fn written(&self, value: f64) -> String {
        if self.claim.against.is_some() { format!("× {value:.2}") } else { self.claim.figure.written(value) }
    }

    /// The figure for people: a ratio with what it is of, a share with its interval.
    pub fn found(&self) -> String {
        let unscored = match self.unscored {
            0 => String::new(),
            unscored => format!(" ({unscored} of {} not scored)", self.trials),
        };
        let Some(Value { low, high }) = self.value else { return format!("-{unscored}") };
        let mut text = self.written(low);
        if high > low {
            text = format!("{text} to {}", self.written(high));
        }
        if let Some(against) = self.against {
            text = format!("{text} of {}", self.claim.figure.written(against));
        }
        if let Some(Share { count, of, low, high, .. }) = self.share {
            text = format!("{text} ({count} of {of}; 95 %: {:.3} to {:.3} %)", 100.0 * low, 100.0 * high);
        }
        text + &unscored
    }

    /// What was reached, in a word.
    pub fn status(&self) -> &'static str {
        match (self.holds, self.reaches_aim) {
            (_, true) => "aim",
            (true, false) => "must",
            (false, false) => "MISSED",
        }
    }

    /// What it is about: the claim and its figure.
    pub fn about(&self) -> String {
        format!("{}: {}", self.claim.about, self.claim.figure.name())
    }
}

/// What a figure is called where it is no claim's.
pub fn cell(figure: PoseFigure, trials: &[&PoseTrial]) -> String {
    match figure.of(trials) {
        None => "-".to_owned(),
        Some(Value { low, high }) if high > low => format!("{}-{}", figure.written(low), figure.written(high)),
        Some(Value { low, .. }) => figure.written(low),
    }
}

#[cfg(test)]
mod tests {
    use super::super::figure::tests::trial;
    use super::super::file::Against;
    use super::*;

    fn claim(against: Option<&str>, most: f64) -> PoseClaim {
        PoseClaim {
            about: "c".to_owned(),
            runs: vec!["a/fused".to_owned()],
            interval: "settled".to_owned(),
            figure: PoseFigure::AttitudeDeg,
            against: against.map(|run| Against { runs: vec![run.to_owned(), "a/lidar".to_owned()], interval: None }),
            must: Limits { at_least: None, at_most: Some(most) },
            aim: Some(Limits { at_least: None, at_most: Some(0.1) }),
        }
    }

    fn of(config: &str, attitude_deg: Option<f64>) -> PoseTrial {
        PoseTrial { config: config.to_owned(), ..trial(0, attitude_deg) }
    }

    #[test]
    fn a_figure_is_held_against_its_limits_or_against_the_better_of_other_runs() {
        let trials = [of("fused", Some(0.3)), of("kinect", Some(0.4)), of("lidar", Some(0.6))];
        let found = PoseVerdict::of(&claim(None, 0.35), &trials);
        assert_eq!((found.holds, found.reaches_aim, found.status()), (true, false, "must"));
        let found = PoseVerdict::of(&claim(Some("a/kinect"), 1.0), &trials);
        assert!((found.value.expect("a ratio").low - 0.75).abs() < 1e-12 && found.holds);
        assert_eq!(found.found(), "× 0.75 of 0.400°");
        assert_eq!(PoseVerdict::of(&claim(Some("a/kinect"), 0.7), &trials).status(), "MISSED");
    }

    #[test]
    fn what_could_not_be_scored_does_not_hold() {
        let found = PoseVerdict::of(&claim(None, 9.0), &[of("fused", None)]);
        assert_eq!((found.holds, found.found()), (false, "- (1 of 1 not scored)".to_owned()));
        let alone = PoseVerdict::of(&claim(Some("a/kinect"), 9.0), &[of("fused", Some(0.1))]);
        assert_eq!((alone.holds, alone.value), (false, None));
    }
}

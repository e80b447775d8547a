//! Figures of pooled trials, held against what is claimed of them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::file::ClaimEntry;
use crate::experiment::bounds::Share;
use crate::experiment::figures::Figures;
use crate::experiment::trial::Trial;

/// What a claim is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Figure {
    /// Share within 5° and 5 cm of the truth.
    Right,
    /// Share that is right up to the target's symmetry.
    RightUpToSymmetry,
    /// Share of the right ones that is accepted.
    AcceptedOfRight,
    /// Share accepted and wrong.
    WrongAccepted,
    /// Share refused with other modes told.
    RefusedWithModes,
    /// Median rotation error of the right ones, degrees.
    RotationDeg,
    /// Median error at the moving cloud's centroid of the right ones, mm.
    TranslationMm,
    /// Mean NEES of the right ones.
    Nees,
    /// Median time, ms.
    TimeMs,
}

impl Figure {
    /// In words, with its unit.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::RightUpToSymmetry => "right up to symmetry",
            Self::AcceptedOfRight => "accepted of the right",
            Self::WrongAccepted => "wrong but accepted",
            Self::RefusedWithModes => "refused with modes",
            Self::RotationDeg => "median rotation error, deg",
            Self::TranslationMm => "median position error, mm",
            Self::Nees => "mean NEES",
            Self::TimeMs => "median time, ms",
        }
    }

    const fn share(self, figures: &Figures) -> Option<Share> {
        match self {
            Self::Right => Some(figures.right),
            Self::RightUpToSymmetry => Some(figures.right_up_to_symmetry),
            Self::AcceptedOfRight => Some(figures.accepted_of_right),
            Self::WrongAccepted => Some(figures.wrong_accepted),
            Self::RefusedWithModes => Some(figures.refused_with_modes),
            Self::RotationDeg | Self::TranslationMm | Self::Nees | Self::TimeMs => None,
        }
    }

    fn value(self, figures: &Figures) -> Option<f64> {
        match self {
            Self::RotationDeg => figures.rotation_deg.map(|spread| spread.median),
            Self::TranslationMm => figures.translation_mm.map(|spread| spread.median),
            Self::Nees => figures.nees_mean,
            Self::TimeMs => figures.time_ms.map(|spread| spread.median),
            _ => self.share(figures).and_then(|share| share.share),
        }
    }

    /// A number of it for people.
    pub fn written(self, value: f64) -> String {
        match self {
            Self::RotationDeg => format!("{value:.2}°"),
            Self::TranslationMm => format!("{value:.1} mm"),
            Self::Nees => format!("{value:.1}"),
            Self::TimeMs => format!("{value:.1} ms"),
            _ => format!("{:.1} %", 100.0 * value),
        }
    }
}

/// Between what a figure has to lie; what is left out is no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// At least.
    pub at_least: Option<f64>,
    /// At most.
    pub at_most: Option<f64>,
}

impl Limits {
    /// Whether a value lies between.
    pub fn hold(&self, value: f64) -> bool {
        self.at_least.is_none_or(|least| value >= least) && self.at_most.is_none_or(|most| value <= most)
    }

    /// For people: `≥ 98.0 %`.
    pub fn written(&self, figure: Figure) -> String {
        self.written_as(|value| figure.written(value))
    }

    /// The same of numbers that are written in a way of their own.
    pub fn written_as(&self, written: impl Fn(f64) -> String) -> String {
        match (self.at_least, self.at_most) {
            (Some(least), Some(most)) => format!("{} to {}", written(least), written(most)),
            (Some(least), None) => format!("≥ {}", written(least)),
            (None, Some(most)) => format!("≤ {}", written(most)),
            (None, None) => "-".to_owned(),
        }
    }
}

/// A claim, and what was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// The claim.
    pub claim: ClaimEntry,
    /// Trials it is about.
    pub trials: u64,
    /// The figure; null: there is none, and the claim does not hold.
    pub value: Option<f64>,
    /// A share's count and 95 % interval; null: the figure is no share.
    pub share: Option<Share>,
    /// It is what it has to be.
    pub holds: bool,
    /// It is what it should be.
    pub reaches_aim: bool,
}

impl Verdict {
    /// Of a claim about trials.
    pub fn of(claim: &ClaimEntry, trials: &[Trial]) -> Self {
        let figures = Figures::of(trials);
        let value = claim.figure.value(&figures);
        let within = |limits: &Limits| value.is_some_and(|value| limits.hold(value));
        Self {
            trials: trials.len() as u64,
            value,
            share: claim.figure.share(&figures),
            holds: within(&claim.must),
            reaches_aim: within(claim.aim.as_ref().unwrap_or(&claim.must)),
            claim: claim.clone(),
        }
    }

    /// The figure for people, a share with its interval.
    pub fn found(&self) -> String {
        let Some(value) = self.value else { return "-".to_owned() };
        let written = self.claim.figure.written(value);
        match self.share {
            None => written,
            Some(Share { count, of, low, high, .. }) => {
                format!("{written} ({count} of {of}; 95 %: {:.1} to {:.1} %)", 100.0 * low, 100.0 * high)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::figures::tests::trial;

    fn verdict(figure: Figure, must: Limits, aim: Option<Limits>) -> Verdict {
        let claim = ClaimEntry {
            about: "a claim".to_owned(),
            sets: vec!["a".to_owned()],
            method: "cga".to_owned(),
            figure,
            must,
            aim,
        };
        // Three right of four, of them two accepted; the wrong one accepted too. Times 10, 20, 30, 500 ms.
        Verdict::of(&claim, &[trial(1.0, true), trial(2.0, true), trial(3.0, false), trial(50.0, true)])
    }

    #[test]
    fn a_claim_is_held_against_its_figure() {
        let least = |share| Limits { at_least: Some(share), at_most: None };
        let most = |share| Limits { at_least: None, at_most: Some(share) };
        let right = verdict(Figure::Right, least(0.7), Some(least(0.8)));
        assert_eq!((right.value, right.holds, right.reaches_aim), (Some(0.75), true, false));
        assert!(!verdict(Figure::WrongAccepted, most(0.01), None).holds);
        assert!(verdict(Figure::TimeMs, most(25.0), None).reaches_aim);
        let both = Limits { at_least: Some(3.0), at_most: Some(9.0) };
        assert_eq!(verdict(Figure::Nees, both, None).value, Some(6.0));
        assert_eq!(both.written(Figure::Nees), "3.0 to 9.0");
    }

    #[test]
    fn what_cannot_be_told_does_not_hold() {
        let claim = verdict(Figure::RotationDeg, Limits::default(), None).claim;
        let none = Verdict::of(&claim, &[trial(50.0, false)]);
        assert_eq!((none.value, none.holds, none.found()), (None, false, "-".to_owned()));
    }
}

//! What a result has to reach: gates, and the verdict they make.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a gate or a whole calibration ended; the worse the greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// It may be used.
    Pass,
    /// It may be used by somebody who knows why it warns.
    Warn,
    /// It must not be used.
    Fail,
}

impl Status {
    /// In reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Warn => "warn",
            Self::Fail => "fail",
        }
    }

    /// The worst of several; of none, `Pass`.
    pub fn worst(all: impl IntoIterator<Item = Self>) -> Self {
        all.into_iter().max().unwrap_or(Self::Pass)
    }
}

/// One thing that is asked of a result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Gate {
    /// What is asked, in few words: `sigma of the rotation`.
    pub name: String,
    /// What was found; `None`: it could not be computed, which is a failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// The unit of value and bounds: `deg`, `mm`, empty for counts and shares.
    pub unit: String,
    /// Beyond it, in the direction that is bad, it warns; `None`: it never warns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warn: Option<f64>,
    /// Beyond it, in the direction that is bad, it fails; `None`: it never fails.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fail: Option<f64>,
    /// How it ended.
    pub status: Status,
    /// Where it did not pass: what is missing and what to do, a sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl Gate {
    /// A value that should not be above its bounds. A value that is no number fails.
    pub fn at_most(name: &str, value: f64, unit: &str, (warn, fail): (Option<f64>, Option<f64>), remedy: &str) -> Self {
        let beyond = |bound: Option<f64>| bound.is_some_and(|bound| value > bound);
        Self::new(name, value, unit, (warn, fail), beyond, remedy)
    }

    /// A value that should not be below its bounds. A value that is no number fails.
    pub fn at_least(
        name: &str,
        value: f64,
        unit: &str,
        (warn, fail): (Option<f64>, Option<f64>),
        remedy: &str,
    ) -> Self {
        let beyond = |bound: Option<f64>| bound.is_some_and(|bound| value < bound);
        Self::new(name, value, unit, (warn, fail), beyond, remedy)
    }

    fn new(
        name: &str,
        value: f64,
        unit: &str,
        (warn, fail): (Option<f64>, Option<f64>),
        beyond: impl Fn(Option<f64>) -> bool,
        remedy: &str,
    ) -> Self {
        let status = if !value.is_finite() || beyond(fail) {
            Status::Fail
        } else if beyond(warn) {
            Status::Warn
        } else {
            Status::Pass
        };
        Self {
            name: name.to_owned(),
            value: value.is_finite().then_some(value),
            unit: unit.to_owned(),
            warn,
            fail,
            status,
            remedy: (status != Status::Pass).then(|| remedy.to_owned()),
        }
    }

    /// Something that was found wanting as a whole: it fails, and says why.
    pub fn failed(name: &str, remedy: impl Into<String>) -> Self {
        let (unit, warn, fail, value) = (String::new(), None, None, None);
        Self { name: name.to_owned(), value, unit, warn, fail, status: Status::Fail, remedy: Some(remedy.into()) }
    }

    /// Something a person should know before using the result: it warns, and says why.
    pub fn warned(name: &str, remedy: impl Into<String>) -> Self {
        Self { status: Status::Warn, ..Self::failed(name, remedy) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_on_its_bound_passes_and_one_that_is_no_number_fails() {
        let gate = |value| Gate::at_most("sigma", value, "deg", (Some(0.2), Some(0.5)), "more poses").status;
        assert_eq!([0.2, 0.21, 0.5, 0.51].map(gate), [Status::Pass, Status::Warn, Status::Warn, Status::Fail]);
        assert_eq!(gate(f64::NAN), Status::Fail);
        let gate = |value| Gate::at_least("spread", value, "", (None, Some(0.02)), "tilt more").status;
        assert_eq!([0.02, 0.019].map(gate), [Status::Pass, Status::Fail]);
    }

    #[test]
    fn only_what_did_not_pass_says_what_to_do() {
        let gate = |value| Gate::at_most("sigma", value, "deg", (Some(0.2), None), "more poses").remedy;
        assert_eq!((gate(0.1), gate(0.3).as_deref()), (None, Some("more poses")));
    }

    #[test]
    fn the_verdict_is_the_worst_of_all() {
        assert_eq!(Status::worst([Status::Pass, Status::Fail, Status::Warn]), Status::Fail);
        assert_eq!(Status::worst([]), Status::Pass);
    }
}

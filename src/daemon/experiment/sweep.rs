//! The published method's figures against its parameters, one at a time, the others at their defaults.

use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::register::paper::{Neighbourhood, PaperOptions};
use tumbled_core::register::{Method, MethodOptions};

use super::figures::{Figures, Spread};
use super::pairs::Pair;
use super::registration::Runner;
use super::trial::{Start, Trial};

/// A parameter of the published method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Parameter {
    /// Pairs after which matching ends.
    M,
    /// Farthest point samples.
    N,
    /// The neighbourhood's radius, m.
    Rho,
    /// The descriptor's gate.
    Epsilon,
}

impl Parameter {
    /// Every one.
    pub const ALL: [Self; 4] = [Self::M, Self::N, Self::Rho, Self::Epsilon];

    /// As it is written: m, n, rho, epsilon.
    pub const fn name(self) -> &'static str {
        match self {
            Self::M => "m",
            Self::N => "n",
            Self::Rho => "rho",
            Self::Epsilon => "epsilon",
        }
    }

    /// The values that are tried: from too little to too much, the default among them.
    pub const fn values(self) -> &'static [f64] {
        match self {
            Self::M => &[5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 120.0, 160.0, 200.0],
            Self::N => &[25.0, 50.0, 100.0, 200.0, 300.0],
            Self::Rho => &[0.03, 0.05, 0.075, 0.10, 0.15, 0.20, 0.30],
            Self::Epsilon => &[0.03, 0.06, 0.10, 0.15, 0.25, 0.40, 0.80],
        }
    }

    fn options(self, value: f64) -> PaperOptions {
        let standard = PaperOptions::default();
        match self {
            Self::M => PaperOptions { pairs: value as usize, ..standard },
            // Matching ends with m pairs: with fewer samples there are no more of them.
            Self::N => PaperOptions { samples: value as usize, ..standard },
            Self::Rho => PaperOptions { neighbourhood: Neighbourhood::Ball { radius_m: value }, ..standard },
            Self::Epsilon => PaperOptions { epsilon: value, ..standard },
        }
    }
}

impl FromStr for Parameter {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = Self::ALL.into_iter().find(|parameter| parameter.name() == text.trim());
        named.ok_or_else(|| format!("`{text}`: m, n, rho or epsilon expected"))
    }
}

/// The published method with one parameter changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SweepPoint {
    /// Which parameter.
    pub parameter: Parameter,
    /// Its value; rho in m.
    pub value: f64,
    /// What came of it.
    pub figures: Figures,
    /// Median rotation error of all trials, degrees: with few right ones, theirs tells little.
    pub rotation_of_all_deg: Option<f64>,
    /// Median error at the centroid of all trials, mm.
    pub translation_of_all_mm: Option<f64>,
}

/// Registrations of a sweep over so many pairs.
pub fn trials(parameters: &[Parameter], pairs: u64) -> u64 {
    parameters.iter().map(|parameter| parameter.values().len() as u64).sum::<u64>() * pairs
}

/// Sweeps parameters over pairs.
pub fn run(parameters: &[Parameter], pairs: &[Pair], runner: &mut Runner) -> Vec<SweepPoint> {
    let mut points = Vec::new();
    for parameter in parameters {
        for value in parameter.values() {
            runner.set_options(MethodOptions { paper: parameter.options(*value), ..MethodOptions::default() });
            // It takes no prior: nothing is drawn by a seed.
            let trials = runner.register(pairs, (Method::CgaPaper, Start::Global), 0);
            let median = |of: &dyn Fn(&Trial) -> Option<f64>| {
                Spread::of(trials.iter().filter_map(of)).map(|spread| spread.median)
            };
            points.push(SweepPoint {
                parameter: *parameter,
                value: *value,
                figures: Figures::of(&trials),
                rotation_of_all_deg: median(&|trial| trial.rotation_error_deg),
                translation_of_all_mm: median(&|trial| trial.translation_error_m.map(|metres| 1e3 * metres)),
            });
        }
    }
    runner.set_options(MethodOptions::default());
    points
}

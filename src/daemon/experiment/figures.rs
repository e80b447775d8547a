//! What trials come to.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bounds::Share;
use super::trial::Trial;

/// The middle of some numbers, and where all but one in twenty end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// Half are below.
    pub median: f64,
    /// 95 of 100 are below.
    pub p95: f64,
}

impl Spread {
    /// Of numbers; `None`: there are none.
    pub fn of(numbers: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = numbers.collect();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        // Between two ranks the straight line.
        let at = |share: f64| {
            let place = share * last as f64;
            let (low, high) = (sorted.get(place.floor() as usize)?, sorted.get(place.ceil() as usize)?);
            Some(low + (high - low) * place.fract())
        };
        Some(Self { median: at(0.5)?, p95: at(0.95)? })
    }
}

/// What trials of one kind come to. Errors, residuals and NEES are of the right ones: of the wrong ones an error has no
/// meaning. Times are of all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Figures {
    /// Within 5° and 5 cm of the truth, of those whose truth is known.
    pub right: Share,
    /// The same up to the target's symmetry.
    pub right_up_to_symmetry: Share,
    /// Accepted, of all.
    pub accepted: Share,
    /// Accepted, of the right ones.
    pub accepted_of_right: Share,
    /// Accepted and wrong, of those whose truth is known.
    pub wrong_accepted: Share,
    /// Refused with other modes told, of all.
    pub refused_with_modes: Share,
    /// Rotation error of the right ones, degrees.
    pub rotation_deg: Option<Spread>,
    /// Error at the moving cloud's centroid of the right ones, mm.
    pub translation_mm: Option<Spread>,
    /// Root mean square error of the moving points of the right ones, mm.
    pub point_error_mm: Option<Spread>,
    /// The methods' own root mean square residual in the right ones, mm.
    pub rmse_mm: Option<Spread>,
    /// Mean NEES of the right ones: 6 if covariances are right, less if they are too large.
    pub nees_mean: Option<f64>,
    /// Overlap of all pairs, where it is known.
    pub overlap: Option<Spread>,
    /// Wall time of one registration, all preparation included, ms.
    pub time_ms: Option<Spread>,
}

impl Figures {
    /// Of trials.
    pub fn of(trials: &[Trial]) -> Self {
        let count = |holds: &dyn Fn(&Trial) -> bool| trials.iter().filter(|trial| holds(trial)).count();
        let judged = count(&|trial| trial.judged);
        let of_judged = |holds: &dyn Fn(&Trial) -> bool| Share::new(count(holds), judged);
        let of_all = |holds: &dyn Fn(&Trial) -> bool| Share::new(count(holds), trials.len());
        let right = |of: fn(&Trial) -> Option<f64>| trials.iter().filter(|trial| trial.right).filter_map(of);
        let nees: Vec<f64> = right(|trial| trial.nees).collect();
        let right_count = count(&|trial| trial.right);
        Self {
            right: Share::new(right_count, judged),
            right_up_to_symmetry: of_judged(&|trial| trial.right_up_to_symmetry),
            accepted: of_all(&|trial| trial.accepted),
            accepted_of_right: Share::new(count(&|trial| trial.right && trial.accepted), right_count),
            wrong_accepted: of_judged(&Trial::is_wrong_but_accepted),
            refused_with_modes: of_all(&|trial| !trial.accepted && trial.alternatives > 0),
            rotation_deg: Spread::of(right(|trial| trial.rotation_error_deg)),
            translation_mm: Spread::of(right(|trial| trial.translation_error_m).map(|metres| 1e3 * metres)),
            point_error_mm: Spread::of(right(|trial| trial.point_error_m).map(|metres| 1e3 * metres)),
            rmse_mm: Spread::of(right(|trial| trial.rmse_m).map(|metres| 1e3 * metres)),
            nees_mean: (!nees.is_empty()).then(|| nees.iter().sum::<f64>() / nees.len() as f64),
            overlap: Spread::of(trials.iter().filter_map(|trial| trial.overlap)),
            time_ms: Spread::of(trials.iter().map(|trial| trial.time_ms)),
        }
    }
}

/// A number with so many decimals; `-`: there is none.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}"))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A right trial of an error, degrees and as many centimetres.
    pub(crate) fn trial(error: f64, accepted: bool) -> Trial {
        Trial {
            pair: 0,
            overlap: Some(0.7),
            sights_deg: Some(20.0),
            judged: true,
            rotation_error_deg: Some(error),
            translation_error_m: Some(0.01 * error),
            point_error_m: Some(0.01 * error),
            right: error < 5.0,
            right_up_to_symmetry: error < 5.0,
            accepted,
            reason: (!accepted).then(|| "not accepted".to_owned()),
            score: Some(1.0),
            gap: None,
            inliers: Some(0.9),
            rmse_m: Some(0.01),
            nees: Some(3.0 * error),
            alternatives: u64::from(!accepted),
            alternative_right: false,
            iterations: 5,
            time_ms: 10.0 * error,
        }
    }

    #[test]
    fn figures_are_those_of_the_trials() {
        let trials = [trial(1.0, true), trial(2.0, true), trial(3.0, false), trial(50.0, true), trial(90.0, false)];
        let figures = Figures::of(&trials);
        let counts = |share: Share| (share.count, share.of);
        assert_eq!(counts(figures.right), (3, 5));
        assert_eq!(counts(figures.accepted), (3, 5));
        assert_eq!(counts(figures.accepted_of_right), (2, 3));
        assert_eq!(counts(figures.wrong_accepted), (1, 5));
        assert_eq!(counts(figures.refused_with_modes), (2, 5));
        let rotation = figures.rotation_deg.expect("right ones");
        // 1, 2, 3: the 95th percentile lies 1.9 of 2 ranks up.
        assert!((rotation.median - 2.0).abs() < 1e-12 && (rotation.p95 - 2.9).abs() < 1e-12);
        assert!((figures.translation_mm.expect("right ones").median - 20.0).abs() < 1e-9);
        assert!((figures.nees_mean.expect("right ones") - 6.0).abs() < 1e-12);
        // Times of all: 10, 20, 30, 500, 900.
        assert!((figures.time_ms.expect("five").median - 30.0).abs() < 1e-12);
    }

    #[test]
    fn of_no_trials_there_are_no_figures() {
        let figures = Figures::of(&[]);
        assert_eq!((figures.rotation_deg, figures.nees_mean, figures.right.share), (None, None, None));
    }
}

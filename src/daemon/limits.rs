//! Limits that a run has to keep: pass or fail, told beside its figures.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::cli::Failure;

/// The limits; what is left out is not asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Error of the spin rate, r.m.s., degrees a second (`evaluate`).
    #[schemars(range(min = 0.0))]
    pub rate_rms_dps: Option<f64>,
    /// Error of the spin axis, r.m.s., degrees; against a turntable the spread about its axis (`evaluate`).
    #[schemars(range(min = 0.0))]
    pub axis_rms_deg: Option<f64>,
    /// Error of the attitude, gauge-free, r.m.s., degrees; against a turntable that about its axis (`evaluate`).
    #[schemars(range(min = 0.0))]
    pub attitude_rms_deg: Option<f64>,
    /// Error of the position, gauge-free, r.m.s., mm (`evaluate` against full poses).
    #[schemars(range(min = 0.0))]
    pub position_rms_mm: Option<f64>,
    /// Packets, frames and chunks lost over those sent, all sensors together, 0 to 1 (`evaluate`, `run`).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub lost_share: Option<f64>,
    /// From an epoch's time to the hand-over of its state, 99th percentile, ms (`run`).
    #[schemars(range(min = 0.0))]
    pub latency_p99_ms: Option<f64>,
}

/// A limit beside what was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitCheck {
    /// Its key.
    pub limit: String,
    /// The most that is allowed.
    pub most: f64,
    /// What was found; null: nothing, which keeps no limit.
    pub found: Option<f64>,
    /// Whether it is kept.
    pub kept: bool,
}

impl Limits {
    /// From a file: its keys alone, or below `[limits]`, as in a config.
    ///
    /// # Errors
    /// Exit code 2: a file that cannot be read or is none of limits.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct File {
            limits: Limits,
        }
        let problem = |error: &dyn std::fmt::Display| Failure::input(format!("the limits {}: {error}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|error| problem(&error))?;
        let table: toml::Table = text.parse().map_err(|error| problem(&error))?;
        let limits = if table.contains_key("limits") {
            toml::from_str::<File>(&text).map(|file| file.limits)
        } else {
            toml::from_str(&text)
        };
        let limits: Self = limits.map_err(|error| problem(&error))?;
        for (key, value) in limits.given() {
            if !(value.is_finite() && value >= 0.0) {
                return Err(problem(&format_args!("{key} is {value}: a limit is 0 or more")));
            }
        }
        Ok(limits)
    }

    fn given(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let all = [
            ("rate_rms_dps", self.rate_rms_dps),
            ("axis_rms_deg", self.axis_rms_deg),
            ("attitude_rms_deg", self.attitude_rms_deg),
            ("position_rms_mm", self.position_rms_mm),
            ("lost_share", self.lost_share),
            ("latency_p99_ms", self.latency_p99_ms),
        ];
        all.into_iter().filter_map(|(key, value)| Some((key, value?)))
    }

    /// Holds each limit that is given against what was found under its key.
    pub fn check(&self, found: &[(&'static str, Option<f64>)]) -> Vec<LimitCheck> {
        let check = |(key, most): (&'static str, f64)| {
            let (_, found) = *found.iter().find(|(of, _)| *of == key)?;
            let kept = found.is_some_and(|found| found <= most);
            Some(LimitCheck { limit: key.to_owned(), most, found, kept })
        };
        self.given().filter_map(check).collect()
    }
}

/// Whether all are kept.
pub fn all_kept(checks: &[LimitCheck]) -> bool {
    checks.iter().all(|check| check.kept)
}

/// A line each, for people.
pub fn lines(checks: &[LimitCheck]) -> String {
    let line = |check: &LimitCheck| {
        let LimitCheck { limit, most, found, kept } = check;
        let found = found.map_or_else(|| "nothing was found".to_owned(), |found| format!("{found:.4}"));
        format!("limit {limit}: {found}, at most {most}: {}\n", if *kept { "kept" } else { "NOT KEPT" })
    };
    checks.iter().map(line).collect()
}

/// What was lost over what was sent.
pub fn lost_share(sensors: &[tumbled_core::SensorHealth]) -> Option<f64> {
    let lost: u64 = sensors.iter().map(|sensor| sensor.lost.total).sum();
    let received: u64 = sensors.iter().map(|sensor| sensor.received).sum();
    (lost + received > 0).then(|| lost as f64 / (lost + received) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_kept_up_to_its_bound_and_never_by_nothing() {
        let limits = Limits {
            rate_rms_dps: Some(0.5),
            axis_rms_deg: Some(1.0),
            lost_share: Some(0.0),
            latency_p99_ms: Some(90.0),
            ..Limits::default()
        };
        let found = [("rate_rms_dps", Some(0.5)), ("axis_rms_deg", None), ("lost_share", Some(1e-9))];
        let checks = limits.check(&found);
        let kept: Vec<(&str, bool)> = checks.iter().map(|check| (check.limit.as_str(), check.kept)).collect();
        // The latency is not known here and not asked for.
        assert_eq!(kept, [("rate_rms_dps", true), ("axis_rms_deg", false), ("lost_share", false)]);
        assert!(!all_kept(&checks) && all_kept(&checks[..1]) && all_kept(&[]));
        assert!(lines(&checks).contains("axis_rms_deg: nothing was found, at most 1: NOT KEPT"), "{}", lines(&checks));
    }

    #[test]
    fn a_file_holds_limits_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("limits.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).expect("writes");
            Limits::read(&path).map_err(|failure| failure.to_string())
        };
        let limits = Limits { axis_rms_deg: Some(0.3), ..Limits::default() };
        assert_eq!(read("axis_rms_deg = 0.3\n"), Ok(limits));
        assert_eq!(read("[limits]\naxis_rms_deg = 0.3\n"), Ok(limits));
        for (wrong, part) in [
            ("axis = 0.3\n", "unknown field"),
            ("axis_rms_deg = -1.0\n", "0 or more"),
            ("axis_rms_deg = nan\n", "0 or more"),
            ("[limits]\nrate = 1\n", "unknown field"),
            ("axis_rms_deg = \"a\"\n", "invalid type"),
            ("rubbish", "limits.toml"),
        ] {
            let refused = read(wrong).expect_err(wrong);
            assert!(refused.contains(part), "{wrong}: {refused}");
        }
    }
}

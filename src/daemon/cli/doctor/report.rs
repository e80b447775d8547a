//! What `tumbled doctor` finds, for machines and for people.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Everything that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled doctor --json")]
pub struct DoctorReport {
    /// No finding is a failure. Otherwise the exit code is 3, or 2 when the config itself cannot be used.
    pub healthy: bool,
    /// The findings, one or more a check.
    pub findings: Vec<Finding>,
    /// What no look from here tells, and what does.
    #[serde(default)]
    pub unseen: Vec<String>,
}

/// What it cannot see.
const UNSEEN: [&str; 5] = [
    "a firewall or a switch that drops packets on their way here: `tcpdump -ni INTERFACE udp port 2368` shows what arrives",
    "whether a LiDAR's clock is locked to PPS and UTC: `tumbled status --json` shows it once a session runs",
    "whether a calibration is of these very devices and of their mounting now: `tumbled calibrate extrinsic` on a new recording tells",
    "what a turntable answers: its port is not opened, because that resets many a microcontroller",
    "a disk that grows slow after minutes: tumbled_recording_dropped_total in /metrics counts what it cost",
];

/// One finding.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Finding {
    /// How it stands.
    pub level: Level,
    /// What was looked at: `config`, `receive_buffer`, `udp_port`, `lidar`, `kinect`, `turntable`, `disk`, `clock`, `stream`.
    pub check: String,
    /// Which one, where there are several: a sensor's id, a port, a key. Null: there is one.
    pub subject: Option<String>,
    /// What was found.
    pub message: String,
    /// What to do; null: nothing.
    pub remedy: Option<String>,
}

/// How something stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As it should be.
    Ok,
    /// It works, but not as well or as surely as it could.
    Warn,
    /// A session would lack something that the config asks for.
    Fail,
}

impl Level {
    const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Fail => "FAIL",
        }
    }
}

impl Finding {
    fn new(level: Level, check: &str, message: impl Into<String>) -> Self {
        Self { level, check: check.to_owned(), subject: None, message: message.into(), remedy: None }
    }

    /// Something is as it should be.
    pub(super) fn ok(check: &str, message: impl Into<String>) -> Self {
        Self::new(Level::Ok, check, message)
    }

    /// Something could be better.
    pub(super) fn warn(check: &str, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..Self::new(Level::Warn, check, message) }
    }

    /// Something is missing.
    pub(super) fn fail(check: &str, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..Self::new(Level::Fail, check, message) }
    }

    /// The same of one of several.
    #[must_use]
    pub(super) fn of(self, subject: impl ToString) -> Self {
        Self { subject: Some(subject.to_string()), ..self }
    }
}

impl DoctorReport {
    /// The report of these findings.
    pub(super) fn new(findings: Vec<Finding>) -> Self {
        let healthy = findings.iter().all(|finding| finding.level != Level::Fail);
        Self { healthy, findings, unseen: UNSEEN.map(str::to_owned).to_vec() }
    }

    /// One line a finding, its remedy below it.
    pub(super) fn text(&self) -> String {
        let label = |finding: &Finding| match &finding.subject {
            Some(subject) => format!("{} {subject}", finding.check),
            None => finding.check.clone(),
        };
        let width = self.findings.iter().map(|finding| label(finding).chars().count()).max().unwrap_or(0);
        let mut text = String::new();
        for finding in &self.findings {
            let (level, label) = (finding.level.name(), label(finding));
            text.push_str(&format!("{level:<4}  {label:<width$}  {}\n", finding.message));
            if let Some(remedy) = &finding.remedy {
                text.push_str(&format!("{:>1$}  -> {remedy}\n", "", width + 6));
            }
        }
        let count = |level| self.findings.iter().filter(|finding| finding.level == level).count();
        let (warnings, failures) = (count(Level::Warn), count(Level::Fail));
        text.push_str("Not seen from here:\n");
        for unseen in &self.unseen {
            text.push_str(&format!("  {unseen}\n"));
        }
        text.push_str(&match (warnings, failures) {
            (0, 0) => "Everything is as it should be.\n".to_owned(),
            (warnings, 0) => format!("Nothing fails; {warnings} to look at.\n"),
            (warnings, failures) => format!("{failures} to mend, {warnings} to look at.\n"),
        });
        text
    }
}

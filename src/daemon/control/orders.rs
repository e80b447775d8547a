//! What is asked on the control socket, and what is answered: a line of JSON each.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::Command;

use crate::session::run_info::RunInfo;

/// How long the empty room may be learned, s.
const LASTS_S: core::ops::RangeInclusive<f64> = 0.1..=600.0;

/// An order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// The room is empty from now on, for `lasts_s`: what is seen is background. A tracked target is forgotten.
    LearnBackground,
    /// Nothing is background any more.
    ForgetBackground,
    /// The target is forgotten and acquired anew.
    ResetFilter,
    /// `text` stands in the recording at this instant.
    Marker,
    /// What happens from now on is recorded, in `file`. A replay of it begins with the target unknown.
    RecordStart,
    /// The recording ends.
    RecordStop,
    /// The newest events, as many as `[record] pretrigger` keeps, are written to `file`, a recording of their own.
    Snapshot,
    /// What is given of `name`, `operator` and `text` (the note) is said of the run from now on.
    Note,
}

impl Order {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::LearnBackground,
        Self::ForgetBackground,
        Self::ResetFilter,
        Self::Marker,
        Self::RecordStart,
        Self::RecordStop,
        Self::Snapshot,
        Self::Note,
    ];
}

/// A request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled control: request")]
pub struct OrderLine {
    /// What to do.
    pub order: Order,
    /// For how long a background is learned, s, 0.1 to 600; left out: `target.background_s`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lasts_s: Option<f64>,
    /// A marker's or a note's text, at most 1024 bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// The file that is recorded: a name ending in `.mcap`, without a folder; left out: one by the date.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// The run's name, at most 1024 bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Who runs it, at most 1024 bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

/// A recording that was ordered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordingReply {
    /// Its first part.
    pub file: PathBuf,
    /// Events in it so far.
    pub events: u64,
    /// Its size so far, bytes.
    pub bytes: u64,
    /// How much of the session it covers, s; 0 while it runs.
    pub covers_s: f64,
}

/// The answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "class", rename_all = "UPPERCASE", deny_unknown_fields)]
#[schemars(title = "tumbled control: answer")]
pub enum Reply {
    /// The order is in the ledger, and the state stream's EVENT lines tell what comes of it; or it is carried out.
    Done {
        /// What was ordered.
        order: Order,
        /// When, ns on the session's timeline.
        t_ns: i64,
        /// The recording that it was about; left out where it was about none.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recording: Option<RecordingReply>,
    },
    /// It is not.
    Error {
        /// What was wrong, and what to do.
        message: String,
    },
}

impl OrderLine {
    /// An order with nothing beside it.
    pub const fn of(order: Order) -> Self {
        Self { order, lasts_s: None, text: None, file: None, name: None, operator: None }
    }

    /// What it says of the run.
    pub fn run_info(&self) -> RunInfo {
        RunInfo { name: self.name.clone(), note: self.text.clone(), operator: self.operator.clone() }
    }

    /// The order for the core; `background_s` is the config's.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn command(&self, background_s: f64) -> Result<Command, String> {
        match self.order {
            Order::LearnBackground => {
                let lasts_s = self.lasts_s.unwrap_or(background_s);
                if !LASTS_S.contains(&lasts_s) {
                    let (least, most) = (LASTS_S.start(), LASTS_S.end());
                    return Err(format!("lasts_s is {lasts_s}: a room is learned for {least} to {most} s"));
                }
                Ok(Command::LearnBackground { lasts_ms: (lasts_s * 1e3).round() as u32 })
            }
            Order::ForgetBackground => Ok(Command::ForgetBackground),
            Order::ResetFilter => Ok(Command::ResetFilter),
            Order::Marker => {
                let text = self.text.clone().unwrap_or_default();
                if text.is_empty() || text.len() > Command::TEXT_BYTES {
                    let (found, most) = (text.len(), Command::TEXT_BYTES);
                    return Err(format!("a marker's text of {found} bytes: it has 1 to {most}"));
                }
                Ok(Command::Marker { text: text.into() })
            }
            Order::RecordStart | Order::RecordStop | Order::Snapshot | Order::Note => {
                Err("this order is not for the core".to_owned())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(line: &str) -> Result<Command, String> {
        serde_json::from_str::<OrderLine>(line).map_err(|error| error.to_string())?.command(3.0)
    }

    #[test]
    fn orders_are_what_they_say_and_nonsense_is_refused_in_words() {
        assert_eq!(command(r#"{"order":"learn_background"}"#), Ok(Command::LearnBackground { lasts_ms: 3_000 }));
        let half = command(r#"{"order":"learn_background","lasts_s":0.5}"#);
        assert_eq!(half, Ok(Command::LearnBackground { lasts_ms: 500 }));
        assert_eq!(command(r#"{"order":"forget_background"}"#), Ok(Command::ForgetBackground));
        assert_eq!(command(r#"{"order":"reset_filter"}"#), Ok(Command::ResetFilter));
        for (line, part) in [
            (r#"{"order":"learn_background","lasts_s":1e9}"#, "0.1 to 600"),
            (r#"{"order":"learn_background","lasts_s":-1}"#, "0.1 to 600"),
            (r#"{"order":"marker"}"#, "0 bytes"),
            (r#"{"order":"fire"}"#, "unknown variant"),
            (r#"{"order":"reset_filter","force":true}"#, "unknown field"),
        ] {
            let refused = command(line).expect_err(line);
            assert!(refused.contains(part), "{refused}");
        }
    }
}

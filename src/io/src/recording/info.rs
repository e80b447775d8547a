//! What a recording holds and what of it is lost, as its reader finds it.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::counters::Counters;
use super::header::RecordingHeader;
use super::records::Damage;

/// At most so many damaged places of a part are listed.
const LISTED: usize = 64;

/// How a part was ended by its recorder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PartEnd {
    /// The recording ends with it.
    Finished,
    /// It goes on in another part.
    Rotated {
        /// Its file name.
        next: String,
    },
    /// The recorder stopped before it was told to.
    Stopped {
        /// Why.
        reason: String,
    },
}

/// One part of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartInfo {
    /// The file.
    pub path: PathBuf,
    /// Its number in the recording, from 0.
    pub number: u32,
    /// Its size.
    pub file_bytes: u64,
    /// How its recorder ended it; `None`: not at all, or the end record is lost.
    pub end: Option<PartEnd>,
    /// Data end, footer and closing magic are there: other programs open it as it is.
    pub finished: bool,
    /// Events read from it.
    pub events_read: u64,
    /// Events its end record counts.
    pub events_recorded: Option<u64>,
    /// What in it cannot be read; the first 64 places.
    pub damage: Vec<Damage>,
    /// Bytes that damage affects, all places.
    pub damaged_bytes: u64,
}

impl PartInfo {
    pub(crate) fn add_damage(&mut self, damage: Damage) {
        self.damaged_bytes += damage.bytes;
        if self.damage.len() < LISTED {
            self.damage.push(damage);
        }
    }

    /// Everything that was recorded is here, under an end record and an index.
    pub fn whole(&self) -> bool {
        let all = self.events_recorded.is_some_and(|recorded| recorded == self.events_read);
        self.finished && self.damage.is_empty() && all
    }

    /// Events that its end record counts and that cannot be read; `None`: there is no end record to tell.
    pub fn events_lost(&self) -> Option<u64> {
        Some(self.events_recorded?.saturating_sub(self.events_read))
    }

    pub(crate) fn read_end(&mut self, map: &BTreeMap<String, String>) {
        let detail = || map.get("detail").cloned().unwrap_or_default();
        self.events_recorded = map.get("events").and_then(|events| events.parse().ok());
        self.end = match map.get("end").map(String::as_str) {
            Some("finished") => Some(PartEnd::Finished),
            Some("rotated") => Some(PartEnd::Rotated { next: detail() }),
            Some("stopped") => Some(PartEnd::Stopped { reason: detail() }),
            _ => None,
        };
    }
}

/// What a recording holds. Complete once its reader is at its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingInfo {
    /// What it says of itself.
    pub header: RecordingHeader,
    /// The parts given, in order.
    pub parts: Vec<PartInfo>,
    /// What was read.
    pub counters: Counters,
    /// Messages that are not what their channel says: not delivered.
    pub undecodable: u64,
    /// Results of the session beside its ledger.
    pub results: u64,
    /// Messages of channels that replay has no use for.
    pub other_messages: u64,
}

impl RecordingInfo {
    /// Numbers of parts that lie between those given and were not given.
    pub fn missing_parts(&self) -> u32 {
        let numbers = self.parts.windows(2);
        numbers.map(|pair| if let [a, b] = pair { (b.number - a.number).saturating_sub(1) } else { 0 }).sum()
    }

    /// The file the recording goes on in, when its last part here is not the last there is.
    pub fn continued_in(&self) -> Option<&str> {
        match self.parts.last()?.end.as_ref()? {
            PartEnd::Rotated { next } => Some(next),
            PartEnd::Finished | PartEnd::Stopped { .. } => None,
        }
    }

    /// Every event recorded in the parts given was read.
    pub fn whole(&self) -> bool {
        self.undecodable == 0 && self.missing_parts() == 0 && self.parts.iter().all(PartInfo::whole)
    }

    /// Bytes that damage affects.
    pub fn damaged_bytes(&self) -> u64 {
        self.parts.iter().map(|part| part.damaged_bytes).sum()
    }

    /// What a person should know, a sentence each: damage, ends that are missing, parts that are missing.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for part in &self.parts {
            let name = part.path.display();
            for damage in &part.damage {
                let (offset, bytes, detail) = (damage.offset, damage.bytes, &damage.detail);
                warnings.push(format!("{name}, byte {offset}: {detail} ({bytes} bytes affected)"));
            }
            if part.events_recorded.is_none() {
                warnings.push(format!(
                    "{name} was not finished: what was recorded in its last second may be missing \
                     (`tumbled recover` makes a finished file of it)"
                ));
            }
            if let Some(lost) = part.events_lost().filter(|lost| *lost > 0) {
                warnings.push(format!("{name}: {lost} events of its end record's count cannot be read"));
            }
            if let Some(PartEnd::Stopped { reason }) = &part.end {
                warnings.push(format!("{name}: the recorder stopped: {reason}"));
            }
        }
        if self.header.config_damaged {
            warnings.push(
                "the recording's own config is damaged: where its data are decoded, give --config FILE".to_owned(),
            );
        }
        for file in self.header.files.iter().filter(|file| file.content.is_none()) {
            let (key, name) = (&file.key, &file.file.name);
            warnings.push(format!("the copy of {name} is damaged: where its data are decoded, give --set {key}=FILE"));
        }
        if self.missing_parts() > 0 {
            warnings.push(format!("{} parts between those given are missing", self.missing_parts()));
        }
        if let Some(next) = self.continued_in() {
            warnings.push(format!("the recording goes on in {next}: give that file too to read on"));
        }
        if self.undecodable > 0 {
            warnings.push(format!("{} messages are not what their channel says: not read", self.undecodable));
        }
        warnings
    }
}

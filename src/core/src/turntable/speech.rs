//! What is spoken on the line, either way, as one.

use super::sample::Reading;
use crate::clock::{ClockMode, ClockReport, DeviceClock, DeviceClockKind, Pushed};
use crate::config::{TurntableProtocol, TurntableSetup};
use std::collections::BTreeMap;
use tumbled_model::{RigNs, Span};
use tumbled_serial::line_stream::{LineStream, StreamCounts, StreamHeard};
use tumbled_serial::zaber::{
    Command, Counts, Heard, Identity, LineCounts, LineSettings, Listener, PositionKind, Setting, byte_time,
};

/// Something a chunk said.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Said {
    /// Where the stage was.
    Reading(Reading),
    /// The device began: its counts have nothing to do with those before.
    Begun,
    /// How far the encoder is from where the stage was told to be.
    FollowingError { at: RigNs, counts: i64 },
    /// The device's clock began anew.
    ClockBegan,
}

/// A protocol and what was heard in it.
#[derive(Debug)]
pub(super) enum Speech {
    Zaber(Box<Zaber>),
    Line(Box<Line>),
}

/// Zaber ASCII, overheard.
#[derive(Debug)]
pub(super) struct Zaber {
    listener: Listener,
    identity: Identity,
    heard: Vec<Heard>,
}

/// This project's line stream.
#[derive(Debug)]
pub(super) struct Line {
    stream: LineStream,
    clock: DeviceClock,
    clock_began: bool,
    counts_per_turn: Option<u32>,
    firmware: Option<String>,
    heard: Vec<StreamHeard>,
}

impl Speech {
    pub(super) fn new(setup: &TurntableSetup, mode: ClockMode) -> Self {
        match setup.protocol {
            TurntableProtocol::Zaber => {
                let line = LineSettings { byte_time: byte_time(setup.baud), ..LineSettings::default() };
                let (listener, identity) = (Listener::new(line), Identity::default());
                Self::Zaber(Box::new(Zaber { listener, identity, heard: Vec::new() }))
            }
            TurntableProtocol::Line => Self::Line(Box::new(Line {
                stream: LineStream::default(),
                clock: DeviceClock::new(DeviceClockKind::LineStream, mode),
                clock_began: false,
                counts_per_turn: None,
                firmware: None,
                heard: Vec::new(),
            })),
        }
    }

    /// Takes a chunk of either side; what it says is added to `said`.
    pub(super) fn chunk(&mut self, arrived: RigNs, bytes: &[u8], said: &mut Vec<Said>) {
        match self {
            Self::Zaber(zaber) => zaber.chunk(arrived, bytes, said),
            Self::Line(line) => line.chunk(arrived, bytes, said),
        }
    }

    /// The port was opened: what was waited for does not come any more.
    pub(super) fn begin(&mut self) {
        if let Self::Zaber(zaber) = self {
            zaber.listener.give_up();
        }
    }

    /// Counts of a turn, once the device has said.
    pub(super) fn counts_per_turn(&self) -> Option<u32> {
        match self {
            Self::Zaber(zaber) => zaber.identity.counts_per_turn,
            Self::Line(line) => line.counts_per_turn,
        }
    }

    /// Who the device says it is.
    pub(super) fn device(&self) -> Option<String> {
        match self {
            Self::Zaber(zaber) => {
                let Identity { device_id, serial, firmware, .. } = &zaber.identity;
                let part = |name: &str, value: Option<String>| value.map(|value| format!("{name} {value}"));
                let parts = [
                    part("Zaber", device_id.map(|id| id.to_string())),
                    part("serial", serial.map(|serial| serial.to_string())),
                    part("firmware", firmware.clone()),
                ];
                let known: Vec<String> = parts.into_iter().flatten().collect();
                (!known.is_empty()).then(|| known.join(", "))
            }
            Self::Line(line) => line.firmware.clone(),
        }
    }

    /// The device's clock; `None`: it has none, or nothing came yet.
    pub(super) fn clock(&self, t: RigNs) -> Option<ClockReport> {
        match self {
            Self::Zaber(_) => None,
            Self::Line(line) => line.clock_began.then(|| line.clock.report(t)),
        }
    }

    /// Lines that are missing by their numbers; `None`: they have none.
    pub(super) fn lost_lines(&self) -> Option<u64> {
        match self {
            Self::Zaber(_) => None,
            Self::Line(line) => Some(line.stream.counts().lost),
        }
    }

    /// Lines that could not be read, in all.
    pub(super) fn refused(&self) -> u64 {
        self.malformed().values().sum()
    }

    /// Lines that could not be read, by reason; those that happened.
    pub(super) fn malformed(&self) -> BTreeMap<String, u64> {
        match self {
            Self::Zaber(zaber) => {
                let LineCounts { not_text, too_long, bad_checksum, unchecked, continued, malformed, .. } =
                    zaber.listener.counts().lines;
                named([
                    ("not_text", not_text),
                    ("too_long", too_long),
                    ("bad_checksum", bad_checksum),
                    ("unchecked", unchecked),
                    ("continued", continued),
                    ("malformed", malformed),
                ])
            }
            Self::Line(line) => {
                let StreamCounts { not_text, too_long, bad_checksum, malformed, .. } = line.stream.counts();
                named([
                    ("not_text", not_text),
                    ("too_long", too_long),
                    ("bad_checksum", bad_checksum),
                    ("malformed", malformed),
                ])
            }
        }
    }

    /// Readable replies that were not used, by reason; those that happened.
    pub(super) fn refusals(&self) -> BTreeMap<String, u64> {
        let Self::Zaber(zaber) = self else { return BTreeMap::new() };
        let Counts { slow, late, wrong_id, wrong_address, bad_value, rejected, .. } = zaber.listener.counts();
        named([
            ("slow", slow),
            ("late", late),
            ("wrong_id", wrong_id),
            ("wrong_address", wrong_address),
            ("bad_value", bad_value),
            ("rejected", rejected),
        ])
    }
}

fn named<const N: usize>(counts: [(&str, u64); N]) -> BTreeMap<String, u64> {
    counts.into_iter().filter(|(_, n)| *n > 0).map(|(name, n)| (name.to_owned(), n)).collect()
}

impl Zaber {
    fn chunk(&mut self, arrived: RigNs, bytes: &[u8], said: &mut Vec<Said>) {
        self.listener.overheard(arrived, bytes, &mut self.heard);
        for heard in self.heard.drain(..) {
            match heard {
                Heard::Sample(sample) => said.push(Said::Reading(Reading {
                    t: sample.at,
                    half_rtt: Some(sample.half_rtt),
                    // Evenly spread over twice the half.
                    t_sigma: Span((sample.half_rtt.0 as f64 / 3.0_f64.sqrt()).round() as i64),
                    counts: sample.counts,
                    kind: sample.kind,
                    moving: Some(sample.moving),
                    warning: Some(sample.warning),
                })),
                Heard::Answer { at, command: Command::Get(Setting::EncoderPosError), reply } if reply.accepted => {
                    if let Ok(counts) = reply.data.parse() {
                        said.push(Said::FollowingError { at, counts });
                    }
                }
                Heard::Answer { command, reply, .. } => self.identity.learn(command, &reply),
                Heard::Alert { .. } => {}
            }
        }
    }
}

impl Line {
    fn chunk(&mut self, arrived: RigNs, bytes: &[u8], said: &mut Vec<Said>) {
        self.stream.push(arrived, bytes, &mut self.heard);
        for heard in self.heard.drain(..) {
            match heard {
                StreamHeard::Started { counts_per_turn, firmware } => {
                    (self.counts_per_turn, self.firmware) = (Some(counts_per_turn), Some(firmware));
                    said.push(Said::Begun);
                }
                StreamHeard::Reading(reading) => {
                    let pushed = self.clock.push(reading.device_us, reading.arrived);
                    if pushed == Pushed::NewEpoch && core::mem::replace(&mut self.clock_began, true) {
                        said.push(Said::ClockBegan);
                    }
                    if pushed == Pushed::Doubtful {
                        continue;
                    }
                    let Some(mapped) = self.clock.map(reading.device_us) else { continue };
                    said.push(Said::Reading(Reading {
                        t: mapped.t,
                        half_rtt: None,
                        t_sigma: mapped.sigma,
                        counts: reading.counts,
                        kind: PositionKind::Encoder,
                        moving: None,
                        warning: None,
                    }));
                }
            }
        }
    }
}

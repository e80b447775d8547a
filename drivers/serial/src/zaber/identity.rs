//! Who a stage says it is.

use super::command::{Command, Setting};
use super::message::Reply;

/// What the answers to [`Command::OPENING`] say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// The product's number.
    pub device_id: Option<u32>,
    /// The device's serial number.
    pub serial: Option<u64>,
    /// The firmware, as it is written.
    pub firmware: Option<String>,
    /// Counts of a full turn; not 0. `None` also where the stage has no full turn.
    pub counts_per_turn: Option<u32>,
}

impl Identity {
    /// Takes what an answer says; answers to other commands and refusals say nothing.
    pub fn learn(&mut self, command: Command, reply: &Reply) {
        if !reply.accepted {
            return;
        }
        match command {
            Command::Get(Setting::DeviceId) => self.device_id = reply.data.parse().ok(),
            Command::Get(Setting::SystemSerial) => self.serial = reply.data.parse().ok(),
            Command::Get(Setting::Version) => self.firmware = Some(reply.data.clone()),
            Command::Get(Setting::LimitCycleDist) => {
                self.counts_per_turn = reply.data.parse().ok().filter(|counts| *counts > 0);
            }
            _ => {}
        }
    }

    /// Whether the firmware knows `encoder.vel`: 7.29 and later. `None`: not known.
    pub fn has_encoder_velocity(&self) -> Option<bool> {
        let mut numbers = self.firmware.as_deref()?.split('.').map(str::parse::<u32>);
        let version = (numbers.next()?.ok()?, numbers.next()?.ok()?);
        Some(version >= (7, 29))
    }
}

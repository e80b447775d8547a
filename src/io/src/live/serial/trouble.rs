//! Why a serial port gives no angles, and what to do.

use crate::machine::{SerialHolder, in_use_by};
use core::fmt;
use std::io;
use std::path::PathBuf;

/// A port and what is the matter with it.
#[derive(Debug)]
pub struct SerialError {
    /// The port as the config names it.
    pub port: String,
    /// What is the matter.
    pub trouble: SerialTrouble,
}

/// What is the matter with a serial port.
#[derive(Debug)]
#[non_exhaustive]
pub enum SerialTrouble {
    /// Nothing has this name.
    Absent,
    /// No adapter has this USB serial number.
    NoAdapter {
        /// The configured number.
        serial: String,
    },
    /// More than one port has this USB serial number.
    SeveralAdapters {
        /// The configured number.
        serial: String,
        /// The ports.
        devices: Vec<PathBuf>,
    },
    /// Something else has the name: a file, a folder.
    NoDevice,
    /// It is a device, and not for this user.
    Forbidden,
    /// Another program has it.
    Busy {
        /// Who, as far as this user may know.
        holders: Vec<SerialHolder>,
    },
    /// The system refused something else while opening.
    Open {
        /// What it said.
        error: String,
    },
    /// No Zaber device answered.
    NoAnswer {
        /// At this rate.
        baud: u32,
        /// Bytes that came all the same.
        heard: u64,
    },
    /// A Zaber device answered, and no axis of it turns.
    NoRotaryAxis {
        /// The device's number on the chain.
        device: u8,
    },
    /// The stage stopped answering, or the stream stopped.
    Silent,
    /// The port takes no bytes.
    Clogged,
    /// The port is gone, or failed.
    Gone {
        /// What the system said.
        error: io::Error,
    },
}

impl std::error::Error for SerialError {}

impl fmt::Display for SerialError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let port = &self.port;
        match &self.trouble {
            SerialTrouble::Absent => {
                write!(f, "there is no serial port {port}: plug it in; `tumbled devices` lists those there are")
            }
            SerialTrouble::NoAdapter { serial } => write!(
                f,
                "no serial adapter has the USB serial number {serial}: plug it in; `tumbled devices` lists those there are"
            ),
            SerialTrouble::SeveralAdapters { serial, devices } => {
                let devices: Vec<String> = devices.iter().map(|device| device.display().to_string()).collect();
                write!(
                    f,
                    "{} ports have the USB serial number {serial}: {}; set turntable.port to one of them",
                    devices.len(),
                    devices.join(", ")
                )
            }
            SerialTrouble::NoDevice => write!(f, "{port} is no serial port: `tumbled devices` lists those there are"),
            SerialTrouble::Forbidden => write!(
                f,
                "no permission to use {port}: `usermod -aG dialout USER` and log in anew, or the rig's udev rule"
            ),
            SerialTrouble::Busy { holders } => {
                write!(f, "{port} is in use{}: end that program", in_use_by(holders))
            }
            SerialTrouble::Open { error } => write!(f, "cannot open {port}: {error}"),
            SerialTrouble::NoAnswer { baud, heard: 0 } => write!(
                f,
                "nothing answers on {port} at {baud} baud: check the stage's power and cable, turntable.baud and \
                 turntable.protocol"
            ),
            SerialTrouble::NoAnswer { baud, heard } => write!(
                f,
                "no Zaber device answers on {port} at {baud} baud, though {heard} bytes came: check turntable.baud and \
                 turntable.protocol"
            ),
            SerialTrouble::NoRotaryAxis { device } => write!(
                f,
                "the Zaber device {device} on {port} has no axis with a full turn: is it a rotary stage? \
                 turntable.counts_per_turn says how many counts a turn has where the device cannot"
            ),
            SerialTrouble::Silent => {
                write!(f, "{port} is open and says nothing any more: check the stage's power and cable")
            }
            SerialTrouble::Clogged => {
                write!(f, "{port} takes no bytes any more: unplug its adapter and plug it in again")
            }
            SerialTrouble::Gone { error } => write!(f, "{port} is gone: {error}; plug it in again"),
        }
    }
}

//! The journal of what the library did, and the truth about what was sent.

use std::fmt;
use std::fs::File;
use std::io::{self, Write};

use fake_libusb_control::{Corruption, Script};

use crate::clock::{Nanos, seconds};

/// Both files; a line is written at once, so that a test may read on while the child runs.
#[derive(Debug, Default)]
pub(crate) struct Chronicle {
    journal: Option<File>,
    truth: Option<File>,
}

impl Chronicle {
    pub(crate) fn create(script: &Script) -> io::Result<Self> {
        let journal = script.log.as_ref().map(File::create).transpose()?;
        let truth = script.truth.as_ref().map(File::create).transpose()?;
        Ok(Self { journal, truth })
    }

    /// Writes `SECONDS EVENT DETAILS` to the journal.
    pub(crate) fn journal(&mut self, time: Nanos, event: &str, details: impl fmt::Display) {
        line(&mut self.journal, format_args!("{:.6} {event} {details}", seconds(time)));
    }

    pub(crate) fn frame(&mut self, device: usize, number: u64, ticks: u32, time: Nanos, packets: u16) {
        let seconds = seconds(time);
        line(&mut self.truth, format_args!("frame {device} {number} {ticks} {seconds:.6} {packets}"));
    }

    pub(crate) fn lost(&mut self, device: usize, number: u64, packet: u16) {
        line(&mut self.truth, format_args!("lost {device} {number} {packet}"));
    }

    pub(crate) fn late(&mut self, device: usize, number: u64, packet: u16) {
        line(&mut self.truth, format_args!("late {device} {number} {packet}"));
    }

    pub(crate) fn corrupt(&mut self, device: usize, number: u64, packet: u16, kind: Corruption) {
        line(&mut self.truth, format_args!("corrupt {device} {number} {packet} {kind}"));
    }

    pub(crate) fn end(&mut self, device: usize, number: u64, sent: u16) {
        line(&mut self.truth, format_args!("end {device} {number} {sent}"));
    }
}

/// One write per line. A file that can no longer be written to is given up: the tests that need it will say so.
fn line(file: &mut Option<File>, text: fmt::Arguments<'_>) {
    if let Some(open) = file
        && let Err(error) = open.write_all(format!("{text}\n").as_bytes())
    {
        eprintln!("fake-libusb: cannot write: {error}");
        *file = None;
    }
}

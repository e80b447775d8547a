//! The journal of what the library did, and the truth about what was sent.

use std::fmt;
use std::io;

use fake_libusb_control::{Corruption, Script};

use crate::clock::{Nanos, seconds};
use crate::pen::Pen;

/// Both files. The journal is written to at once: what it speaks of is rare. Of the truth everything before a line of the
/// journal, or before a reply on the control socket, is in its file.
#[derive(Debug, Default)]
pub(crate) struct Chronicle {
    journal: Option<Pen>,
    truth: Option<Pen>,
}

impl Chronicle {
    pub(crate) fn create(script: &Script) -> io::Result<Self> {
        let create = |path: Option<&std::path::PathBuf>| path.map(|path| Pen::create(path)).transpose();
        Ok(Self { journal: create(script.log.as_ref())?, truth: create(script.truth.as_ref())? })
    }

    /// Waits until everything is in its file.
    pub(crate) fn flush(&self) {
        self.truth.iter().chain(&self.journal).for_each(Pen::flush);
    }

    /// Writes `SECONDS EVENT DETAILS` to the journal.
    pub(crate) fn journal(&mut self, time: Nanos, event: &str, details: impl fmt::Display) {
        line(self.journal.as_ref(), format_args!("{:.6} {event} {details}", seconds(time)));
        self.flush();
    }

    pub(crate) fn frame(&mut self, device: usize, number: u64, ticks: u32, time: Nanos, packets: u16) {
        let seconds = seconds(time);
        line(self.truth.as_ref(), format_args!("frame {device} {number} {ticks} {seconds:.6} {packets}"));
    }

    pub(crate) fn lost(&mut self, device: usize, number: u64, packet: u16) {
        line(self.truth.as_ref(), format_args!("lost {device} {number} {packet}"));
    }

    pub(crate) fn late(&mut self, device: usize, number: u64, packet: u16) {
        line(self.truth.as_ref(), format_args!("late {device} {number} {packet}"));
    }

    pub(crate) fn corrupt(&mut self, device: usize, number: u64, packet: u16, kind: Corruption) {
        line(self.truth.as_ref(), format_args!("corrupt {device} {number} {packet} {kind}"));
    }

    pub(crate) fn end(&mut self, device: usize, number: u64, sent: u16) {
        line(self.truth.as_ref(), format_args!("end {device} {number} {sent}"));
    }
}

fn line(to: Option<&Pen>, text: fmt::Arguments<'_>) {
    if let Some(pen) = to {
        pen.line(format!("{text}\n"));
    }
}

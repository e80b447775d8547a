//! Bytes from a Zaber chain to messages.

use super::message::{Checksums, Message, MessageError, PACKET_BYTES};
use crate::lines::{LineFault, Lines};
use tumbled_model::RigNs;

/// How many lines came, and what was wrong with those that were of no use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCounts {
    /// Replies.
    pub replies: u64,
    /// Info lines.
    pub infos: u64,
    /// Alerts.
    pub alerts: u64,
    /// Lines with a byte that is not printable ASCII.
    pub not_text: u64,
    /// Lines longer than any may be.
    pub too_long: u64,
    /// Lines whose checksum is another one.
    pub bad_checksum: u64,
    /// Lines without the checksum that is required.
    pub unchecked: u64,
    /// Lines that go on in a further line.
    pub continued: u64,
    /// Lines that are no message.
    pub malformed: u64,
}

impl LineCounts {
    /// All lines that were of no use.
    pub const fn refused(&self) -> u64 {
        self.not_text + self.too_long + self.bad_checksum + self.unchecked + self.continued + self.malformed
    }

    fn count(&mut self, line: &Result<Message, MessageError>) {
        let counter = match line {
            Ok(Message::Reply(_)) => &mut self.replies,
            Ok(Message::Info(_)) => &mut self.infos,
            Ok(Message::Alert(_)) => &mut self.alerts,
            Err(MessageError::Checksum { .. }) => &mut self.bad_checksum,
            Err(MessageError::Unchecked) => &mut self.unchecked,
            Err(MessageError::Continued) => &mut self.continued,
            Err(MessageError::Start | MessageError::Word { .. }) => &mut self.malformed,
        };
        *counter += 1;
    }
}

/// Reads messages from chunks cut anywhere. Holds one unfinished line; damage costs the line it is in, no more.
#[derive(Clone, Debug)]
pub struct Parser {
    lines: Lines,
    checksums: Checksums,
    counts: LineCounts,
}

impl Parser {
    /// A parser in front of the first byte.
    pub fn new(checksums: Checksums) -> Self {
        Self { lines: Lines::new(PACKET_BYTES), checksums, counts: LineCounts::default() }
    }

    /// Takes the bytes one read gave at `at`; hands over each message and when its first byte was there.
    pub fn push(&mut self, at: RigNs, bytes: &[u8], mut each: impl FnMut(RigNs, Message)) {
        let Self { lines, checksums, counts } = self;
        lines.push(at, bytes, |line| match line.text {
            Ok(text) => {
                let message = Message::parse(text, *checksums);
                counts.count(&message);
                if let Ok(message) = message {
                    each(line.begun, message);
                }
            }
            Err(LineFault::NotText) => counts.not_text += 1,
            Err(LineFault::TooLong) => counts.too_long += 1,
        });
    }

    /// What came so far.
    pub const fn counts(&self) -> LineCounts {
        self.counts
    }
}

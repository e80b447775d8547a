//! Both sides of a conversation with a stage, put together: which reply belongs to which request, and when the stage
//! was where it says.
//!
//! The position a reply carries was taken somewhere between the instant a, when the request had left the host, and the
//! instant b, when the reply's first byte had arrived. That byte was on the line for a known time before b. So the
//! sample's time is the middle of what remains, and half of b − a is how far it may be off.
//!
//! The listener only listens: it gives the same samples for the bytes of a live port and for the same bytes with the
//! same times out of a recording.

use super::address::{Address, MessageId};
use super::command::{Command, Setting};
use super::message::{Alert, Checksums, Message, Reply};
use super::parser::{LineCounts, Parser};
use super::quickest::Quickest;
use super::request::{Request, RequestLine};
use super::warning::{Severity, Warning};
use tumbled_model::{RigNs, Span};

/// What a listener has to know of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineSettings {
    /// The stage's axis, until a request to another one is heard: whom the host asks is whose replies count.
    pub axis: Address,
    /// How long a byte is on the line; 0 where there is no line (TCP, a pseudo-terminal). See [`byte_time`].
    pub byte_time: Span,
    /// A reply later than this after its request counts as late.
    pub timeout: Span,
    /// Whether replies need a checksum.
    pub checksums: Checksums,
}

impl Default for LineSettings {
    /// Device 1, axis 1, 115 200 baud, 100 ms, checksums required.
    fn default() -> Self {
        Self {
            axis: Address { device: 1, axis: 1 },
            byte_time: byte_time(115_200),
            timeout: Span::from_micros(100_000),
            checksums: Checksums::Required,
        }
    }
}

/// How long a byte of 8 bits without parity (ten bits with start and stop) is on a line; 0 for 0 baud.
pub const fn byte_time(baud: u32) -> Span {
    if baud == 0 { Span(0) } else { Span(10_000_000_000 / baud as i64) }
}

/// Where the stage was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// When: the middle between request and reply.
    pub at: RigNs,
    /// How far `at` may be off, at most.
    pub half_rtt: Span,
    /// The position, counts; not wrapped.
    pub counts: i64,
    /// Measured, or only commanded.
    pub kind: PositionKind,
    /// The axis was moving.
    pub moving: bool,
    /// The most urgent warning flag.
    pub warning: Warning,
}

/// What a position is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PositionKind {
    /// Read from the encoder.
    Encoder,
    /// Where the stage was told to be: no measurement.
    Commanded,
}

impl Sample {
    /// Whether the angle may be used as truth: measured, and the stage reports no fault.
    pub fn trusted(&self) -> bool {
        self.kind == PositionKind::Encoder && self.warning.severity() < Severity::Fault
    }
}

/// What was heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Heard {
    /// Where the stage was: the answer to a `get pos` or `get encoder.pos`.
    Sample(Sample),
    /// The answer to another command; or a refusal, whatever was asked.
    Answer {
        /// When its first byte had arrived.
        at: RigNs,
        /// What was asked.
        command: Command,
        /// What was answered.
        reply: Reply,
    },
    /// The stage said something by itself.
    Alert {
        /// When its first byte had arrived.
        at: RigNs,
        /// What it said.
        alert: Alert,
    },
}

/// How often what happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// The lines.
    pub lines: LineCounts,
    /// Samples given out.
    pub samples: u64,
    /// Samples left out because the round trip took more than three times as long as the quickest.
    pub slow: u64,
    /// Replies to requests that had been given up.
    pub late: u64,
    /// Replies under an id that nothing waited for.
    pub wrong_id: u64,
    /// Replies of another device or axis.
    pub wrong_address: u64,
    /// Positions that are no number.
    pub bad_value: u64,
    /// Commands the stage refused.
    pub rejected: u64,
}

/// Puts requests and replies together. One request waits for its reply at a time.
#[derive(Clone, Debug)]
pub struct Listener {
    settings: LineSettings,
    parser: Parser,
    matcher: Matcher,
}

#[derive(Clone, Debug)]
struct Matcher {
    /// Whose replies count: the axis that was asked last.
    own: Address,
    waiting: Option<(Request, RigNs)>,
    /// Ids of requests that were given up, a bit each: their replies may still come.
    given_up: u128,
    quickest: Quickest,
    counts: Counts,
}

/// Whether a recorded chunk is what the host asked, as [`Listener::overheard`] tells it.
pub fn is_request(bytes: &[u8]) -> bool {
    requested(bytes).is_some()
}

fn requested(bytes: &[u8]) -> Option<Request> {
    let line = core::str::from_utf8(bytes).unwrap_or_default().trim_end();
    RequestLine::parse(line)?.request()
}

fn bit(id: MessageId) -> u128 {
    1 << id.number()
}

impl Listener {
    /// A listener that has heard nothing.
    pub fn new(settings: LineSettings) -> Self {
        let matcher = Matcher {
            own: settings.axis,
            waiting: None,
            given_up: 0,
            quickest: Quickest::default(),
            counts: Counts::default(),
        };
        Self { settings, parser: Parser::new(settings.checksums), matcher }
    }

    /// A request has left the host at `at` (the write is drained). A request still waiting is given up.
    pub fn sent(&mut self, at: RigNs, request: &Request) {
        self.give_up();
        if let Some(id) = request.id {
            self.matcher.given_up &= !bit(id);
        }
        self.matcher.asked(request.address);
        self.matcher.waiting = Some((*request, at));
    }

    /// The request that waits is given up: its reply, should it still come, is late.
    pub fn give_up(&mut self) {
        if let Some(id) = self.matcher.waiting.take().and_then(|(request, _)| request.id) {
            self.matcher.given_up |= bit(id);
        }
    }

    /// The stage sent these bytes; the read that gave them returned at `at`.
    pub fn heard(&mut self, at: RigNs, bytes: &[u8], out: &mut Vec<Heard>) {
        let Self { settings, parser, matcher } = self;
        parser.push(at, bytes, |first_byte, message| match message {
            Message::Reply(reply) => out.extend(matcher.reply(settings, first_byte, reply)),
            Message::Alert(alert) => out.push(Heard::Alert { at: first_byte, alert }),
            Message::Info(_) => {}
        });
    }

    /// A chunk of either side, as a recording holds them: a request is one chunk and begins with `/`, which no line of
    /// a device does.
    pub fn overheard(&mut self, at: RigNs, bytes: &[u8], out: &mut Vec<Heard>) {
        match requested(bytes) {
            Some(request) => self.sent(at, &request),
            None => self.heard(at, bytes, out),
        }
    }

    /// How often what happened so far.
    pub fn counts(&self) -> Counts {
        Counts { lines: self.parser.counts(), ..self.matcher.counts }
    }

    /// The request whose reply is waited for, and when it had left.
    pub fn waiting(&self) -> Option<(Request, RigNs)> {
        self.matcher.waiting
    }
}

impl Matcher {
    fn asked(&mut self, address: Address) {
        if address.device != 0 {
            let axis = if address.axis == 0 { self.own.axis } else { address.axis };
            self.own = Address { axis, ..address };
        }
    }

    fn reply(&mut self, settings: &LineSettings, first_byte: RigNs, reply: Reply) -> Option<Heard> {
        let own = [self.own, self.own.whole()];
        if !own.contains(&reply.address) {
            self.counts.wrong_address += 1;
            return None;
        }
        let Some((request, sent)) = self.waiting.filter(|(request, _)| request.id == reply.id) else {
            match reply.id.filter(|id| self.given_up & bit(*id) != 0) {
                Some(id) => {
                    self.given_up &= !bit(id);
                    self.counts.late += 1;
                }
                None => self.counts.wrong_id += 1,
            }
            return None;
        };
        self.waiting = None;
        if first_byte - sent > settings.timeout {
            self.counts.late += 1;
            return None;
        }
        if !reply.accepted {
            self.counts.rejected += 1;
            return Some(Heard::Answer { at: first_byte, command: request.command, reply });
        }
        let kind = match request.command {
            Command::Get(Setting::EncoderPos) => PositionKind::Encoder,
            Command::Get(Setting::Pos) => PositionKind::Commanded,
            command => return Some(Heard::Answer { at: first_byte, command, reply }),
        };
        self.sample(settings, sent, first_byte, kind, &reply).map(Heard::Sample)
    }

    fn sample(
        &mut self,
        settings: &LineSettings,
        sent: RigNs,
        first_byte: RigNs,
        kind: PositionKind,
        reply: &Reply,
    ) -> Option<Sample> {
        let Ok(counts) = reply.data.parse::<i64>() else {
            self.counts.bad_value += 1;
            return None;
        };
        let round_trip = (first_byte - sent).0;
        let half_rtt = Span(round_trip / 2);
        // A reply before its request is a reply to something else; a slow one was held up on one of the two ways, so
        // the middle is not where the sample was.
        if round_trip < 0 || !self.quickest.admits(half_rtt) {
            self.counts.slow += 1;
            return None;
        }
        self.counts.samples += 1;
        let at = sent + Span((round_trip - settings.byte_time.0).max(0) / 2);
        Some(Sample { at, half_rtt, counts, kind, moving: reply.busy, warning: reply.warning })
    }
}

//! A session on the serial line: a host that polls, the emulated stage that answers, and the time every byte takes.

use super::emulator::{Latency, Outgoing, ZaberEmulator};
use super::mishaps::Mishaps;
use crate::noise::Noise;
use crate::transport::{Line, Transport};
use std::collections::BTreeMap;
use tumbled_model::{RigNs, Span};
use tumbled_serial::log::{LogEntry, Side};
use tumbled_serial::zaber::{Command, Heard, Poll, PollSettings, Turn, reopen_after};

/// What a session on the line is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineLogSettings {
    /// Its start.
    pub from: RigNs,
    /// Its end.
    pub until: RigNs,
    /// How the host polls.
    pub poll: PollSettings,
    /// How long the device takes at least, from request to sample and again from sample to reply.
    pub quickest: Latency,
    /// Mean of what comes on top, either way, exponentially distributed.
    pub jitter: Span,
    /// What happens to replies.
    pub mishaps: Mishaps,
    /// How what has come over the line gets to the host; `None`: at once.
    pub reads: Option<Transport>,
    /// The seed of the latencies.
    pub seed: u64,
}

impl LineLogSettings {
    /// A usual session: 115 200 baud through a USB adapter, 50 readings a second, a device that takes 0.3 ms and a little
    /// more either way, no mishaps.
    pub fn usual(until: RigNs, seed: u64) -> Self {
        Self {
            from: RigNs(0),
            until,
            poll: PollSettings::default(),
            quickest: Latency { to_sample: Span(300_000), to_reply: Span(300_000) },
            jitter: Span(100_000),
            mishaps: Mishaps { chance: 0.0, seed },
            reads: Some(Transport::SERIAL),
            seed,
        }
    }
}

/// The line from the device to the host.
#[derive(Clone, Debug)]
struct Inbox {
    /// Chunks by arrival and order.
    chunks: BTreeMap<(RigNs, u64), Vec<u8>>,
    replies: u64,
    chunk: u64,
    free: RigNs,
    reads: Option<Line>,
}

impl Inbox {
    /// Puts lines on the line one after the other. Each is read in two: its first byte, and the rest when it is there.
    fn put(&mut self, outgoing: Vec<Outgoing>, settings: &LineLogSettings) {
        for line in outgoing {
            self.replies += 1;
            let due = line.at;
            let Some(line) = settings.mishaps.befall(self.replies, line) else { continue };
            // A reply made late was held up behind the line: those after it do not wait for it.
            let in_time = line.at == due;
            let mut start = line.at.max(self.free);
            let (first, rest) = line.bytes.split_at(line.bytes.len().min(1));
            for part in [first, rest].into_iter().filter(|part| !part.is_empty()) {
                start = start + Span(settings.poll.line.byte_time.0.saturating_mul(part.len() as i64));
                let read = match &mut self.reads {
                    Some(reads) if in_time => reads.arrive(start),
                    _ => start,
                };
                self.chunk += 1;
                self.chunks.insert((read, self.chunk), part.to_vec());
            }
            if in_time {
                self.free = start;
            }
        }
    }

    /// The next chunk, if it is there before `until`.
    fn take(&mut self, until: RigNs) -> Option<(RigNs, Vec<u8>)> {
        let next = self.chunks.first_entry().filter(|next| next.key().0 <= until)?;
        let at = next.key().0;
        Some((at, next.remove()))
    }
}

/// Everything both sides send, in the order of its times; the host opens the conversation, then polls. An iterator:
/// a session of any length is made as it is needed.
#[derive(Debug)]
pub struct Conversation {
    emulator: ZaberEmulator,
    settings: LineLogSettings,
    inbox: Inbox,
    poll: Poll,
    now: RigNs,
    requests: u64,
    attempt: u32,
    heard: Vec<Heard>,
    /// Said already, but not before the time that was asked for.
    held: Option<LogEntry>,
}

impl Conversation {
    /// A host and this stage, from the settings' start on.
    pub fn new(emulator: ZaberEmulator, settings: LineLogSettings) -> Self {
        let reads = settings.reads.map(|transport| Line::new(transport, "turntable", 0, settings.seed));
        Self {
            inbox: Inbox { chunks: BTreeMap::new(), replies: 0, chunk: 0, free: settings.from, reads },
            poll: opened(settings.poll, settings.from),
            now: settings.from,
            requests: 0,
            attempt: 0,
            heard: Vec::new(),
            held: None,
            emulator,
            settings,
        }
    }

    /// The next that is said, if that is before `until`.
    pub fn next_before(&mut self, until: RigNs) -> Option<LogEntry> {
        self.held = self.next();
        self.held.take_if(|entry| entry.at < until)
    }

    /// The host was away until `at`, and opens the conversation anew: what the stage said meanwhile nobody heard, and all that
    /// the host has to know of the stage is asked for again.
    pub fn resume(&mut self, at: RigNs) {
        if at <= self.now {
            return;
        }
        self.held = None;
        self.inbox.chunks.clear();
        self.emulator.advance(at, &mut Vec::new());
        self.now = at;
        self.attempt = 0;
        self.poll = opened(self.settings.poll, at);
    }
}

impl Iterator for Conversation {
    type Item = LogEntry;

    fn next(&mut self) -> Option<LogEntry> {
        if let Some(held) = self.held.take() {
            return Some(held);
        }
        while self.now < self.settings.until {
            match self.poll.turn(self.now) {
                Turn::Write(bytes) => {
                    let byte_time = self.settings.poll.line.byte_time;
                    self.now = self.now + Span(byte_time.0.saturating_mul(bytes.len() as i64));
                    self.poll.written(self.now);
                    let mut answers = Vec::new();
                    let latency = latency(&self.settings, self.requests);
                    self.emulator.receive(self.now, &bytes, latency, &mut answers);
                    self.requests += 1;
                    self.inbox.put(answers, &self.settings);
                    return Some(LogEntry { at: self.now, side: Side::Host, bytes });
                }
                Turn::Wait(until) => {
                    let Some((at, bytes)) = self.inbox.take(until) else {
                        self.now = until;
                        let mut alerts = Vec::new();
                        self.emulator.advance(self.now, &mut alerts);
                        self.inbox.put(alerts, &self.settings);
                        continue;
                    };
                    // What came while the host was writing is read afterwards.
                    self.now = self.now.max(at);
                    self.poll.heard(self.now, &bytes, &mut self.heard);
                    if !self.heard.is_empty() {
                        self.attempt = 0;
                        self.heard.clear();
                    }
                    return Some(LogEntry { at: self.now, side: Side::Device, bytes });
                }
                Turn::Unanswered(command) => {
                    if Command::OPENING.contains(&command) {
                        self.poll.ask(command).expect("what was asked has left the queue");
                    }
                }
                Turn::Reopen => {
                    self.now = self.now + reopen_after(self.attempt);
                    self.attempt += 1;
                    self.poll = opened(self.settings.poll, self.now);
                }
            }
        }
        None
    }
}

fn opened(settings: PollSettings, now: RigNs) -> Poll {
    let mut poll = Poll::new(settings, now);
    for command in Command::OPENING {
        poll.ask(command).expect("six commands are fewer than may wait");
    }
    poll
}

fn latency(settings: &LineLogSettings, request: u64) -> Latency {
    let mut noise = Noise::new(settings.seed, "turntable.latency", request);
    let mut with_jitter = |quickest: Span| {
        let jitter = -libm::log(1.0 - noise.uniform()) * settings.jitter.0 as f64;
        quickest + Span(jitter as i64)
    };
    let Latency { to_sample, to_reply } = settings.quickest;
    Latency { to_sample: with_jitter(to_sample), to_reply: with_jitter(to_reply) }
}

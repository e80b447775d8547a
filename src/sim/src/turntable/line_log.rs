//! A session on the serial line: a host that polls, the emulated stage that answers, and the time every byte takes.

use super::emulator::{Latency, Outgoing, ZaberEmulator};
use super::mishaps::Mishaps;
use crate::noise::Noise;
use std::collections::BTreeMap;
use tumbled_model::{RigNs, Span};
use tumbled_serial::log::{LogEntry, Side};
use tumbled_serial::zaber::{Command, Poll, PollSettings, Turn, reopen_after};

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
    /// The seed of the latencies.
    pub seed: u64,
}

/// The line from the device to the host.
#[derive(Default)]
struct Inbox {
    /// Chunks by arrival and order.
    chunks: BTreeMap<(RigNs, u64), Vec<u8>>,
    replies: u64,
    chunk: u64,
    free: RigNs,
}

impl Inbox {
    /// Puts lines on the line one after the other. Each is read in two: its first byte, and the rest when it is there.
    fn put(&mut self, outgoing: Vec<Outgoing>, mishaps: &Mishaps, byte_time: Span) {
        for line in outgoing {
            self.replies += 1;
            let due = line.at;
            let Some(line) = mishaps.befall(self.replies, line) else { continue };
            let mut start = line.at.max(self.free);
            let (first, rest) = line.bytes.split_at(line.bytes.len().min(1));
            for part in [first, rest].into_iter().filter(|part| !part.is_empty()) {
                start = start + Span(byte_time.0.saturating_mul(part.len() as i64));
                self.chunk += 1;
                self.chunks.insert((start, self.chunk), part.to_vec());
            }
            // A reply made late was held up behind the line: those after it do not wait for it.
            if line.at == due {
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

/// Everything both sides send, in the order of its times; the host opens the conversation, then polls.
pub fn serial_log(emulator: &mut ZaberEmulator, settings: &LineLogSettings, mut each: impl FnMut(LogEntry)) {
    let byte_time = settings.poll.line.byte_time;
    let mut inbox = Inbox { free: settings.from, ..Inbox::default() };
    let mut poll = opened(settings.poll, settings.from);
    let (mut now, mut requests, mut attempt, mut heard) = (settings.from, 0, 0, Vec::new());
    while now < settings.until {
        match poll.turn(now) {
            Turn::Write(bytes) => {
                now = now + Span(byte_time.0.saturating_mul(bytes.len() as i64));
                poll.written(now);
                let mut answers = Vec::new();
                emulator.receive(now, &bytes, latency(settings, requests), &mut answers);
                requests += 1;
                inbox.put(answers, &settings.mishaps, byte_time);
                each(LogEntry { at: now, side: Side::Host, bytes });
            }
            Turn::Wait(until) => {
                let Some((at, bytes)) = inbox.take(until) else {
                    now = until;
                    let mut alerts = Vec::new();
                    emulator.advance(now, &mut alerts);
                    inbox.put(alerts, &settings.mishaps, byte_time);
                    continue;
                };
                // What came while the host was writing is read afterwards.
                now = now.max(at);
                poll.heard(now, &bytes, &mut heard);
                if !heard.is_empty() {
                    attempt = 0;
                    heard.clear();
                }
                each(LogEntry { at: now, side: Side::Device, bytes });
            }
            Turn::Unanswered(_) => {}
            Turn::Reopen => {
                now = now + reopen_after(attempt);
                attempt += 1;
                poll = opened(settings.poll, now);
            }
        }
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

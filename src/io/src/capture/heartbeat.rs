//! Ticks and anchors for captures that have none, so that they are a ledger like a live one.

use super::{CaptureError, Merged, StampOrigin};
use tumbled_model::{Body, Event, RigNs, Span, UnixNs};

/// From tick to tick.
pub const TICK: Span = Span(100_000_000);

/// From anchor to anchor, in ticks.
const TICKS_PER_ANCHOR: i64 = 10;

/// In a silence ticks are made for so long; then there are none until the next event. A watchdog has spoken long before,
/// and inputs that lie years apart are not filled with billions of ticks.
pub const LONGEST_SILENCE: Span = Span(60_000_000_000);

/// Merged captures with a [`Body::Tick`] every tenth of a second and an [`Body::Anchor`] every second.
///
/// * They come before the first event that arrived at their time or later; an anchor before the tick of the same time.
/// * `seq` is counted anew over everything. Nothing comes after the last event.
/// * Captures with synthetic times get no anchors: there is no wall clock to anchor to.
/// * Of recordings merged with other inputs, their own ticks and anchors are left out: they would come twice. So are
///   changes of their configs: all inputs are read with one.
/// * A single recording has its own heartbeat and passes unchanged.
#[derive(Debug)]
pub struct Heartbeat {
    merged: Merged,
    anchor: Option<UnixNs>,
    next_beat: i64,
    /// The beat at `next_beat` has had its anchor.
    anchored: bool,
    next_seq: u64,
    newest: RigNs,
    waiting: Option<Event>,
}

impl Heartbeat {
    /// Adds ticks and anchors to captures at their start.
    pub fn new(merged: Merged) -> Self {
        let synthetic = merged.summaries().any(|summary| summary.stamp_origin == StampOrigin::Synthetic);
        let anchor = merged.epoch().filter(|_| !synthetic);
        Self { merged, anchor, next_beat: 0, anchored: false, next_seq: 0, newest: RigNs(0), waiting: None }
    }

    /// The captures.
    pub fn merged(&self) -> &Merged {
        &self.merged
    }

    fn numbered(&mut self, arrived: RigNs, body: Body) -> Event {
        let seq = self.next_seq;
        self.next_seq += 1;
        Event { seq, arrived, body }
    }

    /// The anchor or tick that is due at `now` or before.
    fn beat(&mut self, now: RigNs) -> Option<Event> {
        let due = |beat: i64| RigNs(beat.saturating_mul(TICK.0));
        let silent_from = self.newest + LONGEST_SILENCE;
        if due(self.next_beat) > silent_from && now > silent_from {
            // The silence's share is spent: go on with the first beat at or after the event.
            let next = now.0.saturating_add(TICK.0 - 1).div_euclid(TICK.0);
            if next > self.next_beat {
                (self.next_beat, self.anchored) = (next, false);
            }
        }
        let at = due(self.next_beat);
        if at > now {
            return None;
        }
        if !self.anchored
            && self.next_beat % TICKS_PER_ANCHOR == 0
            && let Some(zero) = self.anchor
        {
            self.anchored = true;
            return Some(self.numbered(at, Body::Anchor { unix: UnixNs(zero.0.saturating_add(at.0)) }));
        }
        self.next_beat += 1;
        self.anchored = false;
        Some(self.numbered(at, Body::Tick))
    }
}

impl Iterator for Heartbeat {
    type Item = Result<Event, CaptureError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.merged.is_ledger() {
            return self.merged.next();
        }
        let event = match self.waiting.take() {
            Some(event) => event,
            None => loop {
                match self.merged.next()? {
                    Ok(Event { body: Body::Tick | Body::Anchor { .. } | Body::Config { .. }, .. }) => {}
                    Ok(event) => break event,
                    Err(error) => return Some(Err(error)),
                }
            },
        };
        // Where stamps step back the heartbeat waits for them to come up again.
        if let Some(beat) = self.beat(event.arrived) {
            self.waiting = Some(event);
            return Some(Ok(beat));
        }
        self.newest = self.newest.max(event.arrived);
        Some(Ok(self.numbered(event.arrived, event.body)))
    }
}

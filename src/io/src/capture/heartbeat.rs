//! Ticks and anchors for events that have none, so that they are a ledger like a live one.

use super::{Merged, StampOrigin};
use tumbled_model::{Body, Event, RigNs, Span, UnixNs};

/// From tick to tick.
pub const TICK: Span = Span(100_000_000);

/// From anchor to anchor, in ticks.
const TICKS_PER_ANCHOR: i64 = 10;

/// In a silence ticks are made for so long; then there are none until the next event. A watchdog has spoken long before,
/// and inputs that lie years apart are not filled with billions of ticks.
pub const LONGEST_SILENCE: Span = Span(60_000_000_000);

/// Events with a [`Body::Tick`] every tenth of a second and an [`Body::Anchor`] every second: merged captures, or what
/// simulated sensors send.
///
/// * They come before the first event that arrived at their time or later; an anchor before the tick of the same time.
/// * `seq` is counted anew over everything. Nothing comes after the last event.
/// * Where the wall time is not known there are no anchors.
/// * The source's own ticks and anchors are left out: they would come twice. So are changes of its config: everything is
///   read with one.
#[derive(Debug)]
pub struct Heartbeat<S> {
    source: S,
    /// The source has a heartbeat: it passes unchanged.
    beats_itself: bool,
    anchor: Option<UnixNs>,
    next_beat: i64,
    /// The beat at `next_beat` has had its anchor.
    anchored: bool,
    next_seq: u64,
    newest: RigNs,
    waiting: Option<Event>,
}

impl Heartbeat<Merged> {
    /// Merged captures. Those with synthetic times have no wall time; a single recording has its own heartbeat and passes
    /// unchanged.
    pub fn of_captures(merged: Merged) -> Self {
        let synthetic = merged.summaries().any(|summary| summary.stamp_origin == StampOrigin::Synthetic);
        let anchor = merged.epoch().filter(|_| !synthetic);
        Self { beats_itself: merged.is_ledger(), ..Self::new(merged, anchor) }
    }
}

impl<S> Heartbeat<S> {
    /// Events from their start on; `unix_at_zero`: the wall time at rig time 0, where it is known.
    pub fn new(source: S, unix_at_zero: Option<UnixNs>) -> Self {
        Self {
            source,
            beats_itself: false,
            anchor: unix_at_zero,
            next_beat: 0,
            anchored: false,
            next_seq: 0,
            newest: RigNs(0),
            waiting: None,
        }
    }

    /// Where the events come from.
    pub fn source(&self) -> &S {
        &self.source
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

impl<S, E> Iterator for Heartbeat<S>
where
    S: Iterator<Item = Result<Event, E>>,
{
    type Item = Result<Event, E>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.beats_itself {
            return self.source.next();
        }
        let event = match self.waiting.take() {
            Some(event) => event,
            None => loop {
                match self.source.next()? {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_and_anchors_come_before_what_arrives_with_them_and_failures_pass() {
        let event = |ms: i64, body| Event { seq: 77, arrived: RigNs(ms * 1_000_000), body };
        let marker = |ms| {
            let text = "x".into();
            event(ms, Body::Command(tumbled_model::Command::Marker { text }))
        };
        // The source's own beat is left out.
        let source = [Ok(marker(50)), Ok(event(60, Body::Tick)), Ok(marker(100)), Err("broken")];
        let out: Vec<_> = Heartbeat::new(source.into_iter(), Some(UnixNs(5))).collect();
        let told = out.iter().map(|event| match event {
            Err(error) => (*error).to_owned(),
            Ok(Event { seq, arrived, body: Body::Anchor { unix } }) => format!("{seq} {} anchor {}", arrived.0, unix.0),
            Ok(Event { seq, arrived, body: Body::Tick }) => format!("{seq} {} tick", arrived.0),
            Ok(Event { seq, arrived, .. }) => format!("{seq} {} event", arrived.0),
        });
        let expected =
            ["0 0 anchor 5", "1 0 tick", "2 50000000 event", "3 100000000 tick", "4 100000000 event", "broken"];
        assert_eq!(told.collect::<Vec<_>>(), expected);
    }
}

//! The newest events, kept in memory so that the past can be recorded, and what a recording that begins among them needs.
//!
//! ```text
//!   ledger ─▶ … evicted ─▶ │ standing: device tables, source states, anchor, config │ the newest events │ ◀─ now
//! ```
//! A recording that begins in mid-session begins with what was standing at that instant: without a Kinect's tables its frames
//! have no depth, without an anchor its times have no date.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use tumbled_model::{Body, Event, RigNs, SensorId, Span, UnixNs};

use crate::live::outlet::cost;

/// How much of the past is kept: whichever bound is reached first. Nothing by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RingBound {
    /// Time.
    pub span: Span,
    /// Memory, bytes.
    pub bytes: usize,
}

/// A stretch of the ledger that can be recorded for itself.
#[derive(Clone, Debug, Default)]
pub struct Excerpt {
    /// The config that was changed to last before its first event; `None`: the session's own still holds.
    pub config: Option<Arc<str>>,
    /// Its events: what was standing, at its first instant, then what came.
    pub events: Vec<Event>,
    /// It begins with the session: nothing is missing before it.
    pub from_start: bool,
}

impl Excerpt {
    /// How much of the session it covers.
    pub fn span(&self) -> Span {
        match (self.events.first(), self.events.last()) {
            (Some(first), Some(last)) => last.arrived - first.arrived,
            _ => Span(0),
        }
    }
}

/// What stands until something else of its kind comes.
#[derive(Clone, Debug, Default)]
struct Standing {
    states: BTreeMap<SensorId, Event>,
    tables: BTreeMap<SensorId, Event>,
    anchor: Option<(RigNs, UnixNs)>,
    config: Option<Arc<str>>,
}

impl Standing {
    fn take(&mut self, event: &Event) {
        match &event.body {
            Body::SensorState { sensor, .. } => drop(self.states.insert(sensor.clone(), event.clone())),
            Body::DeviceTables { sensor, .. } => drop(self.tables.insert(sensor.clone(), event.clone())),
            Body::Anchor { unix } => self.anchor = Some((event.arrived, *unix)),
            Body::Config { toml } => self.config = Some(Arc::clone(toml)),
            _ => {}
        }
    }

    /// As events right before `seq`, at the instant `t`. There is room for them: each had a number of its own below it.
    fn events(&self, seq: u64, t: RigNs) -> Vec<Event> {
        let mut standing: Vec<&Event> = self.states.values().chain(self.tables.values()).collect();
        standing.sort_unstable_by_key(|event| event.seq);
        let anchor = self.anchor.map(|(arrived, unix)| Body::Anchor { unix: unix + (t - arrived) });
        let bodies: Vec<Body> =
            anchor.into_iter().chain(standing.into_iter().map(|event| event.body.clone())).collect();
        let first = seq.saturating_sub(bodies.len() as u64);
        let at = |(n, body)| Event { seq: first + n as u64, arrived: t, body };
        bodies.into_iter().enumerate().map(at).collect()
    }
}

/// The newest events of a ledger.
#[derive(Debug)]
pub struct Ring {
    bound: RingBound,
    events: VecDeque<Event>,
    bytes: usize,
    /// Before the oldest event kept.
    before: Standing,
    /// Now.
    now: Standing,
    /// Number and arrival of the newest event.
    newest: Option<(u64, RigNs)>,
    evicted: bool,
}

impl Ring {
    /// An empty one.
    pub fn new(bound: RingBound) -> Self {
        let (before, now) = (Standing::default(), Standing::default());
        Self { bound, events: VecDeque::new(), bytes: 0, before, now, newest: None, evicted: false }
    }

    /// Takes the next event of the ledger.
    pub fn push(&mut self, event: &Event) {
        self.now.take(event);
        self.newest = Some((event.seq, event.arrived));
        self.bytes += cost(event);
        self.events.push_back(event.clone());
        while let Some(oldest) = self.events.front()
            && (self.bytes > self.bound.bytes || event.arrived - oldest.arrived > self.bound.span)
        {
            self.bytes -= cost(oldest);
            self.before.take(oldest);
            self.evicted = true;
            self.events.pop_front();
        }
    }

    /// Memory that the kept events hold, bytes.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Everything that is kept.
    pub fn kept(&self) -> Excerpt {
        let Some(first) = self.events.front() else { return self.from_now() };
        let mut events = self.before.events(first.seq, first.arrived);
        events.extend(self.events.iter().cloned());
        Excerpt { config: self.before.config.clone(), events, from_start: !self.evicted }
    }

    /// Nothing of the past but what stands now: what comes next follows it.
    pub fn from_now(&self) -> Excerpt {
        let (config, from_start) = (self.now.config.clone(), self.newest.is_none());
        let events = self.newest.map(|(seq, t)| self.now.events(seq + 1, t)).unwrap_or_default();
        Excerpt { config, events, from_start }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use tumbled_model::SourceState;

    fn event(seq: u64, t_ms: i64, body: Body) -> Event {
        Event { seq, arrived: RigNs(t_ms * 1_000_000), body }
    }

    fn packet(seq: u64, t_ms: i64) -> Event {
        event(seq, t_ms, Body::LidarPacket { sensor: "front".into(), bytes: Bytes::from(vec![0; 1_000]) })
    }

    fn opened(seq: u64) -> Event {
        event(seq, 1, Body::SensorState { sensor: "near".into(), state: SourceState::Opened })
    }

    fn tables(seq: u64) -> Event {
        event(seq, 2, Body::DeviceTables { sensor: "near".into(), bytes: Bytes::from_static(b"tables") })
    }

    fn filled(bound: RingBound) -> Ring {
        let mut ring = Ring::new(bound);
        ring.push(&event(0, 0, Body::Anchor { unix: UnixNs(5_000_000_000) }));
        ring.push(&opened(1));
        ring.push(&tables(2));
        (3..103).for_each(|n| ring.push(&packet(n, 10 * n as i64)));
        ring
    }

    #[test]
    fn it_holds_the_newest_and_what_stood_before_them_without_a_hole_in_the_numbers() {
        let ring = filled(RingBound { span: Span(200_000_000), bytes: usize::MAX });
        let kept = ring.kept();
        let seqs: Vec<u64> = kept.events.iter().map(|event| event.seq).collect();
        assert_eq!(seqs, (79..=102).collect::<Vec<_>>(), "three that stood, 21 packets of 200 ms");
        let first = 82 * 10_000_000;
        assert!(kept.events[..3].iter().all(|event| event.arrived.0 == first));
        assert_eq!(kept.events[0].body, Body::Anchor { unix: UnixNs(5_000_000_000 + first) });
        assert_eq!((&kept.events[1].body, &kept.events[2].body), (&opened(1).body, &tables(2).body));
        assert!(!kept.from_start && kept.config.is_none());
        assert_eq!(kept.span(), Span(200_000_000));
    }

    #[test]
    fn it_stays_below_its_bytes_and_nothing_is_missing_of_a_young_session() {
        let bound = RingBound { span: Span(i64::MAX), bytes: 20_000 };
        let ring = filled(bound);
        assert!(ring.bytes() <= 20_000 && ring.kept().events.len() > 15, "{}", ring.bytes());
        let mut young = Ring::new(RingBound { span: Span(i64::MAX), bytes: usize::MAX });
        [opened(0), tables(1), packet(2, 7)].iter().for_each(|event| young.push(event));
        assert!(young.kept().from_start);
        assert_eq!(young.kept().events, [opened(0), tables(1), packet(2, 7)]);
    }

    #[test]
    fn from_now_on_only_what_stands_comes_before_the_next_event() {
        let mut ring = filled(RingBound::default());
        assert_eq!((ring.bytes(), ring.events.len()), (0, 0), "no bound, no memory");
        ring.push(&event(103, 2_000, Body::Config { toml: "changed".into() }));
        let now = ring.from_now();
        assert_eq!(now.events.iter().map(|event| event.seq).collect::<Vec<_>>(), [101, 102, 103]);
        assert_eq!((now.config.as_deref(), now.from_start), (Some("changed"), false));
        let closed = event(104, 2_001, Body::SensorState { sensor: "near".into(), state: SourceState::Closed });
        ring.push(&closed);
        assert!(ring.from_now().events.iter().any(|event| event.body == closed.body), "the newest state stands");
    }
}

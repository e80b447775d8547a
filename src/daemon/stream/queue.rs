//! What waits for one client.
//!
//! ```text
//!   publisher ─ offer ─▶ max_hz (STATE, CLOUD): newest held until due ─▶ ┌ waiting, in order ┐ ─ next ─▶ writer
//!   server ── control ─────────────────────────────────────────────────▶ └ oldest data drop  ┘
//! ```
//!
//! Neither side waits for the other: the lock is held for a push or a pop, never over a write to the socket.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use super::class::{Class, Classes};
use super::frame::Frame;
use super::limits::Limits;
use super::request::Request;

/// The queue of one client.
#[derive(Debug)]
pub(super) struct Queue {
    /// Beside the lock, so that asking what is wanted never waits.
    subscribed: AtomicU16,
    inner: Mutex<Inner>,
    /// A line came, or the end was told.
    ready: Notify,
    /// The client is to be closed at once.
    cut: Notify,
}

/// What the writer does next.
#[derive(Debug)]
pub(super) enum Next {
    /// Write this line; so many data lines were dropped since the one before.
    Line { frame: Frame, dropped: u64 },
    /// Nothing to write until something comes or this instant is there.
    Wait(Option<Instant>),
    /// All is said: close.
    End,
}

/// How much waits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fill {
    pub(super) lines: usize,
    pub(super) bytes: usize,
}

#[derive(Debug)]
struct Inner {
    waiting: VecDeque<Frame>,
    data: Fill,
    control: Fill,
    bounds: Bounds,
    /// Since the last line that was taken.
    dropped: u64,
    period: Option<Duration>,
    state: Rated,
    cloud: Rated,
    ending: bool,
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    data: Fill,
    control: Fill,
}

/// A class that `max_hz` thins out.
#[derive(Debug, Default)]
struct Rated {
    /// When the next line may go.
    due: Option<Instant>,
    /// The newest line that came before.
    held: Option<Frame>,
}

impl Queue {
    /// The queue of a client that has not asked for anything yet.
    pub(super) fn new(limits: &Limits) -> Self {
        let bounds = Bounds {
            data: Fill { lines: limits.data_lines, bytes: limits.data_bytes },
            control: Fill { lines: limits.control_lines, bytes: limits.control_bytes },
        };
        let inner = Inner {
            waiting: VecDeque::new(),
            data: Fill::default(),
            control: Fill::default(),
            bounds,
            dropped: 0,
            period: None,
            state: Rated::default(),
            cloud: Rated::default(),
            ending: false,
        };
        Self {
            subscribed: AtomicU16::new(Classes::UNASKED.bits()),
            inner: Mutex::new(inner),
            ready: Notify::new(),
            cut: Notify::new(),
        }
    }

    /// Whether the client asked for lines of this class.
    pub(super) fn wants(&self, class: Class) -> bool {
        Classes::of_bits(self.subscribed.load(Ordering::Relaxed)).contains(class)
    }

    /// A published line, if the client wants it. Gives the number of data lines that had to be dropped for it.
    pub(super) fn offer(&self, frame: &Frame, now: Instant) -> u64 {
        if !self.wants(frame.class) {
            return 0;
        }
        if frame.class.is_control() {
            self.control(frame.clone());
            return 0;
        }
        let dropped = self.lock().offer(frame.clone(), now);
        self.ready.notify_one();
        dropped
    }

    /// A control line, wanted or not. A client that lets too many wait is cut off.
    pub(super) fn control(&self, frame: Frame) {
        let fits = self.lock().push_control(frame);
        self.ready.notify_one();
        if !fits {
            self.cut.notify_one();
        }
    }

    /// What waits is still written, then this line, then the connection ends.
    pub(super) fn end(&self, last: Option<Frame>) {
        let mut inner = self.lock();
        if let Some(last) = last {
            // The last line may go over the bound: none comes after it.
            inner.push_control(last);
        }
        inner.ending = true;
        drop(inner);
        self.ready.notify_one();
    }

    /// Carries out a request.
    pub(super) fn apply(&self, request: &Request) {
        let mut inner = self.lock();
        if let Some(classes) = request.subscribe {
            self.subscribed.store(classes.bits(), Ordering::Relaxed);
            for class in [Class::State, Class::Cloud].into_iter().filter(|class| !classes.contains(*class)) {
                *inner.rated(class) = Rated::default();
            }
        }
        if let Some(period) = request.period {
            inner.period = period;
            inner.release(None);
        }
        drop(inner);
        self.ready.notify_one();
    }

    /// The next thing to do for the writer.
    pub(super) fn next(&self, now: Instant) -> Next {
        let mut inner = self.lock();
        inner.release(Some(now));
        if let Some(frame) = inner.pop() {
            return Next::Line { frame, dropped: std::mem::take(&mut inner.dropped) };
        }
        if inner.ending { Next::End } else { Next::Wait(inner.due()) }
    }

    /// Waits for [`Queue::next`] to have something else to say.
    pub(super) async fn ready(&self) {
        self.ready.notified().await;
    }

    /// Waits for the client to be cut off.
    pub(super) async fn cut(&self) {
        self.cut.notified().await;
    }

    /// How much waits, both kinds together.
    pub(super) fn fill(&self) -> Fill {
        let inner = self.lock();
        let held: Vec<usize> =
            [&inner.state, &inner.cloud].iter().filter_map(|rated| rated.held.as_ref()).map(Frame::size).collect();
        Fill {
            lines: inner.data.lines + inner.control.lines + held.len(),
            bytes: inner.data.bytes + inner.control.bytes + held.iter().sum::<usize>(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing between lock and unlock can panic half-way; a poisoned queue is as good as any.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    fn offer(&mut self, frame: Frame, now: Instant) -> u64 {
        if self.ending {
            return 0;
        }
        if let (true, Some(period)) = (frame.class.is_rated(), self.period) {
            let rated = self.rated(frame.class);
            if rated.due.is_some_and(|due| now < due) {
                // Thinned out as asked for, not dropped: the newest goes when its time has come.
                rated.held = Some(frame);
                return 0;
            }
            rated.pass(period, now);
        }
        self.push_data(frame)
    }

    fn push_data(&mut self, frame: Frame) -> u64 {
        self.data.add(&frame);
        self.waiting.push_back(frame);
        let mut dropped = 0;
        while self.data.exceeds(self.bounds.data) {
            let Some(oldest) = self.waiting.iter().position(|frame| !frame.class.is_control()) else { break };
            if let Some(frame) = self.waiting.remove(oldest) {
                self.data.remove(&frame);
                dropped += 1;
            }
        }
        self.dropped += dropped;
        dropped
    }

    /// Whether it is still within the bounds.
    fn push_control(&mut self, frame: Frame) -> bool {
        if self.ending {
            return true;
        }
        self.control.add(&frame);
        self.waiting.push_back(frame);
        !self.control.exceeds(self.bounds.control)
    }

    fn pop(&mut self) -> Option<Frame> {
        let frame = self.waiting.pop_front()?;
        let fill = if frame.class.is_control() { &mut self.control } else { &mut self.data };
        fill.remove(&frame);
        Some(frame)
    }

    /// Queues the held lines whose time has come by `now`; all of them without a `now`.
    fn release(&mut self, now: Option<Instant>) {
        for class in [Class::State, Class::Cloud] {
            let period = self.period;
            let rated = self.rated(class);
            let is_due = match (now, rated.due) {
                (Some(now), Some(due)) => now >= due,
                _ => true,
            };
            if !is_due {
                continue;
            }
            let held = rated.held.take();
            match (now, period) {
                (Some(now), Some(period)) if held.is_some() => rated.pass(period, now),
                (None, _) => rated.due = None,
                _ => {}
            }
            if let Some(frame) = held {
                self.push_data(frame);
            }
        }
    }

    fn due(&self) -> Option<Instant> {
        [&self.state, &self.cloud].into_iter().filter(|rated| rated.held.is_some()).filter_map(|rated| rated.due).min()
    }

    fn rated(&mut self, class: Class) -> &mut Rated {
        if class == Class::Cloud { &mut self.cloud } else { &mut self.state }
    }
}

impl Rated {
    /// A line goes now. The beat is kept, so that jitter of the source does not lower the rate; after a pause it begins
    /// anew.
    fn pass(&mut self, period: Duration, now: Instant) {
        self.held = None;
        let on_the_beat = self.due.map(|due| due + period).filter(|next| *next > now);
        self.due = Some(on_the_beat.unwrap_or(now + period));
    }
}

impl Fill {
    fn add(&mut self, frame: &Frame) {
        self.lines += 1;
        self.bytes += frame.size();
    }

    fn remove(&mut self, frame: &Frame) {
        self.lines -= 1;
        self.bytes -= frame.size();
    }

    fn exceeds(self, bound: Self) -> bool {
        self.lines > bound.lines || self.bytes > bound.bytes
    }
}

#[cfg(test)]
mod tests;

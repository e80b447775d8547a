//! Predicted states at a steady rate: between epochs and without them, on a thread of its own.
//!
//! ```text
//!   core ── after each epoch: a Predictor ─▶ slot ─▶ beat: every 1/rate s, predicted to now ─▶ stream, telemetry
//! ```
//! The beats lie at multiples of the period since the start, so that they do not drift; one that is missed is left out.
//! What is told here is live only: it is in no recording, no hash and no `replay -o`.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tumbled_core::estimate::Predictor;
use tumbled_model::{RigNs, Span, UnixNs};

use crate::stream::{Class, Publisher, StateLine, StreamOrigin};
use crate::telemetry::{Telemetry, TelemetryOutlet};

/// What time it is on the session's timeline; `None`: a replay that keeps no pace, or has not begun.
pub type Now = Box<dyn Fn() -> Option<RigNs> + Send>;

/// To whom predicted states go.
#[derive(Debug)]
pub struct Listeners {
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The state stream's clients.
    pub stream: Publisher,
    /// The guidance computer.
    pub telemetry: Option<TelemetryOutlet>,
}

/// The running beat.
#[derive(Debug)]
pub struct Beat {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    slot: Mutex<Slot>,
    ended: Condvar,
}

#[derive(Debug, Default)]
struct Slot {
    latest: Option<Arc<Latest>>,
    ended: bool,
}

/// The newest that is known.
#[derive(Debug)]
struct Latest {
    predictor: Predictor,
    /// Wall time at rig time 0, by the newest anchor.
    unix_at_zero: UnixNs,
}

impl Beat {
    /// Begins to beat `rate_hz` times a second, above 0.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(rate_hz: f64, now: Now, listeners: Listeners) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let beat = move || beat(&of_thread, rate_hz, &now, &listeners);
        let thread = std::thread::Builder::new().name("beat".to_owned()).spawn(beat)?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// What is predicted with from now on.
    pub fn set(&self, predictor: &Predictor, unix_at_zero: UnixNs) {
        let latest = Arc::new(Latest { predictor: predictor.clone(), unix_at_zero });
        self.shared.lock().latest = Some(latest);
    }

    /// What is predicted with is of another play: nothing is, until the next is set.
    pub fn clear(&self) {
        self.shared.lock().latest = None;
    }
}

impl Drop for Beat {
    /// No line comes after this.
    fn drop(&mut self) {
        self.shared.lock().ended = true;
        self.shared.ended.notify_all();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so itself.
            thread.join().unwrap_or_default();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Slot> {
        // A slot is whole after every statement.
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until an instant; the newest then, or the end.
    fn wait(&self, due: Instant) -> Result<Option<Arc<Latest>>, Ended> {
        let mut slot = self.lock();
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if slot.ended {
                return Err(Ended);
            }
            if left.is_zero() {
                return Ok(slot.latest.clone());
            }
            slot = self.ended.wait_timeout(slot, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// The session ends.
struct Ended;

fn beat(shared: &Shared, rate_hz: f64, now: &Now, listeners: &Listeners) {
    let began = Instant::now();
    loop {
        let due = began + next_beat(began.elapsed(), rate_hz);
        let Ok(latest) = shared.wait(due) else { return };
        if let (Some(latest), Some(t)) = (latest, now()) {
            listeners.tell(&latest, t);
        }
    }
}

/// The first beat after `elapsed`: the next multiple of the period.
fn next_beat(elapsed: Duration, rate_hz: f64) -> Duration {
    let next = |passed: f64| Duration::from_secs_f64((passed + 1.0) / rate_hz);
    let passed = (elapsed.as_secs_f64() * rate_hz).floor();
    let beat = next(passed);
    // Rounding may give the beat that was just waited for.
    if beat > elapsed { beat } else { next(passed + 1.0) }
}

impl Listeners {
    fn tell(&self, latest: &Latest, t: RigNs) {
        let of_stream = self.stream.wants(Class::State);
        let telemetry = self.telemetry.as_ref().filter(|telemetry| telemetry.kinds().predicted());
        if !of_stream && telemetry.is_none() {
            return;
        }
        let state = latest.predictor.at(t);
        let unix = latest.unix_at_zero + Span(t.0);
        if let Some(telemetry) = telemetry {
            telemetry.send(&Telemetry::of_prediction(&state, unix));
        }
        if of_stream {
            let line = StateLine::of_prediction(self.origin, &state, latest.predictor.measured(), unix);
            self.stream.publish(Class::State, &line);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beats_are_multiples_of_the_period_and_missed_ones_are_left_out() {
        let ms = Duration::from_millis;
        assert_eq!(next_beat(ms(0), 100.0), ms(10));
        assert_eq!(next_beat(ms(10), 100.0), ms(20));
        assert_eq!(next_beat(Duration::from_micros(10_300), 100.0), ms(20));
        // 37 ms late: the beats at 20 and 30 ms are gone, the next one is where it would have been anyway.
        assert_eq!(next_beat(ms(37), 100.0), ms(40));
    }

    #[test]
    fn a_day_of_beats_at_an_odd_rate_does_not_drift() {
        // 86 400 s · 119.88 Hz = 10 357 632 beats; the last is due at a day, to a microsecond.
        let day = Duration::from_secs(86_400);
        let last = next_beat(day - Duration::from_millis(4), 119.88);
        assert!(last.abs_diff(day) < Duration::from_micros(1), "{last:?}");
    }
}

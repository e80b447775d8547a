//! How time passes on the bus.

use std::time::{Duration, Instant};

use fake_libusb_control::Pace;

/// A time in nanoseconds after the host's first `libusb_init`.
pub(crate) type Nanos = u64;

/// One slot of a high-speed bus, which carries at most one packet of an endpoint.
pub(crate) const SLOT: Nanos = 125_000;

/// The clock of one bus.
#[derive(Debug)]
pub(crate) struct Clock {
    pace: Pace,
    began: Instant,
    /// At the fast pace: the time shown, and when it was last looked at.
    shown: Nanos,
    looked: Instant,
}

impl Clock {
    pub(crate) fn new(pace: Pace, began: Instant) -> Self {
        Self { pace, began, shown: 0, looked: began }
    }

    /// The time. At the fast pace it stands still while the host `works` (has packets to take): however slow it is, it
    /// loses none. Else it passes as everywhere.
    pub(crate) fn now(&mut self, works: bool) -> Nanos {
        let now = Instant::now();
        if self.pace == Pace::Real {
            return nanos(now.duration_since(self.began));
        }
        if !works {
            self.shown += nanos(now.duration_since(self.looked));
        }
        self.looked = now;
        self.shown
    }

    /// At the fast pace: it is `time` now, if it is not yet later.
    pub(crate) fn hurry(&mut self, time: Nanos) {
        self.shown = self.shown.max(time);
    }

    pub(crate) fn is_fast(&self) -> bool {
        self.pace == Pace::Fast
    }
}

/// A duration in nanoseconds; five centuries at most.
pub(crate) fn nanos(duration: Duration) -> Nanos {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Seconds of a script in nanoseconds.
pub(crate) fn from_seconds(seconds: f64) -> Nanos {
    (seconds * 1e9) as Nanos
}

/// Nanoseconds in seconds, to write down.
pub(crate) fn seconds(time: Nanos) -> f64 {
    time as f64 * 1e-9
}

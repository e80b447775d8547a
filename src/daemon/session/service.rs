//! What the service manager is told: ready, what is awaited, and that the core is alive (sd_notify(3)).
//!
//! Outside of a service, without `NOTIFY_SOCKET`, nothing is told to nobody. The watchdog is fed by the core's own thread, after an event
//! that it has computed: a core that hangs feeds nothing, and the service is started anew.

use std::time::{Duration, Instant};

use sd_notify::NotifyState;
use tumbled_core::health::Reason;

/// Sockets are bound, the config is valid, every source is open or tried again and again.
pub fn ready() {
    tell(&[NotifyState::Ready]);
}

/// The end has begun.
pub fn stopping() {
    tell(&[NotifyState::Stopping]);
}

/// The line that `systemctl status` shows.
#[derive(Debug, Default)]
pub struct Status(String);

impl Status {
    /// What is missing, or that nothing is; said again only where it has changed.
    pub fn tell<'a>(&mut self, reasons: impl Iterator<Item = &'a Reason>) {
        let missing: Vec<&str> = reasons.map(|reason| reason.message.as_str()).collect();
        let line = if missing.is_empty() { "measuring".to_owned() } else { missing.join("; ") };
        if self.0 != line {
            tell(&[NotifyState::Status(&line)]);
            self.0 = line;
        }
    }
}

/// Feeds the watchdog from the core's thread.
#[derive(Debug)]
pub struct Watchdog {
    /// Fed so often; `None`: there is none.
    every: Option<Duration>,
    fed: Instant,
    feeds: u64,
}

impl Watchdog {
    /// By `WATCHDOG_USEC`: it is fed four times in its period.
    pub fn of_service() -> Self {
        Self { every: sd_notify::watchdog_enabled().map(|period| period / 4), fed: Instant::now(), feeds: 0 }
    }

    /// How often it was fed.
    pub fn feeds(&self) -> u64 {
        self.feeds
    }

    /// The core has computed an event. Ticks come ten times a second, whatever the sensors do.
    pub fn alive(&mut self) {
        if self.every.is_some_and(|every| self.fed.elapsed() >= every) {
            self.fed = Instant::now();
            self.feeds += 1;
            tell(&[NotifyState::Watchdog]);
        }
    }
}

/// A manager that does not listen is no reason to stop measuring.
fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::debug!("the service manager was not told: {error}");
    }
}

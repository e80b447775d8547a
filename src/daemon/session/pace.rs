//! How fast recorded events are played: it changes when they are seen, never what they are.

use std::str::FromStr;
use std::time::Duration;

use tumbled_io::live::StopToken;
use tumbled_model::RigNs;

use super::beat::Now;
use super::transport::{Due, Transport};

/// Rig seconds per second, or as fast as the machine can.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// No waiting.
    Max,
    /// So many times the recording's own pace, above 0.
    Times(f64),
}

/// A speed that is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no speed: `max`, or how many times as fast, e.g. 1, 4, 0.5")]
pub struct NoSpeed(String);

impl FromStr for Speed {
    type Err = NoSpeed;

    fn from_str(text: &str) -> Result<Self, NoSpeed> {
        if text == "max" {
            return Ok(Self::Max);
        }
        let times = text.parse::<f64>().ok().filter(|times| (1e-3..=1e6).contains(times));
        times.map(Self::Times).ok_or_else(|| NoSpeed(text.to_owned()))
    }
}

/// What a wait ended with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waited {
    /// The event's time has come.
    Due,
    /// It has not come yet: wait again.
    NotYet,
    /// The replay is to end, or to begin anew.
    Stopped,
}

/// Waits until each event's time has come.
#[derive(Debug)]
pub struct Pace {
    transport: Transport,
    stop: StopToken,
}

/// Shorter waits are left out: the next event makes up for them.
const SHORTEST_WAIT: Duration = Duration::from_millis(1);

/// So soon an order is followed.
const LOOK_EVERY: Duration = Duration::from_millis(50);

impl Pace {
    /// A pace that a stop interrupts.
    pub fn new(speed: Speed, stop: StopToken) -> Self {
        Self::steered(Transport::new(speed, None), stop)
    }

    /// A pace that follows the orders a transport is given.
    pub fn steered(transport: Transport, stop: StopToken) -> Self {
        Self { transport, stop }
    }

    /// What time it is on the session's timeline as it is played; `None` before the first event, while it is held, and
    /// without a pace.
    pub fn clock(&self) -> Now {
        let transport = self.transport.clone();
        Box::new(move || transport.now())
    }

    /// Waits until it is time for an event that arrived at `arrived`, 50 ms at most.
    pub fn wait(&mut self, arrived: RigNs) -> Waited {
        if self.stop.is_stopped() {
            return Waited::Stopped;
        }
        let left = match self.transport.due(arrived) {
            Due::Now => return Waited::Due,
            Due::Restart => return Waited::Stopped,
            Due::After(left) if left < SHORTEST_WAIT => return Waited::Due,
            Due::After(left) => left,
            Due::Held => Duration::MAX,
        };
        if self.stop.wait(left.min(LOOK_EVERY)) { Waited::Stopped } else { Waited::NotYet }
    }

    /// Everything was played: waits until it is to begin anew, true, or to end. `waiting` is called while it lasts.
    pub fn rest(&mut self, mut waiting: impl FnMut()) -> bool {
        self.transport.end();
        while !self.transport.take_restart() {
            waiting();
            if self.stop.wait(LOOK_EVERY) {
                return false;
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    #[test]
    fn a_speed_is_max_or_a_positive_number() {
        assert_eq!("max".parse(), Ok(Speed::Max));
        assert_eq!("0.5".parse(), Ok(Speed::Times(0.5)));
        for wrong in ["", "0", "-1", "nan", "inf", "fast", "1x"] {
            assert_eq!(wrong.parse::<Speed>(), Err(NoSpeed(wrong.to_owned())));
        }
    }

    #[test]
    fn four_times_as_fast_takes_a_quarter_of_the_time_and_a_stop_ends_it() {
        let stop = StopToken::new().expect("a descriptor");
        let mut pace = Pace::new(Speed::Times(4.0), stop.clone());
        let began = Instant::now();
        assert_eq!(pace.wait(RigNs(5_000_000_000)), Waited::Due);
        // 200 ms at four times the speed, at most a millisecond early.
        while pace.wait(RigNs(5_200_000_000)) == Waited::NotYet {}
        assert!(began.elapsed() >= Duration::from_millis(49));
        stop.stop();
        assert_eq!(pace.wait(RigNs(3_600_000_000_000)), Waited::Stopped);
    }
}

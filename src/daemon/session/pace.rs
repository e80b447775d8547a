//! How fast recorded events are played: it changes when they are seen, never what they are.

use std::str::FromStr;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use tumbled_io::live::StopToken;
use tumbled_model::{RigNs, Span};

use super::beat::Now;

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
    /// The replay is to end.
    Stopped,
}

/// Waits until each event's time has come.
#[derive(Debug)]
pub struct Pace {
    speed: Speed,
    /// Shared with the clock.
    began: Arc<OnceLock<(Instant, RigNs)>>,
    stop: StopToken,
}

/// Shorter waits are left out: the next event makes up for them.
const SHORTEST_WAIT: Duration = Duration::from_millis(1);

impl Pace {
    /// A pace that a stop interrupts.
    pub fn new(speed: Speed, stop: StopToken) -> Self {
        Self { speed, began: Arc::default(), stop }
    }

    /// What time it is on the session's timeline as it is played; `None` before the first event, and without a pace.
    pub fn clock(&self) -> Now {
        let (speed, began) = (self.speed, Arc::clone(&self.began));
        Box::new(move || {
            let Speed::Times(times) = speed else { return None };
            let (began, first) = began.get()?;
            Some(*first + Span((began.elapsed().as_secs_f64() * times * 1e9) as i64))
        })
    }

    /// Waits until it is time for an event that arrived at `arrived`, at most `at_most`.
    pub fn wait(&mut self, arrived: RigNs, at_most: Duration) -> Waited {
        if self.stop.is_stopped() {
            return Waited::Stopped;
        }
        let Speed::Times(times) = self.speed else { return Waited::Due };
        let (began, first) = *self.began.get_or_init(|| (Instant::now(), arrived));
        let due_s = ((arrived - first).as_secs_f64() / times).clamp(0.0, 1e9);
        let left = Duration::from_secs_f64(due_s).saturating_sub(began.elapsed());
        if left < SHORTEST_WAIT {
            Waited::Due
        } else if self.stop.wait(left.min(at_most)) {
            Waited::Stopped
        } else if left <= at_most {
            Waited::Due
        } else {
            Waited::NotYet
        }
    }
}

#[cfg(test)]
mod tests {
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
        let minute = Duration::from_secs(60);
        assert_eq!(pace.wait(RigNs(5_000_000_000), minute), Waited::Due);
        // 200 ms at four times the speed, at most a millisecond early.
        assert_eq!(pace.wait(RigNs(5_200_000_000), Duration::from_millis(10)), Waited::NotYet);
        assert_eq!(pace.wait(RigNs(5_200_000_000), minute), Waited::Due);
        assert!(began.elapsed() >= Duration::from_millis(49));
        stop.stop();
        assert_eq!(pace.wait(RigNs(3_600_000_000_000), minute), Waited::Stopped);
    }
}

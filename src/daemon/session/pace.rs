//! How fast recorded events are played: it changes when they are seen, never what they are.

use std::str::FromStr;
use std::time::{Duration, Instant};

use tumbled_io::live::StopToken;
use tumbled_model::RigNs;

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

/// Waits until each event's time has come.
#[derive(Debug)]
pub struct Pace {
    speed: Speed,
    began: Option<(Instant, RigNs)>,
    stop: StopToken,
}

/// Shorter waits are left out: the next event makes up for them.
const SHORTEST_WAIT: Duration = Duration::from_millis(1);

impl Pace {
    /// A pace that a stop interrupts.
    pub fn new(speed: Speed, stop: StopToken) -> Self {
        Self { speed, began: None, stop }
    }

    /// Waits until it is time for an event that arrived at `arrived`; false when stopped.
    pub fn wait(&mut self, arrived: RigNs) -> bool {
        let Speed::Times(times) = self.speed else { return !self.stop.is_stopped() };
        let (began, first) = *self.began.get_or_insert_with(|| (Instant::now(), arrived));
        let due_s = ((arrived - first).as_secs_f64() / times).clamp(0.0, 1e9);
        let left = Duration::from_secs_f64(due_s).saturating_sub(began.elapsed());
        if left < SHORTEST_WAIT { !self.stop.is_stopped() } else { !self.stop.wait(left) }
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
        assert!(pace.wait(RigNs(5_000_000_000)) && pace.wait(RigNs(5_200_000_000)));
        // 200 ms at four times the speed, at most a millisecond early.
        assert!(began.elapsed() >= Duration::from_millis(49));
        stop.stop();
        assert!(!pace.wait(RigNs(3_600_000_000_000)));
    }
}

//! Device clocks: what a sensor's counter says at a true instant.
//!
//! A sensor has an oscillator, which paces all it does, and a counter that the oscillator drives and that can be set:
//!
//! ```text
//!   true time ── skew, warm-up ──▶ oscillator, ns ── offset, resets ──▶ counter, ns ──▶ LidarTime, KinectTicks
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{KinectTicks, LidarTime, RigNs, UnixNs};

const HOUR_NS: i64 = 3_600_000_000_000;

/// A sensor's clock.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SimClock {
    /// The counter at the session's start, ns.
    pub offset_ns: i64,
    /// How much faster than true time the oscillator runs when warm, ppm; a quartz stays within ±100.
    pub skew_ppm: f64,
    /// What the oscillator is off besides while it is cold.
    pub warm_up: Option<WarmUp>,
    /// Times the counter is set, ascending: reboots, the lock to a pulse.
    pub resets: Vec<ClockReset>,
    /// The LiDAR's counter does not wrap at the hour but counts on: seen on units that were never synchronised.
    pub counts_past_the_hour: bool,
}

/// A frequency that settles as the sensor warms up: off by `ppm`·exp(−t/τ).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WarmUp {
    /// At the session's start, ppm.
    pub ppm: f64,
    /// Time constant, s.
    pub tau_s: f64,
}

/// The counter is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ClockReset {
    /// When, ns of true time on the session's timeline.
    pub at_ns: i64,
    /// To what, ns.
    pub to_ns: i64,
}

impl SimClock {
    /// A clock disciplined by a receiver: no skew, the counter is UTC's time of the hour. `unix_at_zero` is UTC at the
    /// session's start.
    pub fn locked(unix_at_zero: UnixNs) -> Self {
        Self { offset_ns: unix_at_zero.0.rem_euclid(HOUR_NS), ..Self::default() }
    }

    /// The oscillator's own time at a true instant: ns since the session's start.
    pub fn oscillator_ns(&self, t: RigNs) -> i64 {
        t.0 + libm::round(self.ahead_ns(t.0 as f64)) as i64
    }

    /// The true instant at which the oscillator has counted so many ns.
    pub fn instant(&self, oscillator_ns: i64) -> RigNs {
        // Each round leaves an error smaller by the skew, below 1e-3: three bring an hour's to below 1 ns.
        let mut t = oscillator_ns as f64;
        for _ in 0..3 {
            t = oscillator_ns as f64 - self.ahead_ns(t);
        }
        RigNs(oscillator_ns - libm::round(self.ahead_ns(t)) as i64)
    }

    /// The counter at a true instant, ns, not wrapped.
    pub fn counter_ns(&self, t: RigNs) -> i64 {
        let oscillator = self.oscillator_ns(t);
        match self.resets.iter().rfind(|reset| reset.at_ns <= t.0) {
            Some(reset) => reset.to_ns + oscillator - self.oscillator_ns(RigNs(reset.at_ns)),
            None => self.offset_ns + oscillator,
        }
    }

    /// What a LiDAR stamps: whole µs past the hour, cut off.
    pub fn lidar(&self, t: RigNs) -> LidarTime {
        let us = self.counter_ns(t).div_euclid(1_000);
        let wrap = if self.counts_past_the_hour { 1 << 32 } else { i64::from(LidarTime::HOUR_US) };
        LidarTime(us.rem_euclid(wrap) as u32)
    }

    /// What a Kinect stamps: 60 MHz, 32 bit.
    pub fn kinect(&self, t: RigNs) -> KinectTicks {
        let ticks = i128::from(self.counter_ns(t)) * i128::from(KinectTicks::HZ) / 1_000_000_000;
        KinectTicks(ticks as u32)
    }

    /// How far the oscillator is ahead of true time, ns.
    fn ahead_ns(&self, t_ns: f64) -> f64 {
        let steady = self.skew_ppm * 1e-6 * t_ns;
        let warming = self.warm_up.filter(|warm_up| warm_up.tau_s > 0.0).map_or(0.0, |WarmUp { ppm, tau_s }| {
            // The integral of ppm·exp(−t/τ) from 0 to t.
            -ppm * 1e-6 * tau_s * 1e9 * libm::expm1(-t_ns.max(0.0) * 1e-9 / tau_s)
        });
        steady + warming
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn skew_and_warm_up_add_up() {
        let warm_up = Some(WarmUp { ppm: 10.0, tau_s: 100.0 });
        let clock = SimClock { skew_ppm: -300.0, warm_up, ..SimClock::default() };
        // After 100 s: −300e-6 · 100 s = −30 ms; 10e-6 · 100 s · (1 − 1/e) = 632.12 µs.
        let ahead = clock.oscillator_ns(RigNs(100_000_000_000)) - 100_000_000_000;
        assert!((ahead - (-30_000_000 + 632_121)).abs() <= 1, "{ahead}");
    }

    #[test]
    fn the_lidars_counter_wraps_at_the_hour_unless_it_never_learned_of_hours() {
        let mut clock = SimClock { offset_ns: HOUR_NS - 1_000_000, ..SimClock::default() };
        assert_eq!(clock.lidar(RigNs(0)), LidarTime(3_599_999_000));
        assert_eq!(clock.lidar(RigNs(1_500_000)), LidarTime(500));
        clock.counts_past_the_hour = true;
        assert_eq!(clock.lidar(RigNs(1_500_000)), LidarTime(3_600_000_500));
    }

    #[test]
    fn a_locked_clock_tells_the_minutes_of_utc() {
        // 1 795 321 341 = 498 700 · 3600 + 1341: 22 min 21 s past an hour.
        let clock = SimClock::locked(UnixNs(1_795_321_341_000_000_000));
        assert_eq!(clock.lidar(RigNs(250_000_000)), LidarTime(1_341_250_000));
    }

    #[test]
    fn the_kinects_counter_wraps_after_71_58_seconds() {
        let clock = SimClock::default();
        assert_eq!(clock.kinect(RigNs(1_000_000_000)), KinectTicks(60_000_000));
        // 2³² ticks are 71.582788266… s; 72 s are 72 · 6e7 − 2³² = 25 032 704 ticks past the wrap.
        assert_eq!(clock.kinect(RigNs(72_000_000_000)), KinectTicks(25_032_704));
    }

    #[test]
    fn a_reboot_sets_the_counter_and_not_the_pace() {
        let resets = vec![ClockReset { at_ns: 5_000_000_000, to_ns: 0 }];
        let clock = SimClock { offset_ns: 77_000_000_000, skew_ppm: 100.0, resets, ..SimClock::default() };
        assert_eq!(clock.lidar(RigNs(4_999_999_999)), LidarTime(82_000_499)); // 77 + 5 + 0.0005 s
        assert_eq!(clock.lidar(RigNs(15_000_000_000)), LidarTime(10_001_000)); // 10 s + 100 ppm of them
    }

    proptest! {
        #[test]
        fn instants_and_the_oscillator_are_each_others_inverse(
            t in 0i64..4_000_000_000_000, skew_ppm in -300.0f64..300.0, ppm in -20.0f64..20.0, tau_s in 1.0f64..2_000.0,
        ) {
            let clock = SimClock { skew_ppm, warm_up: Some(WarmUp { ppm, tau_s }), ..SimClock::default() };
            let back = clock.instant(clock.oscillator_ns(RigNs(t)));
            prop_assert!((back.0 - t).abs() <= 1, "{} {}", t, back.0);
        }
    }
}

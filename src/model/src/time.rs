//! Time, kept apart by type.
//!
//! | type | meaning | where it comes from |
//! |---|---|---|
//! | [`RigNs`] | ns on the session's timeline, 0 = session start (imports: the earliest host stamp) | monotonic clock, sampled by the shell |
//! | [`UnixNs`] | wall time, ns since 1970-01-01 UTC | anchors, capture files |
//! | [`LidarTime`] | µs past the sensor's hour | Velodyne packet, offset 1200 |
//! | [`KinectTicks`] | 60 MHz counter, wraps every 71.58 s | USB frame header |
//!
//! Only differences of the same kind are times one may add:
//!
//! ```
//! use tumbled_model::{RigNs, Span};
//! let start = RigNs(1_000);
//! assert_eq!(RigNs(1_500) - start, Span(500));
//! assert_eq!(start + Span(500), RigNs(1_500));
//! ```
//! ```compile_fail
//! use tumbled_model::{RigNs, UnixNs};
//! let mixed = RigNs(1_000) - UnixNs(500); // two timelines: does not build
//! ```
//! ```compile_fail
//! use tumbled_model::{KinectTicks, LidarTime};
//! let mixed = LidarTime(1_000) == KinectTicks(1_000); // two devices' counters: does not build
//! ```

use core::fmt;
use core::ops::{Add, Neg, Sub};
use serde::{Deserialize, Serialize};

/// Nanoseconds on the session's timeline; zero is the session start, or for imports the earliest
/// host stamp over all inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct RigNs(pub i64);

/// Wall time: nanoseconds since 1970-01-01 00:00 UTC, leap seconds not counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct UnixNs(pub i64);

/// A signed difference of two times of one kind, nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Span(pub i64);

impl Span {
    /// A span of whole microseconds.
    pub const fn from_micros(us: i64) -> Self {
        Self(us * 1_000)
    }

    /// Seconds, for a formula over a short span or for people.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

macro_rules! timeline {
    ($t:ty) => {
        impl Sub for $t {
            type Output = Span;
            fn sub(self, earlier: Self) -> Span {
                Span(self.0.wrapping_sub(earlier.0))
            }
        }
        impl Add<Span> for $t {
            type Output = Self;
            fn add(self, span: Span) -> Self {
                Self(self.0.wrapping_add(span.0))
            }
        }
        impl Sub<Span> for $t {
            type Output = Self;
            fn sub(self, span: Span) -> Self {
                Self(self.0.wrapping_sub(span.0))
            }
        }
    };
}
timeline!(RigNs);
timeline!(UnixNs);

impl Add for Span {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }
}

impl Sub for Span {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }
}

impl Neg for Span {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.wrapping_neg())
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.6} s", self.as_secs_f64())
    }
}

/// Microseconds since the top of the sensor's hour, as a Velodyne packet says it.
///
/// Range 0..3 599 999 999 when the sensor behaves; sensors that were never synchronised have been
/// seen to count past it, so the raw value is kept and only differences wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct LidarTime(pub u32);

impl LidarTime {
    /// One hour in the stamp's unit, where it wraps.
    pub const HOUR_US: u32 = 3_600_000_000;

    /// The signed shortest way from `earlier` to `self` round the hour, in (−30 min, +30 min].
    ///
    /// A counter past 3.6e9 µs is not folded when both stamps lie past it or the difference is short:
    /// the plain difference is used whenever it is within half an hour.
    pub fn since(self, earlier: Self) -> Span {
        const HOUR: i64 = LidarTime::HOUR_US as i64;
        let mut us = i64::from(self.0) - i64::from(earlier.0);
        if us > HOUR / 2 {
            us -= HOUR;
        } else if us <= -HOUR / 2 {
            us += HOUR;
        }
        Span::from_micros(us)
    }
}

/// The Kinect's own counter, 60 MHz, wraps at 2³² (every 71.58 s).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct KinectTicks(pub u32);

impl KinectTicks {
    /// Ticks per second (libfreenect threads #465, #681).
    pub const HZ: u32 = 60_000_000;

    /// Signed shortest way from `earlier` to `self`, within half a wrap (35.8 s).
    pub fn since(self, earlier: Self) -> Span {
        let ticks = i64::from(self.0.wrapping_sub(earlier.0) as i32);
        Span(ticks * 50 / 3) // 1e9 / 60e6 = 50/3 ns per tick
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lidar_time_wraps_at_the_hour_and_not_at_two_to_the_32() {
        // 0.1 s before the hour to 0.2 s after it: 0.3 s.
        assert_eq!(LidarTime(200_000).since(LidarTime(3_599_900_000)), Span::from_micros(300_000));
        assert_eq!(LidarTime(3_599_900_000).since(LidarTime(200_000)), Span::from_micros(-300_000));
    }

    #[test]
    fn a_counter_past_the_hour_is_still_a_counter() {
        assert_eq!(LidarTime(3_600_000_500).since(LidarTime(3_599_999_500)), Span::from_micros(1_000));
    }

    #[test]
    fn kinect_frame_is_a_thirtieth_across_the_wrap() {
        // 2,000,000 ticks of 1/60e6 s = 33.333 ms.
        let before = KinectTicks(u32::MAX - 999_999);
        assert_eq!(KinectTicks(1_000_000).since(before), Span(33_333_333));
    }

    proptest! {
        #[test]
        fn lidar_unwrap_inverts_any_step_below_half_an_hour(
            start in 0u32..LidarTime::HOUR_US, step in -1_799_999_999i64..1_799_999_999
        ) {
            let end = (i64::from(start) + step).rem_euclid(i64::from(LidarTime::HOUR_US));
            let end = LidarTime(u32::try_from(end).expect("below one hour"));
            prop_assert_eq!(end.since(LidarTime(start)), Span::from_micros(step));
        }

        #[test]
        fn rig_time_minus_itself_plus_a_span_is_the_span(t in -1i64<<60..1i64<<60, s in -1i64<<60..1i64<<60) {
            prop_assert_eq!((RigNs(t) + Span(s)) - RigNs(t), Span(s));
        }
    }
}

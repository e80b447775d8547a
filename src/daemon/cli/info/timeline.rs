//! A LiDAR's own time over the inputs: how long, and what UTC its first firing was at.
//!
//! A sensor's stamps begin again each hour, and the first position packet comes after the first data packets, in a
//! capture from a sensor that was switched on with it even minutes or hours later. So the time since the first packet
//! is added up as packets come, the hours told by the host's stamps, and taken off the first UTC that is known.

use tumbled_model::{LidarTime, RigNs, Span, UnixNs};
use tumbled_velodyne::clock::UtcClock;
use tumbled_velodyne::track::Order;

const HOUR_NS: i64 = LidarTime::HOUR_US as i64 * 1_000;

/// A stamp and the arrival it came with belong to the same run of the counter as others do, when the two differences
/// agree to this: well above the delay of a packet, well below a clock set anew by a receiver.
const SAME_RUN_NS: i64 = 250_000_000;

/// A stamp and when the host had it.
#[derive(Clone, Copy, Debug)]
struct Instant {
    stamp: LidarTime,
    arrived: RigNs,
}

impl Instant {
    /// Device time from `earlier`, hours told by the arrivals.
    fn since(self, earlier: Self) -> i64 {
        let short = self.stamp.since(earlier.stamp).0;
        let by_arrival = (self.arrived - earlier.arrived).0;
        let hours = (by_arrival - short).saturating_add(HOUR_NS / 2).div_euclid(HOUR_NS);
        short + hours * HOUR_NS
    }

    /// Whether both were counted by one run of the sensor's counter.
    fn same_run(self, other: Self) -> bool {
        let by_arrival = (self.arrived - other.arrived).0;
        (self.since(other) - by_arrival).abs() <= SAME_RUN_NS + by_arrival.saturating_abs() / 1_000
    }
}

/// Adds up one sensor's device time.
#[derive(Debug, Default)]
pub(super) struct Timeline {
    first: Option<LidarTime>,
    newest: Option<Instant>,
    elapsed_ns: i64,
    steps: u64,
    reference: Option<Instant>,
    first_utc: Option<UnixNs>,
    set_anew: bool,
}

impl Timeline {
    /// Takes note of one data packet and returns its device time after the first packet, ns; `None` for one that came
    /// late or twice, or whose stamp is in doubt.
    pub(super) fn packet(&mut self, stamp: LidarTime, arrived: RigNs, order: Order) -> Option<i64> {
        let now = Instant { stamp, arrived };
        let Some(newest) = self.newest else {
            self.first = Some(stamp);
            self.newest = Some(now);
            return Some(0);
        };
        match order {
            Order::Next { .. } => self.elapsed_ns += now.since(newest),
            Order::Reset => {
                // The two stamps have nothing to do with each other; the host's clock went on.
                self.elapsed_ns += (arrived - newest.arrived).0;
                self.set_anew = true;
            }
            Order::Duplicate | Order::Late | Order::Doubtful => return None,
        }
        self.steps += 1;
        self.newest = Some(now);
        Some(self.elapsed_ns)
    }

    /// Takes note of the stamp that the clock's newest UTC came with.
    pub(super) fn reference(&mut self, stamp: LidarTime, arrived: RigNs) {
        self.reference = Some(Instant { stamp, arrived });
    }

    /// Takes the first firing's UTC from the clock, once both are known and the counter was not set anew in between.
    pub(super) fn resolve(&mut self, clock: &UtcClock) {
        if self.first_utc.is_some() || self.set_anew {
            return;
        }
        let (Some(newest), Some(reference)) = (self.newest, self.reference) else { return };
        if newest.same_run(reference) {
            self.first_utc = clock.utc(newest.stamp).map(|utc| utc - Span(self.elapsed_ns));
        }
    }

    /// UTC of the first packet's stamp, if it was ever known.
    pub(super) fn first_utc(&self) -> Option<UnixNs> {
        self.first_utc
    }

    /// Stamps of the first and the newest packet.
    pub(super) fn stamps(&self) -> Option<(LidarTime, LidarTime)> {
        self.first.zip(self.newest.map(|newest| newest.stamp))
    }

    /// Device time from the first to the newest packet, ns.
    pub(super) fn elapsed_ns(&self) -> i64 {
        self.elapsed_ns
    }

    /// Packets per second of device time, `silent_ns` of it left out; `None` before two packets.
    pub(super) fn packets_per_s(&self, silent_ns: i64) -> Option<f64> {
        let sending_ns = self.elapsed_ns - silent_ns;
        (self.steps > 0 && sending_ns > 0).then(|| self.steps as f64 * 1e9 / sending_ns as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::{CivilTime, nmea};
    use tumbled_velodyne::position::{PositionPacket, Pps};

    const NEXT: Order = Order::Next { lost: 0 };
    const MINUTE_NS: i64 = 60_000_000_000;

    /// 10:00:00 UTC on 22 November 2026.
    fn ten_o_clock() -> UnixNs {
        let ten = CivilTime { year: 2026, month: 11, day: 22, hour: 10, minute: 0, second: 0, nanosecond: 0 };
        ten.to_unix().expect("a valid date")
    }

    fn stamp(utc: UnixNs) -> LidarTime {
        LidarTime((utc.0.rem_euclid(HOUR_NS) / 1_000) as u32)
    }

    fn clock_at(utc: UnixNs) -> UtcClock {
        let rmc = nmea::parse_rmc(nmea::format_rmc(utc, true).as_bytes());
        let mut clock = UtcClock::default();
        clock.update(&PositionPacket {
            stamp: stamp(utc),
            pps: Pps::Locked,
            rmc,
            temperature_c: None,
            thermal_shutdown: false,
        });
        clock
    }

    #[test]
    fn a_receiver_heard_after_forty_minutes_still_dates_the_first_firing() {
        // Packets at 09:50, 10:10 and 10:30, the sentence at 10:30: the first lies 40 min before it and an hour wrap.
        let start = ten_o_clock() - Span(10 * MINUTE_NS);
        let mut timeline = Timeline::default();
        for k in 0..3 {
            let t = 20 * MINUTE_NS * k;
            assert_eq!(timeline.packet(stamp(start + Span(t)), RigNs(t), NEXT), Some(t));
        }
        timeline.resolve(&UtcClock::default());
        assert_eq!(timeline.first_utc(), None);
        let heard = start + Span(40 * MINUTE_NS);
        timeline.reference(stamp(heard), RigNs(40 * MINUTE_NS));
        timeline.resolve(&clock_at(heard));
        assert_eq!(timeline.first_utc(), Some(start));
        assert_eq!(timeline.elapsed_ns(), 40 * MINUTE_NS);
    }

    #[test]
    fn several_hours_between_two_packets_are_told_by_the_arrivals() {
        let mut timeline = Timeline::default();
        timeline.packet(LidarTime(1_000_000), RigNs(0), NEXT);
        // 3 h and 2 s later, the host's stamp 3 ms off.
        let three_hours = 3 * HOUR_NS + 2_000_000_000;
        assert_eq!(timeline.packet(LidarTime(3_000_000), RigNs(three_hours + 3_000_000), NEXT), Some(three_hours));
    }

    #[test]
    fn stamps_before_the_counter_was_set_are_never_taken_for_utc() {
        let ten = ten_o_clock();
        let mut timeline = Timeline::default();
        timeline.packet(LidarTime(900_000_000), RigNs(0), NEXT); // 15 min after power-up
        timeline.reference(stamp(ten), RigNs(1_000_000));
        timeline.resolve(&clock_at(ten));
        assert_eq!(timeline.first_utc(), None, "the sentence came with another run of the counter");
        timeline.packet(stamp(ten), RigNs(2_000_000), Order::Reset);
        timeline.resolve(&clock_at(ten));
        assert_eq!(timeline.first_utc(), None, "the first packet is of the run before");
    }

    #[test]
    fn late_and_repeated_packets_take_no_time() {
        let mut timeline = Timeline::default();
        timeline.packet(LidarTime(0), RigNs(0), NEXT);
        timeline.packet(LidarTime(2_000), RigNs(2_000_000), NEXT);
        assert_eq!(timeline.packet(LidarTime(1_000), RigNs(2_100_000), Order::Late), None);
        assert_eq!(timeline.packet(LidarTime(2_000), RigNs(2_200_000), Order::Duplicate), None);
        // One step of 2 ms: 500 a second.
        assert_eq!(timeline.packets_per_s(0), Some(500.0));
    }
}

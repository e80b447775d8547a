//! What is known of each kind of device clock before its first stamp.

use serde::{Deserialize, Serialize};

/// Whose counter it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviceClockKind {
    /// A Velodyne's µs past the hour.
    Velodyne,
    /// A Kinect v1's 60 MHz counter.
    Kinect,
    /// The µs counter of a microcontroller that streams encoder lines.
    LineStream,
}

/// A kind's constants.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ClockParameters {
    /// Ticks after which the counter starts again.
    pub wrap: i64,
    /// Ticks a second.
    pub hz: i64,
    /// The window of the hull once 30 s of data are there, ns. Longer averages more, shorter follows drift better.
    pub window_ns: i64,
    /// Of so many pairs in a row the least delayed one enters the hull.
    pub decimation: u32,
    /// So many stamps in a row that lie behind the newest are no reordering but a counter set back.
    pub reorder_run: u32,
    /// Standard deviation of plain arrival stamps, ns: the uncertainty before anything better is known.
    pub arrival_sigma_ns: i64,
}

/// Sources. Wraps: VLP-32C manual (µs past the hour); libfreenect's protocol notes (60 MHz, 32 bit); our own line
/// stream (32 bit). Windows: simulated p99 of the mapping error over windows of 10, 30 and 60 s; a 1500 packets/s
/// sensor is best at 30 s, because warm-up drift costs more than averaging gains beyond, a 30 Hz one at 60 s.
/// Reordering: a switch may swap neighbours, so 32 packets (21 ms of a VLP-32C) is far beyond it; USB and serial lines
/// keep their order, so a few suffice. Arrival sigma: the standard deviation of the same simulated arrivals.
const TABLE: [(DeviceClockKind, ClockParameters); 3] = [
    (
        DeviceClockKind::Velodyne,
        ClockParameters {
            wrap: 3_600_000_000,
            hz: 1_000_000,
            window_ns: 30_000_000_000,
            decimation: 10,
            reorder_run: 32,
            arrival_sigma_ns: 300_000,
        },
    ),
    (
        DeviceClockKind::Kinect,
        ClockParameters {
            wrap: 1 << 32,
            hz: 60_000_000,
            window_ns: 60_000_000_000,
            decimation: 1,
            reorder_run: 3,
            arrival_sigma_ns: 1_200_000,
        },
    ),
    (
        DeviceClockKind::LineStream,
        ClockParameters {
            wrap: 1 << 32,
            hz: 1_000_000,
            window_ns: 30_000_000_000,
            decimation: 5,
            reorder_run: 8,
            // An FTDI adapter hands over what it has every 1 ms at best: uniform over 1 ms is 0.29 ms, and the host adds its own.
            arrival_sigma_ns: 1_000_000,
        },
    ),
];

impl DeviceClockKind {
    /// The kind's constants.
    pub const fn parameters(self) -> &'static ClockParameters {
        let [(_, velodyne), (_, kinect), (_, line_stream)] = &TABLE;
        match self {
            Self::Velodyne => velodyne,
            Self::Kinect => kinect,
            Self::LineStream => line_stream,
        }
    }
}

impl ClockParameters {
    /// Ticks to nanoseconds, rounded down; saturates past 292 years.
    pub fn ns(&self, ticks: i64) -> i64 {
        let ns = (i128::from(ticks) * 1_000_000_000).div_euclid(i128::from(self.hz));
        i64::try_from(ns).unwrap_or(if ns < 0 { i64::MIN } else { i64::MAX })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_finds_its_own_row() {
        for (kind, parameters) in &TABLE {
            assert_eq!(kind.parameters(), parameters, "{kind:?}");
        }
    }

    #[test]
    fn sixty_megahertz_lose_less_than_a_nanosecond() {
        // 2,000,000 ticks / 60 MHz = 33,333,333.33 ns; one tick before zero is −16.67 ns, rounded down −17.
        let kinect = DeviceClockKind::Kinect.parameters();
        assert_eq!((kinect.ns(2_000_000), kinect.ns(-1)), (33_333_333, -17));
        assert_eq!(kinect.ns(i64::MAX), i64::MAX);
    }
}

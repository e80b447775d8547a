//! Numbers with sensible digits.

use super::super::report::{Spread, WallTime};

/// `1 packet`, `3 packets`.
pub(super) fn counted(n: u64, noun: &str) -> String {
    if n == 1 { format!("1 {noun}") } else { format!("{n} {noun}s") }
}

/// Bytes, or from ten thousand on the largest unit that leaves a whole number, with one decimal.
pub(super) fn bytes(n: u64) -> String {
    let scaled = |unit: f64| n as f64 / unit;
    if n < 10_000 {
        format!("{n} bytes")
    } else if n < 1_000_000 {
        format!("{:.1} kB", scaled(1e3))
    } else if n < 1_000_000_000 {
        format!("{:.1} MB", scaled(1e6))
    } else {
        format!("{:.1} GB", scaled(1e9))
    }
}

/// A duration: milliseconds below a second, else seconds, with hours and minutes where there are any.
pub(super) fn seconds(s: f64) -> String {
    let minutes = (s / 60.0) as u64;
    let rest = s - minutes as f64 * 60.0;
    if s < 1.0 {
        format!("{:.1} ms", s * 1e3)
    } else if minutes == 0 {
        format!("{s:.3} s")
    } else if minutes < 60 {
        format!("{minutes} min {rest:.1} s")
    } else {
        format!("{} h {} min {rest:.0} s", minutes / 60, minutes % 60)
    }
}

/// RFC 3339 to the microsecond, `2026-11-22T04:22:21.340595Z`: nanoseconds only where there are any.
pub(super) fn utc(time: &WallTime) -> String {
    match time.utc.strip_suffix("000Z") {
        Some(to_the_microsecond) => format!("{to_the_microsecond}Z"),
        None => time.utc.clone(),
    }
}

/// A stamp past the hour: minutes, seconds, microseconds. A counter past the hour has more than 59 minutes.
pub(super) fn past_the_hour(stamp_us: u32) -> String {
    format!("{:02}:{:02}.{:06}", stamp_us / 60_000_000, stamp_us / 1_000_000 % 60, stamp_us % 1_000_000)
}

/// A rate: from ten thousand on in thousands.
pub(super) fn rate(per_s: f64) -> String {
    if per_s < 10_000.0 { format!("{per_s:.1}") } else { format!("{:.1} k", per_s / 1e3) }
}

/// A share as a percentage.
pub(super) fn percent(share: f64) -> String {
    format!("{:.1} %", share * 100.0)
}

/// Smallest, median and greatest, metres.
pub(super) fn spread(spread: &Spread, decimals: usize) -> String {
    let Spread { min, median, max } = spread;
    format!("{min:.decimals$} to {max:.decimals$} m, median {median:.decimals$} m")
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::UnixNs;

    #[test]
    fn durations_have_the_unit_a_person_would_take() {
        let shown = [0.0123, 12.3456, 125.0, 7_384.4].map(seconds);
        // 7384.4 s = 2 h + 184.4 s = 2 h 3 min 4.4 s.
        assert_eq!(shown, ["12.3 ms", "12.346 s", "2 min 5.0 s", "2 h 3 min 4 s"]);
    }

    #[test]
    fn microseconds_are_shown_and_nanoseconds_where_there_are_any() {
        assert_eq!(utc(&WallTime::from(UnixNs(1_500))), "1970-01-01T00:00:00.000001500Z");
        assert_eq!(utc(&WallTime::from(UnixNs(2_000))), "1970-01-01T00:00:00.000002Z");
    }

    #[test]
    fn stamps_are_minutes_and_seconds() {
        // 1 082 340 595 µs = 18 min 2.340595 s; 3 660 s past the hour is a counter that did not wrap.
        assert_eq!(past_the_hour(1_082_340_595), "18:02.340595");
        assert_eq!(past_the_hour(3_660_000_000), "61:00.000000");
    }

    #[test]
    fn large_numbers_are_short() {
        assert_eq!([rate(754.04), rate(236_123.0)], ["754.0", "236.1 k"]);
        assert_eq!(
            [9_999, 226_304, 1_500_000, 12_000_000_000].map(bytes),
            ["9999 bytes", "226.3 kB", "1.5 MB", "12.0 GB"]
        );
        assert_eq!([counted(1, "gap"), counted(2, "gap")], ["1 gap", "2 gaps"]);
    }
}

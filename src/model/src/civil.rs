//! Calendar time: what an NMEA sentence says, and the hour that "microseconds past the hour" belong to.

use crate::time::{LidarTime, Span, UnixNs};

const DAY_NS: i64 = 86_400_000_000_000;
const HOUR_NS: i64 = 3_600_000_000_000;

/// A UTC date and time of day, proleptic Gregorian. A leap second (`second` 60) is the next minute's 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CivilTime {
    /// Year, e.g. 2026.
    pub year: i32,
    /// Month, 1..=12.
    pub month: u8,
    /// Day of the month, 1..=31.
    pub day: u8,
    /// Hour, 0..=23.
    pub hour: u8,
    /// Minute, 0..=59.
    pub minute: u8,
    /// Second, 0..=60.
    pub second: u8,
    /// Nanosecond, 0..1e9.
    pub nanosecond: u32,
}

impl CivilTime {
    /// The instant, or `None` when a field is out of its range or the day does not exist.
    pub fn to_unix(self) -> Option<UnixNs> {
        let leap = (self.year % 4 == 0 && self.year % 100 != 0) || self.year % 400 == 0;
        let days_in_month = match self.month {
            1 | 3 | 5 | 7 | 8 | 10 | 12 => 31,
            4 | 6 | 9 | 11 => 30,
            2 if leap => 29,
            2 => 28,
            _ => return None,
        };
        // i64 nanoseconds reach from 1678 to 2261.
        if !(1700..=2200).contains(&self.year)
            || !(1..=days_in_month).contains(&self.day)
            || self.hour > 23
            || self.minute > 59
            || self.second > 60
            || self.nanosecond >= 1_000_000_000
        {
            return None;
        }
        let seconds = i64::from(self.hour) * 3_600 + i64::from(self.minute) * 60 + i64::from(self.second);
        let days = days_since_1970(self.year, self.month, self.day);
        Some(UnixNs(days * DAY_NS + seconds * 1_000_000_000 + i64::from(self.nanosecond)))
    }

    /// The calendar reading of an instant.
    pub fn from_unix(t: UnixNs) -> Self {
        let (days, ns) = (t.0.div_euclid(DAY_NS), t.0.rem_euclid(DAY_NS));
        // Days counted from 0000-03-01, so that the leap day is the last of its year; 400 years are 146 097 days.
        let z = days + 719_468;
        let (era, day_of_era) = (z.div_euclid(146_097), z.rem_euclid(146_097));
        let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
        let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let shifted_month = (5 * day_of_year + 2) / 153;
        let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
        let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
        let year = era * 400 + year_of_era + i64::from(month <= 2);
        let second_of_day = ns / 1_000_000_000;
        Self {
            year: year as i32,
            month: month as u8,
            day: day as u8,
            hour: (second_of_day / 3_600) as u8,
            minute: (second_of_day / 60 % 60) as u8,
            second: (second_of_day % 60) as u8,
            nanosecond: (ns % 1_000_000_000) as u32,
        }
    }
}

impl core::fmt::Display for CivilTime {
    /// RFC 3339 with all nine decimals: `2012-03-15T08:18:02.340595000Z`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:09}Z",
            self.year, self.month, self.day, self.hour, self.minute, self.second, self.nanosecond
        )
    }
}

fn days_since_1970(year: i32, month: u8, day: u8) -> i64 {
    let year = i64::from(year) - i64::from(month <= 2);
    let (era, year_of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let shifted_month = (i64::from(month) + 9) % 12;
    let day_of_year = (153 * shifted_month + 2) / 5 + i64::from(day) - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    era * 146_097 + day_of_era - 719_468
}

/// The absolute time of a stamp "µs past the hour", given any reference within half an hour of it
/// (an NMEA sentence, or the host's clock when the sensor is known to be synchronised).
///
/// The hour of the reference plus the stamp; more than 30 min ahead of the reference takes one hour
/// off, more than 30 min behind adds one.
pub fn resolve_hour(stamp: LidarTime, reference: UnixNs) -> UnixNs {
    let top = UnixNs(reference.0.div_euclid(HOUR_NS) * HOUR_NS);
    let candidate = top + Span::from_micros(i64::from(stamp.0));
    let ahead = (candidate - reference).0;
    if ahead > HOUR_NS / 2 {
        candidate - Span(HOUR_NS)
    } else if ahead < -HOUR_NS / 2 {
        candidate + Span(HOUR_NS)
    } else {
        candidate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_instants() {
        // 2000-03-01 is 951 868 800 s: 30 years of 365 days + 7 leap days (72…96) + 31 + 29 days = 11 017 days.
        let t = CivilTime { year: 2000, month: 3, day: 1, hour: 0, minute: 0, second: 0, nanosecond: 0 };
        assert_eq!(t.to_unix(), Some(UnixNs(11_017 * DAY_NS)));
        assert_eq!(CivilTime::from_unix(UnixNs(0)).to_string(), "1970-01-01T00:00:00.000000000Z");
        assert_eq!(CivilTime::from_unix(UnixNs(-1)).to_string(), "1969-12-31T23:59:59.999999999Z");
    }

    #[test]
    fn days_that_do_not_exist_are_refused() {
        let t = CivilTime { year: 2023, month: 2, day: 29, hour: 0, minute: 0, second: 0, nanosecond: 0 };
        assert_eq!(t.to_unix(), None);
        assert_eq!(CivilTime { day: 28, hour: 24, ..t }.to_unix(), None);
        assert!(CivilTime { year: 2024, ..t }.to_unix().is_some());
    }

    #[test]
    fn stamp_just_before_the_hour_belongs_to_the_hour_before() {
        // Reference 10:00:00.1; stamp 59:59.9 is 09:59:59.9 and not 10:59:59.9.
        let ten = 10 * HOUR_NS;
        let reference = UnixNs(ten + 100_000_000);
        assert_eq!(resolve_hour(LidarTime(3_599_900_000), reference), UnixNs(ten - 100_000_000));
        // Reference 09:59:59.9; stamp 0.1 s is 10:00:00.1.
        assert_eq!(resolve_hour(LidarTime(100_000), UnixNs(ten - 100_000_000)), UnixNs(ten + 100_000_000));
    }

    proptest! {
        #[test]
        fn calendar_round_trip(t in -200i64 * 365 * DAY_NS..200 * 365 * DAY_NS) {
            prop_assert_eq!(CivilTime::from_unix(UnixNs(t)).to_unix(), Some(UnixNs(t)));
        }

        #[test]
        fn hour_is_resolved_from_any_reference_within_29_minutes(
            us in 0i64..4_000_000_000_000_000, off in -1_740_000_000i64..1_740_000_000
        ) {
            let truth = UnixNs(us * 1_000);
            let stamp = LidarTime((us % 3_600_000_000) as u32);
            prop_assert_eq!(resolve_hour(stamp, truth + Span::from_micros(off)), truth);
        }
    }
}

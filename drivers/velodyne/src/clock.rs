//! Absolute time: what position packets say about the hour that the stamps count in.

use crate::position::{PositionPacket, Pps};
use serde::{Deserialize, Serialize};
use tumbled_model::nmea::NmeaError;
use tumbled_model::{LidarTime, UnixNs, resolve_hour};

/// The sensor sets minutes and seconds from the sentence after the pulse, so a sentence lags the stamp by up to a
/// second, and by one more until the next arrives.
const SENTENCE_LAG_NS: i64 = 2_500_000_000;

/// How far the stamps may be trusted as UTC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UtcState {
    /// No usable sentence: stamps count from power-up and only differences mean anything.
    #[default]
    FreeRunning,
    /// A valid sentence that contradicts the stamp's minutes and seconds: not synchronised.
    Contradicted,
    /// A valid sentence agrees with the stamp, but no pulse is reported (old HDL-32E firmware never reports one).
    Sentence,
    /// Pulse locked and a valid sentence that agrees.
    Locked,
}

impl core::fmt::Display for UtcState {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::FreeRunning => "free-running",
            Self::Contradicted => "contradicted by NMEA",
            Self::Sentence => "NMEA without PPS",
            Self::Locked => "PPS locked",
        })
    }
}

/// Collects position packets; turns stamps into UTC when they are UTC.
#[derive(Clone, Debug, Default)]
pub struct UtcClock {
    pps: Option<Pps>,
    pps_changes: u64,
    bad_checksums: u64,
    other_sentences: u64,
    state: UtcState,
    /// UTC of the newest position packet.
    reference: Option<UnixNs>,
    temperature_c: Option<(i8, i8)>,
}

impl UtcClock {
    /// Takes note of one position packet.
    pub fn update(&mut self, position: &PositionPacket) {
        if self.pps.is_some_and(|pps| pps != position.pps) {
            self.pps_changes += 1;
        }
        self.pps = Some(position.pps);
        self.temperature_c = position.temperature_c.or(self.temperature_c);
        match position.rmc {
            Ok(rmc) if rmc.valid => {
                let utc = resolve_hour(position.stamp, rmc.utc);
                let agrees = (utc - rmc.utc).0.abs() <= SENTENCE_LAG_NS;
                self.reference = agrees.then_some(utc);
                self.state = match (agrees, position.pps) {
                    (false, _) => UtcState::Contradicted,
                    (true, Pps::Locked) => UtcState::Locked,
                    (true, _) => UtcState::Sentence,
                };
            }
            // One broken or foreign sentence says nothing about the clock: some receivers send GGA in turn with RMC.
            Err(NmeaError::Checksum { .. }) => self.bad_checksums += 1,
            Err(NmeaError::Frame | NmeaError::NotRmc | NmeaError::Field) if position.pps == Pps::Locked => {
                self.other_sentences += 1;
            }
            _ => self.invalidate(),
        }
    }

    /// Takes note of a time that the sensor itself vouches for as a GPS receiver's (HDL-64E S2 and S3 send it with their
    /// status): UTC in whole seconds near `stamp`.
    pub fn update_utc(&mut self, stamp: LidarTime, utc: UnixNs) {
        let absolute = resolve_hour(stamp, utc);
        let agrees = (absolute - utc).0.abs() <= SENTENCE_LAG_NS;
        self.reference = agrees.then_some(absolute);
        self.state = if agrees { UtcState::Locked } else { UtcState::Contradicted };
    }

    /// The stamps are no UTC any more: the counter was set anew, or the receiver lost its signal.
    pub fn invalidate(&mut self) {
        self.state = UtcState::FreeRunning;
        self.reference = None;
    }

    /// The newest pulse state; `None` before any position packet.
    pub fn pps(&self) -> Option<Pps> {
        self.pps
    }

    /// How often the pulse state changed.
    pub fn pps_changes(&self) -> u64 {
        self.pps_changes
    }

    /// Sentences whose checksum was wrong; they change nothing.
    pub fn bad_checksums(&self) -> u64 {
        self.bad_checksums
    }

    /// Sentences that carry no usable time while the pulse is locked (GGA, or cut short); they change nothing.
    pub fn other_sentences(&self) -> u64 {
        self.other_sentences
    }

    /// How far the stamps may be trusted as UTC.
    pub fn state(&self) -> UtcState {
        self.state
    }

    /// Top and bottom board, °C, where the firmware sends them.
    pub fn temperature_c(&self) -> Option<(i8, i8)> {
        self.temperature_c
    }

    /// UTC of a stamp within half an hour of the newest position packet; `None` while the stamps are not UTC.
    pub fn utc(&self, stamp: LidarTime) -> Option<UnixNs> {
        self.reference.map(|reference| resolve_hour(stamp, reference))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::{CivilTime, nmea};

    fn position(stamp_us: u32, pps: Pps, sentence: &str) -> PositionPacket {
        let rmc = nmea::parse_rmc(sentence.as_bytes());
        PositionPacket { stamp: LidarTime(stamp_us), pps, rmc, temperature_c: None, thermal_shutdown: false }
    }

    /// 04:22:21 UTC on 22 November 2026.
    const RMC: &str = "$GPRMC,042221.00,A,4124.8963,N,08151.6838,W,000.0,000.0,221126,,,A*40";

    #[test]
    fn locked_stamps_are_utc_on_both_sides_of_the_hour() {
        let mut clock = UtcClock::default();
        // 22 min 21.5 s past the hour.
        clock.update(&position(1_341_500_000, Pps::Locked, RMC));
        assert_eq!(clock.state(), UtcState::Locked);
        let utc = |stamp| CivilTime::from_unix(clock.utc(LidarTime(stamp)).expect("locked")).to_string();
        assert_eq!(utc(1_341_499_999), "2026-11-22T04:22:21.499999000Z");
        // 59 min 59 s lies 37 min ahead of 22 min 21 s, 23 min behind it in the hour before.
        assert_eq!(utc(3_599_000_000), "2026-11-22T03:59:59.000000000Z");
    }

    #[test]
    fn a_sentence_that_contradicts_the_stamp_is_no_synchronisation() {
        let mut clock = UtcClock::default();
        clock.update(&position(1_941_500_000, Pps::Absent, RMC)); // 10 min off
        assert_eq!((clock.state(), clock.utc(LidarTime(0))), (UtcState::Contradicted, None));
    }

    #[test]
    fn one_broken_sentence_does_not_unlock() {
        let mut clock = UtcClock::default();
        clock.update(&position(1_341_500_000, Pps::Locked, RMC));
        clock.update(&position(1_341_600_000, Pps::Locked, &RMC.replace("42221", "42222")));
        assert_eq!((clock.state(), clock.bad_checksums()), (UtcState::Locked, 1));
        clock.update(&position(1_341_650_000, Pps::Locked, "$GPRMC,042221.00,A,41"));
        clock.update(&position(
            1_341_660_000,
            Pps::Locked,
            "$GPGGA,042221.00,4124.8963,N,08151.6838,W,1,8,1,1,M,1,M,,*61",
        ));
        assert_eq!((clock.state(), clock.other_sentences()), (UtcState::Locked, 2));
        clock.update(&position(1_341_700_000, Pps::Absent, ""));
        assert_eq!((clock.state(), clock.pps_changes()), (UtcState::FreeRunning, 1));
    }
}

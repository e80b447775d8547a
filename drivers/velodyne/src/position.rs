//! The position packet: 512 bytes on UDP port 8308 with the sensor's view of PPS and GPS.
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0xBB, 0xBC, 0xBD | 1 each | temperatures: top board, bottom board, at the last ADC calibration (firmware since 2018, else 0) |
//! | 0xC6 | 4 | time stamp, µs past the hour |
//! | 0xCA | 1 | PPS: 0 absent, 1 synchronising, 2 locked, 3 error |
//! | 0xCB | 1 | thermal shutdown |
//! | 0xCE | 128 | NMEA sentence, CR LF, padded with 0 |
//!
//! Source: VLS-128 manual's table; offsets of stamp, PPS and sentence checked on real captures of two models.

use crate::wire::{POSITION_LEN, WireError};
use serde::{Deserialize, Serialize};
use tumbled_model::{LidarTime, nmea};

/// Where the sentence stands, and its room, bytes.
const SENTENCE: usize = 0xCE;
const SENTENCE_LEN: usize = 128;

/// What the sensor says about the pulse-per-second input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pps {
    /// No pulse (also: old HDL-32E firmware, which never says anything else).
    Absent,
    /// A pulse is there, the counter is not yet aligned.
    Synchronising,
    /// The counter is aligned.
    Locked,
    /// The pulse is irregular.
    Error,
    /// A byte outside the table.
    #[serde(untagged)]
    Unknown(u8),
}

impl Pps {
    /// From byte 0xCA.
    pub const fn from_byte(byte: u8) -> Self {
        match byte {
            0 => Self::Absent,
            1 => Self::Synchronising,
            2 => Self::Locked,
            3 => Self::Error,
            other => Self::Unknown(other),
        }
    }

    /// The byte on the wire.
    pub const fn byte(self) -> u8 {
        match self {
            Self::Absent => 0,
            Self::Synchronising => 1,
            Self::Locked => 2,
            Self::Error => 3,
            Self::Unknown(byte) => byte,
        }
    }
}

impl core::fmt::Display for Pps {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Absent => f.write_str("absent"),
            Self::Synchronising => f.write_str("synchronising"),
            Self::Locked => f.write_str("locked"),
            Self::Error => f.write_str("error"),
            Self::Unknown(byte) => write!(f, "unknown ({byte})"),
        }
    }
}

/// A position packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PositionPacket {
    /// When it was made, µs past the hour. May lie slightly before a data packet that arrived earlier.
    pub stamp: LidarTime,
    /// State of the pulse input.
    pub pps: Pps,
    /// What the NMEA sentence says, or why it says nothing.
    pub rmc: Result<nmea::Rmc, nmea::NmeaError>,
    /// Top and bottom board, °C; `None` where the firmware leaves both bytes 0.
    pub temperature_c: Option<(i8, i8)>,
    /// The sensor shut its lasers down because of heat.
    pub thermal_shutdown: bool,
}

impl PositionPacket {
    /// Reads a payload.
    ///
    /// # Errors
    /// [`WireError::Length`] when it does not have 512 bytes; [`WireError::Sentence`] when there is no text where the
    /// sentence stands: any 512 bytes on the port would else speak of pulse and time.
    pub fn parse(payload: &[u8]) -> Result<Self, WireError> {
        let wrong = WireError::Length { got: payload.len() };
        let payload: &[u8; POSITION_LEN] = payload.try_into().map_err(|_length| wrong)?;
        let sentence = payload.get(SENTENCE..SENTENCE + SENTENCE_LEN).unwrap_or_default();
        let is_text = |byte: u8| matches!(byte, 0 | b'\r' | b'\n' | b' '..=b'~');
        if let Some((at, found)) = sentence.iter().enumerate().find(|(_, byte)| !is_text(**byte)) {
            return Err(WireError::Sentence { offset: (SENTENCE + at) as u16, found: *found });
        }
        let byte = |offset: usize| payload.get(offset).copied().unwrap_or(0);
        let stamp = u32::from_le_bytes([byte(0xC6), byte(0xC7), byte(0xC8), byte(0xC9)]);
        let (top, bottom) = (byte(0xBB).cast_signed(), byte(0xBC).cast_signed());
        Ok(Self {
            stamp: LidarTime(stamp),
            pps: Pps::from_byte(byte(0xCA)),
            rmc: nmea::parse_rmc(sentence),
            temperature_c: (top != 0 || bottom != 0).then_some((top, bottom)),
            thermal_shutdown: byte(0xCB) != 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tumbled_model::CivilTime;

    #[test]
    fn fields_are_where_the_table_puts_them() {
        let mut payload = [0u8; POSITION_LEN];
        payload[0xC6..0xCA].copy_from_slice(&1_082_342_001u32.to_le_bytes());
        payload[0xCA] = 2;
        payload[0xBB] = 61;
        payload[0xBC] = 256u16.wrapping_sub(5) as u8;
        // XOR of the characters between $ and *, done by hand tools: 40.
        let sentence = b"$GPRMC,042221.00,A,4124.8963,N,08151.6838,W,000.0,000.0,221126,,,A*40\r\n";
        payload[0xCE..0xCE + sentence.len()].copy_from_slice(sentence);
        let packet = PositionPacket::parse(&payload).expect("512 bytes");
        assert_eq!((packet.stamp, packet.pps), (LidarTime(1_082_342_001), Pps::Locked));
        assert_eq!(packet.temperature_c, Some((61, -5)));
        let rmc = packet.rmc.expect("checksum is right");
        assert_eq!(CivilTime::from_unix(rmc.utc).to_string(), "2026-11-22T04:22:21.000000000Z");
        assert_eq!(PositionPacket::parse(&payload[..511]), Err(WireError::Length { got: 511 }));
        payload[0xCE + 127] = 0xEE;
        assert_eq!(PositionPacket::parse(&payload), Err(WireError::Sentence { offset: 0x14D, found: 0xEE }));
    }

    #[test]
    fn a_sensor_without_a_receiver_says_so() {
        let packet = PositionPacket::parse(&[0; POSITION_LEN]).expect("512 bytes");
        assert_eq!((packet.pps, packet.rmc, packet.temperature_c), (Pps::Absent, Err(nmea::NmeaError::Empty), None));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_around_text_are_read(
            bytes in prop::collection::vec(any::<u8>(), 500..520), text in prop::collection::vec(b' '..=b'~', 128),
        ) {
            let refused = PositionPacket::parse(&bytes).is_err();
            // 128 random bytes are text once in (256 / 98)^128 = 10^53 times.
            prop_assert!(refused);
            let mut bytes = bytes;
            bytes.get_mut(0xCE..0xCE + 128).expect("500 bytes").copy_from_slice(&text);
            prop_assert_eq!(PositionPacket::parse(&bytes).is_ok(), bytes.len() == POSITION_LEN);
        }
    }
}

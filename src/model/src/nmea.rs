//! NMEA 0183 sentences: the checksum, and the UTC that an RMC sentence carries.
//!
//! `$GPRMC,081802.00,A,3649.747,N,00224.454,W,0.034,212.5,210116,0.0,E,A*2E`: field 1 is hhmmss with any number of
//! decimals, field 2 `A` (valid) or `V` (warning), field 9 ddmmyy. Twelve or thirteen fields; any talker.

use crate::civil::CivilTime;
use crate::time::UnixNs;

/// The longest sentence looked at, terminator excluded. The standard's limit is 82; receivers with more decimals exceed it.
pub const MAX_LEN: usize = 255;

/// Why a text is not an RMC sentence one may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
#[non_exhaustive]
pub enum NmeaError {
    /// Nothing there: the sensor has never heard a receiver.
    #[error("no sentence")]
    Empty,
    /// Not `$…*HH`.
    #[error("not an NMEA sentence: `$`, fields, `*` and two hex digits expected")]
    Frame,
    /// The XOR of the characters between `$` and `*` is something else.
    #[error("checksum {computed:02X} computed, {found:02X} in the sentence")]
    Checksum {
        /// XOR over the sentence.
        computed: u8,
        /// The two hex digits after `*`.
        found: u8,
    },
    /// A valid sentence of another kind (a VLP-32C also accepts GGA, which has no date).
    #[error("not an RMC sentence: it carries no date")]
    NotRmc,
    /// The time or date field is not a time or date.
    #[error("time or date field unreadable")]
    Field,
}

/// What an RMC sentence says about time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rmc {
    /// UTC of the sentence (of the pulse before it).
    pub utc: UnixNs,
    /// Status `A`: the receiver vouches for it. `V` sentences carry a free-running or remembered time.
    pub valid: bool,
}

/// Reads one sentence; trailing CR, LF and NUL padding are ignored.
///
/// # Errors
/// [`NmeaError`]: what is wrong with it.
pub fn parse_rmc(text: &[u8]) -> Result<Rmc, NmeaError> {
    let end = text.iter().position(|&b| matches!(b, b'\r' | b'\n' | 0)).unwrap_or(text.len());
    let (sentence, _) = text.split_at(end);
    if sentence.is_empty() {
        return Err(NmeaError::Empty);
    }
    let body = checked_body(sentence)?;
    let mut fields = body.split(|&b| b == b',');
    let address = fields.next().unwrap_or_default();
    if !(address.len() == 5 && address.ends_with(b"RMC")) {
        return Err(NmeaError::NotRmc);
    }
    let time = fields.next().ok_or(NmeaError::Field)?;
    let status = fields.next().ok_or(NmeaError::Field)?;
    let date = fields.nth(6).ok_or(NmeaError::Field)?;
    let utc = civil(time, date).and_then(CivilTime::to_unix).ok_or(NmeaError::Field)?;
    Ok(Rmc { utc, valid: status == b"A" })
}

/// An RMC sentence without a position, CR LF included, as a receiver on a bench would send it.
pub fn format_rmc(utc: UnixNs, valid: bool) -> String {
    let t = CivilTime::from_unix(utc);
    let status = if valid { 'A' } else { 'V' };
    let centis = t.nanosecond / 10_000_000;
    let body = format!(
        "GPRMC,{:02}{:02}{:02}.{centis:02},{status},,,,,,,{:02}{:02}{:02},,,N",
        t.hour,
        t.minute,
        t.second,
        t.day,
        t.month,
        t.year.rem_euclid(100)
    );
    let checksum = body.bytes().fold(0, |sum, b| sum ^ b);
    format!("${body}*{checksum:02X}\r\n")
}

/// The characters between `$` and `*`, once the checksum agrees.
fn checked_body(sentence: &[u8]) -> Result<&[u8], NmeaError> {
    let inner = match sentence.split_first() {
        Some((b'$' | b'!', inner)) if sentence.len() <= MAX_LEN => inner,
        _ => return Err(NmeaError::Frame),
    };
    let star = inner.iter().position(|&b| b == b'*').ok_or(NmeaError::Frame)?;
    let (body, rest) = inner.split_at(star);
    let digits: &[u8; 2] = rest.get(1..).and_then(|hex| hex.try_into().ok()).ok_or(NmeaError::Frame)?;
    let digit = |b: u8| char::from(b).to_digit(16).map(|d| d as u8).ok_or(NmeaError::Frame);
    let found = digit(digits[0])? << 4 | digit(digits[1])?;
    let computed = body.iter().fold(0, |sum, b| sum ^ b);
    if computed == found { Ok(body) } else { Err(NmeaError::Checksum { computed, found }) }
}

fn civil(time: &[u8], date: &[u8]) -> Option<CivilTime> {
    let (hms, fraction) = match time.iter().position(|&b| b == b'.') {
        Some(dot) => (time.get(..dot)?, time.get(dot + 1..)?),
        None => (time, &[][..]),
    };
    let [hour, minute, second] = three_pairs(hms)?;
    let [day, month, year] = three_pairs(date)?;
    let mut nanosecond = 0;
    let mut scale = 100_000_000;
    for digit in fraction {
        nanosecond += char::from(*digit).to_digit(10)? * scale;
        scale /= 10; // decimals beyond the ninth count nothing
    }
    let year = if year < 80 { 2000 } else { 1900 } + i32::from(year);
    Some(CivilTime { year, month, day, hour, minute, second, nanosecond })
}

fn three_pairs(digits: &[u8]) -> Option<[u8; 3]> {
    let digits: &[u8; 6] = digits.try_into().ok()?;
    let mut pairs = [0; 3];
    for (value, pair) in pairs.iter_mut().zip(digits.as_chunks::<2>().0) {
        *value = (char::from(pair[0]).to_digit(10)? * 10 + char::from(pair[1]).to_digit(10)?) as u8;
    }
    Some(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn utc(text: &str) -> Result<String, NmeaError> {
        parse_rmc(text.as_bytes()).map(|rmc| format!("{} {}", CivilTime::from_unix(rmc.utc), rmc.valid))
    }

    #[test]
    fn sentences_with_known_checksums() {
        let read = |text| utc(text).expect("valid sentence");
        assert_eq!(
            read("$GPRMC,042221.00,A,4124.8963,N,08151.6838,W,000.0,000.0,221126,,,A*40\r\n\0\0"),
            "2026-11-22T04:22:21.000000000Z true"
        );
        assert_eq!(
            read("$GPRMC,225446.00,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E*46"),
            "1994-11-19T22:54:46.000000000Z true"
        );
        assert_eq!(read("$GNRMC,235959.00,V,,,,,,,311226,,,N*67"), "2026-12-31T23:59:59.000000000Z false");
    }

    #[test]
    fn what_is_wrong_is_named() {
        assert_eq!(utc(""), Err(NmeaError::Empty));
        assert_eq!(utc("\0\0"), Err(NmeaError::Empty));
        assert_eq!(utc("GPRMC,1*00"), Err(NmeaError::Frame));
        // One digit changed: 042221 → 042222 flips two bits of one character: 40 ^ 31 ^ 32 = 43.
        assert_eq!(
            utc("$GPRMC,042222.00,A,4124.8963,N,08151.6838,W,000.0,000.0,221126,,,A*40"),
            Err(NmeaError::Checksum { computed: 0x43, found: 0x40 })
        );
        assert_eq!(utc("$GPZDA,042221.00,22,11,2026,00,00*67"), Err(NmeaError::NotRmc));
        // No fix yet, no time: empty fields. XOR of "GPRMC,,V,,,,,,,,,,N" is 53.
        assert_eq!(utc("$GPRMC,,V,,,,,,,,,,N*53"), Err(NmeaError::Field));
    }

    proptest! {
        #[test]
        fn own_sentences_are_read_back(centis in 0i64..100 * 4_000_000_000, valid in any::<bool>()) {
            let utc = UnixNs(centis * 10_000_000); // 1970 to 2079 (two-digit years)
            prop_assume!(utc < UnixNs(3_471_292_800_000_000_000) && utc > UnixNs(315_532_800_000_000_000));
            prop_assert_eq!(parse_rmc(format_rmc(utc, valid).as_bytes()), Ok(Rmc { utc, valid }));
        }

        #[test]
        fn arbitrary_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _verdict = parse_rmc(&bytes);
        }

        #[test]
        fn arbitrary_bodies_with_a_right_checksum_are_read_or_refused(body in "[A-Z0-9,.]{0,60}") {
            let sum = body.bytes().fold(0, |s, b| s ^ b);
            let verdict = parse_rmc(format!("$GPRMC,{body}*{:02X}", sum ^ b"GPRMC,".iter().fold(0, |s, b| s ^ b)).as_bytes());
            let framed = !matches!(verdict, Err(NmeaError::Frame | NmeaError::Checksum { .. }));
            prop_assert!(framed, "the checksum is right");
        }
    }
}

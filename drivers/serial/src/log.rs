//! The bytes on a serial line with their times, as text: `serial.log`.
//!
//! A line is a chunk: when, in ns of the session; `>` for what the host sent (the instant its last byte had left) or `<`
//! for what one read gave; the bytes. CR, LF and `\` are written `\r`, `\n` and `\\`, other bytes that are not printable
//! ASCII `\xHH`.
//!
//! ```text
//!   1022343750 > /1 1 51 get encoder.pos:18\n
//!   1023630555 < @01 1 51 OK BUSY -- 15106:14\r\n
//! ```

use core::fmt::{self, Write};
use tumbled_model::RigNs;

/// A chunk of bytes on a serial line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogEntry {
    /// When: after the write was drained, or when the read returned.
    pub at: RigNs,
    /// Who sent it.
    pub side: Side,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// Who sent a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The host, to the device.
    Host,
    /// The device, to the host.
    Device,
}

/// A line that is no log entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LogError {
    /// It does not begin with a whole number of nanoseconds, a space, `>` or `<`, and a space.
    #[error("nanoseconds, `>` or `<` and the bytes expected, with a space between")]
    Head,
    /// A backslash that is not followed by `r`, `n`, `\` or `x` and two hex digits, or a character that should be behind one.
    #[error("character {at} of the bytes: \\r, \\n, \\\\, \\xHH or printable ASCII expected")]
    Byte {
        /// Which one, from 0.
        at: usize,
    },
}

impl fmt::Display for LogEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mark = match self.side {
            Side::Host => '>',
            Side::Device => '<',
        };
        write!(f, "{} {mark} ", self.at.0)?;
        for &byte in &self.bytes {
            match byte {
                b'\r' => f.write_str("\\r")?,
                b'\n' => f.write_str("\\n")?,
                b'\\' => f.write_str("\\\\")?,
                b' '..=b'~' => f.write_char(char::from(byte))?,
                _ => write!(f, "\\x{byte:02X}")?,
            }
        }
        Ok(())
    }
}

impl LogEntry {
    /// Reads a line of a log, without its end.
    ///
    /// # Errors
    /// [`LogError`]: what is wrong with it.
    pub fn parse(line: &str) -> Result<Self, LogError> {
        let (at, rest) = line.split_once(' ').ok_or(LogError::Head)?;
        let at = at.parse().map(RigNs).map_err(|_not_a_number| LogError::Head)?;
        let (side, text) = match rest.split_at_checked(2) {
            Some(("> ", text)) => (Side::Host, text),
            Some(("< ", text)) => (Side::Device, text),
            _ => return Err(LogError::Head),
        };
        Ok(Self { at, side, bytes: unescaped(text)? })
    }
}

fn unescaped(text: &str) -> Result<Vec<u8>, LogError> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.chars();
    while let Some(first) = rest.next() {
        let wrong = LogError::Byte { at: text.len() - rest.as_str().len() - first.len_utf8() };
        let byte = match first {
            '\\' => match rest.next().ok_or(wrong)? {
                'r' => b'\r',
                'n' => b'\n',
                '\\' => b'\\',
                'x' => {
                    let mut digit = || rest.next().and_then(|c| c.to_digit(16)).and_then(|d| u8::try_from(d).ok());
                    let (high, low) = (digit().ok_or(wrong)?, digit().ok_or(wrong)?);
                    16 * high + low
                }
                _ => return Err(wrong),
            },
            ' '..='~' => u8::try_from(first).map_err(|_not_a_byte| wrong)?,
            _ => return Err(wrong),
        };
        bytes.push(byte);
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_log_is_read_by_people() {
        let entry = LogEntry { at: RigNs(-5), side: Side::Device, bytes: b"@01 \\\xFF\r\n".to_vec() };
        assert_eq!(entry.to_string(), r"-5 < @01 \\\xFF\r\n");
        let error = |line| LogEntry::parse(line).expect_err("no entry");
        assert_eq!([error("5 = x"), error("x < x"), error("5 <")], [LogError::Head; 3]);
        assert_eq!(error(r"5 < ab\q"), LogError::Byte { at: 2 });
        assert_eq!(error("5 < abö"), LogError::Byte { at: 2 });
        assert_eq!(error(r"5 < \x4"), LogError::Byte { at: 0 });
    }

    proptest! {
        #[test]
        fn any_entry_is_read_as_it_was_written(at: i64, host: bool, bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            let entry = LogEntry { at: RigNs(at), side: if host { Side::Host } else { Side::Device }, bytes };
            let line = entry.to_string();
            prop_assert!(line.bytes().all(|byte| matches!(byte, b' '..=b'~')));
            prop_assert_eq!(LogEntry::parse(&line), Ok(entry));
        }

        #[test]
        fn arbitrary_lines_are_an_entry_or_an_error(line in r"-?[0-9]{0,3} [<>] ([ -~]|\\x[0-9A-F]|\\[rn]|\PC){0,20}") {
            if let Ok(entry) = LogEntry::parse(&line) {
                prop_assert_eq!(LogEntry::parse(&entry.to_string()), Ok(entry));
            }
        }
    }
}

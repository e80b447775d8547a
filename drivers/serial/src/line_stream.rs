//! A stream of encoder readings in lines of text: this project's own protocol for a microcontroller that reads an encoder.
//!
//! ```text
//!   H,<counts per turn u32>,<firmware>*HH          once, first
//!   E,<seq u32>,<device µs u32>,<count i32>*HH     100 to 1000 times a second
//! ```
//!
//! Lines end with CR LF. `HH` is the XOR of all characters before the `*`, two upper-case hex digits. `seq` grows by one
//! a line and goes on at 0 after 2³²−1, as do the µs; the count goes on at the other end of its range.

use crate::lines::{LineFault, Lines};
use tumbled_model::RigNs;

/// The longest line, its end not counted: an `E` line has 38 characters at most, the rest is for a firmware's name.
pub const LINE_BYTES: usize = 80;

/// A line of the stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StreamLine {
    /// The device has started.
    Header {
        /// Counts of a full turn; not 0.
        counts_per_turn: u32,
        /// What runs on the device; may hold commas.
        firmware: String,
    },
    /// A reading as it is on the wire.
    Reading {
        /// The line's number.
        seq: u32,
        /// When it was taken: the device's µs counter, which wraps.
        device_us: u32,
        /// The encoder's count, which wraps.
        count: i32,
    },
}

/// Why a line is not one of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// It does not end with `*` and two hex digits: cut, or no line of this protocol.
    #[error("a line ends with `*` and two upper-case hex digits")]
    Frame,
    /// The XOR of the characters before the `*` is another one.
    #[error("checksum {computed:02X} computed, {found:02X} in the line")]
    Checksum {
        /// XOR over the line.
        computed: u8,
        /// The two digits.
        found: u8,
    },
    /// It has a right checksum and is neither an `H` nor an `E` line, or a number is out of range.
    #[error("`H,counts per turn,firmware` or `E,seq,us,count` expected")]
    Fields,
}

impl StreamLine {
    /// Reads a line without its end.
    ///
    /// # Errors
    /// [`StreamError`]: what is wrong with it.
    pub fn parse(line: &str) -> Result<Self, StreamError> {
        let (body, digits) = line.rsplit_once('*').ok_or(StreamError::Frame)?;
        let upper = digits.len() == 2 && digits.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'A'..=b'F'));
        let found = u8::from_str_radix(digits, 16).ok().filter(|_| upper).ok_or(StreamError::Frame)?;
        let computed = xor(body);
        if computed != found {
            return Err(StreamError::Checksum { computed, found });
        }
        Self::fields(body).ok_or(StreamError::Fields)
    }

    fn fields(body: &str) -> Option<Self> {
        let (kind, rest) = body.split_once(',')?;
        match kind {
            "H" => {
                let (counts, firmware) = rest.split_once(',')?;
                let counts_per_turn = counts.parse().ok().filter(|counts| *counts > 0)?;
                Some(Self::Header { counts_per_turn, firmware: firmware.to_owned() })
            }
            "E" => {
                let (seq, rest) = rest.split_once(',')?;
                let (device_us, count) = rest.split_once(',')?;
                Some(Self::Reading {
                    seq: seq.parse().ok()?,
                    device_us: device_us.parse().ok()?,
                    count: count.parse().ok()?,
                })
            }
            _ => None,
        }
    }

    /// The line as the device sends it, with its end.
    pub fn encode(&self) -> Vec<u8> {
        let body = match self {
            Self::Header { counts_per_turn, firmware } => format!("H,{counts_per_turn},{firmware}"),
            Self::Reading { seq, device_us, count } => format!("E,{seq},{device_us},{count}"),
        };
        format!("{body}*{:02X}\r\n", xor(&body)).into_bytes()
    }
}

fn xor(body: &str) -> u8 {
    body.bytes().fold(0, |sum, byte| sum ^ byte)
}

/// What was heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StreamHeard {
    /// The device started. Its clock, line numbers and, without an index pulse, its zero are new.
    Started {
        /// Counts of a full turn; not 0.
        counts_per_turn: u32,
        /// What runs on the device.
        firmware: String,
    },
    /// A reading.
    Reading(Reading),
}

/// A reading, put behind the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// When the line's first byte was there.
    pub arrived: RigNs,
    /// When it was taken: the device's µs counter, which wraps. For a clock mapper.
    pub device_us: u32,
    /// The position, counts since the device started; not wrapped.
    pub counts: i64,
    /// So many lines before it are missing.
    pub lost: u32,
}

/// How often what happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounts {
    /// Readings given out.
    pub readings: u64,
    /// Lines that are missing by their numbers (`serial_lost`).
    pub lost: u64,
    /// Starts of the device: header lines, and numbers that went back without one.
    pub starts: u64,
    /// Lines with a byte that is not printable ASCII.
    pub not_text: u64,
    /// Lines longer than any may be.
    pub too_long: u64,
    /// Lines whose checksum is another one.
    pub bad_checksum: u64,
    /// Lines without checksum or without the fields.
    pub malformed: u64,
}

/// Reads the stream from chunks cut anywhere. Holds one unfinished line; damage costs the line it is in, no more.
#[derive(Clone, Debug)]
pub struct LineStream {
    lines: Lines,
    state: State,
}

#[derive(Clone, Debug, Default)]
struct State {
    /// Number, count on the wire and unwrapped count of the last reading since the start.
    last: Option<(u32, i32, i64)>,
    counts: StreamCounts,
}

impl Default for LineStream {
    fn default() -> Self {
        Self { lines: Lines::new(LINE_BYTES), state: State::default() }
    }
}

impl LineStream {
    /// Takes the bytes one read gave at `at`. What they say is added to `out`.
    pub fn push(&mut self, at: RigNs, bytes: &[u8], out: &mut Vec<StreamHeard>) {
        let Self { lines, state } = self;
        lines.push(at, bytes, |line| match line.text.map(StreamLine::parse) {
            Ok(Ok(StreamLine::Header { counts_per_turn, firmware })) => {
                state.last = None;
                state.counts.starts += 1;
                out.push(StreamHeard::Started { counts_per_turn, firmware });
            }
            Ok(Ok(StreamLine::Reading { seq, device_us, count })) => {
                let (lost, counts) = state.place(seq, count);
                out.push(StreamHeard::Reading(Reading { arrived: line.begun, device_us, counts, lost }));
            }
            Ok(Err(StreamError::Checksum { .. })) => state.counts.bad_checksum += 1,
            Ok(Err(StreamError::Frame | StreamError::Fields)) => state.counts.malformed += 1,
            Err(LineFault::NotText) => state.counts.not_text += 1,
            Err(LineFault::TooLong) => state.counts.too_long += 1,
        });
    }

    /// How often what happened so far.
    pub const fn counts(&self) -> StreamCounts {
        self.state.counts
    }
}

impl State {
    /// How many lines are missing before a reading, and its count unwrapped.
    fn place(&mut self, seq: u32, count: i32) -> (u32, i64) {
        self.counts.readings += 1;
        let step = self.last.map(|(last, ..)| seq.wrapping_sub(last));
        let (lost, counts) = match (step, self.last) {
            // Half the range and more ahead is behind: a serial line does not reorder, so the device began again and its
            // header was lost.
            (Some(step), Some((_, last, counts))) if (1..=u32::MAX / 2).contains(&step) => {
                (step - 1, counts + i64::from(count.wrapping_sub(last)))
            }
            (Some(_), _) => {
                self.counts.starts += 1;
                (0, i64::from(count))
            }
            (None, _) => (0, i64::from(count)),
        };
        self.counts.lost += u64::from(lost);
        self.last = Some((seq, count, counts));
        (lost, counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn heard(bytes: &[u8]) -> (Vec<StreamHeard>, StreamCounts) {
        let mut stream = LineStream::default();
        let mut out = Vec::new();
        stream.push(RigNs(5), bytes, &mut out);
        (out, stream.counts())
    }

    fn lines(readings: &[(u32, i32)]) -> Vec<u8> {
        let line = |&(seq, count)| StreamLine::Reading { seq, device_us: 7, count }.encode();
        readings.iter().flat_map(line).collect()
    }

    fn placed(readings: &[(u32, i32)]) -> Vec<(u32, i64)> {
        let read =
            |heard: &StreamHeard| if let StreamHeard::Reading(r) = heard { Some((r.lost, r.counts)) } else { None };
        heard(&lines(readings)).0.iter().filter_map(read).collect()
    }

    #[test]
    fn lines_are_written_and_read_with_their_checksum() {
        // E ^ , ^ 1 ^ , ^ 2 ^ , ^ - ^ 3 = 45 2C 31 2C 32 2C 2D 33: 45^31^32^33 = 75, three commas 2C: 59, 2D: 74.
        let line = StreamLine::Reading { seq: 1, device_us: 2, count: -3 };
        assert_eq!(line.encode(), b"E,1,2,-3*74\r\n");
        assert_eq!(StreamLine::parse("E,1,2,-3*74"), Ok(line));
        assert_eq!(StreamLine::parse("E,1,2,-4*74"), Err(StreamError::Checksum { computed: 0x73, found: 0x74 }));
        assert_eq!(StreamLine::parse("E,1,2,-3"), Err(StreamError::Frame));
        // H ^ , ^ 0 ^ , ^ x = 48 30 78, two commas cancel: 00.
        assert_eq!(StreamLine::parse("H,0,x*00"), Err(StreamError::Fields));
        let header = StreamLine::Header { counts_per_turn: 4_096, firmware: "rig-encoder,2".to_owned() };
        let bytes = header.encode();
        assert_eq!(StreamLine::parse(core::str::from_utf8(&bytes).expect("text").trim_end()), Ok(header));
    }

    #[test]
    fn numbers_and_counts_go_on_over_their_wrap() {
        let before = (u32::MAX, i32::MAX);
        // One step over both wraps; then line 1 is missing.
        let after = placed(&[before, (0, i32::MIN), (2, i32::MIN + 5)]);
        let max = i64::from(i32::MAX);
        assert_eq!(after, [(0, max), (0, max + 1), (1, max + 6)]);
    }

    #[test]
    fn a_device_that_starts_again_loses_nothing_and_counts_from_its_own_zero() {
        assert_eq!(placed(&[(70_000, 900), (0, 3), (1, 4)]), [(0, 900), (0, 3), (0, 4)]);
        let (_, counts) = heard(&lines(&[(70_000, 900), (0, 3), (1, 4), (1, 4)]));
        // The same number twice is a start too: a device that hangs at line 1 is not a source of samples in order.
        assert_eq!((counts.starts, counts.lost, counts.readings), (2, 0, 4));
    }

    #[test]
    fn damage_is_counted_and_shows_as_a_gap() {
        let [first, bad, last] = [(1, 10), (2, 20), (3, 30)].map(|reading| lines(&[reading]));
        // `E,2` becomes `E,3`: one bit, so the XOR shows it.
        let spoilt: Vec<u8> = bad.iter().enumerate().map(|(n, byte)| if n == 2 { byte ^ 1 } else { *byte }).collect();
        let (out, counts) = heard(&[first, spoilt, b"E,9\r\n\xFE\r\n".to_vec(), last].concat());
        assert_eq!((out.len(), counts.lost), (2, 1));
        assert_eq!((counts.bad_checksum, counts.malformed, counts.not_text), (1, 1, 1));
    }

    proptest! {
        #[test]
        fn any_reading_is_read_as_it_was_written(seq: u32, device_us: u32, count: i32) {
            let line = StreamLine::Reading { seq, device_us, count };
            let bytes = line.encode();
            prop_assert!(bytes.len() <= 40);
            prop_assert_eq!(StreamLine::parse(core::str::from_utf8(&bytes).expect("text").trim_end()), Ok(line));
        }

        #[test]
        fn arbitrary_bytes_leave_the_next_lines_alone(
            noise in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"EH,*-0123\r\n".to_vec())], 0..300),
            count: i32,
        ) {
            let bytes = [&noise[..], b"\n", &lines(&[(7, count), (8, count)])].concat();
            let (out, _) = heard(&bytes);
            let Some(StreamHeard::Reading(last)) = out.last() else { panic!("a reading") };
            prop_assert_eq!(last.lost, 0);
        }
    }
}

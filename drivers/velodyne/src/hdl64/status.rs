//! What an HDL-64E tells about itself in the last six bytes of a packet, a little in each.
//!
//! With a clock (S2, S3): the time stamp u32, a type, a value. Sixteen types make a cycle: H M S D N Y (time and date),
//! G (GPS), T (temperature), V (firmware), and seven that carry the calibration ([`super::in_stream`]); on an S3 one of
//! these is now and then W (warnings).
//!
//! As text (S1, early S2): a u16, then four characters: `DegC` (the u16 is a temperature) or `V` and three more
//! (firmware; the u16 counts turns). In a real S1 capture the two alternate.

use tumbled_model::{CivilTime, UnixNs};

/// What six bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tail {
    /// A clock, a type and its value.
    Typed {
        /// The type, an ASCII letter or digit.
        kind: u8,
        /// The value.
        value: u8,
    },
    /// Text: the temperature of the unit, 1/256 °C.
    Temperature(u16),
    /// Text: turns since power-up, and the firmware.
    Firmware {
        /// Turns, wraps.
        turns: u16,
        /// Four characters, the first `V` or `v`.
        text: [u8; 4],
    },
}

impl Tail {
    /// The kinds that speak of time and unit. All others carry the calibration (W does both).
    pub const OWN_KINDS: [u8; 9] = *b"HMSDNYGTV";

    /// Reads six bytes. Whether they are text they do not say themselves: a stamp can look like it. `text` is what is
    /// known from the packets before, if anything.
    pub fn read(bytes: &[u8; 6], text: Option<bool>) -> Self {
        let [a, b, c, d, e, f] = *bytes;
        let number = u16::from_le_bytes([a, b]);
        let characters = [c, d, e, f];
        // A stamp that ends in "De" comes up for 65 ms an hour, and 'g' is no type of a typed tail.
        if characters == *b"DegC" {
            return Self::Temperature(number);
        }
        let firmware = matches!(c, b'V' | b'v') && d.is_ascii_digit() && e.is_ascii_graphic() && f.is_ascii_graphic();
        if firmware && text != Some(false) {
            return Self::Firmware { turns: number, text: characters };
        }
        Self::Typed { kind: e, value: f }
    }

    /// Whether the first four bytes are a time stamp.
    pub fn stamped(self) -> bool {
        matches!(self, Self::Typed { .. })
    }
}

/// The firmware as it names itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// S2, S3: a number.
    Number(u8),
    /// S1, early S2: four ASCII characters such as `v25c`.
    Text([u8; 4]),
}

/// Warning bits (S3: type W; S2: in the calibration's tail).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Warnings(pub u8);

impl Warnings {
    /// Bit 0: the lens is dirty.
    pub fn lens_contaminated(self) -> bool {
        self.0 & 1 != 0
    }
    /// Bit 1: too hot inside.
    pub fn too_hot(self) -> bool {
        self.0 & 2 != 0
    }
    /// Bit 2: too cold inside.
    pub fn too_cold(self) -> bool {
        self.0 & 4 != 0
    }
    /// Bit 5: pulse per second present.
    pub fn pps(self) -> bool {
        self.0 & 0x20 != 0
    }
    /// Bit 6: time from a GPS receiver present.
    pub fn gps_time(self) -> bool {
        self.0 & 0x40 != 0
    }
}

/// The last of everything said so far; `None` until it was said.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    date_time: Option<CivilTime>,
    /// H M S D N Y of the cycle under way, as far as they came in a row.
    gathering: ([u8; 6], usize),
    /// GPS status byte as sent.
    pub gps: Option<u8>,
    /// °C.
    pub temperature_c: Option<f32>,
    /// Firmware.
    pub firmware: Option<Firmware>,
    /// S3's warnings.
    pub warnings: Option<Warnings>,
    /// Text tails: turns since power-up.
    pub turns: Option<u16>,
    /// Whether tails are text; `None` until one was clear.
    pub text: Option<bool>,
}

impl Status {
    /// Date and time of day by the sensor's clock, whole seconds. From six packets in a row, so one second old at most.
    pub fn date_time(&self) -> Option<CivilTime> {
        self.date_time
    }

    /// [`Self::date_time`] when the GPS status says that a receiver vouches for it (`A`).
    pub fn gps_time(&self) -> Option<UnixNs> {
        if self.gps == Some(b'A') { self.date_time.and_then(CivilTime::to_unix) } else { None }
    }

    /// Takes in the tail of the next packet and says what it was.
    pub fn update(&mut self, bytes: &[u8; 6]) -> Tail {
        let tail = Tail::read(bytes, self.text);
        match tail {
            Tail::Temperature(in_256ths) => {
                self.text = Some(true);
                self.temperature_c = Some(f32::from(in_256ths) / 256.0);
            }
            Tail::Firmware { turns, text } => {
                self.turns = Some(turns);
                self.firmware = Some(Firmware::Text(text));
            }
            Tail::Typed { kind, value } => {
                self.text = Some(false);
                self.typed(kind, value);
            }
        }
        tail
    }

    fn typed(&mut self, kind: u8, value: u8) {
        match kind {
            b'H' | b'M' | b'S' | b'D' | b'N' | b'Y' => self.gather(kind, value),
            b'G' => self.gps = Some(value),
            b'T' => self.temperature_c = Some(f32::from(value)),
            b'V' => self.firmware = Some(Firmware::Number(value)),
            b'W' => self.warnings = Some(Warnings(value)),
            _ => {}
        }
    }

    /// Puts H M S D N Y together; one out of its turn (a lost packet) starts over.
    fn gather(&mut self, kind: u8, value: u8) {
        let (values, came) = &mut self.gathering;
        if kind == b'H' {
            *came = 0;
        }
        match b"HMSDNY".get(*came) {
            Some(&expected) if expected == kind => {
                if let Some(place) = values.get_mut(*came) {
                    *place = value;
                }
                *came += 1;
            }
            _ => *came = b"HMSDNY".len() + 1, // no kind is expected before the next H
        }
        if *came == values.len() {
            let [hour, minute, second, day, month, year] = *values;
            let time = CivilTime { year: 2000 + i32::from(year), month, day, hour, minute, second, nanosecond: 0 };
            // A clock never set says 0 for day and month: no date then.
            self.date_time = time.to_unix().map(|_valid| time);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn say(status: &mut Status, kinds: &[u8], values: &[u8]) {
        for (&kind, &value) in kinds.iter().zip(values) {
            status.update(&[0, 0, 0, 0, kind, value]);
        }
    }

    #[test]
    fn a_cycle_of_types_tells_time_and_unit() {
        let mut status = Status::default();
        say(&mut status, b"HMSDNYGTVW", &[13, 59, 7, 22, 11, 26, b'A', 31, 227, 0x61]);
        let time = status.date_time().expect("six in a row");
        assert_eq!((time.year, time.month, time.day), (2026, 11, 22));
        assert_eq!((time.hour, time.minute, time.second), (13, 59, 7));
        assert_eq!((status.gps, status.temperature_c), (Some(b'A'), Some(31.0)));
        assert_eq!(status.firmware, Some(Firmware::Number(227)));
        // 0x61 = bits 0, 5, 6.
        let w = status.warnings.expect("W was said");
        assert_eq!(
            [w.lens_contaminated(), w.too_hot(), w.too_cold(), w.pps(), w.gps_time()],
            [true, false, false, true, true]
        );
    }

    #[test]
    fn a_date_is_never_put_together_across_a_lost_packet() {
        let mut status = Status::default();
        say(&mut status, b"HMDNY", &[13, 59, 22, 11, 26]);
        assert_eq!(status.date_time(), None);
        say(&mut status, b"MSDNY", &[59, 7, 22, 11, 26]);
        assert_eq!(status.date_time(), None);
        say(&mut status, b"HMSDNY", &[13, 59, 7, 22, 13, 26]); // a month 13
        assert_eq!(status.date_time(), None);
    }

    #[test]
    fn text_tails_are_temperature_and_firmware_in_turn() {
        let mut status = Status::default();
        // 0x2040 / 256 = 32.25 °C.
        assert!(!status.update(&[0x40, 0x20, b'D', b'e', b'g', b'C']).stamped());
        assert!(!status.update(b"\x21\x0cv25c").stamped());
        assert_eq!((status.temperature_c, status.turns), (Some(32.25), Some(0x0c21)));
        assert_eq!(status.firmware, Some(Firmware::Text(*b"v25c")));
    }

    #[test]
    fn a_stamp_that_looks_like_firmware_stays_a_stamp_once_stamps_are_known() {
        let mut status = Status::default();
        status.update(&[1, 2, 3, 4, b'H', 5]);
        assert!(status.update(b"\x21\x0cV2H5").stamped());
        assert_eq!(Tail::read(b"\x21\x0cV2H5", Some(false)), Tail::Typed { kind: b'H', value: b'5' });
    }
}

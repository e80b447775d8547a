//! The calibration an HDL-64E S2 or S3 sends along: one byte in 7 of every 16 packets, 1 820 bytes, 4 160 packets in all
//! (1.2 s on an S2, 1.44 s on an S3), then from the start again.
//!
//! | offset behind `UNIT#` | size | field |
//! |---|---|---|
//! | 0 | 5 | `UNIT#` |
//! | 5, 6 | 1 each | noise threshold, upper and lower bank |
//! | 7 + 28·i, i = 0..64 | 21 of 28 | a laser: id u8, nine i16 (below), min and max intensity u8 |
//! | 1792 | 28 | the unit: [`Unit`] |
//! | 1818 | 2 | S3: CRC-16 (polynomial 0x8005, start 0) over bytes 1..21 of the 64 groups; S2: the length, 1820 |
//!
//! The i16: vertical and rotation 0.01°; far, X, Y distance, vertical and horizontal offset, focal distance 1 mm; focal
//! slope 0.1. Source: HDL-64E S2 and S3 manuals, appendix on the calibration in the data stream.
//!
//! Bytes go to the place the packet has in the cycle of 4 160, counted by the stamps: a lost packet leaves a hole that
//! the next cycle fills, and does not cost the whole cycle.

use super::calibration::{Calibration, CalibrationError, LaserCalibration};
use super::field::{Field, Gathered};
use super::pace::Step;
use super::status::Tail;
use tumbled_model::CivilTime;

/// Bytes of the calibration.
pub const STREAM_LEN: usize = 1820;
/// Status types in a cycle.
pub const KINDS: usize = 16;
/// Types of a cycle that carry the calibration.
pub const CARRIERS: usize = 7;
/// Packets that carry the whole.
pub const PACKETS: usize = STREAM_LEN / CARRIERS * KINDS;
/// Bytes of a laser's group.
pub(super) const GROUP: usize = 28;
/// Where the groups start.
pub(super) const GROUPS_AT: usize = 7;
/// Where the [`Unit`]'s bytes start: it takes the unused end of laser 63's group.
pub(super) const UNIT_AT: usize = STREAM_LEN - GROUP;
/// What a stream starts with.
pub(super) const START: &[u8; 5] = b"UNIT#";
/// The fields of a laser in the order of the stream, with their factor to SI.
pub(super) const FIELDS: [(Field, f64); 9] = {
    let rad_per_cdeg = core::f64::consts::PI / 18_000.0;
    [
        (Field::Vertical, rad_per_cdeg),
        (Field::Rotation, rad_per_cdeg),
        (Field::Distance, 0.001),
        (Field::DistanceX, 0.001),
        (Field::DistanceY, 0.001),
        (Field::VerticalOffset, 0.001),
        (Field::HorizontalOffset, 0.001),
        (Field::FocalDistance, 0.001),
        (Field::FocalSlope, 0.1),
    ]
};

/// Why 1 820 bytes are not a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InStreamError {
    /// No `UNIT#` anywhere.
    #[error("no `UNIT#` in {STREAM_LEN} status bytes; the sensor may not send its calibration: give a file")]
    Start,
    /// Neither the checksum nor the length at the end.
    #[error(
        "the status bytes end with {found:#06x}; {expected:#06x} expected: wait for the next cycle, or give a file"
    )]
    Checksum {
        /// The last two bytes.
        found: u16,
        /// S3: the CRC of what was received; S2: 1820.
        expected: u16,
    },
    /// The numbers themselves.
    #[error("the calibration in the status bytes: {0}")]
    Content(#[from] CalibrationError),
}

/// What the stream says of the unit besides its lasers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unit {
    /// Noise threshold of the upper bank.
    pub noise_upper: u8,
    /// Noise threshold of the lower bank.
    pub noise_lower: u8,
    /// When it was calibrated; `None` when it was not, or says nonsense.
    pub calibrated: Option<CivilTime>,
    /// Relative humidity inside, %.
    pub humidity_percent: u8,
    /// Speed set, revolutions per minute.
    pub rpm: i16,
    /// Field of view set: from, 0.01°.
    pub view_from_cdeg: u16,
    /// Field of view set: to, 0.01°.
    pub view_to_cdeg: u16,
    /// Hours of operation.
    pub hours: u16,
    /// Address of the sensor.
    pub source_ip: [u8; 4],
    /// Address it sends to.
    pub destination_ip: [u8; 4],
    /// Return mode: 0 strongest, 1 last, 2 both.
    pub return_mode: u8,
    /// S2: warning bits.
    pub warnings: u8,
    /// Laser power level.
    pub power: u8,
}

/// A calibration out of the packets.
#[derive(Clone, Debug, PartialEq)]
pub struct InStream {
    /// The lasers.
    pub calibration: Calibration,
    /// The unit.
    pub unit: Unit,
}

/// CRC-16, polynomial 0x8005, start 0, most significant bit first.
pub(super) fn crc16(bytes: impl IntoIterator<Item = u8>) -> u16 {
    let mut register = 0u16;
    for byte in bytes {
        register ^= u16::from(byte) << 8;
        for _ in 0..8 {
            register = if register & 0x8000 != 0 { register << 1 ^ 0x8005 } else { register << 1 };
        }
    }
    register
}

/// The CRC of an aligned stream.
pub(super) fn stream_crc(stream: &[u8; STREAM_LEN]) -> u16 {
    let groups = stream.get(GROUPS_AT..).unwrap_or_default().chunks_exact(GROUP);
    crc16(groups.flat_map(|group| group.iter().copied().skip(1).take(20)))
}

/// Reads 1 820 status bytes, `UNIT#` anywhere in them. `s3` says how they end.
///
/// # Errors
/// [`InStreamError`].
pub fn parse(bytes: &[u8; STREAM_LEN], s3: bool) -> Result<InStream, InStreamError> {
    let start = (0..STREAM_LEN)
        .find(|&at| START.iter().enumerate().all(|(i, byte)| bytes.get((at + i) % STREAM_LEN) == Some(byte)))
        .ok_or(InStreamError::Start)?;
    let mut stream = *bytes;
    stream.rotate_left(start);
    let &[.., low, high] = &stream;
    let found = u16::from_le_bytes([low, high]);
    let expected = if s3 { stream_crc(&stream) } else { STREAM_LEN as u16 };
    if found != expected {
        return Err(InStreamError::Checksum { found, expected });
    }
    let mut gathered = Gathered::new();
    for group in stream.get(GROUPS_AT..).unwrap_or_default().chunks_exact(GROUP).take(64) {
        let &[id, ref rest @ ..] = group else { continue };
        let id = Gathered::id(0, f64::from(id))?;
        let mut laser = LaserCalibration::default();
        let (numbers, bytes) = rest.as_chunks::<2>().0.split_at_checked(FIELDS.len()).unwrap_or_default();
        for ((field, to_si), number) in FIELDS.into_iter().zip(numbers) {
            field.put(&mut laser, id, f64::from(i16::from_le_bytes(*number)) * to_si)?;
        }
        if let Some(&[min, max]) = bytes.first() {
            (laser.min_intensity, laser.max_intensity) = (min, max);
        }
        gathered.insert(0, id, laser)?;
    }
    let calibration = gathered.finish(super::calibration::DISTANCE_UNIT_M)?;
    Ok(InStream { calibration, unit: unit(&stream) })
}

fn unit(stream: &[u8; STREAM_LEN]) -> Unit {
    let byte = |at: usize| stream.get(at).copied().unwrap_or_default();
    let tail = |at: usize| byte(UNIT_AT + at);
    let word = |at: usize| u16::from_le_bytes([tail(at), tail(at + 1)]);
    let four = |at: usize| [tail(at), tail(at + 1), tail(at + 2), tail(at + 3)];
    let calibrated = CivilTime {
        year: 2000 + i32::from(tail(0)),
        month: tail(1),
        day: tail(2),
        hour: tail(3),
        minute: tail(4),
        second: tail(5),
        nanosecond: 0,
    };
    Unit {
        noise_upper: byte(5),
        noise_lower: byte(6),
        calibrated: calibrated.to_unix().map(|_valid| calibrated),
        humidity_percent: tail(6),
        rpm: word(7).cast_signed(),
        view_from_cdeg: word(9),
        view_to_cdeg: word(11),
        hours: word(13),
        source_ip: four(15),
        destination_ip: four(19),
        return_mode: tail(23),
        warnings: tail(24),
        power: tail(25),
    }
}

/// What a place in the cycle of sixteen is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    Unknown,
    Own,
    Carrier,
}

/// Gathers the bytes out of the packets.
#[derive(Clone, Debug)]
pub struct Collector {
    bytes: Box<[Option<u8>; PACKETS]>,
    uses: [Use; KINDS],
    at: usize,
    filled: usize,
    warnings_seen: bool,
    /// Packets since the last attempt to read them.
    waited: usize,
    failure: Option<InStreamError>,
}

impl Default for Collector {
    fn default() -> Self {
        Self::new()
    }
}

impl Collector {
    /// A collector that has seen nothing.
    pub fn new() -> Self {
        Self {
            bytes: Box::new([None; PACKETS]),
            uses: [Use::Unknown; KINDS],
            at: 0,
            filled: 0,
            warnings_seen: false,
            waited: 0,
            failure: None,
        }
    }

    /// Bytes gathered, of [`STREAM_LEN`].
    pub fn filled(&self) -> usize {
        self.filled
    }

    /// Why the last complete set of bytes was no calibration.
    pub fn failure(&self) -> Option<&InStreamError> {
        self.failure.as_ref()
    }

    fn restart(&mut self) {
        let failure = self.failure.take();
        let warnings_seen = self.warnings_seen;
        self.bytes.fill(None);
        self.uses = [Use::Unknown; KINDS];
        (self.filled, self.waited) = (0, 0);
        (self.failure, self.warnings_seen) = (failure, warnings_seen);
    }

    /// Takes in the type and value of a packet `step` on from the one before; gives the calibration once it is there.
    /// A step that is not clear starts over.
    pub fn push(&mut self, step: Step, kind: u8, value: u8) -> Option<InStream> {
        match step {
            Step::First => {}
            Step::Packets(packets) => {
                self.at = (self.at + usize::from(packets)) % PACKETS;
                self.waited = self.waited.saturating_add(usize::from(packets));
            }
            Step::Unclear => self.restart(),
        }
        self.warnings_seen |= kind == b'W';
        let used = if Tail::OWN_KINDS.contains(&kind) { Use::Own } else { Use::Carrier };
        match self.uses.get_mut(self.at % KINDS) {
            Some(place) if *place == Use::Unknown => *place = used,
            Some(place) if *place == used => {}
            // The types are out of step with the count: a gap was counted wrong.
            _ => {
                self.restart();
                if let Some(place) = self.uses.get_mut(self.at % KINDS) {
                    *place = used;
                }
            }
        }
        if used == Use::Carrier
            && let Some(slot) = self.bytes.get_mut(self.at)
        {
            self.filled += usize::from(slot.is_none());
            *slot = Some(value);
        }
        // After a failure the whole cycle is heard once more before the next attempt.
        let due = self.filled == STREAM_LEN && (self.failure.is_none() || self.waited >= PACKETS);
        if due { self.read() } else { None }
    }

    fn read(&mut self) -> Option<InStream> {
        self.waited = 0;
        let mut bytes = [0; STREAM_LEN];
        for (byte, gathered) in bytes.iter_mut().zip(self.bytes.iter().flatten()) {
            *byte = *gathered;
        }
        match parse(&bytes, self.warnings_seen) {
            Ok(found) => {
                self.failure = None;
                Some(found)
            }
            Err(error) => {
                self.failure = Some(error);
                None
            }
        }
    }
}

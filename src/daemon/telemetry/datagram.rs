//! The datagram: one state of the target.

use thiserror::Error;

use super::layout::{Field, OnWire};

/// The first four bytes.
pub const MAGIC: [u8; 4] = *b"TMBL";
/// The layout's number: any change of it is a new one.
pub const VERSION: u16 = 1;
/// Bytes of a datagram.
pub const SIZE: usize = {
    let last = &Telemetry::FIELDS[Telemetry::FIELDS.len() - 1];
    last.offset + last.size()
};
/// Bytes that the checksum at the end is of.
const CHECKED: usize = SIZE - 4;

macro_rules! datagram {
    ($($name:ident: $type:ty, $meaning:literal;)*) => {
        /// A datagram's fields, as they lie in it. What is not known is NaN.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Telemetry {
            $(#[doc = $meaning] pub $name: $type,)*
        }

        impl Telemetry {
            /// The table of the fields, in their order.
            pub const FIELDS: &'static [Field] = &{
                let mut fields = [$(Field {
                    name: stringify!($name),
                    wire: <$type as OnWire>::WIRE,
                    count: <$type as OnWire>::COUNT,
                    offset: 0,
                    meaning: $meaning,
                }),*];
                let (mut number, mut offset) = (0, 0);
                while number < fields.len() {
                    fields[number].offset = offset;
                    offset += fields[number].size();
                    number += 1;
                }
                fields
            };

            fn put(&self, bytes: &mut Vec<u8>) {
                $(self.$name.put(bytes);)*
            }

            fn take(bytes: &mut &[u8]) -> Option<Self> {
                Some(Self { $($name: OnWire::take(bytes)?,)* })
            }
        }
    };
}

datagram! {
    magic: [u8; 4], "`TMBL`.";
    version: u16, "1. Any other: another layout.";
    size: u16, "Bytes of the datagram.";
    origin: u8, "Where the data come from: 1 live, 2 replay, 3 simulated. Take nothing but 1 for a measurement.";
    mode: u8, "0 no_target, 1 acquiring, 2 tracking, 3 predicted, 4 lost.";
    validity: u8, "0 invalid, 1 degraded, 2 ok. Do not use what is invalid.";
    kind: u8, "1 epoch: of a measurement; 2 predicted: to the time of sending.";
    sequence: u32, "Counts the datagrams of a session from 0, those that could not be sent too; it wraps.";
    session: [u8; 16], "The session: another one, and `t_ns` and `sequence` start anew.";
    t_ns: i64, "ns on the session's timeline: the time for which all this holds.";
    unix_ns: i64, "The same on the wall clock of the daemon's machine, ns since 1970-01-01 UTC.";
    epoch: u64, "The epoch that it is from; of a prediction the last one.";
    position_m: [f64; 3], "m, rig axes: the origin of the target frame.";
    rotation_xyzw: [f64; 4], "Quaternion of length 1: target axes to rig axes.";
    velocity_mps: [f64; 3], "m/s, rig axes: of the origin of the target frame.";
    angular_velocity_rps: [f64; 3], "rad/s, rig axes.";
    spin_axis: [f64; 3], "Of length 1, rig axes, right-handed. NaN: no spin that is more than noise.";
    spin_rate_rps: f64, "rad/s, above 0; NaN with `spin_axis`.";
    sigma: [f64; 12], "One standard deviation each: rotation about the target's x, y, z (rad), position along them (m), velocity (m/s) and angular velocity (rad/s) along the rig's.";
    reasons: u32, "Why it is not fully valid: a bit each, see the table.";
    crc32: u32, "CRC-32 (IEEE 802.3) of all bytes before it.";
}

/// The bits of `reasons`: name in the state stream, and meaning. The first is bit 0.
pub const REASONS: &[(&str, &str)] = &[
    ("no_points", "nothing stands in the region of interest"),
    ("few_points", "too few points belong to the target"),
    ("poor_fit", "the points lie badly on the model"),
    ("degenerate", "the points leave a direction open"),
    ("rejected", "the measurement is farther from the prediction than both explain"),
    ("settling", "the motion is not known yet"),
    ("one_sensor", "only one sensor has measured lately"),
    ("ambiguous", "several things, or several poses, explain what was seen"),
    ("stale", "nothing was measured for longer than the prediction is good for"),
    ("extrinsic", "the sensors disagree by more than their mountings' uncertainty"),
    ("manoeuvre", "the motion has just changed: something pushed the target, or its stage starts or stops"),
    ("learning", "the empty room is being learned: nothing is looked for"),
    ("unrecognised", "what is seen is not recognised as the target whose model is given"),
];
/// The bit of reasons that have no bit of their own.
pub const OTHER_REASON: u32 = 1 << 31;

/// The bits of reasons, by their names in the state stream.
pub fn reason_bits<'a>(names: impl IntoIterator<Item = &'a str>) -> u32 {
    let bit = |name: &str| REASONS.iter().position(|(known, _)| *known == name).map_or(OTHER_REASON, |bit| 1 << bit);
    names.into_iter().fold(0, |bits, name| bits | bit(name))
}

/// Why bytes are no datagram of this layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum TelemetryError {
    /// Another length.
    #[error("{found} bytes, and a datagram has {SIZE}")]
    Size {
        /// Bytes.
        found: usize,
    },
    /// Not ours.
    #[error("it begins with {found:02x?}, not with TMBL: another program sends to this port")]
    Magic {
        /// The first bytes.
        found: [u8; 4],
    },
    /// Another layout.
    #[error("layout {found}, and this reads layout {VERSION}: use the client that came with the daemon")]
    Version {
        /// Its number.
        found: u16,
    },
    /// Damaged.
    #[error("the checksum is {found:08x} and the bytes make {expected:08x}: it was damaged on the way")]
    Checksum {
        /// What it says.
        found: u32,
        /// What it should say.
        expected: u32,
    },
}

impl Telemetry {
    /// Of a time, and nothing known: no target, invalid, all else NaN. Origin, session and sequence are the sender's.
    pub fn nothing_known(t_ns: i64, unix_ns: i64) -> Self {
        let unknown = f64::NAN;
        Self {
            magic: MAGIC,
            version: VERSION,
            size: SIZE as u16,
            origin: 0,
            mode: 0,
            validity: 0,
            kind: 0,
            sequence: 0,
            session: [0; 16],
            t_ns,
            unix_ns,
            epoch: 0,
            position_m: [unknown; 3],
            rotation_xyzw: [unknown; 4],
            velocity_mps: [unknown; 3],
            angular_velocity_rps: [unknown; 3],
            spin_axis: [unknown; 3],
            spin_rate_rps: unknown,
            sigma: [unknown; 12],
            reasons: 0,
            crc32: 0,
        }
    }

    /// Writes the datagram; magic, version, size and checksum are always right.
    pub fn encode(&self, bytes: &mut Vec<u8>) {
        bytes.clear();
        Self { magic: MAGIC, version: VERSION, size: SIZE as u16, ..*self }.put(bytes);
        bytes.truncate(CHECKED);
        let crc = crc32fast::hash(bytes);
        bytes.extend_from_slice(&crc.to_le_bytes());
    }

    /// Reads a datagram.
    ///
    /// # Errors
    /// [`TelemetryError`]: it is not ours, of another layout, or damaged.
    pub fn decode(bytes: &[u8]) -> Result<Self, TelemetryError> {
        let found = bytes.len();
        let mut rest = bytes;
        let telemetry = Self::take(&mut rest).ok_or(TelemetryError::Size { found });
        // Whose and which layout it is says more than its length.
        if let Some((magic, rest)) = bytes.split_first_chunk::<4>() {
            if *magic != MAGIC {
                return Err(TelemetryError::Magic { found: *magic });
            }
            match rest.first_chunk().map(|version| u16::from_le_bytes(*version)) {
                Some(version) if version != VERSION => return Err(TelemetryError::Version { found: version }),
                _ => {}
            }
        }
        let telemetry = telemetry?;
        if !rest.is_empty() || usize::from(telemetry.size) != SIZE {
            return Err(TelemetryError::Size { found });
        }
        let expected = crc32fast::hash(bytes.get(..CHECKED).unwrap_or_default());
        if telemetry.crc32 != expected {
            return Err(TelemetryError::Checksum { found: telemetry.crc32, expected });
        }
        Ok(telemetry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn some() -> Telemetry {
        Telemetry {
            origin: 1,
            mode: 2,
            validity: 2,
            kind: 1,
            sequence: 7,
            session: *b"0123456789abcdef",
            position_m: [2.5, -0.25, 0.125],
            rotation_xyzw: [0.5, 0.5, -0.5, 0.5],
            velocity_mps: [0.0, 0.01, -0.02],
            angular_velocity_rps: [0.0, 0.0, 0.35],
            spin_axis: [0.0, 0.0, 1.0],
            spin_rate_rps: 0.35,
            sigma: core::array::from_fn(|n| 0.001 * n as f64),
            reasons: reason_bits(["one_sensor"]),
            ..Telemetry::nothing_known(-1, 1_700_000_000_000_000_000)
        }
    }

    fn encoded(telemetry: &Telemetry) -> Vec<u8> {
        let mut bytes = Vec::new();
        telemetry.encode(&mut bytes);
        bytes
    }

    #[test]
    fn fields_lie_where_c_puts_them() {
        // 4 + 2·2 + 4·1 + 4 + 16 = 32; 3 · 8 = 56; 3 + 4 + 3 + 3 + 3 + 1 + 12 = 29 doubles = 288; 2 · 4 = 296.
        let offset = |name: &str| Telemetry::FIELDS.iter().find(|field| field.name == name).map(|field| field.offset);
        let offsets = ["t_ns", "position_m", "sigma", "reasons", "crc32"].map(offset);
        assert_eq!(offsets, [32, 56, 192, 288, 292].map(Some));
        assert_eq!((SIZE, encoded(&some()).len()), (296, 296));
        // A C compiler leaves no gap.
        assert!(Telemetry::FIELDS.iter().all(|field| field.offset % field.wire.size() == 0) && SIZE.is_multiple_of(8));
    }

    #[test]
    fn what_is_written_is_read() {
        let bytes = encoded(&some());
        let read = Telemetry::decode(&bytes).expect("a datagram");
        let crc32 = u32::from_le_bytes(bytes[292..].try_into().expect("four bytes"));
        assert_eq!(read, Telemetry { crc32, ..some() });
        assert_eq!(&bytes[..8], b"TMBL\x01\x00\x28\x01");
        assert_eq!(read.reasons, 1 << 6);
        // The t_ns −1 is all ones.
        assert_eq!(bytes[32..40], [0xff; 8]);
    }

    #[test]
    fn a_reason_without_a_bit_is_not_lost() {
        assert_eq!(reason_bits(["no_points", "of_tomorrow"]), 1 | OTHER_REASON);
        assert_eq!(reason_bits([]), 0);
    }

    #[test]
    fn what_is_not_ours_is_told_apart() {
        let bytes = encoded(&some());
        let with = |at: usize, byte: u8| {
            let mut bytes = bytes.clone();
            bytes[at] = byte;
            Telemetry::decode(&bytes)
        };
        assert_eq!(with(0, b'X'), Err(TelemetryError::Magic { found: *b"XMBL" }));
        assert_eq!(with(4, 2), Err(TelemetryError::Version { found: 2 }));
        assert_eq!(Telemetry::decode(&bytes[..295]), Err(TelemetryError::Size { found: 295 }));
        assert_eq!(Telemetry::decode(&[&bytes[..], &[0]].concat()), Err(TelemetryError::Size { found: 297 }));
        assert_eq!(Telemetry::decode(&[]), Err(TelemetryError::Size { found: 0 }));
    }

    proptest! {
        #[test]
        fn a_flipped_bit_is_noticed(bit in 0..SIZE * 8) {
            let mut bytes = encoded(&some());
            bytes[bit / 8] ^= 1 << (bit % 8);
            prop_assert!(Telemetry::decode(&bytes).is_err());
        }

        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
            prop_assert!(Telemetry::decode(&bytes).is_err());
        }
    }
}

//! The data packet as it lies on the wire: 1 206 bytes of UDP payload, little-endian.
//!
//! | offset | size | field |
//! |---|---|---|
//! | 100·b, b = 0..12 | 2 | block flag: 0xEEFF, or 0xDDFF for the lower bank of an HDL-64E |
//! | 100·b + 2 | 2 | azimuth, 0.01°, 0..36000 |
//! | 100·b + 4 + 3·c, c = 0..32 | 3 | distance u16 (0 = no return), reflectivity u8 |
//! | 1200 | 4 | time stamp, µs past the hour, of the first firing of block 0 |
//! | 1204 | 1 | return mode (HDL-64E: status type) |
//! | 1205 | 1 | product id (HDL-64E: status value) |
//!
//! Source: VLP-16 manual 63-9243 and VLP-32C manual 63-9325, chapter 9.

use tumbled_model::LidarTime;

/// Bytes of a data packet's UDP payload: 12 × 100 + 6.
pub const DATA_LEN: usize = BLOCKS * BLOCK_LEN + 6;
/// Bytes of a position packet's UDP payload.
pub const POSITION_LEN: usize = 512;
/// Data blocks in a packet.
pub const BLOCKS: usize = 12;
/// Bytes of a block: flag, azimuth, 32 slots of 3.
pub const BLOCK_LEN: usize = 4 + SLOTS * SLOT_LEN;
/// Channel slots in a block.
pub const SLOTS: usize = 32;
/// Bytes of a slot: distance u16, reflectivity u8.
pub const SLOT_LEN: usize = 3;
/// One turn in the unit of the azimuth field.
pub const TURN_CDEG: u16 = 36_000;

/// Block flag of every sensor but the lower half of an HDL-64E (bytes FF EE).
pub const FLAG_UPPER: u16 = 0xEEFF;
/// Block flag of an HDL-64E's lower lasers 32..64 (bytes FF DD); a VLS-128 uses it too.
pub const FLAG_LOWER: u16 = 0xDDFF;

/// Why a payload is not a packet of a sensor we know.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
#[non_exhaustive]
pub enum WireError {
    /// Neither a data nor a position packet by its length.
    #[error("a data packet has {DATA_LEN} bytes, this payload has {got}")]
    Length {
        /// Bytes found.
        got: usize,
    },
    /// A block starts with something that is not a block flag.
    #[error("block {block} starts with flag {found:#06x}; {FLAG_UPPER:#06x} or {FLAG_LOWER:#06x} expected")]
    Flag {
        /// The block, 0..12.
        block: u8,
        /// The flag found.
        found: u16,
    },
    /// An azimuth beyond one turn.
    #[error("block {block} has azimuth {found}; 0.01° below {TURN_CDEG} expected")]
    Azimuth {
        /// The block, 0..12.
        block: u8,
        /// The azimuth found, 0.01°.
        found: u16,
    },
    /// A position packet whose sentence has bytes that no text has: it is somebody else's payload.
    #[error("byte {offset:#05x} of a position packet is {found:#04x}; text, CR, LF or padding with 0 expected")]
    Sentence {
        /// Where, bytes from the payload's start.
        offset: u16,
        /// The byte found.
        found: u8,
    },
}

/// Which half of the lasers a block belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bank {
    /// Lasers 0..32 (all sensors).
    Upper,
    /// Lasers 32..64 (HDL-64E).
    Lower,
}

/// A payload of the right length, looked at as blocks. Borrowed; nothing is copied.
#[derive(Clone, Copy, Debug)]
pub struct DataPacket<'a> {
    blocks: &'a [[u8; BLOCK_LEN]; BLOCKS],
    tail: &'a [u8; 6],
}

impl<'a> DataPacket<'a> {
    /// Checks the length only; the blocks are checked when they are read.
    ///
    /// # Errors
    /// [`WireError::Length`].
    pub fn new(payload: &'a [u8]) -> Result<Self, WireError> {
        let wrong = WireError::Length { got: payload.len() };
        let payload: &[u8; DATA_LEN] = payload.try_into().map_err(|_length| wrong)?;
        let (blocks, rest) = payload.as_chunks::<BLOCK_LEN>();
        match (blocks.try_into(), rest.try_into()) {
            (Ok(blocks), Ok(tail)) => Ok(Self { blocks, tail }),
            _ => Err(wrong),
        }
    }

    /// The twelve blocks in packet order.
    pub fn blocks(&self) -> impl ExactSizeIterator<Item = Block<'a>> + use<'a> {
        self.blocks.iter().map(Block)
    }

    /// The flags of the twelve blocks.
    pub fn flags(&self) -> [u16; BLOCKS] {
        self.blocks.each_ref().map(|bytes| Block(bytes).flag())
    }

    /// The azimuths of the twelve blocks, 0.01°.
    ///
    /// # Errors
    /// [`WireError::Flag`] or [`WireError::Azimuth`] for the first block that is none.
    pub fn azimuths(&self) -> Result<[u16; BLOCKS], WireError> {
        for (index, block) in (0u8..).zip(self.blocks()) {
            if block.bank().is_none() {
                return Err(WireError::Flag { block: index, found: block.flag() });
            }
            if block.azimuth_cdeg() >= TURN_CDEG {
                return Err(WireError::Azimuth { block: index, found: block.azimuth_cdeg() });
            }
        }
        Ok(self.blocks.each_ref().map(|bytes| Block(bytes).azimuth_cdeg()))
    }

    /// The packet's time stamp: µs past the hour (meaningless for an HDL-64E S1).
    pub fn stamp(&self) -> LidarTime {
        let [a, b, c, d, _, _] = *self.tail;
        LidarTime(u32::from_le_bytes([a, b, c, d]))
    }

    /// Byte 1204: return mode, or on an HDL-64E the status type.
    pub fn mode_byte(&self) -> u8 {
        self.tail[4]
    }

    /// Byte 1205: product id, or on an HDL-64E the status value.
    pub fn product_byte(&self) -> u8 {
        self.tail[5]
    }

    /// The six bytes behind the blocks.
    pub fn tail(&self) -> &'a [u8; 6] {
        self.tail
    }
}

/// One data block: a flag, an azimuth and 32 slots.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a>(&'a [u8; BLOCK_LEN]);

impl Block<'_> {
    /// The flag, read as a little-endian u16.
    pub fn flag(&self) -> u16 {
        u16::from_le_bytes([self.0[0], self.0[1]])
    }

    /// The bank the flag names, `None` for a flag that is none.
    pub fn bank(&self) -> Option<Bank> {
        match self.flag() {
            FLAG_UPPER => Some(Bank::Upper),
            FLAG_LOWER => Some(Bank::Lower),
            _ => None,
        }
    }

    /// The encoder's angle at the first firing of the block, 0.01°. Not range-checked.
    pub fn azimuth_cdeg(&self) -> u16 {
        u16::from_le_bytes([self.0[2], self.0[3]])
    }

    /// Raw distances (0 = no return) and reflectivities of the 32 slots.
    #[inline]
    pub fn slots(&self) -> ([u16; SLOTS], [u8; SLOTS]) {
        let mut raw = [0; SLOTS];
        let mut intensity = [0; SLOTS];
        let (_, body) = self.0.split_at(4);
        let (slots, _) = body.as_chunks::<SLOT_LEN>();
        for ((slot, r), i) in slots.iter().zip(&mut raw).zip(&mut intensity) {
            *r = u16::from_le_bytes([slot[0], slot[1]]);
            *i = slot[2];
        }
        (raw, intensity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_agree_with_each_other() {
        assert_eq!((BLOCK_LEN, DATA_LEN), (100, 1206));
    }

    #[test]
    fn fields_are_where_the_manual_puts_them() {
        let mut bytes = [0u8; DATA_LEN];
        for b in 0..BLOCKS {
            bytes[100 * b] = 0xFF;
            bytes[100 * b + 1] = 0xEE;
            bytes[100 * b + 2..100 * b + 4].copy_from_slice(&(b as u16 * 20).to_le_bytes());
        }
        // Block 3, slot 31: distance 0x1234, reflectivity 7.
        bytes[304 + 93..304 + 96].copy_from_slice(&[0x34, 0x12, 7]);
        bytes[1200..1206].copy_from_slice(&[0x78, 0x56, 0x34, 0x12, 0x37, 0x28]);
        let packet = DataPacket::new(&bytes).expect("1206 bytes");
        assert_eq!(packet.stamp(), LidarTime(0x1234_5678));
        assert_eq!((packet.mode_byte(), packet.product_byte()), (0x37, 0x28));
        assert_eq!(packet.azimuths().expect("valid")[3], 60);
        let (raw, intensity) = packet.blocks().nth(3).expect("12 blocks").slots();
        assert_eq!((raw[31], intensity[31]), (0x1234, 7));
        assert!(raw[..31].iter().all(|&r| r == 0));
    }

    #[test]
    fn foreign_payloads_are_named_by_what_is_wrong() {
        assert_eq!(DataPacket::new(&[0; 512]).err(), Some(WireError::Length { got: 512 }));
        let mut bytes = [0u8; DATA_LEN];
        let flag = |bytes: &[u8]| DataPacket::new(bytes).expect("1206 bytes").azimuths();
        assert_eq!(flag(&bytes), Err(WireError::Flag { block: 0, found: 0 }));
        for b in 0..BLOCKS {
            bytes[100 * b..100 * b + 2].copy_from_slice(&FLAG_UPPER.to_le_bytes());
        }
        bytes[1102..1104].copy_from_slice(&36_000u16.to_le_bytes());
        assert_eq!(flag(&bytes), Err(WireError::Azimuth { block: 11, found: 36_000 }));
    }
}

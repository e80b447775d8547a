//! Packets of an HDL-64E, written: for tests and for the simulator.
//!
//! A simulator casts [`super::Beams::ray`] of each laser at the head's azimuth at [`Generation::firing_ns`], and writes
//! [`super::Beams::raw`] of the distance it met.

use super::calibration::Calibration;
use super::in_stream::{
    CARRIERS, FIELDS, GROUP, GROUPS_AT, KINDS, PACKETS, START, STREAM_LEN, UNIT_AT, Unit, stream_crc,
};
use super::status::Tail;
use super::timing::Generation;
use crate::wire::{BLOCK_LEN, BLOCKS, Bank, DATA_LEN, FLAG_LOWER, FLAG_UPPER, SLOT_LEN, SLOTS};
use tumbled_model::{CivilTime, LidarTime};

/// What a channel slot holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slot {
    /// Distance, counts of 2 mm; 0 = no return.
    pub raw: u16,
    /// Intensity as measured.
    pub intensity: u8,
}

/// The slots of a packet by block and laser within the bank.
pub type Slots = [[Slot; SLOTS]; BLOCKS];

/// What the status bytes say besides the calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Said {
    /// Time and date of the sensor's clock; years 2000..=2255.
    pub time: CivilTime,
    /// GPS status byte.
    pub gps: u8,
    /// °C.
    pub temperature_c: u8,
    /// Firmware number (S2, S3).
    pub firmware: u8,
    /// Warning bits (S3).
    pub warnings: u8,
}

/// Writes the packets of one sensor, its status running along.
#[derive(Clone, Debug)]
pub struct Hdl64Encoder {
    generation: Generation,
    stream: Box<[u8; STREAM_LEN]>,
    packets: usize,
}

impl Hdl64Encoder {
    /// An encoder at the start of the status cycle.
    pub fn new(generation: Generation, calibration: &Calibration, unit: &Unit) -> Self {
        Self { generation, stream: Box::new(stream(generation, calibration, unit)), packets: 0 }
    }

    /// Passes over packets without writing them: the status goes on, as when packets are lost.
    pub fn skip(&mut self, packets: usize) {
        self.packets = self.packets.wrapping_add(packets);
    }

    /// The next packet. Azimuths in 0.01° below 36 000, one per block: S2 and S3 expect them equal in pairs, in dual
    /// return in fours. An S1 has no clock: `stamp` goes nowhere.
    pub fn encode(
        &mut self,
        stamp: LidarTime,
        azimuths_cdeg: &[u16; BLOCKS],
        slots: &Slots,
        said: &Said,
    ) -> [u8; DATA_LEN] {
        let mut packet = [0; DATA_LEN];
        let (blocks, tail) = packet.split_at_mut(BLOCKS * BLOCK_LEN);
        let (blocks, _) = blocks.as_chunks_mut::<BLOCK_LEN>();
        for (((bytes, bank), azimuth), slots) in
            blocks.iter_mut().zip(self.generation.banks()).zip(azimuths_cdeg).zip(slots)
        {
            let flag = match bank {
                Bank::Upper => FLAG_UPPER,
                Bank::Lower => FLAG_LOWER,
            };
            let (head, body) = bytes.split_at_mut(4);
            let [f, g] = flag.to_le_bytes();
            let [a, b] = azimuth.to_le_bytes();
            head.copy_from_slice(&[f, g, a, b]);
            for (bytes, slot) in body.as_chunks_mut::<SLOT_LEN>().0.iter_mut().zip(slots) {
                let [low, high] = slot.raw.to_le_bytes();
                *bytes = [low, high, slot.intensity];
            }
        }
        tail.copy_from_slice(&self.tail(stamp, said));
        self.packets = self.packets.wrapping_add(1);
        packet
    }

    fn tail(&self, stamp: LidarTime, said: &Said) -> [u8; 6] {
        if self.generation == Generation::S1 {
            // The temperature's fraction is 0.
            return if self.packets.is_multiple_of(2) {
                [0, said.temperature_c, b'D', b'e', b'g', b'C']
            } else {
                *b"\0\0v25c"
            };
        }
        let [a, b, c, d] = stamp.0.to_le_bytes();
        let (kind, value) = self.status(said);
        [a, b, c, d, kind, value]
    }

    fn status(&self, said: &Said) -> (u8, u8) {
        let place = self.packets % PACKETS;
        let (cycle, within) = (place / KINDS, place % KINDS);
        let Some(&kind) = Tail::OWN_KINDS.get(within) else {
            let carrier = within - Tail::OWN_KINDS.len();
            return self.carried(cycle * CARRIERS + carrier, carrier, said);
        };
        let value = match kind {
            b'H' => said.time.hour,
            b'M' => said.time.minute,
            b'S' => said.time.second,
            b'D' => said.time.day,
            b'N' => said.time.month,
            b'Y' => (said.time.year - 2000).clamp(0, 255) as u8,
            b'G' => said.gps,
            b'T' => said.temperature_c,
            _ => said.firmware,
        };
        (kind, value)
    }

    /// Byte `at` of the calibration. The seven types are digits here; an S3's W takes the place of one in the unused end
    /// of each laser's group. (Decoders do not depend on which.)
    fn carried(&self, at: usize, carrier: usize, said: &Said) -> (u8, u8) {
        let spare = (GROUPS_AT..UNIT_AT).contains(&at) && (at - GROUPS_AT) % GROUP == GROUP - 1;
        if self.generation == Generation::S3 && spare {
            return (b'W', said.warnings);
        }
        (b'1' + carrier as u8, self.stream.get(at).copied().unwrap_or_default())
    }
}

/// The calibration as 1 820 bytes, rounded to the stream's units (0.01°, 1 mm, slope 0.1), from `UNIT#` on.
pub fn stream(generation: Generation, calibration: &Calibration, unit: &Unit) -> [u8; STREAM_LEN] {
    let mut bytes = Vec::with_capacity(STREAM_LEN);
    bytes.extend_from_slice(START);
    bytes.extend_from_slice(&[unit.noise_upper, unit.noise_lower]);
    for (id, laser) in (0u8..).zip(calibration.lasers()) {
        bytes.push(id);
        for (field, to_si) in FIELDS {
            let count = libm::round(field.get(laser) / to_si);
            bytes.extend_from_slice(&(count as i16).to_le_bytes());
        }
        bytes.extend_from_slice(&[laser.min_intensity, laser.max_intensity, 0, 0, 0, 0, 0, 0, 0]);
    }
    bytes.truncate(UNIT_AT);
    let calibrated = unit
        .calibrated
        .map_or([0xFF; 6], |t| [(t.year - 2000).clamp(0, 255) as u8, t.month, t.day, t.hour, t.minute, t.second]);
    bytes.extend_from_slice(&calibrated);
    bytes.push(unit.humidity_percent);
    bytes.extend_from_slice(&unit.rpm.to_le_bytes());
    for word in [unit.view_from_cdeg, unit.view_to_cdeg, unit.hours] {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    bytes.extend_from_slice(&unit.source_ip);
    bytes.extend_from_slice(&unit.destination_ip);
    bytes.extend_from_slice(&[unit.return_mode, unit.warnings, unit.power]);
    let mut stream = [0; STREAM_LEN];
    for (byte, value) in stream.iter_mut().zip(bytes) {
        *byte = value;
    }
    let end = if generation == Generation::S3 { stream_crc(&stream) } else { STREAM_LEN as u16 };
    let [.., low, high] = &mut stream;
    [*low, *high] = end.to_le_bytes();
    stream
}

//! Packets from values: what the simulator sends and the tests decode.
//!
//! Block by block, as a sensor fills a packet; nothing is interpolated or guessed here. HDL-64E packets are made by
//! [`crate::hdl64`].

use crate::models::{Model, Product, ReturnMode};
use crate::position::Pps;
use crate::wire::{BLOCK_LEN, BLOCKS, DATA_LEN, FLAG_UPPER, POSITION_LEN, SLOT_LEN, SLOTS, TURN_CDEG};
use tumbled_model::LidarTime;

/// The content of one slot: raw distance counts (0 = no return) and reflectivity.
pub type Slot = (u16, u8);

/// A data packet being filled.
#[derive(Clone, Debug)]
pub struct DataPacketBuilder {
    bytes: [u8; DATA_LEN],
}

impl DataPacketBuilder {
    /// An empty packet of a model with built-in geometry: flags, return mode and product byte are set, all azimuths
    /// and slots are 0. An HDL-64E has no product byte and gets 0.
    pub fn new(model: Model, mode: ReturnMode) -> Self {
        let mut builder = Self { bytes: [0; DATA_LEN] };
        for block in 0..BLOCKS {
            builder.put(block * BLOCK_LEN, &FLAG_UPPER.to_le_bytes());
        }
        builder.put(DATA_LEN - 2, &[mode.byte(), Product::byte(model).unwrap_or(0)]);
        builder
    }

    /// Sets a block's azimuth (0.01°, taken modulo one turn) and its 32 slots. Blocks past the twelfth are ignored.
    pub fn block(&mut self, block: usize, azimuth_cdeg: u16, slots: &[Slot; SLOTS]) -> &mut Self {
        if block < BLOCKS {
            let start = block * BLOCK_LEN;
            self.put(start + 2, &(azimuth_cdeg % TURN_CDEG).to_le_bytes());
            for (slot, (raw, intensity)) in slots.iter().enumerate() {
                let [low, high] = raw.to_le_bytes();
                self.put(start + 4 + slot * SLOT_LEN, &[low, high, *intensity]);
            }
        }
        self
    }

    /// Sets the stamp: µs past the hour of the first firing.
    pub fn stamp(&mut self, stamp: LidarTime) -> &mut Self {
        self.put(DATA_LEN - 6, &stamp.0.to_le_bytes());
        self
    }

    /// Overwrites the return mode and product bytes, e.g. to claim another product.
    pub fn factory_bytes(&mut self, mode: u8, product: u8) -> &mut Self {
        self.put(DATA_LEN - 2, &[mode, product]);
        self
    }

    /// The payload.
    pub fn build(&self) -> [u8; DATA_LEN] {
        self.bytes
    }

    fn put(&mut self, at: usize, value: &[u8]) {
        if let Some(place) = self.bytes.get_mut(at..at + value.len()) {
            place.copy_from_slice(value);
        }
    }
}

/// Distance in metres to raw counts of a model: rounded; 0 (no return) when it is not positive or beyond the field.
pub fn raw_distance(range_m: f64, distance_lsb_m: f64) -> u16 {
    let counts = libm::round(range_m / distance_lsb_m);
    if (1.0..=f64::from(u16::MAX)).contains(&counts) { counts as u16 } else { 0 }
}

/// A position packet with the given stamp, pulse state and NMEA sentence (cut at 128 bytes; give it with its CR LF).
pub fn position_packet(stamp: LidarTime, pps: Pps, sentence: &str) -> [u8; POSITION_LEN] {
    let mut bytes = [0; POSITION_LEN];
    let mut put = |at: usize, value: &[u8]| {
        if let Some(place) = bytes.get_mut(at..at + value.len()) {
            place.copy_from_slice(value);
        }
    };
    put(0xC6, &stamp.0.to_le_bytes());
    put(0xCA, &[pps.byte()]);
    let sentence = sentence.as_bytes();
    put(0xCE, sentence.get(..sentence.len().min(128)).unwrap_or_default());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::position::PositionPacket;
    use crate::wire::DataPacket;
    use proptest::prelude::*;
    use tumbled_model::nmea;

    #[test]
    fn distances_round_to_the_nearest_count() {
        // 2.5 counts of 4 mm round away from zero to 3; 262.14 m is the last count.
        assert_eq!(raw_distance(0.010, 0.004), 3);
        assert_eq!(raw_distance(262.140, 0.004), 65_535);
        assert_eq!((raw_distance(262.143, 0.004), raw_distance(-1.0, 0.004), raw_distance(f64::NAN, 0.004)), (0, 0, 0));
    }

    #[test]
    fn position_packets_come_back() {
        let sentence = nmea::format_rmc(tumbled_model::UnixNs(1_795_321_341_000_000_000), true);
        let packet =
            PositionPacket::parse(&position_packet(LidarTime(77), Pps::Synchronising, &sentence)).expect("512");
        assert_eq!((packet.stamp, packet.pps), (LidarTime(77), Pps::Synchronising));
        assert_eq!(packet.rmc.expect("own checksum").utc.0, 1_795_321_341_000_000_000);
    }

    proptest! {
        #[test]
        fn what_is_put_in_is_read_back(
            azimuth in prop::array::uniform12(0u16..36_000),
            raw in prop::collection::vec(any::<u16>(), 384),
            stamp in any::<u32>(),
        ) {
            let mut builder = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Last);
            builder.stamp(LidarTime(stamp));
            for (block, (azimuth, raw)) in azimuth.iter().zip(raw.chunks(32)).enumerate() {
                builder.block(block, *azimuth, &core::array::from_fn(|slot| (raw[slot], raw[slot] as u8)));
            }
            let bytes = builder.build();
            let packet = DataPacket::new(&bytes).expect("1206 bytes");
            prop_assert_eq!(packet.stamp(), LidarTime(stamp));
            prop_assert_eq!((packet.mode_byte(), packet.product_byte()), (0x38, 0x28));
            prop_assert_eq!(packet.azimuths().expect("flags are set"), azimuth);
            let read: Vec<u16> = packet.blocks().flat_map(|b| b.slots().0).collect();
            prop_assert_eq!(&read, &raw);
        }
    }
}

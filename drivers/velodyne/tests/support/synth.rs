//! A sensor made of the encoder: a head that turns evenly, with or without a limited field of view, in a room whose
//! distance is any function of laser and head azimuth.

use tumbled_model::LidarTime;
use tumbled_velodyne::beams::BeamTable;
use tumbled_velodyne::encode::DataPacketBuilder;
use tumbled_velodyne::{Model, ReturnMode};

/// One packet of the synthetic sensor, and the truth about it.
#[derive(Clone, Debug)]
pub(crate) struct Packet {
    pub(crate) bytes: [u8; 1206],
    /// Device time of its first firing, ns since the start (not wrapped).
    pub(crate) t_ns: i64,
    /// Device time of each firing group, ns since the start.
    pub(crate) group_t_ns: Vec<i64>,
    pub(crate) has_jump: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Sensor {
    pub(crate) model: Model,
    pub(crate) mode: ReturnMode,
    pub(crate) rpm: f64,
    /// Head azimuth at the start, degrees.
    pub(crate) start_deg: f64,
    /// Silent sector, degrees clockwise from the first to the second.
    pub(crate) silent_deg: Option<(f64, f64)>,
    /// Stamp at the start, µs past the hour.
    pub(crate) start_us: u32,
}

impl Sensor {
    pub(crate) fn new(model: Model, mode: ReturnMode) -> Self {
        Self { model, mode, rpm: 600.0, start_deg: 0.0, silent_deg: None, start_us: 1_000_000 }
    }

    pub(crate) fn packets(&self, n: usize, raw: impl Fn(usize, i64) -> (u16, u16)) -> Vec<Packet> {
        let beams = BeamTable::new(self.model.spec().expect("built-in model"), false);
        let blocks_per_group = self.mode.blocks_per_firing();
        let cycle_ns = i64::from(beams.block_ns());
        let deg_per_ns = self.rpm * 360.0 / 60e9;
        let mut packets = Vec::new();
        let mut t_ns = 0;
        while packets.len() < n {
            let mut builder = DataPacketBuilder::new(self.model, self.mode);
            let mut group_t_ns = Vec::new();
            while group_t_ns.len() < 12 / blocks_per_group {
                let azimuth = (self.start_deg + deg_per_ns * t_ns as f64).rem_euclid(360.0);
                let silent = self
                    .silent_deg
                    .is_some_and(|(from, to)| (azimuth - from).rem_euclid(360.0) < (to - from).rem_euclid(360.0));
                if !silent {
                    let block = group_t_ns.len() * blocks_per_group;
                    let cdeg = ((azimuth * 100.0).round() as u32 % 36_000) as u16;
                    let pair: [(u16, u16); 32] = core::array::from_fn(|slot| raw(slot, t_ns));
                    builder.block(block, cdeg, &pair.map(|(first, _)| (first, first as u8)));
                    if blocks_per_group == 2 {
                        builder.block(block + 1, cdeg, &pair.map(|(_, second)| (second, second as u8)));
                    }
                    group_t_ns.push(t_ns);
                }
                t_ns += cycle_ns;
            }
            let has_jump = group_t_ns.windows(2).any(|pair| pair[1] - pair[0] > cycle_ns);
            let first = group_t_ns[0];
            builder.stamp(self.stamp(first));
            packets.push(Packet { bytes: builder.build(), t_ns: first, group_t_ns, has_jump });
        }
        packets
    }

    /// The stamp of a device time: whole µs, wrapping at the hour.
    pub(crate) fn stamp(&self, t_ns: i64) -> LidarTime {
        let us = i64::from(self.start_us) + (t_ns + 500) / 1_000;
        LidarTime((us % 3_600_000_000) as u32)
    }
}

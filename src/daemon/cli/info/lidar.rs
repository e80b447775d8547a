//! One LiDAR's packets, watched from the first to the last.

use std::collections::BTreeMap;

use tumbled_model::{LidarTime, RigNs, Span, nmea::NmeaError};
use tumbled_velodyne::beams::BeamTable;
use tumbled_velodyne::detect::claimed_product;
use tumbled_velodyne::position::PositionPacket;
use tumbled_velodyne::stream::{Decoded, PacketInfo, StampReference, StreamDecoder};
use tumbled_velodyne::track::Order;
use tumbled_velodyne::wire::{BLOCKS, SLOTS};
use tumbled_velodyne::{DataPacket, Model, Points, Product, Return, ReturnMode};

use super::histogram::Histogram;
use super::report::lidar::{Returns, Sentences};
use super::timeline::Timeline;
use crate::cli::Failure;
use crate::config::LidarConfig;
use crate::decoding;
use crate::decoding::turning::HeadTurning;

/// Ranges are counted in centimetres.
const BINS_PER_M: f32 = 100.0;

/// A sensor without a clock: packets this close by the host's stamps have less than a turn between them, up to 1 200 rpm
/// (50 ms a turn).
const UNSTAMPED_STEP_NS: i64 = 25_000_000;

/// Follows one LiDAR through the inputs.
pub(super) struct LidarWatch {
    pub(super) id: String,
    /// The model the config names.
    pub(super) forced: Option<Model>,
    /// A calibration file was read.
    pub(super) has_calibration_file: bool,
    pub(super) decoder: StreamDecoder,
    /// What the packets say they are from.
    pub(super) claims: BTreeMap<Product, u64>,
    /// Host times of the first and the newest payload with 1 206 bytes, and how many.
    pub(super) host: Option<(RigNs, RigNs, u64)>,
    pub(super) timeline: Timeline,
    pub(super) head: HeadTurning,
    pub(super) ranges: Histogram,
    pub(super) returns: Returns,
    /// Laser shots of the decoded packets, and those with any return.
    pub(super) shots: (u64, u64),
    pub(super) sentences: Sentences,
    pub(super) thermal_shutdowns: u64,
    stamp_reference: StampReference,
    decoded: Decoded,
}

impl LidarWatch {
    /// Nothing seen yet.
    pub(super) fn new(lidar: &LidarConfig) -> Result<Self, Failure> {
        let settings = decoding::lidar::settings(lidar)?;
        Ok(Self {
            id: lidar.id.to_string(),
            forced: settings.model,
            has_calibration_file: settings.hdl64e_calibration.is_some(),
            stamp_reference: settings.hdl32e_stamp,
            decoder: StreamDecoder::new(settings),
            claims: BTreeMap::new(),
            host: None,
            timeline: Timeline::default(),
            head: HeadTurning::default(),
            ranges: Histogram::new(BINS_PER_M),
            returns: Returns::default(),
            shots: (0, 0),
            sentences: Sentences::default(),
            thermal_shutdowns: 0,
            decoded: Decoded::default(),
        })
    }

    /// Whether the inputs held anything for it.
    pub(super) fn seen(&self) -> bool {
        let counts = self.decoder.counts();
        counts.data_packets + counts.position_packets + counts.refused() > 0
    }

    /// Takes one payload.
    pub(super) fn payload(&mut self, payload: &[u8], arrived: RigNs) {
        if let Ok(packet) = DataPacket::new(payload) {
            self.data_payload(&packet, arrived);
        }
        self.decoder.push(payload, arrived, &mut self.decoded);
        self.take_decoded(arrived);
    }

    /// The inputs have ended.
    pub(super) fn finish(&mut self) {
        self.decoder.finish(&mut self.decoded);
        let newest = self.host.map_or(RigNs(0), |(_, newest, _)| newest);
        self.take_decoded(newest);
    }

    /// From a packet's stamp to its first firing, ns: not 0 where the config says that the stamp marks the last one.
    pub(super) fn first_firing(&self) -> Span {
        let spec = self.decoder.model().filter(|model| *model == Model::Hdl32e).and_then(Model::spec);
        match (spec, self.stamp_reference) {
            (Some(spec), StampReference::LastFiring) => {
                let dual = self.decoder.counts().modes.contains_key(&ReturnMode::Dual);
                let groups = BLOCKS / if dual { 2 } else { 1 };
                Span(-i64::from(BeamTable::new(spec, false).last_firing_ns(groups)))
            }
            _ => Span(0),
        }
    }

    fn data_payload(&mut self, packet: &DataPacket<'_>, arrived: RigNs) {
        let (first, count) = self.host.map_or((arrived, 0), |(first, _, count)| (first, count));
        self.host = Some((first, arrived, count + 1));
        // A payload of the right length that is none says nothing.
        if packet.azimuths().is_ok() {
            *self.claims.entry(claimed_product(packet)).or_default() += 1;
        }
    }

    fn take_decoded(&mut self, arrived: RigNs) {
        let decoded = std::mem::take(&mut self.decoded);
        for position in &decoded.positions {
            self.position(position, arrived);
        }
        for packet in &decoded.packets {
            self.packet(packet, &decoded.points);
        }
        // The counter's resets are known to the tracker first: a packet held back for its azimuth jump still says that
        // it followed the one before.
        if self.decoder.tracker().totals().resets == 0 {
            self.timeline.resolve(self.decoder.clock());
        }
        self.decoded = decoded;
        self.decoded.clear();
    }

    fn position(&mut self, position: &PositionPacket, arrived: RigNs) {
        self.timeline.reference(position.stamp, arrived);
        self.thermal_shutdowns += u64::from(position.thermal_shutdown);
        let sentences = &mut self.sentences;
        *match position.rmc {
            Ok(rmc) if rmc.valid => &mut sentences.valid,
            Ok(_) => &mut sentences.void,
            Err(NmeaError::Empty) => &mut sentences.missing,
            Err(NmeaError::Checksum { .. }) => &mut sentences.bad_checksum,
            Err(_) => &mut sentences.unusable,
        } += 1;
    }

    fn packet(&mut self, packet: &PacketInfo, points: &Points) {
        match packet.stamp {
            Some(stamp) => self.stamped(packet, stamp),
            None => {
                // Host stamps alone; loss does not show in them, so only short steps are believed.
                let short = self.head.last_ns().is_some_and(|last| packet.arrived.0 - last < UNSTAMPED_STEP_NS);
                self.head.packet(packet.arrived.0, packet.azimuth_cdeg, short);
            }
        }
        self.shots.0 += (BLOCKS * SLOTS / packet.mode.blocks_per_firing()) as u64;
        let mut before = None;
        for point in points.iter_range(packet.points.clone()) {
            self.ranges.add(point.range_m);
            *match point.ret {
                Return::Strongest => &mut self.returns.strongest,
                Return::Last => &mut self.returns.last,
                Return::Both => &mut self.returns.both,
            } += 1;
            // Two returns of one shot follow each other.
            let shot = Some((point.column, point.laser));
            self.shots.1 += u64::from(shot != before);
            before = shot;
        }
    }

    fn stamped(&mut self, packet: &PacketInfo, stamp: LidarTime) {
        if self.decoder.hdl64().is_some() {
            // It tells the time in the data packets themselves.
            self.timeline.reference(stamp, packet.arrived);
        }
        if let Some(t_ns) = self.timeline.packet(stamp, packet.arrived, packet.order) {
            let follows = matches!(packet.order, Order::Next { lost: 0 });
            self.head.packet(t_ns, packet.azimuth_cdeg, follows);
        }
    }
}

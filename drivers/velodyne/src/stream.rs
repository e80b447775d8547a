//! A sensor's UDP payloads to points: the composition of this crate.
//!
//! ```text
//!   payload ─ length ─▶ position packet ─▶ PPS, UTC
//!      └─▶ data packet ─ model? ─▶ turning ─▶ tracker (lost? pause?) ─▶ decode ─▶ points
//!                                               ▲ a packet with an azimuth jump waits for the next stamp
//! ```

use crate::azimuth::Turning;
use crate::beams::BeamTable;
use crate::clock::UtcClock;
use crate::decode::{Timing, decode_packet};
use crate::detect::{PeriodCheck, PeriodMismatch, claimed_product, packet_period_ns};
use crate::hdl64::{self, Hdl64Decoder};
use crate::models::{Model, Product, ReturnMode};
use crate::points::Points;
use crate::position::PositionPacket;
use crate::track::{Order, PacketTracker};
use crate::wire::{BLOCKS, DATA_LEN, DataPacket, POSITION_LEN, WireError};
use core::ops::Range;
use std::collections::BTreeMap;
use tumbled_model::{LidarTime, RigNs};

/// Which firing a packet's stamp belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StampReference {
    /// The first of the packet: every model's later manuals.
    #[default]
    FirstFiring,
    /// The last of the packet: the HDL-32E manual's other reading (appendix E), 542.6 µs apart.
    LastFiring,
}

/// How one sensor's packets are to be read.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// The model; `None` believes the packets.
    pub model: Option<Model>,
    /// Whether z includes the beams' vertical offsets; `None` takes the model's default.
    pub vertical_offsets: Option<bool>,
    /// HDL-32E only.
    pub hdl32e_stamp: StampReference,
    /// HDL-64E only: the factory calibration; S2 and S3 send their own when it is `None`.
    pub hdl64e_calibration: Option<hdl64::Calibration>,
    /// Points nearer or farther than this (metres) are left out and counted; `None` keeps all that have a distance.
    pub range_limits_m: Option<(f32, f32)>,
}

/// Why a payload gave no points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
#[non_exhaustive]
pub enum Rejection {
    /// Not a packet by its length or its blocks.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// A Velodyne product this crate does not decode.
    #[error("{0} packets are not supported (supported: VLP-32C, VLP-16, Puck LITE, Puck Hi-Res, HDL-32E, HDL-64E)")]
    UnsupportedProduct(&'static str),
    /// A product byte nobody here knows.
    #[error("product byte {0:#04x} is unknown: set lidar.model if you know what it is")]
    UnknownProduct(u8),
    /// Not the model that the stream began with or that the settings name.
    #[error(
        "packets of a {found} on the port of a {expected}: set lidar.source to tell two sensors apart, or lidar.model"
    )]
    OtherModel {
        /// The model of this stream.
        expected: Model,
        /// What the packet says it is.
        found: Model,
    },
    /// Byte 1204 names no return mode of these models.
    #[error("return mode byte {0:#04x} is none of strongest 0x37, last 0x38, dual 0x39")]
    ReturnMode(u8),
    /// HDL-64E packets before any calibration is known.
    #[error(
        "HDL-64E packets without a calibration: give lidar.calibration (S2 and S3 also send it within 4160 packets)"
    )]
    Uncalibrated,
}

/// One decoded data packet.
#[derive(Clone, Debug, PartialEq)]
pub struct PacketInfo {
    /// Position among the data packets accepted so far, from 0.
    pub index: u64,
    /// When the host had it.
    pub arrived: RigNs,
    /// Its own stamp; `None` for an HDL-64E S1, which has no clock.
    pub stamp: Option<LidarTime>,
    /// Its points in [`Decoded::points`].
    pub points: Range<usize>,
    /// Return mode.
    pub mode: ReturnMode,
    /// Azimuth of its first and last firing group, 0.01°.
    pub azimuth_cdeg: (u16, u16),
    /// It holds an azimuth jump: the limited field of view ends and begins within it.
    pub azimuth_jump: bool,
    /// How long the sensor was silent at the jump, ns; included in the later points' times.
    pub pause_ns: i64,
    /// Its place in the stream, with what is missing before it.
    pub order: Order,
}

/// What payloads turned into. Cleared and refilled by the caller.
#[derive(Clone, Debug, Default)]
pub struct Decoded {
    /// All points, packet after packet.
    pub points: Points,
    /// The packets they came from.
    pub packets: Vec<PacketInfo>,
    /// Position packets.
    pub positions: Vec<PositionPacket>,
}

impl Decoded {
    /// Forgets what is there, keeps the memory.
    pub fn clear(&mut self) {
        self.points.clear();
        self.packets.clear();
        self.positions.clear();
    }
}

/// Counts of one sensor's payloads, by what became of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamCounts {
    /// Data packets decoded.
    pub data_packets: u64,
    /// Position packets read.
    pub position_packets: u64,
    /// Payloads that gave nothing, by reason.
    pub rejected: BTreeMap<Rejection, u64>,
    /// Points decoded.
    pub points: u64,
    /// Points left out by the range limits.
    pub out_of_range: u64,
    /// Packets by return mode.
    pub modes: BTreeMap<ReturnMode, u64>,
}

/// Most different reasons kept apart; a port scan must not grow the table without bound.
const MAX_REJECTION_KINDS: usize = 64;

/// Decodes one sensor's payloads in the order they came.
#[derive(Debug)]
pub struct StreamDecoder {
    settings: Settings,
    model: Option<Model>,
    beams: Option<BeamTable>,
    hdl64: Option<Hdl64Decoder>,
    tracker: PacketTracker,
    period: PeriodCheck,
    clock: UtcClock,
    counts: StreamCounts,
    last_stamp: Option<LidarTime>,
    waiting: Option<Waiting>,
    waiting_bytes: Box<[u8; DATA_LEN]>,
}

/// A packet with an azimuth jump, held back until the next stamp tells how long the silence in it was.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    index: u64,
    arrived: RigNs,
    mode: ReturnMode,
    turning: Turning,
    order: Order,
}

impl StreamDecoder {
    /// A decoder that has seen nothing yet.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            model: None,
            beams: None,
            hdl64: None,
            tracker: PacketTracker::default(),
            period: PeriodCheck::default(),
            clock: UtcClock::default(),
            counts: StreamCounts::default(),
            last_stamp: None,
            waiting: None,
            waiting_bytes: Box::new([0; DATA_LEN]),
        }
    }

    /// Takes one UDP payload of the sensor's data or position port and appends what it holds to `out`.
    ///
    /// A packet with an azimuth jump appears with the packet after it, or with [`Self::finish`].
    pub fn push(&mut self, payload: &[u8], arrived: RigNs, out: &mut Decoded) {
        if payload.len() == POSITION_LEN {
            self.push_position(payload, out);
        } else if let Err(rejection) = self.push_data(payload, arrived, out) {
            let known = self.counts.rejected.contains_key(&rejection);
            if known || self.counts.rejected.len() < MAX_REJECTION_KINDS {
                *self.counts.rejected.entry(rejection).or_default() += 1;
            } else {
                *self.counts.rejected.entry(Rejection::Wire(WireError::Length { got: 0 })).or_default() += 1;
            }
        }
    }

    /// Gives out the packet still held back, its pause estimated from the jump's width.
    pub fn finish(&mut self, out: &mut Decoded) {
        let pause_ns = self.tracker.pending_pause_ns();
        self.release(pause_ns, out);
    }

    /// The model, once a packet has been accepted.
    pub fn model(&self) -> Option<Model> {
        self.model
    }

    /// Whether z includes the beams' vertical offsets, once the model is known.
    pub fn vertical_offsets(&self) -> Option<bool> {
        self.model.map(|model| self.settings.vertical_offsets.unwrap_or(model.vertical_offsets_default()))
    }

    /// What became of the payloads.
    pub fn counts(&self) -> &StreamCounts {
        &self.counts
    }

    /// Loss, order, speed and field of view.
    pub fn tracker(&self) -> &PacketTracker {
        &self.tracker
    }

    /// PPS, NMEA and absolute time.
    pub fn clock(&self) -> &UtcClock {
        &self.clock
    }

    /// HDL-64E: generation, calibration, status.
    pub fn hdl64(&self) -> Option<&Hdl64Decoder> {
        self.hdl64.as_ref()
    }

    /// A packet period that does not fit the model.
    pub fn period_mismatch(&self) -> Option<PeriodMismatch> {
        self.period.mismatch()
    }

    fn push_position(&mut self, payload: &[u8], out: &mut Decoded) {
        if let Some(position) = PositionPacket::parse(payload) {
            self.counts.position_packets += 1;
            self.clock.update(&position);
            out.positions.push(position);
        }
    }

    fn push_data(&mut self, payload: &[u8], arrived: RigNs, out: &mut Decoded) -> Result<(), Rejection> {
        let packet = DataPacket::new(payload)?;
        match self.accept_model(&packet)? {
            Model::Hdl64e => self.push_hdl64(&packet, arrived, out),
            model => self.push_built_in(&packet, model, payload, arrived, out),
        }
    }

    /// The model to decode as: the settings', or what the first packet says.
    fn accept_model(&mut self, packet: &DataPacket<'_>) -> Result<Model, Rejection> {
        if let Some(forced) = self.settings.model {
            self.model = Some(forced);
            return Ok(forced);
        }
        match (claimed_product(packet), self.model) {
            (Product::Supported(found), Some(expected)) if found != expected => {
                Err(Rejection::OtherModel { expected, found })
            }
            (Product::Supported(found), _) => Ok(found),
            (Product::Unsupported(name), _) => Err(Rejection::UnsupportedProduct(name)),
            (Product::Unknown(byte), _) => Err(Rejection::UnknownProduct(byte)),
        }
    }

    fn push_built_in(
        &mut self,
        packet: &DataPacket<'_>,
        model: Model,
        payload: &[u8],
        arrived: RigNs,
        out: &mut Decoded,
    ) -> Result<(), Rejection> {
        let azimuths = packet.azimuths()?;
        let mode = self.return_mode(packet, &azimuths)?;
        let turning = Turning::measure(&azimuths, mode.blocks_per_firing());
        let Some(nominal_ns) = packet_period_ns(model, mode) else { return Ok(()) };
        if self.beams.is_none() {
            let offsets = self.settings.vertical_offsets.unwrap_or(model.vertical_offsets_default());
            self.beams = model.spec().map(|spec| BeamTable::new(spec, offsets));
        }
        self.model = Some(model);

        let stamp = packet.stamp();
        let period_ns = self.checked_period(stamp, model, mode, nominal_ns);
        let observation = self.tracker.observe(stamp, arrived, period_ns, &turning);
        let pause_ns = observation.previous_pause_ns.or_else(|| self.tracker.pending_pause_ns());
        self.release(pause_ns, out);

        let held = Waiting { index: self.counts.data_packets, arrived, mode, turning, order: observation.order };
        self.counts.data_packets += 1;
        *self.counts.modes.entry(mode).or_default() += 1;
        let newest = matches!(observation.order, Order::Next { .. } | Order::Reset);
        match <&[u8; DATA_LEN]>::try_from(payload) {
            Ok(bytes) if turning.jump.is_some() && newest => {
                self.waiting_bytes.copy_from_slice(bytes);
                self.waiting = Some(held);
            }
            _ => self.decode(packet, held, 0, out),
        }
        Ok(())
    }

    fn push_hdl64(&mut self, packet: &DataPacket<'_>, arrived: RigNs, out: &mut Decoded) -> Result<(), Rejection> {
        let calibration = &self.settings.hdl64e_calibration;
        let decoder = self.hdl64.get_or_insert_with(|| Hdl64Decoder::new(calibration.clone()));
        let start = out.points.len();
        let read = decoder.decode(packet, &mut out.points)?;
        self.model = Some(Model::Hdl64e);
        if let (true, Some(utc)) = (read.stamped, decoder.status().gps_time()) {
            self.clock.update_utc(packet.stamp(), utc);
        }
        if read.uncalibrated {
            return Err(Rejection::Uncalibrated);
        }
        let mode = if read.dual { ReturnMode::Dual } else { ReturnMode::Strongest };
        // A firing is two blocks, upper and lower bank, in dual return four. An S1 fires by the block, and has no clock.
        let order = if read.stamped {
            let turning = Turning::measure(&packet.azimuths()?, 2 * mode.blocks_per_firing());
            self.tracker.observe(packet.stamp(), arrived, i64::from(read.period_ns), &turning).order
        } else {
            self.tracker.count_unstamped();
            Order::Next { lost: 0 }
        };
        self.keep_in_range(start, &mut out.points);
        out.packets.push(PacketInfo {
            index: self.counts.data_packets,
            arrived,
            stamp: read.stamped.then(|| packet.stamp()),
            points: start..out.points.len(),
            mode,
            azimuth_cdeg: (read.azimuth_first_cdeg, read.azimuth_last_cdeg),
            azimuth_jump: read.azimuth_jump,
            pause_ns: 0,
            order,
        });
        self.counts.data_packets += 1;
        *self.counts.modes.entry(mode).or_default() += 1;
        Ok(())
    }

    /// The period to count losses with: the model's, or the measured one when that is another model's.
    fn checked_period(&mut self, stamp: LidarTime, model: Model, mode: ReturnMode, nominal_ns: i64) -> i64 {
        if let Some(last) = self.last_stamp.replace(stamp)
            && let Some(mismatch) = self.period.step(stamp.since(last).0, model, mode)
        {
            self.tracker.forget_losses(mismatch.measured_ns);
        }
        self.period.mismatch().map_or(nominal_ns, |mismatch| mismatch.measured_ns)
    }

    /// The packet's return mode. Where the settings name the model, an unknown byte is settled by the azimuths: only
    /// dual return sends every one twice.
    fn return_mode(&self, packet: &DataPacket<'_>, azimuths: &[u16; BLOCKS]) -> Result<ReturnMode, Rejection> {
        let byte = packet.mode_byte();
        if let Some(mode) = ReturnMode::from_byte(byte) {
            return Ok(mode);
        }
        if self.settings.model.is_none() {
            return Err(Rejection::ReturnMode(byte));
        }
        let (pairs, _) = azimuths.as_chunks::<2>();
        let paired = pairs.iter().all(|pair| pair[0] == pair[1]);
        let turning = azimuths.first() != azimuths.last();
        Ok(if paired && turning { ReturnMode::Dual } else { ReturnMode::Strongest })
    }

    /// Decodes the packet held back, now that its pause is known.
    fn release(&mut self, pause_ns: Option<i64>, out: &mut Decoded) {
        let Some(held) = self.waiting.take() else { return };
        // A pause is at most a turn of the slowest motor, 0.2 s; the bound keeps forged stamps out of the point times.
        let pause_ns = pause_ns.unwrap_or(0).clamp(0, 1_000_000_000);
        let bytes = *self.waiting_bytes;
        if let Ok(packet) = DataPacket::new(&bytes) {
            self.decode(&packet, held, pause_ns, out);
        }
    }

    fn decode(&mut self, packet: &DataPacket<'_>, held: Waiting, pause_ns: i64, out: &mut Decoded) {
        let Some(beams) = &self.beams else { return };
        let last_firing = self.model == Some(Model::Hdl32e) && self.settings.hdl32e_stamp == StampReference::LastFiring;
        let shift_ns = if last_firing { -beams.last_firing_ns() } else { 0 };
        let start = out.points.len();
        let timing = Timing { shift_ns, pause_ns: pause_ns as i32 };
        decode_packet(packet, beams, held.mode, &held.turning, timing, &mut out.points);
        self.keep_in_range(start, &mut out.points);
        out.packets.push(PacketInfo {
            index: held.index,
            arrived: held.arrived,
            stamp: Some(packet.stamp()),
            points: start..out.points.len(),
            mode: held.mode,
            azimuth_cdeg: (held.turning.first_cdeg(), held.turning.last_cdeg()),
            azimuth_jump: held.turning.jump.is_some(),
            pause_ns,
            order: held.order,
        });
    }

    fn keep_in_range(&mut self, start: usize, points: &mut Points) {
        if let Some((min, max)) = self.settings.range_limits_m {
            let before = points.len();
            points.retain_range_m(start, min, max);
            self.counts.out_of_range += (before - points.len()) as u64;
        }
        self.counts.points += (points.len() - start) as u64;
    }
}

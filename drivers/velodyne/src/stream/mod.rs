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
pub use crate::decoded::{Decoded, PacketInfo, Refused, Rejection, RejectionKind, StreamCounts};
use crate::detect::{PeriodCheck, PeriodMismatch, claimed_product, packet_period_ns};
use crate::hdl64::{Hdl64Decoder, Hdl64Packet};
use crate::heads::{GroupTimes, Heads};
use crate::models::{Model, Product, ReturnMode};
use crate::points::Points;
use crate::position::PositionPacket;
pub use crate::settings::{Settings, StampReference};
use crate::track::{Order, PacketTracker};
use crate::wire::{BLOCKS, DATA_LEN, DataPacket, POSITION_LEN, SLOTS, WireError};
use tumbled_model::{LidarTime, RigNs};

mod hdl64e;

/// So many packets of another model in a row, and no fewer than were decoded, and the stream is that model's: the first
/// packet may have been a stray.
const OTHER_MODEL_RUN: u32 = 8;

/// Longest silence believed, ns: a turn of the slowest motor is 0.2 s, and a narrow view has several in a packet. The
/// bound keeps forged stamps out of the points' times.
const MAX_PAUSE_NS: i64 = 2_000_000_000;

/// Decodes one sensor's payloads in the order they came.
#[derive(Debug)]
pub struct StreamDecoder {
    settings: Settings,
    model: Option<Model>,
    beams: Option<BeamTable>,
    hdl64: Option<Hdl64Decoder>,
    /// What the newest HDL-64E packet was: whether its stamps are a clock shows only in decoding.
    hdl64_newest: Option<Hdl64Packet>,
    /// What the packets say they are, where the settings say otherwise.
    contradiction: Option<Product>,
    /// Packets of another model on end.
    other_model: (u32, Option<Model>),
    /// Data payloads so far, decoded or not.
    payloads: u64,
    tracker: PacketTracker,
    period: PeriodCheck,
    clock: UtcClock,
    counts: StreamCounts,
    last_stamp: Option<LidarTime>,
    waiting: Option<Held>,
    waiting_bytes: Box<[u8; DATA_LEN]>,
}

/// Which payload it is and when the host had it.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    index: u64,
    arrived: RigNs,
}

/// A packet about to be decoded; one with an azimuth jump is held back until the next stamp tells how long the silence
/// in it was.
#[derive(Clone, Copy, Debug)]
struct Held {
    arrival: Arrival,
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
            hdl64_newest: None,
            contradiction: None,
            other_model: (0, None),
            payloads: 0,
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
    /// A packet with an azimuth jump appears with the packet after it, or with [`Self::finish`]. Gives the reason, which
    /// is counted, when the payload could not be read.
    pub fn push(&mut self, payload: &[u8], arrived: RigNs, out: &mut Decoded) -> Option<Rejection> {
        let read = if payload.len() == POSITION_LEN {
            self.push_position(payload, out).map_err(Rejection::from)
        } else {
            self.push_data(payload, arrived, out)
        };
        let rejection = read.err()?;
        self.counts.reject(rejection);
        Some(rejection)
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

    /// What the packets say they are when that is not the model the settings force.
    ///
    /// An old VLP-16 that says HDL-32E is the reason to force a model, and no contradiction.
    pub fn contradiction(&self) -> Option<Product> {
        self.contradiction
    }

    fn push_position(&mut self, payload: &[u8], out: &mut Decoded) -> Result<(), WireError> {
        let position = PositionPacket::parse(payload)?;
        self.counts.position_packets += 1;
        self.clock.update(&position);
        out.positions.push(position);
        Ok(())
    }

    fn push_data(&mut self, payload: &[u8], arrived: RigNs, out: &mut Decoded) -> Result<(), Rejection> {
        let packet = DataPacket::new(payload)?;
        let index = self.payloads;
        self.payloads += 1;
        let azimuths = packet.azimuths().map_err(|error| self.refuse_foreign(&packet).unwrap_or(error.into()))?;
        let model = self.accept_model(&packet)?;
        if self.model.is_some_and(|before| before != model) {
            self.finish(out);
            self.begin_anew();
        }
        self.model = Some(model);
        let arrival = Arrival { index, arrived };
        match model {
            Model::Hdl64e => self.push_hdl64(&packet, &azimuths, payload, arrival, out),
            model => self.push_built_in(&packet, &azimuths, model, payload, arrival, out),
        }
    }

    /// The name of a foreign product, for packets whose blocks are not ours either.
    fn refuse_foreign(&self, packet: &DataPacket<'_>) -> Option<Rejection> {
        match claimed_product(packet) {
            Product::Unsupported(name) if self.settings.model.is_none() => Some(Rejection::UnsupportedProduct(name)),
            _ => None,
        }
    }

    /// The model to decode as: the settings', or what the packets say.
    fn accept_model(&mut self, packet: &DataPacket<'_>) -> Result<Model, Rejection> {
        let claimed = claimed_product(packet);
        if let Some(forced) = self.settings.model {
            let old_firmware =
                claimed == Product::Supported(Model::Hdl32e) && matches!(forced, Model::Vlp16 | Model::Vlp16HiRes);
            if claimed != Product::Supported(forced) && !old_firmware {
                self.contradiction = Some(claimed);
            }
            return Ok(forced);
        }
        match (claimed, self.model) {
            (Product::Supported(found), Some(expected)) if found != expected => {
                let (run, other) = self.other_model;
                let run = if other == Some(found) { run + 1 } else { 1 };
                self.other_model = (run, Some(found));
                if run < OTHER_MODEL_RUN || u64::from(run) < self.counts.data_packets {
                    return Err(Rejection::OtherModel { expected, found });
                }
                Ok(found)
            }
            (Product::Supported(found), _) => {
                self.other_model = (0, None);
                Ok(found)
            }
            (Product::Unsupported(name), _) => Err(Rejection::UnsupportedProduct(name)),
            (Product::Unknown(byte), _) => Err(Rejection::UnknownProduct(byte)),
        }
    }

    /// Forgets what was learned of a sensor that was not this one; the counts stay.
    fn begin_anew(&mut self) {
        self.other_model = (0, None);
        self.beams = None;
        self.hdl64 = None;
        self.hdl64_newest = None;
        self.tracker = PacketTracker::default();
        self.period = PeriodCheck::default();
        self.last_stamp = None;
        self.waiting = None;
    }

    fn push_built_in(
        &mut self,
        packet: &DataPacket<'_>,
        azimuths: &[u16; BLOCKS],
        model: Model,
        payload: &[u8],
        arrival: Arrival,
        out: &mut Decoded,
    ) -> Result<(), Rejection> {
        let mode = self.return_mode(packet, azimuths)?;
        let turning = Turning::measure(azimuths, mode.blocks_per_firing());
        let Some(nominal_ns) = packet_period_ns(model, mode) else { return Ok(()) };
        if self.beams.is_none() {
            let offsets = self.settings.vertical_offsets.unwrap_or(model.vertical_offsets_default());
            self.beams = model.spec().map(|spec| BeamTable::new(spec, offsets));
        }
        let period_ns = self.checked_period(packet.stamp(), model, mode, nominal_ns);
        let order = self.observe(packet, arrival, period_ns, &turning, out);
        self.counts.data_packets += 1;
        *self.counts.modes.entry(mode).or_default() += 1;
        let held = Held { arrival, mode, turning, order };
        if self.hold(held, payload) {
            return Ok(());
        }
        let pause_ns = if turning.jumps.is_empty() { 0 } else { self.tracker.pause_of_ns(&turning, period_ns) };
        self.decode(packet, held, pause_ns, out);
        Ok(())
    }

    /// Follows the stream by a packet's stamp, and gives out the one held back before it.
    fn observe(
        &mut self,
        packet: &DataPacket<'_>,
        arrival: Arrival,
        period_ns: i64,
        turning: &Turning,
        out: &mut Decoded,
    ) -> Order {
        let by_angle = self.waiting.and_then(|_| self.tracker.pending_pause_ns());
        let observation = self.tracker.observe(packet.stamp(), arrival.arrived, period_ns, turning);
        if observation.order == Order::Reset {
            self.clock.invalidate();
        }
        self.release(observation.previous_pause_ns.or(by_angle), out);
        observation.order
    }

    /// Keeps a packet with a jump back until the next stamp. Late and repeated ones wait for none: theirs has passed.
    fn hold(&mut self, held: Held, payload: &[u8]) -> bool {
        let newest = matches!(held.order, Order::Next { .. } | Order::Reset);
        match <&[u8; DATA_LEN]>::try_from(payload) {
            Ok(bytes) if newest && !held.turning.jumps.is_empty() => {
                self.waiting_bytes.copy_from_slice(bytes);
                self.waiting = Some(held);
                true
            }
            _ => false,
        }
    }

    /// The period to count losses with: the model's, or the measured one where that is another model's.
    fn checked_period(&mut self, stamp: LidarTime, model: Model, mode: ReturnMode, nominal_ns: i64) -> i64 {
        if let Some(last) = self.last_stamp.replace(stamp)
            && let Some(mismatch) = self.period.step(stamp.since(last).0, model, mode)
            && mismatch.fits.is_some()
        {
            self.tracker.forget_losses(mismatch.measured_ns);
        }
        let other = self.period.mismatch().filter(|mismatch| mismatch.fits.is_some());
        other.map_or(nominal_ns, |mismatch| mismatch.measured_ns)
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
        let pause_ns = pause_ns.unwrap_or(0).clamp(0, MAX_PAUSE_NS);
        let bytes = *self.waiting_bytes;
        let Ok(packet) = DataPacket::new(&bytes) else { return };
        if self.model != Some(Model::Hdl64e) {
            self.decode(&packet, held, pause_ns, out);
        } else if let Err(rejection) = self.decode_hdl64(&packet, held, pause_ns, out) {
            self.counts.reject(rejection);
        }
    }

    fn decode(&mut self, packet: &DataPacket<'_>, held: Held, pause_ns: i64, out: &mut Decoded) {
        let Some(beams) = &self.beams else { return };
        let last_firing = self.model == Some(Model::Hdl32e) && self.settings.hdl32e_stamp == StampReference::LastFiring;
        let shift_ns = if last_firing { -beams.last_firing_ns(held.turning.groups) } else { 0 };
        let start = out.points.len();
        decode_packet(packet, beams, held.mode, &held.turning, Timing { shift_ns, pause_ns }, &mut out.points);
        self.keep_in_range(start, &mut out.points);
        out.packets.push(PacketInfo {
            index: held.arrival.index,
            arrived: held.arrival.arrived,
            stamp: Some(packet.stamp()),
            points: start..out.points.len(),
            mode: held.mode,
            azimuth_cdeg: (held.turning.first_cdeg(), held.turning.last_cdeg()),
            azimuth_jump: !held.turning.jumps.is_empty(),
            pause_ns,
            heads: self.heads(&held, shift_ns, pause_ns),
            order: held.order,
        });
    }

    fn heads(&self, held: &Held, shift_ns: i32, pause_ns: i64) -> Heads {
        let period_ns = self.model.and_then(|model| packet_period_ns(model, held.mode)).unwrap_or_default();
        // The sixteen lasers of a VLP-16 fire twice in a block.
        let columns = self.model.map_or(1, |model| SLOTS / model.lasers().clamp(1, SLOTS)) as u8;
        Heads::new(&held.turning, GroupTimes { period_ns, shift_ns, pause_ns, columns })
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

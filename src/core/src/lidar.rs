//! One LiDAR: packets to turns on the session's timeline.
//!
//! ```text
//!   payload ─ StreamDecoder ─▶ points ─ DeviceClock ─▶ time ─ Reorder ─▶ Assembler ─▶ turns ─ Placement ─▶ epochs
//! ```

use crate::assemble::{Assembler, LONGEST_SILENCE, Turn};
use crate::boundary::Shedding;
use crate::clock::{DeviceClock, DeviceClockKind, Pushed, UtcMap};
use crate::config::{CoreConfig, LidarSetup};
use crate::epoch::{Epoch, LidarScan, RigCloud, Scan, TimeBasis};
use crate::health::{LidarHealth, LossHealth, PointHealth, SensorHealth, SensorKind, SensorState, age_ns};
use crate::notice::{Gravity, NoticeKind};
use crate::place::Placement;
use crate::reorder::{Reorder, TimedPacket};
use crate::sector::{Sector, TURN_CDEG};
use crate::vitals::Vitals;
use crate::workers::Workers;
use bytes::Bytes;
use tumbled_model::{RigNs, SensorId, SourceState, Span};
use tumbled_velodyne::stream::{Decoded, PacketInfo, Rejection, StreamDecoder};
use tumbled_velodyne::track::{Order, StreamTotals};
use tumbled_velodyne::{DataPacket, Model, ReturnMode};

/// What a channel tells people: what kind, how bad, and the sentence.
pub(crate) type Remark = (NoticeKind, Gravity, String);

/// One LiDAR's way through the core.
#[derive(Debug)]
pub(crate) struct LidarChannel {
    id: SensorId,
    pub(crate) vitals: Vitals,
    pub(crate) shedding: Shedding,
    decoder: StreamDecoder,
    decoded: Decoded,
    clock: DeviceClock,
    utc: UtcMap,
    time_offset: Span,
    reorder: Reorder,
    assembler: Assembler,
    placement: Placement,
    /// Its clock has begun: when it begins again, that is told.
    clock_began: bool,
    turns: Vec<Turn>,
    points: PointHealth,
    /// Losses posted since the newest data packet: the next stamp will tell of them too.
    posted: u64,
    /// Losses that were posted and that no stamp can tell of: the counter began, or there is none.
    unstamped: u64,
    /// Payloads of a data packet's length so far: how the decoder numbers them.
    payloads: u64,
    /// Whether the packet that the decoder holds back is of a shed scan.
    held_is_shed: bool,
    coverage: Option<f64>,
    points_in_roi: u64,
    seen: (Option<Model>, Option<ReturnMode>),
    rejected: u64,
    /// `rejected` and the packets decoded a second ago.
    before: (u64, u64),
    unreadable: bool,
    remarks: Vec<Remark>,
}

impl LidarChannel {
    pub(crate) fn new(setup: &LidarSetup, config: &CoreConfig) -> Self {
        Self {
            id: setup.id.clone(),
            vitals: Vitals::default(),
            shedding: Shedding::default(),
            decoder: StreamDecoder::new(setup.decoder.clone()),
            decoded: Decoded::default(),
            clock: DeviceClock::new(DeviceClockKind::Velodyne, config.timing.clock),
            utc: UtcMap::new(),
            time_offset: setup.time_offset,
            reorder: Reorder::default(),
            assembler: Assembler::new(Sector::new(&config.roi, &setup.t_rig_lidar)),
            placement: Placement::new(&setup.t_rig_lidar, &config.roi),
            clock_began: false,
            turns: Vec::new(),
            points: PointHealth::default(),
            posted: 0,
            unstamped: 0,
            payloads: 0,
            held_is_shed: false,
            coverage: None,
            points_in_roi: 0,
            seen: (None, None),
            rejected: 0,
            before: (0, 0),
            unreadable: false,
            remarks: Vec::new(),
        }
    }

    /// Takes over what of a changed config can change in a session.
    pub(crate) fn configure(&mut self, setup: &LidarSetup, config: &CoreConfig) {
        while let Some(packet) = self.reorder.pop() {
            self.assemble(packet);
        }
        let ended = self.assembler.set_sector(Sector::new(&config.roi, &setup.t_rig_lidar));
        self.turns.extend(ended);
        self.placement = Placement::new(&setup.t_rig_lidar, &config.roi);
        self.time_offset = setup.time_offset;
    }

    /// Takes one payload of the data or position port.
    pub(crate) fn packet(&mut self, payload: &Bytes, arrived: RigNs, begins_scan: bool) {
        if self.vitals.newest.is_some_and(|newest| arrived - newest > LONGEST_SILENCE) {
            self.end_turn();
        }
        self.vitals.datum(arrived, payload.len());
        let shed = self.shedding.covers(begins_scan);
        let before = (self.decoder.model(), self.decoder.tracker().totals());
        self.decoded.clear();
        let rejection = self.decoder.push(payload, arrived, &mut self.decoded);
        let mut decoded = core::mem::take(&mut self.decoded);
        self.settle_losses(before, &decoded);
        self.take_positions(&decoded);
        let index = self.payloads;
        for packet in &decoded.packets {
            let shed = if packet.index == index { shed } else { self.held_is_shed };
            self.take(packet, &decoded.points, shed);
        }
        if DataPacket::new(payload).is_ok() {
            self.payloads += 1;
            if rejection.is_none() && decoded.packets.last().is_none_or(|packet| packet.index != index) {
                self.held_is_shed = shed;
            }
        }
        decoded.clear();
        self.decoded = decoded;
        if let Some(rejection) = rejection {
            self.notice_rejection(payload, rejection);
        }
    }

    /// What was posted is told once more by the next packet's stamp, which is the better witness; where no stamp can
    /// tell of it, it stays as it was posted.
    fn settle_losses(&mut self, (model, before): (Option<Model>, StreamTotals), decoded: &Decoded) {
        let now = self.decoder.tracker().totals();
        if self.decoder.model() != model {
            // The tracker begins with this packet, and forgets what another model's stream had lost.
            self.unstamped += before.lost;
        }
        let begins = self.decoder.model() != model || now.resets > before.resets;
        let newer =
            |totals: &StreamTotals| totals.received.saturating_sub(totals.duplicates + totals.late + totals.doubtful);
        let has_no_stamp = decoded.packets.last().is_some_and(|packet| packet.stamp.is_none());
        if begins || has_no_stamp {
            self.unstamped += core::mem::take(&mut self.posted);
        } else if newer(&now) > newer(&before) {
            self.posted = 0;
        }
    }

    /// Its source's state changed. What it had sent is a turn of its own: nobody waits for the rest of it.
    pub(crate) fn source(&mut self, state: SourceState) {
        self.vitals.source(state);
        if state != SourceState::Opened {
            self.end_turn();
        }
    }

    /// Something of its data was lost on this host or in the capture.
    pub(crate) fn gap(&mut self, place: tumbled_model::LossPoint, lost: u32) {
        self.vitals.gap(place, lost);
        self.posted += u64::from(lost);
    }

    /// Ends the open turn if nothing came for so long that it is over.
    pub(crate) fn silence(&mut self, t: RigNs) {
        if self.vitals.newest.is_some_and(|newest| t - newest > LONGEST_SILENCE) {
            self.end_turn();
        }
    }

    /// Gives out what is still held back: nothing more comes.
    pub(crate) fn finish(&mut self) {
        self.decoded.clear();
        self.decoder.finish(&mut self.decoded);
        let decoded = core::mem::take(&mut self.decoded);
        for packet in &decoded.packets {
            self.take(packet, &decoded.points, self.held_is_shed);
        }
        self.end_turn();
    }

    /// No later epoch will have an earlier time.
    pub(crate) fn watermark(&self) -> Option<RigNs> {
        self.assembler.watermark()
    }

    /// The turns that are complete, as epochs.
    pub(crate) fn epochs(&mut self, spare: &mut Vec<RigCloud>, workers: &Workers, mut give: impl FnMut(Epoch)) {
        for turn in self.turns.drain(..) {
            let Turn { t, span, sigma, basis, arrived, scan } = turn;
            let mut rig = spare.pop().unwrap_or_default();
            self.placement.apply([&scan.points.x, &scan.points.y, &scan.points.z], &mut rig, workers);
            self.points.in_epochs += scan.points.len() as u64;
            self.points_in_roi = rig.points_in_roi() as u64;
            self.coverage = Some(scan.coverage);
            let sensor = self.id.clone();
            give(Epoch { number: 0, sensor, t, span, sigma, basis, arrived, scan: Scan::Lidar(Box::new(scan)), rig });
        }
    }

    /// Buffers of an epoch that is no longer needed.
    pub(crate) fn recycle(&mut self, scan: LidarScan) {
        self.assembler.recycle(scan);
    }

    /// What happened since the last call.
    pub(crate) fn remarks(&mut self) -> std::vec::Drain<'_, Remark> {
        self.remarks.drain(..)
    }

    /// So many seconds are over since the last call.
    pub(crate) fn seconds(&mut self, seconds: i64) {
        self.vitals.seconds(seconds);
        let now = (self.rejected, self.decoder.counts().data_packets);
        self.unreadable = now.0 > self.before.0 && now.1 == self.before.1;
        self.before = now;
    }

    /// What it was doing at `t`.
    pub(crate) fn state(&self, t: RigNs) -> SensorState {
        match self.vitals.state(t) {
            SensorState::Live if self.unreadable => SensorState::Fault,
            state => state,
        }
    }

    /// Its health at `t`, given everything that arrived before.
    pub(crate) fn health(&self, t: RigNs) -> SensorHealth {
        let counts = self.decoder.counts();
        let refused = counts.rejected.iter();
        let totals = self.decoder.tracker().totals();
        let lost = LossHealth {
            total: totals.lost + self.unstamped + self.posted,
            by_stamps: totals.lost,
            ..self.vitals.lost
        };
        SensorHealth {
            id: self.id.to_string(),
            kind: SensorKind::Lidar,
            state: self.state(t),
            received: self.vitals.received,
            bytes: self.vitals.bytes,
            rate_hz: self.vitals.rate_hz(),
            age_ns: age_ns(t, self.vitals.newest),
            lost,
            malformed: refused.clone().map(|(kind, refused)| (kind.to_string(), refused.count)).collect(),
            malformed_first: refused.map(|(kind, refused)| (kind.to_string(), refused.first.to_string())).collect(),
            duplicates: totals.duplicates,
            reordered: totals.late,
            points: PointHealth { decoded: counts.points, ..self.points },
            epochs: crate::health::EpochHealth { shed_scans: self.shedding.scans(), ..Default::default() },
            clock: self.clock_began.then(|| self.clock.report(t).into()),
            lidar: Some(LidarHealth {
                model: self.decoder.model().map(|model| model.to_string()),
                return_mode: self.seen.1.map(|mode| mode.to_string()),
                rpm: self.decoder.tracker().rpm(),
                utc: self.decoder.clock().state().to_string(),
                utc_ns: self.utc.utc(t).map(|reading| reading.utc.0.to_string()),
                coverage: self.coverage,
                missed_crossings: self.assembler.missed(),
                points_in_roi: self.points_in_roi,
                contradiction: self.decoder.contradiction().map(|product| product.to_string()),
            }),
            kinect: None,
            turntable: None,
        }
    }

    fn take_positions(&mut self, decoded: &Decoded) {
        for position in &decoded.positions {
            self.clock.note_pps(position.pps);
        }
    }

    /// Puts one decoded packet on the timeline and into its turn.
    fn take(&mut self, info: &PacketInfo, points: &tumbled_velodyne::Points, shed: bool) {
        self.notice_model(info.mode);
        let len = info.points.len() as u64;
        if info.order == Order::Duplicate {
            self.points.duplicate += len;
            return;
        }
        let Some((t, sigma, basis)) = self.time(info) else {
            self.points.untimed += len;
            return;
        };
        if shed {
            self.points.shed += len;
            return;
        }
        if !self.reorder.has_place(t) {
            self.points.late += len;
            return;
        }
        let mut own = self.reorder.buffer();
        own.extend_from_range(points, info.points.clone());
        let packet = TimedPacket { t, sigma, basis, arrived: info.arrived, heads: info.heads, points: own };
        if let Some(next) = self.reorder.push(packet) {
            self.assemble(next);
        }
    }

    /// The time of a packet's stamp; `None`: it cannot be told.
    fn time(&mut self, info: &PacketInfo) -> Option<(RigNs, Span, TimeBasis)> {
        let Some(stamp) = info.stamp else {
            // An HDL-64E S1 has no clock: its packets' arrivals are the times there are.
            let sigma = DeviceClockKind::Velodyne.parameters().arrival_sigma_ns;
            return Some((info.arrived - self.time_offset, Span(sigma), TimeBasis::Arrival));
        };
        let pushed = self.clock.push(stamp.0, info.arrived);
        if pushed == Pushed::NewEpoch {
            self.end_turn();
            if core::mem::replace(&mut self.clock_began, true) {
                let message = format!("the clock of {} began anew: its times are being found again", self.id);
                self.remarks.push((NoticeKind::ClockReset, Gravity::Warn, message));
            }
        }
        if pushed == Pushed::Doubtful {
            return None;
        }
        let mapped = self.clock.map(stamp.0)?;
        let utc = self.decoder.clock();
        self.utc.update(utc.state(), utc.utc(stamp), mapped.t, mapped.sigma);
        Some((mapped.t - self.time_offset, mapped.sigma, TimeBasis::Device(mapped.state)))
    }

    fn assemble(&mut self, packet: TimedPacket) {
        let turn_per_ns = f64::from(TURN_CDEG) / 60e9;
        let speed = self.decoder.tracker().rpm().map(|rpm| rpm * turn_per_ns);
        self.assembler.push(&packet, speed, &mut self.turns);
        self.reorder.done(packet);
    }

    fn end_turn(&mut self) {
        while let Some(packet) = self.reorder.pop() {
            self.assemble(packet);
        }
        let ended = self.assembler.finish();
        self.turns.extend(ended);
    }

    fn notice_model(&mut self, mode: ReturnMode) {
        let now = (self.decoder.model(), Some(mode));
        if let (true, (Some(model), _)) = (now != self.seen, now) {
            let message = format!("{} is a {model}, {mode} return", self.id);
            self.remarks.push((NoticeKind::Model, Gravity::Info, message));
            self.seen = now;
        }
    }

    /// Tells of the first payload in a second that could not be read.
    fn notice_rejection(&mut self, payload: &[u8], rejection: Rejection) {
        if self.rejected == self.before.0 {
            let message = format!("{}: a payload of {} bytes could not be read: {rejection}", self.id, payload.len());
            self.remarks.push((NoticeKind::Malformed, Gravity::Warn, message));
        }
        self.rejected += 1;
    }
}

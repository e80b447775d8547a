//! One Kinect: frames to epochs on the session's timeline.
//!
//! ```text
//!   frame ─ FrozenDetector ─ DeviceClock ─▶ time
//!       └── depth law ─▶ metres ─ BackProjector ─▶ points ─ Placement ─▶ epoch
//! ```

use crate::boundary::Shedding;
use crate::clock::{ClockState, DeviceClock, DeviceClockKind, Pushed};
use crate::config::{CoreConfig, KinectSetup};
use crate::epoch::{Epoch, KinectScan, RigCloud, Scan, TimeBasis};
use crate::health::{EpochHealth, KinectHealth, PointHealth, SensorHealth, SensorKind, SensorState, age_ns};
use crate::lidar::Remark;
use crate::notice::{Gravity, NoticeKind};
use crate::place::Placement;
use crate::vitals::Vitals;
use crate::workers::Workers;
use bytes::Bytes;
use std::collections::BTreeMap;
use tumbled_kinect::{BackProjector, DecodeCounts, DepthImage, DepthTable, Freshness, FrozenDetector, decode_metres};
use tumbled_model::{DepthEncoding, KinectTicks, PacketMask, RigNs, SensorId, SourceState, Span};

/// A frozen device is closed and opened anew by its source: for so long it counts as frozen, and not as absent. It is live
/// again by then, or it has gone.
const FROZEN_STANDS: Span = Span(5_000_000_000);

/// Exposures follow each other by 33.3 ms: after one whose time is the device's own, none comes for so long. What is left of the
/// period is room for corrections of a locked clock's line. The other sensors need not wait for the next frame's arrival to know
/// it.
const NEXT_AFTER: Span = Span(25_000_000);

/// A depth frame as the ledger has it.
#[derive(Clone, Copy)]
pub(crate) struct Frame<'a> {
    pub(crate) ticks: Option<KinectTicks>,
    pub(crate) encoding: DepthEncoding,
    pub(crate) lost: &'a PacketMask,
    pub(crate) bytes: &'a Bytes,
}

/// One Kinect's way through the core.
#[derive(Debug)]
pub(crate) struct KinectChannel {
    id: SensorId,
    pub(crate) vitals: Vitals,
    pub(crate) shedding: Shedding,
    table: DepthTable,
    projector: BackProjector,
    placement: Placement,
    time_offset: Span,
    clock: DeviceClock,
    clock_began: bool,
    frozen: FrozenDetector,
    is_frozen: bool,
    counts: DecodeCounts,
    depth: DepthImage,
    ready: Vec<Epoch>,
    spare: Vec<KinectScan>,
    /// No frame has an earlier time any more.
    passed: Option<RigNs>,
    points: PointHealth,
    kinect: KinectHealth,
    reordered: u64,
    refused_before: u64,
    /// Why the first frame of each kind was refused.
    refused_first: BTreeMap<&'static str, String>,
    remarks: Vec<Remark>,
}

impl KinectChannel {
    pub(crate) fn new(setup: &KinectSetup, config: &CoreConfig) -> Self {
        Self {
            id: setup.id.clone(),
            vitals: Vitals::default(),
            shedding: Shedding::default(),
            table: setup.table.clone(),
            projector: setup.projector.clone(),
            placement: Placement::new(&setup.t_rig_kinect, &config.roi),
            time_offset: setup.time_offset,
            clock: DeviceClock::new(DeviceClockKind::Kinect, config.timing.clock),
            clock_began: false,
            frozen: FrozenDetector::default(),
            is_frozen: false,
            counts: DecodeCounts::default(),
            depth: DepthImage::new(),
            ready: Vec::new(),
            spare: Vec::new(),
            passed: None,
            points: PointHealth::default(),
            kinect: KinectHealth::default(),
            reordered: 0,
            refused_before: 0,
            refused_first: BTreeMap::new(),
            remarks: Vec::new(),
        }
    }

    /// Takes over what of a changed config can change in a session.
    pub(crate) fn configure(&mut self, setup: &KinectSetup, config: &CoreConfig) {
        self.projector = setup.projector.clone();
        self.placement = Placement::new(&setup.t_rig_kinect, &config.roi);
        self.time_offset = setup.time_offset;
    }

    /// Its source's state changed.
    pub(crate) fn source(&mut self, state: SourceState) {
        self.vitals.source(state);
        if state == SourceState::Opened {
            self.frozen.reopened();
        }
    }

    /// Takes one frame.
    pub(crate) fn frame(&mut self, frame: Frame<'_>, arrived: RigNs, spare: &mut Vec<RigCloud>, workers: &Workers) {
        self.vitals.datum(arrived, frame.bytes.len());
        // A frame that is shed is compared all the same: a device does not thaw because this machine is busy.
        let (shed, repeats) = (self.shedding.covers(true), self.repeats(frame));
        if shed || repeats {
            return;
        }
        let Some((t, sigma, basis)) = self.time(frame.ticks, arrived) else { return };
        if self.passed.is_some_and(|passed| t < passed) {
            self.reordered += 1;
            return;
        }
        let outcome = decode_metres(frame.encoding, frame.bytes, frame.lost, &self.table, &mut self.depth);
        self.counts.add(&outcome);
        let loss = match outcome {
            Ok(loss) => loss,
            Err(error) => return self.notice_refusal(frame.encoding, &error.to_string()),
        };
        let mut scan = self.spare.pop().unwrap_or_default();
        scan.loss = loss;
        self.projector.points(&self.depth, &mut scan.points);
        let mut rig = spare.pop().unwrap_or_default();
        self.placement.apply([scan.points.x(), scan.points.y(), scan.points.z()], &mut rig, workers);
        self.points.decoded += scan.points.len() as u64;
        self.points.in_epochs += scan.points.len() as u64;
        self.kinect.points_in_roi = rig.points_in_roi() as u64;
        self.passed = Some(if basis == TimeBasis::Device(ClockState::Locked) { t + NEXT_AFTER } else { t });
        let sensor = self.id.clone();
        let scan = Scan::Kinect(scan);
        self.ready.push(Epoch { number: 0, sensor, t, span: (t, t), sigma, basis, arrived, scan, rig });
    }

    /// No later epoch will have an earlier time.
    pub(crate) fn watermark(&self) -> Option<RigNs> {
        self.passed
    }

    /// The frames since the last call, as epochs.
    pub(crate) fn epochs(&mut self) -> std::vec::Drain<'_, Epoch> {
        self.ready.drain(..)
    }

    /// Buffers of an epoch that is no longer needed.
    pub(crate) fn recycle(&mut self, scan: KinectScan) {
        if self.spare.len() < 4 {
            self.spare.push(scan);
        }
    }

    /// What happened since the last call.
    pub(crate) fn remarks(&mut self) -> std::vec::Drain<'_, Remark> {
        self.remarks.drain(..)
    }

    /// So many seconds are over since the last call.
    pub(crate) fn seconds(&mut self, seconds: i64) {
        self.vitals.seconds(seconds);
        self.refused_before = self.counts.refused();
    }

    /// What it was doing at `t`.
    pub(crate) fn state(&self, t: RigNs) -> SensorState {
        let lately = self.vitals.newest.is_some_and(|newest| t - newest <= FROZEN_STANDS);
        match self.vitals.state(t) {
            state if self.is_frozen && (lately || state == SensorState::Live) => SensorState::Fault,
            state => state,
        }
    }

    /// Its health at `t`, given everything that arrived before.
    pub(crate) fn health(&self, t: RigNs) -> SensorHealth {
        let counts = [
            (length_of(DepthEncoding::Packed11), self.counts.wrong_length_packed11),
            (length_of(DepthEncoding::Raw11), self.counts.wrong_length_raw11),
            (length_of(DepthEncoding::Mm16), self.counts.wrong_length_mm16),
        ];
        let malformed = counts.into_iter().filter(|(_, n)| *n > 0).map(|(name, n)| (name.to_owned(), n));
        let timed = self.clock_began;
        SensorHealth {
            id: self.id.to_string(),
            kind: SensorKind::Kinect,
            state: self.state(t),
            received: self.vitals.received,
            bytes: self.vitals.bytes,
            rate_hz: self.vitals.rate_hz(),
            age_ns: age_ns(t, self.vitals.newest),
            lost: self.vitals.lost.summed(),
            malformed: malformed.collect::<BTreeMap<_, _>>(),
            malformed_first: self.refused_first.iter().map(|(kind, why)| ((*kind).to_owned(), why.clone())).collect(),
            duplicates: self.kinect.repeated,
            reordered: self.reordered,
            points: self.points,
            epochs: EpochHealth { shed_scans: self.shedding.scans(), ..EpochHealth::default() },
            clock: timed.then(|| self.clock.report(t).into()),
            lidar: None,
            kinect: Some(KinectHealth {
                frames_with_loss: self.counts.frames_with_loss,
                lost_pixels: self.counts.lost_pixels,
                ..self.kinect
            }),
            turntable: None,
        }
    }

    /// Whether the frame is the one before it once more.
    fn repeats(&mut self, frame: Frame<'_>) -> bool {
        let freshness = self.frozen.observe(frame.ticks, frame.encoding, frame.bytes);
        let repeats = matches!(freshness, Freshness::Repeated { .. } | Freshness::Frozen { .. });
        self.is_frozen = matches!(freshness, Freshness::Frozen { .. });
        self.kinect.repeated += u64::from(repeats);
        self.kinect.repeated_in_a_row = if repeats { self.kinect.repeated_in_a_row + 1 } else { 0 };
        repeats
    }

    /// The time of a frame; `None`: it cannot be told.
    fn time(&mut self, ticks: Option<KinectTicks>, arrived: RigNs) -> Option<(RigNs, Span, TimeBasis)> {
        let Some(ticks) = ticks else {
            let sigma = DeviceClockKind::Kinect.parameters().arrival_sigma_ns;
            return Some((arrived - self.time_offset, Span(sigma), TimeBasis::Arrival));
        };
        let pushed = self.clock.push(ticks.0, arrived);
        if pushed == Pushed::NewEpoch && core::mem::replace(&mut self.clock_began, true) {
            let message = format!("the clock of {} began anew: its times are being found again", self.id);
            self.remarks.push((NoticeKind::ClockReset, Gravity::Warn, message));
        }
        if pushed == Pushed::Doubtful {
            return None;
        }
        let mapped = self.clock.map(ticks.0)?;
        Some((mapped.t - self.time_offset, mapped.sigma, TimeBasis::Device(mapped.state)))
    }

    /// Tells of the first frame in a second that could not be read.
    fn notice_refusal(&mut self, encoding: DepthEncoding, error: &str) {
        self.refused_first.entry(length_of(encoding)).or_insert_with(|| error.to_owned());
        if self.counts.refused() == self.refused_before + 1 {
            let message = format!("{}: a frame could not be read: {error}", self.id);
            self.remarks.push((NoticeKind::Malformed, Gravity::Warn, message));
        }
    }
}

/// What is wrong with a refused frame, in a word: each encoding has one length.
const fn length_of(encoding: DepthEncoding) -> &'static str {
    match encoding {
        DepthEncoding::Packed11 => "packed11_length",
        DepthEncoding::Raw11 => "raw11_length",
        DepthEncoding::Mm16 => "mm16_length",
    }
}

//! The mapper: one device's stamps in, times out.

use super::estimator::{Estimator, Found, Lock};
use super::hull::Pair;
use super::kind::{ClockParameters, DeviceClockKind};
use super::report::{ClockCounts, ClockMode, ClockReport, ClockState, Mapped, Pushed};
use super::timeline::Timeline;
use super::unwrap::{Counter, Step};
use tumbled_model::{RigNs, Span};
use tumbled_velodyne::position::Pps;

const S: i64 = 1_000_000_000;

/// Without a usable stamp for longer, the line is only extrapolated.
const HOLDOVER_AFTER: i64 = S;
/// So much data after a holdover make it locked again.
const RELOCK_AFTER: i64 = S / 2;
/// Without a usable stamp for longer, the next begins an epoch.
const LOST_AFTER: i64 = 5 * S;
/// A silence whose length by the device's counter and by the host differ by more was a restart.
const SILENCE_MISMATCH: i64 = S;
/// So many doubtful stamps in a row that agree with each other are the device's new clock. One forged or broken packet
/// does not move it.
const DOUBT_RUN: u32 = 3;
/// So many position packets on end have to say that the pulse's state is another. One forged or broken packet changes
/// nothing; the sensor says it again within a tenth of a second.
const PPS_RUN: u32 = 2;
/// An epoch that began so shortly before the pulse's change is told has begun for it: position packets come ten times a
/// second or more often.
const SAME_INCIDENT: i64 = S / 2;
/// How far from the newest stamp others are mapped: as far as reordering goes, and a LiDAR's pause of 50 ms.
const MAP_REACH: i64 = S;
/// What extrapolation adds to the uncertainty: crystals drift by about 1 ppm over minutes.
const HOLDOVER_DRIFT: f64 = 1e-6;

/// Why an epoch ended.
#[derive(Clone, Copy, Debug)]
enum Cause {
    Device,
    Gap,
    Pps,
    Reanchor,
}

/// Where an epoch's device time starts.
#[derive(Clone, Copy, Debug)]
struct Epoch {
    counter: Counter,
    first_ticks: i64,
    first_arrived: RigNs,
}

/// Stamps that contradict the clock but agree with each other.
#[derive(Clone, Copy, Debug)]
struct Doubt {
    raw: u32,
    arrived: RigNs,
    run: u32,
}

/// Maps one device's raw stamps to the rig's timeline.
///
/// Push every packet's or frame's stamp with its arrival, then map it, and whatever other stamps lie near it. Memory is
/// allocated once (about 330 kB); a push costs well under a microsecond on average. The same pushes and maps give the
/// same results to the bit.
///
/// Times never run backwards: of two ticks, the later one gets no earlier time, whatever the arrivals say, across
/// resets too ([`ClockMode::Arrival`] promises it only for ticks mapped in order).
///
/// ```
/// use tumbled_core::clock::{ClockMode, ClockState, DeviceClock, DeviceClockKind};
/// use tumbled_model::{RigNs, Span};
///
/// let mut clock = DeviceClock::new(DeviceClockKind::Kinect, ClockMode::Hull);
/// for frame in 0..90 {
///     // Every other frame is 4 ms late; the clock is not.
///     let late = if frame % 2 == 0 { Span::from_micros(4_000) } else { Span(0) };
///     clock.push(frame * 2_000_000, RigNs(i64::from(frame) * 100_000_000 / 3) + late);
/// }
/// let mapped = clock.map(88 * 2_000_000).expect("near the newest stamp");
/// assert_eq!(mapped.state, ClockState::Locked);
/// assert!((mapped.t - RigNs(8_800_000_000 / 3)).0.abs() < 1_000);
/// ```
#[derive(Clone, Debug)]
pub struct DeviceClock {
    kind: DeviceClockKind,
    mode: ClockMode,
    epoch: Option<Epoch>,
    estimator: Estimator,
    timeline: Timeline,
    /// Arrival of the newest usable stamp.
    last_arrived: RigNs,
    doubt: Option<Doubt>,
    behind_run: u32,
    /// A reset that waits for the next stamp; until then the old line serves.
    pending: Option<Cause>,
    /// Device time at which a holdover ends.
    relocks_at: Option<i64>,
    pps: Option<Pps>,
    /// Another state of the pulse, and how often on end it was told.
    other_pps: Option<(Pps, u32)>,
    counts: ClockCounts,
}

impl DeviceClock {
    /// A clock that knows nothing yet.
    pub fn new(kind: DeviceClockKind, mode: ClockMode) -> Self {
        Self {
            kind,
            mode,
            epoch: None,
            estimator: Estimator::new(mode, kind.parameters()),
            timeline: Timeline::new(),
            last_arrived: RigNs(0),
            doubt: None,
            behind_run: 0,
            pending: None,
            relocks_at: None,
            pps: None,
            other_pps: None,
            counts: ClockCounts::default(),
        }
    }

    /// Learns from one stamp and the instant the host had it.
    pub fn push(&mut self, raw: u32, arrived: RigNs) -> Pushed {
        self.counts.pushed += 1;
        if self.kind == DeviceClockKind::Velodyne && i64::from(raw) >= self.parameters().wrap {
            self.counts.raw_over_hour += 1;
        }
        let Some(epoch) = self.epoch else {
            return self.begin(raw, arrived);
        };
        if let Some(cause) = self.pending.take() {
            return self.reset(cause, raw, arrived);
        }
        let silence = arrived.0.saturating_sub(self.last_arrived.0);
        if silence > LOST_AFTER {
            return self.reset(self.cause_of_silence(&epoch, raw, silence), raw, arrived);
        }
        match epoch.counter.step(raw) {
            Step::Same => {
                self.counts.duplicates += 1;
                Pushed::Duplicate
            }
            Step::Behind(_) => self.fall_behind(raw, arrived),
            Step::Jump => self.doubt(raw, arrived),
            Step::Ahead(ticks) => self.advance(epoch, raw, ticks, arrived, silence),
        }
    }

    /// The time of a stamp; `None` before any was pushed and for stamps more than 1 s from the newest usable one.
    ///
    /// Takes `&mut self` because later results must respect this one.
    pub fn map(&mut self, raw: u32) -> Option<Mapped> {
        let epoch = self.epoch.as_ref()?;
        let ticks = epoch.counter.shortest(raw);
        if self.parameters().ns(ticks).saturating_abs() > MAP_REACH {
            return None;
        }
        let x = self.device_time(epoch, ticks);
        let t = self.timeline.hand_out(x);
        let sigma = Span(self.estimator.sigma()) + self.timeline.slewing(x);
        Some(Mapped { t, sigma, state: self.state() })
    }

    /// Takes note of what the sensor says of its pulse input. A change that is told twice on end begins an epoch, since
    /// the counter may have been set with it, unless its stamps have just begun one by themselves.
    pub fn note_pps(&mut self, pps: Pps) {
        if self.pps == Some(pps) {
            self.other_pps = None;
            return;
        }
        let run = self.other_pps.filter(|(other, _)| *other == pps).map_or(1, |(_, run)| run + 1);
        self.other_pps = (run < PPS_RUN).then_some((pps, run));
        if run < PPS_RUN {
            return;
        }
        let begun = self.epoch.map_or(0, |epoch| self.last_arrived.0.saturating_sub(epoch.first_arrived.0));
        if self.pps.replace(pps).is_some() && begun > SAME_INCIDENT {
            self.pending = Some(Cause::Pps);
        }
    }

    /// The host's receive stamps were anchored anew (its wall clock stepped): arrivals before and after do not compare.
    pub fn reanchor(&mut self) {
        self.pending = Some(Cause::Reanchor);
    }

    /// The clock's state at `now`, which is used for silence alone.
    pub fn report(&self, now: RigNs) -> ClockReport {
        let age = self.epoch.map(|_| Span(now.0.saturating_sub(self.last_arrived.0).max(0)));
        let silence = age.map_or(i64::MAX, |age| age.0);
        let state = match self.state() {
            _ if silence > LOST_AFTER => ClockState::Lost,
            ClockState::Locked if silence > HOLDOVER_AFTER => ClockState::Holdover,
            state => state,
        };
        let (mut offset, mut slewing) = (Span(0), Span(0));
        if let Some(epoch) = &self.epoch {
            let x = self.device_time(epoch, 0);
            offset = Span(self.timeline.at(x).0.saturating_sub(self.parameters().ns(epoch.counter.total())));
            slewing = self.timeline.slewing(x);
        }
        let drift = age.map_or(Span(0), |age| Span((age.0 as f64 * HOLDOVER_DRIFT) as i64));
        let (pairs, window) = self.estimator.window();
        ClockReport {
            kind: self.kind,
            mode: self.mode,
            state,
            offset,
            skew_ppm: self.estimator.line().slope * 1e6,
            sigma: Span(self.estimator.sigma()) + slewing + drift,
            window: Span(window),
            pairs: pairs as u64,
            age,
            pps: self.pps,
            counts: ClockCounts { steps: self.timeline.steps(), held: self.timeline.held(), ..self.counts },
        }
    }

    fn parameters(&self) -> &'static ClockParameters {
        self.kind.parameters()
    }

    fn state(&self) -> ClockState {
        match self.estimator.lock() {
            Lock::Acquiring => ClockState::Acquiring,
            Lock::Suspect => ClockState::Suspect,
            Lock::Locked if self.relocks_at.is_some() => ClockState::Holdover,
            Lock::Locked => ClockState::Locked,
        }
    }

    /// Device time since the epoch's start, `ticks` after the newest stamp, ns.
    fn device_time(&self, epoch: &Epoch, ticks: i64) -> i64 {
        let total = epoch.counter.total().saturating_add(ticks);
        self.parameters().ns(total.saturating_sub(epoch.first_ticks))
    }

    fn begin(&mut self, raw: u32, arrived: RigNs) -> Pushed {
        let counter = Counter::new(self.parameters().wrap, self.parameters().hz, raw);
        self.epoch = Some(Epoch { counter, first_ticks: counter.total(), first_arrived: arrived });
        self.estimator.begin();
        self.timeline.begin(arrived, self.estimator.line());
        self.last_arrived = arrived;
        self.doubt = None;
        self.behind_run = 0;
        self.relocks_at = None;
        Pushed::NewEpoch
    }

    fn reset(&mut self, cause: Cause, raw: u32, arrived: RigNs) -> Pushed {
        let resets = &mut self.counts.resets;
        match cause {
            Cause::Device => resets.device += 1,
            Cause::Gap => resets.gap += 1,
            Cause::Pps => resets.pps += 1,
            Cause::Reanchor => resets.reanchor += 1,
        }
        self.begin(raw, arrived)
    }

    /// After a silence the arrivals decide how often the counter wrapped; if it is far off even so, it was restarted.
    fn cause_of_silence(&self, epoch: &Epoch, raw: u32, silence: i64) -> Cause {
        let counted = self.parameters().ns(epoch.counter.across_silence(raw, silence));
        if counted.saturating_sub(silence).saturating_abs() > SILENCE_MISMATCH { Cause::Device } else { Cause::Gap }
    }

    fn advance(&mut self, mut epoch: Epoch, raw: u32, ticks: i64, arrived: RigNs, silence: i64) -> Pushed {
        let x = self.device_time(&epoch, ticks);
        let y = arrived.0.saturating_sub(epoch.first_arrived.0).saturating_sub(x);
        let pair = Pair { x, y };
        if self.estimator.too_early(pair) {
            return self.doubt(raw, arrived);
        }
        epoch.counter.advance(raw, ticks);
        self.epoch = Some(epoch);
        self.last_arrived = self.last_arrived.max(arrived);
        self.doubt = None;
        self.behind_run = 0;
        if silence > HOLDOVER_AFTER {
            self.relocks_at = Some(x.saturating_add(RELOCK_AFTER));
        } else if self.relocks_at.is_some_and(|relocks_at| x >= relocks_at) {
            self.relocks_at = None;
        }
        match self.estimator.push(pair) {
            Found::Nothing => {}
            Found::Line { at_once } => self.timeline.adopt(self.estimator.line(), at_once),
            Found::Astray => self.pending = Some(Cause::Device),
        }
        Pushed::InOrder
    }

    fn fall_behind(&mut self, raw: u32, arrived: RigNs) -> Pushed {
        self.behind_run += 1;
        if self.behind_run >= self.parameters().reorder_run {
            return self.reset(Cause::Device, raw, arrived);
        }
        self.counts.reordered += 1;
        Pushed::Reordered
    }

    fn doubt(&mut self, raw: u32, arrived: RigNs) -> Pushed {
        let agrees = self.doubt.is_some_and(|before| {
            let before_counter = Counter::new(self.parameters().wrap, self.parameters().hz, before.raw);
            let Step::Ahead(ticks) = before_counter.step(raw) else { return false };
            let waited = arrived.0.saturating_sub(before.arrived.0);
            self.parameters().ns(ticks).saturating_sub(waited).saturating_abs() <= SILENCE_MISMATCH
        });
        let run = if agrees { self.doubt.map_or(1, |before| before.run + 1) } else { 1 };
        if run >= DOUBT_RUN {
            return self.reset(Cause::Device, raw, arrived);
        }
        self.doubt = Some(Doubt { raw, arrived, run });
        self.counts.doubtful += 1;
        Pushed::Doubtful
    }
}

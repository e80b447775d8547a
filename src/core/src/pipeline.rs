//! The core: one event in, what follows from it out.
//!
//! ```text
//!   Event ─┬─ LidarPacket ─▶ LidarChannel ──┐
//!          ├─ DepthFrame ──▶ KinectChannel ─┼─ epochs ─▶ Aligner ─▶ Outputs::epochs ─▶ Estimator ─▶ Outputs::states
//!          ├─ SerialChunk ─▶ TurntableChannel ─ samples ──────────▶ Outputs::turntable
//!          ├─ Tick ────────▶ Beat ──────────┴─ states, health ────▶ Outputs::{notices, health}
//!          └─ Anchor, Command, Config
//! ```

use crate::align::Aligner;
use crate::beat::{self, Beat, Pulse, Steps};
use crate::boundary::ScanBoundaries;
use crate::channel::Channels;
use crate::clock::WallClock;
use crate::config::CoreConfig;
use crate::epoch::{Epoch, RigCloud};
use crate::estimate::{EstimateHealth, Estimator, KeptFrame, NamedPoint, Predictor, Standing, TargetState};
use crate::health::{CoreHealth, EpochHealth, Judge, SensorHealth, SensorState, WallHealth, worst};
use crate::notice::{Gravity, Notice, NoticeKind, Waiting};
use crate::reasons::Observer;
use crate::track::Tracker;
use crate::turntable::{ErrorWatch, TurntableErrors, TurntableSample};
use crate::ukf::SensorPrior;
use crate::workers::Workers;
use nalgebra::Vector3;
use tumbled_model::{Body, Command, Event, RigNs, SensorId, Span};

/// What the core gives out. Kept by the caller and cleared between steps: its buffers are used again.
#[derive(Debug, Default)]
pub struct Outputs {
    /// Epochs, in their order.
    pub epochs: Vec<Epoch>,
    /// The target after each of the epochs, in the same order.
    pub states: Vec<TargetState>,
    /// What can be said of the times after each of the epochs, in the same order.
    pub predictors: Vec<Predictor>,
    /// Things that happened, in the order of their times.
    pub notices: Vec<Notice>,
    /// Health, once a second of the session's time.
    pub health: Vec<CoreHealth>,
    /// Where turntables were, each turntable's in their order.
    pub turntable: Vec<TurntableSample>,
    /// Frames that show the target, if they were asked for: [`Pipeline::keep_frames`].
    pub kept: Vec<KeptFrame>,
    /// Epochs that are no longer needed.
    done: Vec<Epoch>,
}

impl Outputs {
    /// Forgets what was given out; its memory goes back to the core at the next step.
    pub fn clear(&mut self) {
        self.done.append(&mut self.epochs);
        self.states.clear();
        self.predictors.clear();
        self.notices.clear();
        self.health.clear();
        self.turntable.clear();
        self.kept.clear();
    }
}

/// Session-wide notices come behind those of the sensors of the same time.
const SESSION: usize = usize::MAX;

/// All state of the core. The same events give the same outputs to the bit, whatever the machine and its threads; events
/// of different sensors may also lie among each other as they like, as long as none is more than 0.2 s out of order.
#[derive(Debug)]
pub struct Pipeline {
    config: CoreConfig,
    channels: Channels,
    boundaries: ScanBoundaries,
    aligner: Aligner,
    estimator: Estimator,
    standing: Standing,
    beat: Beat,
    states: Vec<SensorState>,
    observer: Observer,
    judge: Judge,
    errors: ErrorWatch,
    /// Those of the newest health.
    told_errors: Option<TurntableErrors>,
    notices: Waiting,
    wall: WallClock,
    workers: Workers,
    spare: Vec<RigCloud>,
    unknown: Vec<SensorId>,
    /// The newest arrival: the time of what happens to the session as a whole.
    now: RigNs,
}

impl Pipeline {
    /// A core that has seen nothing yet.
    pub fn new(config: CoreConfig, workers: Workers) -> Self {
        let channels = Channels::new(&config);
        let sensors = channels.len();
        let mut errors = ErrorWatch::default();
        errors.set_axis(config.turntable_axis);
        Self {
            boundaries: ScanBoundaries::new(&config),
            aligner: Aligner::new(sensors, config.kinects.len() + config.lidars.len(), config.timing.hold),
            estimator: Estimator::new(&config),
            standing: Standing::default(),
            beat: Beat::new(sensors),
            states: vec![SensorState::Absent; sensors],
            observer: Observer::default(),
            judge: Judge::default(),
            errors,
            told_errors: None,
            notices: Waiting::default(),
            wall: WallClock::new(),
            workers,
            spare: Vec::new(),
            unknown: Vec::new(),
            now: RigNs(0),
            channels,
            config,
        }
    }

    /// Takes over a changed config: mountings, offsets, region of interest, timing. Sensors are neither added nor taken
    /// away, and none changes its model: these need a new session.
    pub fn configure(&mut self, config: CoreConfig) {
        self.channels.configure(&config);
        self.boundaries = ScanBoundaries::new(&config);
        self.aligner.set_hold(config.timing.hold);
        self.errors.set_axis(config.turntable_axis);
        let forgot = self.estimator.configure(&config);
        self.config = config;
        if forgot {
            let message = "the background is forgotten, for a sensor stands elsewhere: let it be learned again";
            self.note_session(NoticeKind::Background, Gravity::Warn, message.to_owned());
        }
        self.note_session(NoticeKind::Configured, Gravity::Info, "the config was changed".to_owned());
    }

    /// Consumes one event and appends what it produced. Never blocks, never fails: bad input becomes a count.
    pub fn step(&mut self, event: &Event, out: &mut Outputs) {
        self.reclaim(out);
        self.now = self.now.max(event.arrived);
        let begins_scan = self.boundaries.begins(&event.body);
        if let Some(sensor) = event.body.sensor() {
            match self.channels.find(sensor) {
                Some(channel) => {
                    self.feed(channel, event, begins_scan);
                    let known = out.turntable.len();
                    self.channels.samples(channel, &mut out.turntable);
                    let of_first = |sample: &&TurntableSample| {
                        self.config.turntables.first().is_some_and(|first| first.id == sample.sensor)
                    };
                    let fresh = out.turntable.iter().skip(known).filter(of_first);
                    fresh.for_each(|sample| self.errors.angle(sample));
                }
                None => self.note_unknown(sensor, event.arrived),
            }
        }
        match &event.body {
            Body::Anchor { unix } => self.anchor(event.arrived, *unix),
            Body::Tick => self.tick(event.arrived, out),
            Body::Command(Command::Marker { text }) => {
                self.note(SESSION, event.arrived, NoticeKind::Marker, Gravity::Info, format!("marker: {text}"));
            }
            Body::Command(command) => self.estimator.order(event.arrived, command),
            _ => {}
        }
        self.aligner.release(&mut out.epochs, &mut out.done);
        self.estimate(out);
    }

    /// The ledger has ended: gives out what was waiting for more.
    pub fn finish(&mut self, out: &mut Outputs) {
        self.reclaim(out);
        for instant in self.beat.left(self.now) {
            self.aligner.judge(beat::time(instant), &mut out.epochs, &mut out.done);
        }
        for channel in 0..self.channels.len() {
            self.channels.finish(channel);
            self.collect(channel, self.now, false);
        }
        self.aligner.finish(&mut out.epochs, &mut out.done);
        self.estimate(out);
        self.notices.release(RigNs(i64::MAX), &mut out.notices);
    }

    /// Wall time at `t`, by the ledger's anchors.
    pub fn wall(&self) -> &WallClock {
        &self.wall
    }

    /// What the estimation says of itself after an epoch: of the newest, whose state this is.
    pub fn estimate_health(&self, state: &TargetState) -> EstimateHealth {
        self.estimator.health(state, self.standing.since().unwrap_or(state.t))
    }

    /// From here on frames that show the target are given out, for whoever makes a surface of them. Changes no other output.
    pub fn keep_frames(&mut self) {
        self.estimator.keep_frames();
    }

    /// The model of the target and what is known of beams, after the newest epoch. `None`: there is no target.
    pub fn tracker(&self) -> Option<&Tracker> {
        self.estimator.tracker()
    }

    /// The same with the target's number in the session.
    pub fn model(&self) -> Option<(u32, &Tracker)> {
        Some((self.targets(), self.tracker()?))
    }

    /// What the estimation believes of the sensors for a target at `center`, rig frame, m: in the order of the kept frames'
    /// sensor numbers.
    pub fn sensor_priors(&self, center: &Vector3<f64>) -> Vec<SensorPrior> {
        self.estimator.sensor_priors(center)
    }

    /// How many targets were begun so far: the number of the newest, whose model [`Pipeline::tracker`] gives. 0: none was.
    pub fn targets(&self) -> u32 {
        self.estimator.targets()
    }

    /// The target's points whose motion is to be told.
    pub fn points(&self) -> &[NamedPoint] {
        &self.config.estimate.points
    }

    /// The counts and states of every sensor as of everything seen so far, not waiting for anything; a turntable's errors
    /// are those of the newest health.
    pub fn sensors(&self) -> Vec<SensorHealth> {
        let at = RigNs(self.now.0.saturating_add(1));
        let mut sensors: Vec<SensorHealth> =
            (0..self.channels.len()).filter_map(|channel| self.channels.health(channel, at)).collect();
        self.tell_errors(&mut sensors);
        sensors
    }

    /// The target after every epoch that was given out since.
    fn estimate(&mut self, out: &mut Outputs) {
        let (epochs, states) = (&out.epochs, &mut out.states);
        let mut told = Vec::new();
        for epoch in epochs.get(states.len()..).unwrap_or_default() {
            let state = self.estimator.take(epoch, &self.workers, &mut told);
            out.predictors.push(self.estimator.predictor(&state));
            self.standing.take(&state);
            if !self.config.turntables.is_empty() {
                self.errors.state(&state);
            }
            states.push(state);
        }
        out.kept.extend(self.estimator.kept());
        for (kind, gravity, message) in told {
            self.note_session(kind, gravity, message);
        }
    }

    /// Lets a sensor's channel have its event, and passes its epochs on.
    fn feed(&mut self, channel: usize, event: &Event, begins_scan: bool) {
        if let Some(steps) = self.beat.steps_over(channel, event.arrived) {
            self.step_over(channel, event.arrived, &steps);
        }
        let before = self.channels.shed_scans(channel);
        self.channels.take(channel, event, begins_scan, &self.config, &mut self.spare, &self.workers);
        if self.channels.shed_scans(channel) > before && before == 0 {
            let message = format!(
                "{}: this machine cannot keep up and sheds whole scans; they are recorded all the same",
                self.channels.id(channel)
            );
            self.note(channel, event.arrived, NoticeKind::Shedding, Gravity::Warn, message);
        }
        for (kind, gravity, message) in self.channels.remarks(channel) {
            let sensor = Some(self.channels.id(channel).clone());
            self.notices.push(channel, Notice { t: event.arrived, sensor, gravity, kind, message });
        }
        self.collect(channel, event.arrived, false);
    }

    /// Keeps what a sensor was like at the instants that its event is the first to step over.
    fn step_over(&mut self, channel: usize, arrived: RigNs, steps: &Steps) {
        if !self.channels.may_come(channel, beat::time(steps.newest), self.config.timing.silent_after) {
            self.aligner.returns(channel, arrived, beat::time(steps.newest + 1));
        }
        for instant in steps.unjudged.clone() {
            let pulse = self.pulse(channel, instant);
            self.beat.keep(channel, instant, pulse);
        }
    }

    /// Hands a channel's epochs and its watermark to the aligner; `by` is the arrival or the instant that completed them.
    fn collect(&mut self, channel: usize, by: RigNs, is_silent: bool) {
        let (channels, aligner) = (&mut self.channels, &mut self.aligner);
        channels.epochs(channel, &mut self.spare, &self.workers, |epoch| aligner.offer(channel, epoch, by, is_silent));
        aligner.pass(channel, channels.watermark(channel));
    }

    fn anchor(&mut self, arrived: RigNs, unix: tumbled_model::UnixNs) {
        if let Some(Span(step)) = self.wall.anchor(arrived, unix) {
            let seconds = step as f64 * 1e-9;
            let message = format!(
                "the host's wall clock was set by {seconds:+.6} s: measurement times do not change, wall times do from here on"
            );
            self.note(SESSION, arrived, NoticeKind::WallStep, Gravity::Warn, message);
        }
    }

    /// Judges every instant that this tick lets be judged.
    fn tick(&mut self, arrived: RigNs, out: &mut Outputs) {
        while let Some(instant) = self.beat.due(arrived) {
            let t = beat::time(instant);
            let mut healths = Vec::new();
            for channel in 0..self.channels.len() {
                let pulse = match self.beat.take(channel, instant) {
                    Some(kept) => kept,
                    None => self.pulse(channel, instant),
                };
                self.judge_state(channel, t, &pulse);
                healths.extend(pulse.health.map(|health| *health));
            }
            self.aligner.judge(t, &mut out.epochs, &mut out.done);
            self.notices.release(t, &mut out.notices);
            if beat::is_second(instant) && instant > 0 {
                out.health.push(self.health(t, healths));
            }
        }
    }

    /// A sensor just before an instant that none of its events has stepped over yet; at whole seconds with its health.
    fn pulse(&mut self, channel: usize, instant: i64) -> Pulse {
        let t = beat::time(instant);
        let may_come = self.channels.may_come(channel, t, self.config.timing.silent_after);
        self.channels.silence(channel, t);
        self.collect(channel, t, !may_come);
        let health = beat::is_second(instant).then_some(()).and_then(|()| {
            self.channels.begin_second(channel, instant);
            self.channels.health(channel, t).map(Box::new)
        });
        Pulse { state: self.channels.state(channel, t), may_come, health }
    }

    fn judge_state(&mut self, channel: usize, t: RigNs, pulse: &Pulse) {
        self.aligner.set_silent(channel, !pulse.may_come);
        let Some(state) = self.states.get_mut(channel) else { return };
        let before = core::mem::replace(state, pulse.state);
        if before != pulse.state {
            let id = self.channels.id(channel).clone();
            let message = format!("{id} is {} (was {})", pulse.state.name(), before.name());
            // It shows at the instant, and instants are released up to their own time.
            self.note(channel, RigNs(t.0 - 1), NoticeKind::SensorState, pulse.state.gravity(), message);
        }
    }

    fn health(&mut self, t: RigNs, mut sensors: Vec<SensorHealth>) -> CoreHealth {
        for (channel, sensor) in sensors.iter_mut().enumerate() {
            let counts = self.aligner.counts_before(t - Span(1_000_000_000), channel);
            sensor.epochs = EpochHealth {
                given_out: counts.epochs,
                late: counts.late,
                joining: counts.joining,
                points_left_out: counts.points_left_out,
                shed_scans: sensor.epochs.shed_scans,
            };
        }
        self.told_errors = self.errors.errors(t);
        self.tell_errors(&mut sensors);
        let reasons = self.judge.judge(self.observer.observe(&sensors));
        let wall = WallHealth {
            unix_ns: self.wall.unix(t).map(|unix| unix.0.to_string()),
            steps: self.wall.steps_until(t),
            last_step_ns: self.wall.last_step_until(t).map(|step| step.0),
        };
        CoreHealth { t_ns: t.0, level: worst(&reasons), reasons, sensors, wall }
    }

    /// To the first turntable: the one that the target stands on.
    fn tell_errors(&self, sensors: &mut [SensorHealth]) {
        if let Some(turntable) = sensors.iter_mut().find_map(|sensor| sensor.turntable.as_mut()) {
            turntable.errors = self.told_errors;
        }
    }

    /// Takes the buffers of epochs that the caller is done with.
    fn reclaim(&mut self, out: &mut Outputs) {
        for epoch in out.done.drain(..) {
            let Epoch { sensor, scan, rig, .. } = epoch;
            if self.spare.len() < 8 {
                self.spare.push(rig);
            }
            if let Some(channel) = self.channels.find(&sensor) {
                self.channels.recycle(channel, scan);
            }
        }
    }

    fn note_unknown(&mut self, sensor: &SensorId, arrived: RigNs) {
        if !self.unknown.contains(sensor) && self.unknown.len() < 16 {
            self.unknown.push(sensor.clone());
            let message = format!("there are data of {sensor}, which the config does not have: they are not used");
            self.note(SESSION, arrived, NoticeKind::UnknownSensor, Gravity::Warn, message);
        }
    }

    fn note_session(&mut self, kind: NoticeKind, gravity: Gravity, message: String) {
        self.note(SESSION, self.now, kind, gravity, message);
    }

    fn note(&mut self, source: usize, t: RigNs, kind: NoticeKind, gravity: Gravity, message: String) {
        let sensor = (source < self.channels.len()).then(|| self.channels.id(source).clone());
        self.notices.push(source, Notice { t, sensor, gravity, kind, message });
    }
}

//! A turntable of which everything is known, on a pseudo terminal that is plugged in and pulled out, and what a live
//! session makes of it.

use std::collections::VecDeque;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tumbled_core::turntable::{TruthState, TurntableHealth};
use tumbled_core::{
    CoreConfig, CoreHealth, Notice, NoticeKind, Outputs, Pipeline, SensorHealth, TurntableProtocol, TurntableSample,
    TurntableSetup, Workers,
};
use tumbled_io::live::{
    Ledger, LedgerHandle, PortName, PseudoTerminal, QueueBound, SerialConfig, SerialOpener, SerialProtocol,
    SessionClock, StopToken, Supervised, supervise,
};
use tumbled_model::{RigNs, Span};
use tumbled_sim::turntable::{
    EmulatorSettings, Latency, Mishaps, Outgoing, ScriptedStage, Stage, StageFault, StageMotion, StageState,
    ZaberEmulator,
};

use super::rig::lidar_core;

pub(crate) const TURNTABLE: &str = "turntable";
/// Counts of the emulated stage's turn.
pub(crate) const COUNTS_PER_TURN: f64 = 768_000.0;
/// So long is waited for what has to happen; a machine that is busy may take its time.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);
/// What the device takes over an answer.
const LATENCY: Latency = Latency { to_sample: Span(300_000), to_reply: Span(300_000) };
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// A stage that turns at an even rate, with its faults.
pub(crate) fn turning(rate_dps: f64, faults: Vec<StageFault>) -> ScriptedStage {
    let rate_rps = rate_dps.to_radians();
    let motion: StageMotion = Arc::new(move |t| StageState { angle_rad: rate_rps * t.0 as f64 * 1e-9, rate_rps });
    ScriptedStage::new(motion, faults)
}

/// How the device's end behaves.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Manners {
    /// What happens to replies.
    pub(crate) mishaps: Mishaps,
    /// Each reply in two writes, so long apart.
    pub(crate) split: Option<Duration>,
    /// After so many replies it says nothing more.
    pub(crate) mute_after: Option<u64>,
    /// It babbles: noise as fast as it is taken, and nothing else.
    pub(crate) babbles: bool,
}

/// A stage behind a port of a fixed name.
pub(crate) struct Port {
    link: PathBuf,
    stage: ScriptedStage,
    clock: SessionClock,
    plugged: Option<(StopToken, JoinHandle<()>)>,
}

impl Port {
    /// A stage that is not plugged in yet.
    pub(crate) fn new(link: PathBuf, stage: ScriptedStage, clock: &SessionClock) -> Self {
        Self { link, stage, clock: clock.clone(), plugged: None }
    }

    /// Plugs it in: a new pseudo terminal under the old name.
    pub(crate) fn plug(&mut self, manners: Manners) {
        let terminal = PseudoTerminal::open().expect("a pseudo terminal");
        symlink(terminal.path(), &self.link).expect("a link");
        let stop = StopToken::new().expect("a descriptor");
        let emulator = ZaberEmulator::new(EmulatorSettings::usual(1), Stage::Scripted(self.stage.clone()));
        let mut device =
            Device { terminal, emulator, manners, clock: self.clock.clone(), stop: stop.clone(), replies: 0 };
        let thread = std::thread::spawn(move || device.answer());
        self.plugged = Some((stop, thread));
    }

    /// Pulls it out; when.
    pub(crate) fn unplug(&mut self) -> RigNs {
        if let Some((stop, thread)) = self.plugged.take() {
            fs::remove_file(&self.link).expect("removes the link");
            stop.stop();
            thread.join().expect("no panic");
        }
        self.clock.now().rig
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        if let Some((stop, _)) = &self.plugged {
            stop.stop();
        }
    }
}

struct Device {
    terminal: PseudoTerminal,
    emulator: ZaberEmulator,
    manners: Manners,
    clock: SessionClock,
    stop: StopToken,
    replies: u64,
}

impl Device {
    fn answer(&mut self) {
        let mut answers = Vec::new();
        // Late ones are overtaken.
        let mut due: VecDeque<Outgoing> = VecDeque::new();
        while !self.stop.is_stopped() {
            if self.manners.babbles {
                // What nobody takes is lost, and the next try is a moment later.
                let taken = self.terminal.write(&[0xB5; 512]).expect("there");
                self.stop.wait(Duration::from_millis(u64::from(taken == 0)));
                continue;
            }
            if self.terminal.wait(if due.is_empty() { LOOK_EVERY } else { Duration::ZERO }, &self.stop).expect("waits")
            {
                let mut read = [0; 256];
                let n = self.terminal.read(&mut read).expect("there");
                self.emulator.receive(self.clock.now().rig, &read[..n], LATENCY, &mut answers);
            }
            for reply in answers.drain(..) {
                self.replies += 1;
                if self.manners.mute_after.is_some_and(|last| self.replies > last) {
                    continue;
                }
                due.extend(self.manners.mishaps.befall(self.replies, reply));
            }
            due.make_contiguous().sort_by_key(|reply| reply.at);
            self.send(&mut due);
        }
    }

    /// What is due; else a moment passes.
    fn send(&mut self, due: &mut VecDeque<Outgoing>) {
        let Some(next) = due.front() else { return };
        if next.at > self.clock.now().rig {
            std::thread::sleep(Duration::from_micros(100));
            return;
        }
        let bytes = due.pop_front().expect("it is there").bytes;
        let cut = if self.manners.split.is_some() { bytes.len() / 2 } else { 0 };
        let (first, rest) = bytes.split_at(cut);
        self.terminal.write(first).expect("there");
        self.stop.wait(self.manners.split.unwrap_or_default());
        self.terminal.write(rest).expect("there");
    }
}

/// What a session knows so far.
#[derive(Clone, Debug, Default)]
pub(crate) struct Known {
    pub(crate) samples: Vec<TurntableSample>,
    pub(crate) notices: Vec<Notice>,
    pub(crate) health: Vec<CoreHealth>,
}

impl Known {
    /// The turntable in the newest health.
    pub(crate) fn sensor(&self) -> Option<&SensorHealth> {
        self.health.last()?.sensors.iter().find(|sensor| sensor.id == TURNTABLE)
    }

    pub(crate) fn turntable(&self) -> Option<&TurntableHealth> {
        self.sensor()?.turntable.as_ref()
    }

    pub(crate) fn truth(&self) -> Option<TruthState> {
        self.turntable().map(|turntable| turntable.truth)
    }

    /// When a notice of that kind with that text came first after an instant, and its text.
    pub(crate) fn told(&self, kind: NoticeKind, text: &str, after: RigNs) -> Option<(RigNs, &str)> {
        let found = |notice: &&Notice| notice.kind == kind && notice.t > after && notice.message.contains(text);
        self.notices.iter().find(found).map(|notice| (notice.t, notice.message.as_str()))
    }
}

/// A live session with a turntable alone: source, ledger and core, each on its thread.
pub(crate) struct Session {
    known: Arc<Mutex<Known>>,
    stop: StopToken,
    running: Option<(Supervised, LedgerHandle, JoinHandle<()>)>,
}

impl Session {
    /// Begins to read the port of that name, whether it is there or not.
    pub(crate) fn start(port: &Path, clock: &SessionClock) -> Self {
        let stop = StopToken::new().expect("a descriptor");
        let mut ledger = Ledger::live(clock.clone());
        let intake = ledger.intake(TURNTABLE.into(), QueueBound::SERIAL_CHUNKS);
        let events = ledger.core(Box::new(|_| false));
        let known = Arc::new(Mutex::new(Known::default()));
        let told = Arc::clone(&known);
        let core = std::thread::spawn(move || {
            let mut pipeline = Pipeline::new(core(), Workers::none());
            let mut out = Outputs::default();
            for event in events {
                out.clear();
                pipeline.step(&event, &mut out);
                let mut known = told.lock().expect("no panic");
                known.samples.append(&mut out.turntable);
                known.notices.append(&mut out.notices);
                known.health.append(&mut out.health);
            }
        });
        let config = SerialConfig {
            sensor: TURNTABLE.into(),
            port: PortName::Path(port.to_owned()),
            protocol: SerialProtocol::Zaber,
            baud: 115_200,
            root: "/".into(),
        };
        let opener = Box::new(SerialOpener::new(config, clock.clone(), stop.clone()));
        let ledger = ledger.start().expect("a thread");
        let source = supervise(opener, None, intake, clock.clone(), stop.clone(), SerialOpener::BACKOFF, |_| {})
            .expect("a thread");
        Self { known, stop, running: Some((source, ledger, core)) }
    }

    /// Waits until something is known.
    pub(crate) fn wait_for<T>(&self, what: &str, mut find: impl FnMut(&Known) -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            let known = self.known.lock().expect("no panic");
            if let Some(found) = find(&known) {
                return found;
            }
            assert!(began.elapsed() < PATIENCE, "{what}: {:?} {:?}", known.notices, known.health.last());
            drop(known);
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits until the core has told that many more angles.
    pub(crate) fn more_samples(&self, n: usize) {
        let before = self.now_known().samples.len();
        self.wait_for("angles", |known| (known.samples.len() >= before + n).then_some(()));
    }

    pub(crate) fn now_known(&self) -> Known {
        self.known.lock().expect("no panic").clone()
    }

    /// How much processor time the source's thread has had.
    pub(crate) fn source_cpu(&self) -> Duration {
        let threads = fs::read_dir("/proc/self/task").expect("the threads").flatten();
        let mine = |folder: &PathBuf| {
            let name = fs::read_to_string(folder.join("comm")).unwrap_or_default();
            name.trim_end() == format!("rx-{TURNTABLE}")
        };
        let time = |folder: PathBuf| {
            let text = fs::read_to_string(folder.join("schedstat")).ok()?;
            text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
        };
        threads.map(|thread| thread.path()).filter(mine).filter_map(time).sum()
    }

    /// Ends it: how long that took, and all that was known.
    pub(crate) fn end(mut self) -> (Duration, Known) {
        let (source, ledger, core) = self.running.take().expect("runs");
        let began = Instant::now();
        self.stop.stop();
        source.join();
        let took = began.elapsed();
        ledger.stop();
        core.join().expect("no panic");
        (took, self.now_known())
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.stop.stop();
    }
}

fn core() -> CoreConfig {
    let setup = TurntableSetup {
        id: TURNTABLE.into(),
        protocol: TurntableProtocol::Zaber,
        baud: 115_200,
        counts_per_turn: None,
    };
    CoreConfig { lidars: Vec::new(), turntables: vec![setup], ..lidar_core() }
}

/// How far a sample is from where the stage was, degrees, and how far it may be: what it turns in half a round trip, a count,
/// and half of a byte's 87 µs, which a pseudo terminal's bytes do not take.
pub(crate) fn error_and_doubt_deg(sample: &TurntableSample, stage: &ScriptedStage) -> (f64, f64) {
    let truth = stage.table(sample.t);
    let error = (sample.angle_rad - truth.angle_rad).to_degrees().abs();
    let half_rtt = sample.half_rtt.expect("polled").as_secs_f64() + 44e-6;
    (error, truth.rate_rps.to_degrees().abs() * half_rtt + 360.0 / COUNTS_PER_TURN)
}

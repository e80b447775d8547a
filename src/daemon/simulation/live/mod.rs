//! A scene in real time: its sensors send when the session's clock reaches the instant of each packet and frame.
//!
//! ```text
//!   sim: Simulation ─▶ faults ─▶ up to 0.3 s ahead ─▶ sim-send ─┬─ UDP on loopback ─▶ rx-front ─▶ ledger
//!        (a pool shares the making)                             └─ intake (frames, chunks) ────▶ ledger
//!   sim-stage: the turntable's emulator on a pseudo terminal
//! ```
//!
//! The scene's time *is* the session's: the target is at `t_ns` where the scene has it then, and the stage answers with
//! the angle of that instant. So time is never shifted. Where this machine is too slow, data are left out, as if they had
//! been lost on the way, and counted: a stretch is not made when its time has come already, and what was made is not sent
//! when it is [`LATEST`] late. A pause is never made up for by a burst.
//!
//! * `ahead`: making, a little ahead of time; `sender`: sending in time; [`shortfall`]: what was left out.

mod ahead;
mod sender;
pub mod shortfall;

use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;

use tumbled_io::live::{Intake, SessionClock, StopToken, UdpSender};
use tumbled_model::{SensorId, Span, UnixNs};
use tumbled_sim::faults::{Action, Fault, FaultInjector, FaultScript, FaultTruth};
use tumbled_sim::scene::Scene;
use tumbled_sim::session::Simulation;
use tumbled_sim::turntable;

use super::stage::EmulatedStage;
use super::{faults, scenes};
use crate::cli::Failure;
use ahead::Ahead;
use sender::Sender;
use shortfall::{Shortfall, ShortfallReport};

/// Later than this nothing is sent. Of a Kinect it is three frames of the eight that its queue holds.
pub const LATEST: Span = Span(100_000_000);
/// Items between the two threads: 0.3 s of several LiDARs in dual return.
const BETWEEN: usize = 8_192;

/// What a session is asked to simulate.
#[derive(Clone, Debug)]
pub struct SimulatedRig {
    /// The scene, without end.
    pub scene: Arc<Scene>,
    /// What is to go wrong besides the scene's own faults; `None`: no fault file was given.
    pub faults: Option<FaultScript>,
}

/// What was done on purpose.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DoneFaults {
    /// By the scene's own faults; `None`: it has none.
    pub of_scene: Option<FaultTruth>,
    /// By those of the fault file; `None`: none was given.
    pub asked_for: Option<FaultTruth>,
}

/// How a sensor's items come into the session.
#[derive(Debug)]
pub enum Way {
    /// A LiDAR: datagrams to the sockets of its source.
    Datagrams {
        /// The data socket.
        data: SocketAddr,
        /// The position socket.
        position: SocketAddr,
    },
    /// Everything else: into the ledger, as its source would.
    Intake(Intake),
}

/// Simulated sensors that run.
#[derive(Debug)]
pub struct RunningScene {
    make: JoinHandle<DoneFaults>,
    send: JoinHandle<()>,
    stage: Option<EmulatedStage>,
    name: String,
    shortfall: Arc<Shortfall>,
}

impl SimulatedRig {
    /// A scene by name or file, and the faults of a file, for a session whose zero is this wall time.
    ///
    /// # Errors
    /// Exit code 2: no such scene; a file that is none, or faults of sensors that the scene does not have.
    pub fn load(name: &str, script: Option<&std::path::Path>, unix_at_zero: UnixNs) -> Result<Self, Failure> {
        let scene = scenes::load_endless(name, unix_at_zero)?;
        let faults = script.map(|path| faults::read_for(path, &sensors(&scene))).transpose()?;
        let steps_wall = |fault: &Fault| matches!(fault.action, Action::WallStep { .. });
        let asked_for = faults.iter().flat_map(|script| &script.fault);
        if scene.config.fault.iter().chain(asked_for).any(steps_wall) {
            let why = "a live session's wall clock is this machine's; replay takes it";
            tracing::warn!("wall_step does nothing here: {why}");
        }
        Ok(Self { scene: Arc::new(scene), faults })
    }

    /// Whether anything is to go wrong.
    pub fn has_faults(&self) -> bool {
        self.faults.is_some() || !self.scene.config.fault.is_empty()
    }

    /// Lets the sensors send until the stop. A sensor without a way is not in the rig, and is not simulated.
    ///
    /// # Errors
    /// When the system gives no thread or no socket.
    pub fn start(
        self,
        ways: BTreeMap<SensorId, Way>,
        clock: &SessionClock,
        stop: &StopToken,
    ) -> Result<RunningScene, Failure> {
        let name = self.scene.config.name.clone();
        let shortfall = Arc::new(Shortfall::default());
        let stage = self.stage(clock, stop);
        let (items, due) = crossbeam_channel::bounded(BETWEEN);
        let socket = UdpSender::bind(SocketAddr::from(([127, 0, 0, 1], 0))).map_err(Failure::failed)?;
        let sender =
            Sender { ways, socket, clock: clock.clone(), stop: stop.clone(), shortfall: Arc::clone(&shortfall) };
        let mut scene = Scene::clone(&self.scene);
        scene.lidars.retain(|lidar| sender.ways.contains_key(&lidar.id));
        scene.kinects.retain(|kinect| sender.ways.contains_key(&kinect.id));
        let scene = Arc::new(scene);
        let simulation = Simulation::new(Arc::clone(&scene), pool()?);
        let ahead = Ahead::new(simulation, clock.clone(), stop.clone(), Arc::clone(&shortfall));
        // One after the other, each with its own seed: a fault file changes nothing of what the scene's own faults do.
        let own = FaultInjector::of_scene(ahead, &scene);
        let (has_own, is_asked) = (!scene.config.fault.is_empty(), self.faults.is_some());
        let mut injector = FaultInjector::new(own, self.faults.unwrap_or_default()).map_err(Failure::input)?;
        let make = thread("sim", move || {
            for event in injector.by_ref() {
                if items.send(event).is_err() {
                    break;
                }
            }
            DoneFaults {
                of_scene: has_own.then(|| injector.source().truth().clone()),
                asked_for: is_asked.then(|| injector.truth().clone()),
            }
        })?;
        let send = thread("sim-send", move || sender.run(due))?;
        Ok(RunningScene { make, send, stage, name, shortfall })
    }

    /// Without a pseudo terminal the session goes on: nothing of it needs the emulator.
    fn stage(&self, clock: &SessionClock, stop: &StopToken) -> Option<EmulatedStage> {
        match EmulatedStage::start(&self.scene, clock, stop) {
            Ok(stage) => {
                if let Some(stage) = &stage {
                    tracing::info!("turntable emulator on {}, 115200 baud Zaber ASCII", stage.path().display());
                }
                stage
            }
            Err(error) => {
                tracing::warn!("no turntable emulator: {error}");
                None
            }
        }
    }
}

impl RunningScene {
    /// What was left out so far.
    pub fn shortfall(&self) -> &Shortfall {
        &self.shortfall
    }

    /// The port on which the scene's turntable answers; `None`: it has none.
    pub fn stage(&self) -> Option<&std::path::Path> {
        self.stage.as_ref().map(EmulatedStage::path)
    }

    /// The scene's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Waits for the end: tell it to stop first. What was left out, and what the faults did.
    pub fn join(self) -> (ShortfallReport, DoneFaults) {
        self.send.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        if let Some(stage) = self.stage {
            stage.join();
        }
        let faults = self.make.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        (self.shortfall.report(), faults)
    }
}

/// The sensors of a scene, as fault files name them.
fn sensors(scene: &Scene) -> Vec<SensorId> {
    let lidars = scene.lidars.iter().map(|lidar| lidar.id.clone());
    let kinects = scene.kinects.iter().map(|kinect| kinect.id.clone());
    let stage = scene.stage().map(|_| SensorId::from(turntable::SENSOR));
    lidars.chain(kinects).chain(stage).collect()
}

/// Threads that share the making; one processor is left to the core. `None`: the making thread alone.
fn pool() -> Result<Option<Arc<rayon::ThreadPool>>, Failure> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).saturating_sub(1);
    if threads < 2 {
        return Ok(None);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|n| format!("sim-{n}")).build();
    Ok(Some(Arc::new(pool.map_err(Failure::failed)?)))
}

fn thread<T: Send + 'static>(name: &str, work: impl FnOnce() -> T + Send + 'static) -> Result<JoinHandle<T>, Failure> {
    let thread: io::Result<_> = std::thread::Builder::new().name(name.to_owned()).spawn(work);
    thread.map_err(Failure::failed)
}

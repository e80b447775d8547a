//! The core with its hash chain: what `run`, `replay` and `verify` share, so that they cannot differ.

use std::sync::Arc;

use nalgebra::Vector3;
use tumbled_core::estimate::{EstimateHealth, NamedPoint, TargetState};
use tumbled_core::track::Tracker;
use tumbled_core::ukf::SensorPrior;
use tumbled_core::{CoreConfig, Outputs, Pipeline, SensorHealth, WallClock, Workers};
use tumbled_io::recording::RecordingHeader;
use tumbled_model::{Body, Event};

use super::chain::{Chain, Checkpoint, rig_digest};
use crate::cli::Failure;
use crate::config::{self, Config, Loaded, Recorded, show};

/// Makes the core's config of a changed config that stands in the ledger as text.
pub type Interpreter = Box<dyn Fn(&str) -> Result<CoreConfig, Failure> + Send>;

/// One event's work.
#[derive(Debug)]
pub struct Step<'a> {
    /// What came out.
    pub outputs: &'a Outputs,
    /// The wall clock beside the session's timeline.
    pub wall: &'a WallClock,
    /// The chain's value, where the core told its health.
    pub checkpoint: Option<Checkpoint>,
    pipeline: &'a Pipeline,
    newest: Option<&'a TargetState>,
}

impl Step<'_> {
    /// What the estimation says of itself after the newest epoch; `None`: there was none yet. Costs a little: ask once a
    /// second, or where somebody wants it.
    pub fn estimate_health(&self) -> Option<EstimateHealth> {
        self.newest.map(|state| self.pipeline.estimate_health(state))
    }

    /// The model of the target after the newest epoch, with the target's number in the session; `None`: there is none.
    pub fn model(&self) -> Option<(u32, &Tracker)> {
        self.pipeline.model()
    }

    /// The target's points whose motion is to be told.
    pub fn points(&self) -> &[NamedPoint] {
        self.pipeline.points()
    }
}

/// The core and its chain.
pub struct Engine {
    pipeline: Pipeline,
    outputs: Outputs,
    chain: Chain,
    interpreter: Interpreter,
    t_ns: i64,
    /// The state after the newest epoch.
    newest: Option<TargetState>,
}

impl Engine {
    /// A core for a rig, whose config and files have the digest `rig` ([`super::chain::rig_digest`]).
    pub fn new(config: CoreConfig, rig: String, workers: Workers, interpreter: Interpreter) -> Self {
        let pipeline = Pipeline::new(config, workers);
        Self { pipeline, outputs: Outputs::default(), chain: Chain::new(rig), interpreter, t_ns: 0, newest: None }
    }

    /// A core for a loaded config, as every command that reads inputs has it; `threads` as for [`workers`].
    ///
    /// # Errors
    /// A config that the core cannot use; no threads.
    pub fn of_config(loaded: &Loaded, ignore_skips: bool, threads: usize) -> Result<Self, Failure> {
        let config = &loaded.config;
        let core = CoreConfig { ignore_skips, ..super::setup::core_config(config)? };
        let rig = rig_digest(&show::text(&loaded.tree, false), &config.attachments());
        Ok(Self::new(core, rig, workers(threads)?, interpreter(config, ignore_skips)))
    }

    /// A core for another config than the inputs' own, in which `change` is made: in one that comes in the ledger too.
    ///
    /// # Errors
    /// As [`Engine::of_config`].
    pub fn of_changed(
        config: &Config,
        change: Arc<dyn Fn(&mut Config) + Send + Sync>,
        threads: usize,
    ) -> Result<Self, Failure> {
        let mut changed = config.clone();
        change(&mut changed);
        let core = super::setup::core_config(&changed)?;
        let files = config.attachments();
        let interpreter = move |toml: &str| {
            let header =
                RecordingHeader { config: toml.to_owned(), files: files.clone(), ..RecordingHeader::default() };
            let mut loaded = config::load_recorded(Recorded { path: "the ledger".into(), header }, &[])?;
            change(&mut loaded.config);
            super::setup::core_config(&loaded.config)
        };
        Ok(Self::new(core, rig_digest("", &[]), workers(threads)?, Box::new(interpreter)))
    }

    /// Lets the core have an event.
    pub fn step(&mut self, event: &Event) -> Step<'_> {
        self.outputs.clear();
        self.chain.event(event);
        self.t_ns = self.t_ns.max(event.arrived.0);
        if let Body::Config { toml } = &event.body {
            self.configure(toml);
        }
        self.pipeline.step(event, &mut self.outputs);
        self.account()
    }

    /// The ledger has ended: what was held back comes out.
    pub fn finish(&mut self) -> Step<'_> {
        self.outputs.clear();
        self.pipeline.finish(&mut self.outputs);
        let step = self.account();
        Step { checkpoint: None, ..step }
    }

    /// From here on frames that show the target are given out; the chain stays as it is.
    pub fn keep_frames(&mut self) {
        self.pipeline.keep_frames();
    }

    /// The model of the target; `None`: there is no target.
    pub fn tracker(&self) -> Option<&Tracker> {
        self.pipeline.tracker()
    }

    /// The same with the target's number in the session.
    pub fn model(&self) -> Option<(u32, &Tracker)> {
        self.pipeline.model()
    }

    /// What the estimation believes of the sensors for a target at a place, rig frame, m.
    pub fn sensor_priors(&self, center: &Vector3<f64>) -> Vec<SensorPrior> {
        self.pipeline.sensor_priors(center)
    }

    /// The chain's value now.
    pub fn checkpoint(&self) -> Checkpoint {
        self.chain.checkpoint(self.t_ns)
    }

    /// The sensors' counts and states as of everything so far.
    pub fn sensors(&self) -> Vec<SensorHealth> {
        self.pipeline.sensors()
    }

    fn account(&mut self) -> Step<'_> {
        self.outputs.epochs.iter().for_each(|epoch| self.chain.epoch(epoch));
        self.outputs.states.iter().for_each(|state| self.chain.state(state));
        self.outputs.notices.iter().for_each(|notice| self.chain.notice(notice));
        self.outputs.health.iter().for_each(|health| self.chain.health(health));
        let checkpoint = self.outputs.health.last().map(|health| self.chain.checkpoint(health.t_ns));
        if let Some(newest) = self.outputs.states.last() {
            self.newest = Some(newest.clone());
        }
        Step {
            outputs: &self.outputs,
            wall: self.pipeline.wall(),
            checkpoint,
            pipeline: &self.pipeline,
            newest: self.newest.as_ref(),
        }
    }

    /// A config that cannot be read was written by another version: the session goes on with what it has.
    fn configure(&mut self, toml: &str) {
        match (self.interpreter)(toml) {
            Ok(config) => self.pipeline.configure(config),
            Err(failure) => tracing::error!("a changed config in the ledger cannot be used: {failure}"),
        }
    }
}

impl core::fmt::Debug for Engine {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Engine").field("chain", &self.chain).finish_non_exhaustive()
    }
}

/// Reads changed configs as they stand in a ledger, with the session's own files: a change names no other ones.
pub fn interpreter(config: &Config, ignore_skips: bool) -> Interpreter {
    let files = config.attachments();
    Box::new(move |toml| {
        let header = RecordingHeader { config: toml.to_owned(), files: files.clone(), ..RecordingHeader::default() };
        let loaded = config::load_recorded(Recorded { path: "the ledger".into(), header }, &[])?;
        Ok(CoreConfig { ignore_skips, ..super::setup::core_config(&loaded.config)? })
    })
}

/// The core's threads: `threads` in all, the caller's included; 0 = one for each processor.
///
/// # Errors
/// When the system gives no threads.
pub fn workers(threads: usize) -> Result<Workers, Failure> {
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = if threads == 0 { available } else { threads };
    if threads == 1 {
        return Ok(Workers::none());
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|n| format!("core-{n}"))
        .build()
        .map_err(Failure::failed)?;
    Ok(Workers::pool(Arc::new(pool)))
}

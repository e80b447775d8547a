//! The inputs of a command: opened, merged, followed with a progress bar, and judged at the end.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use tumbled_io::capture::{
    self, Capture, CaptureError, CaptureSummary, Heartbeat, KinectRoute, LidarRoute, Merged, Routing, StampOrigin,
};
use tumbled_io::recording::RecordingHeader;
use tumbled_model::{Event, SensorId, UnixNs};
use tumbled_sim::faults::{FaultInjector, FaultScript, FaultTruth};
use tumbled_sim::scene::Scene;

use crate::cli::{Failure, InputArgs};
use crate::config::Config;
use crate::simulation::{SCHEME, SimulatedLedger, faults, scene_of, scenes};

/// Events shown as progress between two redraws of the bar.
const TICK_EVENTS: u64 = 256;

/// Several captures as one ledger.
pub struct Inputs {
    events: Passed,
    lidars: Vec<SensorId>,
    progress: ProgressBar,
    seen: u64,
}

/// The way from the inputs to the command.
enum Passed {
    /// As they are.
    Whole(Box<Unfailing>),
    /// With faults.
    Faulty(Box<FaultInjector<Unfailing>>),
}

impl Passed {
    fn source(&self) -> &Unfailing {
        match self {
            Self::Whole(source) => source,
            Self::Faulty(injector) => injector.source(),
        }
    }
}

/// Events until there are no more, or until one cannot be read: then why.
struct Unfailing {
    events: Events,
    failed: Option<CaptureError>,
    ended: bool,
}

impl Iterator for Unfailing {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        if self.ended {
            return None;
        }
        match self.events.next() {
            Some(Ok(event)) => return Some(event),
            Some(Err(error)) => self.failed = Some(error),
            None => {}
        }
        self.ended = true;
        None
    }
}

/// What is read from the inputs.
enum Events {
    /// The sensors' data alone.
    Data(Merged),
    /// A ledger: with ticks and anchors, recorded or made.
    Ledger(Heartbeat<Merged>),
    /// A simulated session, a ledger too.
    Simulated(Box<SimulatedLedger>),
}

impl Events {
    /// The captures; `None`: a simulation has none.
    fn merged(&self) -> Option<&Merged> {
        match self {
            Self::Data(merged) => Some(merged),
            Self::Ledger(heartbeat) => Some(heartbeat.source()),
            Self::Simulated(_) => None,
        }
    }
}

impl Iterator for Events {
    type Item = Result<Event, CaptureError>;

    fn next(&mut self) -> Option<Self::Item> {
        match self {
            Self::Data(merged) => merged.next(),
            Self::Ledger(heartbeat) => heartbeat.next(),
            Self::Simulated(ledger) => ledger.next().map(Ok),
        }
    }
}

/// Where the config says each sensor's bytes are.
pub fn routing(config: &Config) -> Routing {
    let lidar = |lidar: &crate::config::LidarConfig| LidarRoute {
        id: lidar.id.clone(),
        port: lidar.port,
        position_port: lidar.position_port,
        source: lidar.source,
        topic: None,
    };
    let kinect = |kinect: &crate::config::KinectConfig| KinectRoute { id: kinect.id.clone(), topic: None };
    Routing { lidars: config.lidars.iter().map(lidar).collect(), kinects: config.kinects.iter().map(kinect).collect() }
}

/// The simulation that the inputs name; `None`: they are captures. A scene has its own wall time, and is simulated alone.
fn simulated<P: AsRef<Path>>(inputs: &[P], threads: usize) -> Result<Option<SimulatedLedger>, Failure> {
    let Some(name) = inputs.iter().find_map(|input| scene_of(input.as_ref())) else { return Ok(None) };
    if inputs.len() > 1 {
        return Err(Failure::input(format!(
            "{SCHEME}{name} is simulated alone: it cannot be merged with other inputs"
        )));
    }
    Ok(Some(SimulatedLedger::new(scenes::load(name)?, Some(scenes::pool(threads)?))))
}

fn merge<P: AsRef<Path>>(inputs: &[P], config: &Config) -> Result<Merged, Failure> {
    refuse_twice(inputs)?;
    let captures = capture::open_all(inputs, &routing(config)).map_err(Failure::input)?;
    capture::merge(captures).map_err(Failure::input)
}

impl Inputs {
    /// Opens every input and merges them by host time.
    ///
    /// # Errors
    /// An input that cannot be read, is none, or is given twice: exit code 2.
    pub fn open(args: &InputArgs, config: &Config) -> Result<Self, Failure> {
        let events = match simulated(&args.inputs, 0)? {
            Some(ledger) => Events::Simulated(Box::new(ledger)),
            None => Events::Data(merge(&args.inputs, config)?),
        };
        Ok(Self::start(events, config))
    }

    /// The same as a whole ledger: foreign captures get ticks and anchors, a recording alone has its own. A scene is made by
    /// so many threads; 0 = one for each processor.
    ///
    /// # Errors
    /// An input that cannot be read, is none, or is given twice: exit code 2.
    pub fn open_ledger<P: AsRef<Path>>(inputs: &[P], config: &Config, threads: usize) -> Result<Self, Failure> {
        let events = match simulated(inputs, threads)? {
            Some(ledger) => Events::Simulated(Box::new(ledger)),
            None => Events::Ledger(Heartbeat::of_captures(merge(inputs, config)?)),
        };
        Ok(Self::start(events, config))
    }

    fn start(events: Events, config: &Config) -> Self {
        let progress = ProgressBar::new_spinner().with_style(
            ProgressStyle::with_template("{spinner} {elapsed_precise} {human_pos} packets and frames, {per_sec}")
                .unwrap_or_else(|_| ProgressStyle::default_spinner()),
        );
        progress.enable_steady_tick(Duration::from_millis(100)); // draws on a terminal only
        let lidars = config.lidars.iter().map(|lidar| lidar.id.clone()).collect();
        let events = Passed::Whole(Box::new(Unfailing { events, failed: None, ended: false }));
        Self { events, lidars, progress, seen: 0 }
    }

    /// The same with faults from here on: no longer what was recorded, but a rehearsal.
    ///
    /// # Errors
    /// A script with numbers that mean nothing: exit code 2.
    pub fn with_faults(self, script: FaultScript) -> Result<Self, Failure> {
        let events = match self.events {
            Passed::Whole(source) => source,
            Passed::Faulty(injector) => return Ok(Self { events: Passed::Faulty(injector), ..self }),
        };
        let injector = FaultInjector::new(*events, script).map_err(Failure::input)?;
        Ok(Self { events: Passed::Faulty(Box::new(injector)), ..self })
    }

    /// What has been done to the inputs so far; `None`: they pass as they are.
    pub fn faults(&self) -> Option<&FaultTruth> {
        match &self.events {
            Passed::Whole(_) => None,
            Passed::Faulty(injector) => Some(injector.truth()),
        }
    }

    /// Tells in the header of a recording of the inputs what faults are in it; see [`faults::mark`].
    pub fn mark_faults(&self, header: &mut RecordingHeader) {
        if let Passed::Faulty(injector) = &self.events {
            faults::mark(injector.script(), header);
        }
    }

    fn events(&self) -> &Events {
        &self.events.source().events
    }

    /// The wall time at `t_ns` 0: the earliest host stamp over all inputs.
    pub fn epoch(&self) -> Option<UnixNs> {
        match self.events() {
            Events::Simulated(ledger) => Some(ledger.scene().unix_at_zero()),
            other => other.merged()?.epoch(),
        }
    }

    /// The next event.
    ///
    /// # Errors
    /// An input that turns out unreadable.
    pub fn next_event(&mut self) -> Result<Option<Event>, Failure> {
        let (next, source) = match &mut self.events {
            Passed::Whole(source) => (source.next(), source.as_mut()),
            Passed::Faulty(injector) => (injector.next(), injector.source_mut()),
        };
        let Some(event) = next else {
            self.progress.finish_and_clear();
            return source.failed.take().map_or(Ok(None), |error| Err(Failure::input(error)));
        };
        self.seen += 1;
        if self.seen.is_multiple_of(TICK_EVENTS) {
            self.progress.set_position(self.seen);
        }
        Ok(Some(event))
    }

    /// The inputs and what they held, in the order they were given. Complete after the last event.
    pub fn captures(&self) -> impl Iterator<Item = &Capture> {
        self.events().merged().into_iter().flat_map(Merged::captures)
    }

    /// What the recording says of itself, when the inputs are one recording and nothing else.
    pub fn recording(&self) -> Option<&RecordingHeader> {
        let merged = self.events().merged()?;
        merged.captures().next().filter(|_| merged.is_ledger())?.recording()
    }

    /// The scene, when the input is a simulation.
    pub fn scene(&self) -> Option<&Arc<Scene>> {
        match self.events() {
            Events::Simulated(ledger) => Some(ledger.scene()),
            Events::Data(_) | Events::Ledger(_) => None,
        }
    }

    fn summaries(&self) -> impl Iterator<Item = &CaptureSummary> {
        self.events().merged().into_iter().flat_map(Merged::summaries)
    }

    /// Whether the host stamps are real and not numbered at 30 Hz; inputs of both kinds are never merged.
    pub fn have_host_times(&self) -> bool {
        self.summaries().all(|summary| summary.stamp_origin != StampOrigin::Synthetic)
    }

    /// What a person should know about the inputs: damage, sensors that are mixed up, and what to change when a LiDAR
    /// found nothing.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = self.damage();
        warnings.extend(self.lidars.iter().filter_map(|lidar| self.mixed_sources(lidar)));
        for capture in self.captures() {
            warnings.extend(capture.summary().hint().map(|hint| format!("{}: {hint}", capture.path().display())));
        }
        warnings
    }

    /// What of the inputs could not be read or delivered, each with the remedy if there is one.
    pub fn damage(&self) -> Vec<String> {
        let mut damage = Vec::new();
        for capture in self.captures() {
            let summary = capture.summary();
            let name = capture.path().display();
            match &summary.recording {
                Some(recording) => damage.extend(recording.warnings()),
                None => damage.extend(summary.broken_off.iter().map(ToString::to_string)),
            }
            damage.extend(summary.damaged_files.iter().map(|d| format!("{}: {}", d.path.display(), d.detail)));
            let mut count = |n: u64, what: &str| {
                if n > 0 {
                    damage.push(format!("{name}: {n} {what}"));
                }
            };
            count(
                summary.cut_short,
                "packets cut short by the capture's snap length, not decoded: capture whole packets (tcpdump -s 0)",
            );
            count(
                summary.fragments,
                "IP fragments, not put together, not decoded: capture before the link that splits them",
            );
            count(
                summary.malformed_frames,
                "frames with contradictory IP or UDP headers, not decoded: capture on the interface of the sensor's cable",
            );
            count(summary.untimed, "packets without a usable time, not decoded: capture with times (tcpdump does)");
            for (link, frames) in &summary.unread_link_types {
                let read = "Ethernet, Linux cooked, raw IP and loopback are";
                count(
                    *frames,
                    &format!(
                        "frames of link type {link}, which is not read ({read}): capture on the interface of the sensor's cable"
                    ),
                );
            }
            for (topic, traffic) in &summary.unused_topics {
                if let Some(fault) = &traffic.first_fault {
                    damage.push(format!("{name}: {} messages of {topic} not used: {fault}", traffic.messages));
                }
            }
        }
        damage
    }

    /// A warning when data packets of more than one sender, over all inputs, were taken for this LiDAR's.
    pub fn mixed_sources(&self, lidar: &SensorId) -> Option<String> {
        let mut senders: BTreeMap<IpAddr, u64> = BTreeMap::new();
        for (address, packets) in self.summaries().filter_map(|s| s.data_sources.get(lidar)).flatten() {
            *senders.entry(*address).or_default() += packets;
        }
        // The busiest is the likeliest to be meant; of equals the lowest address.
        let busiest = senders.iter().rev().max_by_key(|(_, packets)| **packets).map(|(address, _)| *address)?;
        if senders.len() < 2 {
            return None;
        }
        let list: Vec<String> =
            senders.iter().map(|(address, packets)| format!("{address} ({packets} packets)")).collect();
        let key = if self.lidars.len() == 1 { "lidar.source".to_owned() } else { format!("lidar.{lidar}.source") };
        Some(format!(
            "LiDAR {lidar} has data packets of several senders, decoded as if of one: {}; set {key}={busiest}",
            list.join(", ")
        ))
    }

    /// Whether something in the inputs could not be delivered.
    pub fn data_lost(&self) -> bool {
        self.summaries().any(CaptureSummary::data_lost)
    }
}

/// The same recording twice would count everything double.
fn refuse_twice<P: AsRef<Path>>(inputs: &[P]) -> Result<(), Failure> {
    let one_path = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    for (k, input) in inputs.iter().enumerate() {
        let before = inputs.iter().take(k);
        if before.map(|other| one_path(other.as_ref())).any(|other| other == one_path(input.as_ref())) {
            return Err(Failure::input(format!("{} is given twice", input.as_ref().display()))
                .with_help("give each input once: what is in it would count double"));
        }
    }
    Ok(())
}

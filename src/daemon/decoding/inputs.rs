//! The inputs of a command: opened, merged, followed with a progress bar, and judged at the end.

use std::path::Path;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use tumbled_io::capture::{self, Capture, CaptureSummary, Heartbeat, KinectRoute, LidarRoute, Merged, Routing};
use tumbled_io::recording::RecordingHeader;
use tumbled_model::{Event, UnixNs};

use crate::cli::{Failure, InputArgs};
use crate::config::Config;

/// Events shown as progress between two redraws of the bar.
const TICK_EVENTS: u64 = 256;

/// Several captures as one ledger.
pub struct Inputs {
    events: Events,
    progress: ProgressBar,
    seen: u64,
}

/// What is read from the inputs.
enum Events {
    /// The sensors' data alone.
    Data(Merged),
    /// A ledger: with ticks and anchors, recorded or made.
    Ledger(Heartbeat),
}

impl Events {
    fn merged(&self) -> &Merged {
        match self {
            Self::Data(merged) => merged,
            Self::Ledger(heartbeat) => heartbeat.merged(),
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

fn merge<P: AsRef<Path>>(inputs: &[P], config: &Config) -> Result<Merged, Failure> {
    let captures = capture::open_all(inputs, &routing(config)).map_err(Failure::input)?;
    capture::merge(captures).map_err(Failure::input)
}

impl Inputs {
    /// Opens every input and merges them by host time.
    ///
    /// # Errors
    /// An input that cannot be read or is none: exit code 2.
    pub fn open(args: &InputArgs, config: &Config) -> Result<Self, Failure> {
        Ok(Self::start(Events::Data(merge(&args.inputs, config)?)))
    }

    /// The same as a whole ledger: foreign captures get ticks and anchors, a recording alone has its own.
    ///
    /// # Errors
    /// An input that cannot be read or is none: exit code 2.
    pub fn open_ledger<P: AsRef<Path>>(inputs: &[P], config: &Config) -> Result<Self, Failure> {
        Ok(Self::start(Events::Ledger(Heartbeat::new(merge(inputs, config)?))))
    }

    fn start(events: Events) -> Self {
        let progress = ProgressBar::new_spinner().with_style(
            ProgressStyle::with_template("{spinner} {elapsed_precise} {human_pos} packets and frames, {per_sec}")
                .unwrap_or_else(|_| ProgressStyle::default_spinner()),
        );
        progress.enable_steady_tick(Duration::from_millis(100)); // draws on a terminal only
        Self { events, progress, seen: 0 }
    }

    /// The wall time at `t_ns` 0: the earliest host stamp over all inputs.
    pub fn epoch(&self) -> Option<UnixNs> {
        self.events.merged().epoch()
    }

    /// The next event.
    ///
    /// # Errors
    /// An input that turns out unreadable.
    pub fn next_event(&mut self) -> Result<Option<Event>, Failure> {
        let next = match &mut self.events {
            Events::Data(merged) => merged.next(),
            Events::Ledger(heartbeat) => heartbeat.next(),
        };
        let Some(event) = next else {
            self.progress.finish_and_clear();
            return Ok(None);
        };
        self.seen += 1;
        if self.seen.is_multiple_of(TICK_EVENTS) {
            self.progress.set_position(self.seen);
        }
        event.map(Some).map_err(Failure::input)
    }

    /// The inputs and what they held, in the order they were given. Complete after the last event.
    pub fn captures(&self) -> impl Iterator<Item = &Capture> {
        self.events.merged().captures()
    }

    /// What the recording says of itself, when the inputs are one recording and nothing else.
    pub fn recording(&self) -> Option<&RecordingHeader> {
        let merged = self.events.merged();
        merged.captures().next().filter(|_| merged.is_ledger())?.recording()
    }

    /// What a person should know about the inputs: damage and what to change when a LiDAR found nothing.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for capture in self.captures() {
            let summary = capture.summary();
            let name = capture.path().display();
            match &summary.recording {
                Some(recording) => warnings.extend(recording.warnings()),
                None => warnings.extend(summary.broken_off.iter().map(ToString::to_string)),
            }
            warnings.extend(summary.damaged_files.iter().map(|d| format!("{}: {}", d.path.display(), d.detail)));
            let mut count = |n: u64, what: &str| {
                if n > 0 {
                    warnings.push(format!("{name}: {n} {what}"));
                }
            };
            count(summary.cut_short, "packets cut short by the capture's snap length: not decoded");
            count(summary.fragments, "IP fragments: not put together, not decoded");
            count(summary.malformed_frames, "frames with contradictory IP or UDP headers: not decoded");
            count(summary.untimed, "packets without a usable time: not decoded");
            for (topic, traffic) in &summary.unused_topics {
                if let Some(fault) = &traffic.first_fault {
                    warnings.push(format!("{name}: {} messages of {topic} not used: {fault}", traffic.messages));
                }
            }
            warnings.extend(summary.hint().map(|hint| format!("{name}: {hint}")));
        }
        warnings
    }

    /// Whether something in the inputs could not be delivered.
    pub fn data_lost(&self) -> bool {
        self.events.merged().summaries().any(CaptureSummary::data_lost)
    }
}

//! `tumbled info`: what inputs hold, what is missing in them, and what the sensors say of themselves.
//!
//! ```text
//!   inputs ─▶ events ─┬─▶ lidar:  decoder, timeline, head turning, ranges ─┐
//!                     └─▶ kinect: decoder, steps, depths ──────────────────┴─▶ report ─▶ text │ JSON
//! ```
//!
//! * [`report`]: what is reported, as machines get it; `text`, `page`: the same for people;
//! * `lidar`, `timeline`, `histogram`: one LiDAR followed; `lidar_report`, `hdl64e`: what came out of it;
//! * `kinect`: one Kinect followed; `input`: what was left out of an input; [`recording`]: what a recording says of itself.

mod hdl64e;
mod histogram;
mod input;
mod kinect;
mod lidar;
mod lidar_report;
mod page;
pub mod recording;
pub mod report;
mod text;
mod timeline;

use std::path::PathBuf;

use tumbled_model::{Body, Event};

use super::{Failure, InputArgs, Outcome, output};
use crate::config::Config;
use crate::decoding::Inputs;
use crate::decoding::kinect::Frame;
use kinect::KinectWatch;
use lidar::LidarWatch;
use report::{Absent, InfoReport, KinectReport, LidarReport, SensorKind, UsedConfig, Verdict};

/// What `info` is asked for.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  tumbled info drive.pcap\n  tumbled info drive.pcap dump/ --config rig.toml --json\n  \
    tumbled info old.pcap --set lidar.model=vlp-16\n  tumbled info run.mcap --html run.html\n\n\
    Exit code 3: part of an input could not be read. Packets that were lost before the capture, and payloads that are no \
    packets of the sensor, are the report's content and leave the exit code 0."
)]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// Write the report as a page too.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// Reads the inputs to their ends and reports.
///
/// # Errors
/// Exit code 2: an input or a config that cannot be used.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = args.input.load()?;
    let mut inputs = Inputs::open(&args.input, &loaded.config)?;
    let mut watch = Watch::new(&loaded.config)?;
    while let Some(event) = inputs.next_event()? {
        watch.event(&event);
    }
    let report = watch.report(&inputs, UsedConfig::new(&loaded, &args.input.config.settings));
    if let Some(path) = &args.html {
        output::file(path, page::html(&report))?;
    }
    output::report(&report, args.json, || text::render(&report))?;
    Ok(if inputs.data_lost() { Outcome::Incomplete } else { Outcome::Fine })
}

/// Every sensor of the config, followed.
struct Watch {
    lidars: Vec<LidarWatch>,
    kinects: Vec<KinectWatch>,
}

impl Watch {
    fn new(config: &Config) -> Result<Self, Failure> {
        Ok(Self {
            lidars: config.lidars.iter().map(LidarWatch::new).collect::<Result<_, _>>()?,
            kinects: config.kinects.iter().map(KinectWatch::new).collect::<Result<_, _>>()?,
        })
    }

    fn event(&mut self, event: &Event) {
        match &event.body {
            Body::LidarPacket { sensor, bytes } => {
                if let Some(lidar) = self.lidars.iter_mut().find(|lidar| lidar.id == sensor.as_str()) {
                    lidar.payload(bytes, event.arrived);
                }
            }
            Body::DepthFrame { sensor, ticks, encoding, lost_packets, bytes } => {
                if let Some(kinect) = self.kinects.iter_mut().find(|kinect| kinect.id() == sensor) {
                    let frame = Frame { ticks: *ticks, encoding: *encoding, lost: lost_packets, bytes };
                    kinect.frame(frame, event.arrived);
                }
            }
            // Counted by the inputs.
            _ => {}
        }
    }

    fn report(mut self, inputs: &Inputs, config: UsedConfig) -> InfoReport {
        self.lidars.iter_mut().for_each(LidarWatch::finish);
        let input_reports: Vec<_> = inputs.captures().map(input::report).collect();
        let host_times = inputs.have_host_times();
        let seen = self.lidars.iter().filter(|lidar| lidar.seen());
        let mut lidars: Vec<LidarReport> = seen.map(|lidar| lidar_report::report(lidar, host_times)).collect();
        for lidar in &mut lidars {
            lidar.warnings.extend(inputs.mixed_sources(&lidar.id.as_str().into()));
        }
        let seen = self.kinects.iter().filter(|kinect| kinect.seen());
        let kinects: Vec<KinectReport> = seen.map(|kinect| kinect.report(host_times)).collect();
        let absent = |kind| move |id: &str| Absent { kind, id: id.to_owned() };
        let unseen = self.lidars.iter().filter(|lidar| !lidar.seen()).map(|lidar| lidar.id.as_str());
        let absent_lidars = unseen.map(absent(SensorKind::Lidar));
        let unseen = self.kinects.iter().filter(|kinect| !kinect.seen()).map(|kinect| kinect.id().as_str());
        let absent_kinects = unseen.map(absent(SensorKind::Kinect));
        InfoReport {
            epoch_unix_ns: inputs.epoch().filter(|_| host_times).map(|epoch| epoch.0.to_string()),
            absent: absent_lidars.chain(absent_kinects).collect(),
            verdict: verdict(!inputs.data_lost(), &lidars, &kinects),
            config,
            inputs: input_reports,
            lidars,
            kinects,
        }
    }
}

fn verdict(inputs_whole: bool, lidars: &[LidarReport], kinects: &[KinectReport]) -> Verdict {
    let rejected = lidars.iter().flat_map(|lidar| &lidar.rejected);
    let refused = kinects.iter().flat_map(|kinect| &kinect.refused);
    Verdict {
        inputs_whole,
        lidar_packets_lost: lidars.iter().filter_map(|lidar| lidar.loss).map(|loss| loss.lost).sum(),
        lidar_payloads_rejected: rejected.map(|refusal| refusal.count).sum(),
        kinect_packets_lost: kinects.iter().map(|kinect| kinect.usb_packets_lost).sum(),
        kinect_frames_missing: kinects.iter().filter_map(|kinect| kinect.frames_missing).sum(),
        kinect_frames_refused: refused.map(|refusal| refusal.count).sum(),
        kinect_frames_repeated: kinects.iter().map(|kinect| kinect.repeated).sum(),
    }
}

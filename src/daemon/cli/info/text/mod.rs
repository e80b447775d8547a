//! The report for people at the rig: one block an input and a sensor, label and value in two columns.

mod figures;
mod kinect;
mod lidar;

use super::recording;
use super::report::input::{HostStamps, InputKind, InputReport};
use super::report::{Absent, InfoReport, SensorKind, Verdict};
use figures::{bytes, counted, seconds, utc};

/// Column of the values.
const VALUES_AT: usize = 16;

/// The report as text, its last line ended.
pub(super) fn render(report: &InfoReport) -> String {
    let mut page = Page::default();
    for one in &report.inputs {
        input(&mut page, one);
    }
    page.heading(&format!("config: {}", report.config));
    for one in &report.lidars {
        lidar::block(&mut page, one);
    }
    for one in &report.kinects {
        kinect::block(&mut page, one);
    }
    page.heading(&verdict(report));
    page.text
}

/// A page being written.
#[derive(Default)]
struct Page {
    text: String,
}

impl Page {
    /// Begins a block.
    fn heading(&mut self, heading: &str) {
        if !self.text.is_empty() {
            self.text.push('\n');
        }
        self.text.push_str(heading);
        self.text.push('\n');
    }

    /// One line of a block; an empty label continues the line above.
    fn line(&mut self, label: &str, value: &str) {
        let width = VALUES_AT - 2;
        self.text.push_str(&format!("  {label:<width$}{value}\n"));
    }

    /// A line that must not be overlooked.
    fn alert(&mut self, value: &str) {
        self.line("! attention", value);
    }
}

fn input(page: &mut Page, input: &InputReport) {
    let size = input.size_bytes.map(|size| format!(", {}", bytes(size))).unwrap_or_default();
    page.heading(&format!("{}: {}{size}", input.path, kind(input.kind)));
    match (&input.first, &input.last, input.duration_s) {
        (Some(first), Some(last), Some(duration)) => {
            page.line("host time", &format!("{} to {}, {}", utc(first), utc(last), seconds(duration)));
            page.line("", stamps(input.stamp_origin));
        }
        _ if input.stamp_origin == HostStamps::Synthetic => page.line("host time", stamps(input.stamp_origin)),
        _ => page.line("host time", "nothing for the sensors of the config"),
    }
    if input.backward_steps > 0 {
        page.line("", &format!("{} steps back in time", input.backward_steps));
    }
    if let Some(recording) = &input.recording {
        for (label, value) in recording::lines(recording) {
            page.line(label, &value);
        }
    }
    for left_out in input.left_out.iter().filter(|left_out| !left_out.lost) {
        page.line("left out", &format!("{}: {}", left_out.what, left_out.count));
    }
    for lost in input.left_out.iter().filter(|left_out| left_out.lost) {
        page.alert(&format!("lost: {}: {}", lost.what, lost.count));
    }
    // A recording's own words say it better.
    let foreign = input.recording.is_none();
    for broken in input.broken_off.iter().filter(|_| foreign) {
        let place = match (broken.byte, broken.after_row) {
            (Some(byte), _) => format!("byte {byte}"),
            (None, Some(row)) => format!("row {row}"),
            (None, None) => "an unknown place".to_owned(),
        };
        page.alert(&format!("{} is readable only up to {place}: {}", broken.path, broken.detail));
    }
    for warning in input.recording.iter().flat_map(|recording| &recording.warnings) {
        page.alert(warning);
    }
    if let Some(hint) = &input.hint {
        page.alert(hint);
    }
}

const fn kind(kind: InputKind) -> &'static str {
    match kind {
        InputKind::Pcap => "pcap",
        InputKind::Pcapng => "pcapng",
        InputKind::Rosbag => "ROS 2 bag",
        InputKind::Fakenect => "fakenect dump",
        InputKind::DepthPngs => "depth PNGs",
        InputKind::Recording => "recording",
        InputKind::Other => "capture",
    }
}

const fn stamps(origin: HostStamps) -> &'static str {
    match origin {
        HostStamps::Capture => "as the capture received each packet or frame",
        HostStamps::Message => "as the driver stamped the messages",
        HostStamps::TimesFile => "as times.txt says",
        HostStamps::Ledger => "as recorded with the ledger",
        HostStamps::Synthetic => "unknown: none in the input, frames are numbered at 30 Hz",
        HostStamps::Other => "by stamps of another kind",
    }
}

/// The last line: everything that is missing, or that nothing is.
fn verdict(report: &InfoReport) -> String {
    let Verdict {
        inputs_whole,
        lidar_packets_lost,
        lidar_payloads_rejected,
        kinect_packets_lost,
        kinect_frames_missing,
        kinect_frames_refused,
        kinect_frames_repeated,
    } = report.verdict;
    if report.lidars.is_empty() && report.kinects.is_empty() {
        return "Nothing in the inputs is for a sensor of the config.".to_owned();
    }
    let mut missing = Vec::new();
    if !inputs_whole {
        missing.push("the inputs are not whole".to_owned());
    }
    let counts = [
        (lidar_packets_lost, "LiDAR packet", "lost"),
        (lidar_payloads_rejected, "LiDAR payload", "not decoded"),
        (kinect_frames_missing, "depth frame", "missing"),
        (kinect_packets_lost, "USB packet", "of depth frames lost"),
        (kinect_frames_refused, "depth frame", "not decoded"),
        (kinect_frames_repeated, "depth frame", "repeated"),
    ];
    for (count, noun, fate) in counts {
        if count > 0 {
            missing.push(format!("{} {fate}", counted(count, noun)));
        }
    }
    let idle = report.lidars.iter().filter(|lidar| lidar.data_packets == 0 && lidar.rejected.is_empty());
    missing.extend(idle.map(|lidar| format!("no data packets of LiDAR {}", lidar.id)));
    missing.extend(absent(report));
    let stampless = report.lidars.iter().any(|lidar| lidar.loss.is_none())
        || report.kinects.iter().any(|kinect| kinect.frames_missing.is_none());
    match (missing.is_empty(), stampless) {
        (false, _) => format!("Not complete: {}.", missing.join("; ")),
        (true, true) => "Nothing known to be missing; without stamps from the sensor that cannot be told.".to_owned(),
        (true, false) => "Complete: nothing is missing.".to_owned(),
    }
}

/// Sensors that have nothing while others of their kind do. That a whole kind is not in the inputs is no news.
fn absent(report: &InfoReport) -> Vec<String> {
    let is_news = |absent: &&Absent| match absent.kind {
        SensorKind::Lidar => !report.lidars.is_empty(),
        SensorKind::Kinect => !report.kinects.is_empty(),
    };
    let name = |absent: &Absent| match absent.kind {
        SensorKind::Lidar => format!("nothing from LiDAR {}", absent.id),
        SensorKind::Kinect => format!("nothing from Kinect {}", absent.id),
    };
    report.absent.iter().filter(is_news).map(name).collect()
}

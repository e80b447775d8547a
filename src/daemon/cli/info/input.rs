//! What an input held and what of it was left out, as part of the report.

use tumbled_io::capture::{BrokenOff, Capture, CaptureKind, CaptureSummary, Place, StampOrigin};

use super::report::input::{BrokenFile, Delivered, HostStamps, InputKind, InputReport, LeftOut};

/// The report of one input at its end.
pub(super) fn report(capture: &Capture) -> InputReport {
    let summary = capture.summary();
    let timed = summary.stamp_origin != StampOrigin::Synthetic;
    let (first, last) = (summary.earliest.filter(|_| timed), summary.latest.filter(|_| timed));
    let file = std::fs::metadata(capture.path()).ok().filter(std::fs::Metadata::is_file);
    InputReport {
        path: capture.path().display().to_string(),
        kind: kind(summary.kind),
        size_bytes: file.map(|metadata| metadata.len()),
        stamp_origin: stamp_origin(summary.stamp_origin),
        first: first.map(Into::into),
        last: last.map(Into::into),
        duration_s: first.zip(last).map(|(first, last)| (last - first).as_secs_f64()),
        backward_steps: summary.backward_steps,
        sensors: delivered(summary),
        left_out: left_out(summary),
        broken_off: summary.broken_off.iter().map(broken_file).collect(),
        whole: !summary.data_lost(),
        recording: summary.recording.as_deref().map(Into::into),
        hint: summary.hint().map(|hint| hint.to_string()),
    }
}

fn kind(kind: CaptureKind) -> InputKind {
    match kind {
        CaptureKind::Pcap => InputKind::Pcap,
        CaptureKind::PcapNg => InputKind::Pcapng,
        CaptureKind::Rosbag => InputKind::Rosbag,
        CaptureKind::Fakenect => InputKind::Fakenect,
        CaptureKind::DepthPngs => InputKind::DepthPngs,
        CaptureKind::Recording => InputKind::Recording,
        _ => InputKind::Other,
    }
}

fn stamp_origin(origin: StampOrigin) -> HostStamps {
    match origin {
        StampOrigin::Capture => HostStamps::Capture,
        StampOrigin::Message => HostStamps::Message,
        StampOrigin::TimesFile => HostStamps::TimesFile,
        StampOrigin::Ledger => HostStamps::Ledger,
        StampOrigin::Synthetic => HostStamps::Synthetic,
        _ => HostStamps::Other,
    }
}

fn delivered(summary: &CaptureSummary) -> Vec<Delivered> {
    let one = |(id, traffic): (&tumbled_model::SensorId, &tumbled_io::capture::SensorTraffic)| Delivered {
        sensor: id.to_string(),
        data_packets: traffic.data_packets,
        position_packets: traffic.position_packets,
        depth_frames: traffic.depth_frames,
        lost: traffic.lost,
    };
    summary.sensors.iter().map(one).collect()
}

/// Everything left out, the harmless first.
fn left_out(summary: &CaptureSummary) -> Vec<LeftOut> {
    let mut all = Vec::new();
    let mut add = |count: u64, lost: bool, what: String| {
        if count > 0 {
            all.push(LeftOut { what, count, lost });
        }
    };
    add(summary.not_udp, false, "network frames that are not UDP".to_owned());
    add(summary.ignored_files, false, "files that are no depth frames".to_owned());
    for (port, traffic) in &summary.other_ports {
        let first = traffic.payload_bytes;
        add(traffic.datagrams, false, format!("datagrams to port {port}, which no LiDAR has (first: {first} bytes)"));
    }
    for (address, datagrams) in &summary.other_sources {
        add(*datagrams, false, format!("datagrams from {address}, which lidar.source excludes"));
    }
    for (link, frames) in &summary.unread_link_types {
        add(*frames, true, format!("frames of link type {link}, which is not read"));
    }
    add(summary.malformed_frames, true, "frames with contradictory IP or UDP headers".to_owned());
    for (topic, traffic) in &summary.unused_topics {
        let why = match &traffic.first_fault {
            Some(fault) => format!(": {fault}"),
            None => ", which no sensor has".to_owned(),
        };
        let what = format!("messages of {topic} ({}){why}", traffic.type_name);
        add(traffic.messages, traffic.first_fault.is_some(), what);
    }
    add(summary.fragments, true, "IP fragments, which are not put together".to_owned());
    add(summary.cut_short, true, "packets cut short by the capture's snap length".to_owned());
    add(summary.untimed, true, "packets without a usable time".to_owned());
    add(summary.damaged_frames, true, damaged(summary));
    all
}

fn damaged(summary: &CaptureSummary) -> String {
    let first = summary.damaged_files.first();
    let first = first.map(|file| format!(" (first: {}: {})", file.path.display(), file.detail)).unwrap_or_default();
    format!("frames whose files cannot be read{first}")
}

fn broken_file(broken: &BrokenOff) -> BrokenFile {
    let (byte, after_row) = match broken.place {
        Place::Byte(offset) => (Some(offset), None),
        Place::AfterRow(row) => (None, Some(row)),
    };
    BrokenFile { path: broken.path.display().to_string(), byte, after_row, detail: broken.detail.clone() }
}

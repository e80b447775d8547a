//! The report as a page of its own: the verdict first, what is missing, then tables and the whole text.

use super::report::{InfoReport, Verdict};
use super::text;
use crate::experiment::page::{page, table};
use crate::experiment::plot::escaped;

/// The page.
pub(super) fn html(report: &InfoReport) -> String {
    let names: Vec<&str> = report.inputs.iter().map(|input| input.path.as_str()).collect();
    let mut body = format!("<h1>What is in {}</h1>", escaped(&names.join(", ")));
    let missing = missing(&report.verdict);
    if missing.is_empty() {
        body.push_str("<p class=\"good\">Nothing is missing, and everything could be read.</p>");
    }
    let recordings = || report.inputs.iter().filter_map(|input| input.recording.as_ref());
    let warnings = recordings().flat_map(|recording| &recording.warnings);
    let of_sensors = report.lidars.iter().flat_map(|lidar| &lidar.warnings);
    let warnings = warnings.chain(of_sensors).chain(report.kinects.iter().flat_map(|kinect| &kinect.warnings));
    for line in missing.iter().chain(warnings) {
        body.push_str(&format!("<p class=\"bad\">{}</p>", escaped(line)));
    }
    let mut add = |title: &str, heading: &[&str], rows: Vec<Vec<String>>| {
        if !rows.is_empty() {
            body.push_str(&format!("<h2>{}</h2>{}", escaped(title), table(heading, &rows)));
        }
    };
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
    for recording in recordings() {
        let mut rows = vec![
            vec!["session".to_owned(), recording.session.clone()],
            vec!["origin".to_owned(), recording.origin.clone()],
            vec!["recorded by".to_owned(), recording.program.clone()],
        ];
        rows.extend(recording.notes.iter().map(|(key, value)| vec![key.clone(), value.clone()]));
        add("Recording", &["what", "as recorded"], rows);
        let channels = recording.ledger.channels.iter().map(|channel| {
            vec![
                channel.channel.clone(),
                channel.events.to_string(),
                format!("{:.2}", channel.bytes as f64 / 1e6),
                number(channel.rate_hz),
                format!("{:.3}", channel.longest_gap_s),
            ]
        });
        add("Channels", &["channel", "events", "MB", "Hz", "longest gap, s"], channels.collect());
        let lost = recording.ledger.lost.iter();
        let lost = lost.map(|loss| vec![loss.sensor.clone(), loss.place.clone(), loss.count.to_string()]);
        add("Lost", &["sensor", "place", "packets, frames or chunks"], lost.collect());
    }
    let lidars = report.lidars.iter().map(|lidar| {
        vec![
            lidar.id.clone(),
            lidar.model.clone().unwrap_or_else(|| "-".to_owned()),
            lidar.data_packets.to_string(),
            number(lidar.packets_per_s),
            number(lidar.rpm),
            lidar.points.to_string(),
            lidar.loss.map_or_else(|| "-".to_owned(), |loss| loss.lost.to_string()),
        ]
    });
    add("LiDARs", &["id", "model", "packets", "packets/s", "rpm", "points", "packets lost"], lidars.collect());
    let kinects = report.kinects.iter().map(|kinect| {
        vec![
            kinect.id.clone(),
            kinect.frames.to_string(),
            number(kinect.rate_hz),
            kinect.frames_missing.map_or_else(|| "-".to_owned(), |missing| missing.to_string()),
            kinect.usb_packets_lost.to_string(),
            kinect.repeated.to_string(),
        ]
    });
    let heading = ["id", "frames", "frames/s", "frames missing", "USB packets lost", "repeated frames"];
    add("Kinects", &heading, kinects.collect());
    body.push_str(&format!("<h2>All of it</h2><pre class=\"scroll\">{}</pre>", escaped(&text::render(report))));
    page("tumbled: info", &body)
}

/// What is not there, a sentence each.
fn missing(verdict: &Verdict) -> Vec<String> {
    let Verdict { inputs_whole, .. } = verdict;
    let counts = [
        (verdict.lidar_packets_lost, "LiDAR packets were lost"),
        (verdict.lidar_payloads_rejected, "payloads on a LiDAR's ports are no packets of it"),
        (verdict.kinect_packets_lost, "USB packets of Kinects were lost"),
        (verdict.kinect_frames_missing, "frames of Kinects are missing"),
        (verdict.kinect_frames_refused, "frames of Kinects could not be read"),
        (verdict.kinect_frames_repeated, "frames of Kinects came again as they were"),
    ];
    let whole = (!inputs_whole).then(|| "Part of an input could not be read.".to_owned());
    let counts = counts.into_iter().filter(|(count, _)| *count > 0);
    whole.into_iter().chain(counts.map(|(count, what)| format!("{count} {what}."))).collect()
}

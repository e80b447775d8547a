//! Status in plain words: the origin first, then what is wrong, then the sensors, then this machine.

use indicatif::HumanBytes;
use tumbled_core::clock::ClockState;
use tumbled_core::estimate::{EstimateHealth, SpinReport};
use tumbled_core::health::{ClockHealth, LossHealth, SensorHealth, SensorKind};
use tumbled_core::turntable::TurntableErrors;
use tumbled_core::{ClockMode, Level};

use super::StatusReport;
use crate::stream::{QueueUnit, RecorderHealth, RecorderStatus, ShellHealth, SimulationHealth, StreamOrigin};

/// The status as text, its last line ended.
pub(super) fn render(report: &StatusReport) -> String {
    let mut lines = Vec::new();
    head(&mut lines, report);
    reasons(&mut lines, report);
    lines.extend(report.health.estimate.as_ref().map(target));
    lines.push(String::new());
    sensors(&mut lines, &report.health.core.sensors);
    lines.push(String::new());
    machine(&mut lines, &report.health.shell);
    lines.push(String::new());
    lines.join("\n")
}

fn head(lines: &mut Vec<String>, report: &StatusReport) {
    let (hello, health) = (&report.hello, &report.health);
    let origin = match health.origin {
        StreamOrigin::Live => "LIVE",
        StreamOrigin::Replay => "REPLAY: no measurement of now",
        StreamOrigin::Simulated => "SIMULATED: no measurement",
    };
    lines.push(origin.to_owned());
    lines.push(format!("rig {}, session {}, tumbled {}, at {}", hello.rig, hello.session, hello.version, report.at));
    lines.push(format!("{} after {}", level(health.level), lapse(health.shell.uptime_s)));
}

/// The target in a line: what is known, how well, how it spins.
fn target(estimate: &EstimateHealth) -> String {
    let mut line = format!("target {}", estimate.mode.name().replace('_', " "));
    if let Some(sigma) = &estimate.sigma_by_source {
        line += &format!(", to {:.2}° and {:.1} mm", sigma.attitude_deg.total, sigma.position_mm.total);
    }
    if let Some(SpinReport { axis: [x, y, z], rate_dps }) = &estimate.spin {
        line += &format!(", spins at {rate_dps:.2}°/s about ({x:.3}, {y:.3}, {z:.3})");
    }
    for report in estimate.mountings.iter().filter(|report| report.alarm) {
        line += &format!("\n  {}", report.sentence());
    }
    line
}

fn reasons(lines: &mut Vec<String>, report: &StatusReport) {
    for reason in report.health.core.reasons.iter().chain(&report.health.shell.reasons) {
        let whose = reason.sensor.as_deref().unwrap_or("rig");
        lines.push(format!("  {whose}: {} ({})", reason.message, level(reason.level)));
    }
}

const fn level(level: Level) -> &'static str {
    match level {
        Level::Ok => "ok",
        Level::Degraded => "degraded",
        Level::Failed => "FAILED",
    }
}

fn sensors(lines: &mut Vec<String>, sensors: &[SensorHealth]) {
    if sensors.is_empty() {
        lines.push("no sensors".to_owned());
        return;
    }
    let mut rows = vec![["sensor", "state", "rate", "newest", "lost", "clock"].map(str::to_owned)];
    rows.extend(sensors.iter().map(row));
    // The last column is not padded.
    let widths: Vec<usize> = (0..5).map(|k| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0)).collect();
    for row in &rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(&widths) {
            line.push_str(&format!("{cell:width$}  "));
        }
        line.push_str(&row[5]);
        lines.push(line.trim_end().to_owned());
    }
    for sensor in sensors {
        details(lines, sensor);
    }
}

fn row(sensor: &SensorHealth) -> [String; 6] {
    let unit = match sensor.kind {
        SensorKind::Lidar => "packets/s",
        SensorKind::Kinect => "frames/s",
        SensorKind::Serial => "chunks/s",
    };
    [
        sensor.id.clone(),
        sensor.state.name().to_owned(),
        format!("{:.1} {unit}", sensor.rate_hz),
        sensor.age_ns.map_or_else(|| "never".to_owned(), |age| format!("{} ago", lapse(age as f64 * 1e-9))),
        sensor.lost.total.to_string(),
        sensor.clock.as_ref().map_or_else(|| "-".to_owned(), clock),
    ]
}

fn clock(clock: &ClockHealth) -> String {
    let state = match clock.state {
        ClockState::Acquiring => "acquiring",
        ClockState::Locked => "locked",
        ClockState::Holdover => "holdover",
        ClockState::Lost => "lost",
        ClockState::Suspect => "suspect",
    };
    let mode = match clock.mode {
        ClockMode::Hull => "",
        ClockMode::Arrival => ", by arrival",
        ClockMode::Kalman => ", by mean delay",
    };
    let (offset_s, sigma_ms) = (clock.offset_ns as f64 * 1e-9, clock.sigma_ns as f64 * 1e-6);
    format!("{state}{mode}, offset {offset_s:.6} s ± {sigma_ms:.3} ms, skew {:+.2} ppm", clock.skew_ppm)
}

/// What the estimate is off by against the encoder.
fn turntable_errors(errors: &TurntableErrors) -> String {
    let TurntableErrors { about_axis_deg, rate_dps, axis_deg, .. } = errors;
    let axis = axis_deg.map_or_else(String::new, |axis| format!(", axis {axis:.2}° from the calibrated one"));
    format!("estimate less encoder: {about_axis_deg:+.2}° about the axis, {rate_dps:+.3}°/s{axis}")
}

/// What only some sensors have something to say about.
fn details(lines: &mut Vec<String>, sensor: &SensorHealth) {
    let mut said: Vec<String> = Vec::new();
    if let Some(lidar) = &sensor.lidar {
        said.extend(lidar.model.clone());
        said.extend(lidar.return_mode.as_ref().map(|mode| format!("{mode} return")));
        said.extend(lidar.rpm.map(|rpm| format!("{rpm:.0} rpm")));
        said.push(format!("{} points in the region", lidar.points_in_roi));
    }
    if let Some(kinect) = &sensor.kinect {
        said.push(format!("{} points in the region", kinect.points_in_roi));
    }
    let errors = sensor.turntable.as_ref().and_then(|turntable| turntable.errors.as_ref());
    said.extend(errors.map(turntable_errors));
    said.extend(losses(&sensor.lost));
    let malformed: u64 = sensor.malformed.values().sum();
    if malformed > 0 {
        let kinds: Vec<String> = sensor.malformed.iter().map(|(kind, n)| format!("{n} {kind}")).collect();
        said.push(format!("{malformed} not readable ({})", kinds.join(", ")));
    }
    if sensor.epochs.shed_scans > 0 {
        said.push(format!("{} scans shed", sensor.epochs.shed_scans));
    }
    if !said.is_empty() {
        lines.push(format!("  {}: {}", sensor.id, said.join(", ")));
    }
}

/// Losses by what the stamps say and by where they were noticed: the same packet may be in both.
fn losses(lost: &LossHealth) -> Option<String> {
    let places = [
        (lost.kernel, "in the kernel's buffer"),
        (lost.queue, "in the queue"),
        (lost.usb, "on the USB"),
        (lost.recorder, "in the recording"),
        (lost.capture, "before the capture"),
    ];
    let noticed: Vec<String> = places.iter().filter(|(n, _)| *n > 0).map(|(n, place)| format!("{n} {place}")).collect();
    match (lost.by_stamps, noticed.is_empty()) {
        (0, true) => None,
        (0, false) => Some(format!("lost {}", noticed.join(", "))),
        (n, true) => Some(format!("lost {n} by its stamps")),
        (n, false) => Some(format!("lost {n} by its stamps, noticed {}", noticed.join(", "))),
    }
}

fn machine(lines: &mut Vec<String>, shell: &ShellHealth) {
    for queue in &shell.queues {
        let lost = if queue.lost > 0 { format!(", {} lost", queue.lost) } else { String::new() };
        let amount = |n: u64| match queue.unit {
            QueueUnit::Items => n.to_string(),
            QueueUnit::Bytes => HumanBytes(n).to_string(),
        };
        lines.push(format!("queue {}: {} of {}{lost}", queue.name, amount(queue.waiting), amount(queue.bound)));
    }
    if shell.shed_scans > 0 {
        lines.push(format!("shed: {} scans, because the computation was behind; they are recorded", shell.shed_scans));
    }
    if let Some(SimulationHealth { scene, left_out }) = &shell.simulation {
        let mut line = format!("simulated scene: {scene}");
        if left_out.left_out_s > 0.0 || left_out.late > 0 {
            let lapse = lapse(left_out.left_out_s);
            line.push_str(&format!(", {lapse} and {} items left out because this machine was too slow", left_out.late));
        }
        lines.push(line);
    }
    match &shell.recorder {
        Some(recorder) => lines.push(format!("recorder: {}", recording(recorder))),
        None => lines.push("recorder: none".to_owned()),
    }
    let clients = &shell.stream;
    lines.push(format!(
        "clients: {} of {} since the start, {} refused, {} cut off, {} lines dropped",
        clients.clients, clients.accepted, clients.refused, clients.cut_off, clients.dropped
    ));
    for step in &shell.steps {
        lines.push(format!(
            "step {}: half below {:.2} ms, 99 % below {:.2} ms, longest {:.2} ms",
            step.name, step.p50_ms, step.p99_ms, step.max_ms
        ));
    }
    if let Some(bytes) = shell.memory_bytes {
        lines.push(format!("memory: {}", HumanBytes(bytes)));
    }
}

fn recording(recorder: &RecorderHealth) -> String {
    let state = match recorder.state {
        RecorderStatus::Recording => "recording",
        RecorderStatus::StoppedDisk => "STOPPED, the disk is full",
        RecorderStatus::StoppedError => "STOPPED by an error",
    };
    let mut text = format!("{state}, {}, {}", recorder.file, HumanBytes(recorder.bytes));
    if recorder.dropped > 0 {
        text.push_str(&format!(", {} events DROPPED", recorder.dropped));
    }
    if let Some(synced_s) = recorder.synced_s {
        text.push_str(&format!(", safe on the disk up to {} ago", lapse(synced_s)));
    }
    if let Some(free) = recorder.disk_free_bytes {
        text.push_str(&format!(", {} free", HumanBytes(free)));
    }
    text
}

/// A span of time to about three digits.
fn lapse(s: f64) -> String {
    match s {
        ..1.0 => format!("{:.0} ms", s * 1e3),
        1.0..60.0 => format!("{s:.1} s"),
        60.0..3_600.0 => format!("{} min {:.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
        _ => format!("{} h {:.0} min", (s / 3_600.0).floor(), (s % 3_600.0 / 60.0).floor()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_have_about_three_digits() {
        let said = [0.0134, 0.9996, 59.96, 61.5, 7_384.0].map(lapse);
        // 7 384 s = 2 h + 184 s.
        assert_eq!(said, ["13 ms", "1000 ms", "60.0 s", "1 min 1 s", "2 h 3 min"]);
    }
}

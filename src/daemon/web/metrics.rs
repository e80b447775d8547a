//! The metrics, in the text exposition format that monitoring systems read.

use std::fmt::Write;

use tumbled_core::turntable::TruthState;

use super::latest::{FUSION_BOUNDS_S, Known, LATENCY_BOUNDS_S, Latencies};
use crate::stream::{HealthLine, StateLine};

/// What the text is served as.
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Every name's beginning.
const PREFIX: &str = "tumbled_";

/// All that is known, as text. What nobody knows yet is left out; each name stands with its meaning and its kind.
pub fn text(known: &Known, version: &str) -> String {
    let mut text = Text::default();
    text.head("build_info", "gauge", "1; the version stands in its label.");
    text.sample("build_info", &[("version", version)], 1.0);
    text.head("up", "gauge", "1 while health is told as it should be and some sensor delivers, else 0.");
    text.sample("up", &[], f64::from(u8::from(known.well().is_ok())));
    if let Some((age, health)) = &known.health {
        text.one("health_age_seconds", "gauge", "Since health was last told.", age.as_secs_f64());
        session(&mut text, health);
        sensors(&mut text, health);
        shell(&mut text, health);
    }
    if let Some(state) = &known.state {
        target(&mut text, state);
    }
    let help = "From an epoch's time to the hand-over of its state; live only.";
    histogram(&mut text, "epoch_latency_seconds", help, (&known.latencies, &LATENCY_BOUNDS_S));
    let help = "The core's work on an epoch: registration, model and filter; live only.";
    histogram(&mut text, "fusion_seconds", help, (&known.fusion, &FUSION_BOUNDS_S));
    text.0
}

fn session(text: &mut Text, health: &HealthLine) {
    text.head("origin", "gauge", "1; the label says where the data come from: only live is a measurement of now.");
    text.sample("origin", &[("origin", health.origin.name())], 1.0);
    text.one("level", "gauge", "0 ok, 1 degraded, 2 failed.", f64::from(health.level as u8));
    let Some(estimate) = &health.estimate else { return };
    let Some(sigma) = &estimate.sigma_by_source else { return };
    let parts = |parts: &tumbled_core::estimate::SigmaParts| {
        [
            ("registration", parts.registration),
            ("model", parts.model),
            ("extrinsic", parts.extrinsic),
            ("time", parts.time),
            ("total", parts.total),
        ]
    };
    text.head("attitude_sigma_degrees", "gauge", "Standard deviation of the attitude by source.");
    for (source, value) in parts(&sigma.attitude_deg) {
        text.sample("attitude_sigma_degrees", &[("source", source)], value);
    }
    text.head("position_sigma_meters", "gauge", "Standard deviation of the position by source.");
    for (source, value) in parts(&sigma.position_mm) {
        text.sample("position_sigma_meters", &[("source", source)], value * 1e-3);
    }
}

fn sensors(text: &mut Text, health: &HealthLine) {
    type Value = fn(&tumbled_core::health::SensorHealth) -> Option<f64>;
    let columns: [(&str, &str, &str, Value); 12] = [
        ("sensor_live", "gauge", "1 while data of the sensor come, else 0.", |s| {
            Some(f64::from(u8::from(s.state == tumbled_core::health::SensorState::Live)))
        }),
        ("packets_total", "counter", "Packets, frames or chunks that came.", |s| Some(s.received as f64)),
        ("bytes_total", "counter", "Their payload.", |s| Some(s.bytes as f64)),
        ("packet_rate_hertz", "gauge", "Of them in the last second.", |s| Some(s.rate_hz)),
        ("lost_total", "counter", "Packets, frames or chunks lost, each counted once.", |s| Some(s.lost.total as f64)),
        ("kernel_drops_total", "counter", "Lost in the kernel's socket buffer.", |s| Some(s.lost.kernel as f64)),
        ("reordered_total", "counter", "Data that came after later ones.", |s| Some(s.reordered as f64)),
        ("duplicate_total", "counter", "Data that came twice.", |s| Some(s.duplicates as f64)),
        ("frame_age_seconds", "gauge", "Since the newest data came.", |s| Some(s.age_ns? as f64 * 1e-9)),
        ("clock_offset_seconds", "gauge", "Session time minus device time.", |s| {
            Some(s.clock?.offset_ns as f64 * 1e-9)
        }),
        ("clock_skew_ppm", "gauge", "How much slower than the host the device's clock runs.", |s| {
            Some(s.clock?.skew_ppm)
        }),
        ("epochs_total", "counter", "Epochs given out.", |s| Some(s.epochs.given_out as f64)),
    ];
    for (name, kind, help, value) in columns {
        text.head(name, kind, help);
        for sensor in &health.core.sensors {
            if let Some(value) = value(sensor) {
                text.sample(name, &[("sensor", &sensor.id)], value);
            }
        }
    }
    turntables(text, health);
    text.head("clock_state", "gauge", "1 for the state the device's clock is in.");
    for sensor in &health.core.sensors {
        if let Some(clock) = &sensor.clock {
            text.sample("clock_state", &[("sensor", &sensor.id), ("state", clock.state.name())], 1.0);
        }
    }
    text.head("malformed_total", "counter", "Data that could not be read, by what is wrong with them.");
    for sensor in &health.core.sensors {
        for (reason, count) in &sensor.malformed {
            text.sample("malformed_total", &[("sensor", &sensor.id), ("reason", reason)], *count as f64);
        }
    }
}

/// The line to a turntable, and the truth it gives.
fn turntables(text: &mut Text, health: &HealthLine) {
    let found = || health.core.sensors.iter().filter_map(|sensor| Some((sensor, sensor.turntable.as_ref()?)));
    text.head("serial_rtt_seconds", "gauge", "From a request to its answer, newest sample.");
    for (sensor, turntable) in found() {
        if let Some(half_ns) = turntable.half_rtt_ns {
            text.sample("serial_rtt_seconds", &[("sensor", &sensor.id)], 2e-9 * half_ns as f64);
        }
    }
    text.head("truth_age_seconds", "gauge", "Since the encoder's angle was last the truth.");
    for (sensor, turntable) in found() {
        // What is invalid has been so since an instant; what is not is as old as the newest data.
        let age_ns = match turntable.invalid_since_ns {
            Some(since_ns) => Some(health.t_ns - since_ns),
            None => sensor.age_ns.filter(|_| matches!(turntable.truth, TruthState::Valid | TruthState::Stale)),
        };
        if let Some(age_ns) = age_ns {
            text.sample("truth_age_seconds", &[("sensor", &sensor.id)], age_ns as f64 * 1e-9);
        }
    }
}

fn shell(text: &mut Text, health: &HealthLine) {
    let shell = &health.shell;
    text.one("uptime_seconds", "gauge", "Since the session's start.", shell.uptime_s);
    if let Some(memory) = shell.memory_bytes {
        text.one("memory_bytes", "gauge", "Memory of the process that is in RAM.", memory as f64);
    }
    text.head("queue_depth", "gauge", "How much waits between two threads; the unit is items or bytes.");
    for queue in &shell.queues {
        text.sample("queue_depth", &[("queue", &queue.name)], queue.waiting as f64);
    }
    text.head("queue_bound", "gauge", "How much may wait there.");
    for queue in &shell.queues {
        text.sample("queue_bound", &[("queue", &queue.name)], queue.bound as f64);
    }
    text.head("queue_dropped_total", "counter", "Lost because a queue was full.");
    for queue in &shell.queues {
        text.sample("queue_dropped_total", &[("queue", &queue.name)], queue.lost as f64);
    }
    text.one(
        "watchdog_feeds_total",
        "counter",
        "Times the watchdog was fed; 0 outside of a service.",
        shell.watchdog_feeds as f64,
    );
    text.one("pretrigger_bytes", "gauge", "Kept of the past, for a snapshot.", shell.pretrigger_bytes as f64);
    text.one(
        "shed_scans_total",
        "counter",
        "Scans not measured with because the core was behind.",
        shell.shed_scans as f64,
    );
    if let Some(recorder) = &shell.recorder {
        text.one("recording_bytes", "gauge", "Written, all parts together.", recorder.bytes as f64);
        text.one("recording_dropped_total", "counter", "Events missing in the recording.", recorder.dropped as f64);
        if let Some(free) = recorder.disk_free_bytes {
            text.one("disk_free_bytes", "gauge", "Free on the recording's disk.", free as f64);
        }
    }
    text.one("clients", "gauge", "Clients of the state stream, pages among them.", shell.stream.clients as f64);
    text.one(
        "client_dropped_total",
        "counter",
        "Lines dropped because a client was behind.",
        shell.stream.dropped as f64,
    );
    text.one(
        "client_cut_off_total",
        "counter",
        "Clients cut off because they did not read.",
        shell.stream.cut_off as f64,
    );
    text.head("step_seconds", "gauge", "How long the steps of the work take over the last minute.");
    for step in &shell.steps {
        for (quantile, ms) in [("0.5", step.p50_ms), ("0.99", step.p99_ms), ("1", step.max_ms)] {
            text.sample("step_seconds", &[("step", &step.name), ("quantile", quantile)], ms * 1e-3);
        }
    }
}

fn target(text: &mut Text, state: &StateLine) {
    text.head("mode", "gauge", "1; the label says how much is known of the target.");
    text.sample("mode", &[("mode", state.mode.name())], 1.0);
    text.one("epoch", "gauge", "The newest epoch's number.", state.epoch as f64);
    if let Some(nis) = state.nis {
        text.one("nis", "gauge", "The innovation's normalised square; 6 on the average.", nis);
    }
    if let Some(spin) = &state.spin {
        text.one("spin_rate_dps", "gauge", "Spin rate, degrees a second.", spin.rate_dps);
        text.one("spin_rate_sigma_dps", "gauge", "Its standard deviation.", spin.rate_sigma_dps);
        text.one("spin_axis_sigma_degrees", "gauge", "Standard deviation of the spin axis.", spin.axis_sigma_deg);
    }
}

fn histogram(text: &mut Text, name: &str, help: &str, (found, bounds_s): (&Latencies, &[f64])) {
    text.head(name, "histogram", help);
    let bucket = format!("{name}_bucket");
    let mut below = 0;
    for (count, bound) in found.counts.iter().zip(bounds_s) {
        below += count;
        text.sample(&bucket, &[("le", &bound.to_string())], below as f64);
    }
    let all: u64 = found.counts.iter().sum();
    text.sample(&bucket, &[("le", "+Inf")], all as f64);
    text.sample(&format!("{name}_sum"), &[], found.sum_s);
    text.sample(&format!("{name}_count"), &[], all as f64);
}

/// The text that grows.
#[derive(Debug, Default)]
struct Text(String);

impl Text {
    fn head(&mut self, name: &str, kind: &str, help: &str) {
        self.add(format_args!("# HELP {PREFIX}{name} {help}\n# TYPE {PREFIX}{name} {kind}\n"));
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        self.add(format_args!("{PREFIX}{name}"));
        for (index, (label, of)) in labels.iter().enumerate() {
            let before = if index == 0 { '{' } else { ',' };
            self.add(format_args!("{before}{label}=\"{}\"", escaped(of)));
        }
        let end = if labels.is_empty() { "" } else { "}" };
        self.add(format_args!("{end} {value}\n"));
    }

    fn one(&mut self, name: &str, kind: &str, help: &str, value: f64) {
        self.head(name, kind, help);
        self.sample(name, &[], value);
    }

    fn add(&mut self, what: std::fmt::Arguments<'_>) {
        // A String takes everything.
        self.0.write_fmt(what).unwrap_or_default();
    }
}

/// A label's value as the format wants it.
fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_cannot_end_itself() {
        let mut text = Text::default();
        text.sample("up", &[("sensor", "a\"}\\\n")], 1.0);
        assert_eq!(text.0, "tumbled_up{sensor=\"a\\\"}\\\\\\n\"} 1\n");
    }

    #[test]
    fn a_histogram_is_cumulative_and_ends_with_all() {
        let latencies = Latencies { counts: [1, 2, 0, 0, 0, 0, 0, 0, 0, 4], sum_s: 9.5 };
        let known = Known { latencies, ..Known::default() };
        let text = text(&known, "1");
        for line in [
            "_bucket{le=\"0.02\"} 1",
            "_bucket{le=\"0.05\"} 3",
            "_bucket{le=\"2\"} 3",
            "_bucket{le=\"+Inf\"} 7",
            "_count 7",
        ] {
            assert!(text.contains(&format!("tumbled_epoch_latency_seconds{line}\n")), "{line} in {text}");
        }
    }
}

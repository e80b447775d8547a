//! What `calibrate time` tells: how late each sensor's stamps are, against the encoder.

use nalgebra::Unit;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_calib::time::{Correlated, Phase, TimedAngle, correlate, phase};
use tumbled_calib::turntable::{TurnedPose, stepwise_axis};
use tumbled_calib::{Gate, Status};
use tumbled_core::evaluate::EstimateSample;
use tumbled_model::se3::turned_about;

use super::frame::{self, Parameter};
use super::provenance::Provenance;
use crate::experiment::page::table;
use crate::experiment::plot::{Line, Plot, escaped};

/// σ above which a result warns and fails, ms: 2 ms are 0.04° at 20 °/s. What is known worse is no calibration of a time.
const SIGMA_MS: (f64, f64) = (1.0, 2.0);

/// How an offset was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TimeMethod {
    /// Phase against rate.
    Phase,
    /// Cross-correlation of the rates.
    Correlation,
}

impl TimeMethod {
    const fn name(self) -> &'static str {
        match self {
            Self::Phase => "phase against rate",
            Self::Correlation => "cross-correlation",
        }
    }
}

/// A run at one rate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RunRow {
    /// °/s, with its sign.
    pub rate_dps: f64,
    /// Whole turns used.
    pub turns: u64,
    /// States in them.
    pub states: u64,
    /// Mean angle of the states less the encoder's, degrees; 0 at rest.
    pub phase_deg: f64,
    /// What the line through all runs leaves of it, degrees.
    pub residual_deg: f64,
}

/// One sensor's time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorTime {
    /// Whose.
    pub id: String,
    /// What it was found by; null: by nothing.
    pub method: Option<TimeMethod>,
    /// The offset the config had, ms.
    pub before_ms: f64,
    /// The offset found, ms: measurement time = mapped stamp − offset, so positive where the stamps are late.
    pub time_offset_ms: Option<f64>,
    /// One standard deviation, ms, that of the encoder's own times included.
    pub sigma_ms: Option<f64>,
    /// Runs at one rate.
    pub runs: Vec<RunRow>,
    /// By cross-correlation, ms, where the capture lets it be; a check beside the phases.
    pub correlation_ms: Option<f64>,
    /// One standard deviation of it, ms.
    pub correlation_sigma_ms: Option<f64>,
    /// Its second peak over the first.
    pub second_peak: Option<f64>,
    /// Why a method gave nothing.
    pub refused: Vec<String>,
}

/// `tumbled calibrate time --json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled calibrate time --json")]
pub struct TimeReport {
    /// The verdict, gates and inputs.
    pub provenance: Provenance,
    /// Sensor by sensor.
    pub sensors: Vec<SensorTime>,
    /// The file the results stand in; null: none was written.
    pub written: Option<String>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// States with the encoder's angles as angles about the stage's axis, in the encoder's sense.
pub fn angles(turned: &[(&EstimateSample, f64)]) -> Vec<TimedAngle> {
    let pose = |(state, angle_rad): &(&EstimateSample, f64)| TurnedPose {
        angle_rad: *angle_rad,
        t_rig_target: state.t_rig_target,
    };
    let poses: Vec<TurnedPose> = turned.iter().map(pose).collect();
    let Some(axis) = Unit::try_new(stepwise_axis(&poses), 0.1) else { return Vec::new() };
    let Some(((first, _), _)) = turned.split_first() else { return Vec::new() };
    let about = |state: &EstimateSample| {
        turned_about(&(state.t_rig_target.rotation * first.t_rig_target.rotation.inverse()), &axis)
    };
    let angle = |(state, encoder_rad): &(&EstimateSample, f64)| TimedAngle {
        t_s: (state.t - first.t).as_secs_f64(),
        encoder_rad: *encoder_rad,
        state_rad: about(state),
    };
    turned.iter().map(angle).collect()
}

/// One sensor's time by both methods, with its gates; the phases count where both give one. `encoder_sigma_s`: of the
/// encoder's own times. `depth_camera`: whether the sensor sees all of the target's face at once. Of a LiDAR alone the estimate stays
/// behind a turning target in proportion to its rate, which is what a late stamp looks like: that is refused, whatever its σ.
pub fn sensor(
    id: &str,
    depth_camera: bool,
    before_ms: f64,
    angles: &[TimedAngle],
    encoder_sigma_s: f64,
) -> (SensorTime, Vec<Gate>) {
    let (phase, correlated) = (phase(angles), correlate(angles));
    let mut refused = Vec::new();
    if let Err(reason) = &phase {
        refused.push(format!("{}: {reason}", TimeMethod::Phase.name()));
    }
    if let Err(reason) = &correlated {
        refused.push(format!("{}: {reason}", TimeMethod::Correlation.name()));
    }
    let with_encoder = |sigma_s: f64| 1e3 * sigma_s.hypot(encoder_sigma_s);
    let by_phase = phase.as_ref().ok().map(|found| (TimeMethod::Phase, found.late_s, found.sigma_s));
    let by_rates = correlated.as_ref().ok().map(|found| (TimeMethod::Correlation, found.late_s, found.sigma_s));
    let found = by_phase.or(by_rates);
    let mut gates = match found {
        Some((_, _, sigma_s)) => vec![Gate::at_most(
            &format!("{id}: sigma of the time"),
            with_encoder(sigma_s),
            "ms",
            (Some(SIGMA_MS.0), Some(SIGMA_MS.1)),
            "more turns at 5, 10 and 20 °/s both ways, the target's sides in view",
        )],
        None => vec![Gate::failed(&format!("{id}: time"), refused.join("; "))],
    };
    if found.is_some() && !depth_camera {
        gates.push(Gate::failed(
            &format!("{id}: time by a LiDAR alone"),
            "the estimate of a LiDAR alone stays behind a turning target by some 0.3 degrees at 20 °/s, which no method here tells from \
             stamps that are 15 ms late: take its time from PTP or its own stamps, and calibrate the Kinect's with --sensor",
        ));
    }
    let sensor = SensorTime {
        id: id.to_owned(),
        method: found.map(|(method, ..)| method),
        before_ms,
        time_offset_ms: found.map(|(_, late_s, _)| before_ms + 1e3 * late_s),
        sigma_ms: found.map(|(_, _, sigma_s)| with_encoder(sigma_s)),
        runs: phase.as_ref().map(rows).unwrap_or_default(),
        correlation_ms: correlated.as_ref().ok().map(|found: &Correlated| before_ms + 1e3 * found.late_s),
        correlation_sigma_ms: correlated.as_ref().ok().map(|found| with_encoder(found.sigma_s)),
        second_peak: correlated.as_ref().ok().map(|found| found.second_peak),
        refused,
    };
    (sensor, gates)
}

fn rows(phase: &Phase) -> Vec<RunRow> {
    let row = |run: &tumbled_calib::time::PhaseRun| RunRow {
        rate_dps: run.rate_rps.to_degrees(),
        turns: run.turns as u64,
        states: run.states as u64,
        phase_deg: run.phase_rad.to_degrees(),
        residual_deg: run.residual_rad.to_degrees(),
    };
    phase.runs.iter().map(row).collect()
}

/// What is read on a terminal.
pub fn text(report: &TimeReport) -> String {
    let mut text = format!("{}\n", frame::verdict(&report.provenance));
    for sensor in &report.sensors {
        match (sensor.time_offset_ms, sensor.sigma_ms, sensor.method) {
            (Some(offset), Some(sigma), Some(method)) => text.push_str(&format!(
                "  {}: time_offset_ms {offset:.3} ± {sigma:.3} by {} (the config had {:.3})\n",
                sensor.id,
                method.name(),
                sensor.before_ms
            )),
            _ => text.push_str(&format!("  {}: no offset\n", sensor.id)),
        }
        for run in &sensor.runs {
            text.push_str(&format!(
                "    {:>8.3} deg/s, {} turns, {} states: phase {:+.4} deg, left {:+.4} deg\n",
                run.rate_dps, run.turns, run.states, run.phase_deg, run.residual_deg
            ));
        }
        if let (Some(offset), Some(sigma)) = (sensor.correlation_ms, sensor.correlation_sigma_ms) {
            text.push_str(&format!("    by cross-correlation {offset:.3} ± {sigma:.3} ms\n"));
        }
    }
    for gate in report.provenance.gates.iter().filter(|gate| gate.status != Status::Pass) {
        let remedy = gate.remedy.as_deref().unwrap_or_default();
        text.push_str(&format!("  {}: {}: {remedy}\n", gate.status.name(), gate.name));
    }
    if let Some(path) = &report.written {
        text.push_str(&format!("written to {path}\n"));
    }
    text
}

/// The report's page.
pub fn page(report: &TimeReport) -> String {
    let told = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3} ms"));
    let parameters: Vec<Parameter> = report
        .sensors
        .iter()
        .map(|sensor| Parameter {
            name: format!("{}: time_offset_ms", sensor.id),
            value: told(sensor.time_offset_ms),
            sigma: told(sensor.sigma_ms),
        })
        .collect();
    let mut rest = String::from(
        "<p>Measurement time = mapped stamp − offset: positive where the stamps are late. A sensor that is δ late shows the \
         target where it was δ ago: its phase against the encoder falls with the rate, by δ.</p>",
    );
    for sensor in &report.sensors {
        rest.push_str(&format!("<h2>{}</h2>", escaped(&sensor.id)));
        for reason in &sensor.refused {
            rest.push_str(&format!("<p>{}</p>", escaped(reason)));
        }
        let mut points: Vec<(f64, f64)> = sensor.runs.iter().map(|run| (run.rate_dps, run.phase_deg)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fitted = sensor.runs.iter().map(|run| (run.rate_dps, run.phase_deg - run.residual_deg));
        let mut fitted: Vec<(f64, f64)> = fitted.collect();
        fitted.sort_by(|a, b| a.0.total_cmp(&b.0));
        if !points.is_empty() {
            let plot = Plot {
                title: "phase against rate".to_owned(),
                x: "deg/s".to_owned(),
                y: "degrees".to_owned(),
                logarithmic: false,
                y_to: 0.0,
                lines: vec![
                    Line { name: "measured".to_owned(), points },
                    Line { name: "line".to_owned(), points: fitted },
                ],
            };
            rest.push_str(&plot.svg());
            let row = |run: &RunRow| {
                vec![
                    format!("{:.3}", run.rate_dps),
                    run.turns.to_string(),
                    run.states.to_string(),
                    format!("{:+.4}", run.phase_deg),
                    format!("{:+.4}", run.residual_deg),
                ]
            };
            let rows: Vec<Vec<String>> = sensor.runs.iter().map(row).collect();
            rest.push_str(&table(&["rate, deg/s", "turns", "states", "phase, deg", "left, deg"], &rows));
        }
        if sensor.correlation_ms.is_some() {
            rest.push_str(&format!(
                "<p>By cross-correlation: {} ± {}.</p>",
                told(sensor.correlation_ms),
                told(sensor.correlation_sigma_ms)
            ));
        }
    }
    let about = "How late each sensor's stamps are, alone, against the turntable's encoder.";
    frame::report("Time", about, &report.provenance, &parameters, &rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// States that follow a stage at three rates each way, two turns and some each, 3 ms late.
    fn followed() -> Vec<TimedAngle> {
        let (late_s, step_s) = (0.003, 0.05);
        let (mut t_s, mut at) = (0.0, 0.0_f64);
        let mut angles = Vec::new();
        for dps in [20.0_f64, -20.0, 30.0, -30.0, 40.0, -40.0] {
            let rate = dps.to_radians();
            for _ in 0..(2.6 * 360.0 / dps.abs() / step_s) as usize {
                (t_s, at) = (t_s + step_s, at + rate * step_s);
                angles.push(TimedAngle { t_s, encoder_rad: at, state_rad: at - rate * late_s });
            }
            for _ in 0..60 {
                t_s += step_s;
                angles.push(TimedAngle { t_s, encoder_rad: at, state_rad: at });
            }
        }
        angles
    }

    #[test]
    fn a_lidar_alone_is_refused_what_a_kinect_is_given() {
        let status = |depth_camera| {
            let (sensor, gates) = sensor("one", depth_camera, 1.0, &followed(), 1e-4);
            let found = sensor.time_offset_ms.expect("an offset");
            assert!((found - 4.0).abs() < 0.2, "{found}");
            Status::worst(gates.iter().map(|gate| gate.status))
        };
        assert_eq!([true, false].map(status), [Status::Pass, Status::Fail]);
    }

    #[test]
    fn what_is_known_worse_than_two_milliseconds_is_refused() {
        let (_, gates) = sensor("one", true, 0.0, &followed(), 3e-3);
        let gate = gates.first().expect("a gate");
        assert_eq!(gate.status, Status::Fail, "{gate:?}");
    }
}

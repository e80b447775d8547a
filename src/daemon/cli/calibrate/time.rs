//! `tumbled calibrate time`: how late each sensor's stamps are, against the turntable's encoder.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args as ClapArgs;
use tumbled_calib::{Gate, Status};

use crate::calibration::plays::{Change, Played, play_all};
use crate::calibration::time::{self as told, SensorTime, TimeReport};
use crate::calibration::{Provenance, file, provenance};
use crate::cli::{ConfigArgs, Failure, InputArgs, Outcome, output, signals};
use crate::config::Config;
use crate::config::calibration::RawCalibration;

/// What `calibrate time` is asked for.
#[derive(Debug, ClapArgs)]
#[command(
    after_help = "Examples:\n  tumbled calibrate time --from run.mcap -o calibration.toml --report time.html\n  \
    tumbled calibrate time --from run.mcap --sensor near -o calibration.toml\n\n\
    Turn the stage at 5, 10 and 20 degrees a second, two turns and some each way, with the target on it. Each sensor is \
    calibrated by itself: the capture is played once for each, without the others. By phase against rate, over whole turns; \
    or, where the rate changes all the time, by cross-correlation.\n\
    Measurement time = mapped stamp - time_offset_ms: positive where the stamps are late.\n\
    Exit code 3: a gate failed; the sensors that passed are written, the report says what the others lack."
)]
pub struct Args {
    /// Captures in which the stage turns both ways; several are merged by host time.
    #[arg(long, value_name = "INPUT", required = true, num_args = 1..)]
    from: Vec<PathBuf>,
    /// The calibration file that the results are written into; other results in it stay.
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,
    /// A page with the verdict, the gates and what is behind them.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// One sensor alone, by its id; repeatable. [default: all of the config]
    #[arg(long = "sensor", value_name = "ID")]
    sensors: Vec<String>,
    /// Sensors calibrated at a time; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

/// Calibrates.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used, inputs without a turntable's angles, an id that is none. 1: a file
/// that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let input = InputArgs { inputs: args.from.clone(), config: args.config.clone() };
    let loaded = input.load()?;
    let mut calibration = file::read(&args.output)?;
    let sensors = sensors(&loaded.config, &args.sensors)?;
    let inputs = provenance::digests(&args.from)?;
    let changes: Vec<Change> = sensors.iter().map(|(id, _)| alone(id.clone())).collect();
    let Some(plays) = play_all(&args.from, &loaded.config, &changes, args.threads, &signals::stop_token()?)? else {
        return Err(Failure::failed("stopped before the inputs' end: nothing was calculated"));
    };
    let (mut warnings, mut gates, mut found) = (Vec::new(), Vec::new(), Vec::new());
    for ((id, before_ms), played) in sensors.iter().zip(&plays) {
        let depth_camera = loaded.config.kinects.iter().any(|kinect| kinect.id.to_string() == *id);
        let (sensor, more) = one(id, depth_camera, *before_ms, played, &mut warnings)?;
        found.push(sensor);
        gates.extend(more);
    }
    let mut provenance = Provenance::new(inputs, gates);
    provenance.covariance_of = found.iter().map(|sensor| format!("{}: time_offset_ms, ms", sensor.id)).collect();
    let variance = |n: usize, m: usize, sensor: &SensorTime| match sensor.sigma_ms {
        Some(sigma) if n == m => sigma * sigma,
        _ => 0.0,
    };
    let row = |(n, sensor): (usize, &SensorTime)| (0..found.len()).map(|m| variance(n, m, sensor)).collect();
    provenance.covariance = found.iter().enumerate().map(row).collect();
    let passed: Vec<&SensorTime> = found.iter().filter(|sensor| passes(sensor, &provenance.gates)).collect();
    let mut written = None;
    if !passed.is_empty() {
        passed.iter().for_each(|sensor| put(&mut calibration, &loaded.config, sensor));
        file::note(&mut calibration, "time", &provenance)?;
        super::write(&args.output, &calibration)?;
        written = Some(args.output.display().to_string());
    }
    let report = TimeReport { provenance, sensors: found, written, warnings };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if let Some(path) = &args.report {
        output::file(path, told::page(&report))?;
    }
    output::report(&report, args.json, || told::text(&report))?;
    let is_fine = report.provenance.status != Status::Fail && plays.iter().all(|played| played.complete);
    Ok(if is_fine { Outcome::Fine } else { Outcome::Incomplete })
}

/// The sensors asked for, with the offsets the config has, ms.
fn sensors(config: &Config, wanted: &[String]) -> Result<Vec<(String, f64)>, Failure> {
    let ms = |offset: tumbled_model::Span| offset.as_secs_f64() * 1e3;
    let lidars = config.lidars.iter().map(|lidar| (lidar.id.to_string(), ms(lidar.time_offset)));
    let kinects = config.kinects.iter().map(|kinect| (kinect.id.to_string(), ms(kinect.time_offset)));
    let all: Vec<(String, f64)> = lidars.chain(kinects).collect();
    let ids = || all.iter().map(|(id, _)| id.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(unknown) = wanted.iter().find(|wanted| !all.iter().any(|(id, _)| id == *wanted)) {
        return Err(Failure::input(format!("--sensor {unknown}: the config has {}", ids())));
    }
    let is_wanted = |(id, _): &(String, f64)| wanted.is_empty() || wanted.contains(id);
    let sensors: Vec<_> = all.iter().filter(|sensor| is_wanted(sensor)).cloned().collect();
    if sensors.is_empty() {
        return Err(Failure::input("the config has no sensor to calibrate").with_help("give one with --config"));
    }
    Ok(sensors)
}

/// The config without every other sensor.
fn alone(id: String) -> Change {
    Arc::new(move |config| {
        config.lidars.retain(|lidar| lidar.id.to_string() == id);
        config.kinects.retain(|kinect| kinect.id.to_string() == id);
    })
}

fn one(
    id: &str,
    depth_camera: bool,
    before_ms: f64,
    played: &Played,
    warnings: &mut Vec<String>,
) -> Result<(SensorTime, Vec<Gate>), Failure> {
    let mut more = played.warnings.clone();
    let encoder = played.encoder(&mut more)?;
    let angles = told::angles(&played.turned(&encoder, &mut more));
    for warning in more {
        let warning = format!("{id}: {warning}");
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }
    Ok(told::sensor(id, depth_camera, before_ms, &angles, played.encoder_sigma_s()))
}

fn passes(sensor: &SensorTime, gates: &[Gate]) -> bool {
    let own = format!("{}:", sensor.id);
    sensor.time_offset_ms.is_some()
        && gates.iter().filter(|gate| gate.name.starts_with(&own)).all(|gate| gate.status != Status::Fail)
}

/// Writes an offset into the file; of a sensor whose other standard deviations are known, its own too.
fn put(file: &mut RawCalibration, config: &Config, sensor: &SensorTime) {
    if let Some(lidar) = config.lidars.iter().find(|lidar| lidar.id.to_string() == sensor.id) {
        let entry = file.lidar.entry(sensor.id.clone()).or_default();
        entry.time_offset_ms = sensor.time_offset_ms;
        let known = entry.sigma.or(lidar.sigma).zip(sensor.sigma_ms);
        entry.sigma =
            known.map(|(known, time_offset_ms)| crate::config::raw::RawLidarSigma { time_offset_ms, ..known });
    }
    if let Some(kinect) = config.kinects.iter().find(|kinect| kinect.id.to_string() == sensor.id) {
        let entry = file.kinect.entry(sensor.id.clone()).or_default();
        entry.time_offset_ms = sensor.time_offset_ms;
        let known = entry.sigma.or(kinect.sigma).zip(sensor.sigma_ms);
        entry.sigma =
            known.map(|(known, time_offset_ms)| crate::config::raw::RawKinectSigma { time_offset_ms, ..known });
    }
}

//! `tumbled export`: what the sensors measured, in files other programs open.
//!
//! ```text
//!   inputs ─▶ events ─┬─▶ lidar:  packets → points ─▶ PointFile (pts, csv, ply, pcd)
//!                     ├─▶ kinect: frames → depth or points ─▶ one file a frame (png, csv, ply, pcd), times.txt
//!                     └─▶ session: through the core → states (tum, csv), the target's points (csv, ply, pcd)
//! ```

mod frames;
mod kinect;
mod lidar;
mod outfile;
mod protected;
mod session;
mod table;
mod turns;

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use clap::{Args as ClapArgs, ValueEnum};
use schemars::JsonSchema;
use serde::Serialize;

use super::{Failure, InputArgs, Outcome, output};
use crate::decoding::Inputs;
pub use frames::FrameRange;
use protected::Protected;

/// What `export` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled export drive.pcap --what lidar-points --format ply -o cloud.ply\n  \
    tumbled export drive.pcap --what lidar-points --format csv -o first-turn.csv --frames 0..1\n  \
    tumbled export dump/ --what kinect-depth --format png -o depth/\n  \
    tumbled export run.mcap --what state --format tum -o poses.tum\n\n\
    Exit code 3: everything there is was exported, but data of the sensor are missing: part of an input could not be \
    read or decoded, or packets were lost before the capture, by the sensor's own stamps. The warnings say what and how \
    much.")]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// What to export.
    #[arg(long, value_enum)]
    what: What,
    /// The file format.
    #[arg(long, value_enum)]
    format: Format,
    /// The file to write; a folder for several Kinect frames, which also gets their host times (times.txt).
    #[arg(short = 'o', long = "output", value_name = "PATH")]
    output: PathBuf,
    /// Kinect: frames A to B-1 of the inputs, counted from 0. LiDAR: turns of the head, counted from the first packet.
    /// State: epochs.
    #[arg(long, value_name = "A..B", default_value = "..")]
    frames: FrameRange,
    /// The sensor, where the config has several of the kind; of states, those by its epochs.
    #[arg(long, value_name = "ID")]
    sensor: Option<String>,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// What can be exported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum What {
    /// Every LiDAR return: per packet, in the sensor's frame, nothing moved or filtered.
    LidarPoints,
    /// Points of each depth frame, in the depth camera's frame.
    KinectPoints,
    /// Depth images, millimetres.
    KinectDepth,
    /// The target's points by all sensors, in its frame, as they were fused.
    Fused,
    /// The target's state after every epoch: pose target to rig.
    State,
    /// The target's points laid on the planes that were found, in its frame.
    Model,
}

/// File formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum Format {
    /// 24-byte records, little-endian (LiDAR).
    Pts,
    /// Comma-separated text with a heading.
    Csv,
    /// PLY, binary little-endian: MeshLab, CloudCompare, Blender.
    Ply,
    /// PCD, binary: the Point Cloud Library.
    Pcd,
    /// 16-bit grey PNG, millimetres, 0 = no data.
    Png,
    /// A line for each pose: Unix time in seconds, x y z, quaternion x y z w (states).
    Tum,
}

impl Format {
    const fn extension(self) -> &'static str {
        match self {
            Self::Pts => "pts",
            Self::Csv => "csv",
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::Png => "png",
            Self::Tum => "tum",
        }
    }
}

/// What was written.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Report {
    what: What,
    format: Format,
    /// The sensor exported; `target`: what all of them gave.
    sensor: String,
    /// The files, in order of the frames; what of a name is no UTF-8 is replaced by U+FFFD.
    files: Vec<String>,
    /// LiDAR: data packets. Kinect: depth frames. State: epochs. Fused and model: frames and crossings it is made of.
    records: u64,
    /// Points, or pixels with a depth; states that were written.
    points: u64,
    /// LiDAR: packets that the stamps say were sent and that the inputs do not hold. Kinect: USB packets missing in the
    /// frames. Of a session it is not counted here: `tumbled info` and `tumbled replay --json` tell it.
    lost: u64,
    /// LiDAR: payloads on the sensor's ports that gave no points. Kinect: frames that could not be decoded.
    not_decoded: u64,
    /// Nothing is missing: the inputs could be read whole, nothing is lost and nothing was not decoded. Otherwise the
    /// exit code is 3.
    complete: bool,
    /// What a person should know.
    warnings: Vec<String>,
}

/// Exports.
///
/// # Errors
/// Exit code 2: an input or a combination that cannot be used. 1: a file that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = args.input.load()?;
    let protected = Protected::new(args, &loaded);
    // Better now than after reading it all; a folder's files are looked at one by one.
    protected.allow(&args.output, &protected::resolve(&args.output).unwrap_or_else(|_| args.output.clone()))?;
    // Asked now: writing may give the name to another file.
    let on_stdout = is_stdout(&args.output);
    let of_session = matches!(args.what, What::Fused | What::State | What::Model);
    let mut inputs = if of_session {
        Inputs::open_ledger(&args.input.inputs, &loaded.config, 0)?
    } else {
        Inputs::open(&args.input, &loaded.config)?
    };
    let mut report = match (args.what, args.format) {
        (What::LidarPoints, Format::Pts | Format::Csv | Format::Ply | Format::Pcd) => {
            lidar::export(args, &loaded.config, &protected, &mut inputs)?
        }
        (What::KinectPoints, Format::Csv | Format::Ply | Format::Pcd)
        | (What::KinectDepth, Format::Png | Format::Csv) => {
            kinect::export(args, &loaded.config, &protected, &mut inputs)?
        }
        (What::State, Format::Tum | Format::Csv)
        | (What::Fused | What::Model, Format::Csv | Format::Ply | Format::Pcd) => {
            session::export(args, &loaded, &protected, &mut inputs)?
        }
        (what, format) => return Err(no_such_combination(what, format)),
    };
    report.warnings.extend(inputs.warnings());
    report.complete &= !inputs.data_lost() && report.lost == 0 && report.not_decoded == 0;
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    match (args.json, on_stdout) {
        (true, false) => output::json(&report)?,
        (false, false) => output::text(&summary(&report))?,
        // The points are there, the report must not stand among them.
        (_, true) => tracing::info!("{}", summary(&report).trim_end()),
    }
    Ok(if report.complete { Outcome::Fine } else { Outcome::Incomplete })
}

/// Whether a path is where standard output goes.
fn is_stdout(path: &Path) -> bool {
    let identity = |path: &Path| path.metadata().ok().map(|metadata| (metadata.dev(), metadata.ino()));
    let is_null = path.canonicalize().is_ok_and(|path| path == Path::new("/dev/null"));
    !is_null && identity(path).is_some_and(|output| identity(Path::new("/dev/stdout")) == Some(output))
}

/// A failure of an export that found nothing, with what went wrong in the inputs: that is the likely reason.
fn nothing_exported(why: &str, inputs: &Inputs) -> Failure {
    const TOLD: usize = 5;
    let damage = inputs.damage();
    let mut text = why.to_owned();
    for reason in damage.iter().take(TOLD) {
        text.push_str(&format!("; {reason}"));
    }
    if damage.len() > TOLD {
        text.push_str(&format!("; and {} more", damage.len() - TOLD));
    }
    Failure::input(text)
}

/// Paths as the report has them.
fn names(paths: &[PathBuf]) -> Vec<String> {
    paths.iter().map(|path| path.display().to_string()).collect()
}

fn no_such_combination(what: What, format: Format) -> Failure {
    let formats = match what {
        What::LidarPoints => "pts, csv, ply or pcd",
        What::KinectPoints => "csv, ply or pcd",
        What::KinectDepth => "png or csv",
        What::Fused | What::Model => "csv, ply or pcd",
        What::State => "tum or csv",
    };
    let name = |value: &dyn Fn() -> Option<clap::builder::PossibleValue>| {
        value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    };
    let (what, format) = (name(&|| what.to_possible_value()), name(&|| format.to_possible_value()));
    Failure::input(format!("{what} has no format {format}")).with_help(format!("use --format {formats}"))
}

fn summary(report: &Report) -> String {
    let (records, points) = match report.what {
        What::LidarPoints => ("packets", "points"),
        What::KinectPoints => ("frames", "points"),
        What::KinectDepth => ("frames", "pixels with a depth"),
        What::Fused | What::Model => ("frames and crossings", "points"),
        What::State => ("epochs", "states"),
    };
    let files = match report.files.as_slice() {
        [] => "nothing".to_owned(),
        [one] => one.clone(),
        [first, .., last] => format!("{} files, {first} to {last}", report.files.len()),
    };
    let mut text = format!("{}: {} {records}, {} {points} -> {files}\n", report.sensor, report.records, report.points);
    match report.what {
        _ if report.lost == 0 => {}
        What::LidarPoints => {
            text.push_str(&format!("{} packets are missing in the inputs, by their stamps\n", report.lost));
        }
        _ => text.push_str(&format!("{} USB packets are missing in the frames\n", report.lost)),
    }
    if report.not_decoded > 0 {
        let what = if report.what == What::LidarPoints { "payloads" } else { "frames" };
        text.push_str(&format!("{} {what} could not be decoded\n", report.not_decoded));
    }
    text
}

/// The one sensor of a kind to export: the one named, or the only one.
fn choose<'a, T>(
    sensors: &'a [T],
    id: impl Fn(&T) -> &str,
    wanted: Option<&str>,
    kind: &str,
) -> Result<&'a T, Failure> {
    let names = || sensors.iter().map(&id).collect::<Vec<_>>().join(", ");
    match (wanted, sensors) {
        (_, []) => Err(Failure::input(format!("the config has no {kind}"))),
        (None, [only]) => Ok(only),
        (None, _) => Err(Failure::input(format!("the config has several {kind}s: {}", names()))
            .with_help("choose one with --sensor ID")),
        (Some(wanted), _) => sensors.iter().find(|sensor| id(sensor) == wanted).ok_or_else(|| {
            Failure::input(format!("the config has no {kind} `{wanted}`")).with_help(format!("there is: {}", names()))
        }),
    }
}

//! `tumbled export`: what the sensors measured, in files other programs open.
//!
//! ```text
//!   inputs ─▶ events ─┬─▶ lidar:  packets → points ─▶ PointFile (pts, csv, ply, pcd)
//!                     └─▶ kinect: frames → depth or points ─▶ one file a frame (png, csv, ply, pcd)
//! ```

mod frames;
mod kinect;
mod lidar;
mod outfile;
mod table;

use std::path::PathBuf;

use clap::{Args as ClapArgs, ValueEnum};
use schemars::JsonSchema;
use serde::Serialize;

use super::{Failure, InputArgs, Outcome, output};
use crate::decoding::Inputs;
pub use frames::FrameRange;

/// What `export` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled export drive.pcap --what lidar-points --format ply -o cloud.ply\n  \
    tumbled export drive.pcap --what lidar-points --format csv -o first-turn.csv --frames 0..1\n  \
    tumbled export dump/ --what kinect-depth --format png -o depth/\n\n\
    Exit code 3: everything readable was exported, but part of an input could not be read.")]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// What to export.
    #[arg(long, value_enum)]
    what: What,
    /// The file format.
    #[arg(long, value_enum)]
    format: Format,
    /// The file to write; a folder for several Kinect frames.
    #[arg(short = 'o', long = "output", value_name = "PATH")]
    output: PathBuf,
    /// Kinect: frames A to B-1 of the inputs, counted from 0. LiDAR: turns of the head, counted from the first packet.
    #[arg(long, value_name = "A..B", default_value = "..")]
    frames: FrameRange,
    /// The sensor, where the config has several of the kind.
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
}

impl Format {
    const fn extension(self) -> &'static str {
        match self {
            Self::Pts => "pts",
            Self::Csv => "csv",
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::Png => "png",
        }
    }
}

/// What was written.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Report {
    what: What,
    format: Format,
    /// The sensor exported.
    sensor: String,
    /// The files, in order of the frames.
    files: Vec<PathBuf>,
    /// LiDAR: data packets. Kinect: depth frames.
    records: u64,
    /// Points, or pixels with a depth.
    points: u64,
    /// LiDAR: packets that the stamps say were sent and that the inputs do not hold.
    lost: u64,
    /// What a person should know.
    warnings: Vec<String>,
}

/// Exports.
///
/// # Errors
/// Exit code 2: an input or a combination that cannot be used. 1: a file that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    refuse_own_input(args)?;
    let loaded = args.input.config.load()?;
    let mut inputs = Inputs::open(&args.input, &loaded.config)?;
    let mut report = match (args.what, args.format) {
        (What::LidarPoints, Format::Pts | Format::Csv | Format::Ply | Format::Pcd) => {
            lidar::export(args, &loaded.config, &mut inputs)?
        }
        (What::KinectPoints, Format::Csv | Format::Ply | Format::Pcd)
        | (What::KinectDepth, Format::Png | Format::Csv) => kinect::export(args, &loaded.config, &mut inputs)?,
        (what, format) => return Err(no_such_combination(what, format)),
    };
    report.warnings.extend(inputs.warnings());
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if args.json {
        output::json(&report)?;
    } else {
        output::text(&summary(&report))?;
    }
    Ok(if inputs.data_lost() { Outcome::Incomplete } else { Outcome::Fine })
}

/// An output that is an input would replace the recording it is made from.
fn refuse_own_input(args: &Args) -> Result<(), Failure> {
    let Ok(output) = args.output.canonicalize() else { return Ok(()) };
    let same = args.input.inputs.iter().find(|input| input.canonicalize().is_ok_and(|input| input == output));
    match same {
        Some(input) => Err(Failure::input(format!("{} is an input, it is not written to", input.display()))
            .with_help("give -o another path")),
        None => Ok(()),
    }
}

fn no_such_combination(what: What, format: Format) -> Failure {
    let formats = match what {
        What::LidarPoints => "pts, csv, ply or pcd",
        What::KinectPoints => "csv, ply or pcd",
        What::KinectDepth => "png or csv",
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
    };
    let files = match report.files.as_slice() {
        [] => "nothing".to_owned(),
        [one] => one.display().to_string(),
        [first, .., last] => format!("{} files, {} to {}", report.files.len(), first.display(), last.display()),
    };
    let mut text = format!("{}: {} {records}, {} {points} -> {files}\n", report.sensor, report.records, report.points);
    if report.lost > 0 {
        text.push_str(&format!("{} packets are missing in the inputs, by their stamps\n", report.lost));
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

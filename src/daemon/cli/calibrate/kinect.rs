//! `tumbled calibrate kinect`: the Kinect's lens and depths, against the LiDAR.

use std::path::PathBuf;

use clap::Args as ClapArgs;
use tumbled_calib::board::BoardSize;
use tumbled_calib::{Gate, Status, View, depth_camera};

use super::{aligned, sides};
use crate::calibration::camera::KinectCamera;
use crate::calibration::depth::{self, KinectReport};
use crate::calibration::gather::{Pair, gather};
use crate::calibration::{Provenance, depth_page, file, frame, provenance};
use crate::cli::{ConfigArgs, Failure, InputArgs, Outcome, output};
use crate::decoding::Inputs;

/// What `calibrate kinect` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  \
    tumbled calibrate kinect --board 0.8x0.6 --from board.mcap -o calibration.toml --report kinect.html\n  \
    tumbled calibrate kinect --from sim:calibration-board -o calibration.toml\n\n\
    The recordings are those of `calibrate extrinsic --target board`: the board still for two seconds in each of 12 poses or more, over \
    the whole picture, 1.2 to 2.6 m away, leaning to 45 degrees left, right, back and forward. Found together: the depth scale, a \
    surface of the depth's error over the picture, the lens (as far as the data bear each of them), and the Kinect's place.\n\
    Exit code 0: written, perhaps with a warning. 3: a gate failed, the report says which and what to do; nothing is written.")]
pub struct Args {
    /// Captures in which the board stands still in one pose after the other; several are merged by host time.
    #[arg(long, value_name = "INPUT", required = true, num_args = 1..)]
    from: Vec<PathBuf>,
    /// The calibration file that the result is written into; other results in it stay, and what was there is kept as .bak.
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,
    /// The board's sides, m.
    #[arg(long, value_name = "AxB", default_value = "0.8x0.6", value_parser = sides)]
    board: BoardSize,
    /// The Kinect that is calibrated, by its id. [default: the config's first]
    #[arg(long, value_name = "ID")]
    kinect: Option<String>,
    /// The LiDAR that it is held against, by its id. [default: the config's first]
    #[arg(long, value_name = "ID")]
    lidar: Option<String>,
    /// Write the report as one page.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// Calibrates.
///
/// # Errors
/// Exit code 2: inputs, a config or a calibration file that cannot be used. 1: a file that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let input = InputArgs { inputs: args.from.clone(), config: args.config.clone() };
    let mut loaded = input.load()?;
    // Scale and surface are found anew from what the depth law alone says.
    for kinect in &mut loaded.config.kinects {
        (kinect.depth_scale, kinect.depth_warp) = (1.0, None);
    }
    let pair = Pair::of(&loaded.config, args.lidar.as_deref(), args.kinect.as_deref())?;
    let mut calibration = file::read(&args.output)?;
    let digests = provenance::digests(&args.from)?;
    let mut inputs = Inputs::open(&input, &loaded.config)?;
    let gathered = gather(&mut inputs, &pair)?;
    let lost = inputs.data_lost();
    let views: Vec<View> = gathered.poses.iter().map(|still| still.view.clone()).collect();
    let seconds: Vec<f64> =
        gathered.poses.iter().map(|still| 0.5e-9 * (still.from.0 as f64 + still.until.0 as f64)).collect();
    let camera = KinectCamera::of(pair.kinect);
    let found = depth_camera::calibrate(&views, &seconds, &args.board, &pair.t_lidar_kinect(), &camera);
    let mut gates = found.gates.clone();
    if lost {
        gates.push(Gate::warned("inputs", "parts of the inputs are missing or damaged: see the warnings"));
    }
    let provenance = Provenance::new(digests, gates);
    let mut report = depth::report(&found, &gathered.poses, &pair, format!("board {}", args.board), provenance);
    report.warnings = gathered.warnings;
    if depth::enter(&mut calibration, &report, &pair) {
        file::note(&mut calibration, "kinect", &report.provenance)?;
        report.kept = file::write(&args.output, &calibration)?.map(|kept| kept.display().to_string());
        report.written = Some(args.output.display().to_string());
    }
    super::tell(&report.warnings, &report.provenance.gates);
    if let Some(path) = &args.report {
        output::file(path, depth_page::page(&report))?;
    }
    output::report(&report, args.json, || text(&report))?;
    Ok(if report.provenance.status == Status::Fail { Outcome::Incomplete } else { Outcome::Fine })
}

/// The report for people.
fn text(report: &KinectReport) -> String {
    let mut text = format!("{}\n", frame::verdict(&report.provenance));
    let used = report.poses.iter().filter(|pose| pose.left_aside.is_none()).count();
    text.push_str(&format!("{}, {used} of {} poses used\n", report.target, report.poses.len()));
    if let Some(result) = &report.result {
        let scale = (result.place.depth_scale.unwrap_or(1.0), result.place.sigma_depth_scale.unwrap_or_default());
        text.push_str(&format!("solved for: {}\ndepth scale: {:.5} ± {:.5}\n", result.model, scale.0, scale.1));
        let names = ["fx", "fy", "cx", "cy", "k1", "k2"];
        let lens = names.iter().zip(result.lens).zip(result.sigma_lens);
        let lens = lens.map(|((name, value), sigma)| match sigma {
            Some(sigma) => format!("{name} {value:.4} ± {}", frame::significant(sigma)),
            None => format!("{name} {value:.4} (the config's)"),
        });
        text.push_str(&format!("lens: {}\n", lens.collect::<Vec<_>>().join(", ")));
        let rms = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1} mm"));
        text.push_str(&format!(
            "held-out depths beyond the LiDAR's planes, r.m.s. over the picture: {} with a scale alone, {} with the model\n",
            rms(result.held_out.scale_alone_rms_mm),
            rms(result.held_out.model_rms_mm)
        ));
        if let Some(drift) = &result.drift {
            text.push_str(&format!(
                "drift: {:.2} ± {:.2} mm/min over {:.0} s\n",
                drift.mm_per_minute, drift.sigma, drift.seconds
            ));
        }
    }
    let mut rows = vec![frame::GATES.map(str::to_owned).to_vec()];
    rows.extend(frame::gates(&report.provenance.gates));
    text.push_str(&aligned(&rows));
    text.push_str(&super::written(report.written.as_deref(), report.kept.as_deref()));
    text
}

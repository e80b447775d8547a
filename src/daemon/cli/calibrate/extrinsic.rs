//! `tumbled calibrate extrinsic`: the Kinect relative to the LiDAR.

use std::path::PathBuf;

use clap::{Args as ClapArgs, ValueEnum};
use tumbled_calib::board::{self, BoardSize};
use tumbled_calib::{Extrinsic, Gate, Status, View, sphere};

use super::{aligned, sides};
use crate::calibration::extrinsic::{self, ExtrinsicReport};
use crate::calibration::gather::{Pair, gather};
use crate::calibration::{Provenance, extrinsic_page, file, frame, provenance};
use crate::cli::{ConfigArgs, Failure, InputArgs, Outcome, output};
use crate::decoding::Inputs;

/// What is shown to both sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Target {
    /// A flat board.
    Board,
    /// A sphere.
    Sphere,
}

/// What `calibrate extrinsic` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled record --config rig.toml -o board.mcap --duration 90s\n  \
    tumbled calibrate extrinsic --target board --board 0.8x0.6 --from board.mcap -o calibration.toml --report board.html\n  \
    tumbled calibrate extrinsic --target sphere --radius 0.25 --from sphere.mcap -o calibration.toml\n  \
    tumbled calibrate extrinsic --from sim:calibration-board -o calibration.toml\n\n\
    Hold the target still for two seconds in one pose, move it to the next within two, and go on: 12 poses or more, 1.2 to \
    2.6 m away, boards leaning to 45 degrees left, right, back and forward. Nothing else may move in the Kinect's sight. \
    The config's t_rig_kinect is where the search begins: within some degrees and a decimetre.\n\
    Exit code 0: written, perhaps with a warning. 3: a gate failed, the report says which and what to do; nothing is written.")]
pub struct Args {
    /// Captures in which the target stands still in one pose after the other; several are merged by host time.
    #[arg(long, value_name = "INPUT", required = true, num_args = 1..)]
    from: Vec<PathBuf>,
    /// The calibration file that the result is written into; other results in it stay, and what was there is kept as .bak.
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,
    /// What was shown.
    #[arg(long, value_enum, default_value_t = Target::Board)]
    target: Target,
    /// The board's sides, m.
    #[arg(long, value_name = "AxB", default_value = "0.8x0.6", value_parser = sides)]
    board: BoardSize,
    /// The sphere's radius, m; known to half a millimetre.
    #[arg(long, value_name = "M", default_value_t = 0.25, value_parser = radius)]
    radius: f64,
    /// The Kinect that is placed, by its id. [default: the config's first]
    #[arg(long, value_name = "ID")]
    kinect: Option<String>,
    /// The LiDAR that it is placed by, by its id. [default: the config's first]
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

fn radius(text: &str) -> Result<f64, String> {
    let radius = text.trim().parse::<f64>().ok().filter(|radius| (0.05..=1.0).contains(radius));
    radius.ok_or_else(|| "expected a radius in metres, 0.05 to 1, as in 0.25".to_owned())
}

impl Args {
    fn target(&self) -> String {
        match self.target {
            Target::Board => format!("board {}", self.board),
            Target::Sphere => format!("sphere of radius {:.3} m", self.radius),
        }
    }

    fn calibrate(&self, views: &[View], start: &nalgebra::Isometry3<f64>) -> Extrinsic {
        match self.target {
            Target::Board => board::calibrate(views, &self.board, start),
            Target::Sphere => sphere::calibrate(views, self.radius, start),
        }
    }
}

/// Calibrates.
///
/// # Errors
/// Exit code 2: inputs, a config or a calibration file that cannot be used. 1: a file that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let input = InputArgs { inputs: args.from.clone(), config: args.config.clone() };
    let loaded = input.load()?;
    let pair = Pair::of(&loaded.config, args.lidar.as_deref(), args.kinect.as_deref())?;
    // Before the work: a file that is none is told at once, and digests are of what is read.
    let mut calibration = file::read(&args.output)?;
    let digests = provenance::digests(&args.from)?;
    let mut inputs = Inputs::open(&input, &loaded.config)?;
    let gathered = gather(&mut inputs, &pair)?;
    let lost = inputs.data_lost();
    let views: Vec<View> = gathered.poses.iter().map(|still| still.view.clone()).collect();
    let found = args.calibrate(&views, &pair.t_lidar_kinect());
    let mut gates = found.gates.clone();
    if lost {
        gates.push(Gate::warned("inputs", "parts of the inputs are missing or damaged: see the warnings"));
    }
    let provenance = Provenance::new(digests, gates);
    let mut report = extrinsic::report(&found, &gathered.poses, &pair, args.target(), provenance);
    report.warnings = gathered.warnings;
    if extrinsic::enter(&mut calibration, &report, &pair) {
        file::note(&mut calibration, "extrinsic", &report.provenance)?;
        report.kept = file::write(&args.output, &calibration)?.map(|kept| kept.display().to_string());
        report.written = Some(args.output.display().to_string());
    }
    super::tell(&report.warnings, &report.provenance.gates);
    if let Some(path) = &args.report {
        output::file(path, extrinsic_page::page(&report, &found))?;
    }
    output::report(&report, args.json, || text(&report))?;
    Ok(if report.provenance.status == Status::Fail { Outcome::Incomplete } else { Outcome::Fine })
}

/// The report for people.
fn text(report: &ExtrinsicReport) -> String {
    let mut text = format!("{}\n", frame::verdict(&report.provenance));
    let used = report.poses.iter().filter(|pose| pose.left_aside.is_none()).count();
    text.push_str(&format!("{}, {used} of {} poses used\n", report.target, report.poses.len()));
    if let Some(result) = &report.result {
        let list = |numbers: &[f64], digits: usize| {
            numbers.iter().map(|number| format!("{number:.digits$}")).collect::<Vec<_>>().join(", ")
        };
        let t = &result.t_rig_kinect;
        text.push_str(&format!(
            "t_rig_kinect: translation_m [{}], rotation_xyzw [{}]\n1 sigma about and along the rig's axes: {} deg, {} mm\n",
            list(&t.translation_m, 5),
            list(&t.rotation_xyzw, 6),
            list(&result.sigma_rotation_deg, 4),
            list(&result.sigma_translation_mm, 2)
        ));
        if let (Some(scale), Some(sigma)) = (result.depth_scale, result.sigma_depth_scale) {
            text.push_str(&format!("depth scale: {scale:.5} ± {sigma:.5}\n"));
        }
    }
    let mut rows = vec![frame::GATES.map(str::to_owned).to_vec()];
    rows.extend(frame::gates(&report.provenance.gates));
    text.push_str(&aligned(&rows));
    text.push_str(&super::written(report.written.as_deref(), report.kept.as_deref()));
    text
}

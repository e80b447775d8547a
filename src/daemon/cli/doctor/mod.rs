//! `tumbled doctor`: is this machine ready for a session with this config?
//!
//! ```text
//!            ┌▶ lidar:     ports, who speaks on them ─────────────┐
//!   config ──┼▶ kinect:    USB, permissions, two seconds of frames ┼─▶ findings ─▶ text │ JSON, exit 0 or 3
//!            ├▶ machine:   buffer, disk, clock, turntable ────────┤
//!            └▶ listeners: where the state is told ───────────────┘
//! ```
//! Nothing is changed, and nothing is opened but the ports that a session would open, a Kinect that nobody uses, and for a
//! moment a file without a name.

mod kinect;
mod lidar;
mod listeners;
mod machine;
pub mod report;

use std::path::{Path, PathBuf};
use std::time::Duration;

use tumbled_io::live::UdpProbe;
use tumbled_io::machine::interfaces;

use super::config::check::summary;
use super::{ConfigArgs, Failure, Outcome, output, quantity};
use crate::config::{self, Config, ConfigError, Gravity, Loaded, Problem};
use crate::decoding::listening::Listening;
use report::{DoctorReport, Finding};

/// What `doctor` is asked for.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  tumbled doctor --config rig.toml\n  \
    tumbled doctor --config rig.toml --folder /data --listen 5s --json\n\n\
    Exit code 3: something that the config asks for is missing; each finding says what to do. Warnings alone leave 0.")]
pub struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// How long to listen for the LiDARs.
    #[arg(long, value_parser = quantity::duration, value_name = "TIME", default_value = "2s")]
    listen: Duration,
    /// The folder recordings are to go to.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    folder: PathBuf,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// Looks at everything and reports.
///
/// # Errors
/// Exit code 2: a config that cannot be used; with --json its problems are the report's findings.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = match config::load(args.config.config.as_deref(), &args.config.settings) {
        Ok(loaded) => loaded,
        Err(error) => return Err(unusable(error, args.json)?),
    };
    let report = DoctorReport::new(examine(args, &loaded)?);
    output::report(&report, args.json, || report.text())?;
    Ok(if report.healthy { Outcome::Fine } else { Outcome::Incomplete })
}

/// People get a config's problems as every command tells them; machines get them as findings first.
fn unusable(error: ConfigError, json: bool) -> Result<Failure, Failure> {
    if json {
        output::json(&DoctorReport::new(error.problems.iter().map(problem).collect()))?;
    }
    Ok(error.into())
}

fn problem(problem: &Problem) -> Finding {
    let remedy = problem.help.clone().unwrap_or_else(|| "`tumbled config check` shows the place".to_owned());
    let finding = match problem.gravity {
        Gravity::Error => Finding::fail("config", problem.message.clone(), remedy),
        Gravity::Warning => Finding::warn("config", problem.message.clone(), remedy),
    };
    match &problem.key {
        Some(key) => finding.of(key),
        None => finding,
    }
}

fn examine(args: &Args, loaded: &Loaded) -> Result<Vec<Finding>, Failure> {
    let config = &loaded.config;
    let mut findings = vec![Finding::ok("config", summary(config))];
    findings.extend(loaded.warnings.iter().map(problem));
    // Any port's socket gets the buffer that a sensor's gets.
    findings.extend(UdpProbe::open(0).ok().map(|probe| machine::receive_buffer(probe.buffer())));
    let heard = Listening::open(config).listen(args.listen).map_err(Failure::failed)?;
    let interfaces = interfaces().unwrap_or_default(); // without them one hint less
    findings.extend(lidar::check(config, &heard, &interfaces));
    findings.extend(around(config, &args.folder, Path::new("/")));
    Ok(findings)
}

/// What is looked for in files and sockets; system files below `root`.
fn around(config: &Config, folder: &Path, root: &Path) -> Vec<Finding> {
    let mut findings: Vec<Finding> = config.kinects.iter().flat_map(|kinect| kinect::check(kinect, root)).collect();
    findings.extend(config.turntable.as_ref().map(|turntable| machine::turntable(turntable, root)));
    findings.push(machine::disk(config, folder));
    findings.extend(machine::disk_speed(folder));
    findings.push(machine::wall_clock(root));
    findings.extend(listeners::check(&config.stream));
    findings
}

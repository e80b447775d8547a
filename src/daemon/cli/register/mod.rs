//! `tumbled register`: one cloud onto another, once, with what is known of it and what is not.
//!
//! ```text
//!   files ─ clouds ─▶ Cloud, Cloud ─ core::register ─▶ report: text or JSON
//!   --init ─ init ──▶ Prior                        └─▶ viewer: HTML with both clouds
//! ```

mod arguments;
mod init;
pub mod report;
mod text;
mod viewer;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args as ClapArgs;
use nalgebra::Point3;
use tumbled_core::register::{Cloud, Method, MethodOptions, RegisterError, SensorKind, View, register};

use super::import::refuse_input_as_output;
use super::{Failure, Outcome, output};
use crate::clouds::{self, ReadCloud};
use crate::experiment::trial::method_named;
use crate::session::engine;
use arguments::{Sensors, Viewpoint, sensors, viewpoint};
use report::RegisterReport;

/// What `register` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled register kinect.ply lidar.ply\n  \
    tumbled register kinect.ply lidar.ply --init guess.json --json\n  \
    tumbled register a.ply b.ply --sensors moving=kinect,reference=lidar --viz pair.html\n  \
    tumbled register fused.ply lidar.ply --viewpoint-moving none\n\n\
    Clouds are in metres, each in the frame it was measured in: a Kinect's z forward, a LiDAR's x forward and z up. What each \
    sensor saw through counts as much as the points: with points that were moved or fused say where the sensor stood, or \
    `none`.\n\
    A guess is {\"t_reference_moving\": {\"translation_m\": [x, y, z], \"rotation_xyzw\": [x, y, z, w]}}; a result of \
    `register --json` is one.\n\
    Exit code 0 also where the result is not accepted: it is the best candidate, and the reason is told. 2: no clouds.")]
pub struct Args {
    /// The cloud to be moved: .ply, or .pts of `tumbled export`.
    #[arg(value_name = "MOVING")]
    moving: PathBuf,
    /// The cloud it is registered onto.
    #[arg(value_name = "REFERENCE")]
    reference: PathBuf,
    /// cga, cga-paper (our reconstruction of the published method), icp, plane-icp, gicp or cbd.
    #[arg(long, value_name = "METHOD", default_value = "cga", value_parser = method_named)]
    method: Method,
    /// Begin with this guess; without it all poses are searched. cga-paper and cbd make no use of it.
    #[arg(long, value_name = "FILE.json")]
    init: Option<PathBuf>,
    /// The guess's standard deviation in rotation, degrees about each axis.
    #[arg(long, value_name = "DEG", default_value_t = 6.0, requires = "init")]
    init_sigma_deg: f64,
    /// The guess's standard deviation at the moving cloud's centroid, m along each axis.
    #[arg(long, value_name = "M", default_value_t = 0.06, requires = "init")]
    init_sigma_m: f64,
    /// What made the clouds, e.g. moving=lidar,reference=kinect; otherwise the sparser one is the LiDAR's.
    #[arg(long, value_name = "WHICH", value_parser = sensors)]
    sensors: Option<Sensors>,
    /// Where the sensor of the moving cloud stood, in its cloud's frame, m: x,y,z; `none`: nobody knows. [default: 0,0,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = viewpoint, allow_hyphen_values = true)]
    viewpoint_moving: Option<Viewpoint>,
    /// The same of the reference.
    #[arg(long, value_name = "X,Y,Z", value_parser = viewpoint, allow_hyphen_values = true)]
    viewpoint_reference: Option<Viewpoint>,
    /// Write a page with both clouds before and after.
    #[arg(long, value_name = "FILE.html")]
    viz: Option<PathBuf>,
    /// Threads; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// Registers.
///
/// # Errors
/// Exit code 2: files that hold no clouds, a guess that is none. 1: a page that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if let Some(page) = &args.viz {
        let inputs = [Some(&args.moving), Some(&args.reference), args.init.as_ref()];
        refuse_input_as_output("--viz", page, inputs.into_iter().flatten())?;
    }
    let (moving, reference) = (read(&args.moving)?, read(&args.reference)?);
    let prior =
        args.init.as_deref().map(|file| init::read(file, args.init_sigma_deg, args.init_sigma_m)).transpose()?;
    if prior.is_some() && !args.method.takes_prior() {
        tracing::warn!("{} makes no use of --init", args.method.name());
    }
    let workers = engine::workers(args.threads)?;
    let kinds = args.sensors.unwrap_or_else(|| Sensors::by_density(moving.points.len(), reference.points.len()));
    let moving_cloud = cloud(&moving, kinds.moving, args.viewpoint_moving);
    let reference_cloud = cloud(&reference, kinds.reference, args.viewpoint_reference);
    let began = Instant::now();
    let options = MethodOptions::default();
    let found = register(&moving_cloud, &reference_cloud, args.method, prior.as_ref(), &options, &workers);
    let time_ms = 1e3 * began.elapsed().as_secs_f64();
    let found = found.map_err(|error| refused(args, &error))?;
    let report = RegisterReport::new(args.method, [&moving, &reference], kinds, &found, time_ms);
    if let Some(page) = &args.viz {
        viewer::write(page, [&args.moving, &args.reference], [&moving_cloud, &reference_cloud], &report, &found)?;
    }
    output::report(&report, args.json, || text::text(&report, &found, &moving_cloud))?;
    Ok(Outcome::Fine)
}

fn read(path: &Path) -> Result<ReadCloud, Failure> {
    let cloud = clouds::read(path).map_err(|error| {
        Failure::input(error)
            .with_help("PLY (text or binary, x y z as float or double) and `tumbled export` pts are read")
    })?;
    if cloud.not_finite > 0 {
        tracing::warn!("{}: {} points that are not finite left out", path.display(), cloud.not_finite);
    }
    Ok(cloud)
}

fn cloud(read: &ReadCloud, sensor: SensorKind, viewpoint: Option<Viewpoint>) -> Cloud {
    let viewpoint = match viewpoint {
        None => Some(Point3::origin()),
        Some(Viewpoint(stated)) => stated,
    };
    Cloud { sensor, points: read.points.clone(), viewpoint, view: View::Bare }
}

/// Why there is nothing to register, with the file it is about.
fn refused(args: &Args, error: &RegisterError) -> Failure {
    let of = |cloud: &str| if cloud == "moving" { args.moving.display() } else { args.reference.display() };
    match error {
        RegisterError::TooFewPoints { cloud, .. } | RegisterError::Collinear { cloud } => {
            Failure::input(format!("{}: {error}", of(cloud))).with_help("give a cloud of the target's surface")
        }
        RegisterError::Size { cloud, .. } => Failure::input(format!("{}: {error}", of(cloud)))
            .with_help("crop the target out of its surroundings, and write the cloud in metres"),
        _ => {
            let file = args.init.as_ref().map(|file| format!("{}: ", file.display())).unwrap_or_default();
            Failure::input(format!("{file}{error}"))
        }
    }
}

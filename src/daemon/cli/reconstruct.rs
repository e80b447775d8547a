//! `tumbled reconstruct`: a session's target as a model.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args as ClapArgs;
use indicatif::ProgressBar;
use tumbled_core::recon::ReconSettings;

use super::experiment::write;
use super::replay::origin;
use super::{Failure, InputArgs, Outcome, VERSION, output, signals};
use crate::decoding::Inputs;
use crate::reconstruction::{Frames, ReconstructReport, files, make, picture, report};
use crate::session::play::play;
use crate::session::{Engine, Pace, Speed};

/// What `reconstruct` is asked for.
#[derive(Debug, ClapArgs)]
#[command(
    after_help = "Examples:\n  tumbled reconstruct run.mcap -o model/\n  tumbled reconstruct sim:demo -o model/ --json\n\n\
    The session is played through the core; every 3 degrees of turning a frame of each sensor that shows the target and \
    nothing else is laid on its model once more, and all are fused. Planes are found, points are put on them as far as their \
    distance is noise, and edges are drawn where planes meet or end. Everything is in the target's frame.\n\
    In DIR: model.ply (points with normals, sigma, plane, counts), planes.json, contour.obj, contour.json, motion.csv, model.png.\n\
    Exit code 3: no frame shows a tracked target, or the inputs are damaged."
)]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// The folder for the model's files; it is made if it is not there.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// How rough the target's surfaces are, mm: so much of the points' distance from their planes is left; 0: none.
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = roughness)]
    surface_sigma: f64,
    /// Leave points as they were measured: no planes, no contour.
    #[arg(long)]
    no_planes: bool,
    /// Threads of the core; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

fn roughness(text: &str) -> Result<f64, String> {
    let mm = text.parse::<f64>().ok().filter(|mm| (0.0..=100.0).contains(mm));
    mm.ok_or_else(|| "expected millimetres, 0 to 100".to_owned())
}

/// Reconstructs.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used. 1: a folder that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = args.input.load()?;
    fs::create_dir_all(&args.output)
        .map_err(|error| Failure::failed(format!("cannot make {}: {error}", args.output.display())))?;
    let mut engine = Engine::of_config(&loaded, false, args.threads)?;
    engine.keep_frames();
    let mut inputs = Inputs::open_ledger(&args.input.inputs, &loaded.config, args.threads)?;
    let mut frames = Frames::default();
    let mut pace = Pace::new(Speed::Max, signals::stop_token()?);
    let progress = ProgressBar::new_spinner().with_message("playing the session");
    progress.enable_steady_tick(Duration::from_millis(200));
    let finished = play(&mut inputs, &mut engine, &mut frames, &mut pace)?;
    progress.set_message("making the model");
    let settings = ReconSettings {
        surface_sigma_m: args.surface_sigma * 1e-3,
        planes: !args.no_planes,
        ..ReconSettings::default()
    };
    let made = make::make(&frames.frames, &engine, &settings);
    progress.finish_and_clear();
    let Some(made) = made else {
        tracing::warn!("no frame shows a tracked target: there is nothing to make a model of");
        return Ok(Outcome::Incomplete);
    };
    let mut warnings = inputs.warnings();
    if !finished {
        warnings.push("the run was stopped before the inputs' end".to_owned());
    }
    if made.others > 0 {
        warnings.push(format!("{} frames of other targets of the session were left out", made.others));
    }
    if frames.beyond > 0 {
        warnings.push(format!("{} frames beyond what is kept were not used: reconstruct a part", frames.beyond));
    }
    let all = [
        ("model.ply", files::ply(&made.model)),
        ("planes.json", files::planes(&made.model)?),
        ("contour.obj", files::obj(&made.model)?),
        ("contour.json", files::contour(&made.model)?),
        ("motion.csv", files::motion(&made)),
        ("model.png", picture::png(&made.model)?),
    ];
    for (name, bytes) in &all {
        write(&args.output, name, bytes)?;
    }
    let report = ReconstructReport {
        program: VERSION.to_owned(),
        inputs: args.input.inputs.iter().map(|input| input.display().to_string()).collect(),
        origin: origin(&inputs),
        digest: engine.checkpoint().outputs_digest(),
        files: all.iter().map(|(name, _)| (*name).to_owned()).collect(),
        complete: finished && !inputs.data_lost(),
        warnings,
        ..report::of_model(&made)
    };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    output::report(&report, args.json, || report.text())?;
    Ok(if report.complete { Outcome::Fine } else { Outcome::Incomplete })
}

//! `tumbled evaluate`: the states of a session held against the truth.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args as ClapArgs;
use tumbled_io::recording::Origin;
use tumbled_model::RigNs;

use super::experiment::write_report;
use super::replay::origin;
use super::{Failure, InputArgs, Outcome, VERSION, output, signals};
use crate::decoding::Inputs;
use crate::evaluation::report::Scored;
use crate::evaluation::score::{self, From, Outcome as Found, Wanted};
use crate::evaluation::{EvaluateReport, Gathered, page, report, text, truth};
use crate::limits::{self, Limits};
use crate::quantity;
use crate::session::play::play;
use crate::session::{Engine, Pace, Speed};

/// What `evaluate` is asked for.
#[derive(Debug, ClapArgs)]
#[command(
    after_help = "Examples:\n  tumbled evaluate out/capture.mcap --truth out/truth.csv --config out/rig.toml -o report/\n  \
    tumbled evaluate run.mcap --truth turntable --json\n  \
    tumbled evaluate sim:tumble --truth truth.csv --from 20s\n\n\
    Scored are the states of mode `tracking` that are not `invalid`: attitude, position, velocity, spin axis, rate, and \
    whether the stated uncertainty holds. The frame of the target is the estimate's own choice: errors are told with the \
    mean error removed (gauge-free), and aligned in the first second. A turntable tells the angle about an axis that \
    nobody knows: only what turns about the estimate's own axis is compared.\n\
    With -o: report.json and report.html.\n\
    Exit code 2: the truth is none, or of other times. 3: nothing was tracked, the inputs are damaged, or a limit is not kept."
)]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// A truth.csv as `simulate` writes it (t_ns,unix_ns,px,py,pz,qx,qy,qz,qw,wx,wy,wz), or `turntable`: the encoder's
    /// angles in the inputs.
    #[arg(long, value_name = "FILE|turntable")]
    truth: PathBuf,
    /// Score from this session time on, e.g. 20s; 0: from the first state tracked. [default: after --revolutions]
    #[arg(long, value_name = "TIME", value_parser = time, conflicts_with = "revolutions")]
    from: Option<RigNs>,
    /// Score after so many turns of the target since it was first tracked: a model of it is made first. A target at rest
    /// is scored from its first state on.
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = revolutions)]
    revolutions: f64,
    /// Limits that the figures have to keep, a TOML file [default: the config's [limits]].
    #[arg(long, value_name = "FILE.toml")]
    limits: Option<PathBuf>,
    /// The folder for report.json and report.html; it is made if it is not there.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Threads of the core; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// A session time as people write it; 0 is one too.
fn time(text: &str) -> Result<RigNs, quantity::QuantityError> {
    if text.trim() == "0" {
        return Ok(RigNs(0));
    }
    // At most 100 years: 3.2e18 ns.
    quantity::duration(text).map(|time| RigNs(time.as_nanos() as i64))
}

fn revolutions(text: &str) -> Result<f64, String> {
    let turns = text.parse::<f64>().ok().filter(|turns| (0.0..=1e6).contains(turns));
    turns.ok_or_else(|| "expected a number of turns, 0 or more".to_owned())
}

/// Evaluates.
///
/// # Errors
/// Exit code 2: inputs, a config or a truth that cannot be used. 1: a folder that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = args.input.load()?;
    let by_turntable = args.truth == Path::new("turntable");
    // Before the work: a wrong file is told at once.
    let limits = args.limits.as_deref().map(Limits::read).transpose()?.unwrap_or(loaded.config.limits);
    let samples = if by_turntable { Vec::new() } else { truth::read(&args.truth).map_err(Failure::input)? };
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder)
            .map_err(|error| Failure::failed(format!("cannot make {}: {error}", folder.display())))?;
    }
    let mut engine = Engine::of_config(&loaded, false, args.threads)?;
    let mut inputs = Inputs::open_ledger(&args.input.inputs, &loaded.config, args.threads)?;
    let mut gathered = Gathered::new(inputs.epoch().unwrap_or_default());
    let mut pace = Pace::new(Speed::Max, signals::stop_token()?);
    let finished = play(&mut inputs, &mut engine, &mut gathered, &mut pace)?;
    let mut warnings = inputs.warnings();
    if !finished {
        warnings.push("the run was stopped before the inputs' end".to_owned());
    }
    if gathered.beyond > 0 {
        warnings.push(format!(
            "{} states and angles beyond what is kept were not scored: evaluate a part",
            gathered.beyond
        ));
    }
    let first_tracking_s = gathered.estimates.first().map(|first| first.t.0 as f64 * 1e-9);
    let (truth, source) = if by_turntable {
        score::turntable(&gathered, &mut warnings)?
    } else {
        let is_simulated =
            inputs.scene().is_some() || inputs.recording().is_some_and(|header| header.origin == Origin::Simulated);
        score::poses(&args.truth, &samples, &mut gathered, inputs.have_host_times(), is_simulated)?
    };
    let wanted = Wanted::from(args.from.map_or(From::Turns(args.revolutions), From::At));
    let (scored, series, unscored) = match score::score(&gathered, &truth, &wanted, &mut warnings)? {
        Found::Scored(scored, series) => (Some(*scored), Some(series), None),
        Found::Unscored(reason) => (None, None, Some(reason)),
    };
    let (epochs, modes, reasons) = report::counts(&gathered);
    let checkpoint = engine.checkpoint();
    let report = EvaluateReport {
        program: VERSION.to_owned(),
        inputs: args.input.inputs.iter().map(|input| input.display().to_string()).collect(),
        origin: origin(&inputs),
        digest: checkpoint.outputs_digest(),
        truth: source,
        duration_s: checkpoint.t_ns as f64 * 1e-9,
        epochs,
        modes,
        reasons,
        first_tracking_s,
        limits: limits.check(&against_limits(scored.as_ref(), &engine)),
        complete: finished && !inputs.data_lost() && scored.is_some(),
        scored,
        unscored,
        warnings,
    };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if let Some(folder) = &args.output {
        write_report(folder, &report, &page::evaluation(&report, &gathered, series.as_ref()))?;
    }
    output::report(&report, args.json, || text::report(&report))?;
    Ok(if report.complete && limits::all_kept(&report.limits) { Outcome::Fine } else { Outcome::Incomplete })
}

/// What limits are held against: nothing scored keeps none of them.
fn against_limits(scored: Option<&Scored>, engine: &Engine) -> Vec<(&'static str, Option<f64>)> {
    const UNSCORED: [(&str, Option<f64>); 4] =
        [("rate_rms_dps", None), ("axis_rms_deg", None), ("attitude_rms_deg", None), ("position_rms_mm", None)];
    let mut found = scored.map_or(UNSCORED, Scored::against_limits).to_vec();
    found.push(("lost_share", limits::lost_share(&engine.sensors())));
    found
}

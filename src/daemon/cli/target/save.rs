//! `tumbled target save`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args as ClapArgs;
use tumbled_core::estimate::Mode;

use super::super::import::refuse_input_as_output;
use super::super::{Failure, InputArgs, Outcome, output, signals};
use super::show::TargetReport;
use crate::decoding::Inputs;
use crate::session::play::{Listener, play};
use crate::session::{Engine, Pace, Speed, Step};
use crate::target::SavedTarget;

/// What `target save` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled target save run.mcap --name mock-up -o mock-up.target.ply\n  \
    tumbled run --config rig.toml --set target.saved=mock-up.target.ply\n\n\
    The model is what the session knows of the target at its end: let it turn once at least, all of its sides are known \
    then. Its frame is the one that the session's states were told in. Sessions with target.saved set recognise it and \
    tell their states in that frame.\n\
    Exit code 3: the target was not tracked at the end, or a side of it is not known yet; the file is written all the \
    same in the latter case.")]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// What the target is called.
    #[arg(long, value_name = "NAME")]
    name: String,
    /// The file, best NAME.target.ply.
    #[arg(short, long, value_name = "FILE.ply")]
    output: PathBuf,
    /// Write over a file that is there.
    #[arg(long)]
    force: bool,
    /// Threads of the core; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// How a session ended.
#[derive(Default)]
struct AtLast(Option<Mode>);

impl Listener for AtLast {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        self.0 = step.outputs.states.last().map_or(self.0, |state| Some(state.mode));
        Ok(())
    }
}

/// How far a model is closed at least that is known from all sides but the one it stands on.
const ALL_SIDES: f64 = 0.75;

/// Saves.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used, a file that is there. 1: it cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.name.trim().is_empty() {
        return Err(Failure::input("the name is empty: say --name mock-up, for example"));
    }
    if args.output.exists() && !args.force {
        let problem = format!("{} is there already: choose another name, or say --force", args.output.display());
        return Err(Failure::input(problem));
    }
    refuse_input_as_output("-o", &args.output, &args.input.inputs)?;
    let loaded = args.input.load()?;
    let mut engine = Engine::of_config(&loaded, false, args.threads)?;
    let mut inputs = Inputs::open_ledger(&args.input.inputs, &loaded.config, args.threads)?;
    let mut pace = Pace::new(Speed::Max, signals::stop_token()?);
    let mut at_last = AtLast::default();
    play(&mut inputs, &mut engine, &mut at_last, &mut pace)?;
    let names: Vec<String> = args.input.inputs.iter().map(|input| base(input)).collect();
    let tracker = engine.tracker().filter(|_| matches!(at_last.0, Some(Mode::Tracking | Mode::Predicted)));
    let Some(tracker) = tracker else {
        tracing::error!("nothing was tracked at the end of {}: nothing is saved", names.join(", "));
        return Ok(Outcome::Incomplete);
    };
    let source = format!("{} by tumbled {}", names.join(", "), super::super::VERSION);
    let saved = SavedTarget::new(&args.name, &source, tracker.surfels()).map_err(Failure::failed)?;
    write(&args.output, &saved.text())?;
    let report = TargetReport::of(&saved);
    output::report(&report, args.json, || report.text())?;
    if report.sizes.closed < ALL_SIDES {
        tracing::warn!(
            "its surface is closed to {:.0} % only, not all of its sides are known: save it after a whole turn, or it is \
             recognised from these sides alone",
            report.sizes.closed * 100.0
        );
        return Ok(Outcome::Incomplete);
    }
    Ok(Outcome::Fine)
}

fn base(input: &Path) -> String {
    input.file_name().unwrap_or(input.as_os_str()).to_string_lossy().into_owned()
}

/// Whole or not at all: written beside the place, renamed at the end.
fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::failed(format!("cannot write {}: {error}", path.display()));
    let mut beside = output::beside(output::folder_of(path)).map_err(failed)?;
    beside.write_all(text.as_bytes()).map_err(failed)?;
    beside.persist(path).map_err(|error| failed(error.error))?;
    Ok(())
}

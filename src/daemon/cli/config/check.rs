//! `tumbled config check`: every problem of a config at once.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::cli::{ConfigArgs, Failure, Outcome, output, render};
use crate::config::{self, Config, Gravity, Problem, ProblemReport};

/// Arguments of `config check`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: tumbled config check rig.toml --set lidar.model=vlp-16")]
pub struct Args {
    /// The config file; without it the built-in defaults are checked with what --set makes of them.
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// Overrides one key, e.g. lidar.port=2369 (every LiDAR), lidar.front.port=2369 (one); repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// What `config check --json` prints.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled config check --json")]
pub struct CheckReport {
    /// Whether the config may be used; the exit code is 0 then, 2 otherwise.
    pub ok: bool,
    /// The config file; null: the built-in defaults.
    pub file: Option<String>,
    /// How many of the problems are errors.
    pub errors: usize,
    /// How many of the problems are warnings.
    pub warnings: usize,
    /// Every problem, in reading order.
    pub problems: Vec<ProblemReport>,
}

impl CheckReport {
    fn new(args: &Args, problems: &[Problem]) -> Self {
        let count = |gravity| problems.iter().filter(|problem| problem.gravity == gravity).count();
        let errors = count(Gravity::Error);
        Self {
            ok: errors == 0,
            file: args.file.as_ref().map(|file| file.display().to_string()),
            errors,
            warnings: count(Gravity::Warning),
            problems: problems.iter().map(ProblemReport::from).collect(),
        }
    }
}

/// Checks a config.
///
/// # Errors
/// [`Failure::Config`] with every problem.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.json {
        return run_json(args);
    }
    let arguments = ConfigArgs { config: args.file.clone(), settings: args.settings.clone() };
    let loaded = arguments.load()?;
    let name = args.file.as_ref().map_or("the built-in config".to_owned(), |file| file.display().to_string());
    output::text(&format!("{name}: fine: {}\n", summary(&loaded.config)))?;
    Ok(Outcome::Fine)
}

/// Machines get the problems in the report; people get them on stderr too, as for every failure.
fn run_json(args: &Args) -> Result<Outcome, Failure> {
    match config::load(args.file.as_deref(), &args.settings) {
        Ok(loaded) => {
            loaded.warnings.iter().for_each(render::warning);
            output::json(&CheckReport::new(args, &loaded.warnings))?;
            Ok(Outcome::Fine)
        }
        Err(error) => {
            output::json(&CheckReport::new(args, &error.problems))?;
            Err(error.into())
        }
    }
}

/// `1 LiDAR (front), 1 Kinect (near), no turntable`.
pub(in crate::cli) fn summary(config: &Config) -> String {
    let lidars: Vec<&str> = config.lidars.iter().map(|lidar| lidar.id.as_str()).collect();
    let kinects: Vec<&str> = config.kinects.iter().map(|kinect| kinect.id.as_str()).collect();
    let turntable = if config.turntable.is_some() { "a turntable" } else { "no turntable" };
    format!("{}, {}, {turntable}", counted("LiDAR", &lidars), counted("Kinect", &kinects))
}

fn counted(what: &str, ids: &[&str]) -> String {
    match ids {
        [] => format!("no {what}"),
        [id] => format!("1 {what} ({id})"),
        ids => format!("{} {what}s ({})", ids.len(), ids.join(", ")),
    }
}

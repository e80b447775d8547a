//! `tumbled status`: how a running daemon is doing.
//!
//! ```text
//!   connect (TCP or Unix socket) ─▶ HELLO ─▶ the next HEALTH ─▶ table or JSON; --watch: every HEALTH
//! ```

use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::Level;

use self::connection::{Connection, StatusError, Target};
use super::{Failure, Outcome, output, signals};
use crate::config::DEFAULT_STREAM_SOCKET;
use crate::stream::{HealthLine, Hello};

mod connection;
mod table;

/// How long the daemon may take for each of its lines. HEALTH comes once a second, so three are missed by then.
const PATIENCE: Duration = Duration::from_secs(3);

/// Where a daemon listens that was not told otherwise, in the order they are tried.
const DEFAULT_TCP: &str = "127.0.0.1:7117";

/// Moves to the top of the screen and clears it.
const CLEAR: &str = "\u{1b}[H\u{1b}[J";

/// What `status` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled status\n  tumbled status --watch\n  \
    tumbled status --json --connect /run/tumbled/state.sock\n\n\
    Exit codes: 0 it runs, 1 nobody listens or no health came, 3 it runs and its level is failed.")]
pub struct Args {
    /// Go on with every new health, once a second, until Ctrl-C.
    #[arg(long)]
    watch: bool,
    /// On stdout as JSON; with --watch one object per line.
    #[arg(long)]
    json: bool,
    /// Where the daemon listens; left out: 127.0.0.1:7117, then /run/tumbled/state.sock.
    #[arg(long, value_name = "ADDRESS|PATH")]
    connect: Option<String>,
}

/// What a running daemon is, and how it is doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled status --json")]
pub struct StatusReport {
    /// Where it was reached.
    pub at: String,
    /// What it said first.
    pub hello: Hello,
    /// Its newest health.
    pub health: HealthLine,
}

/// Runs the command.
///
/// # Errors
/// Nobody listens, or no health comes.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let (mut connection, hello) = connect(args)?;
    // Without --watch there is nothing to finish: the signal ends the process.
    let stop = if args.watch { Some(signals::stop_token()?) } else { None };
    let mut level = Level::Ok;
    loop {
        let health = match connection.health(PATIENCE, stop.as_ref()) {
            Ok(Some(health)) => health,
            Ok(None) => break, // asked to end
            Err(error) => return Err(told(error)),
        };
        level = health.level;
        let report = StatusReport { at: connection.at().to_owned(), hello: hello.clone(), health };
        show(args, &report)?;
        if !args.watch {
            break;
        }
    }
    Ok(if level == Level::Failed { Outcome::Incomplete } else { Outcome::Fine })
}

fn connect(args: &Args) -> Result<(Connection, Hello), Failure> {
    let targets = match &args.connect {
        Some(text) => vec![Target::parse(text).map_err(Failure::input)?],
        None => {
            let tcp = Target::parse(DEFAULT_TCP).map_err(Failure::failed)?;
            vec![tcp, Target::Unix(PathBuf::from(DEFAULT_STREAM_SOCKET))]
        }
    };
    Connection::open(&targets, PATIENCE).map_err(told)
}

fn told(error: StatusError) -> Failure {
    let help = error.help();
    Failure::failed(error).with_help(help)
}

fn show(args: &Args, report: &StatusReport) -> Result<(), Failure> {
    match (args.json, args.watch) {
        (true, false) => output::json(report),
        (true, true) => {
            let line = serde_json::to_string(report).map_err(Failure::failed)?;
            output::text(&format!("{line}\n"))
        }
        (false, true) if std::io::stdout().is_terminal() => output::text(&format!("{CLEAR}{}", table::render(report))),
        (false, true) => output::text(&format!("{}\n", table::render(report))),
        (false, false) => output::text(&table::render(report)),
    }
}

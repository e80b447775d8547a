//! `tumbled ctl`: orders for a running daemon.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args as ClapArgs, Subcommand};
use indicatif::HumanBytes;

use super::{Failure, Outcome, output};
use crate::config::DEFAULT_CONTROL_SOCKET;
use crate::control::{MOST_LINE_BYTES, Order, OrderLine, RecordingReply, Reply};
use crate::quantity;

/// How long the daemon may take: its ledger may be held up for 2 s, its recorder for 4 s.
const PATIENCE: Duration = Duration::from_secs(10);
/// The same for a snapshot: it is written to the end.
const SNAPSHOT_PATIENCE: Duration = Duration::from_secs(120);

/// What `ctl` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled ctl learn-background --lasts 5s      while the room is empty\n  \
    tumbled ctl reset-filter\n  tumbled ctl marker \"lights off\"\n  \
    tumbled ctl record start spin-7.mcap         and later: tumbled ctl record stop\n  \
    tumbled ctl snapshot                         the last 30 s, a recording of their own\n  \
    tumbled ctl note --name spin-7 --operator Ada \"lamp off\"\n\n\
    An order to the core stands in the ledger: a replay of the recording repeats it. What comes of it is told by the \
    state stream's EVENT lines.\n\
    Recordings are written to the daemon's own folder. A replay of one that began in mid-session acquires the target anew.\n\
    The socket is for its owner and group.\n\
    Exit codes: 0 it is carried out or in the ledger, 1 nobody listens, or it was refused.")]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    order: OrderArgs,
    /// The daemon's control socket.
    #[arg(long, global = true, value_name = "PATH", default_value = DEFAULT_CONTROL_SOCKET)]
    connect: PathBuf,
    /// The answer as JSON.
    #[arg(long, global = true)]
    json: bool,
}

/// An order.
#[derive(Debug, Subcommand)]
enum OrderArgs {
    /// The room is empty: what is seen now is left out from then on. A tracked target is forgotten.
    LearnBackground {
        /// For how long, 100ms to 10m; left out: target.background_s.
        #[arg(long, value_parser = quantity::duration, value_name = "TIME")]
        lasts: Option<Duration>,
    },
    /// Nothing is background any more.
    ForgetBackground,
    /// Forget the target and acquire it anew, in a frame of its own.
    ResetFilter,
    /// Write a remark into the recording.
    Marker {
        /// What it says.
        text: String,
    },
    /// Record while the session runs.
    Record {
        /// Begin or end.
        #[command(subcommand)]
        what: RecordOrder,
    },
    /// Record the newest events, as many as record.pretrigger keeps.
    Snapshot {
        /// The file's name, e.g. spin-7.mcap; left out: one by the date.
        #[arg(value_name = "FILE.mcap")]
        file: Option<String>,
    },
    /// Say something of the run: it stands in recordings that begin later, in the running one as a marker, and in HEALTH.
    Note {
        /// A remark.
        text: Option<String>,
        /// The run's name.
        #[arg(long)]
        name: Option<String>,
        /// Who runs it.
        #[arg(long)]
        operator: Option<String>,
    },
}

/// What of a recording.
#[derive(Debug, Subcommand)]
enum RecordOrder {
    /// Record from now on.
    Start {
        /// The file's name, e.g. spin-7.mcap; left out: one by the date.
        #[arg(value_name = "FILE.mcap")]
        file: Option<String>,
    },
    /// End the recording.
    Stop,
}

impl OrderArgs {
    fn line(&self) -> OrderLine {
        match self {
            Self::LearnBackground { lasts } => {
                let lasts_s = lasts.map(|lasts| lasts.as_secs_f64());
                OrderLine { lasts_s, ..OrderLine::of(Order::LearnBackground) }
            }
            Self::ForgetBackground => OrderLine::of(Order::ForgetBackground),
            Self::ResetFilter => OrderLine::of(Order::ResetFilter),
            Self::Marker { text } => OrderLine { text: Some(text.clone()), ..OrderLine::of(Order::Marker) },
            Self::Record { what: RecordOrder::Start { file } } => {
                OrderLine { file: file.clone(), ..OrderLine::of(Order::RecordStart) }
            }
            Self::Record { what: RecordOrder::Stop } => OrderLine::of(Order::RecordStop),
            Self::Snapshot { file } => OrderLine { file: file.clone(), ..OrderLine::of(Order::Snapshot) },
            Self::Note { text, name, operator } => {
                let (text, name, operator) = (text.clone(), name.clone(), operator.clone());
                OrderLine { text, name, operator, ..OrderLine::of(Order::Note) }
            }
        }
    }
}

/// Gives the order.
///
/// # Errors
/// Exit code 1: nobody listens, or the daemon refused.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let line = args.order.line();
    let reply = ask(&args.connect, &line).map_err(|error| {
        Failure::failed(format!("no daemon takes orders at {}: {error}", args.connect.display()))
            .with_help("is `tumbled run` running, and are you in the socket's group? --connect names another socket")
    })?;
    match &reply {
        Reply::Error { message } => return Err(Failure::failed(format!("the daemon refused: {message}"))),
        Reply::Done { .. } if args.json => output::json(&reply)?,
        Reply::Done { t_ns, recording, .. } => {
            let file = recording.as_ref().map_or_else(String::new, |recording| {
                let RecordingReply { file, events, bytes, covers_s } = recording;
                let (file, bytes) = (file.display(), HumanBytes(*bytes));
                if *events == 0 {
                    format!(": {file}")
                } else {
                    format!(": {file}, {covers_s:.1} s, {events} events, {bytes}")
                }
            });
            output::text(&format!("done at {:.3} s{file}\n", *t_ns as f64 * 1e-9))?;
        }
    }
    Ok(Outcome::Fine)
}

fn ask(path: &Path, line: &OrderLine) -> io::Result<Reply> {
    let mut daemon = UnixStream::connect(path)?;
    let patience = if line.order == Order::Snapshot { SNAPSHOT_PATIENCE } else { PATIENCE };
    daemon.set_read_timeout(Some(patience))?;
    daemon.set_write_timeout(Some(PATIENCE))?;
    let mut request = serde_json::to_vec(line).map_err(io::Error::other)?;
    request.push(b'\n');
    daemon.write_all(&request)?;
    let mut answer = String::new();
    BufReader::new(daemon).take(MOST_LINE_BYTES).read_line(&mut answer)?;
    serde_json::from_str(&answer).map_err(io::Error::other)
}

//! `tumbled ctl`: orders for a running daemon.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args as ClapArgs, Subcommand};

use super::{Failure, Outcome, output};
use crate::config::DEFAULT_CONTROL_SOCKET;
use crate::control::{MOST_LINE_BYTES, Order, OrderLine, Reply};
use crate::quantity;

/// How long the daemon may take: its ledger may be held up for 2 s.
const PATIENCE: Duration = Duration::from_secs(5);

/// What `ctl` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled ctl learn-background --lasts 5s      while the room is empty\n  \
    tumbled ctl reset-filter\n  tumbled ctl marker \"lights off\"\n\n\
    An order stands in the ledger: a replay of the recording repeats it. What comes of it is told by the state \
    stream's EVENT lines.\n\
    The socket is for its owner and group.\n\
    Exit codes: 0 it is in the ledger, 1 nobody listens, or it was refused.")]
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
}

/// Gives the order.
///
/// # Errors
/// Exit code 1: nobody listens, or the daemon refused.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let line = |order, lasts_s, text| OrderLine { order, lasts_s, text };
    let line = match &args.order {
        OrderArgs::LearnBackground { lasts } => {
            line(Order::LearnBackground, lasts.map(|lasts| lasts.as_secs_f64()), None)
        }
        OrderArgs::ForgetBackground => line(Order::ForgetBackground, None, None),
        OrderArgs::ResetFilter => line(Order::ResetFilter, None, None),
        OrderArgs::Marker { text } => line(Order::Marker, None, Some(text.clone())),
    };
    let reply = ask(&args.connect, &line).map_err(|error| {
        Failure::failed(format!("no daemon takes orders at {}: {error}", args.connect.display()))
            .with_help("is `tumbled run` running, and are you in the socket's group? --connect names another socket")
    })?;
    match &reply {
        Reply::Error { message } => return Err(Failure::failed(format!("the daemon refused: {message}"))),
        Reply::Done { .. } if args.json => output::json(&reply)?,
        Reply::Done { t_ns, .. } => output::text(&format!("done at {:.3} s\n", *t_ns as f64 * 1e-9))?,
    }
    Ok(Outcome::Fine)
}

fn ask(path: &Path, line: &OrderLine) -> io::Result<Reply> {
    let mut daemon = UnixStream::connect(path)?;
    daemon.set_read_timeout(Some(PATIENCE))?;
    daemon.set_write_timeout(Some(PATIENCE))?;
    let mut request = serde_json::to_vec(line).map_err(io::Error::other)?;
    request.push(b'\n');
    daemon.write_all(&request)?;
    let mut answer = String::new();
    BufReader::new(daemon).take(MOST_LINE_BYTES).read_line(&mut answer)?;
    serde_json::from_str(&answer).map_err(io::Error::other)
}

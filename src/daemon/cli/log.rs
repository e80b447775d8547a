//! The log: sentences with fields, to stderr.

use std::io::IsTerminal;

use tracing::level_filters::LevelFilter;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Starts the log. 0 logs what happens (info), each step up shows more (debug, trace), each step down less (warnings,
/// errors). No environment variable takes part.
pub fn init(verbosity: i8) {
    let level = match verbosity {
        ..=-2 => LevelFilter::ERROR,
        -1 => LevelFilter::WARN,
        0 => LevelFilter::INFO,
        1 => LevelFilter::DEBUG,
        2.. => LevelFilter::TRACE,
    };
    // Libraries speak of themselves: below a warning, only to those who ask for more.
    let of_libraries = if verbosity > 0 { level } else { level.min(LevelFilter::WARN) };
    let filter = Targets::new().with_default(of_libraries).with_target("tumbled", level);
    // Times are left to whoever collects stderr: the journal stamps each line itself.
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(verbosity > 0)
        .without_time();
    tracing_subscriber::registry().with(lines.with_filter(filter)).init();
}

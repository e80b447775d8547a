//! The log: sentences with fields, to stderr.

use std::io::IsTerminal;

use tracing::level_filters::LevelFilter;

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
    // Times are left to whoever collects stderr: the journal stamps each line itself.
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_max_level(level)
        .with_target(verbosity > 0)
        .without_time()
        .init();
}

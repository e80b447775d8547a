//! SIGINT and SIGTERM end a command cleanly, a second one at once; SIGHUP asks for the config to be read again.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use tumbled_io::live::StopToken;

use super::Failure;

/// The signals of a command that runs for long.
#[derive(Debug)]
pub struct Signals {
    /// Stopped by the first SIGINT or SIGTERM.
    pub stop: StopToken,
    reload: Arc<AtomicBool>,
}

impl Signals {
    /// Whether a SIGHUP came since the last call.
    pub fn take_reload(&self) -> bool {
        self.reload.swap(false, Ordering::Relaxed)
    }
}

/// Catches SIGINT, SIGTERM and SIGHUP from here on.
///
/// # Errors
/// When the system gives no descriptor or thread.
pub fn catch() -> Result<Signals, Failure> {
    let reload = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGHUP, Arc::clone(&reload)).map_err(Failure::failed)?;
    Ok(Signals { stop: stop_token()?, reload })
}

/// A token that the first SIGINT or SIGTERM stops; a second one ends the process at once, with 128 + its number.
///
/// # Errors
/// When the system gives no descriptor or thread.
pub fn stop_token() -> Result<StopToken, Failure> {
    let stop = StopToken::new().map_err(Failure::failed)?;
    let told = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&told))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&told)))
            .map_err(Failure::failed)?;
    }
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]).map_err(Failure::failed)?;
    let token = stop.clone();
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            if signals.forever().next().is_some() {
                token.stop();
            }
        })
        .map_err(Failure::failed)?;
    Ok(stop)
}

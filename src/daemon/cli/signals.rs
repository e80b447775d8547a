//! SIGINT and SIGTERM end a command cleanly, a second one at once.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use tumbled_io::live::StopToken;

use super::Failure;

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
    let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(Failure::failed)?;
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

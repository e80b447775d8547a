//! The line stream: whatever comes, as it comes.

use super::port::{Port, READ_BYTES};
use super::{Chunks, Ended, SerialTrouble};
use crate::live::stop::StopToken;
use std::time::{Duration, Instant};

/// Without a byte for so long the port is opened anew, which starts many a microcontroller afresh. Longer than one takes to
/// start (2 s), so that it is not kept from it.
const SILENT_AFTER: Duration = Duration::from_secs(4);

/// Listens until the stop.
pub(super) fn listen(port: &mut Port, chunks: &mut Chunks, stop: &StopToken) -> Result<(), Ended> {
    let mut read = [0; READ_BYTES];
    let mut newest = Instant::now();
    while !stop.is_stopped() {
        let n = port.read(SILENT_AFTER, &mut read)?;
        let bytes = read.get(..n).unwrap_or_default();
        if !bytes.is_empty() {
            chunks.push(chunks.now(), bytes)?;
            newest = Instant::now();
        } else if newest.elapsed() > SILENT_AFTER {
            return Err(SerialTrouble::Silent.into());
        }
    }
    Ok(())
}

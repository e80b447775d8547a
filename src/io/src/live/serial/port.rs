//! One open serial port: raw, exclusive, never waited for longer than a stop may take.

use super::SerialTrouble;
use crate::machine::{SerialAccess, byte_time, serial_access, serial_holders, shorten_latency};
use serialport::{ClearBuffer, SerialPort, TTYPort};
use std::io::{self, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};
use tumbled_model::Span;

/// A read looks up this often: a stop is noticed so much later at most.
const LOOK: Duration = Duration::from_millis(20);
/// A port that takes no byte for so long is clogged: its buffer holds 40 requests.
const CLOGGED: Duration = Duration::from_millis(200);
/// Bytes read at once.
pub(super) const READ_BYTES: usize = 1_024;
/// A read that is full is of a device that babbles: the line at 921 600 baud gives 92 bytes a millisecond. The next read
/// waits, so that no sender takes this machine's time.
const BABBLE_PAUSE: Duration = Duration::from_millis(5);

/// An open port.
#[derive(Debug)]
pub(super) struct Port {
    tty: TTYPort,
    /// How long a byte is on the line at least.
    byte_time: Span,
    /// Read full just now.
    babbles: bool,
}

impl Port {
    /// Opens a port: raw, 8N1, no flow control, nobody else's. What the system says of it lies below `root`.
    pub(super) fn open(root: &Path, path: &Path, baud: u32) -> Result<Self, SerialTrouble> {
        match serial_access(path) {
            SerialAccess::Absent => return Err(SerialTrouble::Absent),
            SerialAccess::NoDevice => return Err(SerialTrouble::NoDevice),
            SerialAccess::Forbidden => return Err(SerialTrouble::Forbidden),
            SerialAccess::Usable => {}
        }
        shorten_latency(root, path);
        let opened = serialport::new(path.to_string_lossy(), baud).timeout(LOOK).open_native();
        let tty = opened.map_err(|error| match serial_holders(root, path) {
            // The library has no kind of its own for a port that is locked.
            holders if !holders.is_empty() || is_busy(&error) => SerialTrouble::Busy { holders },
            _ => SerialTrouble::Open { error: error.to_string() },
        })?;
        // What came before the port had its rate is noise; a port that cannot forget it is read all the same.
        tty.clear(ClearBuffer::Input).unwrap_or(());
        Ok(Self { tty, byte_time: byte_time(path, baud), babbles: false })
    }

    /// How long so many bytes are on the line at least.
    pub(super) fn line_time(&self, bytes: usize) -> Span {
        Span(self.byte_time.0.saturating_mul(i64::try_from(bytes).unwrap_or(i64::MAX)))
    }

    /// Reads what is there, or comes within `wait` and within one look; 0: nothing did.
    pub(super) fn read(&mut self, wait: Duration, into: &mut [u8]) -> Result<usize, SerialTrouble> {
        if core::mem::take(&mut self.babbles) {
            std::thread::sleep(BABBLE_PAUSE);
        }
        self.wait_at_most(wait.min(LOOK))?;
        match self.tty.read(into) {
            Ok(0) => Err(SerialTrouble::Gone { error: io::ErrorKind::UnexpectedEof.into() }),
            Ok(n) => {
                self.babbles = n == into.len();
                Ok(n)
            }
            Err(error) if is_passing(&error) => Ok(0),
            Err(error) => Err(SerialTrouble::Gone { error }),
        }
    }

    /// Writes all of it.
    pub(super) fn write(&mut self, mut bytes: &[u8]) -> Result<(), SerialTrouble> {
        let began = Instant::now();
        self.wait_at_most(LOOK)?;
        while !bytes.is_empty() {
            match self.tty.write(bytes) {
                Ok(n) => bytes = bytes.get(n..).unwrap_or_default(),
                Err(error) if is_passing(&error) => {}
                Err(error) => return Err(SerialTrouble::Gone { error }),
            }
            if !bytes.is_empty() && began.elapsed() > CLOGGED {
                return Err(SerialTrouble::Clogged);
            }
        }
        Ok(())
    }

    fn wait_at_most(&mut self, time: Duration) -> Result<(), SerialTrouble> {
        self.tty.set_timeout(time).map_err(|error| SerialTrouble::Gone { error: error.into() })
    }
}

fn is_passing(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

/// `EBUSY`, or a lock that somebody holds.
fn is_busy(error: &serialport::Error) -> bool {
    let text = error.to_string().to_lowercase();
    text.contains("busy") || text.contains("exclusive lock")
}

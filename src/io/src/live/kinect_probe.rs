//! Reading a Kinect for a moment, to tell whether it delivers; nothing goes into a ledger.

use super::clock::SessionClock;
use super::kinect_usb::{KinectOpener, KinectUsbConfig};
use super::source::{SourceError, SourceInfo};
use super::stop::StopToken;
use core::ops::ControlFlow;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How often the stream is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// What came of a Kinect.
#[derive(Clone, Debug, PartialEq)]
pub struct KinectProbed {
    /// What it is.
    pub info: SourceInfo,
    /// Frames that came.
    pub frames: u64,
    /// Of them with USB packets missing.
    pub damaged: u64,
    /// Frames that the device stamped in between and that did not come.
    pub missing: u64,
    /// From the stream's start on.
    pub time: Duration,
}

#[derive(Debug, Default)]
struct Counts {
    frames: AtomicU64,
    damaged: AtomicU64,
    missing: AtomicU64,
}

/// Opens a Kinect, takes its frames for so long, and closes it. The device must be nobody else's.
///
/// # Errors
/// [`SourceError::Kinect`]: it cannot be opened, or its stream fails. A stream that merely brings nothing is no error.
pub fn probe_kinect(config: KinectUsbConfig, time: Duration) -> Result<KinectProbed, SourceError> {
    let clock = SessionClock::start_on_system();
    let stop = StopToken::new().map_err(no_descriptor)?;
    let source = KinectOpener::new(config, clock, stop).open_kinect()?;
    let counts = Arc::new(Counts::default());
    let theirs = Arc::clone(&counts);
    let sink = Box::new(move |frame: &tumbled_freenect::Frame<'_>| {
        theirs.frames.fetch_add(1, Ordering::Relaxed);
        theirs.damaged.fetch_add(u64::from(frame.lost_packets.count() > 0), Ordering::Relaxed);
        theirs.missing.fetch_add(u64::from(frame.missing_before), Ordering::Relaxed);
        ControlFlow::Continue(())
    });
    let began = Instant::now();
    let info = source.taken_by(sink, |kinect| {
        while began.elapsed() < time {
            if let Some(outcome) = kinect.look() {
                return outcome.map(|_| ());
            }
            std::thread::sleep(LOOK);
        }
        Ok(())
    })?;
    let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
    let (frames, damaged, missing) = (read(&counts.frames), read(&counts.damaged), read(&counts.missing));
    Ok(KinectProbed { info, frames, damaged, missing, time: began.elapsed() })
}

fn no_descriptor(error: io::Error) -> SourceError {
    SourceError::Kinect { error: tumbled_freenect::KinectError::NoThread(error), hints: Vec::new() }
}

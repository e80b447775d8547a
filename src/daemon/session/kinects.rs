//! Kinects on the USB as a session's sources: only in builds with the feature `kinect-usb`.

use tumbled_io::live::{Backoff, Opener, SessionClock, StopToken};

use crate::cli::Failure;
use crate::config::{Config, KinectConfig};

/// A Kinect that is refused because this program cannot read it must not look as if it were measured with.
///
/// # Errors
/// Exit code 2: the config has a Kinect, and this build reads none.
pub fn refuse_unreadable(config: &Config) -> Result<(), Failure> {
    match config.kinects.first() {
        Some(kinect) if !cfg!(feature = "kinect-usb") => Err(unreadable(kinect)),
        _ => Ok(()),
    }
}

fn unreadable(kinect: &KinectConfig) -> Failure {
    let id = &kinect.id;
    let message =
        format!("the config has the Kinect `{id}`, and this program was built without kinect-usb: it cannot read one");
    Failure::input(message).with_help(
        "build it with `cargo build --release --features kinect-usb` (docs/kinect-usb.md tells what that needs), or put \
         `kinect = []` at the top of the config to run without",
    )
}

/// What opens a Kinect, again and again, and how long it waits in between.
#[cfg(feature = "kinect-usb")]
pub(super) fn opener(
    kinect: &KinectConfig,
    clock: &SessionClock,
    stop: &StopToken,
) -> Result<(Box<dyn Opener>, Backoff), Failure> {
    use tumbled_io::live::{KinectOpener, KinectUsbConfig};

    let usb = KinectUsbConfig::new(kinect.id.clone(), kinect.serial.as_deref().unwrap_or_default());
    Ok((Box::new(KinectOpener::new(usb, clock.clone(), stop.clone())), KinectOpener::BACKOFF))
}

/// Nothing opens a Kinect here.
#[cfg(not(feature = "kinect-usb"))]
pub(super) fn opener(
    kinect: &KinectConfig,
    _: &SessionClock,
    _: &StopToken,
) -> Result<(Box<dyn Opener>, Backoff), Failure> {
    Err(unreadable(kinect))
}

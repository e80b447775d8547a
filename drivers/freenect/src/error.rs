//! Why there are no frames, and what to do about it.

use core::time::Duration;
use std::io;
use std::path::PathBuf;

/// Why a Kinect does not deliver.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KinectError {
    /// The library finds no camera of a Kinect.
    #[error(
        "no Kinect is on the USB: plug it in, and its 12 V supply too (without it the camera does not come up); `lsusb -d 045e:` \
         lists its parts"
    )]
    NoDevice,
    /// There are Kinects, and none has the serial number.
    #[error(
        "no Kinect has the serial number `{serial}`; found: {}. One that this user may not open has no number here; models \
         1473 and Kinect for Windows go by the number of their microphones",
        list(found)
    )]
    NoSuchSerial {
        /// The configured number.
        serial: String,
        /// The numbers there are.
        found: Vec<String>,
    },
    /// The configured serial number is what models without one report.
    #[error(
        "sixteen zeros are no serial number: models 1473 and Kinect for Windows report them; use the number of the Kinect's \
         microphones (`lsusb -v -d 045e:02ad`), or leave it empty for the only Kinect"
    )]
    SerialOfZeros,
    /// There are several Kinects, and none was named.
    #[error("there are {count} Kinects and none is named: set its serial number; found: {}", list(found))]
    Ambiguous {
        /// How many cameras there are.
        count: usize,
        /// The serial numbers of those that could be asked.
        found: Vec<String>,
    },
    /// This user may not open the device.
    #[error(
        "no permission to open the Kinect: a udev rule has to allow it. Debian's package libfreenect0.5 brings one for the \
         camera 045e:02ae; a Kinect for Windows needs its own: SUBSYSTEM==\"usb\", ATTR{{idVendor}}==\"045e\", \
         ATTR{{idProduct}}==\"02bf\", MODE=\"0666\". Then plug it in anew"
    )]
    NotPermitted,
    /// Another program or a kernel driver has the camera.
    #[error(
        "the Kinect's camera is in use ({said}): end the other program (`fuser -v /dev/bus/usb/*/*` shows it) or unload the \
         kernel's driver: `modprobe -r gspca_kinect`, and for good a line `blacklist gspca_kinect` in \
         /etc/modprobe.d/kinect.conf; after a killed program plug the Kinect in anew"
    )]
    Busy {
        /// What the library said.
        said: String,
    },
    /// The device was found and opening it failed.
    #[error(
        "opening the Kinect failed with {code} ({said}): plug it in anew, at a port of the machine itself, not of a hub"
    )]
    OpenFailed {
        /// What the library returned.
        code: i32,
        /// What the library said.
        said: String,
    },
    /// Opening took longer than it may.
    #[error(
        "the Kinect did not answer within {} s: opening it was given up, and its thread left behind; plug it in anew",
        within.as_secs_f64()
    )]
    OpenTimeout {
        /// How long it was given.
        within: Duration,
    },
    /// An earlier opening still hangs in the library.
    #[error(
        "the Kinect still does not answer: {threads} thread(s) of earlier attempts hang in the USB library; plug the Kinect in \
         anew, and if that does not help, start this program anew"
    )]
    StillHanging {
        /// Threads that hang.
        threads: u64,
    },
    /// The usb thread made no step for this long.
    #[error("the USB library hung for {} s in the middle of the stream: its thread was left behind", after.as_secs_f64())]
    Hung {
        /// For how long.
        after: Duration,
    },
    /// The caller gave up before the device was open.
    #[error("opening the Kinect was cancelled")]
    Cancelled,
    /// A step after opening failed.
    #[error("{step} failed with {code} ({said}): plug the Kinect in anew")]
    Setup {
        /// Which step.
        step: &'static str,
        /// What the library returned.
        code: i32,
        /// What the library said.
        said: String,
    },
    /// The USB has no room for the stream.
    #[error(
        "the USB refused {refused} of the {of} depth transfers: no bandwidth is left on this controller (a second Kinect or a \
         camera on it?); use a port of another controller: `lsusb -t` shows which ports share one"
    )]
    NoBandwidth {
        /// Transfers refused.
        refused: u32,
        /// Transfers asked for.
        of: u32,
    },
    /// The stream runs and brings no frames, after stopping and starting it once too.
    #[error(
        "no depth frame for {} s, though the stream was started twice: use a port of the machine itself (no hub, no virtual \
         machine) and check the 12 V supply",
        after.as_secs_f64()
    )]
    NoFrame {
        /// For how long, both times together.
        after: Duration,
    },
    /// The device went away.
    #[error("the Kinect was unplugged, or lost its power")]
    Unplugged,
    /// The library's event handling failed.
    #[error("handling USB events failed with {code} ({said})")]
    Events {
        /// What the library returned.
        code: i32,
        /// What the library said.
        said: String,
    },
    /// The library itself does not start.
    #[error("libfreenect does not start: it returned {code}; is /dev/bus/usb there?")]
    Library {
        /// What it returned.
        code: i32,
    },
    /// The recorded frames cannot be played.
    #[error(transparent)]
    Playback(#[from] PlaybackError),
    /// The sink panicked; nothing is delivered any more.
    #[error("a panic while a frame was handled: this is a bug of this program")]
    SinkPanicked,
    /// The system gives no thread.
    #[error("no thread for the Kinect: {0}")]
    NoThread(io::Error),
    /// The usb thread ended without a word.
    #[error("the Kinect's thread ended by a panic: this is a bug of this program")]
    ThreadPanicked,
}

impl KinectError {
    /// Whether another attempt can help: cables, power and permissions change, recorded frames and bugs do not.
    pub fn is_worth_a_retry(&self) -> bool {
        !matches!(self, Self::Playback(_) | Self::SerialOfZeros | Self::SinkPanicked)
    }

    /// Whether the device is there and does not do its work: what a USB reset can mend.
    pub fn calls_for_a_reset(&self) -> bool {
        matches!(
            self,
            Self::OpenTimeout { .. }
                | Self::StillHanging { .. }
                | Self::Hung { .. }
                | Self::NoFrame { .. }
                | Self::OpenFailed { .. }
        )
    }
}

/// Why a folder of recorded frames cannot be played. The player would end the whole program.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlaybackError {
    /// Nothing names the folder.
    #[error("the player of recorded frames (fakenect) stands in for libfreenect, and FAKENECT_PATH names no folder")]
    NoFolder,
    /// A file cannot be read.
    #[error("the recorded frames cannot be played: {}: {error}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// The index is no regular file: what it will list cannot be checked.
    #[error("the recorded frames cannot be played: {} is not a regular file", path.display())]
    IndexIsNoFile {
        /// The index.
        path: PathBuf,
    },
    /// A line of the index is none.
    #[error("{} line {line}: `{found}` is not of the form TYPE-SECONDS-TICKS.ext", path.display())]
    IndexLine {
        /// The index.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The line, its first 80 characters.
        found: String,
    },
    /// A depth file has another size.
    #[error("{} holds {found} bytes after its header line, expected {expected}", path.display())]
    WrongLength {
        /// The file.
        path: PathBuf,
        /// Bytes of payload found.
        found: u64,
        /// Bytes of payload expected.
        expected: u64,
    },
}

fn list(serials: &[String]) -> String {
    if serials.is_empty() { "none that tells its number".to_owned() } else { serials.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_names_its_remedy() {
        let said = || "LIBUSB_ERROR_BUSY".to_owned();
        let remedies = [
            (KinectError::NoDevice, "12 V"),
            (KinectError::NoSuchSerial { serial: "A1".into(), found: vec!["B2".into(), "C3".into()] }, "B2, C3"),
            (KinectError::Ambiguous { count: 2, found: vec![] }, "set its serial number"),
            (KinectError::SerialOfZeros, "microphones"),
            (KinectError::NotPermitted, "ATTR{idProduct}==\"02bf\""),
            (KinectError::Busy { said: said() }, "modprobe -r gspca_kinect"),
            (KinectError::OpenTimeout { within: Duration::from_secs(5) }, "within 5 s"),
            (KinectError::NoBandwidth { refused: 16, of: 16 }, "another controller"),
            (KinectError::NoFrame { after: Duration::from_secs(4) }, "no hub"),
        ];
        for (error, remedy) in remedies {
            assert!(error.to_string().contains(remedy), "{error}");
        }
    }

    #[test]
    fn what_only_a_person_can_change_in_the_files_is_not_tried_again() {
        assert!(!KinectError::from(PlaybackError::NoFolder).is_worth_a_retry());
        assert!(KinectError::NotPermitted.is_worth_a_retry() && KinectError::Unplugged.is_worth_a_retry());
    }
}

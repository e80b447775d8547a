//! The usb thread: opens the Kinect, runs its stream, closes it.

use crate::callbacks::StreamState;
use crate::error::KinectError;
use crate::frame::FrameSink;
use crate::kinect::{End, Opened};
use crate::library::{Context, Device, Library};
use crate::options::Options;
use crate::posture::{self, Acceleration};
use crate::priority::{Priority, Raised};
use crate::symbols::Symbols;
use crate::{playback, said};
use core::time::Duration;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// How long one turn waits for the USB: the longest time until a stop is seen.
const TURN: Duration = Duration::from_millis(100);
/// Transfers that the library submits for the depth stream.
pub(crate) const TRANSFERS: u32 = 16;

/// What the usb thread and the handle share.
#[derive(Default)]
pub(crate) struct Shared {
    /// The thread is to close and end.
    pub(crate) stop: AtomicBool,
    /// Counts turns of the loop: a thread that hangs makes none.
    pub(crate) beats: AtomicU64,
    /// Frames that the library finished.
    pub(crate) frames: AtomicU64,
    /// Where frames go; taken away from a thread that is left behind.
    pub(crate) sink: Mutex<Option<FrameSink>>,
    /// The latest reading.
    pub(crate) acceleration: Mutex<Option<Acceleration>>,
}

/// What the thread tells. After the last one its sender is dropped: the thread has closed everything.
#[derive(Debug)]
pub(crate) enum Report {
    /// The device is open.
    Opened(Opened),
    /// Opening failed, or the stream is over; the device is still being closed.
    Ended(Result<End, KinectError>),
}

/// The thread's work. `begin` tells it to start the stream; when its other end is gone there will be none.
pub(crate) fn work(options: &Options, shared: &Arc<Shared>, begin: &Receiver<()>, reports: &SyncSender<Report>) {
    let tell = |report| {
        // A handle that gave this thread up does not listen any more.
        drop(reports.send(report));
    };
    let symbols = Symbols::look_up();
    let library = if symbols.set_depth_chunk_callback.is_some() { Library::Freenect } else { Library::Fakenect };
    let context = match ready(library).and_then(|()| Context::new(symbols)) {
        Ok(context) => context,
        Err(error) => return tell(Report::Ended(Err(error))),
    };
    let (mut device, serial, motor) = match open(&context, options) {
        Ok(opened) => opened,
        Err(error) => return tell(Report::Ended(Err(error))),
    };
    let posture_failed = match (options.wants_motor(), motor) {
        (true, true) => posture::apply(&device, options),
        (true, false) => Some("opening the motor"),
        (false, _) => None,
    };
    let raised = (library == Library::Freenect).then(Raised::ask);
    let priority = raised.as_ref().map_or(Priority::Ordinary, Raised::granted);
    tell(Report::Opened(Opened { library, serial, posture_failed, priority }));
    if begin.recv().is_ok() {
        let outcome =
            Streaming::new(options, shared, library, motor && posture_failed.is_none()).run(&mut device, &context);
        drop(raised);
        tell(Report::Ended(outcome));
    }
}

/// The player ends the program over what it does not find: looked for first.
fn ready(library: Library) -> Result<(), KinectError> {
    match library {
        Library::Freenect => Ok(()),
        Library::Fakenect => Ok(playback::check(std::env::var_os("FAKENECT_PATH").as_deref())?),
    }
}

/// The device, its serial number, and whether its motor is open too. A motor that cannot be had costs no depth.
fn open<'context>(
    context: &'context Context,
    options: &Options,
) -> Result<(Device<'context>, Option<String>, bool), KinectError> {
    let serial = options.serial.as_deref();
    if options.wants_motor()
        && let Ok((device, serial)) = context.open(serial, true)
    {
        return Ok((device, serial, true));
    }
    let (device, serial) = context.open(serial, false)?;
    Ok((device, serial, false))
}

/// A running stream and its watches.
struct Streaming<'a> {
    shared: &'a Arc<Shared>,
    library: Library,
    frame_within: Duration,
    read_every: Option<Duration>,
    last_frame: Instant,
    last_reading: Instant,
    frames: u64,
    restarted: bool,
}

impl<'a> Streaming<'a> {
    fn new(options: &Options, shared: &'a Arc<Shared>, library: Library, motor: bool) -> Self {
        let now = Instant::now();
        let read_every = options.accelerometer.filter(|_| motor);
        let (last_frame, last_reading, frame_within) = (now, now, options.frame_within);
        Self { shared, library, frame_within, read_every, last_frame, last_reading, frames: 0, restarted: false }
    }

    fn run(mut self, device: &mut Device<'_>, context: &Context) -> Result<End, KinectError> {
        let mut refused = device.start(Arc::clone(self.shared))?;
        self.last_frame = Instant::now();
        loop {
            self.shared.beats.fetch_add(1, Ordering::Relaxed);
            if self.shared.stop.load(Ordering::SeqCst) {
                return Ok(End::Stopped);
            }
            if refused >= TRANSFERS {
                // Not one transfer is under way: no frame will come.
                return Err(KinectError::NoBandwidth { refused, of: TRANSFERS });
            }
            if let Err(code) = context.handle_events(TURN) {
                return self.events_failed(code);
            }
            match device.state() {
                StreamState::Running => {}
                StreamState::Over => return Ok(End::SinkClosed),
                StreamState::Panicked => return Err(KinectError::SinkPanicked),
            }
            if self.is_silent() {
                refused = self.start_anew(device, refused)?;
            }
            self.read_accelerometer(device);
        }
    }

    fn events_failed(&self, code: i32) -> Result<End, KinectError> {
        let said = said::since();
        match self.library {
            Library::Fakenect => Ok(End::Played),
            Library::Freenect if said.disappeared => Err(KinectError::Unplugged),
            Library::Freenect => Err(KinectError::Events { code, said: said.line() }),
        }
    }

    /// Whether the stream has been silent for too long. The player keeps its own pace.
    fn is_silent(&mut self) -> bool {
        let frames = self.shared.frames.load(Ordering::Relaxed);
        if frames != self.frames {
            self.frames = frames;
            self.last_frame = Instant::now();
            self.restarted = false;
        }
        self.library == Library::Freenect && self.last_frame.elapsed() >= self.frame_within
    }

    /// Stops and starts the stream once; a second silence in a row is an error.
    fn start_anew(&mut self, device: &mut Device<'_>, refused: u32) -> Result<u32, KinectError> {
        if refused > 0 {
            return Err(KinectError::NoBandwidth { refused, of: TRANSFERS });
        }
        if self.restarted {
            return Err(KinectError::NoFrame { after: self.frame_within * 2 });
        }
        let refused = device.restart()?;
        self.restarted = true;
        self.last_frame = Instant::now();
        Ok(refused)
    }

    fn read_accelerometer(&mut self, device: &Device<'_>) {
        let Some(every) = self.read_every else { return };
        if self.last_reading.elapsed() >= every {
            self.last_reading = Instant::now();
            let reading = posture::read(device);
            *self.shared.acceleration.lock().unwrap_or_else(PoisonError::into_inner) = reading;
        }
    }
}

//! The handle on a Kinect's thread.

use crate::abandoned::{Abandoned, Presence};
use crate::error::KinectError;
use crate::frame::FrameSink;
use crate::library::Library;
use crate::options::Options;
use crate::posture::Acceleration;
use crate::priority::Priority;
use crate::worker::{Report, Shared, work};
use core::time::Duration;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

/// How often a caller that waits for the opening is asked whether it still wants it.
const LOOK: Duration = Duration::from_millis(20);
/// How long a thread that was told to end may take: closing a device that answers takes some 50 ms.
pub const STOP_WITHIN: Duration = Duration::from_millis(1_500);
/// A thread that makes no turn for this long hangs: a turn takes a tenth of a second, a restart of the stream one second.
const HUNG_AFTER: Duration = Duration::from_secs(5);

/// What was opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Opened {
    /// Which library of the name is loaded.
    pub library: Library,
    /// The serial number, as the library has it; `None`: it is not known.
    pub serial: Option<String>,
    /// The step of tilt, lamp or accelerometer that failed: depth comes all the same.
    pub posture_failed: Option<&'static str>,
    /// The usb thread's priority while frames come; ordinary for recorded frames, which nothing can lose.
    pub priority: Priority,
}

/// Why a stream is over, when nothing failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It was told to stop.
    Stopped,
    /// The sink wanted no more.
    SinkClosed,
    /// The recorded frames are over.
    Played,
}

/// How a thread ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
    /// The device is closed.
    Closed,
    /// It hangs in the library, and was left behind.
    LeftBehind,
}

/// An open Kinect on a thread of its own. Dropping it is stopping it.
pub struct Kinect {
    opened: Opened,
    shared: Arc<Shared>,
    begin: Option<SyncSender<()>>,
    reports: Receiver<Report>,
    presence: Presence,
    /// The latest count of turns, and when it changed.
    beat: (u64, Instant),
    ended: bool,
}

impl Kinect {
    /// Opens a Kinect on a thread named `usb-NAME`. Returns within [`Options::open_within`], or within [`STOP_WITHIN`] after
    /// `cancelled` says so, whatever the device does: a thread that hangs is left to `abandoned`.
    ///
    /// # Errors
    /// [`KinectError`]: why it is not open, and what to do.
    pub fn open(
        name: &str,
        options: Options,
        abandoned: &Abandoned,
        cancelled: &dyn Fn() -> bool,
    ) -> Result<Self, KinectError> {
        if !abandoned.allows_another() {
            return Err(KinectError::StillHanging { threads: abandoned.hanging() });
        }
        let shared = Arc::new(Shared::default());
        let (begin, told_to_begin) = sync_channel(1);
        let (tell, reports) = sync_channel(2);
        let presence = abandoned.presence();
        let (within, theirs, present) = (options.open_within, Arc::clone(&shared), presence.clone());
        let thread = move || {
            // Dropped last, in reverse order: first the sender, by which the owner knows that everything is closed.
            let _ends = EndsAtDrop(present);
            let tell = tell;
            work(&options, &theirs, &told_to_begin, &tell);
        };
        std::thread::Builder::new().name(format!("usb-{name}")).spawn(thread).map_err(KinectError::NoThread)?;
        let (library, priority) = (Library::Freenect, Priority::Ordinary);
        let opened = Opened { library, serial: None, posture_failed: None, priority };
        let beat = (0, Instant::now());
        let mut kinect = Self { opened, shared, begin: Some(begin), reports, presence, beat, ended: false };
        // On an error the handle is dropped, which stops the thread or leaves it behind.
        kinect.opened =
            kinect.wait_for_opening(within, cancelled).map_err(|error| match (error, abandoned.hanging()) {
                // By a thread of this very program that hangs in it.
                (KinectError::Busy { .. }, threads @ 1..) => KinectError::StillHanging { threads },
                (error, _) => error,
            })?;
        Ok(kinect)
    }

    fn wait_for_opening(&mut self, within: Duration, cancelled: &dyn Fn() -> bool) -> Result<Opened, KinectError> {
        let until = Instant::now() + within;
        loop {
            match self.reports.recv_timeout(LOOK) {
                Ok(Report::Opened(opened)) => return Ok(opened),
                Ok(Report::Ended(Err(error))) => return Err(error),
                Ok(Report::Ended(Ok(_))) | Err(RecvTimeoutError::Disconnected) => {
                    return Err(KinectError::ThreadPanicked);
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
            let error = if cancelled() {
                KinectError::Cancelled
            } else if Instant::now() >= until {
                KinectError::OpenTimeout { within }
            } else {
                continue;
            };
            if matches!(error, KinectError::OpenTimeout { .. }) {
                // It has had its time: not a moment more is waited for it.
                self.leave_behind();
            }
            return Err(error);
        }
    }

    /// What was opened.
    pub fn opened(&self) -> &Opened {
        &self.opened
    }

    /// Starts the depth stream; the sink is called on the usb thread. A second call is without effect.
    pub fn start(&mut self, sink: FrameSink) {
        if let Some(begin) = self.begin.take() {
            *self.shared.sink.lock().unwrap_or_else(PoisonError::into_inner) = Some(sink);
            self.beat = (self.shared.beats.load(Ordering::Relaxed), Instant::now());
            // The thread waits for this one word; if it ended meanwhile, the next look tells.
            begin.send(()).unwrap_or(());
        }
    }

    /// Whether the stream is over, and why; `None` while it runs. Never waits. To be asked several times a second.
    pub fn look(&mut self) -> Option<Result<End, KinectError>> {
        match self.reports.try_recv() {
            Ok(Report::Ended(outcome)) => return Some(outcome),
            Ok(Report::Opened(_)) | Err(TryRecvError::Empty) => {}
            Err(TryRecvError::Disconnected) => return Some(Err(KinectError::ThreadPanicked)),
        }
        let beats = self.shared.beats.load(Ordering::Relaxed);
        if beats != self.beat.0 {
            self.beat = (beats, Instant::now());
        }
        // Until it is told to begin the thread makes no turns; the player sleeps for as long as its recording did.
        let watched = self.begin.is_none() && self.opened.library == Library::Freenect;
        if watched && self.beat.1.elapsed() >= HUNG_AFTER {
            self.leave_behind();
            return Some(Err(KinectError::Hung { after: HUNG_AFTER }));
        }
        None
    }

    /// Frames that the library has finished so far.
    pub fn frames(&self) -> u64 {
        self.shared.frames.load(Ordering::Relaxed)
    }

    /// The latest reading of the accelerometer, where [`Options::accelerometer`] asks for it.
    pub fn acceleration(&self) -> Option<Acceleration> {
        *self.shared.acceleration.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Stops the stream and closes the device. Returns within [`STOP_WITHIN`]; the sink is not called any more then.
    pub fn stop(mut self) -> Stopped {
        self.end()
    }

    fn end(&mut self) -> Stopped {
        if std::mem::replace(&mut self.ended, true) {
            return Stopped::LeftBehind;
        }
        self.shared.stop.store(true, Ordering::SeqCst);
        self.begin = None;
        let until = Instant::now() + STOP_WITHIN;
        loop {
            match self.reports.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(_) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    self.take_sink();
                    return Stopped::Closed;
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.ended = false;
                    self.leave_behind();
                    return Stopped::LeftBehind;
                }
            }
        }
    }

    /// Tells the thread to close and end, whenever it comes back, and waits for nothing.
    fn leave_behind(&mut self) {
        if !std::mem::replace(&mut self.ended, true) {
            self.shared.stop.store(true, Ordering::SeqCst);
            self.begin = None;
            self.presence.abandon();
            self.take_sink();
        }
    }

    /// Frees what the sink holds. A sink that is being called at this moment is freed by its own thread.
    fn take_sink(&self) {
        if let Ok(mut sink) = self.shared.sink.try_lock() {
            *sink = None;
        }
    }
}

impl Drop for Kinect {
    fn drop(&mut self) {
        self.end();
    }
}

impl core::fmt::Debug for Kinect {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Kinect").field("opened", &self.opened).field("frames", &self.frames()).finish_non_exhaustive()
    }
}

/// Takes the thread out of the count, even when it ends by a panic.
struct EndsAtDrop(Presence);

impl Drop for EndsAtDrop {
    fn drop(&mut self) {
        self.0.ended();
    }
}

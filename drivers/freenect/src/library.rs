//! The library's context and its device, each closed exactly once and in the right order.

use crate::callbacks::{Stream, StreamState, depth_packet, packed_frame, whole_frame};
use crate::error::KinectError;
use crate::said::{self, UsbCause};
use crate::symbols::Symbols;
use crate::worker::Shared;
use core::ffi::{CStr, c_int, c_void};
use core::ptr::{self, NonNull};
use core::time::Duration;
use freenect_sys as ffi;
use std::ffi::CString;
use std::sync::Arc;

/// Which library of the name is loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Library {
    /// libfreenect: devices, packet by packet.
    Freenect,
    /// fakenect: recorded frames, whole. They are over at some time, and its pace is its own.
    Fakenect,
}

/// What models without a serial number report.
const SERIAL_OF_ZEROS: &str = "0000000000000000";
/// More Kinects than this on one machine are not looked at: each needs a USB controller of its own.
const MOST_DEVICES: usize = 16;

/// A context of the library. Stays on the thread that made it.
pub(crate) struct Context {
    handle: NonNull<ffi::freenect_context>,
    symbols: Symbols,
}

impl Context {
    pub(crate) fn new(symbols: Symbols) -> Result<Self, KinectError> {
        said::begin();
        let mut handle = ptr::null_mut();
        // SAFETY: the place for the handle lives here; a null USB context lets the library make its own.
        let code = unsafe { ffi::freenect_init(&mut handle, ptr::null_mut()) };
        let handle = NonNull::new(handle).filter(|_| code >= 0).ok_or(KinectError::Library { code })?;
        // SAFETY: the context was just made; the callback has the header's type and may be called at any time.
        unsafe {
            ffi::freenect_set_log_level(handle.as_ptr(), ffi::freenect_loglevel_FREENECT_LOG_WARNING);
            ffi::freenect_set_log_callback(handle.as_ptr(), Some(said::log));
        }
        Ok(Self { handle, symbols })
    }

    /// Cameras on the USB.
    fn cameras(&self) -> usize {
        // SAFETY: the context lives.
        let count = unsafe { ffi::freenect_num_devices(self.handle.as_ptr()) };
        usize::try_from(count).unwrap_or(0)
    }

    /// The serial numbers of the cameras that this user may ask; the player has no such list.
    fn serials(&self) -> Vec<String> {
        let Some((list, free)) = self.symbols.attributes else { return Vec::new() };
        let mut first: *mut ffi::freenect_device_attributes = ptr::null_mut();
        // SAFETY: the context lives; the place for the list lives here.
        let count = unsafe { list(self.handle.as_ptr(), &mut first) };
        let mut serials = Vec::new();
        let mut next = first;
        while count > 0 && !next.is_null() && serials.len() < MOST_DEVICES {
            // SAFETY: not null, and an element of the list, which is freed only below.
            let attributes = unsafe { &*next };
            if !attributes.camera_serial.is_null() {
                // SAFETY: not null, and a C string that belongs to the list.
                let serial = unsafe { CStr::from_ptr(attributes.camera_serial) };
                serials.push(serial.to_string_lossy().into_owned());
            }
            next = attributes.next;
        }
        if !first.is_null() {
            // SAFETY: the list that the library made; nothing refers to it any more.
            unsafe { free(first) };
        }
        serials
    }

    /// Opens the Kinect of this number, or the only one; gives its number where it is known.
    pub(crate) fn open(&self, serial: Option<&str>, motor: bool) -> Result<(Device<'_>, Option<String>), KinectError> {
        if serial == Some(SERIAL_OF_ZEROS) {
            return Err(KinectError::SerialOfZeros);
        }
        let count = self.cameras();
        if count == 0 {
            return Err(KinectError::NoDevice);
        }
        let camera = ffi::freenect_device_flags_FREENECT_DEVICE_CAMERA;
        let subdevices = if motor { camera | ffi::freenect_device_flags_FREENECT_DEVICE_MOTOR } else { camera };
        // SAFETY: the context lives; the flags are the header's.
        unsafe { ffi::freenect_select_subdevices(self.handle.as_ptr(), subdevices) };
        let found = self.serials();
        let known = match serial {
            // The player has one device, by any number.
            Some(serial) if self.symbols.attributes.is_some() => {
                if !found.iter().any(|found| found == serial) {
                    return Err(self.why_not_found(serial, found));
                }
                Some(serial)
            }
            Some(_) => None,
            None if count > 1 => return Err(KinectError::Ambiguous { count, found }),
            None => None,
        };
        let device = self.open_device(known)?;
        Ok((device, known.map(str::to_owned).or_else(|| found.into_iter().next().filter(|_| count == 1))))
    }

    fn open_device(&self, serial: Option<&str>) -> Result<Device<'_>, KinectError> {
        said::begin();
        let mut handle = ptr::null_mut();
        let code = match serial.map(CString::new) {
            // SAFETY: the context lives, the place for the handle lives here, the text ends in a zero byte.
            Some(Ok(serial)) => unsafe {
                ffi::freenect_open_device_by_camera_serial(self.handle.as_ptr(), &mut handle, serial.as_ptr())
            },
            // A number with a zero byte in it was not found above.
            Some(Err(_)) => -1,
            // SAFETY: as above.
            None => unsafe { ffi::freenect_open_device(self.handle.as_ptr(), &mut handle, 0) },
        };
        let handle = NonNull::new(handle).filter(|_| code >= 0).ok_or_else(|| why_not_open(code))?;
        Ok(Device { handle, context: self, stream: None, running: false })
    }

    /// A camera that cannot be asked has no number in the library's list, and why it cannot shows only when it is opened.
    fn why_not_found(&self, serial: &str, found: Vec<String>) -> KinectError {
        if found.is_empty()
            && let Err(error) = self.open_device(None)
        {
            return error;
        }
        KinectError::NoSuchSerial { serial: serial.to_owned(), found }
    }

    /// Handles what the USB has to tell; waits for it at most this long.
    pub(crate) fn handle_events(&self, wait: Duration) -> Result<(), c_int> {
        let seconds = libc::time_t::try_from(wait.as_secs()).unwrap_or(1);
        let mut timeout = libc::timeval { tv_sec: seconds, tv_usec: wait.subsec_micros().into() };
        // SAFETY: the context lives, on the thread that made it; the callbacks it may call keep to their streams.
        let code = unsafe { ffi::freenect_process_events_timeout(self.handle.as_ptr(), &mut timeout) };
        if code < 0 { Err(code) } else { Ok(()) }
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: made once, shut down once; every device borrows the context, so all are closed.
        unsafe { ffi::freenect_shutdown(self.handle.as_ptr()) };
    }
}

fn why_not_open(code: c_int) -> KinectError {
    let said = said::since();
    match said.cause {
        Some(UsbCause::Access) => KinectError::NotPermitted,
        Some(UsbCause::Busy) => KinectError::Busy { said: said.line() },
        Some(UsbCause::NoDevice) => KinectError::Unplugged,
        None => KinectError::OpenFailed { code, said: said.line() },
    }
}

/// An open Kinect.
pub(crate) struct Device<'context> {
    handle: NonNull<ffi::freenect_device>,
    context: &'context Context,
    /// Made by `Box::into_raw`, owned by this device; the library has a copy as the user pointer until the device is closed.
    stream: Option<NonNull<Stream>>,
    running: bool,
}

impl Device<'_> {
    /// The library's handle: valid while the device lives.
    pub(crate) fn handle(&self) -> *mut ffi::freenect_device {
        self.handle.as_ptr()
    }

    /// Starts the depth stream for the first time. The transfers that the system refused, of 16.
    pub(crate) fn start(&mut self, shared: Arc<Shared>) -> Result<u32, KinectError> {
        let stream = NonNull::from(Box::leak(Box::new(Stream::new(shared))));
        self.stream = Some(stream);
        let handle = self.handle.as_ptr();
        let set_chunk = self.context.symbols.set_depth_chunk_callback;
        let (format, on_frame): (_, unsafe extern "C" fn(*mut ffi::freenect_device, *mut c_void, u32)) = match set_chunk
        {
            Some(_) => (ffi::freenect_depth_format_FREENECT_DEPTH_11BIT_PACKED, packed_frame),
            None => (ffi::freenect_depth_format_FREENECT_DEPTH_11BIT, whole_frame),
        };
        said::begin();
        // SAFETY: the device is open, on its thread; the callbacks have the header's types, and the user pointer lives until
        // after the device is closed. The player takes the format it is asked for here, and no other.
        let code = unsafe {
            ffi::freenect_set_user(handle, stream.as_ptr().cast());
            if let Some(set_chunk) = set_chunk {
                set_chunk(handle, Some(depth_packet));
            }
            ffi::freenect_set_depth_callback(handle, Some(on_frame));
            let mode = ffi::freenect_find_depth_mode(ffi::freenect_resolution_FREENECT_RESOLUTION_MEDIUM, format);
            ffi::freenect_set_depth_mode(handle, mode)
        };
        self.done("choosing the depth format", code)?;
        self.start_depth()
    }

    /// Stops the stream and starts it anew.
    pub(crate) fn restart(&mut self) -> Result<u32, KinectError> {
        self.stop_depth();
        if let Some(stream) = self.stream {
            // SAFETY: the stream lives while the device does; no call of the library is under way on this thread, so no
            // callback refers to it.
            unsafe { (*stream.as_ptr()).restart() };
        }
        self.start_depth()
    }

    /// Whether the stream goes on.
    pub(crate) fn state(&self) -> StreamState {
        // SAFETY: as in `restart`.
        self.stream.map_or(StreamState::Running, |stream| unsafe { (*stream.as_ptr()).state() })
    }

    fn start_depth(&mut self) -> Result<u32, KinectError> {
        said::begin();
        // SAFETY: the device is open, on its thread, with its callbacks set.
        let code = unsafe { ffi::freenect_start_depth(self.handle.as_ptr()) };
        self.running = code >= 0;
        self.done("starting the depth stream", code)?;
        Ok(said::since().refused)
    }

    fn stop_depth(&mut self) {
        if std::mem::take(&mut self.running) {
            // SAFETY: the device is open, on its thread. What it returns does not matter: a device that went away has
            // stopped by itself, and the library says so with an error.
            unsafe { ffi::freenect_stop_depth(self.handle.as_ptr()) };
        }
    }

    fn done(&self, step: &'static str, code: c_int) -> Result<(), KinectError> {
        if code >= 0 {
            return Ok(());
        }
        let said = said::since();
        Err(match said.cause {
            Some(UsbCause::NoDevice) => KinectError::Unplugged,
            _ => KinectError::Setup { step, code, said: said.line() },
        })
    }
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        self.stop_depth();
        // SAFETY: opened once, closed once, on its thread, its streams stopped before.
        unsafe { ffi::freenect_close_device(self.handle.as_ptr()) };
        if let Some(stream) = self.stream.take() {
            // SAFETY: from a box, and taken back once: the device is closed, so the library has no use for it any more.
            drop(unsafe { Box::from_raw(stream.as_ptr()) });
        }
    }
}

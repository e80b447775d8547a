//! What the library calls: copies, stamps, hands over, returns.
//!
//! All run on the usb thread, from within the library's event handling, one at a time. No panic leaves one: C has no way to
//! let it through.

use crate::assembly::Assembler;
use crate::frame::{Frame, UNPACKED_BYTES};
use crate::missing::MissingFrames;
use crate::worker::Shared;
use core::ffi::{c_int, c_void};
use core::slice;
use freenect_sys::{freenect_device, freenect_get_user};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use tumbled_model::{DepthEncoding, KinectTicks, PacketMask};

/// One running stream; the library's user pointer points at it.
pub(crate) struct Stream {
    assembler: Assembler,
    missing: MissingFrames,
    shared: Arc<Shared>,
    state: StreamState,
}

/// Whether a stream goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StreamState {
    Running,
    /// The sink wants no more.
    Over,
    /// The sink panicked.
    Panicked,
}

impl Stream {
    pub(crate) fn new(shared: Arc<Shared>) -> Self {
        let (assembler, missing) = (Assembler::new(), MissingFrames::default());
        Self { assembler, missing, shared, state: StreamState::Running }
    }

    pub(crate) fn state(&self) -> StreamState {
        self.state
    }

    /// The device was stopped and started: its stamps may begin anywhere, and half a frame belongs to nothing.
    pub(crate) fn restart(&mut self) {
        self.assembler = Assembler::new();
        self.missing.restart();
    }

    fn packed(&mut self, ticks: u32) {
        let ticks = KinectTicks(ticks);
        let Some((lost_packets, bytes)) = self.assembler.frame() else { return };
        let missing_before = self.missing.before(ticks);
        let frame = Frame { ticks, encoding: DepthEncoding::Packed11, lost_packets, missing_before, bytes };
        self.state = deliver(&self.shared, &frame);
    }

    fn whole(&mut self, ticks: u32, bytes: &[u8]) {
        // Recorded frames may have any stamps: nothing of them was lost on the way here.
        let (ticks, lost_packets) = (KinectTicks(ticks), PacketMask::NONE);
        let frame = Frame { ticks, encoding: DepthEncoding::Raw11, lost_packets, missing_before: 0, bytes };
        self.state = deliver(&self.shared, &frame);
    }
}

fn deliver(shared: &Shared, frame: &Frame<'_>) -> StreamState {
    shared.frames.fetch_add(1, Ordering::Relaxed);
    if shared.stop.load(Ordering::SeqCst) {
        return StreamState::Over;
    }
    let mut sink = shared.sink.lock().unwrap_or_else(PoisonError::into_inner);
    match sink.as_mut().map(|sink| sink(frame)) {
        Some(flow) if flow.is_continue() => StreamState::Running,
        _ => StreamState::Over,
    }
}

/// Lets `act` at the stream that a user pointer points at.
///
/// # Safety
/// `user` is null or points at a [`Stream`] that nothing else refers to during the call.
unsafe fn with_stream(user: *mut c_void, act: impl FnOnce(&mut Stream)) {
    // SAFETY: null gives `None`; otherwise it is a stream, and ours alone, as the caller promises.
    let Some(stream) = (unsafe { user.cast::<Stream>().as_mut() }) else { return };
    if stream.state != StreamState::Running {
        return;
    }
    if catch_unwind(AssertUnwindSafe(|| act(stream))).is_err() {
        stream.state = StreamState::Panicked;
    }
}

/// A packet of a depth frame.
///
/// # Safety
/// Called by the library for a device whose user pointer is a live [`Stream`]; `payload` holds `length` bytes.
pub(crate) unsafe extern "C" fn depth_packet(
    _buffer: *mut c_void,
    payload: *mut c_void,
    place: c_int,
    length: c_int,
    user: *mut c_void,
) {
    let (Ok(place), Ok(length)) = (usize::try_from(place), usize::try_from(length)) else { return };
    if payload.is_null() {
        return;
    }
    // SAFETY: not null, and the library says how many bytes of the packet it has; they stay until the call returns.
    let payload = unsafe { slice::from_raw_parts(payload.cast::<u8>(), length) };
    // SAFETY: the user pointer is the stream's, and the usb thread refers to it only outside of the library's calls.
    unsafe { with_stream(user, |stream| stream.assembler.packet(place, payload)) };
}

/// The end of a depth frame whose packets were handed over one by one.
///
/// # Safety
/// Called by the library for a device whose user pointer is a live [`Stream`].
pub(crate) unsafe extern "C" fn packed_frame(device: *mut freenect_device, _depth: *mut c_void, ticks: u32) {
    // SAFETY: the library hands over the open device it calls for.
    let user = unsafe { freenect_get_user(device) };
    // SAFETY: as in `depth_packet`.
    unsafe { with_stream(user, |stream| stream.packed(ticks)) };
}

/// A whole depth frame, 16 bits a pixel.
///
/// # Safety
/// As for [`packed_frame`]; `depth` holds [`UNPACKED_BYTES`].
pub(crate) unsafe extern "C" fn whole_frame(device: *mut freenect_device, depth: *mut c_void, ticks: u32) {
    if depth.is_null() {
        return;
    }
    // SAFETY: not null; the player's files were looked at before it was called, so that many bytes are there.
    let bytes = unsafe { slice::from_raw_parts(depth.cast::<u8>(), UNPACKED_BYTES) };
    // SAFETY: the library hands over the open device it calls for.
    let user = unsafe { freenect_get_user(device) };
    // SAFETY: as in `depth_packet`.
    unsafe { with_stream(user, |stream| stream.whole(ticks, bytes)) };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameSink;
    use std::ops::ControlFlow;

    fn stream(sink: FrameSink) -> Stream {
        let shared = Arc::new(Shared::default());
        *shared.sink.lock().expect("not poisoned") = Some(sink);
        Stream::new(shared)
    }

    /// A frame of one packet.
    fn one_frame(stream: &mut Stream, ticks: u32) {
        let user = std::ptr::from_mut(stream).cast::<c_void>();
        let mut payload = [5u8; 1_748];
        // SAFETY: the stream lives, and nothing else refers to it meanwhile.
        unsafe {
            depth_packet(std::ptr::null_mut(), payload.as_mut_ptr().cast(), 7, 1_748, user);
            with_stream(user, |stream| stream.packed(ticks));
        }
    }

    #[test]
    fn frames_come_with_their_losses_until_the_sink_has_enough() {
        let (told, frames) = std::sync::mpsc::sync_channel(8);
        let mut stream = stream(Box::new(move |frame| {
            told.send((frame.ticks, frame.lost_packets.count(), frame.missing_before)).expect("read");
            if frame.ticks.0 < 6_000_000 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        }));
        for ticks in [2_000_000, 8_000_000, 10_000_000] {
            one_frame(&mut stream, ticks);
        }
        assert_eq!(stream.state(), StreamState::Over);
        let told: Vec<_> = frames.try_iter().collect();
        // From 2 to 8 million ticks: frames at 4 and 6 million are missing.
        assert_eq!(told, [(KinectTicks(2_000_000), 241, 0), (KinectTicks(8_000_000), 241, 2)]);
    }

    #[test]
    fn a_sink_that_panics_ends_the_stream_and_not_the_program() {
        let mut stream = stream(Box::new(|_| panic!("on purpose")));
        one_frame(&mut stream, 1);
        assert_eq!(stream.state(), StreamState::Panicked);
        one_frame(&mut stream, 2);
    }

    #[test]
    fn nonsense_from_the_library_is_left_out() {
        let mut stream = stream(Box::new(|_| panic!("no frame")));
        let user = std::ptr::from_mut(&mut stream).cast::<c_void>();
        let mut payload = [0u8; 4];
        // SAFETY: null and negative numbers are allowed; the payload has its four bytes.
        unsafe {
            depth_packet(std::ptr::null_mut(), payload.as_mut_ptr().cast(), -1, 4, user);
            depth_packet(std::ptr::null_mut(), payload.as_mut_ptr().cast(), 3, -4, user);
            depth_packet(std::ptr::null_mut(), std::ptr::null_mut(), 3, 4, user);
            depth_packet(std::ptr::null_mut(), payload.as_mut_ptr().cast(), 3, 4, std::ptr::null_mut());
            whole_frame(std::ptr::null_mut(), std::ptr::null_mut(), 3);
            with_stream(user, |stream| stream.packed(1));
        }
        assert_eq!(stream.state(), StreamState::Running);
    }
}

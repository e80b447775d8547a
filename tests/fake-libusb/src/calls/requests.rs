//! Transfers that are waited for: control and bulk.

use std::ffi::{c_int, c_uchar, c_uint, c_void};
use std::thread;
use std::time::Duration;

use fake_libusb_control::Audio;

use super::events::{Hurry, handle, is_within};
use super::handles::context_of;
use super::{in_world, key, pointer};
use crate::abi::error;
use crate::kinect::{Kinect, Part};
use crate::motor::Done;
use crate::world::World;

/// How long a control transfer takes.
const ROUND_TRIP: Duration = Duration::from_micros(250);
/// How long a bulk transfer without a timeout waits for a reply that will not come.
const NO_REPLY: Duration = Duration::from_secs(1);

/// # Safety
/// As libusb's: `data` holds `length` bytes.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_control_transfer(
    handle: *mut c_void,
    kind: u8,
    request: u8,
    value: u16,
    _index: u16,
    data: *mut c_uchar,
    length: u16,
    _timeout: c_uint,
) -> c_int {
    let context = context_of(handle);
    if context.is_some_and(is_within) {
        return error::BUSY;
    }
    let result = in_world(|world| {
        let (kinect, part, chronicle) = world.behind(key(handle), "control transfer").ok_or(error::NO_DEVICE)?;
        match (part, kind, request) {
            (Part::Camera, 0x40, 0) => {
                // SAFETY: the caller's promise; without bytes the pointer may be anything.
                let bytes = if length == 0 { &[] } else { unsafe { std::slice::from_raw_parts(data, length.into()) } };
                kinect.request(bytes, chronicle).ok_or(error::PIPE)?;
                Ok(c_int::from(length))
            }
            (Part::Camera, 0xC0, 0) if kinect.is_mute => Ok(0),
            (Part::Camera, 0xC0, 0) => {
                // SAFETY: the caller's promise.
                Ok(unsafe { give(&kinect.camera.fetch(), data, length.into()) })
            }
            (Part::Motor, 0xC0, 0x32) => {
                // SAFETY: the caller's promise.
                Ok(unsafe { give(&kinect.motor.state(), data, length.into()) })
            }
            (Part::Motor, 0x40, _) => {
                let done = kinect.motor.control(request, value).ok_or(error::PIPE)?;
                let device = kinect.number;
                moved(world, device, done);
                Ok(c_int::from(length))
            }
            _ => Err(error::PIPE),
        }
    });
    if let Some(context) = context {
        // It takes its time, in which this thread handles other events. They do not change what became of the request.
        handle_meanwhile(context);
    }
    result
}

fn handle_meanwhile(context: usize) {
    let handled = handle(pointer(context), ROUND_TRIP, Hurry::Forbidden);
    if handled < 0 {
        thread::sleep(ROUND_TRIP);
    }
}

/// Copies a reply; how much of it there was room for.
///
/// # Safety
/// `data` holds `length` bytes.
unsafe fn give(reply: &[u8], data: *mut c_uchar, length: usize) -> c_int {
    let given = reply.len().min(length);
    // SAFETY: both hold at least `given` bytes.
    unsafe { std::ptr::copy_nonoverlapping(reply.as_ptr(), data, given) };
    c_int::try_from(given).unwrap_or(c_int::MAX)
}

/// Writes down what the motor was told.
fn moved(world: &mut World, device: usize, done: Done) {
    match done {
        Done::Read => {}
        Done::Tilt(half_degrees) => world.journal("tilt", format_args!("device={device} half_degrees={half_degrees}")),
        Done::Led(led) => world.journal("led", format_args!("device={device} led={led}")),
    }
}

/// # Safety
/// As libusb's: `data` holds `length` bytes, `transferred` is null or may be written to.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_bulk_transfer(
    handle: *mut c_void,
    endpoint: c_uchar,
    data: *mut c_uchar,
    length: c_int,
    transferred: *mut c_int,
    timeout: c_uint,
) -> c_int {
    let context = context_of(handle);
    if context.is_some_and(is_within) {
        return error::BUSY;
    }
    let room = usize::try_from(length).unwrap_or(0);
    let mut count = 0;
    let result = in_world(|world| {
        let (kinect, part, _) = world.behind(key(handle), "bulk transfer").ok_or(error::NO_DEVICE)?;
        if part != Part::Audio || kinect.device.audio != Audio::Ready {
            return Err(error::PIPE);
        }
        if endpoint & 0x80 == 0 {
            // SAFETY: the caller's promise; without bytes the pointer may be anything.
            let bytes = if room == 0 { &[] } else { unsafe { std::slice::from_raw_parts(data, room) } };
            let (device, done) = told(kinect, bytes)?;
            moved(world, device, done);
            count = length;
        } else {
            let reply = kinect.motor.fetch().ok_or(error::TIMEOUT)?;
            // SAFETY: the caller's promise.
            count = unsafe { give(&reply, data, room) };
        }
        Ok(0)
    });
    if result == error::TIMEOUT {
        thread::sleep(if timeout == 0 { NO_REPLY } else { Duration::from_millis(timeout.into()) });
    }
    if let Some(context) = context {
        handle_meanwhile(context);
    }
    if !transferred.is_null() {
        // SAFETY: the caller's promise.
        unsafe { *transferred = count };
    }
    result
}

fn told(kinect: &mut Kinect, bytes: &[u8]) -> Result<(usize, Done), c_int> {
    let done = kinect.motor.message(bytes).ok_or(error::PIPE)?;
    Ok((kinect.number, done))
}

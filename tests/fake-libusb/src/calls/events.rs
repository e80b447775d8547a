//! Waiting for transfers, and calling back.

use std::ffi::{c_int, c_void};
use std::sync::PoisonError;
use std::thread;
use std::time::{Duration, Instant};

use super::{guarded, key};
use crate::abi::{FREE_BUFFER, FREE_TRANSFER, Transfer, error};
use crate::world::{CHANGED, World, lock, wake};

/// How long libusb waits where it is not told.
const DEFAULT: Duration = Duration::from_secs(60);
/// The longest timeout: what is longer is no different to any program.
const LONGEST: Duration = Duration::from_secs(86_400);

/// Handles events, for a minute if there are none.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_handle_events(context: *mut c_void) -> c_int {
    handle(context, DEFAULT, Hurry::Allowed)
}

/// # Safety
/// As libusb's: `timeout` may be read.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_handle_events_timeout(
    context: *mut c_void,
    timeout: *const libc::timeval,
) -> c_int {
    if timeout.is_null() {
        return error::INVALID_PARAM;
    }
    // SAFETY: the caller's promise.
    let (seconds, micros) = unsafe { ((*timeout).tv_sec, (*timeout).tv_usec) };
    let (Ok(seconds), Ok(micros)) = (u64::try_from(seconds), u64::try_from(micros)) else {
        return error::INVALID_PARAM;
    };
    if micros >= 1_000_000 {
        return error::INVALID_PARAM;
    }
    let timeout = Duration::from_secs(seconds).saturating_add(Duration::from_micros(micros)).min(LONGEST);
    handle(context, timeout, Hurry::Allowed)
}

/// Whether the fast pace may run ahead to have an event to handle.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Hurry {
    Allowed,
    Forbidden,
}

/// Calls back for every transfer that is complete, waiting for the first as long as `timeout`.
///
/// One thread handles a context's events at a time; others wait until it has handled some, as in libusb.
pub(super) fn handle(context: *mut c_void, timeout: Duration, hurry: Hurry) -> c_int {
    let waited = guarded(Err(error::OTHER), || wait(key(context), timeout, hurry));
    let (context, count) = match waited {
        Ok(Some(found)) => found,
        Ok(None) => return 0,
        Err(error) => return error,
    };
    for _ in 0..count {
        let Some(transfer) = guarded(None, || take(context)) else { break };
        call_back(transfer);
    }
    guarded((), || {
        if let Some(world) = lock().as_mut()
            && let Some(context) = world.contexts.get_mut(&context)
        {
            context.handling = None;
        }
        wake();
    });
    0
}

/// Whether this thread is within a callback of a context.
pub(super) fn is_within(context: usize) -> bool {
    guarded(false, || {
        let guard = lock();
        let context = guard.as_ref().and_then(|world| world.contexts.get(&context));
        context.is_some_and(|context| context.handling == Some(thread::current().id()))
    })
}

/// Waits for complete transfers: the context, now handled by this thread, and how many there are; `None` after the
/// timeout, or when another thread handled events meanwhile.
fn wait(context: usize, timeout: Duration, hurry: Hurry) -> Result<Option<(usize, usize)>, c_int> {
    let until = Instant::now() + timeout;
    let me = thread::current().id();
    let mut guard = lock();
    let key = guard.as_ref().and_then(|world| world.context(context)).ok_or(error::INVALID_PARAM)?;
    let mut stood_back = false;
    loop {
        let Some(world) = guard.as_mut() else { return Err(error::OTHER) };
        let handling = world.contexts.get(&key).ok_or(error::INVALID_PARAM)?.handling;
        let mut sleep = until.saturating_duration_since(Instant::now());
        match handling {
            // Events cannot be handled within a callback of theirs.
            Some(thread) if thread == me => return Err(error::BUSY),
            Some(_) => stood_back = true,
            None if stood_back => return Ok(None),
            None => {
                world.advance();
                let count = complete(world, key);
                if count > 0 {
                    if let Some(context) = world.contexts.get_mut(&key) {
                        context.handling = Some(me);
                    }
                    return Ok(Some((key, count)));
                }
                if hurry == Hurry::Allowed && hurry_all(world, key) {
                    continue;
                }
                let next = world.kinects.iter_mut().filter_map(|kinect| kinect.next_event(key)).min();
                sleep = next.map_or(sleep, |next| next.min(sleep));
            }
        }
        if Instant::now() >= until {
            return Ok(None);
        }
        guard = CHANGED.wait_timeout(guard, sleep).unwrap_or_else(PoisonError::into_inner).0;
    }
}

/// At the fast pace: every device sends on to the end of a transfer; whether one had something to send.
fn hurry_all(world: &mut World, context: usize) -> bool {
    world.kinects.iter_mut().fold(false, |hurried, kinect| kinect.hurry(context) | hurried)
}

fn complete(world: &World, context: usize) -> usize {
    world.kinects.iter().map(|kinect| kinect.waiting(context)).sum()
}

/// Takes the next complete transfer; from here on it is its owner's again.
fn take(context: usize) -> Option<*mut Transfer> {
    let mut guard = lock();
    let world = guard.as_mut()?;
    let address = world.kinects.iter_mut().find_map(|kinect| kinect.take(context))?;
    world.transfers.get_mut(&address)?.place = None;
    Some(std::ptr::with_exposed_provenance_mut(address))
}

/// Without the lock: callbacks submit, cancel and free.
fn call_back(transfer: *mut Transfer) {
    // SAFETY: it was allocated here and not freed, which would have taken it from the complete ones.
    let (flags, buffer, callback) = unsafe { ((*transfer).flags, (*transfer).buffer, (*transfer).callback) };
    if let Some(callback) = callback {
        callback(transfer);
    }
    if flags & FREE_BUFFER != 0 {
        // SAFETY: the flag says that the buffer came from malloc and is not used any more.
        unsafe { libc::free(buffer.cast()) };
    }
    if flags & FREE_TRANSFER != 0 {
        // SAFETY: the flag says that the transfer is not used any more.
        unsafe { super::transfers::libusb_free_transfer(transfer) };
    }
}

//! libusb's functions, as far as libfreenect uses them: thirty.
//!
//! Each runs under [`guarded`]: no panic reaches the C code that called.

mod buses;
mod events;
mod handles;
mod requests;
mod transfers;

use std::ffi::{c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::abi::error;
use crate::world::{World, lock};

/// Runs a function's body; `fallback` is what the caller gets if it panics (the panic itself is told on stderr).
fn guarded<T>(fallback: T, body: impl FnOnce() -> T) -> T {
    catch_unwind(AssertUnwindSafe(body)).unwrap_or(fallback)
}

/// Runs the body of a function that gives an error's number under the lock, with every bus in the present.
fn in_world(body: impl FnOnce(&mut World) -> Result<c_int, c_int>) -> c_int {
    guarded(error::OTHER, || {
        let mut guard = lock();
        let Some(world) = guard.as_mut() else { return error::OTHER };
        world.advance();
        body(world).unwrap_or_else(|error| error)
    })
}

/// The number behind an opaque pointer.
fn key(pointer: *const c_void) -> usize {
    pointer.addr()
}

/// An opaque pointer for a number.
fn pointer(key: usize) -> *mut c_void {
    std::ptr::without_provenance_mut(key)
}

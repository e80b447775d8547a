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

#[cfg(test)]
mod tests {
    use std::ptr::null_mut;

    use super::*;
    use crate::abi::DeviceDescriptor;

    #[test]
    fn a_pointer_that_was_not_given_out_is_an_error_and_never_followed() {
        // Without a script the bus is empty.
        let (mut context, mut list) = (null_mut(), null_mut());
        // SAFETY: what is written to is here.
        unsafe {
            assert_eq!(buses::libusb_init(&raw mut context), 0);
            assert_eq!(buses::libusb_get_device_list(context, &raw mut list), 0);
            buses::libusb_free_device_list(list, 1);
        }
        for stale in [null_mut(), pointer(0x10), pointer(usize::MAX)] {
            let (mut handle, mut descriptor) = (null_mut(), std::mem::MaybeUninit::<DeviceDescriptor>::uninit());
            // SAFETY: what is written to is here; of the others nothing is believed.
            unsafe {
                assert_eq!(handles::libusb_open(stale, &raw mut handle), error::INVALID_PARAM);
                let described = buses::libusb_get_device_descriptor(stale, descriptor.as_mut_ptr());
                assert_eq!(described, error::INVALID_PARAM);
                assert_eq!(transfers::libusb_submit_transfer(stale.cast()), error::INVALID_PARAM);
                assert_eq!(transfers::libusb_cancel_transfer(stale.cast()), error::NOT_FOUND);
                transfers::libusb_free_transfer(stale.cast());
                let asked = requests::libusb_control_transfer(stale, 0xC0, 0, 0, 0, null_mut(), 0, 0);
                assert_eq!(asked, error::NO_DEVICE);
            }
            assert_eq!(handles::libusb_claim_interface(stale, 0), error::NO_DEVICE);
            assert_eq!(handles::libusb_release_interface(stale, 0), error::NO_DEVICE);
            handles::libusb_close(stale);
            assert!(buses::libusb_get_parent(stale).is_null());
            assert!(buses::libusb_get_device(stale).is_null());
        }
        let timeout = libc::timeval { tv_sec: 0, tv_usec: 1_000 };
        // SAFETY: the timeout is here.
        let handled = unsafe { events::libusb_handle_events_timeout(context, &raw const timeout) };
        assert_eq!(handled, 0);
        assert!(transfers::libusb_alloc_transfer(-1).is_null());
        assert!(transfers::libusb_alloc_transfer(c_int::MAX).is_null());
        buses::libusb_exit(context);
        // SAFETY: the timeout is here.
        let handled = unsafe { events::libusb_handle_events_timeout(context, &raw const timeout) };
        assert_eq!(handled, error::INVALID_PARAM, "the context has gone");
    }

    #[test]
    fn a_panic_does_not_leave() {
        assert_eq!(guarded(error::OTHER, || panic!("a mistake in the stand-in")), error::OTHER);
    }
}

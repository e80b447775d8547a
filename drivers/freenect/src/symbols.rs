//! What the loaded library has, besides what every library of this name has.
//!
//! Looked up when the program runs: a program that refers to a function which the loaded library lacks does not start.

use core::ffi::{CStr, c_int, c_void};
use freenect_sys::{freenect_chunk_cb, freenect_context, freenect_device, freenect_device_attributes};

pub(crate) type SetChunkCallback = unsafe extern "C" fn(*mut freenect_device, freenect_chunk_cb);
pub(crate) type ListAttributes =
    unsafe extern "C" fn(*mut freenect_context, *mut *mut freenect_device_attributes) -> c_int;
pub(crate) type FreeAttributes = unsafe extern "C" fn(*mut freenect_device_attributes);

/// The optional functions; `None` where the library has none.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Symbols {
    /// Every packet as it comes. The player of recorded frames lacks it.
    pub(crate) set_depth_chunk_callback: Option<SetChunkCallback>,
    /// The serial numbers, and the way to free their list.
    pub(crate) attributes: Option<(ListAttributes, FreeAttributes)>,
}

impl Symbols {
    /// Asks the dynamic linker.
    pub(crate) fn look_up() -> Self {
        let set_chunk = address(c"freenect_set_depth_chunk_callback");
        let list = address(c"freenect_list_device_attributes");
        let free = address(c"freenect_free_device_attributes");
        // SAFETY: a function of this name in a library that calls itself libfreenect has the signature of its header, which
        // is the one of the type; an address that is not null is that function's.
        let (set_depth_chunk_callback, list, free) = unsafe {
            (
                set_chunk.map(|address| std::mem::transmute::<*mut c_void, SetChunkCallback>(address)),
                list.map(|address| std::mem::transmute::<*mut c_void, ListAttributes>(address)),
                free.map(|address| std::mem::transmute::<*mut c_void, FreeAttributes>(address)),
            )
        };
        Self { set_depth_chunk_callback, attributes: list.zip(free) }
    }
}

fn address(name: &CStr) -> Option<*mut c_void> {
    // SAFETY: the name ends in a zero byte; the call reads it and returns an address or null.
    let address = unsafe { libc::dlsym(libc::RTLD_DEFAULT, name.as_ptr()) };
    (!address.is_null()).then_some(address)
}

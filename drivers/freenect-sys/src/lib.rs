//! libfreenect's C interface, generated from the system's header by `build.rs`.
//!
//! Empty without the feature `usb`, so that a build without it needs no library, no header and no libclang. Functions that
//! not every library of this name has are left out on purpose (see `build.rs`); `tumbled-freenect` looks them up when the
//! program runs, and is the one to use.
#![allow(
    unsafe_code,
    missing_docs,
    non_camel_case_types,
    non_upper_case_globals,
    clippy::all,
    reason = "generated from a C header"
)]

#[cfg(feature = "usb")]
mod bindings {
    use libc::timeval;

    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

#[cfg(feature = "usb")]
pub use bindings::*;

/// The bindings' own layout checks run when they are compiled; here stands what this project relies on besides.
#[cfg(all(test, feature = "usb"))]
mod tests {
    use super::*;

    #[test]
    fn structures_that_cross_the_border_have_the_headers_sizes() {
        // u32 reserved, u32 resolution, u32 format, i32 bytes; i16 × 2 (width, height); i8 × 4: 16 + 4 + 4.
        assert_eq!(size_of::<freenect_frame_mode>(), 24);
        // i16 × 3, i8, a byte of padding, u32: what a player's recorded accelerometer file holds.
        assert_eq!(size_of::<freenect_raw_tilt_state>(), 12);
    }
}

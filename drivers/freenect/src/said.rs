//! What the library logs.
//!
//! It returns -1 for nearly everything and tells the cause in its log alone. It logs on the thread that called it, so each usb
//! thread keeps what was said on it.

use core::ffi::{CStr, c_char};
use freenect_sys::{freenect_context, freenect_loglevel};
use std::cell::RefCell;

/// The longest line that is kept, bytes.
const LINE_BYTES: usize = 160;

thread_local! {
    static SAID: RefCell<Said> = const { RefCell::new(Said::NOTHING) };
}

/// What the library said on this thread since the last [`begin`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Said {
    /// The first error or warning: what follows is mostly its consequence.
    first: [u8; LINE_BYTES],
    length: usize,
    /// The first cause that libusb named.
    pub(crate) cause: Option<UsbCause>,
    /// Isochronous transfers that the system did not take.
    pub(crate) refused: u32,
    /// The device went away.
    pub(crate) disappeared: bool,
}

/// Why libusb refused something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UsbCause {
    /// `LIBUSB_ERROR_ACCESS`.
    Access,
    /// `LIBUSB_ERROR_NO_DEVICE`.
    NoDevice,
    /// `LIBUSB_ERROR_BUSY`, and `LIBUSB_ERROR_NOT_FOUND`, which is what a claim gives when a kernel driver is in the way.
    Busy,
}

impl UsbCause {
    /// By the name or the number that libusb gives it.
    fn of(line: &[u8]) -> Option<Self> {
        let tells = |name: &[u8], number: &[u8]| contains(line, name) || line.ends_with(number);
        if tells(b"LIBUSB_ERROR_ACCESS", b": -3") {
            Some(Self::Access)
        } else if tells(b"LIBUSB_ERROR_NO_DEVICE", b": -4") {
            Some(Self::NoDevice)
        } else if tells(b"LIBUSB_ERROR_BUSY", b": -6") || tells(b"LIBUSB_ERROR_NOT_FOUND", b": -5") {
            Some(Self::Busy)
        } else {
            None
        }
    }
}

impl Said {
    const NOTHING: Self = Self { first: [0; LINE_BYTES], length: 0, cause: None, refused: 0, disappeared: false };

    fn note(&mut self, line: &[u8]) {
        let line = line.trim_ascii_end();
        if contains(line, b"Failed to submit isochronous transfer") {
            self.refused = self.refused.saturating_add(1);
        }
        self.disappeared |=
            [&b"disappeared"[..], b"disconnected", b"marked dead"].iter().any(|sign| contains(line, sign));
        self.cause = self.cause.or_else(|| UsbCause::of(line));
        if self.length == 0 {
            let length = line.len().min(LINE_BYTES);
            if let (Some(room), Some(kept)) = (self.first.get_mut(..length), line.get(..length)) {
                room.copy_from_slice(kept);
                self.length = length;
            }
        }
    }

    /// The first line, or that there was none.
    pub(crate) fn line(&self) -> String {
        match self.first.get(..self.length) {
            Some(line) if !line.is_empty() => String::from_utf8_lossy(line).into_owned(),
            _ => "it gave no reason".to_owned(),
        }
    }
}

/// Forgets what was said: a new step begins.
pub(crate) fn begin() {
    SAID.with_borrow_mut(|said| *said = Said::NOTHING);
}

/// What was said since.
pub(crate) fn since() -> Said {
    SAID.with_borrow(|said| *said)
}

fn contains(line: &[u8], sign: &[u8]) -> bool {
    line.windows(sign.len()).any(|window| window == sign)
}

/// The library's log callback.
///
/// # Safety
/// `message` is null or ends in a zero byte.
pub(crate) unsafe extern "C" fn log(
    _context: *mut freenect_context,
    _level: freenect_loglevel,
    message: *const c_char,
) {
    if message.is_null() {
        return;
    }
    // SAFETY: not null, and it ends in a zero byte, as the caller promises.
    let message = unsafe { CStr::from_ptr(message) };
    // A thread that is ending has no such place any more, and the library may log on while it is closed.
    let noted = SAID.try_with(|said| {
        if let Ok(mut said) = said.try_borrow_mut() {
            said.note(message.to_bytes());
        }
    });
    noted.unwrap_or(());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(lines: &[&CStr]) -> Said {
        begin();
        for line in lines {
            // SAFETY: a C string; the context is not looked at.
            unsafe { log(std::ptr::null_mut(), 1, line.as_ptr()) };
        }
        since()
    }

    #[test]
    fn the_cause_is_what_libusb_named_first() {
        let told = said(&[c"Could not open camera: -3\n", c"Failed to open camera subdevice or it is not disabled."]);
        assert_eq!((told.cause, told.line().as_str()), (Some(UsbCause::Access), "Could not open camera: -3"));
        let told = said(&[
            c"Failed to claim camera interface: LIBUSB_ERROR_BUSY\n",
            c"send_cmd: Output control transfer failed (-4)",
        ]);
        assert_eq!(told.cause, Some(UsbCause::Busy));
        assert_eq!(said(&[c"Could not open camera: -36\n"]).cause, None);
        assert_eq!(said(&[]).line(), "it gave no reason");
    }

    #[test]
    fn refused_transfers_are_counted_and_a_device_that_left_is_noticed() {
        let refusal = c"Failed to submit isochronous transfer 3: -1\n";
        assert_eq!(said(&[refusal; 16]).refused, 16);
        assert!(said(&[c"USB device disappeared, cancelling stream 70 :(\n"]).disappeared);
        assert!(!said(&[refusal]).disappeared);
    }

    #[test]
    fn a_long_line_is_cut_and_none_is_no_line() {
        let long = std::ffi::CString::new(vec![b'x'; 10_000]).expect("no zero");
        assert_eq!(said(&[&long]).line().len(), 160);
        // SAFETY: null is allowed.
        unsafe { log(std::ptr::null_mut(), 1, std::ptr::null()) };
    }
}

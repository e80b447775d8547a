//! The last remedy for a device that is there and does not work.

use std::fs::OpenOptions;
use std::io;
use std::os::fd::AsRawFd;
use std::path::Path;

/// `_IO('U', 20)` of `linux/usbdevice_fs.h`: no direction, no argument.
const USBDEVFS_RESET: libc::c_ulong = (b'U' as libc::c_ulong) << 8 | 20;

/// Resets a USB device by its device file (`/dev/bus/usb/001/004`), as if it had been plugged in anew: whoever has it open
/// loses it.
///
/// # Errors
/// What the system says: no such device, no permission, or that the file is no USB device (`ENOTTY`).
pub fn reset(device: &Path) -> io::Result<()> {
    let file = OpenOptions::new().write(true).open(device)?;
    // SAFETY: the descriptor is open for the call, and this request takes no argument, so the kernel touches no memory.
    let code = unsafe { libc::ioctl(file.as_raw_fd(), USBDEVFS_RESET) };
    if code < 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_usb_device_is_refused() {
        // 0x5514: usbdevice_fs.h's value.
        assert_eq!(USBDEVFS_RESET, 0x5514);
        assert_eq!(reset(Path::new("/dev/null")).expect_err("no USB device").raw_os_error(), Some(libc::ENOTTY));
        assert_eq!(reset(Path::new("/dev/bus/usb/999/999")).expect_err("none").kind(), io::ErrorKind::NotFound);
    }
}

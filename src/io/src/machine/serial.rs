//! Serial ports, by their device files and their stable names.

use nix::unistd::{AccessFlags, access};
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

/// Device names of serial adapters: USB converters and microcontrollers with USB of their own.
const ADAPTERS: [&str; 2] = ["ttyUSB", "ttyACM"];

/// A serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialPort {
    /// The device file, e.g. `/dev/ttyUSB0`: its number depends on the order of plugging in.
    pub device: PathBuf,
    /// Names that stay the same wherever it is plugged in, e.g. `/dev/serial/by-id/usb-FTDI_…`.
    pub stable: Vec<PathBuf>,
}

/// The serial adapters plugged in, by device name.
pub fn serial_ports(root: &Path) -> Vec<SerialPort> {
    let mut ports: BTreeMap<PathBuf, Vec<PathBuf>> = BTreeMap::new();
    for name in names(&root.join("dev")) {
        if ADAPTERS.iter().any(|adapter| name.starts_with(adapter)) {
            ports.insert(Path::new("/dev").join(name), Vec::new());
        }
    }
    let by_id = Path::new("/dev/serial/by-id");
    for name in names(&root.join("dev/serial/by-id")) {
        // A link such as ../../ttyUSB0: only its last word counts, wherever the root is.
        let target = fs::read_link(root.join("dev/serial/by-id").join(&name)).unwrap_or_default();
        if let Some(device) = target.file_name() {
            ports.entry(Path::new("/dev").join(device)).or_default().push(by_id.join(name));
        }
    }
    ports.into_iter().map(|(device, stable)| SerialPort { device, stable }).collect()
}

/// The names in a folder, sorted; of a folder that is not there, none.
pub(super) fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    names
}

/// Whether this program may use a serial port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SerialAccess {
    /// It may.
    Usable,
    /// Nothing has this name.
    Absent,
    /// Something else has: a file, a folder.
    NoDevice,
    /// It is a device, and not for this user.
    Forbidden,
}

/// Looks whether a serial port could be used, without opening it: opening resets many a microcontroller.
pub fn serial_access(port: &Path) -> SerialAccess {
    match fs::metadata(port) {
        Err(_) => SerialAccess::Absent,
        Ok(metadata) if !metadata.file_type().is_char_device() => SerialAccess::NoDevice,
        Ok(_) if access(port, AccessFlags::R_OK | AccessFlags::W_OK).is_err() => SerialAccess::Forbidden,
        Ok(_) => SerialAccess::Usable,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn adapters_are_listed_with_their_stable_names() {
        let root = tempfile::tempdir().expect("a folder");
        let dev = root.path().join("dev");
        fs::create_dir_all(dev.join("serial/by-id")).expect("folders");
        for name in ["ttyUSB1", "ttyUSB0", "ttyACM0", "ttyS0", "tty1", "video0"] {
            fs::write(dev.join(name), "").expect("a file");
        }
        symlink("../../ttyUSB0", dev.join("serial/by-id/usb-FTDI_A1-if00-port0")).expect("a link");
        // Unplugged a moment ago: the link is there, the device is not any more. It is told all the same.
        symlink("../../ttyACM9", dev.join("serial/by-id/usb-Arduino-if00")).expect("a link");
        let port = |device: &str, stable: &[&str]| SerialPort {
            device: device.into(),
            stable: stable.iter().map(Into::into).collect(),
        };
        let expected = [
            port("/dev/ttyACM0", &[]),
            port("/dev/ttyACM9", &["/dev/serial/by-id/usb-Arduino-if00"]),
            port("/dev/ttyUSB0", &["/dev/serial/by-id/usb-FTDI_A1-if00-port0"]),
            port("/dev/ttyUSB1", &[]),
        ];
        assert_eq!(serial_ports(root.path()), expected);
        assert_eq!(serial_ports(&root.path().join("nowhere")), []);
    }

    #[test]
    fn a_port_is_judged_without_opening_it() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(serial_access(&folder.path().join("ttyUSB0")), SerialAccess::Absent);
        assert_eq!(serial_access(folder.path()), SerialAccess::NoDevice);
        // The one character device that every machine lets everybody use.
        assert_eq!(serial_access(Path::new("/dev/null")), SerialAccess::Usable);
    }
}

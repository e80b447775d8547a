//! What the system knows of a serial port's line: whose USB adapter it is, who has it open, how long it holds bytes back.

use super::serial::names;
use std::fs;
use std::path::{Path, PathBuf};
use tumbled_model::Span;

/// A port's directory in `/sys`, below which its adapter's attributes lie.
fn sys_device(root: &Path, port: &Path) -> Option<PathBuf> {
    // Links such as /dev/serial/by-id/… are resolved below the root too.
    let below = root.join(port.strip_prefix("/").unwrap_or(port));
    let device = fs::canonicalize(&below).unwrap_or(below);
    let name = device.file_name()?;
    Some(root.join("sys/class/tty").join(name).join("device"))
}

/// The USB serial number of a port's adapter; `None`: it has none.
pub fn usb_serial(root: &Path, port: &Path) -> Option<String> {
    // From the port's interface up to the USB device, which is the first that has a serial number.
    let device = fs::canonicalize(sys_device(root, port)?).ok()?;
    let mut folders = device.ancestors().take_while(|folder| *folder != root);
    let number = folders.find_map(|folder| fs::read_to_string(folder.join("serial")).ok())?;
    Some(number.trim_end().to_owned()).filter(|number| !number.is_empty())
}

/// The ports whose adapter has this USB serial number, by device name; of an adapter with several ports, all.
pub fn serial_by_usb(root: &Path, serial: &str) -> Vec<PathBuf> {
    let ports = names(&root.join("sys/class/tty")).into_iter().map(|name| Path::new("/dev").join(name));
    ports.filter(|port| usb_serial(root, port).is_some_and(|number| number == serial)).collect()
}

/// How long a USB adapter holds bytes back before it hands them over, ms; `None`: it is none that does, or does not say.
pub fn latency_timer_ms(root: &Path, port: &Path) -> Option<u32> {
    let timer = sys_device(root, port)?.join("latency_timer");
    fs::read_to_string(timer).ok()?.trim_end().parse().ok()
}

/// Asks the adapter's driver to hand over what it has every millisecond. Where the driver has no such setting, or the user
/// not the right to, it stays as it is.
pub fn shorten_latency(root: &Path, port: &Path) {
    if latency_timer_ms(root, port).is_some_and(|ms| ms > 1)
        && let Some(device) = sys_device(root, port)
    {
        // Who may not is told by the value that stays.
        fs::write(device.join("latency_timer"), "1").unwrap_or(());
    }
}

/// How long a byte of 8 bits without parity is on the port's line at least. 0 where a rate is only a number: on pseudo
/// terminals, and on devices with a USB of their own (`ttyACM…`), which take bytes as fast as the bus does.
pub fn byte_time(port: &Path, baud: u32) -> Span {
    let device = fs::canonicalize(port).unwrap_or_else(|_gone| port.to_owned());
    let name = device.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let has_line = name.starts_with("ttyUSB") || name.starts_with("ttyS") || name.starts_with("ttyAMA");
    if has_line { tumbled_serial::zaber::byte_time(baud) } else { Span(0) }
}

/// A program that has a port open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialHolder {
    /// Its process id.
    pub pid: u32,
    /// Its name.
    pub name: String,
}

/// Who has a port open, this program left out; of other users' programs only an administrator learns.
pub fn serial_holders(root: &Path, port: &Path) -> Vec<SerialHolder> {
    let below = root.join(port.strip_prefix("/").unwrap_or(port));
    let Ok(device) = fs::canonicalize(below) else { return Vec::new() };
    let processes = root.join("proc");
    let pids = names(&processes).into_iter().filter_map(|name| name.parse::<u32>().ok());
    let has_it = |pid: &u32| {
        let open = fs::read_dir(processes.join(pid.to_string()).join("fd")).into_iter().flatten().flatten();
        open.map(|entry| fs::read_link(entry.path())).any(|link| link.is_ok_and(|link| link == device))
    };
    let holder = |pid: u32| {
        let name = fs::read_to_string(processes.join(pid.to_string()).join("comm")).unwrap_or_default();
        SerialHolder { pid, name: name.trim_end().to_owned() }
    };
    pids.filter(|pid| *pid != std::process::id()).filter(has_it).map(holder).collect()
}

/// Holders as they follow `in use`: ` by minicom (4711)`; nothing where nobody is known.
pub fn in_use_by(holders: &[SerialHolder]) -> String {
    let named: Vec<String> = holders.iter().map(|SerialHolder { pid, name }| format!("{name} ({pid})")).collect();
    if named.is_empty() { String::new() } else { format!(" by {}", named.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// A made-up `/` with an FTDI adapter on ttyUSB0.
    fn machine() -> tempfile::TempDir {
        let root = tempfile::tempdir().expect("a folder");
        let usb = root.path().join("sys/devices/usb1/1-2");
        let port = usb.join("1-2:1.0/ttyUSB0");
        fs::create_dir_all(&port).expect("folders");
        fs::write(usb.join("serial"), "A50285BI\n").expect("an attribute");
        fs::write(port.join("latency_timer"), "16\n").expect("an attribute");
        let class = root.path().join("sys/class/tty/ttyUSB0");
        fs::create_dir_all(&class).expect("folders");
        symlink(&port, class.join("device")).expect("a link");
        fs::create_dir_all(root.path().join("sys/class/tty/tty1")).expect("a console");
        fs::create_dir_all(root.path().join("dev/rig")).expect("folders");
        fs::write(root.path().join("dev/ttyUSB0"), "").expect("a device");
        symlink("../ttyUSB0", root.path().join("dev/rig/turntable")).expect("a link");
        root
    }

    #[test]
    fn a_port_is_found_by_its_adapters_number_wherever_it_is_plugged_in() {
        let root = machine();
        assert_eq!(serial_by_usb(root.path(), "A50285BI"), [PathBuf::from("/dev/ttyUSB0")]);
        assert!(serial_by_usb(root.path(), "A50285B").is_empty());
        assert!(serial_by_usb(&root.path().join("nowhere"), "A50285BI").is_empty());
    }

    #[test]
    fn an_adapter_is_told_to_hand_over_every_millisecond() {
        let root = machine();
        let port = Path::new("/dev/rig/turntable");
        assert_eq!(latency_timer_ms(root.path(), port), Some(16));
        shorten_latency(root.path(), port);
        assert_eq!(latency_timer_ms(root.path(), port), Some(1));
        assert_eq!(latency_timer_ms(root.path(), Path::new("/dev/tty1")), None);
    }

    #[test]
    fn who_has_a_port_open_is_named() {
        let root = machine();
        let device = fs::canonicalize(root.path().join("dev/ttyUSB0")).expect("there");
        let process = root.path().join("proc/4711");
        fs::create_dir_all(process.join("fd")).expect("folders");
        symlink(device, process.join("fd/5")).expect("a link");
        fs::write(process.join("comm"), "minicom\n").expect("a name");
        let holders = serial_holders(root.path(), Path::new("/dev/rig/turntable"));
        assert_eq!(in_use_by(&holders), " by minicom (4711)");
        assert_eq!(in_use_by(&serial_holders(root.path(), Path::new("/dev/ttyUSB7"))), "");
    }

    #[test]
    fn only_a_line_with_a_rate_keeps_bytes_for_a_while() {
        let time = |port: &str| byte_time(Path::new(port), 115_200).0;
        assert_eq!((time("/dev/ttyUSB99"), time("/dev/ttyACM99"), time("/dev/pts/99")), (86_805, 0, 0));
    }
}

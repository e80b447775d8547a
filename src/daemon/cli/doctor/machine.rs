//! The machine around the sensors: buffers, disk, clock, turntable.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use tumbled_io::live::udp::SMALL_RECEIVE_BUFFER_BYTES;
use tumbled_io::live::{PortName, ReceiveBuffer, SerialTrouble, SourceWarning};
use tumbled_io::machine::{SerialAccess, in_use_by, latency_timer_ms, serial_access, serial_holders};
use tumbled_io::recording::{FileSystem, Storage};

use super::report::Finding;
use crate::config::{Config, TurntableConfig};

/// What a VLP-32C and a Kinect make a recording grow by a second: 20 MB of packets and unpacked frames, which lz4 brings
/// to 9 MB (measured over 10 s).
const RECORDED_BYTES_PER_S: u64 = 9_000_000;

/// Less recording time than this is worth a word, s.
const SHORT_RECORDING_S: u64 = 600;

/// What the disk is tried with: a second and a half of recording, more than any drive's own cache swallows unnoticed for long.
const TRIED_BYTES: usize = 16 << 20;

/// The buffer the kernel grants a socket, against the one that is asked for.
pub(super) fn receive_buffer(buffer: ReceiveBuffer) -> Finding {
    const CHECK: &str = "receive_buffer";
    let ReceiveBuffer { requested, granted } = buffer;
    if granted >= requested {
        return Finding::ok(CHECK, format!("the kernel grants the {} asked for", mebibytes(requested)));
    }
    let message = format!("the kernel grants {} of the {} asked for", mebibytes(granted), mebibytes(requested));
    let remedy = "`sysctl -w net.core.rmem_max=8388608`; for ever: `net.core.rmem_max = 8388608` in \
                  /etc/sysctl.d/60-tumbled.conf";
    let small = granted < SMALL_RECEIVE_BUFFER_BYTES;
    let danger = if small { ": packets are lost when this machine is busy for a moment" } else { "" };
    Finding::warn(CHECK, format!("{message}{danger}"), remedy)
}

fn mebibytes(bytes: usize) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

/// The disk of the folder that recordings go to.
pub(super) fn disk(config: &Config, folder: &Path) -> Finding {
    const CHECK: &str = "disk";
    let subject = folder.display();
    if let Err(error) = tempfile::tempfile_in(folder) {
        let remedy = "name a folder that may be written with --folder";
        return Finding::fail(CHECK, format!("nothing can be written there: {error}"), remedy).of(subject);
    }
    let finding = match FileSystem.free_bytes(&folder.join("recording.mcap")) {
        Ok(free) => space(free, config.record.min_free.unwrap_or(0)),
        Err(error) => Finding::warn(CHECK, format!("its free space cannot be told: {error}"), "`df` may tell it"),
    };
    finding.of(subject)
}

/// Free bytes, of which `kept` stay free.
fn space(free: u64, kept: u64) -> Finding {
    const CHECK: &str = "disk";
    let gigabytes = |bytes: u64| format!("{:.1} GB", bytes as f64 / 1e9);
    let Some(usable) = free.checked_sub(kept).filter(|usable| *usable > 0) else {
        let message =
            format!("{} are free and {} are to stay free: no recording begins", gigabytes(free), gigabytes(kept));
        return Finding::fail(CHECK, message, "free space, record elsewhere, or lower record.min_free");
    };
    let seconds = usable / RECORDED_BYTES_PER_S;
    let minutes = seconds / 60;
    let message = format!("{} are free: about {minutes} minutes of a LiDAR and a Kinect", gigabytes(free));
    if seconds < SHORT_RECORDING_S {
        return Finding::warn(CHECK, message, "free space, or keep fewer parts (record.keep)");
    }
    Finding::ok(CHECK, message)
}

/// How fast the disk takes a recording: a file that has no name is written and brought to the medium, as a recorder does.
pub(super) fn disk_speed(folder: &Path) -> Option<Finding> {
    let mut file = tempfile::tempfile_in(folder).ok()?; // that nothing can be written there is told already
    // Not zeros: some file systems do not write those.
    let block: Vec<u8> = (0..1_u32 << 18).flat_map(|n| n.wrapping_mul(2_654_435_761).to_le_bytes()).collect();
    let begun = Instant::now();
    for _ in 0..TRIED_BYTES / block.len() {
        file.write_all(&block).ok()?;
    }
    file.sync_data().ok()?;
    Some(speed(TRIED_BYTES as f64 / begun.elapsed().as_secs_f64().max(1e-6)).of(folder.display()))
}

/// Bytes a second that a disk took.
fn speed(bytes_per_s: f64) -> Finding {
    const CHECK: &str = "disk";
    let message = format!("it takes {:.0} MB/s, synced; a LiDAR and a Kinect make 9", bytes_per_s / 1e6);
    // Half of it for other programs, and for what the 16 MiB did not show.
    if bytes_per_s < 2.0 * RECORDED_BYTES_PER_S as f64 {
        let remedy = "record to a faster disk with --folder and -o, or end what writes to it (`iostat -x 1` or `iotop` shows it): \
                      what it is too slow for is missing in the recording";
        return Finding::warn(CHECK, message, remedy);
    }
    Finding::ok(CHECK, message)
}

/// Whether the wall clock is synchronised, as far as it is told below `root`.
pub(super) fn wall_clock(root: &Path) -> Finding {
    const CHECK: &str = "clock";
    // systemd-timesyncd makes the folder when it starts and the file when it has set the clock.
    let folder = root.join("run/systemd/timesync");
    if folder.join("synchronized").exists() {
        return Finding::ok(CHECK, "the wall clock is synchronised (systemd-timesyncd)");
    }
    if folder.exists() {
        let message = "systemd-timesyncd runs and has not set the wall clock yet";
        return Finding::warn(CHECK, message, "`timedatectl timesync-status` shows its servers");
    }
    let message = "systemd-timesyncd does not run: whether the wall clock is synchronised cannot be told";
    Finding::warn(CHECK, message, "`timedatectl` or `chronyc tracking` tells it; times of recordings rest on it")
}

/// The turntable's serial port; what the system says of it lies below `root`. It is not opened: that resets many a
/// microcontroller.
pub(super) fn turntable(turntable: &TurntableConfig, root: &Path) -> Finding {
    const CHECK: &str = "turntable";
    const ELSEWHERE: &str = "`tumbled devices` lists those there are: set turntable.port";
    let port = match PortName::parse(&turntable.port).find(root) {
        Ok(port) => port,
        Err(SerialTrouble::SeveralAdapters { devices, .. }) => {
            let devices: Vec<String> = devices.iter().map(|device| device.display().to_string()).collect();
            let message = format!("several serial ports have this USB serial number: {}", devices.join(", "));
            return Finding::fail(CHECK, message, "set turntable.port to one of them").of(&turntable.port);
        }
        Err(_) => {
            let message = "no serial adapter has this USB serial number";
            return Finding::fail(CHECK, message, ELSEWHERE).of(&turntable.port);
        }
    };
    let finding = match serial_access(&port) {
        SerialAccess::Usable => usable(&port, root),
        SerialAccess::Absent => Finding::fail(CHECK, "there is no such serial port", ELSEWHERE),
        SerialAccess::NoDevice => Finding::fail(CHECK, "this is no serial device", ELSEWHERE),
        SerialAccess::Forbidden => Finding::fail(
            CHECK,
            "the serial port is there, and this user may not use it",
            "`usermod -aG dialout USER` and log in anew, or the udev rule of the rig",
        ),
    };
    finding.of(&turntable.port)
}

fn usable(port: &Path, root: &Path) -> Finding {
    const CHECK: &str = "turntable";
    let holders = serial_holders(root, port);
    if !holders.is_empty() {
        return Finding::fail(CHECK, format!("the serial port is in use{}", in_use_by(&holders)), "end that program");
    }
    match latency_timer_ms(root, port) {
        Some(ms) if ms > 1 => Finding::warn(
            CHECK,
            format!(
                "the serial port may be used; its adapter holds bytes back for {ms} ms, and the angle's time is that uncertain"
            ),
            SourceWarning::LATENCY_RULE,
        ),
        _ => Finding::ok(CHECK, "the serial port is there, free, and may be used"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::report::Level;
    use super::*;

    #[test]
    fn a_buffer_is_judged_by_what_the_kernel_grants() {
        let level = |granted| receive_buffer(ReceiveBuffer { requested: 4 << 20, granted }).level;
        assert_eq!(level(4 << 20), Level::Ok);
        assert_eq!(level((4 << 20) - 1), Level::Warn);
        // The default rmem_max: 60 ms of a VLP-32C.
        let finding = receive_buffer(ReceiveBuffer { requested: 4 << 20, granted: 212_992 });
        assert!(finding.level == Level::Warn && finding.message.contains("packets are lost"), "{finding:?}");
        assert!(finding.remedy.expect("a remedy").contains("sysctl -w net.core.rmem_max=8388608"));
    }

    #[test]
    fn space_is_what_is_free_beyond_what_stays_free() {
        // 600 s at 9 MB/s are 5.4 GB.
        let kept = 1_000_000_000;
        let level = |free| space(free, kept).level;
        assert_eq!(
            [level(kept), level(kept + 1), level(6_399_999_999), level(6_400_000_000)].map(|level| level as u8),
            [Level::Fail, Level::Warn, Level::Warn, Level::Ok].map(|level| level as u8)
        );
        assert!(space(10_000_000_000, kept).message.contains("10.0 GB are free: about 16 minutes"));
    }

    #[test]
    fn a_disk_is_judged_by_what_it_takes() {
        assert_eq!([speed(17.9e6), speed(18.1e6)].map(|finding| finding.level), [Level::Warn, Level::Ok]);
        let folder = tempfile::tempdir().expect("a folder");
        let tried = disk_speed(folder.path()).expect("it may be written");
        assert!(tried.message.starts_with("it takes ") && tried.subject.is_some(), "{tried:?}");
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0, "nothing is left behind");
        assert_eq!(disk_speed(Path::new("/nowhere/at/all")), None);
    }

    #[test]
    fn the_clock_is_believed_when_timesyncd_has_set_it() {
        let root = tempfile::tempdir().expect("a folder");
        assert_eq!(wall_clock(root.path()).level, Level::Warn);
        let folder = root.path().join("run/systemd/timesync");
        std::fs::create_dir_all(&folder).expect("folders");
        assert!(wall_clock(root.path()).message.contains("has not set"));
        std::fs::write(folder.join("synchronized"), "").expect("a file");
        assert_eq!(wall_clock(root.path()).level, Level::Ok);
    }
}

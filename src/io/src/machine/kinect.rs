//! Why a Kinect may not be opened, as far as the system tells without opening anything.
//!
//! The USB library says "no device" for most of it.

use super::usb::{KinectPart, KinectUsb, kinects};
use core::fmt;
use nix::unistd::{AccessFlags, access};
use std::path::{Path, PathBuf};

/// The kernel's own driver for the Kinect's colour camera: it takes the camera away.
const KERNEL_DRIVER: &str = "gspca_kinect";
/// What a model without a serial number reports.
const SERIAL_OF_ZEROS: &str = "0000000000000000";
/// High speed, megabits a second: a full-speed port's 12 do not carry depth, whose payload is 101.
const HIGH_SPEED_MBIT: u32 = 480;

/// Something that keeps a Kinect from being read. Shown, it names the remedy.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum KinectFinding {
    /// No camera of a Kinect is on the USB.
    NoCamera {
        /// Other parts of a Kinect are.
        other_parts: bool,
    },
    /// There are cameras, and none of this serial number.
    NotThisSerial {
        /// The configured number.
        serial: String,
        /// The numbers there are.
        found: Vec<String>,
    },
    /// Several cameras, and none is named.
    Several {
        /// Their serial numbers.
        found: Vec<String>,
    },
    /// This user may not open its device file.
    NotPermitted {
        /// The device file.
        node: PathBuf,
        /// The product id, for the udev rule.
        product: String,
    },
    /// A kernel driver has the camera.
    KernelDriver {
        /// Its name.
        driver: String,
    },
    /// The kernel's driver is loaded, and has no camera at the moment: it takes the next one that is plugged in.
    KernelDriverLoaded,
    /// A program has the camera.
    InUse,
    /// The port is too slow.
    SlowPort {
        /// What it gives, megabits a second.
        mbit: u32,
    },
}

impl KinectFinding {
    /// Whether the Kinect cannot be read at all as long as this is so. The library takes the camera from a kernel driver by
    /// itself where it may.
    pub fn is_fatal(&self) -> bool {
        !matches!(self, Self::KernelDriver { .. } | Self::KernelDriverLoaded)
    }

    /// What is so.
    pub fn cause(&self) -> String {
        match self {
            Self::NoCamera { other_parts: false } => "no Kinect is on the USB".to_owned(),
            Self::NoCamera { other_parts: true } => "parts of a Kinect are on the USB and its camera is not".to_owned(),
            Self::NotThisSerial { serial, .. } => format!("no Kinect has the serial number `{serial}`"),
            Self::Several { found } => format!("there are {} Kinects and none is named", found.len()),
            Self::NotPermitted { node, .. } => format!("this user may not open {}", node.display()),
            Self::KernelDriver { driver } => format!("the kernel's driver {driver} has the camera"),
            Self::KernelDriverLoaded => {
                format!("the kernel's driver {KERNEL_DRIVER} is loaded and may take the camera")
            }
            Self::InUse => "another program has the camera".to_owned(),
            Self::SlowPort { mbit } => {
                format!("the Kinect's port gives {mbit} Mbit/s of the {HIGH_SPEED_MBIT} it needs")
            }
        }
    }

    /// What to do about it.
    pub fn remedy(&self) -> String {
        let unload = |driver: &str| {
            format!("`modprobe -r {driver}`, and for good a line `blacklist {driver}` in /etc/modprobe.d/kinect.conf")
        };
        match self {
            Self::NoCamera { other_parts: false } => "plug it in, and its 12 V supply".to_owned(),
            Self::NoCamera { other_parts: true } => "plug in its 12 V supply, then the USB anew".to_owned(),
            Self::NotThisSerial { found, .. } => format!("there are: {}", found.join(", ")),
            Self::Several { found } => format!("set the serial number of one: {}", found.join(", ")),
            Self::NotPermitted { product, .. } => format!(
                "put systemd/tumbled.udev.rules, or its line {}, into /etc/udev/rules.d/51-tumbled.rules, then \
                 `udevadm control --reload` and plug the Kinect in anew (Debian's package libfreenect0.5 brings such a rule \
                 for the Xbox 360's)",
                udev_rule(product)
            ),
            Self::KernelDriver { driver } => unload(driver),
            Self::KernelDriverLoaded => unload(KERNEL_DRIVER),
            Self::InUse => "a running tumbled? `fuser -v /dev/bus/usb/*/*` shows it: end it".to_owned(),
            Self::SlowPort { .. } => "use another port and cable, no hub".to_owned(),
        }
    }
}

/// The udev rule that lets everybody at this machine use a part of a Kinect: Microsoft's product of this id, e.g. `02ae`.
pub fn udev_rule(product: &str) -> String {
    format!("SUBSYSTEM==\"usb\", ATTR{{idVendor}}==\"045e\", ATTR{{idProduct}}==\"{product}\", MODE=\"0666\"")
}

impl fmt::Display for KinectFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.cause(), self.remedy())
    }
}

/// The cameras that a config means: those of this serial number, or all when it names none.
///
/// Models 1473 and Kinect for Windows report sixteen zeros; they go by the serial number of their microphones, as in the USB
/// library.
pub fn kinect_cameras(root: &Path, serial: Option<&str>) -> Vec<KinectUsb> {
    let parts = kinects(root);
    let meant = |camera: &&KinectUsb| {
        let matches = serial.is_none_or(|serial| serial_of(camera, &parts).as_deref() == Some(serial));
        camera.part == KinectPart::Camera && matches
    };
    parts.iter().filter(meant).cloned().collect()
}

/// What keeps the Kinect of this serial number, or the only one, from being read; nothing is opened. Empty: nothing that can
/// be seen.
pub fn kinect_findings(root: &Path, serial: Option<&str>) -> Vec<KinectFinding> {
    let parts = kinects(root);
    let cameras = kinect_cameras(root, serial);
    match cameras.as_slice() {
        [] => vec![none_meant(&parts, serial)],
        [camera] => camera_findings(root, camera),
        several => {
            let found = several.iter().filter_map(|camera| serial_of(camera, &parts)).collect();
            vec![KinectFinding::Several { found }]
        }
    }
}

fn none_meant(parts: &[KinectUsb], serial: Option<&str>) -> KinectFinding {
    let cameras = || parts.iter().filter(|part| part.part == KinectPart::Camera);
    match serial {
        Some(serial) if cameras().next().is_some() => {
            let found = cameras().filter_map(|camera| serial_of(camera, parts)).collect();
            KinectFinding::NotThisSerial { serial: serial.to_owned(), found }
        }
        _ => KinectFinding::NoCamera { other_parts: !parts.is_empty() },
    }
}

/// What keeps this camera, as [`kinects`] lists it, from being read.
pub fn camera_findings(root: &Path, camera: &KinectUsb) -> Vec<KinectFinding> {
    let driver_loaded = root.join("sys/module").join(KERNEL_DRIVER).exists();
    let mut findings = Vec::new();
    if let Some(node) = camera.node.as_ref().filter(|node| !may_open(root, node)) {
        let product = camera.id.rsplit(':').next().unwrap_or_default().to_owned();
        findings.push(KinectFinding::NotPermitted { node: node.clone(), product });
    }
    if let Some(mbit) = camera.speed_mbit.filter(|mbit| *mbit < HIGH_SPEED_MBIT) {
        findings.push(KinectFinding::SlowPort { mbit });
    }
    match camera.driver.as_deref() {
        // `usbfs` is how the kernel calls a program that has the interface.
        Some("usbfs") => findings.push(KinectFinding::InUse),
        Some(driver) => findings.push(KinectFinding::KernelDriver { driver: driver.to_owned() }),
        None if driver_loaded => findings.push(KinectFinding::KernelDriverLoaded),
        None => {}
    }
    findings
}

fn may_open(root: &Path, node: &Path) -> bool {
    let below = node.strip_prefix("/").unwrap_or(node);
    access(&root.join(below), AccessFlags::R_OK | AccessFlags::W_OK).is_ok()
}

/// A camera's serial number as the USB library has it.
fn serial_of(camera: &KinectUsb, parts: &[KinectUsb]) -> Option<String> {
    let own = camera.serial.clone()?;
    if own != SERIAL_OF_ZEROS {
        return Some(own);
    }
    let siblings = parts.iter().filter(|part| part.part == KinectPart::Audio && hub(&part.place) == hub(&camera.place));
    siblings.filter_map(|part| part.serial.clone()).next()
}

/// The place of the hub that a device hangs on: `1-2` for `1-2.3`.
fn hub(place: &str) -> &str {
    place.rsplit_once('.').map_or(place, |(hub, _)| hub)
}

#[cfg(test)]
mod tests {
    use super::super::sysfs::Sysfs;
    use super::*;

    const SERIAL: &str = "A00362A08602047A";

    #[test]
    fn a_kinect_that_nothing_keeps_from_being_read_has_no_finding() {
        let root = Sysfs::new();
        root.camera("1-2.3", SERIAL, "010b");
        assert_eq!(kinect_findings(root.path(), None), []);
        assert_eq!(kinect_findings(root.path(), Some(SERIAL)), []);
    }

    #[test]
    fn a_kinect_without_its_supply_shows_its_motor_alone() {
        let root = Sysfs::new();
        assert_eq!(kinect_findings(root.path(), None), [KinectFinding::NoCamera { other_parts: false }]);
        root.device("1-2.1", &[("idVendor", "045e"), ("idProduct", "02b0")]);
        let findings = kinect_findings(root.path(), None);
        assert_eq!(findings, [KinectFinding::NoCamera { other_parts: true }]);
        assert!(findings[0].is_fatal() && findings[0].to_string().contains("12 V supply"));
    }

    #[test]
    fn another_serial_number_and_several_cameras_are_named() {
        let root = Sysfs::new();
        root.camera("1-2.3", SERIAL, "010b");
        let other = KinectFinding::NotThisSerial { serial: "B1".into(), found: vec![SERIAL.into()] };
        assert_eq!(kinect_findings(root.path(), Some("B1")), [other]);
        root.camera("2-2.3", "B1", "010b");
        let several = KinectFinding::Several { found: vec![SERIAL.into(), "B1".into()] };
        assert_eq!(kinect_findings(root.path(), None), [several]);
        assert_eq!(kinect_cameras(root.path(), Some("B1"))[0].place, "2-2.3");
    }

    #[test]
    fn sixteen_zeros_give_way_to_the_microphones_of_the_same_kinect() {
        let root = Sysfs::new();
        root.camera("1-2.3", "0000000000000000", "0205");
        root.device("1-2.1", &[("idVendor", "045e"), ("idProduct", "02ad"), ("serial", "B44838231942047B")]);
        root.device("1-3.1", &[("idVendor", "045e"), ("idProduct", "02ad"), ("serial", "C1")]); // of another one
        assert_eq!(kinect_cameras(root.path(), Some("B44838231942047B")).len(), 1);
        assert_eq!(kinect_cameras(root.path(), Some("0000000000000000")), []);
        assert_eq!(kinect_cameras(root.path(), Some("C1")), []);
    }

    #[test]
    fn a_device_file_that_cannot_be_opened_calls_for_its_own_rule() {
        let root = Sysfs::new();
        root.camera("1-2.3", SERIAL, "010b");
        // No device file: the same as one for others, which root cannot be shown.
        std::fs::remove_file(root.path().join("dev/bus/usb/001/004")).expect("it was there");
        let findings = kinect_findings(root.path(), None);
        let node = PathBuf::from("/dev/bus/usb/001/004");
        assert_eq!(findings, [KinectFinding::NotPermitted { node, product: "02ae".into() }]);
        assert!(findings[0].to_string().contains("ATTR{idProduct}==\"02ae\", MODE=\"0666\""), "{}", findings[0]);
    }

    #[test]
    fn the_kernels_driver_and_a_slow_port_are_told() {
        let root = Sysfs::new();
        root.camera("1-2.3", SERIAL, "010b");
        root.module("gspca_kinect");
        assert_eq!(kinect_findings(root.path(), None), [KinectFinding::KernelDriverLoaded]);
        root.driver("1-2.3", "gspca_kinect");
        root.device("1-2.3", &[("speed", "12")]);
        let driver = KinectFinding::KernelDriver { driver: "gspca_kinect".into() };
        assert!(!driver.is_fatal());
        assert_eq!(kinect_findings(root.path(), None), [KinectFinding::SlowPort { mbit: 12 }, driver]);
    }

    #[test]
    fn a_camera_that_a_program_uses_is_in_use_and_not_taken_by_the_kernel() {
        let root = Sysfs::new();
        root.camera("1-2.3", SERIAL, "010b");
        root.module("gspca_kinect");
        root.driver("1-2.3", "usbfs");
        assert_eq!(kinect_findings(root.path(), None), [KinectFinding::InUse]);
        assert!(KinectFinding::InUse.is_fatal());
    }

    #[test]
    fn each_finding_tells_its_remedy_after_its_cause() {
        let finding = KinectFinding::SlowPort { mbit: 12 };
        assert_eq!(finding.cause(), "the Kinect's port gives 12 Mbit/s of the 480 it needs");
        assert_eq!(finding.to_string(), format!("{}: {}", finding.cause(), finding.remedy()));
    }

    #[test]
    fn the_rule_that_is_named_stands_in_the_file_that_is_named() {
        let file = include_str!("../../../../systemd/tumbled.udev.rules");
        for camera in ["02ae", "02bf"] {
            assert!(file.lines().any(|line| line == udev_rule(camera)), "{camera}");
        }
    }
}

//! Kinects on the USB, by the ids the kernel lists.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::serial::names;

/// Microsoft's vendor id.
const MICROSOFT: &str = "045e";

/// The Kinect for Windows' camera.
const WINDOWS_CAMERA: &str = "02bf";
/// The camera's release number, 0x010b, that tells model 1414 from 1473. Source: libfreenect 0.5.3, `usb_libusb10.c`.
const RELEASE_1414: u16 = 0x010b;

/// Product ids of a Kinect v1's parts, each a USB device of its own behind the Kinect's hub: the Xbox 360's, and the Kinect
/// for Windows', whose microphones change theirs with the firmware. Source: libfreenect 0.5.3 and its udev rules.
const PARTS: [(&str, KinectPart); 8] = [
    ("02ae", KinectPart::Camera),
    ("02b0", KinectPart::Motor),
    ("02ad", KinectPart::Audio),
    ("02bf", KinectPart::Camera),
    ("02c2", KinectPart::Motor),
    ("02be", KinectPart::Audio),
    ("02c3", KinectPart::Audio),
    ("02bb", KinectPart::Audio),
];

/// The longest text of an attribute that is read; sysfs gives a page at most.
const ATTRIBUTE_BYTES: u64 = 4_096;

/// A part of a Kinect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum KinectPart {
    /// The colour and depth cameras.
    Camera,
    /// The tilt motor.
    Motor,
    /// The microphones.
    Audio,
}

impl KinectPart {
    /// Its name for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Motor => "motor",
            Self::Audio => "audio",
        }
    }
}

/// A part of a Kinect as the kernel lists it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KinectUsb {
    /// Its place on the bus, e.g. `1-2.1`: bus, port, port of the hub.
    pub place: String,
    /// What it is.
    pub part: KinectPart,
    /// `045e:02ae`.
    pub id: String,
    /// Its serial number; the depth camera's is the one a config names. `None`: it has none.
    pub serial: Option<String>,
    /// The release number of its firmware (bcdDevice).
    pub release: Option<u16>,
    /// Its device file, e.g. `/dev/bus/usb/001/004`: what a program that uses it has to be allowed to open.
    pub node: Option<PathBuf>,
    /// The kernel's driver that has its first interface.
    pub driver: Option<String>,
    /// Megabits a second that its port gives: 480, or less at a port or cable that is too slow.
    pub speed_mbit: Option<u32>,
}

/// A model of the Kinect v1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KinectModel {
    /// The Xbox 360's first.
    Xbox1414,
    /// The Xbox 360's second: its motor is behind the microphones, its camera has no serial number.
    Xbox1473,
    /// The Kinect for Windows.
    Windows,
}

impl KinectModel {
    /// Its name for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Xbox1414 => "Xbox 360, 1414",
            Self::Xbox1473 => "Xbox 360, 1473",
            Self::Windows => "Kinect for Windows",
        }
    }
}

impl KinectUsb {
    /// The model that this camera belongs to; `None` for other parts.
    pub fn model(&self) -> Option<KinectModel> {
        if self.part != KinectPart::Camera {
            return None;
        }
        Some(match self.release {
            _ if self.id.ends_with(WINDOWS_CAMERA) => KinectModel::Windows,
            Some(RELEASE_1414) => KinectModel::Xbox1414,
            _ => KinectModel::Xbox1473,
        })
    }
}

/// The parts of Kinects plugged in, by their place.
pub fn kinects(root: &Path) -> Vec<KinectUsb> {
    let devices = root.join("sys/bus/usb/devices");
    let listed = names(&devices).into_iter().filter_map(|place| {
        let attribute = |name: &str| attribute(&devices.join(&place).join(name));
        let product = attribute("idProduct").filter(|_| attribute("idVendor").as_deref() == Some(MICROSOFT))?;
        let (_, part) = PARTS.iter().find(|(id, _)| *id == product)?;
        let number = |name: &str| attribute(name)?.parse::<u32>().ok();
        Some(KinectUsb {
            part: *part,
            id: format!("{MICROSOFT}:{product}"),
            serial: attribute("serial").filter(|serial| !serial.is_empty()),
            release: attribute("bcdDevice").and_then(|digits| u16::from_str_radix(&digits, 16).ok()),
            node: number("busnum")
                .zip(number("devnum"))
                .map(|(bus, device)| PathBuf::from(format!("/dev/bus/usb/{bus:03}/{device:03}"))),
            driver: driver(&devices.join(format!("{place}:1.0"))),
            speed_mbit: number("speed"),
            place,
        })
    });
    listed.collect()
}

/// The kernel's driver of an interface: a link named after it.
fn driver(interface: &Path) -> Option<String> {
    Some(fs::read_link(interface.join("driver")).ok()?.file_name()?.to_string_lossy().into_owned())
}

/// An attribute's text, its line end cut off; `None` where there is none.
fn attribute(path: &Path) -> Option<String> {
    let mut text = String::new();
    File::open(path).ok()?.take(ATTRIBUTE_BYTES).read_to_string(&mut text).ok()?;
    Some(text.trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use super::super::sysfs::Sysfs;
    use super::*;

    #[test]
    fn parts_are_known_by_their_ids_and_other_devices_are_left_out() {
        let root = Sysfs::new();
        root.device("1-2.3", &[("idVendor", "045e"), ("idProduct", "02ae"), ("serial", "A00362A08602047A")]);
        root.device("1-2.1", &[("idVendor", "045e"), ("idProduct", "02b0"), ("serial", "")]);
        root.device("2-1", &[("idVendor", "045e"), ("idProduct", "02bf")]);
        root.device("1-1", &[("idVendor", "045e"), ("idProduct", "0291")]); // another product of theirs
        root.device("1-4", &[("idVendor", "0403"), ("idProduct", "02ae")]); // another vendor's 02ae
        root.device("1-2.3:1.0", &[("bInterfaceClass", "ff")]); // an interface, no device
        let found = kinects(root.path());
        let part = |usb: &KinectUsb| (usb.place.clone(), usb.part, usb.id.clone(), usb.serial.clone());
        let expected = [
            ("1-2.1", KinectPart::Motor, "045e:02b0", None),
            ("1-2.3", KinectPart::Camera, "045e:02ae", Some("A00362A08602047A")),
            ("2-1", KinectPart::Camera, "045e:02bf", None),
        ];
        let expected = expected
            .map(|(place, part, id, serial)| (place.to_owned(), part, id.to_owned(), serial.map(str::to_owned)));
        assert_eq!(found.iter().map(part).collect::<Vec<_>>(), expected);
        assert_eq!(kinects(&root.path().join("nowhere")), []);
    }

    #[test]
    fn a_camera_tells_its_model_its_device_file_and_who_has_it() {
        let root = Sysfs::new();
        root.camera("1-2.3", "A00362A08602047A", "010b");
        root.driver("1-2.3", "gspca_kinect");
        root.camera("1-3.3", "0000000000000000", "0205");
        root.device("2-1", &[("idVendor", "045e"), ("idProduct", "02bf"), ("bcdDevice", "010b")]);
        let found = kinects(root.path());
        let models: Vec<_> = found.iter().map(KinectUsb::model).collect();
        assert_eq!(models, [Some(KinectModel::Xbox1414), Some(KinectModel::Xbox1473), Some(KinectModel::Windows)]);
        assert_eq!((found[0].release, found[1].release), (Some(0x010b), Some(0x0205)));
        assert_eq!(found[0].node, Some(PathBuf::from("/dev/bus/usb/001/004")));
        assert_eq!((found[0].driver.as_deref(), found[0].speed_mbit), (Some("gspca_kinect"), Some(480)));
        assert_eq!((&found[2].node, &found[2].driver), (&None, &None));
    }
}

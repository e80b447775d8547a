//! Kinects on the USB, by the ids the kernel lists.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::serial::names;

/// Microsoft's vendor id.
const MICROSOFT: &str = "045e";

/// Product ids of a Kinect v1's parts, each a USB device of its own behind the Kinect's hub: the Xbox 360's, and the Kinect
/// for Windows'. Source: libfreenect's udev rules.
const PARTS: [(&str, KinectPart); 6] = [
    ("02ae", KinectPart::Camera),
    ("02b0", KinectPart::Motor),
    ("02ad", KinectPart::Audio),
    ("02bf", KinectPart::Camera),
    ("02c2", KinectPart::Motor),
    ("02be", KinectPart::Audio),
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
}

/// The parts of Kinects plugged in, by their place.
pub fn kinects(root: &Path) -> Vec<KinectUsb> {
    let devices = root.join("sys/bus/usb/devices");
    let listed = names(&devices).into_iter().filter_map(|place| {
        let attribute = |name: &str| attribute(&devices.join(&place).join(name));
        let product = attribute("idProduct").filter(|_| attribute("idVendor").as_deref() == Some(MICROSOFT))?;
        let (_, part) = PARTS.iter().find(|(id, _)| *id == product)?;
        let serial = attribute("serial").filter(|serial| !serial.is_empty());
        Some(KinectUsb { part: *part, id: format!("{MICROSOFT}:{product}"), serial, place: place.clone() })
    });
    listed.collect()
}

/// An attribute's text, its line end cut off; `None` where there is none.
fn attribute(path: &Path) -> Option<String> {
    let mut text = String::new();
    File::open(path).ok()?.take(ATTRIBUTE_BYTES).read_to_string(&mut text).ok()?;
    Some(text.trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn parts_are_known_by_their_ids_and_other_devices_are_left_out() {
        let root = tempfile::tempdir().expect("a folder");
        let device = |place: &str, attributes: &[(&str, &str)]| {
            let folder = root.path().join("sys/bus/usb/devices").join(place);
            fs::create_dir_all(&folder).expect("a folder");
            for (name, text) in attributes {
                fs::write(folder.join(name), format!("{text}\n")).expect("an attribute");
            }
        };
        device("1-2.3", &[("idVendor", "045e"), ("idProduct", "02ae"), ("serial", "A00362A08602047A")]);
        device("1-2.1", &[("idVendor", "045e"), ("idProduct", "02b0"), ("serial", "")]);
        device("2-1", &[("idVendor", "045e"), ("idProduct", "02bf")]);
        device("1-1", &[("idVendor", "045e"), ("idProduct", "0291")]); // another product of theirs
        device("1-4", &[("idVendor", "0403"), ("idProduct", "02ae")]); // another vendor's 02ae
        device("1-2.3:1.0", &[("bInterfaceClass", "ff")]); // an interface, no device
        let part = |place: &str, part, id: &str, serial: Option<&str>| KinectUsb {
            place: place.to_owned(),
            part,
            id: id.to_owned(),
            serial: serial.map(str::to_owned),
        };
        let expected = [
            part("1-2.1", KinectPart::Motor, "045e:02b0", None),
            part("1-2.3", KinectPart::Camera, "045e:02ae", Some("A00362A08602047A")),
            part("2-1", KinectPart::Camera, "045e:02bf", None),
        ];
        assert_eq!(kinects(root.path()), expected);
        assert_eq!(kinects(&root.path().join("nowhere")), []);
    }
}

//! A made-up `/sys` and `/dev` for tests.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

/// A folder that stands for `/`.
pub(crate) struct Sysfs(tempfile::TempDir);

impl Sysfs {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    /// A device or interface with these attributes.
    pub(crate) fn device(&self, place: &str, attributes: &[(&str, &str)]) {
        let folder = self.path().join("sys/bus/usb/devices").join(place);
        fs::create_dir_all(&folder).expect("a folder");
        for (name, text) in attributes {
            fs::write(folder.join(name), format!("{text}\n")).expect("an attribute");
        }
    }

    /// An Xbox 360 Kinect's camera, bus 1, device 4, with its device file.
    pub(crate) fn camera(&self, place: &str, serial: &str, release: &str) {
        let ids = [("idVendor", "045e"), ("idProduct", "02ae"), ("serial", serial), ("bcdDevice", release)];
        self.device(place, &ids);
        self.device(place, &[("busnum", "1"), ("devnum", "4"), ("speed", "480")]);
        fs::create_dir_all(self.path().join("dev/bus/usb/001")).expect("a folder");
        fs::write(self.path().join("dev/bus/usb/001/004"), "").expect("a device file");
    }

    /// The kernel's driver of a device's first interface.
    pub(crate) fn driver(&self, place: &str, name: &str) {
        let interface = format!("{place}:1.0");
        self.device(&interface, &[]);
        let link = self.path().join("sys/bus/usb/devices").join(interface).join("driver");
        symlink(format!("../../../bus/usb/drivers/{name}"), link).expect("a link");
    }

    /// A module that the kernel has loaded.
    pub(crate) fn module(&self, name: &str) {
        fs::create_dir_all(self.path().join("sys/module").join(name)).expect("a folder");
    }
}

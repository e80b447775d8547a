//! The Kinects: what the system knows of them, and whether they send.

use std::path::Path;

use tumbled_io::machine::{KinectFinding, kinect_findings};

use super::report::Finding;
use crate::config::KinectConfig;

const CHECK: &str = "kinect";

/// One Kinect of the config; system files below `root`. Where nothing is seen to keep it from being read, it is read for two
/// seconds, if this build can.
pub(super) fn check(kinect: &KinectConfig, root: &Path) -> Vec<Finding> {
    let seen = kinect_findings(root, kinect.serial.as_deref());
    let keeps = seen.iter().any(|finding| finding.is_fatal() && !is_unlisted(finding));
    let mut findings: Vec<Finding> = seen.iter().filter(|finding| !is_unlisted(finding)).map(finding).collect();
    if !keeps {
        findings.extend(delivery(kinect, root, seen.iter().any(is_unlisted)));
    }
    findings.into_iter().map(|finding| finding.of(&kinect.id)).collect()
}

/// The system lists none at all: where it has no list of USB devices, the library may find one all the same.
fn is_unlisted(finding: &KinectFinding) -> bool {
    matches!(finding, KinectFinding::NoCamera { other_parts: false })
}

fn finding(finding: &KinectFinding) -> Finding {
    let (cause, remedy) = (finding.cause(), finding.remedy());
    if finding.is_fatal() { Finding::fail(CHECK, cause, remedy) } else { Finding::warn(CHECK, cause, remedy) }
}

#[cfg(feature = "kinect-usb")]
fn delivery(kinect: &KinectConfig, root: &Path, _unlisted: bool) -> Vec<Finding> {
    use std::time::Duration;
    use tumbled_io::live::{KinectUsbConfig, probe_kinect};

    /// A healthy Kinect's first frame comes within half a second.
    const WATCHED: Duration = Duration::from_secs(2);

    let serial = kinect.serial.as_deref().unwrap_or_default();
    let usb = KinectUsbConfig { root: root.to_owned(), ..KinectUsbConfig::new(kinect.id.clone(), serial) };
    match probe_kinect(usb, WATCHED) {
        Ok(probed) => probe::findings(&probed),
        Err(error) => {
            let text = error.to_string();
            let (cause, remedy) = text.split_once(": ").unwrap_or((&text, "docs/kinect-usb.md tells what may help"));
            vec![Finding::fail(CHECK, cause, remedy)]
        }
    }
}

/// A build that reads none tells whether one is there.
#[cfg(not(feature = "kinect-usb"))]
fn delivery(_: &KinectConfig, _: &Path, unlisted: bool) -> Vec<Finding> {
    let there = if unlisted { "no Kinect is on the USB" } else { "a Kinect is on the USB" };
    let message = format!("this build has no kinect-usb: a session with it is refused ({there})");
    let remedy =
        "build with `--features kinect-usb` (docs/kinect-usb.md), or leave Kinects out of the config: kinect = []";
    vec![Finding::fail(CHECK, message, remedy)]
}

/// What two seconds of a stream tell.
#[cfg(feature = "kinect-usb")]
mod probe {
    use tumbled_io::live::{Device, KinectProbed};

    use super::{CHECK, Finding};

    pub(super) fn findings(probed: &KinectProbed) -> Vec<Finding> {
        let KinectProbed { info, frames, damaged, missing, time } = probed;
        let seconds = time.as_secs_f64();
        if *frames == 0 {
            let message = format!("no depth frame within {seconds:.0} s");
            let remedy = "use a port of the machine itself (no hub, no virtual machine), check the 12 V supply, and \
                          `lsusb -t` for what shares its controller";
            return vec![Finding::fail(CHECK, message, remedy)];
        }
        let mut findings = vec![stream(probed, &named(&info.device))];
        if damaged + missing > 0 {
            let message = format!("of {} frames {damaged} lack USB packets, {missing} did not come", frames + missing);
            let remedy = "give it a USB controller of its own (`lsusb -t`), a short cable, and end other programs";
            findings.push(Finding::warn(CHECK, message, remedy));
        }
        let warnings = info.warnings.iter().map(ToString::to_string);
        findings.extend(warnings.map(|text| {
            let (cause, remedy) = text.split_once("; ").unwrap_or((&text, "docs/kinect-usb.md tells more"));
            Finding::warn(CHECK, cause, remedy)
        }));
        findings
    }

    fn stream(probed: &KinectProbed, named: &str) -> Finding {
        let KinectProbed { frames, time, .. } = probed;
        Finding::ok(CHECK, format!("{named}: {frames} frames within {:.1} s", time.as_secs_f64()))
    }

    fn named(device: &Device) -> String {
        let Device::Kinect(kinect) = device else { return "a device".to_owned() };
        let model = kinect.model.map_or_else(|| "Kinect".to_owned(), |model| format!("Kinect {}", model.name()));
        let serial = kinect.serial.as_ref().map_or_else(String::new, |serial| format!(", serial number {serial}"));
        let place = kinect.place.as_ref().map_or_else(String::new, |place| format!(", at {place}"));
        format!("{model}{serial}{place}")
    }
}

#[cfg(test)]
mod tests {
    use super::super::report::Level;
    use super::*;

    fn checked(kinect: &str, files: &[(&str, &str)]) -> Vec<Finding> {
        let root = tempfile::tempdir().expect("a folder");
        for (name, text) in files {
            let path = root.path().join(name);
            std::fs::create_dir_all(path.parent().expect("below the root")).expect("folders");
            std::fs::write(path, text).expect("a file");
        }
        let settings = ["kinect=[{}]".to_owned(), format!("kinect.serial={kinect}")];
        let loaded = crate::config::load(None, &settings).expect("a config");
        check(&loaded.config.kinects[0], root.path())
    }

    /// A camera as the system lists it; without its device file it may not be opened.
    const CAMERA: [(&str, &str); 6] = [
        ("sys/bus/usb/devices/1-2.3/idVendor", "045e\n"),
        ("sys/bus/usb/devices/1-2.3/idProduct", "02ae\n"),
        ("sys/bus/usb/devices/1-2.3/serial", "A1\n"),
        ("sys/bus/usb/devices/1-2.3/busnum", "1\n"),
        ("sys/bus/usb/devices/1-2.3/devnum", "4\n"),
        ("sys/bus/usb/devices/1-2.3/speed", "480\n"),
    ];

    #[test]
    fn what_the_system_knows_is_told_without_opening_anything() {
        let findings = checked("A1", &CAMERA);
        let [forbidden] = findings.as_slice() else { panic!("{findings:#?}") };
        assert_eq!(
            (forbidden.level, forbidden.message.as_str()),
            (Level::Fail, "this user may not open /dev/bus/usb/001/004")
        );
        assert!(forbidden.remedy.as_ref().is_some_and(|remedy| remedy.contains("tumbled.udev.rules")), "{forbidden:?}");
        let other = checked("B2", &CAMERA);
        assert!(other[0].level == Level::Fail && other[0].remedy.as_deref() == Some("there are: A1"), "{other:?}");
    }

    #[test]
    fn parts_without_a_camera_lack_their_supply() {
        let motor = [("sys/bus/usb/devices/1-2.1/idVendor", "045e"), ("sys/bus/usb/devices/1-2.1/idProduct", "02b0")];
        let findings = checked("", &motor);
        assert!(findings[0].level == Level::Fail && findings[0].subject.as_deref() == Some("near"), "{findings:?}");
        assert!(findings[0].remedy.as_ref().is_some_and(|remedy| remedy.contains("12 V")), "{findings:?}");
    }

    #[cfg(not(feature = "kinect-usb"))]
    #[test]
    fn a_build_that_reads_none_says_so_and_whether_one_is_there() {
        let findings = checked("", &[]);
        assert!(
            findings[0].level == Level::Fail && findings[0].message.contains("no Kinect is on the USB"),
            "{findings:?}"
        );
    }
}

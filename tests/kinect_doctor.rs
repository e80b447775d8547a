//! `doctor` reads a Kinect for two seconds and names what keeps it from delivering: on the real libfreenect, over a stand-in
//! for libusb.

use tumbled::cli::doctor::report::{DoctorReport, Finding, Level};

use crate::support::usb::Usb;

/// What it finds of the one Kinect, worst first.
fn kinect(script: &str) -> Vec<Finding> {
    let usb = Usb::new(script);
    let ports = ["--set", "lidar=[]", "--listen", "10ms"];
    let done = usb.run(&[&["doctor", "--config", "rig.toml", "--json"], &ports[..]].concat());
    let report: DoctorReport = done.json();
    let mut findings: Vec<Finding> = report.findings.into_iter().filter(|finding| finding.check == "kinect").collect();
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.level));
    assert_eq!(findings[0].subject.as_deref(), Some("near"));
    assert_eq!(done.code == 3, findings[0].level == Level::Fail, "{findings:?}");
    findings
}

fn assert_fails(script: &str, cause: &str, remedy: &str) {
    let worst = &kinect(script)[0];
    assert_eq!(worst.level, Level::Fail, "{script}: {worst:?}");
    assert!(worst.message.contains(cause), "{script}: {worst:?}");
    assert!(worst.remedy.as_ref().is_some_and(|text| text.contains(remedy)), "{script}: {worst:?}");
}

#[test]
fn a_kinect_that_sends_is_ready() {
    let findings = kinect("");
    let ready = findings.iter().find(|finding| finding.level == Level::Ok).unwrap_or_else(|| panic!("{findings:?}"));
    assert!(ready.message.contains("serial number A1") && ready.message.contains("frames within 2.0 s"), "{ready:?}");
}

#[test]
fn a_kinect_that_loses_packets_is_a_warning() {
    let findings = kinect("frame 3 drop 9\n");
    let lossy = findings.iter().find(|finding| finding.message.contains("lack USB packets"));
    assert_eq!(lossy.unwrap_or_else(|| panic!("{findings:?}")).level, Level::Warn);
}

#[test]
fn each_cause_is_named_with_its_remedy() {
    for (script, cause, remedy) in [
        ("unplug\n", "no Kinect is on the USB", "12 V"),
        ("no-permission\n", "no permission", "udev rule"),
        ("busy\n", "in use", "modprobe -r gspca_kinect"),
        ("refuse-bandwidth\n", "refused 16 of the 16", "another controller"),
        ("stall until reset\n", "no depth frame within 2 s", "12 V"),
    ] {
        assert_fails(script, cause, remedy);
    }
}

#[test]
fn a_kinect_that_does_not_answer_is_given_up() {
    assert_fails("mute-from-start\n", "did not answer within 5 s", "plug it in anew");
}

//! `doctor` and `devices` on this machine, with sensors on loopback.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::thread::JoinHandle;

use tumbled::cli::devices::DevicesReport;
use tumbled::cli::doctor::report::{DoctorReport, Finding, Level};
use tumbled_io::live::{Pace, StopToken, UdpSender};
use tumbled_model::Span;
use tumbled_velodyne::{Model, ReturnMode};

use crate::support::Workbench;
use crate::synth::Sensor;

/// A sensor that sends to a port of its own until it is dropped.
struct Speaking {
    port: u16,
    stop: StopToken,
    sender: Option<JoinHandle<()>>,
}

impl Speaking {
    /// `touch` changes each payload before it is sent.
    fn start(model: Model, mode: ReturnMode, touch: fn(&mut [u8])) -> Self {
        let (port, stop) = (free_port(), StopToken::new().expect("a descriptor"));
        // 13 s of a VLP-32C and more, made before the sensor is said to speak.
        let packets = Sensor::new(model, mode).packets(20_000, |_, _| (500, 600));
        let sender = std::thread::spawn({
            let stop = stop.clone();
            move || {
                let to = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
                let datagram = |packet: crate::synth::Packet| {
                    let mut payload = packet.bytes.to_vec();
                    touch(&mut payload);
                    (Span(packet.t_ns), to, payload)
                };
                let from = UdpSender::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))).expect("a free port");
                // Nobody listens before the command does: refused datagrams are no error of this test.
                let datagrams = packets.into_iter().map(datagram);
                from.send(datagrams, Pace::Times(1.0), &stop).map(drop).unwrap_or_default();
            }
        });
        Self { port, stop, sender: Some(sender) }
    }
}

impl Drop for Speaking {
    fn drop(&mut self) {
        self.stop.stop();
        self.sender.take().map(JoinHandle::join);
    }
}

/// A port that nobody has at the moment.
fn free_port() -> u16 {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).expect("a free port");
    socket.local_addr().expect("bound").port()
}

/// A config for this test's machine: no Kinect, no fixed port, a socket that can be made.
fn bench(port: u16) -> Workbench {
    let bench = Workbench::new();
    bench.file(
        "rig.toml",
        format!(
            "kinect = []\n[[lidar]]\nport = {port}\nposition_port = 0\n[stream]\ntcp = '127.0.0.1:0'\n\
             unix = 'state.sock'\nfoxglove = ''\n[record]\nmin_free = '1MB'\n"
        ),
    );
    bench
}

fn doctor(bench: &Workbench, more: &[&str]) -> (i32, DoctorReport) {
    let arguments = ["doctor", "--config", "rig.toml", "--json", "--listen", "500ms"];
    let done = bench.run(&[&arguments[..], more].concat());
    (done.code, done.json())
}

fn found<'a>(report: &'a DoctorReport, check: &str) -> &'a Finding {
    report.findings.iter().find(|finding| finding.check == check).unwrap_or_else(|| panic!("no {check}: {report:#?}"))
}

#[test]
fn a_rig_that_is_ready_is_found_healthy() {
    let sensor = Speaking::start(Model::Vlp32c, ReturnMode::Dual, |_| {});
    let bench = bench(sensor.port);
    let (code, report) = doctor(&bench, &[]);
    assert_eq!((code, report.healthy), (0, true), "{report:#?}");
    let lidar = found(&report, "lidar");
    assert_eq!((lidar.level, lidar.subject.as_deref()), (Level::Ok, Some("front")));
    assert!(lidar.message.contains("vlp-32c at 127.0.0.1: "), "{}", lidar.message);
    assert!(lidar.message.contains(" rpm, dual return"), "{}", lidar.message);
    for check in ["config", "udp_port", "stream"] {
        assert_eq!(found(&report, check).level, Level::Ok, "{report:#?}");
    }
    // How much is free is this machine's own; a disk with little left is a warning.
    assert_ne!(found(&report, "disk").level, Level::Fail, "{report:#?}");
    let text = bench.run(&["doctor", "--config", "rig.toml", "--listen", "300ms"]);
    assert!(text.code == 0 && text.stdout.contains("lidar front"), "{}", text.stdout);
}

#[test]
fn a_silent_lidar_is_told_with_what_to_look_at() {
    let port = free_port();
    let (code, report) = doctor(&bench(port), &[]);
    assert_eq!((code, report.healthy), (3, false));
    let lidar = found(&report, "lidar");
    assert_eq!(lidar.level, Level::Fail);
    assert_eq!(lidar.message, format!("nothing came to port {port} within 0.5 s"));
    assert!(lidar.remedy.as_ref().expect("a remedy").contains("firewall"));
}

#[test]
fn another_model_and_a_wrong_source_are_told_with_the_key_to_set() {
    let sensor = Speaking::start(Model::Vlp16, ReturnMode::Strongest, |_| {});
    let bench = bench(sensor.port);
    let lidar = |settings: &[&str]| {
        let finding = found(&doctor(&bench, settings).1, "lidar").clone();
        (finding.level, finding.message, finding.remedy.unwrap_or_default())
    };
    let (level, message, remedy) = lidar(&["--set", "lidar.model=vlp-32c"]);
    assert_eq!((level, message.as_str()), (Level::Fail, "127.0.0.1 is a vlp-16, the config says vlp-32c"));
    assert!(remedy.contains("set lidar.front.model=vlp-16"), "{remedy}");
    let (level, message, remedy) = lidar(&["--set", "lidar.source=10.1.2.3"]);
    assert_eq!(
        (level, message.as_str()),
        (Level::Fail, "packets come from 127.0.0.1 and not from its source 10.1.2.3")
    );
    assert!(remedy.contains("set lidar.front.source=127.0.0.1"), "{remedy}");
    assert_eq!(lidar(&["--set", "lidar.model=vlp-16", "--set", "lidar.source=127.0.0.1"]).0, Level::Ok);
}

#[test]
fn an_old_vlp16_that_calls_itself_hdl32e_is_known_by_its_period() {
    let sensor = Speaking::start(Model::Vlp16, ReturnMode::Strongest, |payload| payload[1205] = 0x21);
    let bench = bench(sensor.port);
    let (_, report) = doctor(&bench, &[]);
    let lidar = found(&report, "lidar");
    assert!(lidar.level == Level::Fail && lidar.message.contains("the period of vlp-16"), "{lidar:#?}");
    assert_eq!(found(&doctor(&bench, &["--set", "lidar.model=vlp-16"]).1, "lidar").level, Level::Ok);
}

#[test]
fn what_is_no_velodyne_is_not_taken_for_one() {
    let sensor = Speaking::start(Model::Vlp16, ReturnMode::Strongest, |payload| payload[1205] = 0x23);
    let (_, report) = doctor(&bench(sensor.port), &[]);
    let lidar = found(&report, "lidar");
    assert!(lidar.level == Level::Fail && lidar.message.contains("VLP-32A/B packets are not supported"), "{lidar:#?}");
}

#[test]
fn a_port_that_is_taken_is_told_with_the_way_to_its_owner() {
    let owner = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).expect("a free port");
    let port = owner.local_addr().expect("bound").port();
    let bench = bench(port);
    let (code, report) = doctor(&bench, &[]);
    let finding = found(&report, "udp_port");
    assert_eq!((code, finding.level, finding.subject.clone()), (3, Level::Fail, Some(port.to_string())));
    assert!(finding.remedy.as_ref().expect("a remedy").contains(&format!("'sport = :{port}'")), "{finding:#?}");
    let devices: DevicesReport = bench.run(&["devices", "--config", "rig.toml", "--json", "--listen", "10ms"]).json();
    assert!(devices.warnings.iter().any(|warning| warning.contains("in use")), "{devices:#?}");
}

#[test]
fn kinects_turntable_and_folder_that_are_not_there_are_told() {
    let bench = bench(0);
    bench.file("folder.txt", "");
    let settings = ["--set", "kinect=[{}]", "--set", "turntable.port=/dev/no-such-port", "--folder", "folder.txt"];
    let (code, report) = doctor(&bench, &settings);
    assert_eq!(code, 3);
    assert_eq!((found(&report, "kinect").level, found(&report, "turntable").level), (Level::Fail, Level::Fail));
    if cfg!(not(feature = "kinect-usb")) {
        assert!(found(&report, "kinect").message.contains("no kinect-usb"));
    }
    assert_eq!(found(&report, "disk").level, Level::Fail, "a file is no folder");
    // Any free port: there is nothing to listen to, which is told and no failure.
    assert_eq!(found(&report, "lidar").level, Level::Warn);
}

#[test]
fn a_config_that_cannot_be_used_is_exit_code_2_and_its_problems_are_findings() {
    let bench = bench(2368);
    let done = bench.run(&["doctor", "--config", "rig.toml", "--json", "--set", "lidar.model=vlp16"]);
    let report: DoctorReport = done.json();
    assert_eq!((done.code, report.healthy), (2, false));
    let finding = found(&report, "config");
    assert_eq!(finding.subject.as_deref(), Some("lidar.front.model"));
    assert!(finding.message.contains("vlp16") && done.stderr.contains("vlp16"), "{}", done.stderr);
}

#[test]
fn devices_lists_the_lidars_that_are_heard_and_this_machines_interfaces() {
    let sensor = Speaking::start(Model::Vlp16HiRes, ReturnMode::Last, |_| {});
    let bench = bench(sensor.port);
    let done = bench.run(&["devices", "--config", "rig.toml", "--json", "--listen", "500ms"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: DevicesReport = done.json();
    let [lidar] = report.lidars.as_slice() else { panic!("one LiDAR: {report:#?}") };
    assert_eq!((lidar.port, lidar.address.as_str()), (sensor.port, "127.0.0.1"));
    assert_eq!((lidar.model.as_deref(), lidar.return_mode.as_deref()), (Some("vlp-16-hi-res"), Some("last")));
    assert!(lidar.data_packets > 1 && lidar.rpm.is_some() && lidar.refusal.is_none(), "{lidar:#?}");
    let loopback = report.interfaces.iter().find(|interface| interface.loopback).expect("every machine has it");
    assert!(loopback.addresses.contains(&"127.0.0.1/8".to_owned()), "{loopback:#?}");
    let text = bench.run(&["devices", "--config", "rig.toml", "--listen", "300ms"]).stdout;
    assert!(text.contains("127.0.0.1 on port") && text.contains("vlp-16-hi-res"), "{text}");
}

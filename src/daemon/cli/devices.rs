//! `tumbled devices`: what is plugged into this machine, and which LiDARs speak to it.

use std::path::Path;
use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::live::SourceWarning;
use tumbled_io::machine::{
    self, Interface, KinectFinding, KinectPart, KinectUsb, SerialAccess, SerialPort, camera_findings,
};

use super::{ConfigArgs, Failure, Outcome, output, quantity};
use crate::decoding::listening::{HeardPort, HeardPorts, Listening, Sender};

/// What `devices` is asked for.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  tumbled devices\n  tumbled devices --listen 5s --set lidar.port=2369 --json\n\n\
    LiDARs are listened for on the ports of the config's [[lidar]]; without a config on 2368 and 8308.")]
pub struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// How long to listen for LiDARs.
    #[arg(long, value_parser = quantity::duration, value_name = "TIME", default_value = "2s")]
    listen: Duration,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// What is there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled devices --json")]
pub struct DevicesReport {
    /// Serial adapters, by device name.
    pub serial_ports: Vec<SerialReport>,
    /// Parts of Kinects on the USB, by their place.
    pub kinects: Vec<KinectReport>,
    /// Network interfaces, by name.
    pub interfaces: Vec<InterfaceReport>,
    /// Who sends Velodyne packets, by port and address.
    pub lidars: Vec<HeardLidar>,
    /// For how long it was listened, seconds.
    pub listened_s: f64,
    /// What could not be looked at, and why.
    pub warnings: Vec<String>,
}

/// A serial adapter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SerialReport {
    /// The device file, e.g. `/dev/ttyUSB0`: its number depends on the order of plugging in.
    pub device: String,
    /// Names that stay the same wherever it is plugged in: what a config should name.
    pub stable: Vec<String>,
    /// Its adapter's USB serial number, which a config may name as `usb:NUMBER`; null: it has none.
    pub usb_serial: Option<String>,
    /// What keeps it from being used, or from being used well, and what to do about it.
    pub troubles: Vec<String>,
}

/// A part of a Kinect.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KinectReport {
    /// Its place on the bus: bus, port, port of the hub.
    pub place: String,
    /// camera, motor or audio.
    pub part: String,
    /// Vendor and product, e.g. `045e:02ae`.
    pub id: String,
    /// Its serial number; null: it has none.
    pub serial: Option<String>,
    /// Of a camera: the Kinect's model. Null of other parts.
    pub model: Option<String>,
    /// Of a camera: what keeps it from being read, and what to do about it.
    pub troubles: Vec<String>,
}

/// A network interface.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InterfaceReport {
    /// Its name.
    pub name: String,
    /// It is switched on and has a carrier.
    pub running: bool,
    /// It leads to this machine alone.
    pub loopback: bool,
    /// Its addresses with the lengths of their networks' prefixes, e.g. `192.168.1.5/24`.
    pub addresses: Vec<String>,
}

/// Someone who sends Velodyne packets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeardLidar {
    /// The UDP port they came to.
    pub port: u16,
    /// Who sent them.
    pub address: String,
    /// The model; null: none that this program reads, or position packets alone.
    pub model: Option<String>,
    /// Data packets.
    pub data_packets: u64,
    /// Position packets.
    pub position_packets: u64,
    /// Data packets a second.
    pub packets_per_s: f64,
    /// How fast the head turns, turns a minute; null: too few packets to tell.
    pub rpm: Option<f64>,
    /// strongest, last or dual; null: the packets do not say it.
    pub return_mode: Option<String>,
    /// Why its packets would give no points; null: they would.
    pub refusal: Option<String>,
}

/// Looks and listens.
///
/// # Errors
/// Exit code 2: a config that cannot be used. 1: a port that fails while it is listened to.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = args.config.load()?;
    let heard = Listening::open(&loaded.config).listen(args.listen).map_err(Failure::failed)?;
    let report = report(Path::new("/"), &heard);
    output::report(&report, args.json, || text(&report))?;
    Ok(Outcome::Fine)
}

/// What was heard, with what lies below `root`.
fn report(root: &Path, heard: &HeardPorts) -> DevicesReport {
    let mut warnings: Vec<String> =
        heard.ports.iter().filter_map(|port| Some(port.error.as_ref()?.to_string())).collect();
    let interfaces = machine::interfaces().unwrap_or_else(|error| {
        warnings.push(format!("the network interfaces cannot be listed: {error}"));
        Vec::new()
    });
    let found = machine::kinect_findings(root, None).into_iter();
    let powerless = found.filter(|finding| matches!(finding, KinectFinding::NoCamera { other_parts: true }));
    warnings.extend(powerless.map(|finding| finding.to_string()));
    DevicesReport {
        serial_ports: machine::serial_ports(root).iter().map(|port| serial(root, port)).collect(),
        kinects: machine::kinects(root).iter().map(|part| kinect(root, part)).collect(),
        interfaces: interfaces.iter().map(interface).collect(),
        lidars: heard.ports.iter().flat_map(|port| lidars(port, heard.time)).collect(),
        listened_s: heard.time.as_secs_f64(),
        warnings,
    }
}

fn serial(root: &Path, port: &SerialPort) -> SerialReport {
    let stable = port.stable.iter().map(|name| name.display().to_string()).collect();
    let usb_serial = machine::usb_serial(root, &port.device);
    SerialReport { device: port.device.display().to_string(), stable, usb_serial, troubles: troubles(root, port) }
}

fn troubles(root: &Path, port: &SerialPort) -> Vec<String> {
    let device = root.join(port.device.strip_prefix("/").unwrap_or(&port.device));
    let forbidden = machine::serial_access(&device) == SerialAccess::Forbidden;
    let holders = machine::serial_holders(root, &port.device);
    let slow = machine::latency_timer_ms(root, &port.device).filter(|ms| *ms > 1);
    let troubles = [
        forbidden.then(|| "not for this user: `usermod -aG dialout USER` and log in anew".to_owned()),
        (!holders.is_empty()).then(|| format!("in use{}", machine::in_use_by(&holders))),
        slow.map(|ms| SourceWarning::SlowSerialAdapter { ms }.to_string()),
    ];
    troubles.into_iter().flatten().collect()
}

fn kinect(root: &Path, usb: &KinectUsb) -> KinectReport {
    let (place, id, serial) = (usb.place.clone(), usb.id.clone(), usb.serial.clone());
    let model = usb.model().map(|model| model.name().to_owned());
    let found = if usb.part == KinectPart::Camera { camera_findings(root, usb) } else { Vec::new() };
    let troubles = found.iter().map(ToString::to_string).collect();
    KinectReport { place, part: usb.part.name().to_owned(), id, serial, model, troubles }
}

fn interface(interface: &Interface) -> InterfaceReport {
    InterfaceReport {
        name: interface.name.clone(),
        running: interface.running,
        loopback: interface.loopback,
        addresses: interface.networks.iter().map(ToString::to_string).collect(),
    }
}

/// Senders of nothing that looks like a Velodyne's are left out.
fn lidars(port: &HeardPort, time: Duration) -> impl Iterator<Item = HeardLidar> {
    let velodyne = port.senders.iter().filter(|(_, sender)| sender.data_packets + sender.position_packets > 0);
    velodyne.map(move |(from, sender): (_, &Sender)| HeardLidar {
        port: port.number,
        address: from.to_string(),
        model: sender.model().map(|model| model.to_string()),
        data_packets: sender.data_packets,
        position_packets: sender.position_packets,
        packets_per_s: sender.data_packets as f64 / time.as_secs_f64(),
        rpm: sender.rpm(),
        return_mode: sender.return_mode().map(|mode| mode.to_string()),
        refusal: sender.refusal().map(|refusal| refusal.to_string()),
    })
}

fn text(report: &DevicesReport) -> String {
    let mut text = String::new();
    let mut block = |heading: &str, lines: Vec<String>, none: &str| {
        text.push_str(&format!("{heading}\n"));
        let lines = if lines.is_empty() { vec![none.to_owned()] } else { lines };
        lines.iter().for_each(|line| text.push_str(&format!("  {line}\n")));
    };
    block("serial ports", report.serial_ports.iter().flat_map(serial_lines).collect(), "none");
    block("Kinects on the USB", report.kinects.iter().flat_map(kinect_lines).collect(), "none");
    let interface = |interface: &InterfaceReport| {
        let state = if interface.running { "" } else { ", not running" };
        let addresses =
            if interface.addresses.is_empty() { "no address".to_owned() } else { interface.addresses.join(", ") };
        format!("{}: {addresses}{state}", interface.name)
    };
    block("network interfaces", report.interfaces.iter().map(interface).collect(), "none");
    let heading = format!("LiDARs heard within {:.1} s", report.listened_s);
    block(&heading, report.lidars.iter().map(lidar_line).collect(), "none");
    for warning in &report.warnings {
        text.push_str(&format!("! {warning}\n"));
    }
    text
}

/// The part, and below it what is wrong with it.
fn kinect_lines(usb: &KinectReport) -> Vec<String> {
    let serial = usb.serial.as_ref().map_or_else(String::new, |serial| format!(", serial {serial}"));
    let model = usb.model.as_ref().map_or_else(String::new, |model| format!(", {model}"));
    let line = format!("{}: Kinect {} ({}){model}{serial}", usb.place, usb.part, usb.id);
    core::iter::once(line).chain(usb.troubles.iter().map(|trouble| format!("  ! {trouble}"))).collect()
}

/// The port's names, and below them what is wrong with it.
fn serial_lines(port: &SerialReport) -> Vec<String> {
    let number = port.usb_serial.as_ref().map(|number| format!("usb:{number}"));
    let names = core::iter::once(&port.device).chain(&port.stable).chain(&number);
    let line = names.map(String::as_str).collect::<Vec<_>>().join("  ");
    core::iter::once(line).chain(port.troubles.iter().map(|trouble| format!("  ! {trouble}"))).collect()
}

fn lidar_line(lidar: &HeardLidar) -> String {
    let mut line = format!("{} on port {}: ", lidar.address, lidar.port);
    if lidar.data_packets == 0 {
        line.push_str(&format!("{} position packets", lidar.position_packets));
        return line;
    }
    line.push_str(&format!("{}, {:.0} packets/s", lidar.model.as_deref().unwrap_or("?"), lidar.packets_per_s));
    if let Some(rpm) = lidar.rpm {
        line.push_str(&format!(", {rpm:.0} rpm"));
    }
    if let Some(mode) = &lidar.return_mode {
        line.push_str(&format!(", {mode} return"));
    }
    if let Some(refusal) = &lidar.refusal {
        line.push_str(&format!(" ({refusal})"));
    }
    line
}

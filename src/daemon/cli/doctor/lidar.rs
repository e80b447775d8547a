//! The LiDARs: their ports, and what is heard on them.

use std::net::{IpAddr, Ipv4Addr};

use tumbled_io::live::SourceError;
use tumbled_io::machine::Interface;
use tumbled_velodyne::Model;

use super::report::Finding;
use crate::config::{Config, LidarConfig};
use crate::decoding::lidar::forced_model;
use crate::decoding::listening::{HeardPort, HeardPorts, Sender};

/// Where a Velodyne is when it leaves the factory.
const FACTORY_ADDRESS: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 168, 1, 201));

/// Every port, then every LiDAR.
pub(super) fn check(config: &Config, heard: &HeardPorts, interfaces: &[Interface]) -> Vec<Finding> {
    let mut findings: Vec<Finding> = heard.ports.iter().map(port).collect();
    for lidar in &config.lidars {
        findings.extend(one_lidar(lidar, heard, interfaces).into_iter().map(|finding| finding.of(&lidar.id)));
    }
    findings
}

fn port(port: &HeardPort) -> Finding {
    let finding = match &port.error {
        None => Finding::ok("udp_port", "free"),
        Some(SourceError::PortInUse { port }) => Finding::fail(
            "udp_port",
            "in use",
            format!("`ss -ulpn 'sport = :{port}'` shows by whom (a running tumbled?): end it, or set another port"),
        ),
        Some(error) => Finding::fail("udp_port", error.to_string(), "choose a port of 1024 or more"),
    };
    finding.of(port.number)
}

fn one_lidar(lidar: &LidarConfig, heard: &HeardPorts, interfaces: &[Interface]) -> Vec<Finding> {
    if lidar.port == 0 {
        let message = "its port is 0, any free one: nothing can be listened to before a session has chosen it";
        return vec![Finding::warn("lidar", message, format!("set lidar.{}.port to the sensor's", lidar.id))];
    }
    let Some(port) = heard.port(lidar.port).filter(|port| port.error.is_none()) else {
        return vec![Finding::warn("lidar", "not looked for: its port cannot be listened to", "see the port above")];
    };
    let mine = |from: &IpAddr| lidar.source.is_none_or(|source| source.to_canonical() == *from);
    let speaking = || port.senders.iter().filter(|(_, sender)| sender.data_packets > 0);
    let senders: Vec<(&IpAddr, &Sender)> = speaking().filter(|(from, _)| mine(from)).collect();
    match senders.as_slice() {
        [] => vec![silent(lidar, heard, port, interfaces)],
        [(from, sender)] => speaks(lidar, **from, sender, heard),
        several => {
            let list: Vec<String> =
                several.iter().map(|(from, sender)| format!("{from} ({})", rate(sender, heard))).collect();
            let remedy = format!("set lidar.{}.source to the address of the one that is meant", lidar.id);
            vec![Finding::fail(
                "lidar",
                format!("several sensors send to port {}: {}", lidar.port, list.join(", ")),
                remedy,
            )]
        }
    }
}

/// Nothing was heard of it: filtered out, no Velodyne, or silence.
fn silent(lidar: &LidarConfig, heard: &HeardPorts, port: &HeardPort, interfaces: &[Interface]) -> Finding {
    let (id, number) = (&lidar.id, lidar.port);
    let others: Vec<(&IpAddr, &Sender)> = port.senders.iter().filter(|(_, sender)| sender.data_packets > 0).collect();
    if let (Some(source), [(from, _), ..]) = (lidar.source, others.as_slice()) {
        let message = format!("packets come from {from} and not from its source {source}");
        return Finding::fail(
            "lidar",
            message,
            format!("set lidar.{id}.source={from}, or the sensor's address to {source}"),
        );
    }
    if let Some((from, sender)) = port.senders.iter().find(|(_, sender)| sender.foreign + sender.position_packets > 0) {
        let count = sender.foreign + sender.position_packets;
        let message = format!("{count} datagrams from {from} on port {number}, none of them a Velodyne's data packet");
        return Finding::fail("lidar", message, "point the sensor's data to this port and other programs elsewhere");
    }
    let message = format!("nothing came to port {number} within {:.1} s", heard.time.as_secs_f64());
    let mut remedy = format!(
        "see that it turns, that its destination (its web page: host, data port) is this machine or broadcast and port \
         {number}, and that no firewall drops UDP {number}"
    );
    let address = lidar.source.unwrap_or(FACTORY_ADDRESS);
    let reached = interfaces.iter().any(|interface| {
        !interface.loopback && interface.running && interface.networks.iter().any(|network| network.contains(address))
    });
    if !reached && !address.is_loopback() {
        let whose = if lidar.source.is_some() { "its address" } else { "a Velodyne's address as delivered" };
        remedy.push_str(&format!(
            "; no running interface of this machine is in the network of {address}, {whose}: \
             `ip address add 192.168.1.100/24 dev INTERFACE` gives it one there"
        ));
    }
    Finding::fail("lidar", message, remedy)
}

fn speaks(lidar: &LidarConfig, from: IpAddr, sender: &Sender, heard: &HeardPorts) -> Vec<Finding> {
    let id = &lidar.id;
    let Some(found) = sender.model() else {
        let why = sender.refusal().map_or_else(|| "no packet could be read".to_owned(), |refusal| refusal.to_string());
        let message = format!("{from} sends {}, but: {why}", rate(sender, heard));
        return vec![Finding::fail("lidar", message, "this program reads no such sensor")];
    };
    let mut findings = vec![match (forced_model(lidar.model), sender.period_mismatch()) {
        (Some(wanted), _) if wanted != found => Finding::fail(
            "lidar",
            format!("{from} is a {found}, the config says {wanted}"),
            format!("set lidar.{id}.model={found} or auto, or connect the {wanted}"),
        ),
        // Old firmware names another model than it is; what is left to `auto` would be decoded as that.
        (None, Some(mismatch)) => Finding::fail("lidar", mismatch.to_string(), format!("set lidar.{id}.model={found}")),
        _ => Finding::ok("lidar", description(found, from, sender, heard)),
    }];
    let positions = |port: &HeardPort| port.senders.values().any(|sender| sender.position_packets > 0);
    let position_port = heard.port(lidar.position_port).filter(|port| port.error.is_none());
    if found != Model::Hdl64e && position_port.is_some_and(|port| !positions(port)) {
        let message = format!("no position packets on port {}: its PPS and UTC are unknown", lidar.position_port);
        let remedy = format!("set the sensor's telemetry port to {}, or lidar.{id}.position_port", lidar.position_port);
        findings.push(Finding::warn("lidar", message, remedy));
    }
    if sender.foreign > 0 {
        let message = format!("{} datagrams of {from} are no Velodyne's", sender.foreign);
        findings.push(Finding::warn("lidar", message, "another program on that address uses the sensor's port"));
    }
    findings
}

/// `vlp-32c at 192.168.1.201: 1507 packets/s, 600 rpm, strongest return`.
fn description(model: Model, from: IpAddr, sender: &Sender, heard: &HeardPorts) -> String {
    let rpm = sender.rpm().map_or_else(String::new, |rpm| format!(", {rpm:.0} rpm"));
    let mode = sender.return_mode().map_or_else(String::new, |mode| format!(", {mode} return"));
    format!("{model} at {from}: {}{rpm}{mode}", rate(sender, heard))
}

fn rate(sender: &Sender, heard: &HeardPorts) -> String {
    format!("{:.0} packets/s", sender.data_packets as f64 / heard.time.as_secs_f64())
}

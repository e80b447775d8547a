//! Rules between sensors: who listens where, and which camera is which.

use std::net::IpAddr;

use super::check::Rules;
use super::raw::{RawKinect, RawLidar};
use super::tree::{Step, element_path};

/// A port a LiDAR listens on.
struct Listener<'a> {
    lidar: usize,
    key: &'static str,
    port: u16,
    id: &'a str,
    source: Option<IpAddr>,
}

impl Listener<'_> {
    fn path(&self) -> Vec<Step> {
        element_path("lidar", self.lidar, &[self.key])
    }

    /// Whether a packet could belong to both: the same port, and no two different senders to tell them apart.
    fn clashes_with(&self, other: &Listener<'_>) -> bool {
        let told_apart = self.lidar != other.lidar
            && matches!((self.source, other.source), (Some(mine), Some(theirs)) if mine != theirs);
        self.port == other.port && self.port != 0 && !told_apart
    }
}

/// No packet may belong to two listeners. Port 0 is any free port, so it never clashes.
pub(super) fn ports(rules: &mut Rules<'_>, lidars: &[RawLidar]) {
    let mut listeners: Vec<Listener<'_>> = Vec::new();
    for (lidar, raw) in lidars.iter().enumerate() {
        let source = raw.source.as_deref().and_then(|text| text.parse().ok());
        for (key, port) in [("port", raw.port), ("position_port", raw.position_port)] {
            let listener = Listener { lidar, key, port, id: &raw.id, source };
            let sound = rules.sound(&listener.path()) && rules.sound(&element_path("lidar", lidar, &["source"]));
            if !sound {
                continue;
            }
            if let Some(other) = listeners.iter().find(|other| listener.clashes_with(other)) {
                let (message, help) = clash(&listener, other);
                rules.broken(&listener.path(), message, help);
            }
            listeners.push(listener);
        }
    }
}

fn clash(listener: &Listener<'_>, other: &Listener<'_>) -> (String, String) {
    let Listener { key, port, id, .. } = listener;
    if listener.lidar == other.lidar {
        let message = format!("`{key}` and `{}` of LiDAR `{id}` are both {port}", other.key);
        return (message, "give them two ports: a Velodyne sends data to 2368 and positions to 8308".to_owned());
    }
    let message = format!("`{key}` of LiDAR `{id}` is {port}, and so is `{}` of `{}`", other.key, other.id);
    let help = "give each its own port, or tell them apart by `source`, the sensor's IP address, in both".to_owned();
    (message, help)
}

/// Several cameras need their serial numbers: USB order is not an identity.
pub(super) fn serials(rules: &mut Rules<'_>, kinects: &[RawKinect]) {
    let sound = |rules: &Rules<'_>, index: usize| rules.sound(&element_path("kinect", index, &["serial"]));
    for (index, kinect) in kinects.iter().enumerate() {
        let path = element_path("kinect", index, &["serial"]);
        if kinects.len() < 2 || !sound(rules, index) {
            continue;
        }
        if kinect.serial.is_empty() {
            let message =
                format!("`serial` of Kinect `{}` is empty, and there are {} Kinects", kinect.id, kinects.len());
            rules.broken(&path, message, "an empty serial means the only Kinect: give each its serial number");
            continue;
        }
        let earlier =
            kinects.iter().take(index).enumerate().find(|(i, other)| sound(rules, *i) && other.serial == kinect.serial);
        if let Some((_, other)) = earlier {
            let message =
                format!("Kinects `{}` and `{}` have the same serial \"{}\"", other.id, kinect.id, kinect.serial);
            rules.broken(&path, message, "two cameras never share one: correct it");
        }
    }
}

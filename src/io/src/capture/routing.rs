//! Which bytes of a capture belong to which sensor of the config.

use std::net::IpAddr;
use std::path::Path;
use tumbled_model::SensorId;

/// How to find one LiDAR's packets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LidarRoute {
    /// The sensor's name.
    pub id: SensorId,
    /// Destination UDP port of its data packets (manual: 2368).
    pub port: u16,
    /// Destination UDP port of its position packets (manual: 8308).
    pub position_port: u16,
    /// Only datagrams from this address; `None`: from any.
    pub source: Option<IpAddr>,
    /// Topic of its `VelodyneScan` messages in ROS 2 bags; `None`: by order of names, see [`Routing`].
    pub topic: Option<String>,
}

/// How to find one Kinect's depth frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KinectRoute {
    /// The sensor's name.
    pub id: SensorId,
    /// Topic of its depth images in ROS 2 bags; `None`: by order of names, see [`Routing`].
    pub topic: Option<String>,
}

/// Which bytes of a capture belong to which sensor.
///
/// * UDP: the first LiDAR whose port and source match has the datagram. Source ports are not looked at: some
///   recordings have 443 there.
/// * Bags: a route with a topic has exactly that one; the routes without take the topics that are left, both in
///   order (routes as listed, topics by name).
/// * Folders and single frames: the Kinect whose id is the name of the folder or file stem, else the first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Routing {
    /// The LiDARs, in the config's order.
    pub lidars: Vec<LidarRoute>,
    /// The Kinects, in the config's order.
    pub kinects: Vec<KinectRoute>,
}

impl Default for Routing {
    /// One LiDAR `front` on 2368 and 8308, one Kinect `near`.
    fn default() -> Self {
        Self {
            lidars: vec![LidarRoute {
                id: SensorId::from("front"),
                port: 2368,
                position_port: 8308,
                source: None,
                topic: None,
            }],
            kinects: vec![KinectRoute { id: SensorId::from("near"), topic: None }],
        }
    }
}

/// Where a datagram goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Destination<'a> {
    /// To this LiDAR's data port.
    Data(&'a SensorId),
    /// To this LiDAR's position port.
    Position(&'a SensorId),
    /// To a LiDAR's port, but from an address that its `source` excludes.
    OtherSource,
    /// To a port no LiDAR has.
    OtherPort,
}

impl Routing {
    /// The LiDAR a datagram belongs to.
    pub(crate) fn datagram(&self, source: IpAddr, port: u16) -> Destination<'_> {
        let mut right_port = false;
        for lidar in &self.lidars {
            if port != lidar.port && port != lidar.position_port {
                continue;
            }
            right_port = true;
            if lidar.source.is_some_and(|wanted| wanted != source) {
                continue;
            }
            let to_data = port == lidar.port;
            return if to_data { Destination::Data(&lidar.id) } else { Destination::Position(&lidar.id) };
        }
        if right_port { Destination::OtherSource } else { Destination::OtherPort }
    }

    /// The Kinect whose frames a folder or file holds.
    pub(crate) fn kinect_of(&self, path: &Path) -> Option<&SensorId> {
        let named = |name: Option<&std::ffi::OsStr>| {
            let name = name.and_then(|name| name.to_str())?;
            self.kinects.iter().find(|kinect| kinect.id.as_str() == name)
        };
        named(path.file_name()).or_else(|| named(path.file_stem())).or(self.kinects.first()).map(|kinect| &kinect.id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_lidars_on_one_port_are_told_apart_by_their_address() {
        let mut routing = Routing::default();
        let front = routing.lidars[0].clone();
        let (a, b, c) = (IpAddr::from([10, 0, 0, 1]), IpAddr::from([10, 0, 0, 2]), IpAddr::from([10, 0, 0, 3]));
        routing.lidars[0].source = Some(a);
        routing.lidars.push(LidarRoute { id: SensorId::from("rear"), source: Some(b), ..front });
        assert_eq!(routing.datagram(a, 2368), Destination::Data(&SensorId::from("front")));
        assert_eq!(routing.datagram(b, 8308), Destination::Position(&SensorId::from("rear")));
        assert_eq!(routing.datagram(c, 2368), Destination::OtherSource);
        assert_eq!(routing.datagram(a, 2369), Destination::OtherPort);
    }

    #[test]
    fn a_folder_named_like_a_kinect_belongs_to_it_and_any_other_to_the_first() {
        let mut routing = Routing::default();
        routing.kinects.push(KinectRoute { id: SensorId::from("far"), topic: None });
        assert_eq!(routing.kinect_of(Path::new("session/far")), Some(&SensorId::from("far")));
        assert_eq!(routing.kinect_of(Path::new("session/far.png")), Some(&SensorId::from("far")));
        assert_eq!(routing.kinect_of(Path::new("session/depth")), Some(&SensorId::from("near")));
    }
}

//! Real captures, which lie beside the repository where people have them.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use tumbled_io::capture::{self, LidarRoute, Routing};
use tumbled_model::{Body, Event, Span};
use tumbled_velodyne::wire::POSITION_LEN;

use super::repository;

/// The rig of the real sequence `kinect/seq7`: one camera, whose scene is the target.
pub(crate) const HAND_HELD: &str = r#"
lidar = []
[target]
search = "everything"
[[kinect]]
id = "near"
intrinsics = { fx = 585.0, fy = 585.0, cx = 320.0, cy = 240.0 }
t_rig_kinect = { translation_m = [0.0, 0.0, 0.0], rotation_xyzw = [0.0, 0.0, 0.0, 1.0] }
"#;

/// The path of a real capture; `None` and a printed line when it is not there.
pub(crate) fn real(name: &str) -> Option<PathBuf> {
    let path = repository().join("../shared/data").join(name);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: ../shared/data/{name} is not there");
    None
}

/// A capture's LiDAR packets with their times, as a sender takes them: data packets to one address, position packets to
/// another.
pub(crate) fn datagrams(capture: &Path, data: SocketAddr, position: SocketAddr) -> Vec<(Span, SocketAddr, Bytes)> {
    let lidar = LidarRoute { id: "front".into(), port: 2368, position_port: 8308, source: None, topic: None };
    let routing = Routing { lidars: vec![lidar], kinects: Vec::new() };
    let merged = capture::merge(capture::open_all(&[capture], &routing).expect("opens")).expect("merges");
    let datagram = |event: Event| match event.body {
        Body::LidarPacket { bytes, .. } => {
            let to = if bytes.len() == POSITION_LEN { position } else { data };
            Some((Span(event.arrived.0), to, bytes))
        }
        _ => None,
    };
    merged.filter_map(|event| datagram(event.expect("reads"))).collect()
}

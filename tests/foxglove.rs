//! The bridge to Foxglove and Lichtblick, seen by a plain WebSocket client.

use std::collections::BTreeSet;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use foxglove::Decode;
use foxglove::messages::{FrameTransforms, Log, PointCloud, PoseInFrame, RawImage, SceneUpdate};
use serde_json::{Value, json};
use tumbled::foxglove::{FoxgloveBridge, FoxgloveConfig, FoxgloveError, SensorPose, VIEW_POINTS};
use tumbled::stream::{CloudKind, CloudView, EventLine, HealthLine, StateLine, StreamOrigin};
use tumbled_core::{Gravity, Notice, NoticeKind};
use tumbled_model::{RigNs, SensorId, UnixNs};
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

use crate::support::Workbench;
use crate::support::daemon::{Daemon, FREE_PORTS};
use crate::support::stream::{hello, wait_until};

const UNIX: UnixNs = UnixNs(1_795_341_600_250_000_000);

fn bridge() -> FoxgloveBridge {
    let config = FoxgloveConfig { address: ([127, 0, 0, 1], 0).into(), ..FoxgloveConfig::default() };
    let pose = SensorPose {
        sensor: SensorId::from("front"),
        translation_m: [0.0, 0.3, 0.0],
        rotation_xyzw: [-0.5, 0.5, -0.5, 0.5],
    };
    FoxgloveBridge::start(&config, &hello(), vec![pose]).expect("starts")
}

struct Viewer {
    socket: WebSocket<TcpStream>,
    channels: Vec<Value>,
}

fn handshake(address: SocketAddr, protocol: &'static str) -> Result<WebSocket<TcpStream>, Box<tungstenite::Error>> {
    let stream = TcpStream::connect(address).expect("connects");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
    let mut request = format!("ws://{address}/").into_client_request().expect("a request");
    request.headers_mut().insert("Sec-WebSocket-Protocol", HeaderValue::from_static(protocol));
    match tungstenite::client::client(request, stream) {
        Ok((socket, _)) => Ok(socket),
        Err(tungstenite::HandshakeError::Failure(error)) => Err(Box::new(error)),
        Err(tungstenite::HandshakeError::Interrupted(_)) => panic!("no answer to the handshake"),
    }
}

impl Viewer {
    /// Connected, with what the server told first.
    fn connect(bridge: &FoxgloveBridge) -> (Self, Value) {
        Self::connect_to(bridge.address())
    }

    fn connect_to(address: SocketAddr) -> (Self, Value) {
        let socket = handshake(address, "foxglove.sdk.v1").expect("accepted");
        let mut viewer = Self { socket, channels: Vec::new() };
        let info = viewer.text();
        let advertised = viewer.text();
        assert_eq!(advertised["op"], "advertise");
        viewer.channels = advertised["channels"].as_array().expect("channels").clone();
        (viewer, info)
    }

    fn text(&mut self) -> Value {
        match self.socket.read().expect("a message") {
            Message::Text(text) => serde_json::from_str(&text).expect("JSON"),
            other => panic!("a text was expected, not {other:?}"),
        }
    }

    fn channel(&self, topic: &str) -> &Value {
        self.channels.iter().find(|channel| channel["topic"] == topic).unwrap_or_else(|| panic!("no {topic}"))
    }

    /// Subscribes; messages then carry `id`.
    fn subscribe(&mut self, topic: &str, id: u32) {
        let channel = self.channel(topic)["id"].clone();
        let request = json!({ "op": "subscribe", "subscriptions": [{ "id": id, "channelId": channel }] });
        self.socket.send(Message::text(request.to_string())).expect("sends");
    }

    /// The next message's subscription, its stamp and its payload. Its head: opcode 1, subscription u32, stamp u64. Channels
    /// that are advertised meanwhile are added.
    fn data(&mut self) -> (u32, u64, Vec<u8>) {
        let message = loop {
            match self.socket.read().expect("a message") {
                Message::Binary(bytes) => break bytes,
                Message::Text(text) => {
                    let told: Value = serde_json::from_str(&text).expect("JSON");
                    if told["op"] == "advertise" {
                        self.channels.extend(told["channels"].as_array().expect("channels").iter().cloned());
                    }
                }
                Message::Ping(_) | Message::Pong(_) => {}
                other => panic!("data were expected, not {other:?}"),
            }
        };
        assert_eq!(message[0], 1);
        let id = u32::from_le_bytes(message[1..5].try_into().expect("4 bytes"));
        let stamp = u64::from_le_bytes(message[5..13].try_into().expect("8 bytes"));
        (id, stamp, message[13..].to_vec())
    }
}

/// Points along x, one a metre, at y = 1 m and z = 2 m.
struct Row {
    sensor: SensorId,
    columns: [Vec<f32>; 3],
}

impl Row {
    fn of(points: usize) -> Self {
        let x = (0..points).map(|i| i as f32).collect();
        Self { sensor: SensorId::from("front"), columns: [x, vec![1.0; points], vec![2.0; points]] }
    }

    fn view(&self) -> CloudView<'_> {
        let ([x, y, z], sensor) = (&self.columns, &self.sensor);
        let (kind, frame) = (CloudKind::Lidar, sensor.as_str());
        CloudView { sensor, kind, epoch: 1, t: RigNs(0), unix: UNIX, frame, x, y, z, intensity: None }
    }
}

#[test]
fn a_viewer_is_told_the_origin_and_the_channels_with_their_schemas() {
    let bridge = bridge();
    let (viewer, info) = Viewer::connect(&bridge);
    assert_eq!((&info["op"], &info["name"]), (&json!("serverInfo"), &json!("tumbled SIMULATED: lab")));
    let schemas = [
        ("/cloud/front", "protobuf", "foxglove.PointCloud"),
        ("/tf", "protobuf", "foxglove.FrameTransforms"),
        ("/log", "protobuf", "foxglove.Log"),
        ("/health", "json", "tumbled.Health"),
    ];
    for (topic, encoding, schema) in schemas {
        let channel = viewer.channel(topic);
        assert_eq!((&channel["encoding"], &channel["schemaName"]), (&json!(encoding), &json!(schema)), "{topic}");
    }
    assert_eq!(bridge.stop().viewers, 1);
}

#[test]
fn a_cloud_comes_to_who_subscribed_thinned_out_with_its_points() {
    let mut bridge = bridge();
    // 50 000 points, at most 20 000: every third, that is 16 667.
    let row = Row::of(50_000);
    let (mut viewer, _) = Viewer::connect(&bridge);
    assert!(!bridge.wants_cloud("front"));
    bridge.cloud(&row.view());
    assert_eq!(bridge.totals().clouds, 0, "nobody looks");
    viewer.subscribe("/cloud/front", 7);
    wait_until("the subscription is known", || bridge.wants_cloud("front"));
    bridge.cloud(&row.view());
    let (id, stamp, payload) = viewer.data();
    assert_eq!((id, stamp), (7, UNIX.0 as u64));
    let message = PointCloud::decode(payload.as_slice()).expect("a PointCloud");
    assert_eq!(message.data.len(), 16_667 * message.point_stride as usize);
    assert!(16_667 <= VIEW_POINTS && message.frame_id == "front");
    // The second point is the fourth of the cloud.
    assert_eq!(message.data[16..20], 3.0_f32.to_le_bytes());
}

#[test]
fn clouds_faster_than_ten_a_second_are_thinned_out_and_counted() {
    let mut bridge = bridge();
    let row = Row::of(1);
    let (mut viewer, _) = Viewer::connect(&bridge);
    viewer.subscribe("/cloud/front", 1);
    wait_until("the subscription is known", || bridge.wants_cloud("front"));
    let started = std::time::Instant::now();
    for _ in 0..50 {
        bridge.cloud(&row.view());
    }
    let most = 1 + started.elapsed().as_millis() as u64 / 100;
    let totals = bridge.totals();
    assert_eq!(totals.clouds + totals.thinned_out, 50);
    assert!((1..=most).contains(&totals.clouds), "{totals:?}");
}

#[test]
fn mounting_health_and_events_come_on_their_topics() {
    let mut bridge = bridge();
    let (mut viewer, _) = Viewer::connect(&bridge);
    for (id, topic) in ["/tf", "/health", "/log"].into_iter().enumerate() {
        viewer.subscribe(topic, id as u32);
    }
    // Subscriptions are carried out in order: the answer to a wrong one comes after them.
    viewer.socket.send(Message::text("?")).expect("sends");
    while viewer.text()["op"] != "status" {}
    bridge.health(&json!({ "class": "HEALTH", "level": "ok" }), UNIX.0);
    let notice = Notice {
        t: RigNs(0),
        sensor: None,
        gravity: Gravity::Warn,
        kind: NoticeKind::WallStep,
        message: "the wall clock stepped".to_owned(),
    };
    bridge.event(&EventLine::of_notice(StreamOrigin::Simulated, &notice, UNIX));
    let messages = [viewer.data(), viewer.data(), viewer.data()];
    assert_eq!(messages.each_ref().map(|(id, stamp, _)| (*id, *stamp)), [0, 1, 2].map(|id| (id, UNIX.0 as u64)));
    let tf = FrameTransforms::decode(messages[0].2.as_slice()).expect("FrameTransforms");
    let transform = &tf.transforms[0];
    assert_eq!((transform.parent_frame_id.as_str(), transform.child_frame_id.as_str()), ("rig", "front"));
    assert_eq!(transform.translation.as_ref().map(|t| [t.x, t.y, t.z]), Some([0.0, 0.3, 0.0]));
    assert_eq!(transform.rotation.as_ref().map(|r| [r.x, r.y, r.z, r.w]), Some([-0.5, 0.5, -0.5, 0.5]));
    let health: Value = serde_json::from_slice(&messages[1].2).expect("JSON");
    assert_eq!(health["level"], "ok");
    let log = Log::decode(messages[2].2.as_slice()).expect("a Log");
    assert_eq!((log.message.as_str(), log.name.as_str()), ("wall_step: the wall clock stepped", "rig"));
    assert_eq!(log.timestamp.map(|stamp| (stamp.sec(), stamp.nsec())), Some((1_795_341_600, 250_000_000)));
}

#[test]
fn a_viewer_of_the_old_protocol_is_refused_with_400() {
    let bridge = bridge();
    let Err(error) = handshake(bridge.address(), "foxglove.websocket.v1") else { panic!("it was accepted") };
    assert!(matches!(&*error, tungstenite::Error::Http(response) if response.status() == 400), "{error}");
}

#[test]
fn an_address_of_the_sixth_version_is_served_too() {
    let Ok(_) = TcpListener::bind("[::1]:0") else {
        println!("skipped: this machine has no IPv6");
        return;
    };
    let config = FoxgloveConfig { address: "[::1]:0".parse().expect("an address"), ..FoxgloveConfig::default() };
    let bridge = FoxgloveBridge::start(&config, &hello(), Vec::new()).expect("starts");
    let (_viewer, info) = Viewer::connect(&bridge);
    assert_eq!(info["op"], "serverInfo");
}

#[test]
fn a_port_that_is_taken_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("bound");
    let config = FoxgloveConfig { address, ..FoxgloveConfig::default() };
    let error = FoxgloveBridge::start(&config, &hello(), Vec::new()).expect_err("taken");
    assert!(matches!(error, FoxgloveError::Address { .. }) && error.to_string().contains(&address.to_string()));
}

/// Reads a message as its channel's schema says; panics where it is none. Tells whether it shows something: the first
/// crossing of a daemon that has just begun may hold a corner of it only.
fn check(topic: &str, schema: &str, payload: &[u8]) -> bool {
    let points = |cloud: &PointCloud| {
        let stride = cloud.point_stride as usize;
        assert_eq!(cloud.data.len() % stride, 0, "{topic}");
        let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().expect("4 bytes"));
        let ends: Vec<f32> = cloud.fields.iter().map(|field| field.offset as f32 + 4.0).collect();
        assert!(ends.iter().all(|end| *end <= stride as f32), "{topic}: fields beyond a point");
        cloud.data.chunks_exact(stride).map(|point| [0, 4, 8].map(|at| float(&point[at..at + 4]))).collect::<Vec<_>>()
    };
    match schema {
        "foxglove.PointCloud" => {
            let cloud = PointCloud::decode(payload).expect("a PointCloud");
            let points = points(&cloud);
            assert!(points.iter().flatten().all(|x| x.abs() < 200.0), "{topic}");
            return points.len() > 100;
        }
        "foxglove.FrameTransforms" => {
            let transforms = FrameTransforms::decode(payload).expect("FrameTransforms").transforms;
            assert!(!transforms.is_empty() && transforms.iter().all(|transform| transform.parent_frame_id == "rig"));
        }
        "foxglove.PoseInFrame" => {
            let pose = PoseInFrame::decode(payload).expect("a PoseInFrame").pose.expect("a pose");
            let place = pose.position.expect("a place");
            let from_where_it_stands = (place.x - 2.2).hypot(place.y).hypot(place.z);
            assert!(from_where_it_stands < 0.5, "{from_where_it_stands} m off");
        }
        "foxglove.RawImage" => {
            let image = RawImage::decode(payload).expect("a RawImage");
            assert_eq!(image.data.len(), (image.step * image.height) as usize);
            let depths = image.data.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]]));
            assert!(depths.filter(|depth| (1_500..2_500).contains(depth)).count() > 1_000, "no target in the image");
        }
        "foxglove.SceneUpdate" => {
            let update = SceneUpdate::decode(payload).expect("a SceneUpdate");
            let ends: usize = update.entities[0].lines.iter().map(|line| line.points.len()).sum();
            assert!(ends > 0 && ends.is_multiple_of(2), "{ends} ends of edges");
        }
        "foxglove.Log" => assert!(!Log::decode(payload).expect("a Log").message.is_empty()),
        "tumbled.State" => drop(serde_json::from_slice::<StateLine>(payload).expect("a STATE")),
        "tumbled.Health" => drop(serde_json::from_slice::<HealthLine>(payload).expect("a HEALTH")),
        other => panic!("{topic} has a schema that nobody reads here: {other}"),
    }
    true
}

#[test]
fn every_channel_of_a_running_daemon_gives_what_its_schema_says() {
    let bench = Workbench::new();
    let socket = bench.path("control.sock");
    let control = format!("stream.control={}", socket.display());
    let ports = ["--set", "stream.foxglove=127.0.0.1:0", "--set", &control];
    let mut daemon = Daemon::start(&bench, &[&["run", "--sim", "demo", "--json"], &FREE_PORTS[..], &ports].concat());
    daemon.once_said("Foxglove bridge");
    let line = daemon.said.lines().find(|line| line.contains("Foxglove bridge")).expect("a line");
    let address = line.split_whitespace().find_map(|word| word.strip_prefix("address=")).expect("an address");
    let (mut viewer, info) = Viewer::connect_to(address.parse().expect("an address"));
    assert!(info["name"].as_str().is_some_and(|name| name.starts_with("tumbled SIMULATED")), "{info}");
    let mut wanted: BTreeSet<u32> = BTreeSet::new();
    let began = Instant::now();
    let mut subscribed = 0;
    while subscribed < 10 || !wanted.is_empty() {
        assert!(began.elapsed() < Duration::from_secs(120), "nothing on {wanted:?} of {:#?}", viewer.channels);
        // Channels may come while it runs: a Kinect's image with its first frame.
        for n in subscribed..viewer.channels.len() {
            let topic = viewer.channels[n]["topic"].as_str().expect("a topic").to_owned();
            viewer.subscribe(&topic, n as u32);
            wanted.insert(n as u32);
        }
        subscribed = viewer.channels.len();
        // An event: somebody asks for the filter to begin anew.
        if wanted.len() == 1 && viewer.channels[*wanted.first().expect("one") as usize]["topic"] == "/log" {
            let done = bench.run(&["ctl", "marker", "seen", "--connect", socket.to_str().expect("a path")]);
            assert_eq!(done.code, 0, "{}", done.stderr);
        }
        let (id, stamp, payload) = viewer.data();
        let channel = &viewer.channels[id as usize];
        let text = |key: &str| channel[key].as_str().expect("a text").to_owned();
        assert!(stamp > 1_600_000_000_000_000_000, "{} is not on wall time", text("topic"));
        if check(&text("topic"), &text("schemaName"), &payload) {
            wanted.remove(&id);
        }
    }
    let topics: BTreeSet<&str> = viewer.channels.iter().filter_map(|channel| channel["topic"].as_str()).collect();
    let all = [
        "/cloud/front",
        "/cloud/near",
        "/contour",
        "/depth/near",
        "/health",
        "/log",
        "/model",
        "/pose",
        "/state",
        "/tf",
    ];
    assert_eq!(topics, BTreeSet::from(all));
    // The layout that comes with the documents shows topics that there are.
    let layout = include_str!("../docs/foxglove/layout.json");
    let layout: Value = serde_json::from_str(layout).expect("JSON");
    let mut named = BTreeSet::new();
    topics_of(&layout, &mut named);
    assert!(!named.is_empty() && named.iter().all(|topic| topics.contains(topic.as_str())), "{named:?}");
    daemon.signal("TERM");
    assert_eq!(daemon.finish().code, Some(0));
}

/// All texts and keys of a layout that begin with a slash, up to the first dot.
fn topics_of(value: &Value, found: &mut BTreeSet<String>) {
    let mut take = |text: &str| {
        if text.starts_with('/') {
            found.insert(text.split('.').next().unwrap_or_default().to_owned());
        }
    };
    match value {
        Value::String(text) => take(text),
        Value::Array(items) => items.iter().for_each(|item| topics_of(item, found)),
        Value::Object(entries) => {
            entries.keys().for_each(|key| take(key));
            entries.values().for_each(|item| topics_of(item, found));
        }
        _ => {}
    }
}

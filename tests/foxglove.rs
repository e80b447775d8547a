//! The bridge to Foxglove and Lichtblick, seen by a plain WebSocket client.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use foxglove::Decode;
use foxglove::messages::{FrameTransforms, Log, PointCloud};
use serde_json::{Value, json};
use tumbled::foxglove::{FoxgloveBridge, FoxgloveConfig, FoxgloveError, SensorPose, VIEW_POINTS};
use tumbled::stream::{CloudKind, CloudView, EventLine, StreamOrigin};
use tumbled_core::{Gravity, Notice, NoticeKind};
use tumbled_model::{RigNs, SensorId, UnixNs};
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

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
        let socket = handshake(bridge.address(), "foxglove.sdk.v1").expect("accepted");
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

    /// The next message's subscription, its stamp and its payload. Its head: opcode 1, subscription u32, stamp u64.
    fn data(&mut self) -> (u32, u64, Vec<u8>) {
        let message = loop {
            match self.socket.read().expect("a message") {
                Message::Binary(bytes) => break bytes,
                Message::Text(_) | Message::Ping(_) | Message::Pong(_) => {}
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

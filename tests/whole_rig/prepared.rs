//! A scene whose packets and frames are made before they are sent, for scenes that this machine cannot make in real time; like
//! [`feeder`](super::feeder), each at its sensor's real interface, in a process of its own.

use std::fs::File;
use std::io::Write;
use std::net::SocketAddr;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use fake_libusb_control::FrameWriter;
use tumbled::session::live::unix_at_zero;
use tumbled::simulation::scenes;
use tumbled::simulation::stage::EmulatedStage;
use tumbled_io::live::{SessionClock, StopToken, UdpSender};
use tumbled_model::{Body, RigNs, Span};
use tumbled_sim::session::Simulation;
use tumbled_velodyne::wire::POSITION_LEN;

use super::feeder::{Feeder, KINECT, MARK, OF_SCENE, STAGE};

/// So many seconds of the scene are made: then it is silent.
const SECONDS: &str = "TUMBLED_FEEDER_SECONDS";
/// Later than this a packet has missed its time.
const LATE: Span = Span(20_000_000);

/// Starts one and waits until all is made: 15 MB for each second.
pub(super) fn start(scene: &str, seconds: u64, kinect: &Path, stage: &Path) -> Feeder {
    Feeder::spawn("whole_rig::prepared::child", scene, kinect, stage, &[(SECONDS, seconds.to_string())])
}

#[test]
#[ignore = "a part of the other tests"]
fn child() {
    let text = |name: &str| std::env::var(name).ok();
    let (Some(kinect), Some(stage), Some(scene)) = (text(KINECT), text(STAGE), text(OF_SCENE)) else { return };
    let Some(seconds) = text(SECONDS).and_then(|seconds| seconds.parse::<i64>().ok()) else { return };
    let (kinect, stage) = (PathBuf::from(kinect), PathBuf::from(stage));
    // The sensors' own UTC is that of the making: some minutes before it is sent, as of a receiver without a fix.
    let scene = scenes::load_endless(&scene, unix_at_zero(&SessionClock::start_on_system())).expect("a scene");
    let pool = scenes::pool(0).expect("threads");
    let end = RigNs(seconds * 1_000_000_000);
    let events: Vec<_> =
        Simulation::new(Arc::new(scene.clone()), Some(pool)).take_while(|event| event.arrived < end).collect();
    println!("{MARK}ready");
    let mut orders = std::io::stdin().lines();
    let order = orders.next().expect("an order").expect("reads");
    let (data, position) = order.split_once(' ').expect("two addresses");
    let [data, position] = [data, position].map(|text| text.parse::<SocketAddr>().expect("an address"));

    let (clock, stop) = (SessionClock::start_on_system(), StopToken::new().expect("a descriptor"));
    let emulator = EmulatedStage::start(&scene, &clock, &stop).expect("a terminal");
    if let Some(emulator) = &emulator {
        symlink(emulator.path(), stage).expect("a new link");
    }
    let (frames, to_write) = channel();
    let writer = thread::spawn(move || {
        // Waits for the reader.
        let fifo = File::options().write(true).open(kinect).expect("the test made it");
        let mut writer = FrameWriter::new(fifo).expect("it is read");
        // Until the frames end, or nobody reads them any more.
        to_write
            .into_iter()
            .take_while(|(ticks, bytes): &(u32, bytes::Bytes)| writer.write(*ticks, bytes).is_ok())
            .count()
    });
    let socket = UdpSender::bind(SocketAddr::from(([127, 0, 0, 1], 0))).expect("a port");
    let mut late = 0_u64;
    for event in events {
        let left = event.arrived - clock.now().rig;
        thread::sleep(Duration::from_nanos(u64::try_from(left.0).unwrap_or(0)));
        late += u64::from(clock.now().rig - event.arrived > LATE);
        match event.body {
            Body::LidarPacket { bytes, .. } => {
                let to = if bytes.len() == POSITION_LEN { position } else { data };
                socket.datagram(to, &bytes).expect("loopback takes it");
            }
            Body::DepthFrame { ticks: Some(ticks), bytes, .. } => drop(frames.send((ticks.0, bytes))),
            _ => {}
        }
    }
    drop(frames);
    // The end of the input is the order to stop.
    assert!(orders.next().is_none(), "there is no other order");
    stop.stop();
    if let Some(emulator) = emulator {
        emulator.join();
    }
    let written = writer.join().expect("no panic");
    println!("{MARK}{{\"late\": {late}, \"frames\": {written}}}");
    std::io::stdout().flush().expect("writes");
}

//! Packets that are none, and packets of somebody else: cases 5 and 6.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

use bytes::Bytes;
use tumbled::cli::run::RunReport;
use tumbled_model::{Body, Event, RigNs};
use tumbled_sim::noise::Noise;

use super::session::{S, play, seconds};
use crate::support::Workbench;
use crate::support::daemon::{Daemon, packets};
use crate::support::rig::{PACKET_POINTS, lidar_core};

/// Random payloads in ten seconds, none a packet: a block's flag is right once in 2¹⁵ and there are twelve; 128 random
/// bytes are never text.
const RANDOM: u64 = 1_000_000;

/// Random bytes of the lengths that packets have or nearly have. All are pieces of one stretch of noise.
fn random_payloads() -> impl Iterator<Item = Event> {
    const STRETCH: usize = 1 << 22;
    let mut noise = Noise::new(5, "nonsense", 0);
    let stretch: Bytes = (0..STRETCH / 8).flat_map(|_| noise.bits().to_le_bytes()).collect::<Vec<u8>>().into();
    (0..RANDOM).map(move |n| {
        let length = [1_206, 1_206, 512, 0, 1, 1_205, 1_207, 1_500, 100][(n % 9) as usize];
        let at = (noise.bits() % (STRETCH - length) as u64) as usize;
        let body = Body::LidarPacket { sensor: "front".into(), bytes: stretch.slice(at..at + length) };
        Event { seq: n, arrived: RigNs((n * 10_000) as i64), body }
    })
}

#[test]
fn case_05_a_million_random_payloads_are_all_counted_in_few_words_and_the_next_packet_is_taken() {
    let good = seconds(2, true, false).map(|event| Event {
        seq: event.seq + RANDOM,
        arrived: RigNs(event.arrived.0 + 10 * S),
        body: event.body,
    });
    let packets = seconds(2, true, false).filter(|event| event.body.sensor().is_some()).count() as u64;
    let played = play(random_payloads().chain(good), "", lidar_core());
    let front = played.sensor("front");
    assert_eq!(front.received, RANDOM + packets);
    assert_eq!(front.malformed.values().sum::<u64>(), RANDOM);
    // Every ninth payload has 512 bytes, two of nine have 1206: of these the blocks make no sense, a few by a first flag
    // that is right, and one in 64 says it is of a product that is not decoded.
    let count = |kind: &str| front.malformed.get(kind).copied().unwrap_or_default();
    let blocks = count("block_flag") + count("azimuth") + count("unsupported_product");
    assert_eq!((count("sentence"), count("length"), blocks), (111_111, 666_666, 222_223), "{:?}", front.malformed);
    assert!(front.malformed.keys().eq(front.malformed_first.keys()), "{:?}", front.malformed_first);
    // From the first one on, all that is good is taken.
    assert_eq!((front.points.in_epochs, front.lost.total), (packets * PACKET_POINTS, 0));
    // Its line of health stays a line.
    for health in &played.health {
        let line = serde_json::to_string(health).expect("JSON");
        assert!(line.len() < 4_000, "{} bytes: {line}", line.len());
    }
    let told = played.notices.iter().filter(|notice| notice.kind == tumbled_core::NoticeKind::Malformed).count();
    assert!((10..=11).contains(&told), "the first of each second is told: {told}");
}

#[test]
fn case_06_packets_of_another_address_are_left_out_and_counted() {
    let bench = Workbench::new();
    bench.file(
        "rig.toml",
        "kinect = []\n[[lidar]]\nid = \"front\"\nsource = \"127.0.0.2\"\n\
         [stream]\ntcp = \"127.0.0.1:0\"\nunix = \"\"\nfoxglove = \"\"\n",
    );
    let daemon = Daemon::start(&bench, &["run", "--config", "rig.toml", "--json", "--min-free", "0"]);
    let bound = |address| UdpSocket::bind(SocketAddr::from((address, 0))).expect("loopback is 127/8");
    let (sensor, forger) = (bound(Ipv4Addr::new(127, 0, 0, 2)), bound(Ipv4Addr::LOCALHOST));
    let (genuine, forged) = (packets(600), vec![0xAB; 1_206]);
    for (n, packet) in genuine.iter().enumerate() {
        sensor.send_to(packet, daemon.data).expect("sends");
        // Noise, and packets just like the sensor's.
        forger.send_to(if n % 2 == 0 { &forged } else { packet }, daemon.data).expect("sends");
        std::thread::sleep(Duration::from_micros(300));
    }
    std::thread::sleep(Duration::from_millis(300));
    daemon.signal("TERM");
    let ended = daemon.finish();
    let report: RunReport = serde_json::from_str(&ended.report).expect("a report");
    let (source, front) = (&report.sources[0], &report.sensors[0]);
    assert_eq!((source.packets, source.other_source, source.lost_kernel), (600, 600, 0));
    assert_eq!((front.received, front.duplicates, front.malformed.len()), (600, 0, 0), "{front:?}");
    assert_eq!(front.points.in_epochs, 600 * PACKET_POINTS);
}

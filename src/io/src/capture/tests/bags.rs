//! ROS 2 bags in MCAP and SQLite.

use super::super::cdr::tests::{Writer as Cdr, image_message, scan_message};
use super::super::{CaptureKind, KinectRoute, LidarRoute, MessageFault, Place};
use super::*;
use rusqlite::{Connection, params};
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use tumbled_model::DepthEncoding;

pub(super) const SCAN: &str = "velodyne_msgs/msg/VelodyneScan";
const IMAGE: &str = "sensor_msgs/msg/Image";

/// A message for a bag: topic, type, receive time, bytes.
pub(super) type Posted<'a> = (&'a str, &'a str, i64, Vec<u8>);

pub(super) fn mcap_bag(compression: Option<mcap::Compression>, messages: &[Posted<'_>]) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(compression).chunk_size(Some(4096));
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let mut channels = BTreeMap::new();
    for (topic, type_name, received, data) in messages {
        let channel_id = *channels.entry(topic).or_insert_with(|| {
            let schema = writer.add_schema(type_name, "ros2msg", b"").unwrap();
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
        });
        let time = *received as u64;
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

pub(super) fn db3_bag(path: &Path, messages: &[Posted<'_>]) {
    let connection = Connection::open(path).unwrap();
    // As rosbag2 creates it.
    connection
        .execute_batch(
            "PRAGMA journal_mode = OFF;
             CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                 serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
                 data BLOB NOT NULL);
             CREATE INDEX timestamp_idx ON messages (timestamp ASC);",
        )
        .unwrap();
    for (topic, type_name, received, data) in messages {
        let known = connection.query_row("SELECT id FROM topics WHERE name = ?1", [topic], |row| row.get::<_, i64>(0));
        let id = known.unwrap_or_else(|_| {
            let sql = "INSERT INTO topics (name, type, serialization_format, offered_qos_profiles) VALUES (?1, ?2, 'cdr', '')";
            connection.execute(sql, params![topic, type_name]).unwrap();
            connection.last_insert_rowid()
        });
        let sql = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)";
        connection.execute(sql, params![id, received, data]).unwrap();
    }
}

fn depth_message(stamp: (u32, u32), sample: u16) -> Vec<u8> {
    image_message(stamp, (640, 480), "16UC1", false, 1280, &sample.to_le_bytes().repeat(640 * 480))
}

fn usual_messages() -> Vec<Posted<'static>> {
    vec![
        ("/velodyne_packets", SCAN, 10, scan_message(false, &[(1, 0, 0xaa), (1, 500, 0xbb)])),
        ("/kinect/depth", IMAGE, 11, depth_message((1, 250), 1234)),
        ("/imu", "sensor_msgs/msg/Imu", 12, vec![0, 1, 0, 0, 9]),
        ("/velodyne_packets", SCAN, 13, scan_message(true, &[(2, 0, 0xcc)])),
    ]
}

fn check_usual(path: &Path) {
    let (records, summary) = read_all(path);
    assert_eq!(records.len(), 4);
    assert_eq!(records[0], lidar(1_000_000_000, "front", &[0xaa; 1206]));
    assert_eq!(records[1], lidar(1_000_000_500, "front", &[0xbb; 1206]));
    assert_eq!(depth(&records[2]), (1_000_000_250, DepthEncoding::Mm16, None, 1234));
    assert_eq!(records[3], lidar(2_000_000_000, "front", &[0xcc; 1206]));
    assert_eq!(summary.kind, CaptureKind::Rosbag);
    assert_eq!(summary.unused_topics["/imu"].messages, 1);
    assert_eq!((summary.backward_steps, summary.receive_stamps_used), (1, 0));
    assert!(!summary.data_lost(), "{summary:?}");
    assert_eq!(open_default(path).unwrap().earliest_host().unwrap(), Some(UnixNs(1_000_000_000)));
}

#[test]
fn mcap_and_sqlite_bags_give_the_same_records() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [None, Some(mcap::Compression::Lz4), Some(mcap::Compression::Zstd)] {
        let path = folder.path().join("bag.mcap");
        fs::write(&path, mcap_bag(compression, &usual_messages())).unwrap();
        check_usual(&path);
    }
    // Characters that mean something in a URI do not harm.
    let path = folder.path().join("bag 100%?#.db3");
    db3_bag(&path, &usual_messages());
    check_usual(&path);
}

#[test]
fn a_folder_of_parts_is_one_bag_in_the_order_of_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("metadata.yaml"), "rosbag2_bagfile_information:\n").unwrap();
    for n in [10u32, 9] {
        let scan = ("/points", SCAN, 0, scan_message(false, &[(n, 0, n as u8)]));
        db3_bag(&folder.path().join(format!("bag_{n}.db3")), &[scan]);
    }
    let (records, _) = read_all(folder.path());
    assert_eq!(records, [lidar(9_000_000_000, "front", &[9; 1206]), lidar(10_000_000_000, "front", &[10; 1206])]);
}

#[test]
fn messages_compressed_one_by_one_are_unpacked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    let pack = |message: &[u8]| zstd::encode_all(message, 1).unwrap();
    let scan = scan_message(false, &[(1, 0, 0xaa)]);
    let mut broken = pack(&scan);
    broken.truncate(20);
    db3_bag(&path, &[("/points", SCAN, 5, pack(&scan)), ("/points", SCAN, 6_000_000_000, broken)]);
    let (records, summary) = read_all(&path);
    assert_eq!(records, [lidar(1_000_000_000, "front", &[0xaa; 1206]), lost(6_000_000_000, "front")]);
    assert!(matches!(summary.unused_topics["/points"].first_fault, Some(MessageFault::Zstd { .. })));
}

#[test]
fn topics_go_to_sensors_by_name_or_in_order_of_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let scan = |topic, fill| (topic, SCAN, 0, scan_message(false, &[(1, 0, fill)]));
    let colour = image_message((1, 0), (640, 480), "rgb8", false, 1920, &[0; 921_600]);
    let messages = [
        scan("/c", 3),
        scan("/a", 1),
        scan("/b", 2),
        // The colour image comes first by name and is no depth image.
        ("/camera/colour", IMAGE, 0, colour),
        ("/camera/depth", IMAGE, 0, depth_message((1, 0), 77)),
    ];
    fs::write(&path, mcap_bag(None, &messages)).unwrap();
    let sensors = |routing: &Routing| -> BTreeMap<String, u8> {
        let (records, _) = read_routed(&path, routing);
        let first_byte = |record: CaptureRecord| match record.body {
            Body::LidarPacket { sensor, bytes } => (sensor.to_string(), bytes[0]),
            Body::DepthFrame { sensor, bytes, .. } => (sensor.to_string(), bytes[0]),
            other => panic!("{other:?}"),
        };
        records.into_iter().map(first_byte).collect()
    };
    let expect =
        |pairs: &[(&str, u8)]| pairs.iter().map(|&(id, fill)| (id.to_owned(), fill)).collect::<BTreeMap<_, _>>();
    assert_eq!(sensors(&Routing::default()), expect(&[("front", 1), ("near", 77)]));
    let mut routing = Routing::default();
    let front = routing.lidars[0].clone();
    routing.lidars.push(LidarRoute { id: SensorId::from("rear"), topic: Some("/a".to_owned()), ..front });
    assert_eq!(sensors(&routing), expect(&[("front", 2), ("rear", 1), ("near", 77)]));
    let (_, summary) = read_routed(&path, &routing);
    assert_eq!(summary.unused_topics.keys().collect::<Vec<_>>(), ["/c", "/camera/colour"]);
}

#[test]
fn a_bag_without_usable_topics_lists_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let colour = image_message((1, 0), (1280, 720), "bgr8", false, 3840, &[0; 16]);
    let messages = [("/imu", "sensor_msgs/msg/Imu", 0, vec![0, 1, 0, 0]), ("/camera", IMAGE, 0, colour)];
    fs::write(&path, mcap_bag(None, &messages)).unwrap();
    let message = open_default(&path).err().unwrap().to_string();
    assert!(message.contains("/camera (sensor_msgs/msg/Image bgr8 1280x720), /imu (sensor_msgs/msg/Imu)"), "{message}");
    // A usable bag, but no sensor for it.
    fs::write(&path, mcap_bag(None, &usual_messages())).unwrap();
    let routing = Routing { lidars: vec![], kinects: vec![] };
    assert!(matches!(open(&path, &routing), Err(CaptureError::NoUsableTopic { .. })));
    // A topic that the route names and the bag does not have.
    let kinect = KinectRoute { id: SensorId::from("near"), topic: Some("/elsewhere".to_owned()) };
    let routing = Routing { lidars: vec![], kinects: vec![kinect] };
    assert!(matches!(open(&path, &routing), Err(CaptureError::NoUsableTopic { .. })));
}

#[test]
fn messages_without_a_stamp_have_the_receive_time_and_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let messages = [
        ("/points", SCAN, 7_000, scan_message(false, &[(0, 0, 1), (3, 0, 2)])),
        ("/depth", IMAGE, 8_000, depth_message((0, 0), 5)),
    ];
    fs::write(&path, mcap_bag(None, &messages)).unwrap();
    let (records, summary) = read_all(&path);
    let hosts: Vec<i64> = records.iter().map(|record| record.host.0).collect();
    assert_eq!(hosts, [7_000, 3_000_000_000, 8_000]);
    assert_eq!(summary.receive_stamps_used, 2);
}

#[test]
fn a_scan_that_claims_more_packets_than_it_has_is_a_gap() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let claim = Cdr::new(false).u32(1).u32(0).string("velodyne").u32(1_000_000).raw(&[0; 5000]).finish();
    fs::write(&path, mcap_bag(None, &[("/points", SCAN, 9_000, claim)])).unwrap();
    let (records, summary) = read_all(&path);
    assert_eq!(records, [lost(9_000, "front")]);
    assert!(summary.data_lost());
    assert_eq!(open_default(&path).unwrap().earliest_host().unwrap(), Some(UnixNs(9_000)));
}

#[test]
fn an_interrupted_mcap_gives_what_it_has_and_says_where_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let scan = |n: u32| ("/points", SCAN, 0, scan_message(false, &[(n, 0, n as u8); 4]));
    let whole = mcap_bag(None, &[scan(1), scan(2), scan(3)]);
    // 4 packets of 1 216 bytes fill a chunk of 4 096 each: half of the file is one chunk and a part of the second.
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let (records, summary) = read_all(&path);
    assert!((4..12).contains(&records.len()) && records.len() % 4 == 0, "{}", records.len());
    assert_eq!(summary.broken_off.len(), 1);
    let place = summary.broken_off[0].place;
    assert!(matches!(place, Place::Byte(offset) if offset <= whole.len() as u64 / 2), "{place:?}");
    // Cut at the end record: all is there, and that the recording was interrupted is said.
    let data_end = whole.windows(9).rposition(|w| w == [0x0f, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    fs::write(&path, &whole[..data_end]).unwrap();
    let (records, summary) = read_all(&path);
    assert_eq!(records.len(), 12);
    assert_eq!(summary.broken_off[0].place, Place::Byte(data_end as u64));
    // Cut before any chunk: nothing usable, and the message says that the file ends early.
    fs::write(&path, &whole[..60]).unwrap();
    let message = open_default(&path).err().unwrap().to_string();
    assert!(message.contains("no topics; ") && message.contains("readable only up to"), "{message}");
}

#[test]
fn a_chunk_that_fails_its_checksum_is_said_to_be_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let mut content = mcap_bag(None, &[("/points", SCAN, 0, scan_message(false, &[(1, 0, 0xa5)]))]);
    let payload = content.windows(4).position(|w| w == [0xa5; 4]).unwrap();
    content[payload + 600] ^= 1;
    fs::write(&path, content).unwrap();
    let (_, summary) = read_all(&path);
    assert!(summary.broken_off[0].detail.contains("checksum"), "{:?}", summary.broken_off);
}

#[test]
fn sizes_that_an_mcap_merely_claims_are_not_reserved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let record = |opcode: u8, length: u64, content: &[u8]| [&[opcode][..], &length.to_le_bytes(), content].concat();
    let chunk = |size: u64, records: u64| {
        [&[0; 16][..], &size.to_le_bytes(), &[0; 4], &[0; 4], &records.to_le_bytes(), &[5; 30]].concat()
    };
    for (content, detail) in [
        (record(5, 1 << 40, &[0; 30]), "claims 1099511627776 bytes"),
        (record(6, 70, &chunk(1 << 40, 30)), "claims to unpack to 1099511627776 bytes"),
        (record(6, 70, &chunk(30, 1 << 40)), "claims 1099511627776 bytes of records, but has 30"),
        (record(6, 70, &chunk(30, 30)), "a record claims 361700864190383365 bytes"),
        (record(200, 1 << 40, &[0; 30]), "the file ends within a record of 1099511627776 bytes"),
        // A schema whose name claims 4 GiB is passed over; the file then lacks its end.
        (record(3, 6, &[1, 0, 0xff, 0xff, 0xff, 0xff]), "without its end record"),
    ] {
        fs::write(&path, [mcap::MAGIC, &content].concat()).unwrap();
        let message = open_default(&path).err().unwrap().to_string();
        assert!(message.contains(detail), "{message}");
    }
}

#[test]
fn messages_of_no_declared_topic_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    db3_bag(&path, &[("/points", SCAN, 0, scan_message(false, &[(1, 0, 1)]))]);
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch("INSERT INTO messages (topic_id, timestamp, data) VALUES (99, 0, x'00');").unwrap();
    connection.execute_batch("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 5, 'text');").unwrap();
    drop(connection);
    let (records, summary) = read_all(&path);
    assert_eq!(records, [lidar(1_000_000_000, "front", &[1; 1206]), lost(5, "front")]);
    assert_eq!(summary.unused_topics["(undeclared)"].messages, 1);
    assert!(matches!(summary.unused_topics["/points"].first_fault, Some(MessageFault::EndsEarly { .. })));
}

#[test]
fn sqlite_files_that_are_no_bags_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.db3");
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);").unwrap();
    assert!(matches!(open_default(&path), Err(CaptureError::NotABag { table: "messages", .. })));
    // A view that never ends must not be run.
    let endless = "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)
        SELECT id, 1 AS topic_id, 0 AS timestamp, x'00' AS data FROM n;";
    connection.execute_batch(endless).unwrap();
    assert!(matches!(open_default(&path), Err(CaptureError::NotABag { table: "messages", .. })));
    connection.execute_batch("DROP VIEW messages; CREATE TABLE messages(id INTEGER PRIMARY KEY);").unwrap();
    drop(connection);
    let message = open_default(&path).err().unwrap().to_string();
    assert!(message.contains("no such column"), "{message}");
}

#[test]
fn a_bag_with_a_write_ahead_log_is_read_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    db3_bag(&path, &[("/points", SCAN, 0, scan_message(false, &[(1, 0, 1)]))]);
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch("PRAGMA journal_mode = WAL;").unwrap();
    let second = scan_message(false, &[(2, 0, 2)]);
    connection.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 0, ?1)", [second]).unwrap();
    // Still open: the second message is in the log only.
    assert_eq!(read_all(&path).0.len(), 2);
}

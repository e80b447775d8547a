//! `tumbled run` and `record` with a Kinect: the real libfreenect, over a stand-in for libusb that loses, unplugs and mutes.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use fake_libusb_control::FrameTruth;
use tumbled::cli::record::RecordReport;
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::run::RunReport;
use tumbled::session::SourceReport;
use tumbled_io::recording::Reader;
use tumbled_model::{Body, PacketMask};

use crate::support::daemon::Ended;
use crate::support::usb::{FRAMES, RIG, ROWS, SendingLidar, Usb, sent};

/// What is promised (docs/kinect-usb.md): a Kinect that left is absent, one that came is live, a stop is over.
const ABSENT_WITHIN: Duration = Duration::from_secs(1);
const LIVE_WITHIN: Duration = Duration::from_secs(5);
const STOPPED_WITHIN: Duration = Duration::from_secs(5);
/// Bytes of a USB packet of a frame; the last has 1 132.
const PAYLOAD: usize = 1_748;

fn report(ended: &Ended) -> RunReport {
    assert_eq!(ended.code, Some(0), "{ended:?}");
    serde_json::from_str(&ended.report).unwrap_or_else(|error| panic!("{error} in {ended:?}"))
}

fn source<'a>(report: &'a RunReport, sensor: &str) -> &'a SourceReport {
    report.sources.iter().find(|source| source.sensor == sensor).expect("a source")
}

/// Its recording computes to the same, bit for bit.
fn assert_replays_the_same(usb: &Usb, live: &RunReport) {
    let done = usb.bench.run(&["replay", "run.mcap", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let replay: ReplayReport = done.json();
    assert_eq!((replay.checkpoint, &replay.digest), (live.checkpoint.clone(), &live.digest));
    assert_eq!(replay.sensors, live.sensors);
}

/// Each depth frame of the recording by its stamp: its mask and its bytes.
fn recorded(usb: &Usb) -> BTreeMap<u32, (PacketMask, Vec<u8>)> {
    let reader = Reader::open(&[usb.bench.path("run.mcap")]).expect("opens");
    let frame = |body: Body| match body {
        Body::DepthFrame { ticks: Some(ticks), lost_packets, bytes, .. } => {
            Some((ticks.0, (lost_packets, bytes.to_vec())))
        }
        _ => None,
    };
    reader.filter_map(|event| frame(event.expect("reads").body)).collect()
}

#[test]
fn frames_are_recorded_as_they_were_sent_and_lost_packets_are_no_data_exactly_where_they_were() {
    // After the first seconds often: a busy machine may leave out the points of one or two.
    let later: String = (60..120).step_by(6).map(|n| format!("frame {n} drop 100 241\n")).collect();
    let usb = Usb::new(&format!("frame 5 drop 3 4\nframe 9 drop 17\nframe 11 corrupt short 10\n{later}"));
    let began = Instant::now();
    let running = usb.start(&[]);
    let live = running.wait_for_event("near is live");
    assert!(live - began < LIVE_WITHIN, "{:?}", live - began);
    running.wait_for_reason("frames of the last 10 s lack USB packets");
    let (ended, _) = running.stop();
    let live = report(&ended);
    assert_eq!((source(&live, "near").opened, &source(&live, "near").cause), (1, &None));

    // Against what the stand-in says it sent, and not against anything the daemon says.
    let (truth, frames) = (usb.standin.truth().expect("a truth file"), recorded(&usb));
    let sent_whole: Vec<&FrameTruth> = truth.frames(0).filter(|frame| frame.sent == Some(242)).collect();
    assert!(sent_whole.len() > 20 && frames.len() > 20, "{} sent, {} recorded", sent_whole.len(), frames.len());
    let mut compared = 0;
    for frame in sent_whole {
        // The last may have been on its way when the stop came.
        let Some((mask, bytes)) = frames.get(&frame.ticks) else { continue };
        let mut missing = frame.missing();
        missing.extend(frame.corrupt.iter().map(|(packet, _)| *packet));
        assert_eq!(mask.iter().map(|packet| packet as u16).collect::<Vec<_>>(), missing, "{frame:?}");
        let mut expected = sent(frame.number as usize % FRAMES);
        for packet in missing {
            let start = usize::from(packet) * PAYLOAD;
            let end = (start + PAYLOAD).min(expected.len());
            expected[start..end].fill(0xFF);
        }
        assert!(*bytes == expected, "{frame:?}");
        compared += 1;
    }
    assert!(compared > 20, "{compared}");

    // Packets 3 and 4 are bits 41 952 to 69 919 of the frame: pixels 3 813 to 6 356, eleven bits each.
    let done = usb.bench.run(&[
        "export",
        "run.mcap",
        "--what",
        "kinect-depth",
        "--format",
        "png",
        "--frames",
        "0..10",
        "-o",
        "depth/",
    ]);
    assert!(done.code == 0 || done.code == 3, "{}", done.stderr);
    assert_no_data(&usb, 5, 3_813..6_357);
    assert_no_data(&usb, 6, 0..0);
    // Packet 17: bits 237 728 to 251 711.
    assert_no_data(&usb, 9, 21_611..22_883);
    assert_replays_the_same(&usb, &live);
}

/// That of exported frame `n`, in the order of the recording, exactly these pixels have no depth.
fn assert_no_data(usb: &Usb, n: usize, expected: std::ops::Range<usize>) {
    let files = std::fs::read_dir(usb.bench.path("depth")).expect("a folder").map(|file| file.expect("reads").path());
    let mut files: Vec<_> = files.filter(|file| file.extension().is_some_and(|end| end == "png")).collect();
    files.sort();
    let file = std::io::BufReader::new(std::fs::File::open(&files[n]).expect("opens"));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("it fits")];
    reader.next_frame(&mut pixels).expect("a picture");
    // Sixteen bits a pixel, millimetres, big-endian; 0 is no data.
    let without: Vec<usize> = (0..640 * ROWS).filter(|pixel| pixels[2 * pixel..2 * pixel + 2] == [0, 0]).collect();
    assert_eq!(without, expected.collect::<Vec<_>>(), "frame {n}");
}

#[test]
fn a_kinect_that_is_unplugged_and_comes_back_at_any_port_disturbs_no_packet_of_the_lidar() {
    let usb = Usb::new("");
    let running = usb.start(&[]);
    let lidar = SendingLidar::start(running.daemon.data);
    running.wait_for_event("near is live");
    let mut control = running.control();
    for replug in ["replug", "replug port 4"] {
        control.send("unplug").expect("it was plugged in");
        let left = Instant::now();
        let absent = running.wait_for_event("near is absent") - left;
        running.wait_for_reason("no Kinect is on the USB");
        control.send(replug).expect("it was not");
        let back = Instant::now();
        let live = running.wait_for_event("near is live") - back;
        println!("{replug}: absent within {absent:?}, live within {live:?}");
        assert!(absent <= ABSENT_WITHIN && live <= LIVE_WITHIN, "{replug}: absent {absent:?}, live {live:?}");
    }
    let sent = lidar.stop();
    std::thread::sleep(Duration::from_millis(300)); // sent is not yet received
    let (ended, stopped) = running.stop();
    assert!(stopped < STOPPED_WITHIN, "{stopped:?}");
    let live = report(&ended);
    let front = live.sensors.iter().find(|sensor| sensor.id == "front").expect("the LiDAR");
    assert_eq!((front.received, front.lost.total), (sent, 0));
    assert_eq!((source(&live, "near").opened, &source(&live, "near").cause), (3, &None));
    assert_replays_the_same(&usb, &live);
}

#[test]
fn a_mute_kinect_blocks_neither_start_nor_stop_nor_the_lidar() {
    let usb = Usb::new("mute-from-start\n");
    let running = usb.start(&[]);
    let lidar = SendingLidar::start(running.daemon.data);
    running.wait_for_event("front is live");
    // While it is being opened, which nothing can interrupt.
    let (ended, stopped) = running.stop();
    assert!(stopped < STOPPED_WITHIN, "{stopped:?}");
    lidar.stop();
    assert_eq!(source(&report(&ended), "near").packets, 0);

    let usb = Usb::new("mute-from-start\n");
    let running = usb.start(&[]);
    let lidar = SendingLidar::start(running.daemon.data);
    // "did not answer within 5 s", and from the next attempt on, a moment later, "still does not answer".
    running.wait_for_reason("not answer");
    let sent = lidar.stop();
    std::thread::sleep(Duration::from_millis(300)); // sent is not yet received
    let (ended, stopped) = running.stop();
    assert!(stopped < STOPPED_WITHIN, "{stopped:?}");
    let live = report(&ended);
    assert!(source(&live, "near").cause.is_some() && source(&live, "near").error.is_none(), "{live:?}");
    assert_eq!(source(&live, "front").packets, sent);
    assert_replays_the_same(&usb, &live);
}

#[test]
fn a_frozen_kinect_is_a_fault_and_none_of_its_frames_is_used() {
    let usb = Usb::new("");
    let running = usb.start(&[]);
    running.wait_for_event("near is live");
    let mut control = running.control();
    control.send("freeze").expect("done");
    running.wait_for_event("near is fault");
    running.wait_for_reason("near is frozen");
    control.send("freeze off").expect("done");
    running.wait_for_event("near is live");
    let live = report(&running.stop().0);
    let near = live.sensors.iter().find(|sensor| sensor.id == "near").expect("the Kinect");
    assert!(near.duplicates >= 10, "{near:?}");
    // No repetition gave a point: so many frames with a point in each pixel of their upper rows, or fewer where this machine
    // was too busy for some.
    assert!(near.points.in_epochs <= (near.received - near.duplicates) * (640 * ROWS) as u64, "{near:?}");
    assert_replays_the_same(&usb, &live);
}

#[test]
fn what_keeps_a_kinect_from_delivering_is_told_with_its_cause() {
    let usb = Usb::new("refuse-bandwidth\n");
    let running = usb.start(&[]);
    running.wait_for_reason("no bandwidth is left on this controller");
    let mut control = running.control();
    control.send("refuse-bandwidth off").expect("done");
    running.wait_for_event("near is live");
    control.send("unplug").expect("done");
    control.send("no-permission").expect("done");
    control.send("replug").expect("done");
    running.wait_for_reason("no permission to open the Kinect");
    let live = report(&running.stop().0);
    let near = source(&live, "near");
    assert!(near.cause.as_ref().is_some_and(|cause| cause.contains("udev rule")), "{near:?}");
}

#[test]
fn another_serial_number_needs_a_new_session() {
    let usb = Usb::new("");
    let mut running = usb.start(&[]);
    running.wait_for_event("near is live");
    let rig = RIG.replace("id = \"near\"", "id = \"near\"\nserial = \"B2\"");
    usb.bench.file("rig.toml", rig);
    running.daemon.signal("HUP");
    running.daemon.wait_for("kinect.near.serial");
    let moved = RIG.replace("id = \"near\"", "id = \"near\"\ntime_offset_ms = 5.0");
    usb.bench.file("rig.toml", moved);
    running.daemon.signal("HUP");
    running.daemon.wait_for("the config was taken over");
    let live = report(&running.stop().0);
    assert_replays_the_same(&usb, &live);
}

#[test]
fn record_takes_the_frames_of_a_kinect_alone() {
    let usb = Usb::new("");
    let arguments =
        ["record", "--config", "rig.toml", "--set", "lidar=[]", "-o", "run.mcap", "--duration", "3s", "--json"];
    let done = usb.run(&arguments);
    let report: RecordReport = done.json();
    let [near] = report.sources.as_slice() else { panic!("{report:?}") };
    assert!(near.sensor == "near" && near.packets > 0 && near.error.is_none(), "{}", done.stderr);
    assert_eq!(recorded(&usb).len() as u64, near.packets);
    // Exit code 3 is for a machine that was too busy, and says so.
    assert_eq!((done.code == 0, report.complete), (report.complete, near.lost_here() == 0), "{report:?}");
}

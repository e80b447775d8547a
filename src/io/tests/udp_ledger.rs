//! The ledger between several sources and several consumers.

mod udp_support;

use bytes::Bytes;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use tumbled_io::live::{
    Consumer, Delivery, Ledger, Pace, Patience, QueueBound, ScanMark, SessionClock, Source, StopToken, UdpSender,
    UdpSource,
};
use tumbled_model::{Body, Event, LossPoint, RigNs, SensorId, Span, UnixNs};
use udp_support::*;

const MS: i64 = 1_000_000;

fn sensor(name: &str) -> SensorId {
    name.into()
}

#[test]
fn two_sensors_share_one_order_and_keep_their_own() {
    let clock = SessionClock::start_on_system();
    let mut ledger = Ledger::live(clock.clone());
    let stop = StopToken::new().expect("a descriptor");
    let mut running = Vec::new();
    let mut addresses = Vec::new();
    for name in ["front", "back"] {
        let source = UdpSource::bind(config(name), clock.clone()).expect("loopback is there");
        addresses.push(source.address());
        let intake = ledger.intake(sensor(name), QueueBound::LIDAR_PACKETS);
        let stop = stop.clone();
        running.push(std::thread::spawn(move || Box::new(source).run(intake, stop)));
    }
    let events = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    // 300 packets at 1 ms, every third to the other sensor: slow enough for any socket buffer.
    let from = UdpSender::bind(localhost(0)).expect("a free port");
    let to = |n: u32| addresses[usize::from(n.is_multiple_of(3))];
    let datagrams = (0..300).map(|n| (Span(i64::from(n) * MS), to(n), packet(n)));
    let sent = from.send(datagrams, Pace::Times(1.0), &stop).expect("loopback");
    assert_eq!(sent.datagrams, 300);
    let mut seen = collect_until(&events, |events| packets(events) == 300);
    stop.stop();
    for source in running {
        source.join().expect("no panic").expect("the source ran well");
    }
    let summary = ledger.stop();
    seen.extend(events);
    let order: Vec<u64> = seen.iter().map(|event| event.seq).collect();
    assert_eq!(order, (0..summary.events).collect::<Vec<_>>(), "0, 1, 2, … without gaps");
    let of = |rest: fn(u32) -> bool| (0..300).filter(|n| rest(*n)).map(packet).collect::<Vec<_>>();
    assert_eq!(payloads(&seen, "front"), of(|n| !n.is_multiple_of(3)));
    assert_eq!(payloads(&seen, "back"), of(|n| n.is_multiple_of(3)));
}

#[test]
fn a_capture_sent_at_its_own_pace_arrives_as_its_import_reads_it() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    sent_as_imported(&format!("{root}/tests/captures/vlp32c-strongest-600rpm-fov180.pcap"));
    let real = "../shared/data/velodyne/vlp32c_strongest_600rpm_fov180_a.pcap";
    if std::path::Path::new(&format!("{root}/{real}")).exists() {
        sent_as_imported(&format!("{root}/{real}"));
    } else {
        println!("skipped: {real} is not there");
    }
}

/// The claim for one capture of a LiDAR.
fn sent_as_imported(path: &str) {
    let capture = tumbled_io::capture::open(path.as_ref(), &Default::default()).expect("a capture");
    let imported: Vec<(Span, Bytes)> = capture
        .map(|record| record.expect("a whole file"))
        .filter_map(|record| match record.body {
            Body::LidarPacket { bytes, .. } => Some((record.host - UnixNs(0), bytes)),
            _ => None,
        })
        .collect();
    let clock = SessionClock::start_on_system();
    let mut ledger = Ledger::live(clock.clone());
    let source = UdpSource::bind(config("front"), clock).expect("loopback is there");
    let to = source.address();
    let intake = ledger.intake(sensor("front"), QueueBound::LIDAR_PACKETS);
    let events = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let stop = StopToken::new().expect("a descriptor");
    let token = stop.clone();
    let source = std::thread::spawn(move || Box::new(source).run(intake, token));
    let from = UdpSender::bind(localhost(0)).expect("a free port");
    let datagrams = imported.iter().map(|(at, bytes)| (*at, to, bytes));
    from.send(datagrams, Pace::Times(1.0), &stop).expect("loopback");
    let seen = collect_until(&events, |events| packets(events) == imported.len());
    stop.stop();
    source.join().expect("no panic").expect("the source ran well");
    ledger.stop();
    assert!(!imported.is_empty(), "{path}");
    assert_eq!(payloads(&seen, "front"), imported.into_iter().map(|(_, bytes)| bytes).collect::<Vec<_>>());
}

#[test]
fn ticks_and_anchors_keep_the_beat_of_a_scripted_clock() {
    // Every look advances the clock by 50 ms; the wall clock jumps ahead by an hour at 1.5 s.
    let hour = Span(3_600_000_000_000);
    let epoch = UnixNs(1_795_000_000_000_000_000);
    let script = ScriptedClock::new(Span(50 * MS), epoch, (Span(1_500 * MS), hour));
    let mut ledger = Ledger::live(SessionClock::start(Arc::new(script)));
    let events = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let ticks = |events: &[Event]| events.iter().filter(|event| event.body == Body::Tick).count();
    let seen = collect_until(&events, |events| ticks(events) == 25);
    ledger.stop();
    let at: Vec<i64> = seen.iter().filter(|event| event.body == Body::Tick).map(|e| e.arrived.0 / MS).collect();
    assert_eq!(at, (1..=25).map(|tenth| tenth * 100).collect::<Vec<_>>());
    let anchors: Vec<(i64, UnixNs)> = seen
        .iter()
        .filter_map(|event| match event.body {
            Body::Anchor { unix } => Some((event.arrived.0 / MS, unix)),
            _ => None,
        })
        .collect();
    // The clock's first look is the session's start: both clocks are 50 ms further at the ledger's first look.
    let wall = |ms: i64| epoch + Span(ms * MS);
    assert_eq!(anchors, [(50, wall(50)), (1_000, wall(1_000)), (2_000, wall(2_000) + hour)]);
    assert!(seen.is_sorted_by(|a, b| a.arrived <= b.arrived), "the session's time goes on through the step");
}

#[test]
fn everything_accepted_before_the_stop_is_delivered() {
    let mut ledger = Ledger::live(SessionClock::start_on_system());
    let mut front = ledger.intake(sensor("front"), QueueBound::LIDAR_PACKETS);
    let mut back = ledger.intake(sensor("back"), QueueBound::LIDAR_PACKETS);
    let (recorder, core) = (ledger.recorder(), ledger.core(Box::new(|_| false)));
    for n in 0..4_096 {
        for intake in [&mut front, &mut back] {
            let body = lidar_packet(&intake.sensor().clone(), &Bytes::copy_from_slice(&u32::to_le_bytes(n)));
            assert_eq!(intake.push(RigNs(i64::from(n)), body), Ok(Delivery::Taken));
        }
    }
    let ledger = ledger.start().expect("a thread");
    // The intakes are still open: the ledger does not wait for more.
    let summary = ledger.stop();
    assert_eq!(summary.undelivered, 0);
    let expected: Vec<Bytes> = (0..4_096).map(|n| Bytes::copy_from_slice(&u32::to_le_bytes(n))).collect();
    for consumer in [recorder, core] {
        let seen: Vec<Event> = consumer.collect();
        assert_eq!(payloads(&seen, "front"), expected);
        assert_eq!(payloads(&seen, "back"), expected);
    }
    let body = lidar_packet(&sensor("front"), &Bytes::new());
    assert!(front.push(RigNs(0), body).is_err(), "after the stop nothing is accepted");
}

#[test]
fn a_queue_that_ran_over_posts_the_exact_number_lost() {
    let mut ledger = Ledger::live(SessionClock::start_on_system());
    let mut intake = ledger.intake(sensor("front"), QueueBound(10));
    let events = ledger.recorder();
    for n in 0..25 {
        intake.push(RigNs(i64::from(n)), lidar_packet(&sensor("front"), &packet(n))).expect("open");
    }
    let ledger = ledger.start().expect("a thread");
    let mut seen = collect_until(&events, |events| packets(events) == 10);
    intake.push(RigNs(25), lidar_packet(&sensor("front"), &packet(25))).expect("open");
    seen.extend(collect_until(&events, |events| packets(events) == 1));
    ledger.stop();
    // 10 found room, 15 did not; then the gap, then the next packet.
    let of_sensor: Vec<Body> = seen.into_iter().map(|e| e.body).filter(|body| body.sensor().is_some()).collect();
    let mut expected: Vec<Body> = (0..10).map(|n| lidar_packet(&sensor("front"), &packet(n))).collect();
    expected.push(Body::Gap { sensor: sensor("front"), lost: 15, place: LossPoint::Queue });
    expected.push(lidar_packet(&sensor("front"), &packet(25)));
    assert_eq!(of_sensor, expected);
}

/// Five packets a scan.
fn scan_start() -> Box<dyn FnMut(&Body) -> bool + Send> {
    let mut packets = 0;
    Box::new(move |body| {
        let begins = matches!(body, Body::LidarPacket { .. }) && packets % 5 == 0;
        packets += u32::from(matches!(body, Body::LidarPacket { .. }));
        begins
    })
}

#[test]
fn scans_the_core_has_no_time_for_are_shed_ahead_and_still_recorded() {
    let mut ledger = Ledger::live(SessionClock::start_on_system());
    let mut intake = ledger.intake(sensor("front"), QueueBound::LIDAR_PACKETS);
    let core = ledger.core_with(scan_start(), usize::MAX, 3);
    let recorder = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let mut push = |range: std::ops::Range<u32>| {
        for n in range {
            intake.push(RigNs(i64::from(n)), lidar_packet(&sensor("front"), &packet(n))).expect("open");
        }
    };
    // Six scans while the core takes nothing: three wait, three are shed.
    push(0..30);
    let mut recorded = collect_until(&recorder, |events| packets(events) == 30);
    // The core takes the first scan's first packet: one scan fewer waits.
    let mut seen = collect_until(&core, |events| packets(events) == 1);
    push(30..40);
    recorded.extend(collect_until(&recorder, |events| packets(events) == 10));
    let summary = ledger.stop();
    recorded.extend(recorder);
    seen.extend(core);
    assert_eq!(seen, recorded, "core and recording hold the same ledger");
    assert_eq!(summary.shed_scans, 4);
    let mut packet = 0;
    let mut skips = Vec::new();
    for event in &recorded {
        match event.body {
            Body::Skip { scans: 1, .. } => skips.push(packet),
            Body::LidarPacket { .. } => packet += 1,
            _ => {}
        }
    }
    // Scans 3, 4, 5, and 7: scan 6 took the place of the one that the core had taken.
    assert_eq!(skips, [15, 20, 25, 35]);
}

#[test]
fn a_slow_recorder_loses_and_the_core_does_not() {
    // A clock that stands still: no tick takes room.
    let script = ScriptedClock::new(Span(0), UnixNs(0), (Span(i64::MAX), Span(0)));
    let mut ledger = Ledger::live(SessionClock::start(Arc::new(script)));
    let mut intake = ledger.intake(sensor("front"), QueueBound::LIDAR_PACKETS);
    // Room for two packets of 1 206 bytes and the first anchor.
    let recorder = ledger.recorder_with(3_000);
    let core = ledger.core(Box::new(|_| false));
    let ledger = ledger.start().expect("a thread");
    for n in 0..50 {
        intake.push(RigNs(i64::from(n)), lidar_packet(&sensor("front"), &packet(n))).expect("open");
    }
    let mut seen = collect_until(&core, |events| packets(events) == 50);
    let health: Vec<u64> = ledger.outlets().iter().map(|outlet| outlet.counts().lost).collect();
    ledger.stop();
    seen.extend(core);
    let recorded: Vec<Event> = recorder.collect();
    assert_eq!(packets(&seen), 50);
    assert_eq!(lost(&seen, LossPoint::Recorder), 0, "the run itself lacks nothing");
    assert_eq!((packets(&recorded), lost(&recorded, LossPoint::Recorder)), (2, 48));
    assert_eq!(health, [48, 0]);
}

#[test]
fn a_replay_passes_events_as_they_were_and_adds_nothing() {
    let mut ledger = Ledger::replay();
    let mut intake = ledger.intake(sensor("recording"), QueueBound(4));
    // Small bounds: the source has to wait for both consumers.
    let (recorder, core) = (ledger.recorder_with(2_000), ledger.core_with(scan_start(), 2_000, 1));
    let recorded: Vec<Event> = (0..500)
        .map(|n| {
            let body = match n % 10 {
                0 => Body::Tick,
                1 => Body::Skip { sensor: sensor("front"), scans: 1 },
                2 => Body::Gap { sensor: sensor("front"), lost: n, place: LossPoint::Kernel },
                _ => lidar_packet(&sensor("front"), &packet(n)),
            };
            // A part of a rotated recording begins anywhere.
            Event { seq: 7_000 + u64::from(n), arrived: RigNs(i64::from(n) * 1_000 - 50_000), body }
        })
        .collect();
    let ledger = ledger.start().expect("a thread");
    let readers = [recorder, core].map(|consumer| std::thread::spawn(move || consumer.collect::<Vec<Event>>()));
    for event in &recorded {
        assert_eq!(intake.push_recorded(event.clone()), Ok(Delivery::Taken));
    }
    drop(intake);
    let summary = ledger.wait();
    assert_eq!((summary.events, summary.ticks, summary.shed_scans), (500, 0, 0));
    for reader in readers {
        assert_eq!(reader.join().expect("no panic"), recorded);
    }
}

/// Counts what it is offered.
struct Count(Arc<AtomicU32>);

impl Consumer for Count {
    fn offer(&mut self, _: &Event, _: ScanMark, _: &Patience) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }
}

#[test]
fn a_consumer_of_another_kind_sees_every_event() {
    let mut ledger = Ledger::live(SessionClock::start_on_system());
    let mut intake = ledger.intake(sensor("stage"), QueueBound::SERIAL_CHUNKS);
    let count = Arc::new(AtomicU32::new(0));
    ledger.consumer(Box::new(Count(Arc::clone(&count))));
    for n in 0..100 {
        let bytes = Bytes::from_static(b"E,1,2,3*00\r\n");
        intake.push(RigNs(n), Body::SerialChunk { sensor: sensor("stage"), bytes }).expect("open");
    }
    let handle = ledger.start().expect("a thread");
    assert!(handle.queues()[0].waiting <= handle.queues()[0].bound);
    let summary = handle.stop();
    assert_eq!(u64::from(count.load(Ordering::SeqCst)), summary.events);
    assert_eq!(summary.events, 100 + summary.ticks + summary.anchors);
}

/// Not a claim but a figure: what loopback carries without loss, and what the threads cost.
///
/// `cargo test --release -p tumbled-io --test udp_ledger -- --ignored --nocapture throughput`
#[test]
#[ignore = "a measurement of 30 s"]
fn throughput_on_loopback() {
    let payloads: Vec<Bytes> = (0..1_000).map(packet).collect();
    for rate in [1_507u32, 6_028, 20_000, 50_000, 100_000, 200_000] {
        let clock = SessionClock::start_on_system();
        let source = UdpSource::bind(config("front"), clock.clone()).expect("loopback is there");
        let to: SocketAddr = source.address();
        let mut ledger = Ledger::live(clock);
        let intake = ledger.intake(sensor("front"), QueueBound::LIDAR_PACKETS);
        let events = ledger.recorder();
        let ledger = ledger.start().expect("a thread");
        let stop = StopToken::new().expect("a descriptor");
        let token = stop.clone();
        let receiver = std::thread::Builder::new().name("rx-front".to_owned());
        let receiver = receiver.spawn(move || Box::new(source).run(intake, token)).expect("a thread");
        let consumer = std::thread::spawn(move || events.count());
        let from = UdpSender::bind(localhost(0)).expect("a free port");
        let total = rate * 5;
        // In bursts of a millisecond: a sleep per packet would be the limit.
        let burst = (rate / 1_000).max(1);
        let at = |n: u32| Span(i64::from(n / burst * burst) * 1_000_000_000 / i64::from(rate));
        let datagrams = (0..total).map(|n| (at(n), to, &payloads[n as usize % payloads.len()]));
        let before = (cpu_seconds("rx-front"), cpu_seconds("ledger"), std::time::Instant::now());
        let sent = from.send(datagrams, Pace::Times(1.0), &stop).expect("loopback");
        let wall = before.2.elapsed().as_secs_f64();
        std::thread::sleep(std::time::Duration::from_millis(300));
        let cpu = (cpu_seconds("rx-front") - before.0, cpu_seconds("ledger") - before.1);
        stop.stop();
        let summary = receiver.join().expect("no panic").expect("the source ran well");
        ledger.stop();
        consumer.join().expect("no panic");
        println!(
            "{rate:>7}/s asked, {:>7.0}/s sent: kernel lost {}, queue lost {}, missing {}, rx {:.1} % of a core, ledger {:.1} %, \
             read stamps {}, sender at most {:.1} ms late",
            sent.datagrams as f64 / wall,
            summary.lost_kernel,
            summary.lost_queue,
            sent.datagrams - summary.delivered - summary.lost_kernel - summary.lost_queue,
            cpu.0 / wall * 100.0,
            cpu.1 / wall * 100.0,
            summary.stamped_at_reading,
            sent.latest.as_secs_f64() * 1e3,
        );
    }
}

/// CPU time of this process's thread of that name, seconds (Linux: the first figure of `schedstat`, ns).
fn cpu_seconds(thread: &str) -> f64 {
    let mut total = 0.0;
    for task in std::fs::read_dir("/proc/self/task").expect("Linux").flatten() {
        let read = |file: &str| std::fs::read_to_string(task.path().join(file)).unwrap_or_default();
        if read("comm").trim() == thread {
            total += read("schedstat").split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9;
        }
    }
    total
}

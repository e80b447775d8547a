//! A LiDAR's sockets, from the wire to the intake.

mod udp_support;

use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tumbled_io::live::{
    Backoff, Device, EventReceiver, HostClock, HostSample, Intake, Ledger, LedgerHandle, Notice, Opener, QueueBound,
    SessionClock, Source, SourceError, SourceInfo, SourceWarning, StopToken, Summary, SystemClock, UdpConfig,
    UdpOpener, UdpSource, supervise,
};
use tumbled_model::{Body, Event, LossPoint, RigNs, SensorId, SourceState, Span, UnixNs};
use tumbled_velodyne::encode::position_packet;
use tumbled_velodyne::position::Pps;
use udp_support::*;

/// A source running into a ledger of its own.
struct Running {
    events: EventReceiver,
    ledger: LedgerHandle,
    source: JoinHandle<Result<Summary, SourceError>>,
    stop: StopToken,
}

impl Running {
    fn start(source: UdpSource, clock: SessionClock) -> Self {
        let mut ledger = Ledger::live(clock);
        let intake = ledger.intake("front".into(), QueueBound::LIDAR_PACKETS);
        let events = ledger.recorder();
        let ledger = ledger.start().expect("a thread");
        let stop = StopToken::new().expect("a descriptor");
        let token = stop.clone();
        let source = std::thread::spawn(move || Box::new(source).run(intake, token));
        Self { events, ledger, source, stop }
    }

    /// Stops source and ledger; the rest of the events.
    fn finish(self) -> (Vec<Event>, Summary) {
        self.stop.stop();
        let summary = self.source.join().expect("no panic").expect("the source ran well");
        self.ledger.stop();
        (self.events.collect(), summary)
    }
}

fn open(config: UdpConfig, clock: &SessionClock) -> UdpSource {
    UdpSource::bind(config, clock.clone()).expect("loopback is there")
}

#[test]
fn what_is_sent_arrives_in_order_bit_for_bit_with_stamps_of_the_time_of_sending() {
    let clock = SessionClock::start_on_system();
    let source = open(config("front"), &clock);
    let to = source.address();
    let running = Running::start(source, clock.clone());
    let from = sender();
    // Fewer than the smallest default socket buffer holds (90), so that no pause of the machine can lose one.
    let mut windows = Vec::new();
    for n in 0..80 {
        let before = clock.now().rig;
        from.send_to(&packet(n), to).expect("sent");
        windows.push((before, clock.now().rig));
    }
    let events = collect_until(&running.events, |events| packets(events) == 80);
    assert_eq!(payloads(&events, "front"), (0..80).map(packet).collect::<Vec<_>>());
    let arrivals = arrivals(&events);
    assert!(arrivals.is_sorted());
    let (_, summary) = running.finish();
    assert_eq!((summary.delivered, summary.bytes), (80, 80 * 1_206));
    // Loopback queues within send(): the kernel's stamp lies in the window, but for the reading of two clocks (1 ms).
    let slack = Span::from_micros(1_000);
    let outside = |((before, after), arrived): &(&(RigNs, RigNs), &RigNs)| {
        **arrived + slack < *before || **arrived > *after + slack
    };
    let outside = windows.iter().zip(&arrivals).filter(outside).count() as u64;
    assert!(outside <= summary.stamped_at_reading, "{outside} of 80 outside, {summary:?}");
}

#[test]
fn both_ports_deliver_and_foreign_sizes_are_left_to_the_decoder() {
    let clock = SessionClock::start_on_system();
    let source = open(config("front"), &clock);
    let (data, position) = (source.address(), source.position_address().expect("two ports"));
    let running = Running::start(source, clock);
    let from = sender();
    let nmea = position_packet(tumbled_model::LidarTime(77), Pps::Locked, "$GPRMC\r\n");
    from.send_to(&nmea, position).expect("sent");
    let sizes = [0, 1, 1_205, 1_207, 2_048];
    for size in sizes {
        from.send_to(&vec![size as u8; size], data).expect("sent");
    }
    // Larger than any sensor's: counted, not delivered.
    from.send_to(&[0; 2_049], data).expect("sent");
    from.send_to(&packet(1), data).expect("sent");
    let events = collect_until(&running.events, |events| packets(events) == 7);
    let seen = payloads(&events, "front");
    assert!(seen.iter().any(|bytes| bytes[..] == nmea[..]));
    let lengths: Vec<usize> = seen.iter().map(|bytes| bytes.len()).filter(|length| *length != 512).collect();
    assert_eq!(lengths, [0, 1, 1_205, 1_207, 2_048, 1_206]);
    let (_, summary) = running.finish();
    assert_eq!((summary.delivered, summary.oversized), (7, 1));
}

#[test]
fn a_flooded_socket_buffer_is_told_as_a_gap_where_the_packets_are_missing() {
    let clock = SessionClock::start_on_system();
    let source = open(UdpConfig { receive_buffer: 16 << 10, ..config("front") }, &clock);
    let to = source.address();
    let from = sender();
    // Nobody receives yet: 16 KiB hold a few packets of the hundred.
    for n in 0..100 {
        from.send_to(&packet(n), to).expect("sent");
    }
    let running = Running::start(source, clock);
    // The kernel tells of a loss with the next packet that finds room, so the sums agree once one followed. How soon
    // there is room is the machine's affair: each packet sent shifts both sides alike, a miscount would stay.
    let (mut sent, mut events) = (100, Vec::new());
    while packets(&events) as u64 + lost(&events, LossPoint::Kernel) != sent {
        assert!(sent < 200, "{} packets, {} lost", packets(&events), lost(&events, LossPoint::Kernel));
        from.send_to(&packet(sent as u32), to).expect("sent");
        sent += 1;
        let until = Instant::now() + Duration::from_millis(200);
        while Instant::now() < until && packets(&events) as u64 + lost(&events, LossPoint::Kernel) != sent {
            events.extend(running.events.recv_timeout(Duration::from_millis(20)));
        }
    }
    let (_, summary) = running.finish();
    assert!(summary.lost_kernel > 50, "{summary:?}");
    assert_eq!(lost(&events, LossPoint::Kernel), summary.lost_kernel);
    assert_eq!(summary.delivered + summary.lost_kernel, sent);
    // And the gaps stand where the packets are missing.
    let mut next = 0;
    for event in &events {
        match &event.body {
            Body::LidarPacket { bytes, .. } => {
                assert_eq!(*bytes, packet(next), "packet {next}");
                next += 1;
            }
            Body::Gap { lost, .. } => next += lost,
            _ => {}
        }
    }
}

#[test]
fn packets_from_elsewhere_are_counted_and_not_delivered() {
    let clock = SessionClock::start_on_system();
    let sensor = UdpSocket::bind((Ipv4Addr::new(127, 0, 0, 2), 0)).expect("loopback is 127/8");
    let filter = UdpConfig { source: Some(IpAddr::from([127, 0, 0, 2])), ..config("front") };
    let source = open(filter, &clock);
    let to = source.address();
    let running = Running::start(source, clock);
    let spoofer = sender();
    for n in 0..10 {
        spoofer.send_to(&packet(1_000 + n), to).expect("sent");
        sensor.send_to(&packet(n), to).expect("sent");
    }
    let events = collect_until(&running.events, |events| packets(events) == 10);
    assert_eq!(payloads(&events, "front"), (0..10).map(packet).collect::<Vec<_>>());
    assert_eq!(running.finish().1.other_source, 10);
}

/// The machine's clock, with a wall clock that the test sets an hour ahead.
struct SteppedWall {
    system: SystemClock,
    ahead: Arc<AtomicBool>,
}

impl HostClock for SteppedWall {
    fn sample(&self) -> HostSample {
        let sample = self.system.sample();
        let hour = Span(3_600_000_000_000);
        let wall = if self.ahead.load(Ordering::SeqCst) { sample.wall + hour } else { sample.wall };
        HostSample { wall, ..sample }
    }
}

#[test]
fn a_wall_clock_step_does_not_move_what_arrives() {
    let ahead = Arc::new(AtomicBool::new(false));
    let clock = SessionClock::start(Arc::new(SteppedWall { system: SystemClock::new(), ahead: Arc::clone(&ahead) }));
    let source = open(config("front"), &clock);
    let to = source.address();
    let running = Running::start(source, clock.clone());
    let from = sender();
    let begin = clock.now().rig;
    let mut events = Vec::new();
    for half in [0..40, 40..80] {
        for n in half {
            from.send_to(&packet(n), to).expect("sent");
        }
        events.extend(collect_until(&running.events, |events| packets(events) == 40));
        ahead.store(true, Ordering::SeqCst);
    }
    let end = clock.now().rig;
    let arrivals = arrivals(&events);
    assert!(arrivals.is_sorted());
    let slack = Span::from_micros(1_000);
    assert!(arrivals.iter().all(|at| *at + slack >= begin && *at <= end), "{begin:?}..{end:?}: {arrivals:?}");
    assert_eq!(running.finish().1.clock_steps, 1);
}

#[test]
fn a_small_receive_buffer_is_a_warning_with_its_remedy() {
    let clock = SessionClock::start_on_system();
    let source = open(UdpConfig { receive_buffer: 16 << 10, ..config("front") }, &clock);
    let info = source.describe();
    let [SourceWarning::SmallReceiveBuffer(buffer)] = info.warnings[..] else { panic!("{:?}", info.warnings) };
    assert_eq!(buffer.requested, 16 << 10);
    assert_eq!(buffer.granted, 16 << 10);
    assert!(info.warnings[0].to_string().contains("sysctl -w net.core.rmem_max="));
    let Device::Udp(udp) = info.device else { panic!("{:?}", info.device) };
    assert_eq!(udp.data, source.address());
    assert_ne!(udp.data.port(), 0, "the port chosen is the port reported");
}

/// Opens sources that fail as scripted.
struct Failing {
    sensor: SensorId,
    openings: u32,
    good: UdpOpener,
}

impl Opener for Failing {
    fn sensor(&self) -> &SensorId {
        &self.sensor
    }

    fn open(&mut self) -> Result<Box<dyn Source>, SourceError> {
        self.openings += 1;
        match self.openings {
            1 => self.good.open(),
            2 | 3 => Err(SourceError::NoSuchInterface { interface: "eth7".to_owned() }),
            _ => self.good.open(),
        }
    }
}

/// A source that delivers one packet and fails.
struct OneThenFail(SensorId);

impl Source for OneThenFail {
    fn describe(&self) -> SourceInfo {
        SourceInfo::new(self.0.clone(), Device::Stored)
    }

    fn run(self: Box<Self>, mut sink: Intake, _: StopToken) -> Result<Summary, SourceError> {
        sink.push(RigNs(1), lidar_packet(&self.0, &packet(0))).expect("open");
        sink.lost(LossPoint::Kernel, 3);
        Err(SourceError::NoSuchInterface { interface: "eth7".to_owned() })
    }
}

#[test]
fn a_source_that_fails_is_opened_again_and_each_change_is_an_event() {
    let clock = SessionClock::start_on_system();
    let mut ledger = Ledger::live(clock.clone());
    let intake = ledger.intake("front".into(), QueueBound::LIDAR_PACKETS);
    let events = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let stop = StopToken::new().expect("a descriptor");
    let opener = Failing { sensor: "front".into(), openings: 1, good: UdpOpener::new(config("front"), clock.clone()) };
    let (tell, told) = std::sync::mpsc::channel();
    let first: Box<dyn Source> = Box::new(OneThenFail("front".into()));
    let backoff = Backoff { first: Duration::from_millis(1), last: Duration::from_secs(8) };
    let source = supervise(Box::new(opener), Some(first), intake, clock, stop.clone(), backoff, move |notice| {
        tell.send(notice).expect("the test listens");
    })
    .expect("a thread");
    let state = |event: &Event| match event.body {
        Body::SensorState { state, .. } => Some(state),
        _ => None,
    };
    let opened_again =
        |events: &[Event]| events.iter().filter_map(state).filter(|s| *s == SourceState::Opened).count() == 2;
    let mut seen = collect_until(&events, opened_again);
    stop.stop();
    let summary = source.join();
    ledger.stop();
    seen.extend(events);
    let of_source: Vec<&Body> = seen.iter().map(|e| &e.body).filter(|b| b.sensor().is_some()).collect();
    let sensor = SensorId::from("front");
    let expected = [
        Body::SensorState { sensor: sensor.clone(), state: SourceState::Opened },
        lidar_packet(&sensor, &packet(0)),
        // What the failed run still owed comes before the news of its end.
        Body::Gap { sensor: sensor.clone(), lost: 3, place: LossPoint::Kernel },
        Body::SensorState { sensor: sensor.clone(), state: SourceState::Lost },
        Body::SensorState { sensor: sensor.clone(), state: SourceState::Opened },
        Body::SensorState { sensor, state: SourceState::Closed },
    ];
    assert_eq!(of_source, expected.iter().collect::<Vec<_>>());
    assert_eq!((summary.opened, summary.summary.delivered, summary.summary.lost_kernel), (2, 1, 3));
    assert!(summary.error.is_none());
    let retries: Vec<u128> = told
        .iter()
        .filter_map(|notice| match notice {
            Notice::Failed { retry_in, .. } => Some(retry_in.as_millis()),
            _ => None,
        })
        .collect();
    assert_eq!(retries, [1, 2, 4], "doubling");
}

#[test]
fn a_port_once_chosen_is_kept() {
    let clock = SessionClock::start_on_system();
    let mut opener = UdpOpener::new(config("front"), clock);
    let address = |source: &dyn Source| match source.describe().device {
        Device::Udp(udp) => (udp.data, udp.position),
        other => panic!("{other:?}"),
    };
    let first = opener.open().expect("opens");
    let chosen = address(first.as_ref());
    drop(first);
    let again = opener.open().expect("opens");
    assert_eq!(address(again.as_ref()), chosen);
}

#[test]
fn anchor_and_arrival_together_give_the_kernels_wall_time() {
    let clock = SessionClock::start_on_system();
    let source = open(config("front"), &clock);
    let to = source.address();
    let running = Running::start(source, clock);
    let from = sender();
    let unix = |time: SystemTime| time.duration_since(UNIX_EPOCH).expect("after 1970").as_nanos() as i64;
    let before = unix(SystemTime::now());
    from.send_to(&packet(0), to).expect("sent");
    let events = collect_until(&running.events, |events| packets(events) == 1);
    let after = unix(SystemTime::now());
    let anchor = |event: &Event| match event.body {
        Body::Anchor { unix } => Some((event.arrived, unix)),
        _ => None,
    };
    let (rig, wall) = events.iter().find_map(anchor).expect("the first event is an anchor");
    let UnixNs(arrived) = wall + (arrivals(&events)[0] - rig);
    // 1 ms for the pairs of readings.
    assert!(arrived >= before - 1_000_000 && arrived <= after + 1_000_000, "{before} {arrived} {after}");
    running.finish();
}

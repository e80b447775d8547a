//! Every packet that a LiDAR sent and that never came is counted, once, wherever it was lost: on real UDP over loopback,
//! through ledger and core.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use tumbled::session::Engine;
use tumbled_core::{ScanBoundaries, SensorHealth};
use tumbled_io::live::source::SourceCounters;
use tumbled_io::live::{
    Backoff, EventReceiver, Ledger, LedgerHandle, Opener, QueueBound, SessionClock, StopToken, Summary, Supervised,
    UdpConfig, UdpOpener, supervise,
};

use crate::support::rig;

/// So long is waited for what has to happen; a machine that is busy may take its time.
const PATIENCE: Duration = Duration::from_secs(30);
/// A burst: half a turn of the head.
const BURST: usize = 75;
/// A packet's time at the rig's rate: so the stamps run as fast as the clock, however unevenly the packets come.
const PACKET_TIME: Duration = Duration::from_nanos(rig::PACKET_NS as u64);

/// A LiDAR's sender and everything behind its socket; the test is the core's thread.
struct Session {
    socket: UdpSocket,
    to: SocketAddr,
    packets: Box<dyn Iterator<Item = Bytes>>,
    sent: u64,
    stop: StopToken,
    counters: Arc<SourceCounters>,
    source: Supervised,
    ledger: LedgerHandle,
    events: EventReceiver,
    engine: Engine,
}

impl Session {
    /// `core_bytes`: what may wait for the core before the ledger waits with it.
    fn start(receive_buffer: usize, queue: QueueBound, core_bytes: usize) -> Self {
        let clock = SessionClock::start_on_system();
        let mut ledger = Ledger::live(clock.clone());
        let mut config = UdpConfig::new("front".into());
        config.address = IpAddr::V4(Ipv4Addr::LOCALHOST);
        (config.port, config.position_port, config.receive_buffer) = (0, None, receive_buffer);
        let mut opener = UdpOpener::new(config, clock.clone());
        let open = opener.open().expect("loopback is there");
        let to = match open.describe().device {
            tumbled_io::live::Device::Udp(udp) => udp.data,
            other => panic!("{other:?}"),
        };
        let intake = ledger.intake("front".into(), queue);
        let counters = intake.counters();
        let mut boundaries = ScanBoundaries::new(&rig::lidar_core());
        // More scans may wait than ever do: none is shed.
        let events = ledger.core_with(Box::new(move |body| boundaries.begins(body)), core_bytes, usize::MAX);
        let ledger = ledger.start().expect("a thread");
        let stop = StopToken::new().expect("a descriptor");
        let source = supervise(Box::new(opener), Some(open), intake, clock, stop.clone(), Backoff::default(), |_| {})
            .expect("a thread");
        Self {
            socket: UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port"),
            to,
            packets: Box::new(rig::packets()),
            sent: 0,
            stop,
            counters,
            source,
            ledger,
            events,
            engine: rig::lidar_engine(),
        }
    }

    /// Sends bursts at the rig's rate on average, each as fast as the machine can.
    fn send_bursts(&mut self, bursts: usize) {
        let began = Instant::now();
        for burst in 1..=bursts {
            self.send(BURST);
            std::thread::sleep((PACKET_TIME * (BURST * burst) as u32).saturating_sub(began.elapsed()));
        }
    }

    fn send(&mut self, packets: usize) {
        for packet in self.packets.by_ref().take(packets) {
            self.socket.send_to(&packet, self.to).expect("sends");
            self.sent += 1;
        }
    }

    /// Two turns of the head, packet by packet at the rig's rate: any buffer has room for one.
    fn send_evenly(&mut self) {
        let began = Instant::now();
        for n in 1..=4 * BURST as u32 {
            self.send(1);
            std::thread::sleep((PACKET_TIME * n).saturating_sub(began.elapsed()));
        }
    }

    /// Lets the core have what waits for it, and what that made room for.
    fn take(&mut self) {
        let began = Instant::now();
        while began.elapsed() < Duration::from_millis(300) {
            self.events.recv_timeout(Duration::from_millis(1)).iter().for_each(|event| drop(self.engine.step(event)));
        }
    }

    /// Empties buffer and queue, sends a packet that finds room, and waits until it has told of those before it.
    fn send_one_that_arrives(&mut self) {
        self.take();
        self.send(1);
        let began = Instant::now();
        let known = |counts: Summary| counts.delivered + counts.lost_kernel + counts.lost_queue;
        while known(self.counters.snapshot()) < self.sent {
            assert!(began.elapsed() < PATIENCE, "{} sent, {:?}", self.sent, self.counters.snapshot());
            self.take();
        }
    }

    fn lidar(&self) -> SensorHealth {
        self.engine.sensors().swap_remove(0)
    }

    /// Ends it in order, the core taking all the while; the core has everything.
    fn end(mut self) -> (u64, SensorHealth) {
        self.stop.stop();
        let closing = std::thread::spawn(move || {
            let source = self.source.join();
            assert!(source.error.is_none(), "{source:?}");
            self.ledger.stop()
        });
        for event in self.events {
            self.engine.step(&event);
        }
        assert_eq!(closing.join().expect("no panic").undelivered, 0);
        self.engine.finish();
        (self.sent, self.engine.sensors().swap_remove(0))
    }
}

/// Sent = received + lost, and the head saw as much missing as the machine lost.
fn assert_exact(sent: u64, lidar: &SensorHealth) {
    assert_eq!(lidar.received + lidar.lost.total, sent, "{lidar:?}");
    assert_eq!(lidar.lost.by_stamps, lidar.lost.total, "{lidar:?}");
    assert_eq!(lidar.lost.kernel + lidar.lost.queue, lidar.lost.total, "{lidar:?}");
    assert_eq!((lidar.duplicates, lidar.reordered), (0, 0), "{lidar:?}");
}

#[test]
fn a_tiny_socket_buffer_loses_and_every_lost_packet_is_counted_once() {
    // The kernel gives no less than 2.3 kB: one packet as it accounts for them.
    let mut session = Session::start(0, QueueBound::LIDAR_PACKETS, usize::MAX);
    session.send_evenly();
    session.send_bursts(30);
    session.take();
    let before = session.lidar();
    assert!(before.lost.kernel > 0, "bursts of {BURST} found room for all: {before:?}");
    // What the last bursts lost the kernel tells with the next packet; until then it is not known, and not guessed.
    assert!(before.received + before.lost.total <= session.sent, "{before:?}");
    session.send_one_that_arrives();
    // And once more: no count is taken twice.
    session.send_bursts(10);
    session.send_one_that_arrives();
    let (sent, lidar) = session.end();
    assert_eq!(sent, 4 * 75 + 30 * 75 + 1 + 10 * 75 + 1);
    assert_eq!(lidar.lost.queue, 0);
    assert_exact(sent, &lidar);
}

#[test]
fn a_queue_that_runs_over_while_the_ledger_waits_is_counted_to_the_packet() {
    // The core takes nothing at first: with 20 kB waiting for it the ledger waits too, then the queue of 16 is full.
    let mut session = Session::start(4 << 20, QueueBound(16), 20_000);
    session.send_bursts(10);
    session.send_one_that_arrives();
    let (sent, lidar) = session.end();
    // 750 packets, of which some 14 fit before the core and 16 before the ledger.
    assert!(lidar.lost.queue > 600, "{lidar:?}");
    assert_eq!(lidar.lost.kernel, 0);
    assert_exact(sent, &lidar);
}

#[test]
fn what_is_lost_at_the_end_with_no_packet_behind_it_is_counted_all_the_same() {
    let mut session = Session::start(4 << 20, QueueBound(16), 20_000);
    session.send_bursts(4);
    let (sent, lidar) = session.end();
    // No stamp tells of the last of it: the queue's own count does, with the source's last words.
    assert_eq!(lidar.received + lidar.lost.total, sent, "{lidar:?}");
    assert!(lidar.lost.by_stamps < lidar.lost.total, "{lidar:?}");
    assert_eq!(lidar.lost.queue, lidar.lost.total);
}

#[test]
fn a_session_that_loses_nothing_says_nothing_was_lost() {
    let mut session = Session::start(4 << 20, QueueBound::LIDAR_PACKETS, usize::MAX);
    session.send_bursts(20);
    let (sent, lidar) = session.end();
    assert_eq!((lidar.received, lidar.lost.total), (sent, 0), "{lidar:?}");
    assert_exact(sent, &lidar);
    assert_eq!(lidar.points.in_epochs, sent * rig::PACKET_POINTS);
}

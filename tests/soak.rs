//! The daemon's own parts over hours of rig time: ledger, core, state stream and recorder at full speed.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::num::NonZeroU32;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tumbled::session::publish::Audience;
use tumbled::session::{Checkpoint, Engine, Publish, Step, engine, setup};
use tumbled::stream::{Limits, ShellHealth, StreamOrigin, StreamServer};
use tumbled_core::health::{Level, SensorKind};
use tumbled_core::{Epoch, Scan, SensorHealth, Workers};
use tumbled_io::live::{EventReceiver, Ledger, QueueBound};
use tumbled_io::recording::thread::ResultSink;
use tumbled_io::recording::{Reader, Recorder, RecorderOptions, RecorderThread, RecordingSummary};
use tumbled_model::{Body, UnixNs};

use crate::support::pcap::START_UNIX_S;
use crate::support::rig::{self, FRAME_HZ, PACKET_POINTS, Rig, TURN_NS};
use crate::support::stream::{hello, on_a_free_port, tcp_address};

const SECOND: i64 = 1_000_000_000;
const MINUTE: i64 = 60 * SECOND;
const HOUR: i64 = 60 * MINUTE;
/// Buffers find their sizes, clocks lock and the hour wraps: memory is looked at from here on.
const WARM_UP: i64 = 10 * MINUTE;
/// Columns and rows of the target that the Kinect sees: a frame costs the core what it has points for.
const TARGET: (usize, usize) = (512, 384);
/// Points of a CLOUD line.
const CLOUD_POINTS: usize = 500;

/// What the process takes of the machine.
#[derive(Clone, Copy, Debug)]
struct Sample {
    t_ns: i64,
    memory_bytes: u64,
    descriptors: u64,
}

impl Sample {
    fn now(t_ns: i64) -> Self {
        let status = std::fs::read_to_string("/proc/self/status").expect("Linux");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("VmRSS");
        let kilobytes: u64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
        let descriptors = std::fs::read_dir("/proc/self/fd").expect("Linux").count() as u64;
        Self { t_ns, memory_bytes: kilobytes * 1_024, descriptors }
    }
}

/// Holds the core's outputs against what must be.
#[derive(Default)]
struct Watch {
    epochs: u64,
    newest_t: i64,
    points: BTreeMap<String, u64>,
    epochs_of: BTreeMap<String, u64>,
    /// After a minute: where in its period each sensor's epochs lie, least and greatest, ns.
    phases: BTreeMap<String, (i64, i64)>,
    left_out: BTreeMap<String, u64>,
    healths: u64,
    samples: Vec<Sample>,
}

impl Watch {
    fn step(&mut self, step: &Step<'_>) {
        step.outputs.epochs.iter().for_each(|epoch| self.epoch(epoch));
        for health in &step.outputs.health {
            self.healths += 1;
            if health.t_ns > MINUTE {
                assert_eq!((health.level, &health.reasons), (Level::Ok, &Vec::new()), "at {} ns", health.t_ns);
            }
            for sensor in &health.sensors {
                assert_eq!((sensor.lost.total, sensor.duplicates, sensor.reordered), (0, 0, 0), "{sensor:?}");
                assert_eq!((sensor.epochs.late, sensor.epochs.shed_scans), (0, 0), "{sensor:?}");
                self.left_out.insert(sensor.id.clone(), sensor.epochs.points_left_out);
            }
            if health.t_ns % MINUTE == 0 {
                self.samples.push(Sample::now(health.t_ns));
            }
        }
    }

    fn epoch(&mut self, epoch: &Epoch) {
        assert_eq!(epoch.number, self.epochs, "numbered without gaps");
        assert!(epoch.t.0 >= self.newest_t, "epoch {} is earlier than the one before", epoch.number);
        (self.epochs, self.newest_t) = (self.epochs + 1, epoch.t.0);
        let sensor = epoch.sensor.to_string();
        // The piece of a turn at the session's end has no middle to be the time of.
        let whole = !matches!(&epoch.scan, Scan::Lidar(scan) if scan.coverage < 0.99);
        if epoch.t.0 > MINUTE && whole {
            // Thirds of a nanosecond do not add up: the phase of frame 30 n + k is taken in its own second.
            let t = epoch.t.0 % SECOND;
            let phase = if sensor == "near" {
                let frame = (t * FRAME_HZ + SECOND / 2) / SECOND;
                t - frame * SECOND / FRAME_HZ
            } else {
                t % TURN_NS
            };
            let (least, greatest) = self.phases.entry(sensor.clone()).or_insert((phase, phase));
            (*least, *greatest) = ((*least).min(phase), (*greatest).max(phase));
        }
        *self.points.entry(sensor.clone()).or_default() += epoch.scan.len() as u64;
        *self.epochs_of.entry(sensor).or_default() += 1;
    }
}

/// What a soak ended with.
struct Soaked {
    watch: Watch,
    sensors: Vec<SensorHealth>,
    checkpoint: Checkpoint,
    recording: RecordingSummary,
    /// Events, packets and frames that the source made.
    made: (u64, u64, u64),
    health_lines: u64,
    cut_off: u64,
    took: Duration,
}

/// Lets the rig run for `rig_ns` of its own time, as fast as it goes.
fn soak(rig_ns: i64, folder: &Path) -> Soaked {
    let began = Instant::now();
    let server = Arc::new(StreamServer::start(on_a_free_port(Limits::default()), &hello()).expect("a port"));
    let clients = Clients::connect(tcp_address(&server));
    let options = RecorderOptions {
        rotate_bytes: Some(64 << 20),
        keep: NonZeroU32::new(2),
        min_free: Some(1 << 30),
        ..RecorderOptions::default()
    };
    let recorder = Recorder::create(&folder.join("soak.mcap"), rig::header(), options).expect("a new file");

    let mut ledger = Ledger::replay();
    let mut intake = ledger.intake("front".into(), QueueBound::LIDAR_PACKETS);
    let recorder = RecorderThread::start(recorder, ledger.recorder()).expect("a thread");
    let core = spawn_core(ledger.core(Box::new(|_| false)), recorder.results(), Arc::clone(&server), began);
    let ledger = ledger.start().expect("a thread");

    let mut made = (0, 0, 0);
    for event in Rig::new(TARGET.0, TARGET.1).take_while(|event| event.arrived.0 <= rig_ns) {
        made.0 += 1;
        made.1 += u64::from(matches!(event.body, Body::LidarPacket { .. }));
        made.2 += u64::from(matches!(event.body, Body::DepthFrame { .. }));
        intake.push_recorded(event).expect("the ledger runs");
        // A claim that failed ends the soak now and not in an hour.
        if made.0 % 4_096 == 0 && core.is_finished() {
            break;
        }
    }
    drop(intake);
    let ledger = ledger.wait();
    let (watch, engine) = core.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    assert_eq!((ledger.events, ledger.undelivered), (made.0, 0));
    let recording = recorder.finish();
    let health_lines = clients.end();
    let cut_off = server.clients().cut_off;
    drop(server);
    let (sensors, checkpoint) = (engine.sensors(), engine.checkpoint());
    Soaked { watch, sensors, checkpoint, recording, made, health_lines, cut_off, took: began.elapsed() }
}

fn spawn_core(
    events: EventReceiver,
    results: ResultSink,
    server: Arc<StreamServer>,
    began: Instant,
) -> JoinHandle<(Watch, Engine)> {
    let config = tumbled::config::load(None, &[]).expect("the built-in config").config;
    let core = setup::core_config(&config).expect("a core");
    let mut engine = Engine::new(core, String::new(), Workers::none(), engine::interpreter(&config, false));
    let audience = Audience {
        stream: server.publisher(),
        max_cloud_points: CLOUD_POINTS,
        horizons: Vec::new(),
        viewers: None,
        web: None,
        telemetry: None,
        beat: None,
        surface: tumbled::session::surface::SurfaceTold::new(StreamOrigin::Simulated),
        truth: None,
    };
    let unix_at_zero = UnixNs(START_UNIX_S * SECOND);
    let mut publish = Publish::new(StreamOrigin::Simulated, unix_at_zero, Some(audience));
    let work = move || {
        let shell = || ShellHealth { stream: server.clients().into(), ..ShellHealth::default() };
        let (kind, mut watch) = (Checkpoint::kind(), Watch::default());
        for event in events {
            let step = engine.step(&event);
            watch.step(&step);
            publish.step(&step, shell, None);
            if let Some(checkpoint) = &step.checkpoint {
                // At full speed more come than a session has: what does not fit is left out, as there.
                results.put(&kind, checkpoint.to_message());
                if checkpoint.t_ns % HOUR == 0 {
                    tell_progress(checkpoint, watch.samples.last(), began);
                }
            }
        }
        let last = engine.finish();
        watch.step(&last);
        publish.step(&last, shell, None);
        publish.stop();
        (watch, engine)
    };
    std::thread::Builder::new().name("core".to_owned()).spawn(work).expect("a thread")
}

fn tell_progress(checkpoint: &Checkpoint, sample: Option<&Sample>, began: Instant) {
    let (hours, wall_s) = (checkpoint.t_ns / HOUR, began.elapsed().as_secs_f64());
    let speed = checkpoint.t_ns as f64 * 1e-9 / wall_s;
    let memory_mb = sample.map_or(0.0, |sample| sample.memory_bytes as f64 / 1e6);
    let Checkpoint { events, epochs, .. } = checkpoint;
    println!(
        "{hours} h in {wall_s:.0} s ({speed:.1} times as fast): {events} events, {epochs} epochs, {memory_mb:.1} MB"
    );
}

/// Two clients of the stream: one reads what it can, one never does and comes again when it is cut off.
struct Clients {
    stop: Arc<AtomicBool>,
    health_lines: Arc<AtomicU64>,
    threads: Vec<JoinHandle<()>>,
}

const SUBSCRIBE: &[u8] = b"{\"subscribe\":[\"HEALTH\",\"CLOUD\"]}\n";

impl Clients {
    fn connect(address: SocketAddr) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let health_lines = Arc::new(AtomicU64::new(0));
        let subscribed = move || {
            let mut stream = TcpStream::connect(address).expect("a server");
            stream.write_all(SUBSCRIBE).expect("sends");
            stream
        };
        let (reader, mute) = (BufReader::new(subscribed()), subscribed());
        let (count, told) = (Arc::clone(&health_lines), Arc::clone(&stop));
        let reading = std::thread::spawn(move || {
            for line in reader.lines().map_while(Result::ok) {
                count.fetch_add(u64::from(line.starts_with("{\"class\":\"HEALTH\"")), Ordering::Relaxed);
            }
        });
        let silent = std::thread::spawn(move || {
            let mut mute = mute;
            while !told.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(200));
                // The server resets a connection it cuts off.
                if mute.write_all(b"\n").is_err() {
                    mute = subscribed();
                }
            }
        });
        Self { stop, health_lines, threads: vec![reading, silent] }
    }

    /// Ends them once the server has ended their connections; gives the HEALTH lines that were read.
    fn end(self) -> u64 {
        self.stop.store(true, Ordering::Relaxed);
        let mut threads = self.threads.into_iter();
        let (reading, silent) = (threads.next(), threads.next());
        silent.into_iter().for_each(|thread| thread.join().expect("no panic"));
        drop(reading); // it ends with the server
        self.health_lines.load(Ordering::Relaxed)
    }
}

/// Everything that was made is in epochs and in the recording, once.
fn assert_accounted(soaked: &Soaked) {
    let Soaked { watch, sensors, checkpoint, recording, made, .. } = soaked;
    assert_eq!((checkpoint.events, checkpoint.epochs), (made.0, watch.epochs));
    let pixels = (TARGET.0 * TARGET.1) as u64;
    for sensor in sensors {
        let points = sensor.points;
        let (received, each) = match sensor.kind {
            SensorKind::Lidar => (made.1, PACKET_POINTS),
            _ => (made.2, pixels),
        };
        assert_eq!((sensor.received, points.decoded), (received, received * each), "{sensor:?}");
        assert_eq!(points.in_epochs, points.decoded, "{sensor:?}");
        assert_eq!((points.duplicate, points.late, points.untimed, points.shed), (0, 0, 0, 0));
        assert_eq!(watch.points[&sensor.id] + watch.left_out[&sensor.id], points.in_epochs, "{}", sensor.id);
        assert!(sensor.malformed.is_empty() && sensor.lost.total == 0, "{sensor:?}");
        let clock = sensor.clock.expect("it has one");
        assert_eq!((clock.state.name(), clock.resets, clock.steps, clock.doubtful), ("locked", 0, 0, 0), "{clock:?}");
    }
    // Through hours and wraps a sensor's epochs stay where they lie in its period, to the jitter of the arrivals.
    for (sensor, (least, greatest)) in &watch.phases {
        assert!(greatest - least < 200_000, "{sensor}: {least} to {greatest} ns");
    }
    assert_eq!((recording.counters.events, recording.counters.last_seq), (made.0, Some(made.0 - 1)));
    assert!(recording.stopped.is_none() && recording.unrecordable == 0 && recording.after_stop == 0);
    let mut reader = Reader::open(&recording.parts).expect("the parts that were kept");
    let seqs: Vec<u64> = reader.by_ref().map(|event| event.expect("reads").seq).collect();
    assert!(seqs.windows(2).all(|pair| pair[1] == pair[0] + 1) && seqs.last() == Some(&(made.0 - 1)));
}

fn median(values: impl Iterator<Item = u64>) -> u64 {
    let mut values: Vec<u64> = values.collect();
    values.sort_unstable();
    values[values.len() / 2]
}

#[test]
fn ten_seconds_at_full_speed_are_accounted_for_to_the_point() {
    let folder = tempfile::tempdir().expect("a folder");
    let soaked = soak(10 * SECOND, folder.path());
    assert_accounted(&soaked);
    // Health at 1.2, 2.2, … s. The head passes the cut 100 times, which makes 101 pieces; frame 299 comes at 9.99 s.
    let epochs = &soaked.watch.epochs_of;
    assert_eq!((soaked.watch.healths, epochs["front"], epochs["near"]), (9, 101, 300));
}

/// Rig time is taken from SOAK_HOURS, 8 without it.
#[test]
#[ignore = "half an hour in a release build: .ci/long runs it"]
fn soak_eight_hours() {
    let hours: f64 = std::env::var("SOAK_HOURS").map_or(8.0, |hours| hours.parse().expect("a number of hours"));
    let folder = tempfile::tempdir().expect("a folder");
    let rig_ns = (hours * HOUR as f64) as i64;
    let soaked = soak(rig_ns, folder.path());
    assert_accounted(&soaked);

    let samples: Vec<Sample> = soaked.watch.samples.iter().copied().filter(|sample| sample.t_ns >= WARM_UP).collect();
    assert!(samples.len() >= 2, "more than 10 minutes are needed to tell");
    // The first and the last hour, or halves of what there is.
    let window = samples.len().div_ceil(2).min(60);
    let medians = |of: fn(&Sample) -> u64| {
        (median(samples[..window].iter().map(of)), median(samples[samples.len() - window..].iter().map(of)))
    };
    let (memory_first, memory_last) = medians(|sample| sample.memory_bytes);
    let (descriptors_first, descriptors_last) = medians(|sample| sample.descriptors);
    let growth = memory_last as f64 / memory_first as f64 - 1.0;
    let wall_s = soaked.took.as_secs_f64();
    println!(
        "soak: {hours} h of rig time in {wall_s:.0} s ({:.1} times as fast): {} events, {} epochs, {:.1} GB recorded in {} \
         parts; memory {:.1} MB in the first hour, {:.1} MB in the last: {:+.2} %; descriptors {descriptors_first} and \
         {descriptors_last}; {} HEALTH lines read of {}; {} times cut off; times within their periods, ns: {:?}",
        hours * 3_600.0 / wall_s,
        soaked.made.0,
        soaked.watch.epochs,
        soaked.recording.file_bytes as f64 / 1e9,
        soaked.recording.parts.len() as u64 + soaked.recording.removed,
        memory_first as f64 / 1e6,
        memory_last as f64 / 1e6,
        growth * 100.0,
        soaked.health_lines,
        soaked.watch.healths,
        soaked.cut_off,
        soaked.watch.phases,
    );
    assert!(growth < 0.01, "memory grew from {memory_first} to {memory_last} bytes");
    assert_eq!(descriptors_first, descriptors_last);
}

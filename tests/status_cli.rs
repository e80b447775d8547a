//! `tumbled status` against a server of the state stream.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use socket2::{Domain, Socket, Type};
use tumbled::cli::status::StatusReport;
use tumbled::config::UnixPath;
use tumbled::simulation::live::shortfall::ShortfallReport;
use tumbled::stream::{
    Class, HealthLine, Limits, QueueHealth, QueueUnit, RecorderHealth, RecorderStatus, ShellHealth, SimulationHealth,
    SourceHealth, StepHealth, StreamConfig, StreamOrigin, StreamServer,
};
use tumbled_core::ClockMode;
use tumbled_core::clock::ClockState;
use tumbled_core::health::{
    ClockHealth, CoreHealth, EpochHealth, Level, LidarHealth, LossHealth, PointHealth, Reason, SensorHealth,
    SensorKind, SensorState, WallHealth,
};
use tumbled_model::{RigNs, UnixNs};

use crate::support::stream::{hello, server, tcp_address};
use crate::support::{Done, Workbench, repository};

/// A rig whose LiDAR runs and whose Kinect was unplugged.
fn health() -> HealthLine {
    let front = SensorHealth {
        id: "front".to_owned(),
        kind: SensorKind::Lidar,
        state: SensorState::Live,
        received: 18_000,
        bytes: 21_708_000,
        rate_hz: 1_507.0,
        age_ns: Some(2_000_000),
        lost: LossHealth { total: 5, by_stamps: 5, kernel: 3, ..LossHealth::default() },
        malformed: [("length".to_owned(), 2)].into(),
        malformed_first: [("length".to_owned(), "a data packet has 1206 bytes, this payload has 7".to_owned())].into(),
        duplicates: 0,
        reordered: 0,
        points: PointHealth::default(),
        epochs: EpochHealth::default(),
        clock: Some(ClockHealth {
            state: ClockState::Locked,
            mode: ClockMode::Hull,
            offset_ns: -1_234_567_890,
            skew_ppm: 3.12,
            sigma_ns: 21_000,
            resets: 0,
            steps: 0,
            doubtful: 0,
        }),
        lidar: Some(LidarHealth {
            model: Some("VLP-32C".to_owned()),
            return_mode: Some("strongest".to_owned()),
            rpm: Some(600.4),
            points_in_roi: 812,
            ..LidarHealth::default()
        }),
        kinect: None,
        turntable: None,
    };
    let near = SensorHealth {
        id: "near".to_owned(),
        kind: SensorKind::Kinect,
        state: SensorState::Absent,
        received: 0,
        bytes: 0,
        rate_hz: 0.0,
        age_ns: None,
        lost: LossHealth::default(),
        malformed: [].into(),
        malformed_first: [].into(),
        clock: None,
        lidar: None,
        ..front.clone()
    };
    let core = CoreHealth {
        t_ns: 12_000_000_000,
        level: Level::Degraded,
        reasons: vec![Reason {
            level: Level::Degraded,
            sensor: Some("near".to_owned()),
            key: "absent".to_owned(),
            message: "was never seen: is it plugged in?".to_owned(),
        }],
        sensors: vec![front, near],
        wall: WallHealth::default(),
    };
    let shell = ShellHealth {
        reasons: Vec::new(),
        uptime_s: 12.3,
        memory_bytes: Some(88_080_384),
        sources: vec![SourceHealth { sensor: "near".to_owned(), opened: 0, cause: None }],
        queues: vec![QueueHealth {
            name: "front -> ledger".to_owned(),
            unit: QueueUnit::Items,
            waiting: 7,
            bound: 4_096,
            lost: 0,
        }],
        shed_scans: 2,
        run: None,
        pretrigger_bytes: 0,
        watchdog_feeds: 0,
        recorder: Some(RecorderHealth {
            state: RecorderStatus::Recording,
            file: "run.mcap".to_owned(),
            bytes: 104_857_600,
            dropped: 0,
            synced_s: Some(0.42),
            disk_free_bytes: Some(107_374_182_400),
        }),
        simulation: Some(SimulationHealth {
            scene: "demo".to_owned(),
            left_out: ShortfallReport { left_out_s: 0.3, late: 40, refused: 0, latest_ms: 98.0 },
        }),
        stream: server(Limits::default()).clients().into(),
        steps: vec![StepHealth { name: "core".to_owned(), p50_ms: 0.81, p99_ms: 2.5, max_ms: 9.0 }],
    };
    let at = (RigNs(12_300_000_000), UnixNs(1_795_341_612_300_000_000));
    HealthLine::new(StreamOrigin::Simulated, at, core, None, shell)
}

/// Publishes health every 20 ms while the command runs.
fn while_publishing<T>(server: &StreamServer, health: &HealthLine, command: impl FnOnce() -> T) -> T {
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                server.publisher().publish(Class::Health, health);
                thread::sleep(Duration::from_millis(20));
            }
        });
        let result = command();
        done.store(true, Ordering::Relaxed);
        result
    })
}

fn status(server: &StreamServer, health: &HealthLine, more: &[&str]) -> Done {
    let address = tcp_address(server).to_string();
    let arguments = [&["status", "--connect", &address], more].concat();
    while_publishing(server, health, || Workbench::new().run(&arguments))
}

#[test]
fn the_table_says_in_plain_words_what_is_wrong() {
    let server = server(Limits::default());
    let done = status(&server, &health(), &[]);
    let text = done.transcript().replace(tumbled::cli::VERSION, "VERSION");
    insta::assert_snapshot!("status", text.replace(&tcp_address(&server).to_string(), "ADDRESS"));
}

#[test]
fn json_is_hello_and_health() {
    let server = server(Limits::default());
    let done = status(&server, &health(), &["--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: StatusReport = done.json();
    assert_eq!((report.hello, report.health), (hello(), health()));
}

#[test]
fn a_level_that_is_failed_is_exit_code_3() {
    let server = server(Limits::default());
    let mut failed = health();
    failed.level = Level::Failed;
    let done = status(&server, &failed, &[]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    assert!(done.stdout.contains("FAILED after 12.3 s"), "{}", done.stdout);
}

#[test]
fn a_unix_socket_is_named_by_its_path() {
    let bench = Workbench::new();
    let unix = Some(UnixPath { path: bench.path("state.sock"), configured: true });
    let server = StreamServer::start(StreamConfig { unix, ..StreamConfig::default() }, &hello()).expect("starts");
    let done = while_publishing(&server, &health(), || bench.run(&["status", "--connect", "./state.sock"]));
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(done.stdout.starts_with("SIMULATED"), "{}", done.stdout);
}

#[test]
fn watch_appends_block_after_block_where_there_is_no_terminal_until_ctrl_c() {
    let server = server(Limits::default());
    while_publishing(&server, &health(), || {
        let mut child = Command::new(assert_cmd::cargo::cargo_bin!("tumbled"))
            .args(["status", "--watch", "--json", "--connect", &tcp_address(&server).to_string()])
            .current_dir(repository())
            .stdout(Stdio::piped())
            .spawn()
            .expect("tumbled starts");
        let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        for line in lines.take(3) {
            let report: StatusReport = serde_json::from_str(&line.expect("a line")).expect("a report");
            assert_eq!(report.health, health());
        }
        let killed = Command::new("kill").args(["-s", "INT", &child.id().to_string()]).status().expect("kill");
        assert!(killed.success());
        assert!(child.wait().expect("ends").success());
    });
}

#[test]
fn nobody_there_is_exit_code_1_with_the_address_and_a_remedy() {
    // Bound and not listening: nobody answers, and no other test is given the port.
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).expect("a socket");
    socket.bind(&SocketAddr::from(([127, 0, 0, 1], 0)).into()).expect("a port");
    let gone = socket.local_addr().expect("bound").as_socket().expect("an address").to_string();
    let done = Workbench::new().run(&["status", "--connect", &gone]);
    assert_eq!((done.code, done.stdout.as_str()), (1, ""));
    assert!(done.stderr.contains(&gone) && done.stderr.contains("tumbled run"), "{}", done.stderr);
}

#[test]
fn a_daemon_that_says_nothing_is_told_from_one_without_health() {
    let mute = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = mute.local_addr().expect("bound").to_string();
    let done = Workbench::new().run(&["status", "--connect", &address]);
    assert_eq!(done.code, 1);
    assert!(done.stderr.contains("no HELLO came") && done.stderr.contains("3 s"), "{}", done.stderr);

    let stuck = server(Limits::default());
    let done = Workbench::new().run(&["status", "--connect", &tcp_address(&stuck).to_string()]);
    assert_eq!(done.code, 1);
    assert!(done.stderr.contains("no HEALTH came"), "{}", done.stderr);
}

#[test]
fn another_program_is_not_taken_for_a_daemon() {
    for said in ["SSH-2.0-OpenSSH_9.2\r\n", "{\"class\":\"VERSION\",\"release\":\"3.22\"}\n", "{\"class\":\"HELLO\"}\n"]
    {
        let other = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = other.local_addr().expect("bound").to_string();
        let saying = thread::spawn(move || {
            let (mut stream, _) = other.accept().expect("a client");
            stream.write_all(said.as_bytes()).expect("sends");
            // Until the client has seen enough: a close with its bytes unread would take ours back.
            std::io::copy(&mut stream, &mut std::io::sink()).unwrap_or_default();
        });
        let done = Workbench::new().run(&["status", "--connect", &address]);
        assert_eq!(done.code, 1, "{said}");
        assert!(done.stderr.contains("is no HELLO of tumbled"), "{}", done.stderr);
        saying.join().expect("no panic");
    }
}

#[test]
fn what_the_daemon_says_when_it_refuses_is_passed_on() {
    let server = server(Limits { clients: 0, ..Limits::default() });
    let done = Workbench::new().run(&["status", "--connect", &tcp_address(&server).to_string()]);
    assert_eq!(done.code, 1);
    assert!(done.stderr.contains("there are 0 clients already"), "{}", done.stderr);
}

#[test]
fn a_place_that_is_none_is_bad_usage() {
    let done = Workbench::new().run(&["status", "--connect", "7117"]);
    assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{}", done.stderr);
}

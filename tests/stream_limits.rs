//! No client costs the others anything, or the daemon more than its bounds.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::{SocketAddr, TcpStream};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use tumbled::stream::{Class, Limits};

use crate::support::Workbench;
use crate::support::stream::{Client, large, marked, server, tcp_address, wait_until};

#[test]
fn a_client_that_never_reads_delays_nobody_and_is_cut_off() {
    const LINES: usize = 400; // 200 a second for 2 s
    let limits = Limits { lag: Duration::from_millis(500), ..Limits::default() };
    let server = server(limits.clone());
    let mute = Client::connect(&server);
    let mut client = Client::connect(&server);
    let reading = thread::spawn(move || (0..LINES).map(|_| client.next()).collect::<Vec<_>>());
    let publisher = server.publisher();
    let started = Instant::now();
    for mark in 0..LINES {
        publisher.publish_json(Class::Health, large(Class::Health, mark, 50_000));
        let waiting = server.clients();
        // Two clients; the line that made a queue overflow is in it before the oldest goes, but never seen.
        assert!(waiting.queued_bytes <= 2 * (limits.data_bytes + limits.control_bytes), "{waiting:?}");
        assert!(waiting.queued_lines <= 2 * (limits.data_lines + limits.control_lines), "{waiting:?}");
        let due = Duration::from_millis(5) * mark as u32;
        thread::sleep(due.saturating_sub(started.elapsed()));
    }
    for (mark, line) in reading.join().expect("no panic").iter().enumerate() {
        assert_eq!((&line["mark"], &line["dropped"]), (&json!(mark), &json!(0)));
    }
    wait_until("the mute client is cut off", || server.clients().cut_off == 1);
    drop(mute);
    wait_until("nobody is left", || server.clients().clients == 0);
    assert_eq!(server.clients().queued_bytes, 0);
}

#[test]
fn a_client_that_lets_events_pile_up_is_cut_off_since_none_may_be_dropped() {
    let limits = Limits { lag: Duration::from_secs(600), ..Limits::default() };
    let server = server(limits);
    let mut client = Client::connect(&server);
    client.subscribe(&server, &[Class::Event], None);
    let publisher = server.publisher();
    let mut published = 0;
    while server.clients().cut_off == 0 {
        publisher.publish_json(Class::Event, large(Class::Event, published, 100_000));
        published += 1;
        assert!(published < 10_000, "{:?}", server.clients());
        thread::sleep(Duration::from_millis(1));
    }
    // What it did get has no gap.
    let mut expected = 0;
    while let Ok(Some(line)) = client.try_text() {
        let Ok(line) = serde_json::from_str::<serde_json::Value>(&line) else { break }; // cut in the middle of a line
        assert_eq!((&line["mark"], &line["dropped"]), (&json!(expected), &json!(0)));
        expected += 1;
    }
    assert!(expected > 0 && server.clients().dropped == 0);
}

#[test]
fn the_thirty_third_client_is_refused_with_a_reason() {
    let server = server(Limits::default());
    let clients: Vec<_> = (0..32).map(|_| Client::connect(&server)).collect();
    let stream = TcpStream::connect(tcp_address(&server)).expect("connects");
    let mut line = String::new();
    let mut reader = std::io::BufReader::new(stream);
    std::io::BufRead::read_line(&mut reader, &mut line).expect("a line");
    let error: serde_json::Value = serde_json::from_str(&line).expect("JSON");
    assert_eq!((&error["class"], &error["code"]), (&json!("ERROR"), &json!("too_many_clients")));
    assert_eq!(std::io::Read::read(&mut reader, &mut [0]).expect("the end"), 0);
    assert_eq!((server.clients().clients, server.clients().refused), (32, 1));
    drop(clients);
    wait_until("all have left", || server.clients().clients == 0);
    Client::connect(&server);
}

#[test]
fn a_thousand_connects_disturb_nobody_and_leave_nothing_behind() {
    let server = server(Limits::default());
    let address = tcp_address(&server);
    let mut client = Client::connect(&server);
    assert_eq!(sockets_of(address), 2, "the listener and the client");
    let storm = thread::spawn(move || {
        for _ in 0..1_000 {
            drop(TcpStream::connect(address).expect("connects"));
            thread::sleep(Duration::from_micros(500));
        }
    });
    let publisher = server.publisher();
    let mut mark = 0;
    while !storm.is_finished() {
        publisher.publish_json(Class::Health, marked(Class::Health, mark));
        let line = client.next();
        assert_eq!((&line["mark"], &line["dropped"]), (&json!(mark), &json!(0)));
        mark += 1;
    }
    storm.join().expect("no panic");
    wait_until("all were answered and only the steady client is left", || {
        let totals = server.clients();
        totals.accepted + totals.refused == 1_001 && totals.clients == 1
    });
    wait_until("the descriptors are back to what they were", || sockets_of(address) == 2);
    publisher.publish_json(Class::Health, marked(Class::Health, mark));
    assert_eq!(client.next()["mark"], json!(mark));
}

#[test]
fn a_client_that_says_nothing_is_served_all_the_same() {
    let server = server(Limits { lag: Duration::from_millis(50), ..Limits::default() });
    let mut client = Client::connect(&server);
    // Longer than the lag limit: nothing waits for it, so it does not lag.
    thread::sleep(Duration::from_millis(200));
    server.publisher().publish_json(Class::Health, marked(Class::Health, 0));
    assert_eq!(client.next()["class"], "HEALTH");
}

/// Sockets of this process that are bound to the server's address: its listener and its clients' connections. Other
/// tests of the same process do not count.
fn sockets_of(server: SocketAddr) -> usize {
    let port = format!(":{:04X}", server.port());
    let table = fs::read_to_string("/proc/self/net/tcp").expect("the table of TCP sockets");
    let inodes: Vec<String> = table
        .lines()
        .skip(1)
        .map(|line| line.split_whitespace().collect::<Vec<_>>())
        .filter(|columns| columns[1].ends_with(&port))
        .map(|columns| format!("socket:[{}]", columns[9]))
        .collect();
    let descriptors = fs::read_dir("/proc/self/fd").expect("descriptors");
    descriptors
        .flatten()
        .filter_map(|descriptor| fs::read_link(descriptor.path()).ok())
        .filter(|target| inodes.iter().any(|inode| target.as_os_str() == inode.as_str()))
        .count()
}

#[test]
fn a_daemon_without_descriptors_left_says_so_once_and_goes_on_when_there_are_some() {
    // A running daemon has 17 descriptors: of 40 clients some 13 get one, the others wait in the kernel.
    let bench = Workbench::new();
    bench.file("rig.toml", "kinect = []\n");
    let command = "ulimit -n 30; exec \"$0\" run --config rig.toml --set lidar.port=0 --set lidar.position_port=0 --set stream.tcp=127.0.0.1:0 --set stream.unix= --set stream.foxglove=";
    let mut child = Command::new("sh")
        .args(["-c", command])
        .current_dir(bench.path("."))
        .arg(assert_cmd::cargo::cargo_bin!("tumbled"))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("tumbled starts");
    let mut log = BufReader::new(child.stderr.take().expect("piped")).lines().map(|line| line.expect("UTF-8"));
    let started = log.find(|line| line.contains("state stream")).expect("the line that says where");
    let address = started.split_whitespace().find_map(|word| word.strip_prefix("tcp=")).expect("the address");
    // By then it has all the descriptors it needs.
    assert!(log.any(|line| line.contains("sensor_state")));
    let clients: Vec<TcpStream> = (0..40).map(|_| TcpStream::connect(address).expect("connects")).collect();
    assert!(log.any(|line| line.contains("cannot accept clients for now")));
    // It tries again ten times a second; that is not logged again.
    thread::sleep(Duration::from_millis(500));
    drop(clients);
    let next = log.find(|line| line.contains("accept")).expect("a line about it");
    let errors = next.split_whitespace().find_map(|word| word.strip_prefix("errors=")?.parse::<u64>().ok());
    assert!(next.contains("accepts clients again") && errors.is_some_and(|errors| errors >= 2), "{next}");
    Client::greeted(TcpStream::connect(address).expect("connects"));
    let killed = Command::new("kill").args(["-s", "INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    // The log is read to its end, so that the daemon does not wait for its reader.
    log.for_each(drop);
    assert!(child.wait().expect("ends").success());
}

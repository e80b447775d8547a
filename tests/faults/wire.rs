//! Cases 1 and 4 on real UDP: a network that loses, repeats and overtakes. The kernel's own where that is to be had
//! (root, iproute2, netem: in a network namespace of the test's), else the sender does it.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::Command;
use std::time::{Duration, Instant};

use bytes::Bytes;
use nix::sched::{CloneFlags, unshare};
use tumbled::cli::run::RunReport;
use tumbled_sim::noise::Noise;

use crate::support::Workbench;
use crate::support::daemon::Daemon;
use crate::support::rig::{self, PACKET_NS, PACKET_POINTS};

/// What a network does to packets.
#[derive(Clone, Copy)]
enum Network {
    /// Loses one in a hundred.
    Loses,
    /// Lets one in twenty overtake three others, and repeats one in twenty.
    Shakes,
}

impl Network {
    /// The same in the words of `tc`. 2 ms are three packets of the rig.
    const fn netem(self) -> &'static [&'static str] {
        match self {
            Self::Loses => &["loss", "1%"],
            Self::Shakes => &["delay", "2ms", "reorder", "5%", "duplicate", "5%"],
        }
    }
}

/// Takes this thread and what it starts into a network namespace whose loopback does so; why not, if not.
fn kernel_network(network: Network) -> Result<(), String> {
    unshare(CloneFlags::CLONE_NEWNET).map_err(|error| format!("no network namespace: {error}"))?;
    let run = |program: &str, arguments: &[&str]| {
        let done = Command::new(program).args(arguments).output().map_err(|error| format!("{program}: {error}"))?;
        let said = String::from_utf8_lossy(&done.stderr).trim().to_owned();
        if done.status.success() { Ok(()) } else { Err(format!("{program}: {said}")) }
    };
    run("ip", &["link", "set", "lo", "up"])?;
    let netem = [&["qdisc", "add", "dev", "lo", "root", "netem", "limit", "10000"], network.netem()].concat();
    run("tc", &netem)
}

/// How many packets the kernel's network has lost.
fn kernel_lost() -> u64 {
    let shown = Command::new("tc").args(["-s", "qdisc", "show", "dev", "lo"]).output().expect("tc was there");
    let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
    let word = shown.split("dropped ").nth(1).and_then(|rest| rest.split([',', ' ']).next());
    word.and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("what tc shows: {shown}"))
}

/// What was sent and what a network did to it; where the kernel did, some of it is not known.
#[derive(Debug, Default)]
struct Sent {
    packets: u64,
    lost: Option<u64>,
    repeated: Option<u64>,
    overtaken: Option<u64>,
}

/// Sends the rig's packets at its rate, with the faults or, for a kernel that makes them, without.
fn send(to: SocketAddr, packets: u64, network: Option<Network>) -> Sent {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let mut noise = Noise::new(11, "network", 0);
    let mut held: Option<(Bytes, u64)> = None;
    let (mut lost, mut repeated, mut overtaken) = (0, 0, 0);
    let began = Instant::now();
    let send = |packet: &Bytes| assert_eq!(socket.send_to(packet, to).expect("sends"), packet.len());
    for (n, packet) in (0..packets).zip(rig::packets()) {
        let between = 0 < n && n + 8 < packets; // the stamps tell of what is between others
        match network {
            Some(Network::Loses) if between && noise.chance(0.01) => lost += 1,
            Some(Network::Shakes) if between && held.is_none() && noise.chance(0.05) => held = Some((packet, n + 3)),
            Some(Network::Shakes) if between && noise.chance(0.05) => {
                repeated += 1;
                send(&packet);
                send(&packet);
            }
            _ => send(&packet),
        }
        if let Some((late, _)) = held.take_if(|(_, until)| *until <= n) {
            overtaken += 1;
            send(&late);
        }
        let due = Duration::from_nanos((n as i64 * PACKET_NS) as u64);
        std::thread::sleep(due.saturating_sub(began.elapsed()));
    }
    let known = |count: u64| network.map(|_| count);
    Sent { packets, lost: known(lost), repeated: known(repeated), overtaken: known(overtaken) }
}

/// A daemon behind such a network for so long.
fn run(network: Network, seconds: f64) -> (Sent, RunReport) {
    // On a thread of its own: the namespace is not to outlive the test.
    let session = move || {
        let kernel = kernel_network(network);
        match &kernel {
            Ok(()) => println!("faults by the kernel: netem {}", network.netem().join(" ")),
            Err(why) => println!("faults by the sender, as the kernel makes none here ({why})"),
        }
        let bench = Workbench::new();
        bench.file("rig.toml", "kinect = []\n[stream]\ntcp = \"127.0.0.1:0\"\nunix = \"\"\nfoxglove = \"\"\n");
        let daemon = Daemon::start(&bench, &["run", "--config", "rig.toml", "--json", "--min-free", "0"]);
        let packets = (seconds * 1e9 / PACKET_NS as f64) as u64;
        let mut sent = send(daemon.data, packets, kernel.is_err().then_some(network));
        if kernel.is_ok() {
            sent.lost = Some(kernel_lost());
        }
        std::thread::sleep(Duration::from_millis(500));
        daemon.signal("TERM");
        let ended = daemon.finish();
        (sent, serde_json::from_str(&ended.report).unwrap_or_else(|error| panic!("{error} in {ended:?}")))
    };
    std::thread::spawn(session).join().expect("judged")
}

fn assert_losses_are_counted(seconds: f64) {
    let (sent, report) = run(Network::Loses, seconds);
    let front = &report.sensors[0];
    let lost = sent.lost.expect("known either way");
    println!("case 1 live: {} counted of {lost} lost of {}", front.lost.total, sent.packets);
    assert!(lost > 0 && lost < sent.packets / 50, "{sent:?}");
    // Of what the kernel loses the first or the last packet may be part, of which no stamp tells.
    let slack = (lost / 500).max(2);
    assert!(front.lost.total.abs_diff(lost) <= slack, "{sent:?} {front:?}");
    assert_eq!(front.received + lost, sent.packets);
    assert_eq!(front.lost.kernel + front.lost.queue, 0, "none of it on this machine");
    assert_eq!((front.duplicates, front.reordered), (0, 0));
}

fn assert_points_count_once(seconds: f64) {
    let (sent, report) = run(Network::Shakes, seconds);
    let front = &report.sensors[0];
    println!("case 4 live: {} late, {} twice of {}", front.reordered, front.duplicates, sent.packets);
    assert_eq!((front.received - front.duplicates, front.lost.total), (sent.packets, 0), "{front:?}");
    assert!(front.reordered > 0 && front.duplicates > 0, "{front:?}");
    assert!(sent.repeated.is_none_or(|repeated| repeated == front.duplicates), "{sent:?} {front:?}");
    assert!(sent.overtaken.is_none_or(|overtaken| overtaken == front.reordered), "{sent:?} {front:?}");
    // A busy machine may shed a scan, and counts it.
    let points = front.points;
    assert_eq!(points.in_epochs + points.shed, sent.packets * PACKET_POINTS, "{front:?}");
    assert_eq!((points.late, points.untimed, points.duplicate), (0, 0, front.duplicates * PACKET_POINTS), "{front:?}");
}

#[test]
fn case_01_what_a_network_loses_is_counted() {
    assert_losses_are_counted(4.0);
}

#[test]
#[ignore = "a minute: .ci/long runs it"]
fn case_01_what_a_network_loses_in_a_minute_is_counted() {
    assert_losses_are_counted(60.0);
}

#[test]
fn case_04_what_a_network_shakes_is_used_once() {
    assert_points_count_once(4.0);
}

#[test]
#[ignore = "a minute: .ci/long runs it"]
fn case_04_what_a_network_shakes_in_a_minute_is_used_once() {
    assert_points_count_once(60.0);
}

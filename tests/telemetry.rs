//! UDP telemetry: the published layout is the daemon's, and the clients in other languages read it.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use tumbled::stream::StreamOrigin;
use tumbled::telemetry::published::{DESCRIPTION, HEADER, description, header, python_format};
use tumbled::telemetry::{Telemetry, TelemetrySender};

use crate::support::repository;

/// What is generated: files and their texts.
pub(crate) fn generated() -> [(&'static str, String); 2] {
    [(HEADER, header()), (DESCRIPTION, description())]
}

#[test]
fn header_and_description_are_those_of_the_table() {
    for (file, text) in generated() {
        let committed = fs::read_to_string(repository().join(file)).unwrap_or_default();
        assert!(committed == text, "{file} is not what the table says: cargo test --test main -- --ignored regenerate");
    }
    let client = fs::read_to_string(repository().join("examples/telemetry_client.py")).expect("the Python client");
    assert!(client.contains(&format!("\"{}\"", python_format())), "the Python client reads another layout");
}

/// A client that listens, and where.
struct Client {
    child: Child,
    said: BufReader<std::process::ChildStderr>,
    address: SocketAddr,
}

impl Client {
    fn start(command: &mut Command) -> Self {
        command.args(["--port", "0"]).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the client starts");
        let mut said = BufReader::new(child.stderr.take().expect("its stderr"));
        let mut line = String::new();
        said.read_line(&mut line).expect("its first line");
        let address = line.trim().strip_prefix("listening on ").and_then(|address| address.parse().ok());
        let address = address.unwrap_or_else(|| panic!("the client said {line:?}"));
        Self { child, said, address }
    }

    /// Its exit code, stdout, and what else it said on stderr.
    fn end(mut self) -> (Option<i32>, String, String) {
        let (mut out, mut said) = (String::new(), String::new());
        self.said.read_to_string(&mut said).expect("its stderr");
        self.child.stdout.take().expect("its stdout").read_to_string(&mut out).expect("its stdout");
        (self.child.wait().expect("it ends").code(), out, said)
    }
}

fn state(t_ns: i64) -> Telemetry {
    Telemetry {
        mode: 2,
        validity: 1,
        kind: 1,
        position_m: [2.5, -0.25, 0.125],
        rotation_xyzw: [0.5, -0.5, 0.5, 0.5],
        ..Telemetry::nothing_known(t_ns, 1_700_000_000_000_000_000)
    }
}

/// What every client has to do; `client` makes its command.
fn reads_and_refuses(client: impl Fn() -> Command) {
    // Four good ones, of which the second is lost on the way and another comes again; and three that are no datagrams.
    let listening = Client::start(client().args(["--count", "3"]));
    let relay = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let here = relay.local_addr().expect("its address");
    let mut sender = TelemetrySender::open(here, [9; 16], StreamOrigin::Live, false).expect("a sender");
    let good: Vec<Vec<u8>> = (0..4)
        .map(|t| {
            sender.send(&state(t));
            let mut bytes = vec![0; 512];
            let length = relay.recv(&mut bytes).expect("a datagram");
            bytes.truncate(length);
            bytes
        })
        .collect();
    let mut damaged = good[1].clone();
    damaged[60] ^= 4;
    let mut other_layout = good[1].clone();
    other_layout[4] = 2;
    for bytes in [&good[0], &damaged, &other_layout, &b"something else".to_vec(), &good[2], &good[0], &good[3]] {
        relay.send_to(bytes, listening.address).expect("sent");
    }
    let (code, out, said) = listening.end();
    assert_eq!(code, Some(0), "{said}");
    let lines: Vec<&str> = out.lines().collect();
    assert_eq!(lines.len(), 3, "{out}");
    let pose =
        "live tracking degraded position +2.5000 -0.2500 +0.1250 rotation +0.50000 -0.50000 +0.50000 +0.50000 age ";
    for (line, sequence) in lines.iter().zip([0, 2, 3]) {
        assert!(line.starts_with(&format!("{sequence} {pose}")) && line.ends_with(" ms"), "{line}");
    }
    assert_eq!(said.matches("dropped:").count(), 4, "{said}");
    for word in ["checksum", "layout", "not telemetry", "0 comes late", "lost: 1 before 2"] {
        assert!(said.contains(word), "{word}: {said}");
    }

    // A rehearsal: refused, and taken where it is allowed.
    let rehearse = |listening: Client| {
        let open = TelemetrySender::open(listening.address, [9; 16], StreamOrigin::Simulated, true);
        open.expect("a sender").send(&state(0));
        listening.end()
    };
    let (code, out, said) = rehearse(Client::start(client().args(["--count", "1"])));
    assert_eq!((code, out.as_str()), (Some(3), ""));
    assert!(said.contains("not live"), "{said}");
    let (code, out, _) = rehearse(Client::start(client().args(["--count", "1", "--allow-nonlive"])));
    assert!(code == Some(0) && out.starts_with("0 simulated tracking"), "{out}");
}

fn is_there(program: &str) -> bool {
    let found = Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    found.is_ok_and(|status| status.success())
}

fn compiled(folder: &Path) -> PathBuf {
    let program = folder.join("telemetry_client");
    let flags = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-o"];
    let mut compiler = Command::new("cc");
    compiler.args(flags).arg(&program).arg(repository().join("examples/telemetry_client.c"));
    let output = compiler.output().expect("cc runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    program
}

#[test]
fn the_c_client_reads_what_is_sent_and_refuses_what_is_not_live() {
    if !is_there("cc") {
        println!("skipped: cc is not there");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let program = compiled(folder.path());
    reads_and_refuses(|| Command::new(&program));
}

#[test]
fn the_python_client_reads_what_is_sent_and_refuses_what_is_not_live() {
    if !is_there("python3") {
        println!("skipped: python3 is not there");
        return;
    }
    let client = repository().join("examples/telemetry_client.py");
    reads_and_refuses(|| {
        let mut command = Command::new("python3");
        command.arg(&client);
        command
    });
}

//! A `tumbled` that runs until it is told to end, and the ports it chose.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;

use tumbled_velodyne::{Model, ReturnMode};

use super::Workbench;
use crate::synth::Sensor;

/// Arguments with which a daemon serves on ports that nobody has.
pub(crate) const FREE_PORTS: [&str; 8] = [
    "--set",
    "stream.tcp=127.0.0.1:0",
    "--set",
    "stream.unix=",
    "--set",
    "stream.foxglove=",
    "--set",
    "stream.http=127.0.0.1:0",
];

/// A running `tumbled`.
pub(crate) struct Daemon {
    child: Child,
    log: BufReader<ChildStderr>,
    /// What it has logged so far.
    pub(crate) said: String,
    /// Where it takes data packets.
    pub(crate) data: SocketAddr,
    /// Where it takes position packets.
    pub(crate) position: SocketAddr,
    /// Its state stream, if it serves one.
    pub(crate) stream: Option<SocketAddr>,
    /// Its page, if it serves one.
    pub(crate) http: Option<SocketAddr>,
}

/// How a daemon ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) report: String,
    #[allow(dead_code, reason = "it is shown where a test fails")]
    pub(crate) log: String,
}

impl Daemon {
    /// Starts it and waits until it receives.
    pub(crate) fn start(bench: &Workbench, arguments: &[&str]) -> Self {
        Self::start_in(bench, &[], arguments)
    }

    /// The same with these variables in its environment.
    pub(crate) fn start_in(bench: &Workbench, environment: &[(OsString, OsString)], arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tumbled"));
        command.current_dir(bench.path(".")).args(arguments).envs(environment.iter().cloned());
        command.args(["--set", "lidar.port=0", "--set", "lidar.position_port=0"]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
        let mut log = BufReader::new(child.stderr.take().expect("piped"));
        let mut said = String::new();
        while !said.contains("data=") {
            assert!(log.read_line(&mut said).expect("a log") > 0, "it ended before it received: {said}");
        }
        let address = |key: &str| -> Option<SocketAddr> {
            let value = said.split_whitespace().find_map(|word| word.strip_prefix(key))?;
            let address: SocketAddr = value.parse().ok()?;
            Some(SocketAddr::from((Ipv4Addr::LOCALHOST, address.port())))
        };
        let (data, position) = (address("data=").expect("a port"), address("position=").expect("a port"));
        let (stream, http) = (address("tcp="), address("http="));
        Self { child, log, said, data, position, stream, http }
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn signal(&self, name: &str) {
        let status = Command::new("kill").args(["-s", name, &self.id().to_string()]).status().expect("kill");
        assert!(status.success());
    }

    /// Reads its log until a line holds `text`.
    pub(crate) fn wait_for(&mut self, text: &str) {
        let mut line = String::new();
        while !line.contains(text) {
            line.clear();
            assert!(self.log.read_line(&mut line).expect("a log") > 0, "it ended without {text:?}: {}", self.said);
            self.said.push_str(&line);
        }
    }

    /// Reads its log until it has held `text`, from its beginning on.
    pub(crate) fn once_said(&mut self, text: &str) {
        if !self.said.contains(text) {
            self.wait_for(text);
        }
    }

    /// Waits for the end.
    pub(crate) fn finish(mut self) -> Ended {
        let mut report = String::new();
        self.child.stdout.take().expect("piped").read_to_string(&mut report).expect("a report");
        self.log.read_to_string(&mut self.said).expect("a log");
        Ended { code: self.child.wait().expect("ends").code(), report, log: std::mem::take(&mut self.said) }
    }
}

impl Drop for Daemon {
    /// A test that fails leaves no daemon behind.
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Sends payloads with a little air between them: four times the rig's rate.
pub(crate) fn send(payloads: &[Vec<u8>], to: SocketAddr) {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    for payload in payloads {
        socket.send_to(payload, to).expect("sends");
        std::thread::sleep(Duration::from_micros(150));
    }
}

/// The first packets of a VLP-32C in a room.
pub(crate) fn packets(n: usize) -> Vec<Vec<u8>> {
    let sensor = Sensor::new(Model::Vlp32c, ReturnMode::Strongest);
    sensor.packets(n, |slot, _| (500 + slot as u16, 500)).into_iter().map(|packet| packet.bytes.to_vec()).collect()
}

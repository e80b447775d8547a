//! A `tumbled replay --serve` that runs, and how far a client saw it come.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use super::Workbench;

/// A running replay that serves on a free port.
pub(crate) struct Replaying {
    child: Child,
    log: BufReader<ChildStderr>,
    said: String,
    pub(crate) stream: SocketAddr,
    /// Where its page is.
    pub(crate) http: SocketAddr,
}

impl Replaying {
    /// Starts it and waits until it serves.
    pub(crate) fn start(bench: &Workbench, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tumbled"));
        command.current_dir(bench.path(".")).arg("replay").args(arguments).arg("--serve");
        for key in ["stream.tcp=127.0.0.1:0", "stream.unix=", "stream.foxglove=", "stream.http=127.0.0.1:0"] {
            command.args(["--set", key]);
        }
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
        let mut log = BufReader::new(child.stderr.take().expect("piped"));
        let mut said = String::new();
        let told = |said: &str, key: &str| -> Option<SocketAddr> {
            said.split_whitespace().find_map(|word| word.strip_prefix(key))?.parse().ok()
        };
        let (stream, http) = loop {
            assert!(log.read_line(&mut said).expect("a log") > 0, "it ended before it served: {said}");
            if let (Some(stream), Some(http)) = (told(&said, "tcp="), told(&said, "http=")) {
                break (stream, http);
            }
        };
        Self { child, log, said, stream, http }
    }

    /// Its lines of some classes, HELLO first, until the connection ends.
    pub(crate) fn lines(&self, subscribe: &str) -> impl Iterator<Item = Value> + use<> {
        let mut client = TcpStream::connect(self.stream).expect("connects");
        client.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
        writeln!(client, "{{\"subscribe\":[\"{subscribe}\"]}}").expect("sends");
        let lines = BufReader::new(client).lines().map_while(Result::ok);
        lines.map_while(|line| serde_json::from_str(&line).ok())
    }

    pub(crate) fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-s", name, &id]).status().expect("kill").success());
    }

    /// Waits for the end: its exit code and its log.
    pub(crate) fn finish(mut self) -> (Option<i32>, String) {
        let mut report = String::new();
        self.child.stdout.take().expect("piped").read_to_string(&mut report).expect("a report");
        self.log.read_to_string(&mut self.said).expect("a log");
        (self.child.wait().expect("ends").code(), std::mem::take(&mut self.said))
    }
}

impl Drop for Replaying {
    /// A test that fails leaves no process behind.
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

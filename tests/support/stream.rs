//! A server of the state stream on a free port, and a client that reads it line by line.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tumbled::stream::{Class, Hello, Limits, StreamConfig, StreamOrigin, StreamServer};
use tumbled_model::UnixNs;

/// So long is waited for what has to happen; a machine that is busy may take its time.
const PATIENCE: Duration = Duration::from_secs(30);

/// What every client of these servers is told first.
pub(crate) fn hello() -> Hello {
    Hello::new("5f-1", "lab", StreamOrigin::Simulated, UnixNs(1_795_341_600_000_000_000))
}

/// Loopback, a free port, no Unix socket.
pub(crate) fn on_a_free_port(limits: Limits) -> StreamConfig {
    StreamConfig { tcp: Some((Ipv4Addr::LOCALHOST, 0).into()), limits, ..StreamConfig::default() }
}

/// A server on a free port of loopback.
pub(crate) fn server(limits: Limits) -> StreamServer {
    StreamServer::start(on_a_free_port(limits), &hello()).expect("starts")
}

pub(crate) fn tcp_address(server: &StreamServer) -> SocketAddr {
    server.addresses().tcp.expect("TCP")
}

/// Waits until the condition holds.
pub(crate) fn wait_until(what: &str, condition: impl Fn() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A line of the class with a mark to know it by.
pub(crate) fn marked(class: Class, mark: usize) -> String {
    format!("{{\"class\":\"{}\",\"mark\":{mark}}}", class.name())
}

/// The same, so large.
pub(crate) fn large(class: Class, mark: usize, bytes: usize) -> String {
    format!("{{\"class\":\"{}\",\"mark\":{mark},\"fill\":\"{}\"}}", class.name(), "x".repeat(bytes))
}

/// A client that has read HELLO.
pub(crate) struct Client<S> {
    reader: BufReader<S>,
}

impl Client<TcpStream> {
    /// Connected to a server, HELLO read.
    pub(crate) fn connect(server: &StreamServer) -> Self {
        let stream = TcpStream::connect(tcp_address(server)).expect("connects");
        stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        Self::greeted(stream)
    }

    /// The connection once more, to send and read at the same time.
    pub(crate) fn try_clone(&self) -> TcpStream {
        self.reader.get_ref().try_clone().expect("another descriptor")
    }

    /// Ends the sending side.
    pub(crate) fn half_close(&self) {
        self.reader.get_ref().shutdown(std::net::Shutdown::Write).expect("half closed");
    }
}

impl Client<UnixStream> {
    /// Connected to a Unix socket, HELLO read.
    pub(crate) fn connect_unix(path: &Path) -> Self {
        let stream = UnixStream::connect(path).expect("connects");
        stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        Self::greeted(stream)
    }
}

impl<S: Read + Write> Client<S> {
    /// Of a connection on which nothing was read yet.
    pub(crate) fn greeted(stream: S) -> Self {
        let mut client = Self { reader: BufReader::new(stream) };
        assert_eq!(client.next()["class"], "HELLO");
        client
    }

    pub(crate) fn send(&mut self, bytes: impl AsRef<[u8]>) {
        self.reader.get_mut().write_all(bytes.as_ref()).expect("sends");
    }

    /// Subscribes and waits until the server knows.
    pub(crate) fn subscribe(&mut self, server: &StreamServer, classes: &[Class], max_hz: Option<f64>) {
        // An unknown format is refused with an ERROR, after the request before it was carried out.
        self.send(format!("{}\n{{\"format\":\"?\"}}\n", json!({ "subscribe": classes, "max_hz": max_hz })));
        assert_eq!(self.next()["code"], "unknown_format");
        let publisher = server.publisher();
        assert!(classes.iter().all(|class| publisher.wants(*class)));
    }

    /// The next line as it came, without its newline; `None` at the end.
    pub(crate) fn text(&mut self) -> Option<String> {
        self.try_text().unwrap_or_else(|error| panic!("reading a line: {error}"))
    }

    /// The same of a connection that may have been cut.
    pub(crate) fn try_text(&mut self) -> std::io::Result<Option<String>> {
        let mut line = String::new();
        let bytes = self.reader.read_line(&mut line)?;
        Ok((bytes > 0).then(|| line.trim_end_matches('\n').to_owned()))
    }

    /// The next line.
    pub(crate) fn next(&mut self) -> Value {
        let line = self.text().expect("a line, not the end");
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error} in {line}"))
    }

    /// That the connection ends here.
    pub(crate) fn assert_closed(&mut self) {
        let mut byte = [0];
        // A close while something of ours is under way comes as a reset.
        if let Ok(n) = self.reader.read(&mut byte) {
            assert_eq!(n, 0, "a line came: {:?}", self.text());
        }
    }
}

//! The connection to a daemon's state stream.

use std::fmt;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde_json::Value;
use thiserror::Error;
use tumbled_io::live::StopToken;

use crate::cli::VERSION;
use crate::stream::{HealthLine, Hello};

/// The longest line that is believed: HEALTH of thirty sensors has some 50 kB.
const LINE_BYTES: usize = 4 << 20;

/// How often the end is looked for while nothing comes.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Where a daemon may listen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// A TCP address, as it was written and as it was found.
    Tcp(String, SocketAddr),
    /// A Unix socket.
    Unix(PathBuf),
}

/// A text that names no place to connect to.
#[derive(Debug, Error)]
#[error(
    "{text:?} is no place to connect to: {reason}; write e.g. 127.0.0.1:7117, or the path of a Unix socket with a /"
)]
pub(super) struct NoTarget {
    text: String,
    reason: String,
}

/// Why there is no status.
#[derive(Debug, Error)]
pub(super) enum StatusError {
    /// Nobody listens.
    #[error("no daemon answers: {}", tried.iter().map(|(at, error)| format!("{at}: {error}")).collect::<Vec<_>>().join("; "))]
    Nobody {
        /// Where, and why not.
        tried: Vec<(String, io::Error)>,
    },
    /// It said why it does not serve.
    #[error("the daemon at {at} says: {message}")]
    Refused {
        /// Where.
        at: String,
        /// What it said.
        message: String,
    },
    /// It says nothing.
    #[error("no {awaited} came from {at} within {} s", waited.as_secs_f64())]
    Silent {
        /// Where.
        at: String,
        /// What was waited for.
        awaited: &'static str,
        /// How long.
        waited: Duration,
    },
    /// It ended the connection.
    #[error("{at} ended the connection before {awaited} came")]
    Ended {
        /// Where.
        at: String,
        /// What was waited for.
        awaited: &'static str,
    },
    /// The connection broke.
    #[error("reading from {at}: {source}")]
    Broken {
        /// Where.
        at: String,
        /// Why.
        source: io::Error,
    },
    /// It speaks something else.
    #[error("what {at} says is no {awaited} of tumbled {VERSION}: {reason}")]
    NotUnderstood {
        /// Where.
        at: String,
        /// What was waited for.
        awaited: &'static str,
        /// What does not fit.
        reason: String,
    },
}

impl StatusError {
    /// What to do.
    pub(super) fn help(&self) -> &'static str {
        match self {
            Self::Nobody { .. } => "is `tumbled run` running? --connect names another address or socket",
            Self::Refused { .. } => "end one of its clients, or ask again when it runs",
            Self::Silent { .. } => "is it a tumbled daemon, and does its log say that it is stuck?",
            Self::Ended { .. } | Self::Broken { .. } => "the daemon's log says why it ended",
            Self::NotUnderstood { .. } => "is it a tumbled daemon of this version? `tumbled --version` on its machine",
        }
    }
}

impl Target {
    /// A path if there is a `/` in it, else an address with a port.
    pub(super) fn parse(text: &str) -> Result<Self, NoTarget> {
        if text.contains('/') {
            return Ok(Self::Unix(PathBuf::from(text)));
        }
        let no_target = |reason: String| NoTarget { text: text.to_owned(), reason };
        let mut found = text.to_socket_addrs().map_err(|error| no_target(error.to_string()))?;
        let address = found.next().ok_or_else(|| no_target("no address has this name".to_owned()))?;
        Ok(Self::Tcp(text.to_owned(), address))
    }

    fn connect(&self, patience: Duration) -> io::Result<Socket> {
        match self {
            Self::Tcp(_, address) => TcpStream::connect_timeout(address, patience).map(Socket::Tcp),
            Self::Unix(path) => UnixStream::connect(path).map(Socket::Unix),
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(text, _) => f.write_str(text),
            Self::Unix(path) => write!(f, "{}", path.display()),
        }
    }
}

enum Socket {
    Tcp(TcpStream),
    Unix(UnixStream),
}

impl Socket {
    fn set_read_timeout(&self, timeout: Duration) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.set_read_timeout(Some(timeout)),
            Self::Unix(stream) => stream.set_read_timeout(Some(timeout)),
        }
    }
}

impl Read for Socket {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(buffer),
            Self::Unix(stream) => stream.read(buffer),
        }
    }
}

impl Write for Socket {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(bytes),
            Self::Unix(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A connection on which HELLO was read and HEALTH is subscribed.
pub(super) struct Connection {
    at: String,
    socket: Socket,
    /// What was read beyond the last line.
    buffer: Vec<u8>,
}

impl Connection {
    /// The first of the targets that answers.
    pub(super) fn open(targets: &[Target], patience: Duration) -> Result<(Self, Hello), StatusError> {
        let mut tried = Vec::new();
        for target in targets {
            match target.connect(patience) {
                Ok(socket) => return Self::greet(target.to_string(), socket, patience),
                Err(error) => tried.push((target.to_string(), error)),
            }
        }
        Err(StatusError::Nobody { tried })
    }

    fn greet(at: String, socket: Socket, patience: Duration) -> Result<(Self, Hello), StatusError> {
        let mut connection = Self { at, socket, buffer: Vec::new() };
        connection.socket.set_read_timeout(LOOK_EVERY).map_err(|source| connection.broken(source))?;
        let Some(hello) = connection.line_of("HELLO", patience, None)? else {
            return Err(connection.ended("HELLO"));
        };
        // Without the lines it would not show: STATE comes 50 times a second.
        let subscribed = connection.socket.write_all(b"{\"subscribe\":[\"HEALTH\"]}\n");
        subscribed.map_err(|source| connection.broken(source))?;
        Ok((connection, hello))
    }

    /// Where the daemon was reached.
    pub(super) fn at(&self) -> &str {
        &self.at
    }

    /// The next health; `None` when the end was asked for.
    pub(super) fn health(
        &mut self,
        patience: Duration,
        stop: Option<&StopToken>,
    ) -> Result<Option<HealthLine>, StatusError> {
        self.line_of("HEALTH", patience, stop)
    }

    /// The next line of a class. Lines of other classes are passed over, an ERROR is told.
    fn line_of<T: DeserializeOwned>(
        &mut self,
        class: &'static str,
        patience: Duration,
        stop: Option<&StopToken>,
    ) -> Result<Option<T>, StatusError> {
        let deadline = Instant::now() + patience;
        while let Some(line) = self.line(class, patience, deadline, stop)? {
            let not_understood = |error: serde_json::Error| StatusError::NotUnderstood {
                at: self.at.clone(),
                awaited: class,
                reason: error.to_string(),
            };
            let value: Value = serde_json::from_slice(&line).map_err(not_understood)?;
            let found = value.get("class").and_then(Value::as_str).unwrap_or_default();
            if found == class {
                return serde_json::from_value(value).map(Some).map_err(not_understood);
            }
            if found == "ERROR" {
                let message = value.get("message").and_then(Value::as_str).unwrap_or("(no reason given)").to_owned();
                return Err(StatusError::Refused { at: self.at.clone(), message });
            }
            let is_known = ["HELLO", "STATE", "CLOUD", "POINT", "EVENT", "HEALTH"].contains(&found);
            if class == "HELLO" || !is_known {
                let reason = format!("a line of class {found:?}");
                return Err(StatusError::NotUnderstood { at: self.at.clone(), awaited: class, reason });
            }
        }
        Ok(None)
    }

    /// The next line without its newline; `None` when the end was asked for.
    fn line(
        &mut self,
        awaited: &'static str,
        patience: Duration,
        deadline: Instant,
        stop: Option<&StopToken>,
    ) -> Result<Option<Vec<u8>>, StatusError> {
        loop {
            if let Some(newline) = self.buffer.iter().position(|byte| *byte == b'\n') {
                let rest = self.buffer.split_off(newline + 1);
                let mut line = std::mem::replace(&mut self.buffer, rest);
                line.truncate(newline);
                return Ok(Some(line));
            }
            if self.buffer.len() > LINE_BYTES {
                let reason = format!("a line of more than {LINE_BYTES} bytes");
                return Err(StatusError::NotUnderstood { at: self.at.clone(), awaited, reason });
            }
            if stop.is_some_and(StopToken::is_stopped) {
                return Ok(None);
            }
            if Instant::now() >= deadline {
                return Err(StatusError::Silent { at: self.at.clone(), awaited, waited: patience });
            }
            let mut part = [0; 16 * 1024];
            match self.socket.read(&mut part) {
                Ok(0) => return Err(self.ended(awaited)),
                Ok(n) => self.buffer.extend_from_slice(part.get(..n).unwrap_or_default()),
                Err(error) if is_no_data(&error) => {}
                Err(source) => return Err(self.broken(source)),
            }
        }
    }

    fn ended(&self, awaited: &'static str) -> StatusError {
        StatusError::Ended { at: self.at.clone(), awaited }
    }

    fn broken(&self, source: io::Error) -> StatusError {
        StatusError::Broken { at: self.at.clone(), source }
    }
}

/// Nothing came in time, or a signal came instead.
fn is_no_data(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slash_makes_a_path_and_the_rest_is_an_address() {
        assert_eq!(Target::parse("./state.sock").expect("a path"), Target::Unix("./state.sock".into()));
        let address = SocketAddr::from(([127, 0, 0, 1], 7117));
        assert_eq!(Target::parse("127.0.0.1:7117").expect("TCP"), Target::Tcp("127.0.0.1:7117".to_owned(), address));
        let error = Target::parse("127.0.0.1").expect_err("no port");
        assert!(error.to_string().contains("127.0.0.1:7117"), "{error}");
    }
}

//! The door: connections are accepted, admitted or refused, at a bounded pace.

use std::io;
use std::mem::MaybeUninit;
use std::net::SocketAddr;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::{Duration, Instant};

use socket2::{SockRef, TcpKeepalive};
use tokio::net::{TcpListener, TcpStream, UnixListener, UnixStream};
use tokio::time::sleep;

use super::class::Class;
use super::client::serve;
use super::hello::ErrorLine;
use super::hub::{Hub, Peer, frame};
use super::limits::Limits;

/// Connections accepted per [`BURST_TIME`]: a flood of them takes a bounded share of one of the two workers.
const BURST: u32 = 100;
const BURST_TIME: Duration = Duration::from_millis(100);

/// Pause after an error such as "too many open files", which does not go away by trying at once.
const ERROR_PAUSE: Duration = Duration::from_millis(100);

/// Between two log lines about refused clients.
const REFUSAL_LOG: Duration = Duration::from_secs(10);

/// What the kernel holds for a client beyond our queue. The default grows to megabytes, in which a client that does not
/// read would go unnoticed for minutes.
const SEND_BUFFER: usize = 256 * 1024;

/// A listener of either kind.
#[derive(Debug)]
pub(super) enum Listener {
    Tcp(TcpListener),
    Unix(UnixListener),
}

enum Connection {
    Tcp(TcpStream, SocketAddr),
    Unix(UnixStream),
}

/// Accepts until the task is ended.
pub(super) async fn accept(listener: Listener, hub: Arc<Hub>) {
    let mut pace = Pace::default();
    let mut errors = Errors::default();
    let mut refusals = Refusals::default();
    loop {
        match listener.accept().await {
            Ok(connection) => {
                errors.over();
                match hub.admit(connection.peer()) {
                    Ok(client) => connection.serve(client),
                    Err(refusal) => {
                        connection.refuse(&refusal);
                        refusals.log(&refusal, Instant::now());
                    }
                }
            }
            Err(error) => {
                errors.count(&error);
                sleep(ERROR_PAUSE).await;
            }
        }
        let pause = pace.pause(Instant::now());
        // Even a sleep of nothing takes a millisecond.
        if !pause.is_zero() {
            sleep(pause).await;
        }
    }
}

impl Listener {
    async fn accept(&self) -> io::Result<Connection> {
        match self {
            Self::Tcp(listener) => listener.accept().await.map(|(stream, peer)| Connection::Tcp(stream, peer)),
            Self::Unix(listener) => listener.accept().await.map(|(stream, _)| Connection::Unix(stream)),
        }
    }
}

impl Connection {
    fn peer(&self) -> Peer {
        match self {
            Self::Tcp(_, peer) => Peer::of_address(peer.ip()),
            Self::Unix(_) => Peer::Local,
        }
    }

    /// Starts the client's task.
    fn serve(self, client: super::hub::Admitted) {
        match self {
            Self::Tcp(stream, peer) => {
                if let Err(error) = prepare(&stream, &client.hub.limits) {
                    tracing::debug!(%peer, "a client left at once: {error}");
                    return;
                }
                tracing::debug!(%peer, "a client of the state stream");
                let (read, write) = stream.into_split();
                tokio::spawn(serve(read, write, client));
            }
            Self::Unix(stream) => {
                if let Err(error) = SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER) {
                    tracing::debug!("the send buffer of a Unix socket keeps its size: {error}");
                }
                let (read, write) = stream.into_split();
                tokio::spawn(serve(read, write, client));
            }
        }
    }

    /// Says why and closes, without a task and without waiting.
    fn refuse(self, refusal: &ErrorLine) {
        match &self {
            Self::Tcp(stream, _) => say_and_close(stream, refusal),
            Self::Unix(stream) => say_and_close(stream, refusal),
        }
    }
}

/// Lines go out at once; a peer that is gone without a word is noticed.
fn prepare(stream: &TcpStream, limits: &Limits) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let socket = SockRef::from(stream);
    socket.set_send_buffer_size(SEND_BUFFER)?;
    // A cable that was pulled while nothing was sent: 10 s, then 3 questions 5 s apart.
    let keepalive = TcpKeepalive::new().with_time(Duration::from_secs(10));
    socket.set_tcp_keepalive(&keepalive.with_interval(Duration::from_secs(5)).with_retries(3))?;
    // The same while something waits to be acknowledged.
    socket.set_tcp_user_timeout(Some(limits.lag))
}

fn say_and_close(stream: &impl AsFd, refusal: &ErrorLine) {
    let Ok(frame) = frame(Class::Error, refusal) else { return };
    let line = [frame.stem().as_ref(), frame.tail(0, 0).as_bytes()].concat();
    let socket = SockRef::from(stream);
    // A new connection's buffer is empty, so the line fits whole; if the client has left, nobody misses it. What the
    // client has sent is read, since a close with bytes unread would take the line back.
    let mut unread = [MaybeUninit::uninit(); 4096];
    let said = socket.send(&line).and_then(|_| socket.shutdown(std::net::Shutdown::Write));
    if let Err(error) = said.and_then(|()| socket.recv(&mut unread)) {
        tracing::trace!("a refused client: {error}");
    }
}

/// How fast connections are accepted.
#[derive(Debug, Default)]
struct Pace {
    since: Option<Instant>,
    accepted: u32,
}

impl Pace {
    /// After a connection: how long to wait for the next one.
    fn pause(&mut self, now: Instant) -> Duration {
        let elapsed = self.since.map_or(BURST_TIME, |since| now.duration_since(since));
        if elapsed >= BURST_TIME {
            *self = Self { since: Some(now), accepted: 0 };
        }
        self.accepted += 1;
        if self.accepted < BURST { Duration::ZERO } else { BURST_TIME.saturating_sub(elapsed) }
    }
}

/// Errors of accepting: the first is logged, and how many there were when it works again.
#[derive(Debug, Default)]
struct Errors {
    count: u64,
}

impl Errors {
    fn count(&mut self, error: &io::Error) {
        if self.count == 0 {
            tracing::warn!("the state stream cannot accept clients for now: {error}");
        }
        self.count += 1;
    }

    fn over(&mut self) {
        if self.count > 0 {
            tracing::info!(errors = self.count, "the state stream accepts clients again");
            self.count = 0;
        }
    }
}

/// Refused clients: told at once, then at most every ten seconds with their number.
#[derive(Debug, Default)]
struct Refusals {
    told: Option<Instant>,
    since: u64,
}

impl Refusals {
    /// Whether it was logged now.
    fn log(&mut self, refusal: &ErrorLine, now: Instant) -> bool {
        self.since += 1;
        if self.told.is_some_and(|told| now.duration_since(told) < REFUSAL_LOG) {
            return false;
        }
        tracing::warn!(refused = self.since, "clients of the state stream were refused: {}", refusal.message);
        *self = Self { told: Some(now), since: 0 };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_connections_are_accepted_in_a_tenth_of_a_second_and_no_more() {
        let mut pace = Pace::default();
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        for _ in 0..99 {
            assert_eq!(pace.pause(at(30)), Duration::ZERO);
        }
        // The tenth began with the first one, at 30 ms.
        assert_eq!(pace.pause(at(40)), Duration::from_millis(90));
        assert_eq!(pace.pause(at(130)), Duration::ZERO);
    }

    #[test]
    fn refusals_are_told_once_in_ten_seconds() {
        let refusal = ErrorLine::closing("too_many_clients", "no".to_owned());
        let mut refusals = Refusals::default();
        let start = Instant::now();
        let at = |s: u64| start + Duration::from_secs(s);
        assert!(refusals.log(&refusal, at(0)));
        assert!(!refusals.log(&refusal, at(1)) && !refusals.log(&refusal, at(9)));
        assert!(refusals.log(&refusal, at(10)));
    }
}

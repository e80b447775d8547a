//! A UDP sender that keeps a recording's pace.

use super::stop::StopToken;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};
use tumbled_model::Span;

/// How fast stored datagrams go out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// At their own times, `1.0` = as they were, `2.0` = twice as fast.
    Times(f64),
    /// One after the other.
    AtOnce,
}

/// What was sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// Datagrams that the system took.
    pub datagrams: u64,
    /// Their payload.
    pub bytes: u64,
    /// The furthest that a datagram was behind its time.
    pub latest: Duration,
}

/// Why sending ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SendError {
    /// The sender's own address cannot be had.
    #[error("cannot send from {from}: {error}")]
    Bind {
        /// The address asked for.
        from: SocketAddr,
        /// What the system said.
        error: io::Error,
    },
    /// The system refused a datagram.
    #[error("sending datagram {index} ({length} bytes) to {to} failed: {error}")]
    Send {
        /// Counted from 0.
        index: u64,
        /// Its payload.
        length: usize,
        /// Where to.
        to: SocketAddr,
        /// What the system said.
        error: io::Error,
    },
    /// The speed is no positive number.
    #[error("a speed of {found} cannot be kept: expected a positive number, e.g. 1")]
    Speed {
        /// The speed.
        found: f64,
    },
}

/// A socket to send from.
#[derive(Debug)]
pub struct UdpSender {
    socket: UdpSocket,
}

impl UdpSender {
    /// A sender with the given address; port 0 takes any free one. Broadcasts are allowed.
    ///
    /// # Errors
    /// When the address is not on this machine or in use.
    pub fn bind(from: SocketAddr) -> Result<Self, SendError> {
        let failed = |error| SendError::Bind { from, error };
        let socket = UdpSocket::bind(from).map_err(failed)?;
        if from.is_ipv4() {
            socket.set_broadcast(true).map_err(failed)?;
        }
        Ok(Self { socket })
    }

    /// Sends one datagram now.
    ///
    /// # Errors
    /// When the system refuses it: longer than 65 507 bytes, nobody there.
    pub fn datagram(&self, to: SocketAddr, payload: &[u8]) -> io::Result<()> {
        self.socket.send_to(payload, to).map(|_| ())
    }

    /// Sends each datagram to its destination at its time, until the last or the stop. Times count from the first
    /// datagram's; one that goes back is sent at once. What is late does not delay what follows.
    ///
    /// # Errors
    /// When the system refuses a datagram.
    pub fn send<P: AsRef<[u8]>>(
        &self,
        datagrams: impl IntoIterator<Item = (Span, SocketAddr, P)>,
        pace: Pace,
        stop: &StopToken,
    ) -> Result<Sent, SendError> {
        if let Pace::Times(speed) = pace
            && !(speed.is_finite() && speed > 0.0)
        {
            return Err(SendError::Speed { found: speed });
        }
        let start = Instant::now();
        let mut first = None;
        let mut sent = Sent::default();
        for (at, to, payload) in datagrams {
            let offset = at - *first.get_or_insert(at);
            let late = match pace {
                Pace::Times(speed) => stop.sleep_until(start + after_start(offset, speed)),
                Pace::AtOnce => Duration::ZERO,
            };
            if stop.is_stopped() {
                break;
            }
            let payload = payload.as_ref();
            self.datagram(to, payload).map_err(|error| SendError::Send {
                index: sent.datagrams,
                length: payload.len(),
                to,
                error,
            })?;
            sent.datagrams += 1;
            sent.bytes += payload.len() as u64;
            sent.latest = sent.latest.max(late);
        }
        Ok(sent)
    }
}

fn after_start(offset: Span, speed: f64) -> Duration {
    /// A thousand years: instants can still be told.
    const LONGEST: Duration = Duration::from_secs(31_557_600_000);
    Duration::try_from_secs_f64(offset.as_secs_f64() / speed).unwrap_or(Duration::ZERO).min(LONGEST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    fn pair() -> (UdpSender, UdpSocket, SocketAddr) {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let receiver = UdpSocket::bind(any).expect("a free port");
        let to = receiver.local_addr().expect("bound");
        (UdpSender::bind(any).expect("a free port"), receiver, to)
    }

    #[test]
    fn no_datagram_leaves_before_its_time() {
        let (sender, receiver, to) = pair();
        let stop = StopToken::new().expect("a descriptor");
        let before = Instant::now();
        // 100, 130 and 115 ms (back: at once), at twice the speed: 15 ms in all.
        let datagrams = [100, 130, 115].map(|ms| (Span::from_micros(ms * 1_000), to, [ms as u8]));
        let sent = sender.send(datagrams, Pace::Times(2.0), &stop).expect("loopback");
        assert!(before.elapsed() >= Duration::from_millis(15));
        assert_eq!((sent.datagrams, sent.bytes), (3, 3));
        let mut byte = [0];
        for expected in [100, 130, 115] {
            receiver.recv(&mut byte).expect("delivered");
            assert_eq!(byte, [expected]);
        }
    }

    #[test]
    fn a_stop_ends_the_longest_wait() {
        let (sender, _receiver, to) = pair();
        let stop = StopToken::new().expect("a descriptor");
        let stopper = stop.clone();
        let datagrams = [(Span(0), to, [0]), (Span(3_600_000_000_000), to, [1])];
        let waiting = std::thread::spawn(move || sender.send(datagrams, Pace::Times(1.0), &stop));
        stopper.stop();
        assert!(waiting.join().expect("no panic").expect("loopback").datagrams <= 1);
    }

    #[test]
    fn a_speed_that_cannot_be_kept_is_refused() {
        let (sender, _receiver, to) = pair();
        let stop = StopToken::new().expect("a descriptor");
        for speed in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = sender.send([(Span(0), to, [0])], Pace::Times(speed), &stop).expect_err("no speed");
            assert!(matches!(error, SendError::Speed { .. }), "{error}");
        }
    }
}

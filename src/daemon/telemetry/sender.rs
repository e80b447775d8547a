//! The sender: datagrams to one address, never waiting.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use thiserror::Error;

use super::datagram::{SIZE, Telemetry};
use crate::stream::StreamOrigin;

/// Sends telemetry to one address. A datagram that the kernel does not take at once is counted and gone: the next one is
/// newer.
#[derive(Debug)]
pub struct TelemetrySender {
    socket: UdpSocket,
    origin: u8,
    session: [u8; 16],
    sequence: u32,
    counts: TelemetryCounts,
    bytes: Vec<u8>,
}

/// What became of the datagrams.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TelemetryCounts {
    /// Taken by the kernel.
    pub sent: u64,
    /// Not taken: its buffer is full, nobody listens on this machine, or there is no way to the address.
    pub refused: u64,
}

/// Why telemetry cannot be sent.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SenderError {
    /// A guidance computer would take it for a measurement.
    #[error("telemetry to {destination} would be {}, not live: leave it off, or allow it with --allow-nonlive", origin.name())]
    NonLive {
        /// Where to.
        destination: SocketAddr,
        /// Where the data come from.
        origin: StreamOrigin,
    },
    /// There is no socket, or no way to the address.
    #[error("cannot send telemetry to {destination}: {source}; name an address that this machine has a route to")]
    Socket {
        /// Where to.
        destination: SocketAddr,
        /// Why.
        source: io::Error,
    },
}

/// The origin's number on the wire. None is 0: zeroed memory is never live.
pub const fn origin_code(origin: StreamOrigin) -> u8 {
    match origin {
        StreamOrigin::Live => 1,
        StreamOrigin::Replay => 2,
        StreamOrigin::Simulated => 3,
    }
}

impl TelemetrySender {
    /// To an address, for a session. Data that are not live need to be allowed, on this machine too: a datagram reaches
    /// whoever listens, unasked.
    ///
    /// # Errors
    /// [`SenderError`].
    pub fn open(
        destination: SocketAddr,
        session: [u8; 16],
        origin: StreamOrigin,
        allow_nonlive: bool,
    ) -> Result<Self, SenderError> {
        if origin != StreamOrigin::Live && !allow_nonlive {
            return Err(SenderError::NonLive { destination, origin });
        }
        let any: SocketAddr = match destination {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let connected = || {
            let socket = UdpSocket::bind(any)?;
            socket.set_nonblocking(true)?;
            socket.connect(destination)?;
            Ok(socket)
        };
        let socket = connected().map_err(|source| SenderError::Socket { destination, source })?;
        Ok(Self {
            socket,
            origin: origin_code(origin),
            session,
            sequence: 0,
            counts: TelemetryCounts::default(),
            bytes: Vec::with_capacity(SIZE),
        })
    }

    /// Sends a state; origin, session and sequence are the sender's own.
    pub fn send(&mut self, telemetry: &Telemetry) {
        let (origin, session, sequence) = (self.origin, self.session, self.sequence);
        Telemetry { origin, session, sequence, ..*telemetry }.encode(&mut self.bytes);
        // What is refused has its number too: its receiver sees the gap.
        self.sequence = self.sequence.wrapping_add(1);
        match self.socket.send(&self.bytes) {
            Ok(_) => self.counts.sent += 1,
            Err(_) => self.counts.refused += 1,
        }
    }

    /// What became of the datagrams so far.
    pub const fn counts(&self) -> TelemetryCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn receiver() -> (UdpSocket, SocketAddr) {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
        let address = socket.local_addr().expect("an address");
        (socket, address)
    }

    #[test]
    fn datagrams_are_numbered_and_say_whose_they_are() {
        let (socket, address) = receiver();
        let mut sender = TelemetrySender::open(address, [7; 16], StreamOrigin::Live, false).expect("a sender");
        for t in 0..3 {
            sender.send(&Telemetry { mode: 2, ..Telemetry::nothing_known(t, 0) });
        }
        let mut bytes = [0; 512];
        for t in 0..3 {
            let length = socket.recv(&mut bytes).expect("a datagram");
            let read = Telemetry::decode(&bytes[..length]).expect("ours");
            assert_eq!((read.t_ns, read.sequence, read.origin, read.session), (t, t as u32, 1, [7; 16]));
        }
        assert_eq!(sender.counts(), TelemetryCounts { sent: 3, refused: 0 });
    }

    #[test]
    fn a_rehearsal_is_not_sent_unless_it_is_allowed() {
        let (_socket, address) = receiver();
        for origin in [StreamOrigin::Replay, StreamOrigin::Simulated] {
            let refused = TelemetrySender::open(address, [0; 16], origin, false).expect_err("refused");
            assert!(refused.to_string().contains("--allow-nonlive"), "{refused}");
            assert!(TelemetrySender::open(address, [0; 16], origin, true).is_ok());
        }
    }

    #[test]
    fn nobody_listening_is_counted_and_costs_nothing() {
        let (socket, address) = receiver();
        drop(socket);
        let mut sender = TelemetrySender::open(address, [0; 16], StreamOrigin::Live, false).expect("a sender");
        (0..10).for_each(|t| sender.send(&Telemetry::nothing_known(t, 0)));
        let counts = sender.counts();
        // The kernel says of one datagram that the one before it reached nobody.
        assert!(counts.refused > 0 && counts.sent + counts.refused == 10, "{counts:?}");
    }
}

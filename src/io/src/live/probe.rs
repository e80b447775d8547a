//! Listening to UDP ports for a moment, to tell who sends what; nothing goes into a ledger.

use super::source::{ReceiveBuffer, SourceError};
use super::udp::RECEIVE_BUFFER_BYTES;
use super::udp_port::{PortOptions, UdpPort};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};
use tumbled_model::UnixNs;

/// Datagrams read from one port before the others get their turn.
const TURN: usize = 256;

/// A port that is listened to, with a sensor's own buffer and on every interface, as a [`super::UdpSource`] would.
#[derive(Debug)]
pub struct UdpProbe {
    port: UdpPort,
}

/// A datagram that came.
#[derive(Clone, Copy, Debug)]
pub struct Heard<'a> {
    /// Its content; of one beyond 2 048 bytes the first.
    pub payload: &'a [u8],
    /// Who sent it.
    pub from: Option<IpAddr>,
    /// When the kernel had it.
    pub stamp: Option<UnixNs>,
}

impl UdpProbe {
    /// Opens a port; 0 takes any free one.
    ///
    /// # Errors
    /// When it is in use or reserved.
    pub fn open(port: u16) -> Result<Self, SourceError> {
        let address = SocketAddr::from((Ipv4Addr::UNSPECIFIED, port));
        let options = PortOptions { address, interface: None, multicast: None, buffer: RECEIVE_BUFFER_BYTES };
        Ok(Self { port: UdpPort::open(options)? })
    }

    /// Address and port as bound.
    pub fn address(&self) -> SocketAddr {
        self.port.address()
    }

    /// The receive buffer the kernel granted.
    pub fn buffer(&self) -> ReceiveBuffer {
        self.port.buffer()
    }
}

/// Listens to every port for so long; each datagram is given with the index of its port.
///
/// # Errors
/// When receiving fails.
pub fn listen(
    probes: &mut [UdpProbe],
    time: Duration,
    mut heard: impl FnMut(usize, Heard<'_>),
) -> Result<(), SourceError> {
    let until = Instant::now() + time;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(());
        }
        wait(probes, left);
        for (index, probe) in probes.iter_mut().enumerate() {
            for _ in 0..TURN {
                let Some(datagram) = probe.port.receive()? else { break };
                let (payload, from, stamp) = (datagram.payload, datagram.from, datagram.stamp);
                heard(index, Heard { payload, from, stamp });
            }
        }
    }
}

/// Until something can be received or the time is over; whatever ends it, the ports are looked at.
fn wait(probes: &[UdpProbe], left: Duration) {
    let mut descriptors: Vec<PollFd<'_>> =
        probes.iter().map(|probe| PollFd::new(probe.port.as_fd(), PollFlags::POLLIN)).collect();
    let millis = u16::try_from(left.as_nanos().div_ceil(1_000_000)).unwrap_or(u16::MAX);
    match poll(&mut descriptors, PollTimeout::from(millis)) {
        Ok(_) | Err(Errno::EINTR) => {}
        // Out of memory for the call: a pause instead of a busy loop.
        Err(_) => std::thread::sleep(left.min(Duration::from_millis(10))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn what_comes_to_each_port_is_told_with_its_sender() {
        let mut probes = [UdpProbe::open(0).expect("a free port"), UdpProbe::open(0).expect("a free port")];
        let ports = probes.each_ref().map(|probe| probe.address().port());
        let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
        for (port, byte) in [(ports[0], 1), (ports[1], 2), (ports[0], 3)] {
            sender.send_to(&[byte], (Ipv4Addr::LOCALHOST, port)).expect("sent");
        }
        let mut seen = Vec::new();
        listen(&mut probes, Duration::from_millis(50), |index, datagram| {
            assert_eq!(datagram.from, Some(IpAddr::V4(Ipv4Addr::LOCALHOST)));
            seen.push((index, datagram.payload.to_vec()));
        })
        .expect("open");
        seen.sort();
        assert_eq!(seen, [(0, vec![1]), (0, vec![3]), (1, vec![2])]);
    }

    #[test]
    fn a_port_that_is_taken_is_told() {
        let owner = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).expect("a free port");
        let port = owner.local_addr().expect("bound").port();
        assert!(matches!(UdpProbe::open(port), Err(SourceError::PortInUse { port: taken }) if taken == port));
    }
}

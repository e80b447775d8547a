//! One UDP socket that stamps, counts its losses, and receives without waiting.

use super::source::{ReceiveBuffer, SourceError};
use nix::errno::Errno;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrStorage, recvmsg, setsockopt, sockopt};
use socket2::{Domain, Protocol, Socket, Type};
use std::io::{self, ErrorKind, IoSliceMut};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use tumbled_model::UnixNs;

/// The largest datagram that is delivered; a sensor's are 1 206 and 512 bytes.
pub(super) const DATAGRAM_LIMIT: usize = 2_048;

/// Where a socket listens.
#[derive(Clone, Copy, Debug)]
pub(super) struct PortOptions<'a> {
    pub(super) address: SocketAddr,
    pub(super) interface: Option<&'a str>,
    pub(super) multicast: Option<Ipv4Addr>,
    pub(super) buffer: usize,
}

/// A socket and what is needed to receive on it.
#[derive(Debug)]
pub(super) struct UdpPort {
    socket: Socket,
    address: SocketAddr,
    buffer: ReceiveBuffer,
    payload: [u8; DATAGRAM_LIMIT],
    ancillary: Vec<u8>,
    /// The kernel's count of datagrams dropped at this socket, as last told; it wraps.
    dropped: u32,
}

/// A datagram that was received.
#[derive(Debug)]
pub(super) struct Received<'a> {
    /// The payload; cut at [`DATAGRAM_LIMIT`] when `oversized`.
    pub(super) payload: &'a [u8],
    pub(super) oversized: bool,
    pub(super) from: Option<IpAddr>,
    /// When the kernel had it.
    pub(super) stamp: Option<UnixNs>,
    /// Datagrams the kernel dropped since the previous one.
    pub(super) lost_before: u32,
}

impl UdpPort {
    /// Opens, sets up and binds the socket: in this order, so that the first datagram is already stamped and counted.
    pub(super) fn open(options: PortOptions<'_>) -> Result<Self, SourceError> {
        let port = options.address.port();
        let failed = |step: &'static str| move |error: io::Error| classify(port, step, error);
        let socket = Socket::new(Domain::for_address(options.address), Type::DGRAM, Some(Protocol::UDP))
            .map_err(failed("creating the socket"))?;
        socket.set_nonblocking(true).map_err(failed("making it non-blocking"))?;
        socket.set_recv_buffer_size(options.buffer).map_err(failed("setting the receive buffer"))?;
        setsockopt(&socket, sockopt::ReceiveTimestampns, &true)
            .map_err(|errno| failed("asking for receive stamps")(errno.into()))?;
        setsockopt(&socket, sockopt::RxqOvfl, &1).map_err(|errno| failed("asking for drop counts")(errno.into()))?;
        if let Some(interface) = options.interface {
            socket.bind_device(Some(interface.as_bytes())).map_err(|error| match error.raw_os_error() {
                Some(code) if Errno::from_raw(code) == Errno::ENODEV => {
                    SourceError::NoSuchInterface { interface: interface.to_owned() }
                }
                _ => classify(port, "binding to the interface", error),
            })?;
        }
        socket.bind(&options.address.into()).map_err(|error| match error.kind() {
            ErrorKind::AddrNotAvailable => SourceError::NoSuchAddress { address: options.address.ip() },
            _ => classify(port, "binding", error),
        })?;
        if let Some(group) = options.multicast {
            let local = match options.address.ip() {
                IpAddr::V4(local) => local,
                IpAddr::V6(_) => Ipv4Addr::UNSPECIFIED,
            };
            socket.join_multicast_v4(&group, &local).map_err(failed("joining the multicast group"))?;
        }
        let reported = socket.recv_buffer_size().map_err(failed("reading the receive buffer's size"))?;
        let address = socket.local_addr().map_err(failed("reading the bound address"))?;
        let address = address.as_socket().unwrap_or(options.address);
        let buffer = ReceiveBuffer { requested: options.buffer, granted: reported / 2 };
        let ancillary = nix::cmsg_space!(nix::sys::time::TimeSpec, u32);
        Ok(Self { socket, address, buffer, payload: [0; DATAGRAM_LIMIT], ancillary, dropped: 0 })
    }

    /// The address as bound.
    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// The receive buffer.
    pub(super) fn buffer(&self) -> ReceiveBuffer {
        self.buffer
    }

    /// The next datagram that waits; `None` when none does.
    pub(super) fn receive(&mut self) -> Result<Option<Received<'_>>, SourceError> {
        let address = self.address;
        let mut slices = [IoSliceMut::new(&mut self.payload)];
        let message = loop {
            let flags = MsgFlags::MSG_DONTWAIT;
            match recvmsg::<SockaddrStorage>(self.socket.as_raw_fd(), &mut slices, Some(&mut self.ancillary), flags) {
                Ok(message) => break message,
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN) => return Ok(None),
                Err(errno) => return Err(SourceError::Receive { address, error: errno.into() }),
            }
        };
        let (mut stamp, mut lost_before) = (None, 0);
        // Ancillary data that were cut give an error here: then the datagram counts without them.
        for ancillary in message.cmsgs().into_iter().flatten() {
            match ancillary {
                ControlMessageOwned::ScmTimestampns(time) => stamp = unix_ns(time.tv_sec(), time.tv_nsec()),
                ControlMessageOwned::RxqOvfl(dropped) => {
                    lost_before = dropped.wrapping_sub(self.dropped);
                    self.dropped = dropped;
                }
                _ => {}
            }
        }
        let from = message.address.as_ref().and_then(sender);
        let oversized = message.flags.contains(MsgFlags::MSG_TRUNC);
        let length = message.bytes;
        let payload = self.payload.get(..length).unwrap_or_default();
        Ok(Some(Received { payload, oversized, from, stamp, lost_before }))
    }

    /// The error that waits at the socket, after a poll told of one.
    pub(super) fn pending_error(&self) -> Option<SourceError> {
        let error = match self.socket.take_error() {
            Ok(None) => return None,
            Ok(Some(error)) | Err(error) => error,
        };
        Some(SourceError::Receive { address: self.address, error })
    }
}

impl AsFd for UdpPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

fn classify(port: u16, step: &'static str, error: io::Error) -> SourceError {
    match error.kind() {
        ErrorKind::AddrInUse => SourceError::PortInUse { port },
        ErrorKind::PermissionDenied => SourceError::NotPermitted { port, error },
        _ => SourceError::Open { port, step, error },
    }
}

fn unix_ns(seconds: i64, nanoseconds: i64) -> Option<UnixNs> {
    seconds.checked_mul(1_000_000_000)?.checked_add(nanoseconds).map(UnixNs)
}

/// Who sent it; an IPv4 sender is one on a dual-stack socket too.
fn sender(address: &SockaddrStorage) -> Option<IpAddr> {
    if let Some(v4) = address.as_sockaddr_in() {
        return Some(IpAddr::V4(v4.ip()));
    }
    let v6: Ipv6Addr = address.as_sockaddr_in6()?.ip();
    Some(IpAddr::V6(v6).to_canonical())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    fn options(address: SocketAddr) -> PortOptions<'static> {
        PortOptions { address, interface: None, multicast: None, buffer: 1 << 20 }
    }

    fn any_port() -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, 0))
    }

    #[test]
    fn a_port_in_use_is_said_with_the_way_to_its_owner() {
        let owner = UdpSocket::bind(any_port()).expect("a free port");
        let address = owner.local_addr().expect("bound");
        let error = UdpPort::open(options(address)).expect_err("taken");
        assert!(matches!(error, SourceError::PortInUse { port } if port == address.port()), "{error}");
        assert!(error.to_string().contains(&format!("ss -ulpn 'sport = :{}'", address.port())), "{error}");
    }

    #[test]
    fn an_address_or_interface_that_is_not_here_is_named() {
        // 192.0.2.0/24 is reserved for documentation (RFC 5737): no machine has it.
        let error = UdpPort::open(options(SocketAddr::from(([192, 0, 2, 1], 0)))).expect_err("not ours");
        assert!(
            matches!(error, SourceError::NoSuchAddress { address } if address.to_string() == "192.0.2.1"),
            "{error}"
        );
        let error =
            UdpPort::open(PortOptions { interface: Some("no-such-if0"), ..options(any_port()) }).expect_err("none");
        assert!(matches!(&error, SourceError::NoSuchInterface { interface } if interface == "no-such-if0"), "{error}");
    }

    #[test]
    fn a_datagram_at_the_limit_is_whole_and_one_beyond_it_is_told() {
        let mut port = UdpPort::open(options(any_port())).expect("opens");
        let sender = UdpSocket::bind(any_port()).expect("a free port");
        for length in [0, DATAGRAM_LIMIT, DATAGRAM_LIMIT + 1] {
            sender.send_to(&vec![7; length], port.address()).expect("sent");
            let received = port.receive().expect("open").expect("loopback delivers at once");
            assert_eq!((received.payload.len(), received.oversized), (length.min(2_048), length > 2_048));
            assert_eq!(received.from, Some(IpAddr::V4(Ipv4Addr::LOCALHOST)));
            assert!(received.stamp.is_some());
        }
        assert!(port.receive().expect("open").is_none());
    }

    #[test]
    fn the_drop_count_wraps() {
        let mut port = UdpPort::open(PortOptions { buffer: 0, ..options(any_port()) }).expect("opens");
        let sender = UdpSocket::bind(any_port()).expect("a free port");
        for _ in 0..100 {
            sender.send_to(&[0; 1_206], port.address()).expect("sent");
        }
        // As if the kernel had counted to 2³² − 1 before: its next count c then means c + 1 more.
        port.dropped = u32::MAX;
        let mut received = 0u32;
        while port.receive().expect("open").is_some() {
            received += 1;
        }
        sender.send_to(&[0; 1_206], port.address()).expect("sent");
        let last = port.receive().expect("open").expect("there is room again");
        assert!((1..100).contains(&received), "some fit, not all: {received}");
        assert_eq!(last.lost_before, 100 - received + 1);
    }

    #[test]
    fn a_dual_stack_socket_knows_ipv4_senders() {
        let Ok(mut port) = UdpPort::open(options(SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)))) else {
            println!("skipped: no IPv6 here");
            return;
        };
        let sender = UdpSocket::bind(any_port()).expect("a free port");
        sender.send_to(&[1], (Ipv4Addr::LOCALHOST, port.address().port())).expect("sent");
        let received = port.receive().expect("open").expect("loopback delivers at once");
        assert_eq!(received.from, Some(IpAddr::V4(Ipv4Addr::LOCALHOST)));
    }
}

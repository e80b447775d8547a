//! A LiDAR on UDP: its data port and its position port.

use super::arrival::ArrivalClock;
use super::clock::SessionClock;
use super::intake::{Intake, LedgerClosed};
use super::source::{
    Device, Opener, ReceiveBuffer, Source, SourceCounters, SourceError, SourceInfo, SourceWarning, Summary, UdpInfo,
};
use super::stop::StopToken;
use super::udp_port::{PortOptions, UdpPort};
use bytes::Bytes;
use nix::errno::Errno;
use nix::net::if_::if_nametoindex;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};
use tumbled_model::{Body, LossPoint, SensorId};

/// Receive buffer asked for: 4 MiB hold 1.2 s of a VLP-32C, at the 2.3 kB that the kernel charges for a packet.
pub const RECEIVE_BUFFER_BYTES: usize = 4 << 20;
/// Less than this is worth a warning: 0.3 s of a VLP-32C.
pub const SMALL_RECEIVE_BUFFER_BYTES: usize = 1 << 20;
/// Datagrams read from one port before the other one and the stop get their turn.
const TURN: usize = 256;
/// How often an idle source posts what it owes and looks whether its interface is still there.
const IDLE: Duration = Duration::from_millis(250);

/// Which datagrams are a LiDAR's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UdpConfig {
    /// The sensor's name.
    pub sensor: SensorId,
    /// The address to bind to. The unspecified one hears every interface and the sensors' default, broadcast; a socket
    /// bound to one unicast address does not hear broadcasts.
    pub address: IpAddr,
    /// Data packets' destination port; 0 takes any free one.
    pub port: u16,
    /// Position packets' destination port; 0 takes any free one; `None` does not listen.
    pub position_port: Option<u16>,
    /// Count only datagrams from this address.
    pub source: Option<IpAddr>,
    /// Hear only this network interface.
    pub interface: Option<String>,
    /// A multicast group the sensor sends to.
    pub multicast: Option<Ipv4Addr>,
    /// Receive buffer to ask for, bytes, for each socket.
    pub receive_buffer: usize,
}

impl UdpConfig {
    /// All interfaces, the factory's ports 2368 and 8308, any sender.
    pub fn new(sensor: SensorId) -> Self {
        Self {
            sensor,
            address: IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            port: 2368,
            position_port: Some(8308),
            source: None,
            interface: None,
            multicast: None,
            receive_buffer: RECEIVE_BUFFER_BYTES,
        }
    }
}

/// The open sockets of one LiDAR.
#[derive(Debug)]
pub struct UdpSource {
    config: UdpConfig,
    clock: SessionClock,
    data: Listener,
    position: Option<Listener>,
    /// The interface's index at opening: one that was pulled and came back has another.
    interface_index: Option<u32>,
}

/// A socket and its own way from stamps to the session's timeline.
#[derive(Debug)]
struct Listener {
    port: UdpPort,
    arrivals: ArrivalClock,
}

impl UdpSource {
    /// Opens both sockets; from here on the kernel queues what arrives.
    ///
    /// # Errors
    /// When a port is in use or reserved, when address or interface are not on this machine.
    pub fn bind(config: UdpConfig, clock: SessionClock) -> Result<Self, SourceError> {
        let open = |port: u16| -> Result<Listener, SourceError> {
            let port = UdpPort::open(PortOptions {
                address: SocketAddr::new(config.address, port),
                interface: config.interface.as_deref(),
                multicast: config.multicast,
                buffer: config.receive_buffer,
            })?;
            Ok(Listener { port, arrivals: ArrivalClock::default() })
        };
        let data = open(config.port)?;
        let position = config.position_port.map(open).transpose()?;
        let interface_index = config.interface.as_deref().map(index_of).transpose()?;
        Ok(Self { config, clock, data, position, interface_index })
    }

    /// The data socket's address and port as bound.
    pub fn address(&self) -> SocketAddr {
        self.data.port.address()
    }

    /// The position socket's.
    pub fn position_address(&self) -> Option<SocketAddr> {
        self.position.as_ref().map(|listener| listener.port.address())
    }

    /// The data socket's receive buffer.
    pub fn buffer(&self) -> ReceiveBuffer {
        self.data.port.buffer()
    }

    /// Waits for datagrams; which sockets have some. Both false after [`IDLE`] or a stop.
    fn wait(&self, stop: &StopToken) -> Result<(bool, bool), SourceError> {
        let mut waiting =
            vec![PollFd::new(stop.as_fd(), PollFlags::POLLIN), PollFd::new(self.data.port.as_fd(), PollFlags::POLLIN)];
        waiting.extend(self.position.as_ref().map(|listener| PollFd::new(listener.port.as_fd(), PollFlags::POLLIN)));
        let timeout = PollTimeout::try_from(IDLE).unwrap_or(PollTimeout::MAX);
        match poll(&mut waiting, timeout) {
            Ok(_) => {}
            Err(Errno::EINTR) => return Ok((false, false)),
            Err(errno) => return Err(SourceError::Receive { address: self.address(), error: errno.into() }),
        }
        let told = |index: usize| waiting.get(index).and_then(PollFd::any).unwrap_or(false);
        let broken = |index: usize| {
            let wrong = PollFlags::POLLERR | PollFlags::POLLNVAL | PollFlags::POLLHUP;
            waiting.get(index).and_then(PollFd::revents).is_some_and(|events| events.intersects(wrong))
        };
        for (index, listener) in (1..).zip([Some(&self.data), self.position.as_ref()]) {
            if let Some(error) = listener.filter(|_| broken(index)).and_then(|listener| listener.port.pending_error()) {
                return Err(error);
            }
        }
        Ok((told(1), told(2)))
    }

    /// Whether the interface that was asked for is still the one that was opened.
    fn check_interface(&self) -> Result<(), SourceError> {
        let Some(interface) = &self.config.interface else { return Ok(()) };
        if Some(index_of(interface)?) == self.interface_index {
            Ok(())
        } else {
            Err(SourceError::NoSuchInterface { interface: interface.clone() })
        }
    }

    fn receive_until(&mut self, sink: &mut Intake, stop: &StopToken) -> Result<(), SourceError> {
        let counters = sink.counters();
        let mut last_look = Instant::now();
        while !stop.is_stopped() {
            let (data, position) = self.wait(stop)?;
            for (ready, listener) in [(data, Some(&mut self.data)), (position, self.position.as_mut())] {
                if let Some(listener) = listener.filter(|_| ready) {
                    listener.drain(&self.config, &self.clock, sink, &counters)?;
                }
            }
            if last_look.elapsed() >= IDLE {
                last_look = Instant::now();
                self.check_interface()?;
                sink.settle(self.clock.now().rig).map_err(|closed| ended(&self.config.sensor, closed))?;
            }
        }
        Ok(())
    }
}

impl Listener {
    /// Receive, stamp, push; a turn at most. Nothing else belongs on this thread.
    fn drain(
        &mut self,
        config: &UdpConfig,
        clock: &SessionClock,
        sink: &mut Intake,
        counters: &SourceCounters,
    ) -> Result<(), SourceError> {
        for _ in 0..TURN {
            let Some(datagram) = self.port.receive()? else { return Ok(()) };
            // The kernel told of its losses with this datagram, whosever it is.
            sink.lost(LossPoint::Kernel, u64::from(datagram.lost_before));
            if config.source.is_some_and(|source| datagram.from != Some(source.to_canonical())) {
                SourceCounters::add(&counters.other_source, 1);
                continue;
            }
            if datagram.oversized {
                SourceCounters::add(&counters.oversized, 1);
                continue;
            }
            let steps = self.arrivals.steps();
            let arrival = self.arrivals.arrival(clock.now(), datagram.stamp);
            SourceCounters::add(&counters.clock_steps, self.arrivals.steps() - steps);
            SourceCounters::add(&counters.stamped_at_reading, u64::from(!arrival.by_kernel));
            let bytes = Bytes::copy_from_slice(datagram.payload);
            let body = Body::LidarPacket { sensor: config.sensor.clone(), bytes };
            sink.push(arrival.at, body).map_err(|closed| ended(&config.sensor, closed))?;
        }
        Ok(())
    }
}

impl Source for UdpSource {
    fn describe(&self) -> SourceInfo {
        let buffer = self.buffer();
        let device = Device::Udp(UdpInfo {
            data: self.address(),
            position: self.position_address(),
            source: self.config.source,
            buffer,
        });
        let mut info = SourceInfo::new(self.config.sensor.clone(), device);
        if buffer.granted < SMALL_RECEIVE_BUFFER_BYTES {
            info.warnings.push(SourceWarning::SmallReceiveBuffer(buffer));
        }
        info
    }

    fn run(mut self: Box<Self>, mut sink: Intake, stop: StopToken) -> Result<Summary, SourceError> {
        match self.receive_until(&mut sink, &stop) {
            Ok(()) => {}
            // Who stops the ledger has told this source too: the two only raced.
            Err(SourceError::LedgerClosed { .. }) if stop.is_stopped() => {}
            Err(error) => return Err(error),
        }
        Ok(sink.counters().snapshot())
    }
}

fn ended(sensor: &SensorId, _: LedgerClosed) -> SourceError {
    SourceError::LedgerClosed { sensor: sensor.clone() }
}

fn index_of(interface: &str) -> Result<u32, SourceError> {
    if_nametoindex(interface).map_err(|_no_such_name| SourceError::NoSuchInterface { interface: interface.to_owned() })
}

/// Opens a LiDAR's sockets again and again, on the ports it got the first time.
#[derive(Debug)]
pub struct UdpOpener {
    config: UdpConfig,
    clock: SessionClock,
}

impl UdpOpener {
    /// An opener; nothing is opened yet.
    pub fn new(config: UdpConfig, clock: SessionClock) -> Self {
        Self { config, clock }
    }
}

impl Opener for UdpOpener {
    fn sensor(&self) -> &SensorId {
        &self.config.sensor
    }

    fn open(&mut self) -> Result<Box<dyn Source>, SourceError> {
        let source = UdpSource::bind(self.config.clone(), self.clock.clone())?;
        // A sensor keeps sending to the port it was told: a port once chosen stays.
        self.config.port = source.address().port();
        self.config.position_port = source.position_address().map(|address| address.port());
        Ok(Box::new(source))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::intake::QueueBound;
    use crate::live::ledger::Ledger;

    fn on_loopback() -> UdpConfig {
        let mut config = UdpConfig::new("front".into());
        config.address = IpAddr::V4(Ipv4Addr::LOCALHOST);
        (config.port, config.position_port) = (0, Some(0));
        config
    }

    #[test]
    fn an_interface_that_is_another_one_now_ends_the_run() {
        let clock = SessionClock::start_on_system();
        let config = UdpConfig { interface: Some("lo".to_owned()), ..on_loopback() };
        let mut source = match UdpSource::bind(config, clock.clone()) {
            Err(SourceError::NotPermitted { .. }) => {
                println!("skipped: this kernel lets root alone bind to an interface");
                return;
            }
            bound => bound.expect("loopback is there"),
        };
        // As if the interface had been pulled and had come back: its index is a new one.
        source.interface_index = source.interface_index.map(|index| index + 1_000);
        let mut ledger = Ledger::live(clock);
        let sink = ledger.intake("front".into(), QueueBound::LIDAR_PACKETS);
        let stop = StopToken::new().expect("a descriptor");
        let error = Box::new(source).run(sink, stop).expect_err("the interface is gone");
        assert!(matches!(&error, SourceError::NoSuchInterface { interface } if interface == "lo"), "{error}");
        assert!(error.is_worth_a_retry());
    }

    #[test]
    fn a_ledger_that_ends_first_ends_the_source() {
        let clock = SessionClock::start_on_system();
        let source = UdpSource::bind(on_loopback(), clock.clone()).expect("loopback is there");
        let to = source.address();
        let mut ledger = Ledger::live(clock);
        let sink = ledger.intake("front".into(), QueueBound::LIDAR_PACKETS);
        drop(ledger);
        std::net::UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port").send_to(&[1], to).expect("sent");
        let error = Box::new(source).run(sink, StopToken::new().expect("a descriptor")).expect_err("no ledger");
        assert!(matches!(error, SourceError::LedgerClosed { .. }) && !error.is_worth_a_retry(), "{error}");
    }
}

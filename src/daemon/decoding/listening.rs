//! Who speaks on the LiDARs' UDP ports: heard for a moment, told by port and sender.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::time::Duration;

use tumbled_io::live::{Heard, SourceError, UdpProbe, listen};
use tumbled_model::RigNs;
use tumbled_velodyne::detect::PeriodMismatch;
use tumbled_velodyne::stream::{Decoded, Rejection};
use tumbled_velodyne::stream::{Settings, StreamDecoder};
use tumbled_velodyne::wire::{DataPacket, POSITION_LEN};
use tumbled_velodyne::{Model, ReturnMode};

use super::turning::HeadTurning;
use crate::config::Config;

/// Senders told apart on one port; what others send is not looked at.
const MOST_SENDERS: usize = 32;

/// Between two packets within so much time less than a turn lies at 1 200 rpm, the fastest a sensor turns.
const LESS_THAN_A_TURN_NS: i64 = 45_000_000;

/// The ports of a config's LiDARs.
pub struct Listening {
    ports: Vec<Port>,
}

struct Port {
    number: u16,
    probe: Result<UdpProbe, SourceError>,
}

/// What was heard.
pub struct HeardPorts {
    /// The ports, in order of their numbers.
    pub ports: Vec<HeardPort>,
    /// For how long it was listened.
    pub time: Duration,
}

/// One port.
pub struct HeardPort {
    /// Its number.
    pub number: u16,
    /// Why it could not be listened to; `None`: it could.
    pub error: Option<SourceError>,
    /// Who sent something, by address.
    pub senders: BTreeMap<IpAddr, Sender>,
}

/// Someone who sends to a port.
pub struct Sender {
    /// Payloads of a data packet's length.
    pub data_packets: u64,
    /// Payloads of a position packet's length.
    pub position_packets: u64,
    /// Payloads of other lengths: no Velodyne's.
    pub foreign: u64,
    decoder: StreamDecoder,
    head: HeadTurning,
    decoded: Decoded,
}

impl Listening {
    /// Opens every port of the config's LiDARs once; port 0 is nobody's yet and left out.
    pub fn open(config: &Config) -> Self {
        let all = config.lidars.iter().flat_map(|lidar| [lidar.port, lidar.position_port]);
        let mut numbers: Vec<u16> = all.filter(|port| *port != 0).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let ports = numbers.into_iter().map(|number| Port { number, probe: UdpProbe::open(number) });
        Self { ports: ports.collect() }
    }

    /// Listens for so long.
    ///
    /// # Errors
    /// When receiving from an open port fails.
    pub fn listen(self, time: Duration) -> Result<HeardPorts, SourceError> {
        let (mut ports, mut probes, mut open) = (Vec::new(), Vec::new(), Vec::new());
        for (index, Port { number, probe }) in self.ports.into_iter().enumerate() {
            let error = match probe {
                Ok(probe) => {
                    probes.push(probe);
                    open.push(index);
                    None
                }
                Err(error) => Some(error),
            };
            ports.push(HeardPort { number, error, senders: BTreeMap::new() });
        }
        if !probes.is_empty() {
            listen(&mut probes, time, |index, heard| {
                if let Some(port) = open.get(index).and_then(|index| ports.get_mut(*index)) {
                    port.take(heard);
                }
            })?;
        }
        Ok(HeardPorts { ports, time })
    }
}

impl HeardPorts {
    /// A port by its number.
    pub fn port(&self, number: u16) -> Option<&HeardPort> {
        self.ports.iter().find(|port| port.number == number)
    }
}

impl HeardPort {
    fn take(&mut self, heard: Heard<'_>) {
        let Some(from) = heard.from else { return };
        if self.senders.len() >= MOST_SENDERS && !self.senders.contains_key(&from) {
            return;
        }
        self.senders.entry(from).or_insert_with(Sender::new).take(heard);
    }
}

impl Sender {
    fn new() -> Self {
        Self {
            data_packets: 0,
            position_packets: 0,
            foreign: 0,
            decoder: StreamDecoder::new(Settings::default()),
            head: HeadTurning::default(),
            decoded: Decoded::default(),
        }
    }

    fn take(&mut self, heard: Heard<'_>) {
        let arrived = heard.stamp.map_or(RigNs(0), |stamp| RigNs(stamp.0));
        match DataPacket::new(heard.payload) {
            Ok(packet) => {
                self.data_packets += 1;
                if let (Ok([first, .., last]), Some(stamp)) = (packet.azimuths(), heard.stamp) {
                    let step = self.head.last_ns().map(|last| stamp.0 - last);
                    let follows = step.is_some_and(|step| (0..LESS_THAN_A_TURN_NS).contains(&step));
                    self.head.packet(stamp.0, (first, last), follows);
                }
            }
            Err(_) if heard.payload.len() == POSITION_LEN => self.position_packets += 1,
            Err(_) => self.foreign += 1,
        }
        self.decoder.push(heard.payload, arrived, &mut self.decoded);
        self.decoded.clear();
    }

    /// The model that its packets say they are of, or that their period belongs to where it contradicts them.
    pub fn model(&self) -> Option<Model> {
        let by_period = self.decoder.period_mismatch().and_then(|mismatch| mismatch.fits);
        by_period.or(self.decoder.model())
    }

    /// A packet period that is not that of the model its packets name.
    pub fn period_mismatch(&self) -> Option<PeriodMismatch> {
        self.decoder.period_mismatch()
    }

    /// Why its packets would give no points, the most frequent reason; an HDL-64E's calibration is another matter.
    pub fn refusal(&self) -> Option<Rejection> {
        let refusals =
            self.decoder.counts().rejected.values().filter(|refused| refused.first != Rejection::Uncalibrated);
        refusals.max_by_key(|refused| refused.count).map(|refused| refused.first)
    }

    /// The return mode of most of its packets; `None` where they do not say it.
    pub fn return_mode(&self) -> Option<ReturnMode> {
        let modes = &self.decoder.counts().modes;
        modes.iter().max_by_key(|(_, count)| **count).map(|(mode, _)| *mode)
    }

    /// How fast its head turns, turns a minute, by the kernel's stamps.
    pub fn rpm(&self) -> Option<f64> {
        self.head.rpm()
    }
}

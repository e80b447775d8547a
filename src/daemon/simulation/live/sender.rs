//! Sending what was made when its time has come.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use tumbled_io::live::{Intake, LedgerClosed, SessionClock, StopToken, UdpSender};
use tumbled_model::{Body, Event, RigNs, SensorId, SourceState};
use tumbled_velodyne::wire::POSITION_LEN;

use super::shortfall::Shortfall;
use super::{LATEST, Way};

/// The sensors' side of their cables.
pub(super) struct Sender {
    pub(super) ways: BTreeMap<SensorId, Way>,
    pub(super) socket: UdpSender,
    pub(super) clock: SessionClock,
    pub(super) stop: StopToken,
    pub(super) shortfall: Arc<Shortfall>,
}

impl Sender {
    /// Until the items end: those who make them are told to stop.
    pub(super) fn run(mut self, items: Receiver<Event>) {
        let ended = self.each_intake(SourceState::Opened).and_then(|()| {
            for event in items {
                self.wait_for(event.arrived);
                if self.stop.is_stopped() {
                    break;
                }
                self.send(event)?;
            }
            self.each_intake(SourceState::Closed)
        });
        if ended.is_err() && !self.stop.is_stopped() {
            tracing::error!("the ledger has ended: nothing takes the simulated sensors' data any more");
        }
    }

    fn wait_for(&self, due: RigNs) {
        let left = u64::try_from((due - self.clock.now().rig).0).unwrap_or(0);
        if left > 0 {
            self.stop.sleep_until(Instant::now() + Duration::from_nanos(left));
        }
    }

    fn send(&mut self, event: Event) -> Result<(), LedgerClosed> {
        let Some(way) = event.body.sensor().and_then(|sensor| self.ways.get_mut(sensor)) else { return Ok(()) };
        let now = self.clock.now().rig;
        let is_data = !matches!(event.body, Body::SensorState { .. });
        if is_data && now - event.arrived > LATEST {
            self.shortfall.late(now);
            return Ok(());
        }
        self.shortfall.sent(now - event.arrived);
        match (way, event.body) {
            (Way::Datagrams { data, position }, Body::LidarPacket { bytes, .. }) => {
                let to = if bytes.len() == POSITION_LEN { *position } else { *data };
                if self.socket.datagram(to, &bytes).is_err() {
                    self.shortfall.refused();
                }
                Ok(())
            }
            (Way::Datagrams { .. }, _) => Ok(()),
            (Way::Intake(intake), Body::SensorState { state, .. }) => intake.state(now, state),
            (Way::Intake(intake), body) => intake.push(now, body).map(|_| ()),
        }
    }

    /// What a source tells the ledger when it is opened and closed.
    fn each_intake(&mut self, state: SourceState) -> Result<(), LedgerClosed> {
        let now = self.clock.now().rig;
        let intakes = self.ways.values_mut().filter_map(|way| match way {
            Way::Intake(intake) => Some(intake),
            Way::Datagrams { .. } => None,
        });
        intakes.into_iter().try_for_each(|intake: &mut Intake| intake.state(now, state))
    }
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;

    use bytes::Bytes;
    use tumbled_model::Span;

    use super::*;

    #[test]
    fn each_packet_goes_to_its_port_in_time_and_what_is_too_late_does_not_go() {
        let socket = || UdpSocket::bind("127.0.0.1:0").expect("a free port");
        let (data, position) = (socket(), socket());
        let address = |socket: &UdpSocket| socket.local_addr().expect("bound");
        let way = Way::Datagrams { data: address(&data), position: address(&position) };
        let clock = SessionClock::start_on_system();
        let shortfall = Arc::new(Shortfall::default());
        let sender = Sender {
            ways: BTreeMap::from([("front".into(), way)]),
            socket: UdpSender::bind("127.0.0.1:0".parse().expect("an address")).expect("a free port"),
            clock: clock.clone(),
            stop: StopToken::new().expect("a descriptor"),
            shortfall: Arc::clone(&shortfall),
        };
        let packet = |seq: u64, arrived, sensor: &str, length: usize| Event {
            seq,
            arrived,
            body: Body::LidarPacket { sensor: sensor.into(), bytes: Bytes::from(vec![seq as u8; length]) },
        };
        let (now, ms) = (clock.now().rig, Span(1_000_000));
        let due = now + Span(30 * ms.0);
        let (items, events) = crossbeam_channel::bounded(8);
        let sent = [
            packet(0, now - Span(5_000 * ms.0), "front", 1_206),
            packet(1, now, "front", 1_206),
            packet(2, now, "nobody", 1_206),
            packet(3, now, "front", 70_000),
            packet(4, due, "front", 512),
        ];
        sent.into_iter().for_each(|event| items.send(event).expect("room"));
        drop(items);
        sender.run(events);
        assert!(clock.now().rig >= due);
        let mut bytes = [0; 2_000];
        let mut received = |socket: &UdpSocket| {
            socket.set_nonblocking(true).expect("set");
            let lengths = std::iter::from_fn(|| socket.recv(&mut bytes).ok());
            lengths.collect::<Vec<usize>>()
        };
        assert_eq!((received(&data), received(&position)), (vec![1_206], vec![512]));
        let report = shortfall.report();
        assert_eq!((report.late, report.refused), (1, 1), "5 s late; longer than any datagram");
    }
}

//! A source's bounded way into the ledger.

use super::outlet::WhenFull;
use super::source::SourceCounters;
use bytes::Bytes;
use crossbeam_channel::{Receiver, Sender, TrySendError};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tumbled_model::{Body, LossPoint, RigNs, SensorId, SourceState};

/// How many items of one source may wait for the ledger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueBound(pub usize);

impl QueueBound {
    /// LiDAR packets: 2.7 s of a VLP-32C at 1 507 packets/s, 1.4 s in dual return; 5 MB.
    pub const LIDAR_PACKETS: Self = Self(4_096);
    /// Kinect frames: 0.27 s at 30 Hz; 3.4 MB packed.
    pub const KINECT_FRAMES: Self = Self(8);
    /// Serial chunks: 10 s of a stage polled at 100 Hz, 1 s of a line stream at 1 kHz.
    pub const SERIAL_CHUNKS: Self = Self(1_024);
}

/// What became of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The queue took it.
    Taken,
    /// The queue was full: counted, and posted as part of a gap as soon as there is room.
    Lost,
}

/// The ledger has ended; nothing takes the item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the ledger has ended")]
pub struct LedgerClosed;

/// An item on its way into the ledger.
#[derive(Debug)]
pub(super) struct Offered {
    pub(super) arrived: RigNs,
    pub(super) body: Body,
    /// The position it had in the ledger it was recorded from.
    pub(super) seq: Option<u64>,
}

/// How long a source that ends waits for room to post its last losses: as long as a stopping ledger drains.
const LAST_POST: Duration = Duration::from_secs(2);

/// One source's bounded queue into the ledger, and its policy.
///
/// Live, a full queue loses the newest item and counts it; one gap with the exact count goes ahead of the next item
/// that finds room. On replay the source waits. Dropping the intake posts what is still owed.
#[derive(Debug)]
pub struct Intake {
    sensor: SensorId,
    queue: Sender<Offered>,
    when_full: WhenFull,
    counters: Arc<SourceCounters>,
    /// Losses not yet posted, by place.
    owed: BTreeMap<LossPoint, u64>,
    last_arrived: RigNs,
}

impl Intake {
    /// An intake and the ledger's end of its queue.
    pub(super) fn new(sensor: SensorId, bound: QueueBound, when_full: WhenFull) -> (Self, Receiver<Offered>) {
        let (queue, items) = crossbeam_channel::bounded(bound.0.max(1));
        let counters = Arc::default();
        (Self { sensor, queue, when_full, counters, owed: BTreeMap::new(), last_arrived: RigNs(0) }, items)
    }

    /// Whose data go in.
    pub fn sensor(&self) -> &SensorId {
        &self.sensor
    }

    /// The source's counts, shared by all its intakes.
    pub fn counters(&self) -> Arc<SourceCounters> {
        Arc::clone(&self.counters)
    }

    /// A second way into the same queue, for the next run of the same source. Losses owed stay with this one.
    pub fn again(&self) -> Self {
        Self {
            sensor: self.sensor.clone(),
            queue: self.queue.clone(),
            when_full: self.when_full,
            counters: Arc::clone(&self.counters),
            owed: BTreeMap::new(),
            last_arrived: self.last_arrived,
        }
    }

    /// Puts one item in. Never waits on a live ledger.
    ///
    /// # Errors
    /// When the ledger has ended.
    pub fn push(&mut self, arrived: RigNs, body: Body) -> Result<Delivery, LedgerClosed> {
        self.offer(Offered { arrived, body, seq: None })
    }

    /// Puts in an event that already has its place: a replaying ledger keeps its `seq`.
    ///
    /// # Errors
    /// When the ledger has ended.
    pub fn push_recorded(&mut self, event: tumbled_model::Event) -> Result<Delivery, LedgerClosed> {
        self.offer(Offered { arrived: event.arrived, body: event.body, seq: Some(event.seq) })
    }

    /// Notes `lost` items that never reached the host's program; posted as one gap ahead of the next item.
    pub fn lost(&mut self, place: LossPoint, lost: u64) {
        if lost == 0 {
            return;
        }
        *self.owed.entry(place).or_insert(0) += lost;
        if let Some(count) = self.counters.lost_at(place) {
            SourceCounters::add(count, lost);
        }
    }

    /// Posts what is owed when there is room, as of `now`: for a source that has nothing to deliver at the moment.
    /// Whether nothing is owed any more.
    ///
    /// # Errors
    /// When the ledger has ended.
    pub fn settle(&mut self, now: RigNs) -> Result<bool, LedgerClosed> {
        self.post_owed(now, self.when_full)
    }

    /// Posts the source's state; waits for room, because a state must not be lost.
    ///
    /// # Errors
    /// When the ledger has ended.
    pub fn state(&mut self, now: RigNs, state: SourceState) -> Result<(), LedgerClosed> {
        self.post_owed(now, WhenFull::Wait)?;
        let body = Body::SensorState { sensor: self.sensor.clone(), state };
        self.queue.send(Offered { arrived: now, body, seq: None }).or(Err(LedgerClosed))
    }

    fn offer(&mut self, item: Offered) -> Result<Delivery, LedgerClosed> {
        self.last_arrived = item.arrived;
        let bytes = payload(&item.body).map_or(0, Bytes::len) as u64;
        let taken = self.post_owed(item.arrived, self.when_full)? && self.send(item, self.when_full)?;
        if taken {
            SourceCounters::add(&self.counters.delivered, 1);
            SourceCounters::add(&self.counters.bytes, bytes);
            Ok(Delivery::Taken)
        } else {
            self.lost(LossPoint::Queue, 1);
            Ok(Delivery::Lost)
        }
    }

    /// Posts the gaps owed, oldest place first; false when the queue is full before the last of them.
    fn post_owed(&mut self, arrived: RigNs, when_full: WhenFull) -> Result<bool, LedgerClosed> {
        while let Some((&place, &owed)) = self.owed.first_key_value() {
            let lost = u32::try_from(owed).unwrap_or(u32::MAX);
            let body = Body::Gap { sensor: self.sensor.clone(), lost, place };
            if !self.send(Offered { arrived, body, seq: None }, when_full)? {
                return Ok(false);
            }
            let left = owed - u64::from(lost);
            if left == 0 {
                self.owed.remove(&place);
            } else {
                self.owed.insert(place, left);
            }
        }
        Ok(true)
    }

    fn send(&self, item: Offered, when_full: WhenFull) -> Result<bool, LedgerClosed> {
        match when_full {
            WhenFull::Wait => self.queue.send(item).map(|()| true).or(Err(LedgerClosed)),
            WhenFull::Lose => match self.queue.try_send(item) {
                Ok(()) => Ok(true),
                Err(TrySendError::Full(_)) => Ok(false),
                Err(TrySendError::Disconnected(_)) => Err(LedgerClosed),
            },
        }
    }
}

impl Drop for Intake {
    /// The last losses would otherwise have no packet to go ahead of.
    fn drop(&mut self) {
        let until = Instant::now() + LAST_POST;
        while self.post_owed(self.last_arrived, WhenFull::Lose) == Ok(false) && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(1));
        }
        // A ledger that has ended or hangs does not get them; they stay in the counters.
    }
}

/// The bytes an event carries, if it carries any.
pub(super) fn payload(body: &Body) -> Option<&Bytes> {
    match body {
        Body::LidarPacket { bytes, .. }
        | Body::DepthFrame { bytes, .. }
        | Body::SerialChunk { bytes, .. }
        | Body::DeviceTables { bytes, .. } => Some(bytes),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packet(n: u8) -> Body {
        Body::LidarPacket { sensor: "front".into(), bytes: Bytes::copy_from_slice(&[n]) }
    }

    fn gap(lost: u32, place: LossPoint) -> Body {
        Body::Gap { sensor: "front".into(), lost, place }
    }

    fn taken(items: &Receiver<Offered>) -> Vec<Body> {
        items.try_iter().map(|item| item.body).collect()
    }

    #[test]
    fn a_full_queue_loses_the_newest_and_one_gap_goes_ahead_of_the_next() {
        let (mut intake, items) = Intake::new("front".into(), QueueBound(3), WhenFull::Lose);
        for n in 0..8 {
            intake.push(RigNs(i64::from(n)), packet(n)).expect("open");
        }
        assert_eq!(taken(&items), [packet(0), packet(1), packet(2)]);
        intake.push(RigNs(8), packet(8)).expect("open");
        // 3..=7 were lost: five.
        assert_eq!(taken(&items), [gap(5, LossPoint::Queue), packet(8)]);
        let counts = intake.counters().snapshot();
        assert_eq!((counts.delivered, counts.lost_queue, counts.bytes), (4, 5, 4));
    }

    #[test]
    fn a_queue_with_room_for_the_gap_alone_starts_the_next_gap() {
        let (mut intake, items) = Intake::new("front".into(), QueueBound(1), WhenFull::Lose);
        intake.push(RigNs(0), packet(0)).expect("open");
        intake.push(RigNs(1), packet(1)).expect("open");
        assert_eq!(taken(&items), [packet(0)]);
        assert_eq!(intake.push(RigNs(2), packet(2)), Ok(Delivery::Lost));
        assert_eq!(taken(&items), [gap(1, LossPoint::Queue)]);
        assert_eq!(intake.settle(RigNs(3)), Ok(true));
        assert_eq!(taken(&items), [gap(1, LossPoint::Queue)]);
    }

    #[test]
    fn what_is_owed_at_the_end_is_posted_at_the_end() {
        let (mut intake, items) = Intake::new("front".into(), QueueBound(4), WhenFull::Lose);
        intake.lost(LossPoint::Kernel, 7);
        intake.lost(LossPoint::Usb, 2);
        drop(intake);
        assert_eq!(taken(&items), [gap(7, LossPoint::Kernel), gap(2, LossPoint::Usb)]);
    }

    #[test]
    fn a_gap_beyond_the_field_is_posted_in_parts() {
        let (mut intake, items) = Intake::new("front".into(), QueueBound(4), WhenFull::Lose);
        intake.lost(LossPoint::Kernel, u64::from(u32::MAX) + 3);
        assert_eq!(intake.settle(RigNs(0)), Ok(true));
        assert_eq!(taken(&items), [gap(u32::MAX, LossPoint::Kernel), gap(3, LossPoint::Kernel)]);
    }

    #[test]
    fn an_ended_ledger_is_said() {
        let (mut intake, items) = Intake::new("front".into(), QueueBound(4), WhenFull::Lose);
        drop(items);
        assert_eq!(intake.push(RigNs(0), packet(0)), Err(LedgerClosed));
        assert_eq!(intake.state(RigNs(0), SourceState::Closed), Err(LedgerClosed));
    }

    #[test]
    fn a_replaying_source_waits_instead_of_losing() {
        let (mut intake, items) = Intake::new("front".into(), QueueBound(1), WhenFull::Wait);
        let source = std::thread::spawn(move || {
            (0..200).all(|n| intake.push(RigNs(i64::from(n)), packet(n)) == Ok(Delivery::Taken))
        });
        let bodies: Vec<Body> = items.iter().map(|item| item.body).collect();
        assert!(source.join().expect("no panic"));
        assert_eq!(bodies, (0..200).map(packet).collect::<Vec<_>>());
    }

    proptest! {
        #[test]
        fn delivered_and_gaps_account_for_everything_in_order(
            bound in 1usize..5, steps in prop::collection::vec(prop::option::weighted(0.7, Just(())), 1..200)
        ) {
            // `Some`: the source pushes; `None`: the ledger takes one.
            let (mut intake, items) = Intake::new("front".into(), QueueBound(bound), WhenFull::Lose);
            let (mut pushed, mut seen) = (0u64, Vec::new());
            for step in &steps {
                if step.is_some() {
                    let bytes = Bytes::copy_from_slice(&pushed.to_le_bytes());
                    intake.push(RigNs(0), Body::LidarPacket { sensor: "front".into(), bytes }).expect("open");
                    pushed += 1;
                } else {
                    seen.extend(items.try_recv().map(|item| item.body));
                }
            }
            seen.extend(taken(&items));
            while intake.settle(RigNs(0)) == Ok(false) {
                seen.extend(taken(&items));
            }
            drop(intake);
            seen.extend(taken(&items));
            // Walking the ledger, every packet is where the packets and gaps before it say.
            let mut next = 0u64;
            for body in seen {
                match body {
                    Body::LidarPacket { bytes, .. } => {
                        prop_assert_eq!(&bytes[..], &next.to_le_bytes()[..]);
                        next += 1;
                    }
                    Body::Gap { lost, place: LossPoint::Queue, .. } => next += u64::from(lost),
                    other => prop_assert!(false, "{other:?}"),
                }
            }
            prop_assert_eq!(next, pushed);
        }
    }
}

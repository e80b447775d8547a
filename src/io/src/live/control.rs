//! The shell's own way into the ledger: an operator's orders and changed configs.

use super::intake::{LedgerClosed, Offered};
use crate::recording::layout::MAX_CONFIG_BYTES;
use crossbeam_channel::{Receiver, SendTimeoutError, Sender};
use std::time::Duration;
use tumbled_model::{Body, Command, RigNs};

/// Orders that may wait for the ledger: a person gives one a second.
const BOUND: usize = 16;

/// How long a live ledger may take until it has room for an order. It takes what waits within milliseconds unless the
/// core holds it up, and then an operator wants to be told.
const PATIENCE: Duration = Duration::from_secs(2);

/// Why an order is not in the ledger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// Its text is longer than a recording holds.
    #[error("a text of {found} bytes: an order takes {most} at most")]
    TooLong {
        /// Bytes of the text.
        found: usize,
        /// Bytes it may have.
        most: usize,
    },
    /// It is neither an order nor a config: sensors have intakes of their own, ticks and anchors are the ledger's.
    #[error("only an operator's order and a changed config come this way")]
    NoOrder,
    /// Orders wait already and none was taken for 2 s.
    #[error("the ledger is held up: it took no order for {} s, try again", PATIENCE.as_secs())]
    HeldUp,
    /// The ledger has ended.
    #[error(transparent)]
    Closed(#[from] LedgerClosed),
}

/// The shell's bounded way into the ledger, for what concerns the session and no sensor. Clones share it.
///
/// A replaying ledger ends when this is dropped too.
/// Nothing is lost here: an order that finds no room waits, live for at most 2 s, on replay until there is.
#[derive(Clone, Debug)]
pub struct ControlIntake {
    queue: Sender<Offered>,
    patience: Option<Duration>,
}

impl ControlIntake {
    /// An intake and the ledger's end of its queue.
    pub(super) fn new(live: bool) -> (Self, Receiver<Offered>) {
        let (queue, items) = crossbeam_channel::bounded(BOUND);
        (Self { queue, patience: live.then_some(PATIENCE) }, items)
    }

    /// Puts an order or a config in; waits for room.
    ///
    /// # Errors
    /// When it is none, too long, or finds no room in time, and when the ledger has ended.
    pub fn post(&self, arrived: RigNs, body: Body) -> Result<(), ControlError> {
        let (found, most) = match &body {
            Body::Command(Command::Marker { text }) => (text.len(), Command::TEXT_BYTES),
            Body::Command(_) => (0, 0),
            Body::Config { toml } => (toml.len(), MAX_CONFIG_BYTES),
            _ => return Err(ControlError::NoOrder),
        };
        if found > most {
            return Err(ControlError::TooLong { found, most });
        }
        let item = Offered { arrived, body, seq: None };
        match self.patience {
            None => self.queue.send(item).or(Err(LedgerClosed.into())),
            Some(patience) => self.queue.send_timeout(item, patience).map_err(|error| match error {
                SendTimeoutError::Timeout(_) => ControlError::HeldUp,
                SendTimeoutError::Disconnected(_) => LedgerClosed.into(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::{Ledger, QueueBound, SessionClock};
    use tumbled_model::Event;

    fn marker(text: &str) -> Body {
        Body::Command(Command::Marker { text: text.into() })
    }

    fn config(bytes: usize) -> Body {
        Body::Config { toml: "c".repeat(bytes).into() }
    }

    #[test]
    fn an_order_is_an_event_of_a_live_ledger_and_no_sensor_s() {
        let mut ledger = Ledger::live(SessionClock::start_on_system());
        let events = ledger.recorder();
        let control = ledger.control();
        let _front = ledger.intake("front".into(), QueueBound(4));
        let handle = ledger.start().expect("a thread");
        control.post(RigNs(5), marker("begin")).expect("room");
        control.clone().post(RigNs(6), config(3)).expect("room");
        let listed: Vec<_> = handle.queues().into_iter().map(|queue| queue.sensor).collect();
        assert_eq!(listed, ["front".into()], "a queue's fill is told of sensors alone");
        handle.stop();
        let posted: Vec<Event> =
            events.filter(|event| !matches!(event.body, Body::Tick | Body::Anchor { .. })).collect();
        let bodies: Vec<_> = posted.iter().map(|event| (event.arrived, event.body.clone())).collect();
        assert_eq!(bodies, [(RigNs(5), marker("begin")), (RigNs(6), config(3))]);
        assert!(posted[0].seq < posted[1].seq);
        assert_eq!(control.post(RigNs(7), marker("late")), Err(ControlError::Closed(LedgerClosed)));
    }

    #[test]
    fn a_replaying_ledger_takes_orders_without_loss_and_ends_with_them() {
        let mut ledger = Ledger::replay();
        let events = ledger.recorder_with(1); // one event at a time: the ledger waits for its reader, orders for the ledger
        let control = ledger.control();
        let handle = ledger.start().expect("a thread");
        let poster = std::thread::spawn(move || (0..100).all(|n| control.post(RigNs(n), marker("m")).is_ok()));
        let arrivals: Vec<i64> = events.map(|event| event.arrived.0).collect();
        assert!(poster.join().expect("no panic"));
        assert_eq!(arrivals, (0..100).collect::<Vec<_>>());
        assert_eq!(handle.wait().events, 100);
    }

    #[test]
    fn what_is_no_order_or_too_long_is_refused() {
        let (control, items) = ControlIntake::new(true);
        assert_eq!(control.post(RigNs(0), Body::Tick), Err(ControlError::NoOrder));
        let long = "x".repeat(1_025);
        assert_eq!(control.post(RigNs(0), marker(&long)), Err(ControlError::TooLong { found: 1_025, most: 1_024 }));
        let (found, most) = ((1 << 20) + 1, 1 << 20);
        assert_eq!(control.post(RigNs(0), config(found)), Err(ControlError::TooLong { found, most }));
        assert_eq!(items.len(), 0);
    }

    #[test]
    fn a_ledger_that_is_held_up_is_told_and_the_order_is_not_queued_for_later() {
        let (control, items) = ControlIntake::new(true);
        let control = ControlIntake { patience: Some(Duration::from_millis(1)), ..control };
        for _ in 0..BOUND {
            control.post(RigNs(0), marker("m")).expect("room");
        }
        assert_eq!(control.post(RigNs(0), marker("one too many")), Err(ControlError::HeldUp));
        assert_eq!(items.len(), BOUND);
    }
}

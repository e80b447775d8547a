//! Making what the sensors will send, a little ahead of time.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tumbled_io::live::{SessionClock, StopToken};
use tumbled_model::{Event, Span};
use tumbled_sim::session::Simulation;

use super::shortfall::Shortfall;

/// Nothing is handed on further ahead than this: what makes the making uneven for a moment does not make the sending so.
const AHEAD: Span = Span(300_000_000);
/// Handed on at a time: one wait for so much of the scene, and not one for each packet.
const HAND_ON: Span = Span(50_000_000);
/// The time a first stretch is given to be made, and the first one after some were left out.
const LEAD: Span = Span(200_000_000);

/// A simulation that keeps to the session's clock. It ends with the scene, or with the stop.
pub(super) struct Ahead {
    simulation: Simulation,
    clock: SessionClock,
    stop: StopToken,
    shortfall: Arc<Shortfall>,
    next_seq: u64,
}

impl Ahead {
    /// The sensors are switched on with the session: what they send in the first moments, while nobody can have made it
    /// yet, is not missed.
    pub(super) fn new(
        mut simulation: Simulation,
        clock: SessionClock,
        stop: StopToken,
        shortfall: Arc<Shortfall>,
    ) -> Self {
        simulation.skip_to(clock.now().rig + LEAD);
        Self { simulation, clock, stop, shortfall, next_seq: 0 }
    }
}

impl Iterator for Ahead {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        if self.stop.is_stopped() {
            return None;
        }
        let (now, made) = (self.clock.now().rig, self.simulation.made());
        if made <= now {
            // What would be made now should have been sent already.
            let to = now + LEAD;
            self.shortfall.left_out(now, to - made);
            self.simulation.skip_to(to);
        }
        let Some(item) = self.simulation.next() else {
            tracing::error!("the scene is over after 11 days: the session ends");
            self.stop.stop();
            return None;
        };
        let early = item.arrived - self.clock.now().rig - AHEAD;
        if early > Span(0) {
            let wait = Duration::from_nanos((early + HAND_ON).0.unsigned_abs());
            self.stop.sleep_until(Instant::now() + wait);
        }
        let seq = self.next_seq;
        self.next_seq += 1;
        Some(Event { seq, arrived: item.arrived, body: item.body })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicI64, Ordering};

    use tumbled_io::live::{HostClock, HostSample};
    use tumbled_model::{RigNs, UnixNs};

    use super::*;
    use crate::simulation::scenes;

    /// A clock that stands until it is set.
    #[derive(Clone, Default)]
    struct Hand(Arc<AtomicI64>);

    impl HostClock for Hand {
        fn sample(&self) -> HostSample {
            let ns = self.0.load(Ordering::Relaxed);
            HostSample { monotonic: Span(ns), wall: UnixNs(ns), uncertainty: Span(0) }
        }
    }

    #[test]
    fn after_a_pause_it_goes_on_with_what_can_still_be_sent_in_time() {
        let hand = Hand::default();
        let clock = SessionClock::start(Arc::new(hand.clone()));
        let scene = scenes::load_endless("demo", UnixNs(0)).expect("a scene");
        let shortfall = Arc::new(Shortfall::default());
        let stop = StopToken::new().expect("a descriptor");
        let simulation = Simulation::new(Arc::new(scene), None);
        let mut ahead = Ahead::new(simulation, clock, stop, Arc::clone(&shortfall));
        let first = ahead.next().expect("an item").arrived;
        assert!(first >= RigNs(200_000_000) && first < RigNs(210_000_000), "{first:?}");
        assert_eq!(shortfall.report().left_out_s, 0.0, "nobody misses what came before the first");
        // What is sent from 0.2 s to 0.3 s has been made; now it is 5 s, and what follows begins at 5.2 s.
        hand.0.store(5_000_000_000, Ordering::Relaxed);
        let next = ahead.find(|event| event.arrived > RigNs(1_000_000_000)).expect("an item");
        assert!(next.arrived >= RigNs(5_200_000_000), "{:?}", next.arrived);
        assert!((shortfall.report().left_out_s - 4.9).abs() < 1e-9, "{:?}", shortfall.report());
    }
}

//! A simulated session as a ledger: what the sensors send, ticks and anchors.

use std::iter::Peekable;
use std::sync::Arc;

use tumbled_model::{Body, Event, RigNs, Span, UnixNs};
use tumbled_sim::scene::Scene;
use tumbled_sim::session::Simulation;

/// From tick to tick, as a live ledger has them.
const TICK: Span = Span(100_000_000);
/// From anchor to anchor, in ticks.
const TICKS_PER_ANCHOR: i64 = 10;

/// The ledger of a scene.
pub struct SimulatedLedger {
    scene: Arc<Scene>,
    items: Peekable<Simulation>,
    next_seq: u64,
    /// The next tick, counted from the start.
    beat: i64,
    anchored: bool,
}

impl SimulatedLedger {
    /// A scene from its start on; a pool's threads share the work.
    pub fn new(scene: Scene, pool: Option<Arc<rayon::ThreadPool>>) -> Self {
        let scene = Arc::new(scene);
        let items = Simulation::new(Arc::clone(&scene), pool).peekable();
        Self { scene, items, next_seq: 0, beat: 0, anchored: false }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    fn beat(&mut self) -> (RigNs, Body) {
        let at = RigNs(self.beat * TICK.0);
        if self.beat % TICKS_PER_ANCHOR == 0 && !std::mem::replace(&mut self.anchored, true) {
            let UnixNs(zero) = self.scene.unix_at_zero();
            return (at, Body::Anchor { unix: UnixNs(zero + at.0) });
        }
        self.anchored = false;
        self.beat += 1;
        (at, Body::Tick)
    }
}

impl Iterator for SimulatedLedger {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        let due = RigNs(self.beat * TICK.0);
        let (arrived, body) = match self.items.peek() {
            Some(item) if item.arrived < due => {
                let item = self.items.next()?;
                (item.arrived, item.body)
            }
            Some(_) => self.beat(),
            None => return None,
        };
        let seq = self.next_seq;
        self.next_seq += 1;
        Some(Event { seq, arrived, body })
    }
}

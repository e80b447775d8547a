//! A simulated session as a ledger: what the sensors send, ticks and anchors.

use std::convert::Infallible;
use std::sync::Arc;

use tumbled_io::capture::Heartbeat;
use tumbled_model::Event;
use tumbled_sim::scene::Scene;
use tumbled_sim::session::{Item, Simulation};

/// The ledger of a scene.
#[derive(Debug)]
pub struct SimulatedLedger {
    scene: Arc<Scene>,
    events: Heartbeat<Sent>,
}

impl SimulatedLedger {
    /// A scene from its start on; a pool's threads share the work.
    pub fn new(scene: Scene, pool: Option<Arc<rayon::ThreadPool>>) -> Self {
        let scene = Arc::new(scene);
        let sent = Sent(Simulation::new(Arc::clone(&scene), pool));
        let events = Heartbeat::new(sent, Some(scene.unix_at_zero()));
        Self { scene, events }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
}

impl Iterator for SimulatedLedger {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        match self.events.next()? {
            Ok(event) => Some(event),
            Err(never) => match never {},
        }
    }
}

/// What the sensors send, as a source that never fails. The heartbeat numbers it.
#[derive(Debug)]
struct Sent(Simulation);

impl Iterator for Sent {
    type Item = Result<Event, Infallible>;

    fn next(&mut self) -> Option<Self::Item> {
        let Item { arrived, body } = self.0.next()?;
        Some(Ok(Event { seq: 0, arrived, body }))
    }
}

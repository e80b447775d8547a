//! A simulated session as a ledger: what the sensors send, ticks and anchors, and the scene's own faults.

use std::convert::Infallible;
use std::sync::Arc;

use tumbled_io::capture::Heartbeat;
use tumbled_model::Event;
use tumbled_sim::faults::{FaultInjector, FaultTruth};
use tumbled_sim::scene::Scene;
use tumbled_sim::session::{Item, Simulation};

/// The ledger of a scene, with the scene's own faults.
#[derive(Debug)]
pub struct SimulatedLedger {
    scene: Arc<Scene>,
    events: FaultInjector<Healthy>,
}

impl SimulatedLedger {
    /// A scene from its start on; a pool's threads share the work.
    pub fn new(scene: Scene, pool: Option<Arc<rayon::ThreadPool>>) -> Self {
        let scene = Arc::new(scene);
        let sent = Sent(Simulation::new(Arc::clone(&scene), pool));
        let healthy = Healthy(Heartbeat::new(sent, Some(scene.unix_at_zero())));
        let events = FaultInjector::of_scene(healthy, &scene);
        Self { scene, events }
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// What of the scene's own faults has been done so far; `None`: it has none.
    pub fn faults(&self) -> Option<&FaultTruth> {
        (!self.scene.config.fault.is_empty()).then(|| self.events.truth())
    }
}

impl Iterator for SimulatedLedger {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        self.events.next()
    }
}

/// The ledger of a scene before anything goes wrong.
#[derive(Debug)]
struct Healthy(Heartbeat<Sent>);

impl Iterator for Healthy {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        match self.0.next()? {
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

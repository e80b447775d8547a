//! Where a scene's target truly is: what `truth.csv` holds, and what campaigns compare with.

use tumbled_core::evaluate::TruthSample;
use tumbled_model::{RigNs, Span};
use tumbled_sim::scene::Scene;

/// From one sample to the next.
pub const EVERY: Span = Span(10_000_000);

/// A hundred times a second from the start to the end: pose of the mesh's frame in the rig's, angular velocity in rig axes.
pub fn samples(scene: &Scene) -> impl Iterator<Item = TruthSample> + '_ {
    let times = (0..=scene.duration().0 / EVERY.0).map(|n| RigNs(n * EVERY.0));
    times.map_while(|t| sample(scene, t))
}

/// At one time. `None`: the scene has no target then.
pub fn sample(scene: &Scene, t: RigNs) -> Option<TruthSample> {
    let state = scene.world.target(t)?;
    Some(TruthSample { t, t_rig_target: state.t_rig_body, angular_velocity_rps: state.angular_velocity_rps })
}

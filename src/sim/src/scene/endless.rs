//! A scene as a live session plays it: it has no end.

use super::build::Scene;
use super::config::{SceneConfig, SceneMotion};
use super::error::SceneError;
use crate::motion::Motion;
use crate::motion::repeated::Repeated;
use crate::shape::Mesh;
use crate::world::{Body, Role, World};
use std::sync::Arc;
use tumbled_model::UnixNs;

impl Scene {
    /// How long an endless scene lasts all the same, s: 11 days. Beyond it the sensors fall silent.
    pub const ENDLESS_S: f64 = 1e6;

    /// A scene that goes on beyond its `duration_s`, on a host whose wall clock says `unix_at_zero` at its start.
    ///
    /// Stages turn on, and what stands still stays. What would leave (a tumbling target drifts, a person walks by) starts
    /// over after each `duration_s`. The sensors never notice: their clocks and their noise go on. `brought`: as in
    /// [`Scene::build_with`].
    ///
    /// # Errors
    /// As [`Scene::build`].
    pub fn endless(config: SceneConfig, brought: Option<Mesh>, unix_at_zero: UnixNs) -> Result<Self, SceneError> {
        // Says what is wrong with the duration that the file has.
        let period = Self::build_with(config.clone(), brought.clone())?.duration();
        let unix_ns_at_zero = unix_at_zero.0;
        let scene = Self::build_with(SceneConfig { duration_s: Self::ENDLESS_S, unix_ns_at_zero, ..config }, brought)?;
        let target_stays = matches!(scene.config.motion, SceneMotion::Turntable { .. } | SceneMotion::Still { .. });
        let bodies = scene.world.bodies().iter().map(|body| {
            let stays = match body.role {
                // A stand goes where its target goes.
                Role::Target | Role::Mount => target_stays,
                Role::Intruder => false,
                Role::Room => true,
            };
            if stays {
                return body.clone();
            }
            let motion: Arc<dyn Motion> = Arc::new(Repeated { motion: Arc::clone(&body.motion), period });
            Body { motion, ..body.clone() }
        });
        let world = World::new(bodies.collect());
        Ok(Self { world, ..scene })
    }
}

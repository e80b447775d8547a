//! A scene that can be simulated.

use super::bodies::{bodies, span, stops, turntable};
use super::config::{SceneConfig, SceneMotion};
use super::error::SceneError;
use super::limits;
use super::units::{KinectUnit, LidarUnit, kinect_unit, lidar_unit};
use crate::faults::FaultScript;
use crate::motion::poses::Stop;
use crate::motion::turntable::Turntable;
use crate::shape::Mesh;
use crate::turntable as line;
use crate::world::World;
use std::sync::Arc;
use tumbled_model::{Span, UnixNs};

/// A scene, ready to be simulated.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The keys it was built from.
    pub config: SceneConfig,
    /// The target's surface in its own frame.
    pub surface: Arc<Mesh>,
    /// What there is to see.
    pub world: World,
    /// The LiDARs.
    pub lidars: Vec<LidarUnit>,
    /// The Kinects.
    pub kinects: Vec<KinectUnit>,
}

impl Scene {
    /// Builds a scene whose target is one of the simulator's own.
    ///
    /// # Errors
    /// [`SceneError`]: keys that describe no scene, or one whose target is in a file.
    pub fn build(config: SceneConfig) -> Result<Self, SceneError> {
        Self::build_with(config, None)
    }

    /// Builds a scene; `brought`: the surface in the file that the scene names, in that file's unit.
    ///
    /// # Errors
    /// [`SceneError`]: keys that describe no scene.
    pub fn build_with(config: SceneConfig, brought: Option<Mesh>) -> Result<Self, SceneError> {
        limits::check(&config)?;
        check_faults(&config)?;
        let lidars = config.lidar.iter().map(|lidar| lidar_unit(lidar, &config)).collect::<Result<_, _>>()?;
        let kinects = config.kinect.iter().map(kinect_unit).collect::<Result<_, _>>()?;
        let surface = Arc::new(config.target.surface(brought)?);
        let world = World::new(bodies(&config, Arc::clone(&surface))?);
        Ok(Self { config, surface, world, lidars, kinects })
    }

    /// The scene's own faults.
    pub fn faults(&self) -> FaultScript {
        script(&self.config)
    }

    /// The rests of a motion that has some: where the target is, from when until when.
    pub fn rests(&self) -> Vec<Stop> {
        stops(&self.config.motion).ok().flatten().map(|poses| poses.stops().to_vec()).unwrap_or_default()
    }

    /// How long it lasts.
    pub fn duration(&self) -> Span {
        span(self.config.duration_s)
    }

    /// Wall time at its start.
    pub fn unix_at_zero(&self) -> UnixNs {
        UnixNs(self.config.unix_ns_at_zero)
    }

    /// The turntable under the target, if there is one.
    pub fn stage(&self) -> Option<Turntable> {
        match &self.config.motion {
            SceneMotion::Turntable { axis, center_m, mount, profile } => turntable(axis, center_m, mount, profile).ok(),
            SceneMotion::Tumble { .. }
            | SceneMotion::Still { .. }
            | SceneMotion::Poses { .. }
            | SceneMotion::Views(_) => None,
        }
    }
}

fn script(config: &SceneConfig) -> FaultScript {
    FaultScript { seed: config.seed, fault: config.fault.clone() }
}

fn check_faults(config: &SceneConfig) -> Result<(), SceneError> {
    script(config).check()?;
    let sensors = || config.lidar.iter().map(|lidar| &lidar.id).chain(config.kinect.iter().map(|kinect| &kinect.id));
    // The stage is on the line of a motion that has one, whatever its bytes are called there.
    let known = |name: &String| name == line::SENSOR || sensors().any(|id| id == name);
    let named = config.fault.iter().zip(1..).filter_map(|(fault, number)| Some((fault.sensor.as_ref()?, number)));
    for (name, number) in named {
        if !known(name) {
            let key = format!("fault {number}: sensor");
            return Err(SceneError::Word { key, found: name.clone(), expected: "the id of a sensor of the scene" });
        }
    }
    Ok(())
}

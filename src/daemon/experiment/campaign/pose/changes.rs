//! Scenes other than they are in their files.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_sim::faults::Fault;
use tumbled_sim::scene::{SceneConfig, SceneMotion};

/// What is other than in a scene's file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneChanges {
    /// Turns a minute of the LiDARs; left out: the scene's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lidar_rpm: Option<u32>,
    /// Times the noise of the scene's sensors: of the LiDARs' ranges, of the Kinects' disparity.
    pub noise: f64,
    /// Times the Kinects' warp.
    pub warp: f64,
    /// Where the target is along the rig's x, m: its turntable, or the place it tumbles from; left out: the scene's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_m: Option<f64>,
    /// The orbit's mean motion, rad/s, of a scene that tumbles; left out: the scene's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_motion_rps: Option<f64>,
    /// What goes wrong besides the scene's own faults.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<Fault>,
}

impl Default for SceneChanges {
    fn default() -> Self {
        Self { lidar_rpm: None, noise: 1.0, warp: 1.0, distance_m: None, mean_motion_rps: None, fault: Vec::new() }
    }
}

impl SceneChanges {
    /// Changes a scene's keys.
    ///
    /// # Errors
    /// A scene without what would be changed, in words.
    pub fn make(&self, scene: &mut SceneConfig) -> Result<(), String> {
        for lidar in &mut scene.lidar {
            lidar.rpm = self.lidar_rpm.unwrap_or(lidar.rpm);
            lidar.parameters.range_sigma_m *= self.noise;
        }
        for kinect in &mut scene.kinect {
            kinect.parameters.noise_share *= self.noise;
            kinect.parameters.warp_m *= self.warp;
        }
        if let Some(distance) = self.distance_m {
            let place = match &mut scene.motion {
                SceneMotion::Turntable { center_m, .. } => center_m,
                SceneMotion::Tumble { start, .. } => &mut start.translation_m,
                _ => return Err("distance_m is of a target that is on a turntable or tumbles".to_owned()),
            };
            scene.roi_center_m[0] += distance - place[0];
            place[0] = distance;
        }
        if let Some(rate) = self.mean_motion_rps {
            let SceneMotion::Tumble { mean_motion_rps, .. } = &mut scene.motion else {
                return Err("mean_motion_rps is of a target that tumbles".to_owned());
            };
            *mean_motion_rps = rate;
        }
        scene.fault.extend(self.fault.iter().cloned());
        Ok(())
    }
}

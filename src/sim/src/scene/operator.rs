//! What an operator of a scene's rig has instead of the truth: calibrations that are off by as much as the scene says.

use super::build::Scene;
use super::config::Transform;
use crate::noise::Noise;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

impl Scene {
    /// A mounting as an operator would have it: the truth, turned and moved by what a calibration leaves.
    pub fn operators_mounting(&self, sensor: &str, truth: &Transform) -> Transform {
        let errors = self.config.operator;
        let mut noise = Noise::new(self.config.seed, &format!("operator.{sensor}"), 0);
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| noise.normal() * sigma);
        // The standard deviations are of the whole: a third of the variance for each axis.
        let share = 1.0 / 3f64.sqrt();
        let turned = UnitQuaternion::from_scaled_axis(vector(errors.rotation_deg.to_radians() * share));
        let moved = Translation3::from(vector(errors.translation_m * share));
        let truth = truth.isometry();
        let off =
            Isometry3::from_parts(Translation3::from(moved.vector + truth.translation.vector), turned * truth.rotation);
        Transform::from(&off)
    }

    /// A Kinect's depth scale (true depth over measured depth) as an operator would have it: the truth and what a
    /// calibration leaves.
    pub fn operators_depth_scale(&self, sensor: &str, truth: f64) -> f64 {
        let mut noise = Noise::new(self.config.seed, &format!("operator.{sensor}.depth_scale"), 0);
        truth * (1.0 + noise.normal() * self.config.operator.depth_scale)
    }

    /// A time offset as an operator would have it, s: the truth and what a calibration leaves.
    pub fn operators_time_s(&self, sensor: &str, truth_s: f64) -> f64 {
        truth_s
            + Noise::new(self.config.seed, &format!("operator.{sensor}.time"), 0).normal() * self.config.operator.time_s
    }
}
